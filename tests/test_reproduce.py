"""The paper's figures: what is run for them, and what is drawn."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from benchmark import Run
from figures import FIGURES
from figures.experiment import Experiment

RUN = Run("sac", "HUCRL-Pendulum-v0", "optimistic", "ensemble", 0.1, "exploratory", 51)


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
