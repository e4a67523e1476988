"""What a training prints: one line for each real episode, SB3's tables on request, and a progress bar on request."""

from __future__ import annotations

import io
import re
import sys
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
import pytest
import torch as th
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback, EvalCallback
from stable_baselines3.common.logger import Logger, configure

from helpers import (
    TruePendulum,
    imagination_env,
    pendulum_dataset,
    random_transitions,
    small_callback,
    small_sac,
    state_of,
)
from sb3_hucrl.dynamics import FitReport
from sb3_hucrl.dynamics.calibration import Calibration
from sb3_hucrl.imagination import unseen_r2
from sb3_hucrl.loop import EpisodeLines, PlayedEpisode, Report
from sb3_hucrl.progress import PhaseBar
from sb3_hucrl.sb3 import bar
from sb3_hucrl.tasks import PendulumTask

COLUMNS = ["episode", "real steps", "return", "promised", "model R²", "best", "search", "real", "fit"]
#: of a line, as progress.csv has them; an episode's return is that of a row where it is the only one
LOGGED = {
    "return": "real/return",
    "promised": "imagined/promised_return",
    "model R²": "dynamics/unseen_r2",
    "best": "real/best_return",
    "search": "time/search_seconds",
    "real": "time/rollout_seconds",
    "fit": "time/fit_seconds",
}


def lines_of(printed: str) -> pd.DataFrame:
    """The lines below the header, one row each; a dash or a blank is NaN."""
    text = printed.splitlines()
    [begin] = [number for number, line in enumerate(text) if line.lstrip().startswith("episode real steps")]
    ends, position = [], 0
    for title in COLUMNS:
        position = text[begin].index(title, position) + len(title)
        ends.append(position)
    rows = [line for line in text[begin + 1 :] if re.fullmatch(r" *\d+ +[\d,]+ .*", line)]
    cells = [
        [row[start:end].strip().rstrip("s").replace(",", "") for start, end in zip([0, *ends], ends, strict=False)]
        for row in rows
    ]
    return pd.DataFrame(cells, columns=COLUMNS).replace({"-": "nan", "": "nan"}).astype(float)


def quick_ppo(verbose: int = 0) -> PPO:
    env = imagination_env(max_episode_steps=20)
    return PPO("MlpPolicy", env, n_steps=5, batch_size=20, verbose=verbose, seed=0, device="cpu")


def quick_sac(verbose: int = 0) -> SAC:
    return small_sac(imagination_env(max_episode_steps=20), verbose=verbose)


def tables(printed: str) -> int:
    return printed.count("| real/ ")


def test_the_lines_say_what_progress_csv_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    quick_sac(verbose=1).learn(240, callback=small_callback(log_dir=str(tmp_path)))
    printed = capsys.readouterr().out
    lines, rows = lines_of(printed), pd.read_csv(tmp_path / "progress.csv")
    assert lines["episode"].tolist() == rows["real/episode"].tolist() == [1, 2, 3, 4]
    assert lines["real steps"].tolist() == rows["real/steps"].tolist() == [20, 40, 60, 80]
    for title, column in LOGGED.items():
        rounding = 0.0006 if title == "model R²" else 0.006 if title in ("return", "promised", "best") else 0.06
        np.testing.assert_allclose(lines[title], rows[column], atol=rounding, err_msg=title)
    assert lines["best"].tolist() == lines["return"].cummax().tolist()
    # Nothing is promised of a random episode, nor was there a model that could have predicted it.
    assert lines.iloc[0][["promised", "model R²", "search"]].isna().all()
    assert lines.iloc[1:].notna().all(axis=None)
    assert tables(printed) == 0
    assert all(len(line) <= 79 for line in printed.splitlines() if line.startswith("    "))


