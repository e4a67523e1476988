"""The paper's figures: their runs and their pictures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
import torch as th

from benchmark import EXPLORATIONS, Run, command, hyperparameters
from figures import FIGURES
from figures.experiment import Experiment
from helpers import TruePendulum, random_transitions
from sb3_hucrl import HUCRLState, Optimistic, TransitionDataset
from sb3_hucrl.loop import ImaginedEpisode
from sb3_hucrl.pictures import trajectories, transitions
from sb3_hucrl.zoo.callback_entry import find_entry
from sb3_hucrl.zoo.settings import changed

pytestmark = pytest.mark.slow

RUN = Run("sac", "HUCRL-Pendulum-v0", "optimistic", "ensemble", 0.1, "exploratory", 51)


def test_a_finished_run_is_not_run_again(tmp_path: Path) -> None:
    experiment = Experiment(RUN, 10, quick=False)
    path = experiment.path(tmp_path)
    path.parent.mkdir()
    path.write_text("as it was")
    experiment.execute(tmp_path)
    assert path.read_text() == "as it was"


@pytest.mark.parametrize(("algo", "env", "beta"), [("hsvg", "default", 1), ("sac", "HUCRL-SparseReacher-v0", 0.2)])
def test_optimism_takes_the_place_of_another_strategy_and_keeps_its_own_settings(
    algo: str, env: str, beta: float
) -> None:
    entry = find_entry(hyperparameters(algo, env)["callback"])
    assert entry is not None
    assert changed(entry, EXPLORATIONS["optimistic"]).build().settings.search.strategy == Optimistic(beta=beta)


def test_only_optimistic_runs_have_hallucinated_actions() -> None:
    for exploration in EXPLORATIONS:
        words = command(replace(RUN, exploration=exploration), "logs", {})
        assert f"hallucinate:{exploration.startswith('optimistic')}" in words


def test_figures_share_the_runs_that_they_have_in_common() -> None:
    returns, simulated = (FIGURES[number].jobs([51, 52], quick=False) for number in (6, 15))
    assert returns == simulated
    assert len({each.path(Path()) for each in returns}) == 2 * 3 * 3


def test_trajectories_come_back_from_their_csv(tmp_path: Path) -> None:
    first, second, dream = (random_transitions(20, seed) for seed in range(3))
    dataset = TransitionDataset(2, 1)
    dataset.append_episode(first)
    dataset.append_episode(second)
    state = HUCRLState(dataset, TruePendulum(), th.Generator(), imagined_episodes=[ImaginedEpisode(2, dream)])
    path = tmp_path / "trajectories.csv.gz"
    trajectories(state).to_csv(path, index=False)
    rows = pd.read_csv(path)
    # Before the first episode nothing was imagined.
    for kind, number, expected in (("real", 1, first), ("real", 2, second), ("imagined", 2, dream)):
        read = transitions(rows[(rows.kind == kind) & (rows.episode == number)])
        th.testing.assert_close(read.states, expected.states[:-1], rtol=0, atol=1e-5)
        th.testing.assert_close(read.actions, expected.actions[:-1], rtol=0, atol=1e-5)
        th.testing.assert_close(read.next_states, expected.states[1:], rtol=0, atol=1e-5)
        th.testing.assert_close(read.rewards, expected.rewards[:-1], rtol=0, atol=1e-5)
    assert len(rows) == 60


def test_a_figure_is_drawn_from_what_there_is(tmp_path: Path) -> None:
    figure = FIGURES[6]
    jobs = [job for job in figure.jobs([51, 52], quick=False) if isinstance(job, Experiment)]
    for job in jobs:
        if job.run.action_penalty < 0.2:
            path = job.path(tmp_path)
            path.parent.mkdir(exist_ok=True)
            rows = pd.DataFrame({"episode": [1, 2], "real_return": [10.0, 200.0], **vars(job.run)})
            rows.to_csv(path, index=False)
    numbers = figure.draw(tmp_path, [51, 52], False, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000
    assert numbers.count("optimistic") == 2
