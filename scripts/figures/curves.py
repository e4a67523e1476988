"""Figures whose curves are medians over seeds, against real episodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib as mpl
import pandas as pd

from benchmark import Run, summary
from figures.experiment import DECIMALS, Experiment

mpl.use("agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

#: SAC in JAX, which is faster than in PyTorch with such small networks
ALGO = "sbx_sac"
STRATEGIES = {"optimistic": "H-UCRL", "greedy": "greedy", "thompson": "Thompson"}


def draw_curve(axis: Axes, values: pd.DataFrame, label: str) -> None:
    """
    :param axis: to draw on
    :param values: one row for each real episode (the index), one column for each seed
    :param label: in the legend
    """
    [line] = axis.plot(values.index, values.median(axis=1), marker="o", markersize=3, label=label)
    axis.fill_between(
        values.index, values.min(axis=1), values.max(axis=1), color=line.get_color(), alpha=0.15, linewidth=0
    )


@dataclass(frozen=True)
class Curves:
    """
    One column of panels for each action penalty, one row for each dynamics model, one curve for each strategy.

    :param title: above the picture
    :param env: id of the environment
    :param penalties: of the columns
    :param dynamics: names of the models of the rows
    :param explorations: names of benchmark.py's strategies, and their labels
    :param episodes: real ones, with the random first one
    :param column: column of the CSV that is drawn
    :param label: of that axis
    :param start_states: name of benchmark.py's start states
    :param solved: return that counts as solved; None where no return is drawn
    :param scale: of that axis
    """

    title: str
    env: str
    penalties: tuple[float, ...]
    dynamics: tuple[str, ...] = ("ensemble",)
    explorations: Mapping[str, str] = field(default_factory=lambda: STRATEGIES)
    episodes: int = 10
    column: str = "real_return"
    label: str = "real return"
    start_states: str = "exploratory"
    solved: float | None = 150.0
    scale: str = "linear"

    def jobs(self, seeds: list[int], quick: bool) -> list[Experiment]:
        """
        :param seeds: of each curve
        :param quick: whether to make very short runs, and with the highest penalty only
        """
        return [
            Experiment(Run(ALGO, self.env, exploration, model, penalty, self.start_states, seed), self.episodes, quick)
            for seed in seeds
            for penalty in (self.penalties[-1:] if quick else self.penalties)
            for model in self.dynamics
            for exploration in self.explorations
        ]

    def draw(self, folder: Path, seeds: list[int], quick: bool, picture: Path) -> str:
        """
        :param folder: of all results
        :param seeds: of each curve
        :param quick: whether to draw the quick runs
        :param picture: file of the picture to write
        :return: for each curve, the first solved episode and the mean of the last three, or the median of each episode
        """
        paths = [each.path(folder) for each in self.jobs(seeds, quick)]
        results = pd.concat([pd.read_csv(path) for path in paths if path.exists()])
        figure, axes = plt.subplots(
            len(self.dynamics),
            len(self.penalties),
            figsize=(4.2 * len(self.penalties), 3.4 * len(self.dynamics) + 0.2),
            squeeze=False,
            sharex=True,
            layout="constrained",
        )
        for row, model in zip(axes, self.dynamics, strict=True):
            for axis, penalty in zip(row, self.penalties, strict=True):
                axis.set_title(f"{model}, action penalty {penalty}", fontsize=10)
                self._draw_panel(axis, results[(results.action_penalty == penalty) & (results.dynamics == model)])
            row[0].set_ylabel(self.label)
        for axis in axes[-1]:
            axis.set_xlabel("real episode")
        axes[0][-1].legend(fontsize=8)
        figure.suptitle(f"{self.title} (seeds: {results.seed.nunique()}; median and range)", fontsize=11)
        figure.savefig(picture, dpi=130)
        plt.close(figure)
        if self.solved is not None:
            return summary(results.assign(real_return=results[self.column]), self.solved).to_string()
        curves = ["dynamics", "action_penalty", "exploration"]
        medians = results.pivot_table(index=curves, columns="episode", values=self.column, aggfunc="median")
        return medians.round(4).to_string()

    def _draw_panel(self, axis: Axes, panel: pd.DataFrame) -> None:
        for exploration, label in self.explorations.items():
            runs = panel[panel.exploration == exploration]
            draw_curve(axis, runs.pivot_table(index="episode", columns="seed", values=self.column), label)
        axis.set_yscale(self.scale)
        if self.scale == "log":
            axis.set_ylim(bottom=10.0**-DECIMALS)
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
        axis.grid(alpha=0.3)
