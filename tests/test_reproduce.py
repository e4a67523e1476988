"""The launcher of the paper's figures: interrupted runs are tried again, failing ones are reported."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from benchmark import Run
from figures import FIGURES
from figures.experiment import Experiment
from figures.launcher import launch

RUN = Run("sac", "HUCRL-Pendulum-v0", "optimistic", "ensemble", 0.1, "exploratory", 51)


@dataclass(frozen=True)
class Pretended(Experiment):
    """Leaves a line in its CSV where others train; its seed says what goes wrong before."""

    def execute(self, folder: Path) -> None:
        seed, path = self.run.seed, self.path(folder)
        attempts = path.with_suffix(".attempts")
        path.parent.mkdir(parents=True, exist_ok=True)
        with attempts.open("a") as file:
            file.write("x")
        first = len(attempts.read_text()) == 1
        if seed == 1 and first:
            raise InterruptedError("killed")
        if seed == 3:
            raise RuntimeError("seed 3 fails")
        path.write_text(f"seed\n{seed}\n")


def pretended(seed: int) -> Pretended:
    return Pretended(Run("sac", "HUCRL-Pendulum-v0", "optimistic", "ensemble", 0.1, "exploratory", seed), 10, False)


def test_killed_runs_are_tried_again_and_failing_ones_reported(tmp_path: Path) -> None:
    experiments = [pretended(seed) for seed in range(5)]
    errors = launch(experiments, tmp_path, 2)
    assert errors == ["seed 3 fails"]
    finished = sorted(pd.read_csv(path).seed.item() for path in (tmp_path / "runs").glob("*.csv"))
    assert finished == [0, 1, 2, 4]


def test_a_finished_run_is_not_run_again(tmp_path: Path) -> None:
    experiment = Experiment(RUN, 10, quick=False)
    path = experiment.path(tmp_path)
    path.parent.mkdir()
    path.write_text("as it was")
    experiment.execute(tmp_path)
    assert path.read_text() == "as it was"


def test_figures_share_the_runs_that_they_have_in_common() -> None:
    returns, simulated = (FIGURES[number].jobs([51, 52], quick=False) for number in (6, 15))
    assert returns == simulated
    assert len({each.path(Path()) for each in returns}) == 2 * 3 * 3


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
