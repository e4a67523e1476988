"""The pendulum's phase space: what was imagined, and what then came true (figures 12 to 14 of the paper)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

if TYPE_CHECKING:
    from matplotlib.axes import Axes

EPISODES = 6
#: where the pictures end; a pendulum that spins leaves them
FAST = 15.0


def draw_phase_space(rows: pd.DataFrame, title: str, picture: Path) -> None:
    """
    What was imagined before the first searched episodes, and below it what came true.

    :param rows: trajectories of one run
    :param title: above the picture
    :param picture: is written
    """
    # Imported late, because importing matplotlib takes long.
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    imagined = rows[rows.kind == "imagined"]
    numbers = sorted((rows if imagined.empty else imagined).episode.unique())[:EPISODES]
    figure = Figure(figsize=(14, 4.8), layout="constrained")
    axes = figure.subplots(2, len(numbers), sharex=True, sharey=True, squeeze=False)
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


def _draw(axis: Axes, rows: pd.DataFrame) -> None:
    axis.set_xlim(-np.pi, np.pi)
    axis.set_ylim(-FAST, FAST)
    axis.grid(alpha=0.3)
    if rows.empty:
        axis.text(0.5, 0.5, "nothing imagined", transform=axis.transAxes, ha="center", fontsize=8)
    angle = (rows.angle + np.pi) % (2 * np.pi) - np.pi
    axis.scatter(angle, rows.velocity, c=rows.action.abs(), s=4, vmin=0, vmax=1)
