"""Figures 12 to 14: trajectories that H-UCRL imagined, and the real ones that followed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from benchmark import Run
from figures.curves import ALGO
from figures.experiment import PENDULUM, Experiment
from sb3_hucrl.pictures import draw_phase_space

REAL_EPISODES = 10
#: cosine of the angle from which the reward counts the pendulum as upright
UPRIGHT = 0.95


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
        :param quick: whether to make very short runs
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
        :param quick: whether to draw the quick runs
        :param picture: file of the picture to write
        :return: for each seed and episode the steps upright, imagined and real
        """
        paths = {job.run.seed: job.trajectories_path(folder) for job in self.jobs(seeds, quick)}
        runs = {seed: pd.read_csv(path) for seed, path in paths.items() if path.exists()}
        first = min(runs)
        draw_phase_space(runs[first], f"{self.title}: H-UCRL, action penalty {self.penalty}, seed {first}", picture)
        return pd.concat([_upright(each).assign(seed=seed) for seed, each in runs.items()]).to_string(index=False)


def _upright(rows: pd.DataFrame) -> pd.DataFrame:
    steps = rows.assign(upright=np.cos(rows.angle) > UPRIGHT).groupby(["kind", "episode"]).upright.sum()
    return steps.unstack("episode").head(2).reset_index()
