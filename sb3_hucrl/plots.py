"""Calibration plots."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import torch as th

from sb3_hucrl.dynamics.calibration import LEVELS

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def reliability_figure(coverage: Mapping[str, th.Tensor], title: str = "") -> Figure:
    """
    Reliability diagram: coverage against confidence, one panel per state dimension. The diagonal is perfect.

    :param coverage: reliability curves by name, each of shape (levels, p)
    :param title: title of the figure
    """
    # Imported late, because importing matplotlib takes long.
    from matplotlib.figure import Figure

    dims = next(iter(coverage.values())).shape[1]
    figure = Figure(figsize=(3.2 * dims, 3.4), layout="constrained")
    axes = figure.subplots(1, dims, sharey=True, squeeze=False)[0]
    for dim, axis in enumerate(axes):
        axis.plot([0, 1], [0, 1], color="0.7", linewidth=1)
        for name, curve in coverage.items():
            axis.plot(LEVELS.numpy(), curve[:, dim].numpy(), marker=".", label=name)
        axis.set(title=f"state dimension {dim}", xlabel="confidence", xlim=(0, 1), ylim=(0, 1), aspect="equal")
    axes[0].set_ylabel("coverage")
    axes[0].legend(frameon=False, loc="upper left", fontsize="small")
    figure.suptitle(title)
    return figure