def test_every_episode_of_a_round_has_its_own_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = quick_ppo(verbose=1)
    settings = {"real_envs": 3, "real_episodes": 4, "initial_episodes": 2, "log_dir": str(tmp_path)}
    model.learn(80, callback=small_callback(**settings))
    lines, rows = lines_of(capsys.readouterr().out), pd.read_csv(tmp_path / "progress.csv")
    returns = [float(each.rewards.double().sum()) for each in state_of(model).dataset.episodes]
    assert lines["episode"].tolist() == [*range(1, 10)]
    assert lines["real steps"].tolist() == [20 * number for number in range(1, 10)]
    np.testing.assert_allclose(lines["return"], returns, atol=0.006)
    np.testing.assert_allclose(lines["best"], np.maximum.accumulate(returns), atol=0.006)
    # One of those that are played at once is imagined. The model is fitted after the third and the ninth.
    assert lines["promised"].notna().tolist() == [number in (4, 7) for number in range(1, 10)]
    assert lines["model R²"].notna().tolist() == [number > 3 for number in range(1, 10)]
    assert lines["fit"].notna().tolist() == [number in (3, 9) for number in range(1, 10)]
    np.testing.assert_allclose(lines["model R²"].mean(), rows["dynamics/unseen_r2"].iloc[1], atol=0.0006)
    np.testing.assert_allclose(lines["promised"].iloc[6], rows["imagined/promised_return"].iloc[1], atol=0.006)


def test_a_resumed_training_goes_on_counting(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = quick_sac(verbose=1)
    model.learn(80, callback=small_callback())
    best = lines_of(capsys.readouterr().out)["best"].iloc[-1]
    model.save(tmp_path / "model.zip")
    loaded = SAC.load(tmp_path / "model.zip", env=imagination_env(max_episode_steps=20))
    loaded.learn(80, callback=small_callback(), reset_num_timesteps=False)
    printed = capsys.readouterr().out
    [line] = lines_of(printed).to_dict("records")
    assert (line["episode"], line["real steps"]) == (3, 60)
    assert line["best"] >= best
    assert "Resuming with 2 real episodes" in printed


@pytest.mark.parametrize("make", [quick_sac, quick_ppo])
@pytest.mark.parametrize(
    ("algorithm", "callback", "prints"),
    [
        (0, None, "nothing"),
        (1, None, "lines"),
        (2, None, "tables"),
        (1, 0, "nothing"),
        (0, 1, "lines"),
        (0, 2, "tables"),
    ],
)
def test_verbosity(
    make: Any, algorithm: int, callback: int | None, prints: str, capsys: pytest.CaptureFixture[str]
) -> None:
    model = make(verbose=algorithm)
    capsys.readouterr()
    model.learn(80, callback=small_callback(verbose=callback), log_interval=1)
    printed = capsys.readouterr().out
    assert tables(printed) == (2 if prints == "tables" else 0)
    # SB3 says of an algorithm that is not silent what it trains with.
    assert ("model R²" in printed) == (prints == "lines")
    if prints == "nothing" and algorithm == 0:
        assert printed == ""
    if prints == "tables":
        assert printed.count("unseen_r2") == 1
        assert printed.count("best_return") == 2


def test_nothing_is_printed_at_verbose_0_not_even_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    quick_sac().learn(80, callback=small_callback())
    assert capfd.readouterr() == ("", "")


def tables_on_stdout() -> Logger:
    return configure(None, ["stdout"])


def test_a_logger_of_ones_own_that_prints_gets_lines(capsys: pytest.CaptureFixture[str]) -> None:
    model = quick_sac()
    model.set_logger(tables_on_stdout())
    [output] = model.logger.output_formats
    model.learn(80, callback=small_callback())
    assert len(lines_of(capsys.readouterr().out)) == 2
    assert model.logger.output_formats == [output]


def test_evaluations_print_no_tables_between_the_lines(capsys: pytest.CaptureFixture[str]) -> None:
    evaluation = EvalCallback(imagination_env(1, max_episode_steps=20), eval_freq=5, n_eval_episodes=1, warn=False)
    quick_sac(verbose=1).learn(80, callback=[small_callback(), evaluation])
    printed = capsys.readouterr().out
    assert len(lines_of(printed)) == 2
    assert "| eval/" not in printed
    # SB3's callback says by itself what it found.
    assert printed.count("Eval num_timesteps=") == 4


class Broken(BaseCallback):
    """Fails after some steps."""

    def _on_step(self) -> bool:
        if self.model.num_timesteps >= 40:
            raise RuntimeError("broken")
        return True


@pytest.mark.parametrize("verbose", [1, 2])
def test_after_an_error_sb3_prints_its_tables_again(verbose: int, capsys: pytest.CaptureFixture[str]) -> None:
    model = quick_sac()
    model.set_logger(tables_on_stdout())
    with pytest.raises(RuntimeError, match="broken"):
        model.learn(80, callback=[small_callback(verbose=verbose), Broken()])
    capsys.readouterr()
    with pytest.warns(UserWarning, match="was interrupted"):
        model.learn(80, log_interval=4)
    assert capsys.readouterr().out.count("| rollout/ ") == 1


def report_of(*episodes: PlayedEpisode, **seconds: float) -> Report:
    calibration = Calibration.measure(th.zeros(1, 2), th.ones(1, 2), th.ones(2))
    scalars = {f"time/{name}_seconds": value for name, value in seconds.items()}
    return Report(scalars, FitReport(0.0, 1, 0.0, calibration), list(episodes))


def test_large_numbers_keep_the_columns(capsys: pytest.CaptureFixture[str]) -> None:
    lines = EpisodeLines()
    lines.print(report_of(PlayedEpisode(1, 1000, -1234.567, None, None, -1234.567), rollout=12345.6, fit=0.04))
    lines.print(report_of(PlayedEpisode(99999, 99_999_999, 1.5e12, -2.5e9, -123456.7, 1.5e12), fit=1.0))
    lines.print(report_of(PlayedEpisode(3, 2000, float("nan"), 54321.6, float("-inf"), 12345678.9), search=999.94))
    printed = capsys.readouterr().out
    widths = {len(line) for line in printed.splitlines()}
    assert len(widths) == 1
    table = lines_of(printed)
    assert table["return"].tolist()[:2] == [-1234.57, 1.5e12]
    assert table["promised"].tolist()[1:] == [-2.5e9, 54322]
    assert table["model R²"].tolist()[1:] == [-123457, -np.inf]
    assert table["real"].iloc[0] == 12346
    assert table["search"].iloc[2] == 999.9


def test_a_file_without_superscripts_gets_the_lines_too(monkeypatch: pytest.MonkeyPatch) -> None:
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding="ascii"))
    EpisodeLines().print(report_of(PlayedEpisode(1, 20, 1.0, None, None, 1.0)))
    assert b"model R? " in written.getvalue()


