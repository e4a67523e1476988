"""Figures 12 to 14: what H-UCRL imagined, and what the pendulum then did."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd

from benchmark import Run
from figures.curves import ALGO
from figures.experiment import PENDULUM, Experiment

mpl.use("agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

EPISODES = 6
REAL_EPISODES = 10
#: cosine of the angle from which the reward counts the pendulum as upright
UPRIGHT = 0.95
#: where the pictures end; a pendulum that spins leaves them
FAST = 15.0


@dataclass(frozen=True)
class PhaseSpace:
    """
    Angle and angular velocity of the first episodes after the random one, of the first seed.

    :param title: above the picture
    :param penalty: on actions
    """

    title: str
    penalty: float

    def jobs(self, seeds: list[int], quick: bool) -> list[Experiment]:
        """
        :param seeds: of the runs, which are those of figure 6
        :param quick: whether to search next to nothing
        """
        return [
            Experiment(
                Run(ALGO, PENDULUM, "optimistic", "ensemble", self.penalty, "exploratory", seed), REAL_EPISODES, quick
            )
            for seed in seeds
        ]

    def draw(self, folder: Path, seeds: list[int], quick: bool, picture: Path) -> str:
        """
        :param folder: of all results
        :param seeds: of the runs
        :param quick: whether the quick runs are to be drawn
        :param picture: is written
        :return: for each seed and episode the steps upright, imagined and real
        """
        paths = {job.run.seed: job.trajectories_path(folder) for job in self.jobs(seeds, quick)}
        runs = {seed: pd.read_csv(path) for seed, path in paths.items() if path.exists()}
        first = min(runs)
        draw_phase_space(runs[first], f"{self.title}: H-UCRL, action penalty {self.penalty}, seed {first}", picture)
        return pd.concat([_upright(each).assign(seed=seed) for seed, each in runs.items()]).to_string(index=False)


def draw_phase_space(rows: pd.DataFrame, title: str, picture: Path) -> None:
    """
    What was imagined before the first searched episodes, and below it what came true.

    :param rows: trajectories of one run
    :param title: above the picture
    :param picture: is written
    """
    imagined = rows[rows.kind == "imagined"]
    numbers = sorted((rows if imagined.empty else imagined).episode.unique())[:EPISODES]
    figure, axes = plt.subplots(
        2, len(numbers), figsize=(14, 4.8), sharex=True, sharey=True, squeeze=False, layout="constrained"
    )
    for row, kind in zip(axes, ("imagined", "real"), strict=True):
        for axis, number in zip(row, numbers, strict=True):
            _draw(axis, rows[(rows.kind == kind) & (rows.episode == number)])
        row[0].set_ylabel(f"{kind}\nangular velocity (rad/s)")
    for column, number in zip(axes.T, numbers, strict=True):
        real = rows[(rows.kind == "real") & (rows.episode == number)]
        column[0].set_title(f"episode {number}: {real.reward.sum():.0f}", fontsize=10)
        column[1].set_xlabel("angle (rad), 0 is up")
    figure.colorbar(ScalarMappable(Normalize(0, 1)), ax=axes, label="size of the action", shrink=0.8)
    figure.suptitle(title, fontsize=11)
    figure.savefig(picture, dpi=130)
    plt.close(figure)


def _draw(axis: Axes, rows: pd.DataFrame) -> None:
    axis.set_xlim(-np.pi, np.pi)
    axis.set_ylim(-FAST, FAST)
    axis.grid(alpha=0.3)
    if rows.empty:
        axis.text(0.5, 0.5, "nothing imagined", transform=axis.transAxes, ha="center", fontsize=8)
    angle = (rows.angle + np.pi) % (2 * np.pi) - np.pi
    axis.scatter(angle, rows.velocity, c=rows.action.abs(), s=4, vmin=0, vmax=1)


def _upright(rows: pd.DataFrame) -> pd.DataFrame:
    steps = rows.assign(upright=np.cos(rows.angle) > UPRIGHT).groupby(["kind", "episode"]).upright.sum()
    return steps.unstack("episode").head(2).reset_index()
