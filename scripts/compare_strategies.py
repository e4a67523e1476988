"""
Compares strategies of exploration over all tasks of the paper's figures 6 to 10, from the runs that
``scripts/reproduce.py`` made.

A run's score is 0 if the mean return of its last three episodes is that of doing nothing, and 1 if it is what counts as
solved. Interquartile means over tasks and seeds, in which scores below 0 count as 0, the probability that H-UCRL does
better than another strategy, and bootstrap confidence intervals that are stratified by task are those of Agarwal et
al., *Deep Reinforcement Learning at the Edge of the Statistical Precipice* (NeurIPS 2021), computed by their library
``rliable``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import pandas as pd
from rliable import library, metrics

from figures import FIGURES
from figures.curves import STRATEGIES, Curves
from figures.experiment import Experiment
from suite_parts.tasks import TASKS

mpl.use("agg")
from matplotlib import pyplot as plt

OPTIMISTIC = "optimistic"
#: of the bootstrap
RESAMPLES, BOOTSTRAP_SEED = 2_000, 0

Scores = dict[str, npt.NDArray[np.float64]]
Estimates = dict[str, dict[str, "Estimate"]]


@dataclass(frozen=True)
class Group:
    """
    Tasks with the same number of seeds.

    :param name: in table and picture
    :param figures: numbers of the paper's figures whose runs are compared
    :param penalised: whether actions cost something
    :param seeds: of each task
    """

    name: str
    figures: tuple[int, ...]
    penalised: bool
    seeds: tuple[int, ...]

    def scores(self, folder: Path, nothing: pd.Series[float]) -> Scores:
        """
        :param folder: of all results
        :param nothing: median return of doing nothing, by environment
        :return: one row for each seed and one column for each task, by strategy
        """
        return {
            strategy: np.array([[self._score(job, folder, nothing) for job in row] for row in self.jobs(strategy)])
            for strategy in STRATEGIES
        }

    def jobs(self, strategy: str) -> list[list[Experiment]]:
        """
        :param strategy: name of benchmark.py's strategy
        :return: the runs: one row for each seed, one column for each task
        """
        figures = [figure for number in self.figures if isinstance(figure := FIGURES[number], Curves)]
        return [
            [
                job
                for figure in figures
                for job in figure.jobs([seed], quick=False)
                if job.run.exploration == strategy and (job.run.action_penalty > 0) == self.penalised
            ]
            for seed in self.seeds
        ]

    @staticmethod
    def _score(job: Experiment, folder: Path, nothing: pd.Series[float]) -> float:
        [solved] = [task.solved for task in TASKS if task.env == job.run.env]
        rest = float(nothing[job.run.env])
        return float((pd.read_csv(job.path(folder)).real_return.tail(3).mean() - rest) / (solved - rest))


GROUPS = tuple(
    Group(f"{name}, {'with' if penalised else 'no'} action penalty", figures, penalised, seeds)
    for name, figures, seeds in (
        ("swing-ups", (6, 7), (51, 52, 53, 54, 55)),
        ("arms", (8, 9, 10), (51, 52, 53)),
    )
    for penalised in (False, True)
)


@dataclass(frozen=True)
class Estimate:
    """A number and its 95 % confidence interval."""

    point: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.point:.2f} ({self.low:.2f} to {self.high:.2f})"


def interquartile_means(scores: Scores) -> dict[str, Estimate]:
    """
    :param scores: one row for each run and one column for each task, by strategy
    :return: over runs and tasks, by strategy; a score below 0 counts as 0
    """
    clipped = {name: np.maximum(each, 0) for name, each in scores.items()}
    return _estimates(clipped, lambda each: np.array([metrics.aggregate_iqm(each)]))


def probabilities_of_improvement(scores: Scores) -> dict[str, Estimate]:
    """
    :param scores: one row for each run and one column for each task, by strategy
    :return: that a run of H-UCRL scores more than one of another strategy on the same task, by the other one; a tie
        counts half
    """
    pairs = {name: (scores[OPTIMISTIC], other) for name, other in scores.items() if name != OPTIMISTIC}
    return _estimates(pairs, lambda ours, other: np.array([metrics.probability_of_improvement(ours, other)]))


def _estimates(scores: Mapping[str, Any], measure: Callable[..., npt.NDArray[np.float64]]) -> dict[str, Estimate]:
    np.random.seed(BOOTSTRAP_SEED)  # noqa: NPY002  # rliable draws from numpy's global generator
    points, intervals = library.get_interval_estimates(scores, measure, reps=RESAMPLES)
    return {
        name: Estimate(float(points[name][0]), *(float(bound) for bound in intervals[name][:, 0])) for name in scores
    }


def draw(means: Estimates, probabilities: Estimates, picture: Path) -> None:
    """
    :param means: interquartile means, by group and strategy
    :param probabilities: of improvement, by group and strategy
    :param picture: file to write
    """
    figure, axes = plt.subplots(1, 2, figsize=(10, 3.4), sharey=True, layout="constrained")
    for axis, groups, label, line in (
        (axes[0], means, "interquartile mean of scores", 1.0),
        (axes[1], probabilities, "probability that H-UCRL does better", 0.5),
    ):
        for place, estimates in enumerate(groups.values()):
            for number, (strategy, name) in enumerate(STRATEGIES.items()):
                if strategy in estimates:
                    estimate, height = estimates[strategy], place + 0.2 * (number - 1)
                    bounds = (estimate.low, estimate.high)
                    axis.plot(bounds, (height, height), color=f"C{number}", linewidth=4, alpha=0.4)
                    label_once = name if place == 0 else None
                    axis.plot(estimate.point, height, "o", color=f"C{number}", label=label_once)
        axis.axvline(line, color="0.4", linestyle="--", linewidth=1)
        axis.set_xlabel(label)
        axis.grid(alpha=0.3)
    axes[1].set_xlim(-0.03, 1.03)
    axes[0].set_yticks(range(len(means)), list(means))
    axes[0].invert_yaxis()
    axes[0].legend(fontsize=8)
    figure.savefig(picture, dpi=130)
    plt.close(figure)


def main() -> None:
    """Print the table, and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("results/figures"), help="folder of the CSVs")
    parser.add_argument("--baselines", type=Path, default=Path("results/baselines.csv"), help="returns of no action")
    parser.add_argument("--picture", type=Path, default=Path("docs/figures/strategies.png"))
    args = parser.parse_args()
    baselines = pd.read_csv(args.baselines)
    nothing = baselines[baselines.policy == "zero"].set_index("env")["median"]
    scores = {group.name: group.scores(args.output, nothing) for group in GROUPS}
    means = {name: interquartile_means(each) for name, each in scores.items()}
    probabilities = {name: probabilities_of_improvement(each) for name, each in scores.items()}
    for title, groups in (("interquartile mean", means), ("H-UCRL does better", probabilities)):
        print(title, pd.DataFrame(groups).T.rename(columns=STRATEGIES).to_markdown(), sep="\n\n", end="\n\n")
    draw(means, probabilities, args.picture)


if __name__ == "__main__":
    main()