@pytest.mark.parametrize(("r2", "colour"), [(0.95, "32"), (0.8, "33"), (0.5, "31")])
def test_colours_where_the_terminal_can(
    r2: float, colour: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    report = report_of(PlayedEpisode(2, 40, 1.0, 2.0, r2, 3.0), fit=1.0)
    EpisodeLines().print(report)
    plain = capsys.readouterr().out
    assert "\x1b" not in plain
    for name, value in {"FORCE_COLOR": "1", "TERM": "xterm", "COLUMNS": "40"}.items():
        monkeypatch.setenv(name, value)
    EpisodeLines().print(report)
    coloured = capsys.readouterr().out
    assert f"\x1b[{colour}m{r2:8.3f}\x1b[0m" in coloured
    assert re.sub(r"\x1b\[[\d;]*m", "", coloured) == plain


def test_r2_of_an_unseen_episode() -> None:
    dataset, episode = pendulum_dataset(400), random_transitions(50, seed=1)
    dataset.append_episode(episode)
    bias, change = 0.05, (dataset.transitions.next_states - dataset.transitions.states).numpy()
    change[:, 0] = (change[:, 0] + np.pi) % (2 * np.pi) - np.pi
    exact, biased = (unseen_r2(TruePendulum(each), [episode], dataset, PendulumTask()) for each in (0.0, bias))
    assert exact == pytest.approx([1.0], abs=1e-6)
    # PyTorch's median of two dimensions is the lower one.
    assert biased == pytest.approx([1 - bias**2 / change.var(axis=0).min()], rel=1e-3)


class Recorder(PhaseBar):
    """Remembers what a bar would show."""

    shown: ClassVar[list[tuple[str, int | None, int]]] = []

    def begin(self, label: str, total: int | None, completed: int = 0) -> None:
        super().begin(label, total, completed)
        self.shown.append((label, total, completed))

    def advance(self, steps: int = 1) -> None:
        super().advance(steps)
        label, total, completed = self.shown[-1]
        self.shown[-1] = label, total, completed + steps


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int | None, int]]:
    monkeypatch.setattr(bar, "PhaseBar", Recorder)
    monkeypatch.setattr(Recorder, "shown", [])
    return Recorder.shown


