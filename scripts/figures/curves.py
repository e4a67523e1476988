"""Figures whose curves are medians over seeds, against real episodes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import pandas as pd

from benchmark import Run
from figures.experiment import Experiment

mpl.use("agg")
from matplotlib import pyplot as plt
from matplotlib.ticker import MaxNLocator


@dataclass(frozen=True)
class Curves:
    """
    One panel for each action penalty, one curve for each strategy.

    :param title: above the picture
    :param env: id of the environment
    :param penalties: of the panels
    :param explorations: names of benchmark.py's strategies
    :param episodes: real ones, with the random first one
    :param column: what is drawn
    :param label: of that axis
    :param start_states: name of benchmark.py's start states
    """

    title: str
    env: str
    penalties: tuple[float, ...]
    explorations: tuple[str, ...] = ("optimistic", "greedy", "thompson")
    episodes: int = 10
    column: str = "real_return"
    label: str = "real return"
    start_states: str = "exploratory"

    def experiments(self, seeds: list[int], quick: bool) -> list[Experiment]:
        """
        :param seeds: of each curve
        :param quick: whether to search next to nothing
        """
        return [
            Experiment(
                Run("sac", self.env, exploration, "ensemble", penalty, self.start_states, seed), self.episodes, quick
            )
            for seed in seeds
            for penalty in self.penalties
            for exploration in self.explorations
        ]

    def draw(self, results: pd.DataFrame, path: Path) -> None:
        """
        :param results: rows of all experiments
        :param path: of the picture
        """
        figure, axes = plt.subplots(
            1, len(self.penalties), figsize=(4.2 * len(self.penalties), 3.6), squeeze=False, layout="constrained"
        )
        for axis, penalty in zip(axes[0], self.penalties, strict=True):
            panel = results[results.action_penalty == penalty]
            for exploration, runs in panel.groupby("exploration", sort=False):
                values = runs.pivot_table(index="episode", columns="seed", values=self.column)
                [line] = axis.plot(
                    values.index, values.median(axis=1), marker="o", markersize=3, label=str(exploration)
                )
                low, high = values.min(axis=1), values.max(axis=1)
                axis.fill_between(values.index, low, high, color=line.get_color(), alpha=0.15, linewidth=0)
            axis.set_title(f"action penalty {penalty}", fontsize=10)
            axis.set_xlabel("real episode")
            axis.xaxis.set_major_locator(MaxNLocator(integer=True))
            axis.grid(alpha=0.3)
        axes[0][0].set_ylabel(self.label)
        axes[0][0].legend(fontsize=8)
        figure.suptitle(f"{self.title} (seeds: {results.seed.nunique()}; median and range)", fontsize=11)
        figure.savefig(path, dpi=130)
        plt.close(figure)
