"""A resumed run goes on with the plan of the one that was stopped, in one learning curve."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import rl_zoo3.train
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import load_results

import sb3_hucrl.zoo  # noqa: F401  # for its effect
from helpers import ENV_ID, imagination_env, small_callback, small_sac, state_of
from sb3_hucrl import HUCRLCallback, plot_run
from sb3_hucrl.sb3 import saved_curve
from sb3_hucrl.sb3.curve import carried_lines, line_of
from sb3_hucrl.zoo.runs import ZooRun

DATA = Path(__file__).parent / "data"
#: four searches of 160 timesteps
PLAN = 640
SETTINGS = {"horizon": 20, "imagined_steps": 160, "dynamics_kwargs": {"gradient_steps": 5, "net_arch": [16]}}
#: the last two real episodes play the mode
TIMESTEPS, MODES = [0, 160, 320, 480, 640], [False, False, True, True, True]
TRAIN = [
    *("train", "--algo", "sac", "--env", ENV_ID, "--eval-freq", "-1", "--env-kwargs", "max_episode_steps:40"),
    *("--device", "cpu", "--verbose", "1"),
]

Zoo = Callable[..., Path]


class KilledError(Exception):
    """Ends a run without saving anything."""


class Stop(BaseCallback):
    """
    Ends a training.

    :param at: number of timesteps
    :param politely: as Ctrl-C does
    """

    def __init__(self, at: int, politely: bool) -> None:
        super().__init__()
        self.at, self.politely = at, politely

    def _on_step(self) -> bool:
        if self.num_timesteps >= self.at:
            raise KeyboardInterrupt if self.politely else KilledError
        return True


@pytest.fixture
def zoo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Zoo:
    """Trains as ``rl_zoo3 train`` does, with further arguments, and returns the folder of the run."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")

    def train(*more: str, stop: Stop | None = None, n: int = PLAN, params: tuple[str, ...] = ()) -> Path:
        known = set(tmp_path.glob("logs/sac/*"))
        callbacks: list[object] = [{"sb3_hucrl.HUCRLCallback": SETTINGS}]
        if stop is not None:
            callbacks.append({"test_resume_curve.Stop": {"at": stop.at, "politely": stop.politely}})
        given = ["gradient_steps:1", "n_envs:4", "policy_kwargs:dict(net_arch=[16])", *params, f"callback:{callbacks}"]
        monkeypatch.setattr(sys, "argv", [*TRAIN, "-n", str(n), *more, "-params", *given])
        try:
            rl_zoo3.train.train()
        except KilledError:
            assert stop is not None
        [folder] = set(tmp_path.glob("logs/sac/*")) - known
        return folder

    return train


def progress_of(folder: Path) -> pd.DataFrame:
    return pd.read_csv(folder / "progress.csv")


def assert_whole(folder: Path, timesteps: list[int], modes: list[bool]) -> None:
    """Each real episode is there once, in order, and the same in all files."""
    progress, monitor = progress_of(folder), load_results(str(folder))
    assert progress["real/episode"].tolist() == list(range(1, len(timesteps) + 1))
    assert progress["real/steps"].tolist() == [40 * number for number in range(1, len(timesteps) + 1)]
    assert progress["time/total_timesteps"].tolist() == timesteps
    assert progress["imagined/mode_return"].notna().tolist() == modes
    assert progress["imagined/epistemic_std"].notna().tolist() == [False] + [True] * (len(timesteps) - 1)
    assert monitor.l.tolist() == [40] * len(timesteps)
    assert monitor.r.tolist() == pytest.approx(progress["real/return"].tolist(), abs=1e-3)
    assert (monitor.t.diff()[1:] > 0).all()
    assert len(pd.read_csv(folder / "0.monitor.csv", skiprows=1)) == len(timesteps)
    [model] = folder.glob(f"{ENV_ID}.zip")
    assert state_of(SAC.load(model, device="cpu")).dataset.lengths == [40] * len(timesteps)


@pytest.mark.slow
def test_the_uninterrupted_plan_is_what_the_others_are_compared_with(zoo: Zoo) -> None:
    assert_whole(zoo(), TIMESTEPS, MODES)