@pytest.mark.parametrize("make", [quick_sac, quick_ppo])
def test_the_bar_shows_every_phase(make: Any, shown: list[tuple[str, int | None, int]]) -> None:
    make().learn(160, callback=small_callback(), progress_bar=True)
    played = [("random episode", 20, 20), ("fit", None, 0), ("fit", 20, 20)]
    searched = [("search", 80, 80), ("real episode", 20, 20), ("fit", None, 0), ("fit", 20, 20)]
    assert shown == played + 2 * searched


def test_without_being_asked_for_there_is_no_bar(shown: list[tuple[str, int | None, int]]) -> None:
    quick_sac().learn(80, callback=small_callback())
    assert shown == []


@pytest.mark.parametrize("again", [True, False])
def test_the_bar_of_sb3_is_its_own_in_a_training_without_the_loop(
    again: bool, shown: list[tuple[str, int | None, int]], capsys: pytest.CaptureFixture[str]
) -> None:
    model = quick_sac()
    if again:
        model.learn(80, callback=small_callback(), progress_bar=True)
        capsys.readouterr()
    model.learn(80, progress_bar=True)
    assert ("search" in {label for label, *_ in shown}) == again
    assert "80/80" in capsys.readouterr().out


def test_what_is_redirected_holds_text_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert not sys.stdout.isatty()
    quick_sac(verbose=1).learn(160, callback=small_callback(), progress_bar=True)
    printed, errors = capsys.readouterr()
    assert errors == ""
    lines_of(printed)
    assert not set(printed) & set("\x1b\r━█│")
    assert printed.isprintable() or set(printed) <= set(filter(str.isprintable, printed)) | {"\n"}


class Clock:
    """A time to choose."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def test_the_time_left_counts_searches_and_what_lies_between_them() -> None:
    clock = Clock()
    left = bar._TimeLeft(clock)
    assert left.text() == ""
    clock.now += 7  # the random episode, and a fit
    left.begin_search()
    left.estimate(steps_left=900, search_length=300)
    assert left.text() == ""
    clock.now += 5
    left.add(50)
    left.estimate(steps_left=850, search_length=300)
    # 0.1 seconds for each step, and 7 after each of the three searches that are to end.
    assert left.text() == "whole run: 0:01:46 left"
    clock.now += 6
    assert left.text() == "whole run: 0:01:40 left"
    clock.now += 1_000
    assert left.text() == "whole run: 0:00:00 left"


def test_a_training_that_ends_with_real_steps_ends_sooner(monkeypatch: pytest.MonkeyPatch) -> None:
    left: list[tuple[float, int]] = []
    monkeypatch.setattr(bar._TimeLeft, "estimate", lambda self, *steps: left.append(steps))
    model: BaseAlgorithm = quick_sac()
    model.learn(8_000, callback=small_callback(max_real_steps=60), progress_bar=True)
    assert left[0] == (156, 80)
    assert left[-1] == (0, 80)


def test_logged_steps_do_not_count_as_real_ones_that_end_a_training(monkeypatch: pytest.MonkeyPatch) -> None:
    left: list[tuple[float, int]] = []
    monkeypatch.setattr(bar._TimeLeft, "estimate", lambda self, *steps: left.append(steps))
    callback = small_callback(max_real_steps=60, transitions=pendulum_dataset(100))
    quick_sac().learn(8_000, callback=callback, progress_bar=True)
    assert left[0][0] > 0
    assert left[-1][0] == 0
