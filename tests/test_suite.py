"""The suite: what is run, what is measured, and what the table says of it."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import gymnasium as gym
import numpy as np
import pandas as pd
import pytest
import yaml

import suite_parts.run
from figures.launcher import launch
from suite import main
from suite_parts.diagnosis import first_paragraph
from suite_parts.measure import final_return, first_solved, played, trailing_means
from suite_parts.plans import PLANS, default_entry, zoo_entry
from suite_parts.run import SuiteRun
from suite_parts.table import Line, brief_table, diagnoses, put_into, read, table
from suite_parts.tasks import GYMNASIUM, TASKS, SuiteTask

TASK = SuiteTask("Pendulum-v1", 1_000, -250, "ours")


def episodes(returns: Sequence[float], steps: int | Sequence[int] = 100, **columns: Any) -> pd.DataFrame:
    rows = pd.DataFrame({"real_return": returns, "real_steps": steps}, dtype=float)
    rows["episode"] = range(1, len(rows) + 1)
    return rows.assign(**{"mode_return": np.nan, "error": np.nan, **columns})


def write(folder: Path, who: str, rows: pd.DataFrame, seed: int = 51, env: str = TASK.env) -> None:
    path = folder / who / f"{env}_{seed}.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    rows.assign(env=env, seed=seed, who=who, algo="sac", commit="abc").to_csv(path, index=False)


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.env)
def test_every_environment_is_there_with_room_for_hallucination(task: SuiteTask) -> None:
    real, twin = gym.make(task.env), gym.make(task.twin)
    if not task.env.startswith("HUCRL-"):
        assert twin.action_space.shape > real.action_space.shape  # type: ignore[operator]  # both are boxes
    assert task.real_steps >= 3 * task.time_limit
    if task.source == GYMNASIUM:
        assert task.solved == gym.spec(task.env).reward_threshold


def test_all_environments_get_the_default_setting() -> None:
    plan = PLANS["hucrl"](next(task for task in TASKS if task.env == "HUCRL-Reacher-v0"), "sac", False)
    assert plan.entry == default_entry("sac")
    assert (plan.env, plan.words[-1], plan.entry_name) == ("HUCRL-Reacher-v0", "hucrl_max_real_steps:3000", "default")
    assert PLANS["hucrl"](TASK, "sac", False).env == "HUCRL-Pendulum-v1"


@pytest.mark.parametrize(
    ("env", "key"),
    [
        ("Pendulum-v1", "Pendulum-v1"),
        ("HalfCheetah-v5", "HalfCheetah-v4"),
        ("HUCRL-HalfCheetah-v0", "HalfCheetah-v4"),
        ("BipedalWalker-v3", "BipedalWalker-v3"),
        # rl_zoo3 has other reachers, but not this one.
        ("Reacher-v5", "default"),
        ("HUCRL-SparseReacher-v0", "default"),
    ],
)
def test_the_baseline_has_the_zoos_own_entry(env: str, key: str) -> None:
    assert zoo_entry(env)[0] == key


def test_the_baseline_takes_ten_times_the_real_steps_without_hallucination(tmp_path: Path) -> None:
    tasks = {task.env: task for task in TASKS}
    plan = PLANS["baseline"](tasks["HUCRL-CartPole-v0"], "sbx_sac", False)
    assert (plan.algo, plan.env, plan.timesteps) == ("sbx_sac", "HUCRL-CartPole-v0", 30_000)
    words = plan.command(tmp_path, 51)
    assert "hallucinate:False" in words
    assert yaml.safe_load(Path(words[words.index("-conf") + 1]).read_text()) == {plan.env: plan.entry}
    # SBX would leave out what gSDE is.
    assert PLANS["baseline"](tasks["MountainCarContinuous-v0"], "sbx_sac", False).algo == "sac"


def test_the_latest_tenth_is_averaged_and_three_episodes_at_least() -> None:
    long = played(episodes([0, 1, 2, 3, 4], 1_000), 10_000)
    assert trailing_means(long, window=1_000).to_list() == [0, 0.5, 1, 2, 3]
    short = played(episodes(range(10), 10), 10_000)
    assert trailing_means(short, window=50).to_list()[-3:] == [5, 6, 7]


def test_an_episode_counts_if_it_began_within_the_budget() -> None:
    run = episodes([0, 0, 3, 3, 3, 99], [200, 200, 300, 290, 300, 200])
    assert played(run, 1_000).end.to_list() == [200, 400, 700, 990, 1_290]
    assert final_return(run, TASK, 1_000) == 3
    assert final_return(run, TASK, 10_000) == 35


def test_the_better_of_training_and_mode_counts_up_to_the_budget() -> None:
    run = episodes([0] * 20, 100)
    run.loc[9, "mode_return"], run.loc[19, "mode_return"] = 5.0, -5.0
    assert final_return(run, TASK, 1_000) == 5
    assert final_return(run, TASK, 2_000) == 0


def test_a_single_lucky_episode_does_not_solve() -> None:
    assert first_solved(episodes([-100, -1_000, -1_000, -200, -200, -200, -900]), TASK) == 600
    assert first_solved(episodes([-100, -1_000, -100]), TASK) == np.inf
    # After the real steps of the budget it is too late.
    assert first_solved(episodes([-1_000] * 10 + [0] * 3), TASK) == np.inf


@pytest.mark.parametrize(
    ("ours", "others", "verdict"),
    [
        ([-100, -300, -200], [-50], "solved"),
        ([-300, -100, -400], [-350, -310, -50], "better than SAC at 10x"),
        ([-300, -400, -400], [-350, -350, -350], "fails"),
        ([-300], [], "not solved"),
        ([], [-50], "not run"),
    ],
)
@pytest.mark.parametrize("who", ["hucrl", "hsvg"])
def test_verdicts_compare_medians(
    tmp_path: Path, who: str, ours: list[float], others: list[float], verdict: str
) -> None:
    for side, number, values in ((who, 10, ours), ("baseline", 100, others)):
        for seed, value in enumerate(values):
            write(tmp_path, side, episodes([value] * number), seed)
    line = Line.read(read(tmp_path, [TASK]), TASK)
    assert line.searches[who].verdict == verdict
    assert [search.verdict for name, search in line.searches.items() if name != who] == ["not run"]
    assert f" {verdict} |" in line.markdown()


def test_a_failed_run_is_worse_than_any_return_and_is_named(tmp_path: Path) -> None:
    write(tmp_path, "hucrl", episodes([-100] * 10), 51)
    write(tmp_path, "hucrl", episodes([-100] * 10, error="ValueError: no number"), 52)
    write(tmp_path, "hucrl", episodes([np.nan], 0, episode=0, error="ImportError: no such thing"), 53)
    results = read(tmp_path, [TASK])
    line = Line.read(results, TASK)
    assert sorted(line.searches["hucrl"].returns) == [-np.inf, -np.inf, -100]
    assert line.searches["hucrl"].verdict == "not solved"
    text = table(results, [TASK])
    assert "| error (error to -100) |" in text
    assert "- H-UCRL on `Pendulum-v1`, seed 52: `ValueError: no number`" in text
    assert "- H-UCRL on `Pendulum-v1`, seed 53: `ImportError: no such thing`" in text


def test_the_table_counts_and_shows_what_is_missing(tmp_path: Path) -> None:
    other = SuiteTask("Hopper-v5", 1_000, 3_800)
    for seed in (51, 52):
        write(tmp_path, "hucrl", episodes([-400, -100, -100, -100, *[seed - 251.0] * 6]), seed)
    results = read(tmp_path, [TASK, other])
    text = table(results, [TASK, other])
    assert text.startswith("**H-UCRL: 1 of 2**: 1 solved, 0 not solved but better")
    assert "**H-SVG: 0 of 2**: 0 solved" in text
    ours = "| -200 (-200 to -199) | 300 300 | solved |"
    assert f"| `Pendulum-v1` | 1,000 | -250 * {ours}  |  | not run |  |  |" in text
    assert "| `Hopper-v5` | 1,000 | 3,800 |  |  | not run |  |  | not run |  |  |" in text
    assert "* Thresholds of our own: `Pendulum-v1` (ours)." in text
    assert table(read(tmp_path / "nowhere", [TASK]), [TASK]).startswith("**H-UCRL: 0 of 1**")


def test_the_short_table_has_medians_and_marks_successes(tmp_path: Path) -> None:
    other = SuiteTask("Hopper-v5", 1_000, 3_800)
    for seed, value in enumerate([-100, -200, -210]):
        write(tmp_path, "hucrl", episodes([value] * 10), seed)
        write(tmp_path, "hsvg", episodes([100 + value] * 10), seed, other.env)
    write(tmp_path, "baseline", episodes([-50] * 100), env=other.env)
    assert brief_table(read(tmp_path, [TASK, other]), [TASK, other]).splitlines() == [
        "| environment | real steps | H-UCRL | H-SVG | SAC, same steps | SAC, ten times the steps |",
        "|---|---|---|---|---|---|",
        "| `Pendulum-v1` | 1,000 | **-200** | not run | not run | not run |",
        "| `Hopper-v5` | 1,000 | not run | -100 | -50 | -50 |",
    ]


def test_failing_searches_are_listed_with_what_was_said_of_their_runs(tmp_path: Path) -> None:
    other = SuiteTask("Hopper-v5", 1_000, 3_800)
    write(tmp_path, "hucrl", episodes([-400.0] * 10, diagnosis="The model is wrong."), 51)
    write(tmp_path, "hucrl", episodes([-300.0] * 10), 52)
    write(tmp_path, "hucrl", episodes([-100.0] * 10, diagnosis="Nothing is wrong."), 53)
    write(tmp_path, "hsvg", episodes([-100.0] * 10, diagnosis="Nothing is wrong."), 51)
    text = diagnoses(read(tmp_path, [TASK, other]), [TASK, other])
    assert text == "- H-UCRL on `Pendulum-v1`:\n  - seed 51, -400: The model is wrong."


def test_the_answer_of_a_diagnosis_is_its_first_paragraph_in_one_line() -> None:
    assert first_paragraph("\nThe model\nis wrong.\nChange first: -params a:1\n\nModel\n") == (
        "The model is wrong. Change first: -params a:1"
    )


def test_each_page_gets_the_table_that_it_has_marks_for(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- suite -->\nold\n<!-- end of suite -->\nafter\n")
    put_into(page, {"suite": "new", "suite in brief": "medians"})
    put_into(page, {"suite": "newer", "suite in brief": "medians"})
    assert page.read_text() == "before\n<!-- suite -->\nnewer\n<!-- end of suite -->\nafter\n"
    page.write_text("<!-- suite in brief --><!-- end of suite in brief -->")
    put_into(page, {"suite": "new", "suite in brief": "medians"})
    assert page.read_text() == "<!-- suite in brief -->\nmedians\n<!-- end of suite in brief -->"
    page.write_text("no marks")
    with pytest.raises(ValueError, match="add the lines '<!-- suite -->' and '<!-- end of suite -->' or"):
        put_into(page, {"suite": "new", "suite in brief": "medians"})


def test_a_finished_run_is_not_run_again(tmp_path: Path) -> None:
    run = SuiteRun(TASK, "hucrl", "sac", 51)
    path = run.path(tmp_path)
    path.parent.mkdir()
    path.write_text("as it was")
    run.execute(tmp_path)
    assert path.read_text() == "as it was"


def test_a_run_that_was_interrupted_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def end_early(words: list[str], name: str) -> None:
        twin = "HUCRL-Pendulum-v1" if "hucrl_max_real_steps:1000" in words else "Pendulum-v1"
        folder = Path(words[words.index("-f") + 1]) / "sac" / f"{twin}_1"
        folder.mkdir(parents=True)
        (folder / "0.monitor.csv").write_text('#{"t_start": 0}\nr,l,t\n-5.0,999,1.0\n')
        with ZipFile(folder / f"{twin}.zip", "w") as file:
            file.writestr("data", json.dumps({"num_timesteps": 9_999}))

    monkeypatch.setattr(suite_parts.run, "run_process", end_early)
    ours, baseline = SuiteRun(TASK, "hucrl", "sac", 51), SuiteRun(TASK, "baseline", "sac", 51)
    assert launch([ours, baseline], tmp_path, 1) == [
        "hucrl Pendulum-v1 51 ended early, after 999 of 1000 real steps",
        "baseline Pendulum-v1 51 ended early, after 9999 of 10000 timesteps",
    ]
    assert not ours.path(tmp_path).exists()


def test_a_run_may_end_within_an_episode(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def end_within(words: list[str], name: str) -> None:
        folder = Path(words[words.index("-f") + 1]) / "hsvg" / "HUCRL-Pendulum-v1_1"
        folder.mkdir(parents=True)
        (folder / "0.monitor.csv").write_text('#{"t_start": 0}\nr,l,t\n-5.0,950,1.0\n')
        (folder / "progress.csv").write_text("real/steps,real/return\n900,\n1000,-5.0\n")

    monkeypatch.setattr(suite_parts.run, "run_process", end_within)
    run = SuiteRun(TASK, "hsvg", "hsvg", 51)
    assert launch([run], tmp_path, 1) == []
    rows = pd.read_csv(run.path(tmp_path))
    assert rows.real_steps.to_list() == [950]
    [said] = rows.diagnosis
    assert said.startswith("Not diagnosed: ")


@pytest.mark.slow
def test_a_failed_run_leaves_its_error(tmp_path: Path) -> None:
    run = SuiteRun(SuiteTask("NoSuchThing-v0", 1_000, 0), "baseline", "sac", 51)
    assert launch([run], tmp_path, 1) == []
    [row] = pd.read_csv(run.path(tmp_path)).to_dict("records")
    assert (row["env"], row["episode"], row["entry"]) == ("NoSuchThing-v0", 0, "default")
    assert "NoSuchThing-v0 not found in gym registry" in row["error"]


@pytest.mark.slow
def test_all_sides_run_and_are_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ["--quick", "--envs", "Pendulum-v1", "--seeds", "51", "--jobs", "1", "--output", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", ["suite.py", *words])
    main()
    folder = tmp_path / "quick"
    assert (folder / "suite.png").stat().st_size > 10_000
    ours, others, robots = (pd.read_csv(folder / who / "Pendulum-v1_51.csv") for who in ("hucrl", "baseline", "hsvg"))
    assert ours.real_steps.to_list() == [200] * 4
    assert others.real_steps.to_list() == [200] * 12
    # Ten evaluations; the last two fall upon the last episode that ended.
    assert others.mode_return.notna().sum() == 9
    assert set(robots.algo) == {"hsvg"}
    # 500 random steps, and 100 after each of two searches: the fourth episode is not over.
    assert robots.real_steps.to_list() == [200] * 3
    assert set(ours.entry) == set(robots.entry) == {"default"}
    assert set(others.entry) == {"Pendulum-v1"}
    assert ours.error.isna().all()
    assert robots.error.isna().all()
    assert others.error.isna().all()


def test_longer_runs_are_drawn_on_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path, "hsvg", episodes([-1_000] * 10 + [-200] * 10))
    picture = tmp_path / "picture.png"
    words = ["--draw", "--envs", "Pendulum-v1", "--real-steps", "2000", "--output", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", ["suite.py", *words, "--table", "--picture", str(picture)])
    main()
    printed = capsys.readouterr().out
    assert "**H-SVG: 1 of 1**" in printed
    assert "| `Pendulum-v1` | 2,000 |" in printed
    assert picture.stat().st_size > 5_000