@pytest.mark.slow
@pytest.mark.parametrize("at", [20, 300])
@pytest.mark.parametrize("politely", [False, True], ids=["killed", "ctrl-c"])
def test_an_interrupted_plan_ends_where_it_would_have_ended(
    zoo: Zoo, at: int, politely: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    first = zoo(stop=Stop(at, politely))
    before = progress_of(first)
    assert 1 <= len(before) < 5
    second = zoo("-i", str(first / (f"{ENV_ID}.zip" if politely else "checkpoint.zip")))
    assert_whole(second, TIMESTEPS, MODES)
    pd.testing.assert_frame_equal(progress_of(second)[: len(before)][before.columns], before, check_dtype=False)
    # A search that is interrupted politely goes on where it was; one that is killed begins anew.
    done = at if politely else at // 160 * 160
    assert f"goes on at timestep {done} of {PLAN}" in capsys.readouterr().out


@pytest.mark.slow
def test_all_that_may_be_missing_is_the_last_real_episode(zoo: Zoo) -> None:
    first = zoo("--save-freq", str(PLAN))
    second = zoo("-i", str(first / f"rl_model_{PLAN}_steps.zip"))
    assert_whole(second, TIMESTEPS, MODES)


@pytest.mark.slow
def test_a_whole_plan_is_followed_by_as_many_timesteps_again(zoo: Zoo) -> None:
    first = zoo()
    second = zoo("-i", str(first / "checkpoint.zip"), "--vec-env", "subproc", n=320)
    assert_whole(second, [*TIMESTEPS, 800, 960], [*MODES, True, True])
    # More than before: the rest of a longer plan, of which less than half is done.
    third = zoo("-i", str(second / f"{ENV_ID}.zip"), n=2_400, stop=Stop(1_200, politely=False))
    assert progress_of(third)["time/total_timesteps"].tolist() == [*TIMESTEPS, 800, 960, 1_120]
    assert progress_of(third)["imagined/mode_return"].notna().tolist() == [*MODES, True, True, False]


@pytest.mark.slow
def test_a_zip_that_lies_elsewhere_holds_the_curve(zoo: Zoo, tmp_path: Path) -> None:
    first = zoo(stop=Stop(300, politely=False))
    moved = tmp_path / "elsewhere" / "mine.zip"
    moved.parent.mkdir()
    shutil.move(first / "checkpoint.zip", moved)
    shutil.rmtree(tmp_path / "logs")
    second = zoo("-i", str(moved))
    assert_whole(second, TIMESTEPS, MODES)


@pytest.mark.slow
def test_a_resumed_run_is_drawn_from_its_first_episode(zoo: Zoo, monkeypatch: pytest.MonkeyPatch) -> None:
    first = zoo(stop=Stop(300, politely=False))
    second = zoo("-i", str(first / "checkpoint.zip"), stop=Stop(500, politely=False))
    assert ZooRun(second).progress.index.tolist() == [1, 2, 3, 4]
    assert [episode.real_episode for episode in ZooRun(second).state.imagined_episodes] == [2, 3, 4]
    monkeypatch.setattr(sys, "argv", ["plot_run", str(second)])
    plot_run.main()
    assert (second / "progress.png").is_file()


@pytest.mark.slow
def test_a_file_of_version_0_1_goes_on_in_a_curve_of_what_it_holds(zoo: Zoo) -> None:
    version_0_1 = DATA / "version_0_1_sac.zip"
    state = state_of(SAC.load(version_0_1, device="cpu"))
    done = SAC.load(version_0_1, device="cpu").num_timesteps
    folder = zoo("-i", str(version_0_1), n=done + 160)
    progress, monitor = progress_of(folder), load_results(str(folder))
    assert progress["real/episode"].tolist() == [1, 2, 3, 4, 5]
    returns = [float(episode.rewards.sum()) for episode in state.dataset.episodes]
    assert progress["real/return"].tolist()[:4] == pytest.approx(returns, abs=1e-3)
    assert monitor.r.tolist()[:4] == pytest.approx(returns, abs=1e-3)
    assert monitor.l.tolist() == [40] * 5


@pytest.mark.slow
def test_a_zip_without_our_callback_is_resumed_as_rl_zoo3_does(zoo: Zoo, tmp_path: Path) -> None:
    small_sac(imagination_env(max_episode_steps=40), learning_starts=0).learn(200).save(tmp_path / "plain.zip")
    assert saved_curve(tmp_path / "plain.zip") is None
    assert_whole(zoo("-i", str(tmp_path / "plain.zip")), TIMESTEPS, MODES)


def test_a_resumed_script_keeps_the_rows_of_earlier_episodes(tmp_path: Path) -> None:
    def rows() -> list[tuple[int, int]]:
        progress = progress_of(tmp_path)
        return list(zip(progress["real/episode"], progress["time/total_timesteps"], strict=True))

    model = small_sac(imagination_env(max_episode_steps=40)).learn(80, callback=small_callback(log_dir=str(tmp_path)))
    model.save(tmp_path / "model")
    model.learn(160, callback=small_callback(log_dir=str(tmp_path)), reset_num_timesteps=False)
    assert rows() == [(1, 0), (2, 80), (3, 160), (4, 240)]
    written = (tmp_path / "progress.csv").read_text().splitlines()
    # The file has two episodes that the loaded model knows nothing of.
    loaded = SAC.load(tmp_path / "model", env=imagination_env(max_episode_steps=40), device="cpu")
    loaded.learn(80, callback=small_callback(log_dir=str(tmp_path)), reset_num_timesteps=False)
    assert rows() == [(1, 0), (2, 80), (3, 160)]
    kept = (tmp_path / "progress.csv").read_text().splitlines()
    assert sorted(kept[1].split(",")) == sorted(written[1].split(","))
    # Another model has nothing to do with them.
    small_sac(imagination_env(max_episode_steps=40)).learn(80, callback=small_callback(log_dir=str(tmp_path)))
    assert rows() == [(1, 0), (2, 80)]


def test_without_a_folder_the_zip_has_the_curve_all_the_same(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.zip"
    small_sac(imagination_env(max_episode_steps=40)).learn(80, callback=small_callback(checkpoint=str(path)))
    curve = saved_curve(path)
    assert curve is not None
    assert [row["real/episode"] for row in curve["progress"]] == [1, 2]
    assert [row["l"] for row in curve["monitor"]] == [40, 40]


def test_an_episode_that_was_noted_and_not_stored_is_not_in_the_curve() -> None:
    model = small_sac(imagination_env(max_episode_steps=40)).learn(80, callback=small_callback())
    rows = carried_lines(model)["monitor"]
    kept = [*rows]
    rows.append(line_of({"r": 1.0, "l": 40, "t": 1_000.0}))
    assert carried_lines(model)["monitor"] == kept


def test_the_curve_of_an_earlier_version_goes_on() -> None:
    model = small_sac(imagination_env(max_episode_steps=40)).learn(80, callback=small_callback())
    lines = carried_lines(model)
    assert carried_lines(model) is lines
    # In which every value was a line of the file.
    rows = {"progress": [*map(json.loads, lines["progress"])], "monitor": [*map(json.loads, lines["monitor"])]}
    vars(model)["hucrl_curve"] = rows
    model.learn(80, callback=small_callback(), reset_num_timesteps=False)
    now = carried_lines(model)
    assert now["progress"][:2] == lines["progress"]
    assert [json.loads(each)["l"] for each in now["monitor"]] == [40] * 3


class EndsBetweenEpisodes(HUCRLCallback):
    """Is interrupted after the second of the three real episodes that follow a search."""

    def _save(self) -> None:
        super()._save()
        if self._loop.state.real_episodes == 3:
            raise KeyboardInterrupt


def test_the_real_episodes_that_were_to_follow_a_search_are_played(tmp_path: Path) -> None:
    settings: dict[str, Any] = {"imagined_steps": 80, "horizon": 10, "real_episodes": 3}
    settings |= {
        "initial_steps": 1,
        "real_steps": 1,
        "dynamics_kwargs": {"gradient_steps": 5},
        "log_dir": str(tmp_path),
    }
    checkpoint = str(tmp_path / "checkpoint.zip")
    with pytest.raises(KeyboardInterrupt):
        small_sac(imagination_env(max_episode_steps=40)).learn(
            160, callback=EndsBetweenEpisodes(**settings, checkpoint=checkpoint)
        )
    model = SAC.load(checkpoint, env=imagination_env(max_episode_steps=40), device="cpu")
    assert model.num_timesteps == 80
    model.learn(80, callback=HUCRLCallback(**settings), reset_num_timesteps=False)
    assert state_of(model).real_episodes == 1 + 2 * 3
    assert progress_of(tmp_path)["real/episode"].tolist() == [1, 4, 7]
    assert progress_of(tmp_path)["time/total_timesteps"].tolist() == [0, 80, 160]


class Budgets(HUCRLCallback):
    """Notes how long each search is to be."""

    def _start_search(self) -> None:
        super()._start_search()
        self.noted = [*getattr(self, "noted", []), self._loop.imagined_steps]


def test_a_resumed_search_is_as_long_as_the_new_steps_before_it(tmp_path: Path) -> None:
    settings: dict[str, Any] = {"real_episodes": 2, "horizon": 5, "dynamics_kwargs": {"gradient_steps": 5}}
    env, path = imagination_env(max_episode_steps=5), tmp_path / "model"
    first, second = Budgets(**settings), Budgets(**settings)
    small_sac(env, train_freq=16).learn(800, callback=first).save(path)
    SAC.load(path, env=env, device="cpu").learn(64, callback=second, reset_num_timesteps=False)
    # 128 for each of the ten steps of the two latest episodes.
    assert first.noted == [640, 1_280]
    assert second.noted == [1_280]
