"""What is written of a training: one table or row for each refit, and pictures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch as th
from sb3_contrib import ARS
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback, EvalCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.logger import configure
from stable_baselines3.common.monitor import load_results

from helpers import ENV_ID, imagination_env, random_transitions, small_callback, small_sac, state_of
from sb3_hucrl import ImaginationVecEnv, plots
from sb3_hucrl.sb3 import logging

#: what SB3 records for an algorithm that trains for two real episodes after the random one
RECORDED = {
    SAC: ["rollout/ep_rew_mean", "time/fps", "train/critic_loss"],
    PPO: ["rollout/ep_rew_mean", "time/fps", "train/value_loss"],
    ARS: ["rollout/ep_rew_mean", "time/fps", "train/delta_std"],
}
SMALL: dict[Any, dict[str, Any]] = {SAC: {"batch_size": 16}, PPO: {"n_steps": 5, "batch_size": 20}, ARS: {"n_delta": 2}}


def rows_of(folder: Path) -> pd.DataFrame:
    return pd.read_csv(folder / "progress.csv")


def test_monitor_and_progress_files_hold_the_real_episodes_in_order(tmp_path: Path) -> None:
    env = ImaginationVecEnv(make_vec_env(ENV_ID, 4, seed=0, monitor_dir=str(tmp_path)))
    small_sac(env).learn(160, callback=small_callback(log_dir=str(tmp_path), start_states={"initial": 1}))
    monitor = load_results(str(tmp_path))
    assert monitor.l.tolist() == [400] * 3
    progress = pd.read_csv(tmp_path / "progress.csv").dropna(subset=["real/return"])
    assert progress["real/episode"].tolist() == [1, 2, 3]
    assert progress["real/steps"].tolist() == [400, 800, 1200]
    np.testing.assert_allclose(progress["real/return"], monitor.r, atol=1e-3)
    later = progress.iloc[1:][["imagined/return", "imagined/epistemic_std", "dynamics/holdout_nll"]]
    assert np.isfinite(later.to_numpy(dtype=float)).all()
    assert (progress[["time/rollout_seconds", "time/fit_seconds"]].to_numpy() > 0).all()


def test_logs_to_tensorboard_too(tmp_path: Path) -> None:
    event_accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    model = small_sac()
    model.set_logger(configure(str(tmp_path), ["tensorboard"]))
    model.learn(160, callback=small_callback())
    events = event_accumulator.EventAccumulator(str(tmp_path)).Reload()
    assert [event.value for event in events.Scalars("real/episode")] == [1, 2, 3]
    assert len(events.Scalars("dynamics/calibration_error_1")) == 3
    assert len(events.Images("dynamics/reliability")) == 3
    assert "imagined/episode" not in events.Tags()["images"]


@pytest.mark.parametrize(("real_envs", "pictured", "expected"), [(1, [10, 20], [900, 1900]), (3, [10, 22], [300, 700])])
def test_every_tenth_real_episode_is_a_picture_in_tensorboard(
    real_envs: int, pictured: list[int], expected: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    event_accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    drawn: list[tuple[Any, ...]] = []

    def episode_figure(*given: Any) -> Any:
        drawn.append(given)
        return plots.episode_figure(*given)

    monkeypatch.setattr(logging, "episode_figure", episode_figure)
    model = small_sac(imagination_env(max_episode_steps=10))
    model.set_logger(configure(str(tmp_path), ["tensorboard", "csv", "json", "log"]))
    model.learn(expected[-1], callback=small_callback(imagined_steps=100, real_envs=real_envs))
    images = event_accumulator.EventAccumulator(str(tmp_path)).Reload().Images("imagined/episode")
    assert [image.step for image in images] == expected
    assert all(image.encoded_image_string.startswith(b"\x89PNG") for image in images)
    episodes = state_of(model).dataset.episodes
    for number, (real, imagined, title, angles) in zip(pictured, drawn, strict=True):
        assert angles == (0,)
        assert title == f"real episode {number}"
        assert real.states.equal(episodes[number - 1].states)
        # Both begin in the pendulum's only initial state.
        assert imagined.states[0].equal(real.states[0])
        assert len(imagined) == 10


def test_a_turn_that_is_complete_is_no_difference_in_a_picture() -> None:
    turning = th.linspace(3.1, 3.1 + 4 * np.pi, 40)
    wrapped = (turning + np.pi) % (2 * np.pi) - np.pi
    still = random_transitions(40)
    real, imagined = (
        replace(still, states=th.stack([angle, still.states[:, 1]], dim=1)) for angle in (wrapped, turning - 2 * np.pi)
    )
    figure = plots.episode_figure(real, imagined, "a turn", angle_dims=(0,))
    [panel] = [axis for axis in figure.axes if axis.get_title() == "state 0"]
    for line in panel.lines:
        np.testing.assert_allclose(np.asarray(line.get_ydata()), turning.numpy(), atol=1e-4)


def test_a_picture_of_an_episode_shows_returns_actions_and_states() -> None:
    real, imagined = random_transitions(30, seed=0), random_transitions(20, seed=1)
    figure = plots.episode_figure(real, imagined, "real episode 10")
    panels = {axis.get_title(): axis for axis in figure.axes}
    assert [*panels] == ["return so far", "action 0", "state 0", "state 1"]
    for name, expected in {"action 0": "actions", "state 1": "states"}.items():
        drawn = [line.get_ydata() for line in panels[name].lines]
        for values, episode in zip(drawn, (real, imagined), strict=True):
            np.testing.assert_array_equal(values, getattr(episode, expected)[:, -1])
    totals = [float(np.asarray(line.get_ydata())[-1]) for line in panels["return so far"].lines]
    assert totals == pytest.approx([float(each.rewards.sum()) for each in (real, imagined)], rel=1e-4)
    assert figure.get_suptitle() == f"real episode 10: return real {totals[0]:.1f}, imagined {totals[1]:.1f}"


@pytest.mark.parametrize("algorithm", RECORDED)
def test_one_row_for_each_real_episode_with_what_sb3_recorded(algorithm: Any, tmp_path: Path) -> None:
    policy = "LinearPolicy" if algorithm is ARS else "MlpPolicy"
    model = algorithm(policy, imagination_env(), device="cpu", seed=0, **SMALL[algorithm])
    logger = configure(str(tmp_path), ["csv"])
    model.set_logger(logger)
    model.learn(320, callback=small_callback(imagined_steps=160), log_interval=1)
    rows = rows_of(tmp_path)
    assert rows["real/episode"].tolist() == [1, 2, 3]
    assert rows.loc[1:, RECORDED[algorithm]].notna().all(axis=None)
    assert rows["time/total_timesteps"].tolist() == [0, 160, 320]
    assert model.logger is logger
    assert "dump" not in vars(logger)


def test_a_verbose_script_prints_one_table_for_each_real_episode(capsys: pytest.CaptureFixture[str]) -> None:
    small_sac(verbose=2).learn(160, callback=small_callback())
    printed = capsys.readouterr().out
    assert printed.count("|    episode ") == 3
    assert printed.count("|    fps ") == 2
    assert printed.count("| real/ ") == 3
    assert printed.count("| time/ ") == 3


def test_evaluations_are_written_when_they_are_made(tmp_path: Path) -> None:
    model = small_sac()
    model.set_logger(configure(str(tmp_path), ["csv"]))
    evaluation = EvalCallback(imagination_env(1), eval_freq=5, n_eval_episodes=1, verbose=0)
    model.learn(80, callback=[small_callback(), evaluation])
    rows = rows_of(tmp_path)
    assert rows["eval/mean_reward"].dropna().index.tolist() == [1, 2, 3, 4]
    assert rows["time/total_timesteps"].tolist() == [0, 20, 40, 60, 80, 80]


class Interrupt(BaseCallback):
    """Ends a training as Ctrl-C does, and counts what is recorded on the way."""

    def _on_step(self) -> bool:
        self.logger.record("mine/steps", self.num_timesteps)
        if self.num_timesteps >= 40:
            raise KeyboardInterrupt
        return True


def test_an_interruption_leaves_the_logger_in_order(tmp_path: Path) -> None:
    env = imagination_env(max_episode_steps=20)
    model = small_sac(env)
    model.set_logger(configure(str(tmp_path), ["csv"]))
    with pytest.raises(KeyboardInterrupt):
        model.learn(160, callback=[small_callback(), Interrupt()], log_interval=1)
    assert len(rows_of(tmp_path)) == 1
    with pytest.warns(UserWarning, match="was interrupted"):
        model.learn(80, callback=small_callback(), log_interval=1)
    rows = rows_of(tmp_path)
    assert rows["real/episode"].tolist() == [1, 2]
    assert rows["mine/steps"].tolist()[1:] == [40]
    # Without the callback SB3 writes as it always does: all four environments end at once, twice.
    model.learn(160, log_interval=1)
    assert len(rows_of(tmp_path)) == 2 + 8
