"""Plots of a model's calibration, and of what it imagined beside what came true."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import torch as th

from sb3_hucrl.data import Transitions
from sb3_hucrl.dynamics.calibration import LEVELS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: of a figure of episodes
MOST_PANELS, COLUMNS = 24, 4


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


def episode_figure(real: Transitions, imagined: Transitions, title: str, angle_dims: Sequence[int] = ()) -> Figure:
    """
    A real episode and what was imagined before it, one panel each for the return so far and for every action and state
    dimension, up to :data:`MOST_PANELS`.

    :param real: episode
    :param imagined: episode, of the same task and with the same policy
    :param title: of the figure
    :param angle_dims: of the state, drawn without jumps where a turn is complete
    """
    from matplotlib.figure import Figure

    start = real.states[0].numpy()
    shown = {"real": _series(real, start, angle_dims), "imagined": _series(imagined, start, angle_dims)}
    names = [*shown["real"]][:MOST_PANELS]
    columns = min(COLUMNS, len(names))
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(3.2 * columns, 2.2 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, squeeze=False)
    for axis in axes.flat[len(names) :]:
        axis.remove()
    for axis, name in zip(axes.flat, names, strict=False):
        axis.plot(shown["real"][name], color="C0", linewidth=1, label="real")
        axis.plot(shown["imagined"][name], color="C1", linewidth=1, linestyle="--", label="imagined before it")
        axis.set_title(name, fontsize=9)
        axis.tick_params(labelsize=8)
        axis.grid(alpha=0.3)
    for axis in axes.flat[max(0, len(names) - columns) : len(names)]:
        axis.set_xlabel("step", fontsize=8)
        axis.tick_params(labelbottom=True)
    axes[0, 0].legend(fontsize=8)
    returns = ", ".join(f"{name} {float(each['return so far'][-1]):.1f}" for name, each in shown.items())
    figure.suptitle(f"{title}: return {returns}", fontsize=10)
    return figure


def _series(
    episode: Transitions, start: npt.NDArray[np.float32], angle_dims: Sequence[int]
) -> dict[str, npt.NDArray[np.float32]]:
    """What is drawn of an episode over its steps, by name; angles begin within half a turn of the start."""
    states = episode.states.numpy().copy()
    for dim in angle_dims:
        states[:, dim] = np.unwrap(states[:, dim])
        states[:, dim] += 2 * np.pi * np.round((start[dim] - states[0, dim]) / (2 * np.pi))
    return {
        "return so far": episode.rewards.numpy().cumsum(),
        **{f"action {index}": values for index, values in enumerate(episode.actions.numpy().T)},
        **{f"state {index}": values for index, values in enumerate(states.T)},
    }
