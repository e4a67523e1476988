"""The picture of the suite: real return against real steps, one panel for each environment."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import pandas as pd

from suite_parts.measure import FRACTION, failed, played, trailing_means
from suite_parts.plans import TENFOLD
from suite_parts.table import SIDES
from suite_parts.tasks import SuiteTask

mpl.use("agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter

#: at most
COLUMNS = 6
#: points of each curve
POINTS = 200
#: colours of the sides, and their budgets as multiples of ours
STYLES = {"hucrl": ("C0", 1), "hsvg": ("C2", 1), "baseline": ("C1", TENFOLD)}


def curve(run: pd.DataFrame, task: SuiteTask, steps: int, grid: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """
    :param run: rows of one CSV
    :param task: the environment
    :param steps: real steps at which the curve ends
    :param grid: real steps
    :return: the mean return of the latest episodes at each of these; NaN before the first, and after an error
    """
    episodes = played(run, steps)
    if episodes.empty:
        return np.full(len(grid), np.nan)
    ends = episodes.end.to_numpy()
    means = trailing_means(episodes, FRACTION * task.real_steps).to_numpy()
    at = np.searchsorted(ends, grid, side="right") - 1
    known = (at >= 0) & ((grid <= ends[-1]) | (not failed(run)))
    return np.where(known, means[at], np.nan)


def draw(results: pd.DataFrame, tasks: Sequence[SuiteTask], picture: Path) -> None:
    """
    Draw medians and ranges over the seeds.

    :param results: rows of all runs
    :param tasks: the environments, in the order of the panels
    :param picture: file to write
    """
    columns = min(len(tasks), COLUMNS)
    rows = -(-len(tasks) // columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(3 * columns, 2.7 * rows + 0.5), squeeze=False, layout="constrained"
    )
    for axis, task in zip(axes.flat, tasks, strict=False):
        _draw_panel(axis, results[results.env == task.env], task)
    for axis in axes.flat[len(tasks) :]:
        axis.set_axis_off()
    for row in axes:
        row[0].set_ylabel("real return")
    for axis in axes[-1]:
        axis.set_xlabel("real steps")
    handles = {label: line for axis in axes.flat for line, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    figure.legend(list(handles.values()), list(handles), loc="outside upper center", ncols=len(handles), fontsize=11)
    picture.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(picture, dpi=100)
    plt.close(figure)


def _draw_panel(axis: Axes, results: pd.DataFrame, task: SuiteTask) -> None:
    axis.set_title(f"{task.env}\nsolved at {task.solved:,.6g}", fontsize=9)
    notes = []
    for who, (colour, multiple) in STYLES.items():
        label = SIDES[who]
        runs = [run for _, run in results[results.who == who].groupby("seed")]
        errors = sum(failed(run) for run in runs)
        if errors:
            notes.append(f"{label}: {errors} of {len(runs)} failed")
        steps = multiple * task.real_steps
        ends = pd.concat([played(run, steps).end for run in runs]) if runs else pd.Series(dtype=float)
        if ends.empty:
            continue
        grid = np.geomspace(ends.min(), max(steps, ends.max()), POINTS)
        curves = pd.DataFrame([curve(run, task, steps, grid) for run in runs])
        axis.plot(grid, curves.median(), color=colour, label=label)
        axis.fill_between(grid, curves.min(), curves.max(), color=colour, alpha=0.2, linewidth=0)
    if axis.lines:
        low, high = axis.get_ylim()
        axis.axhline(task.solved, color="0.4", linestyle="--", linewidth=1, label="solved")
        # A threshold far away would press the curves flat; the title names it.
        spread = high - low
        if low - spread / 2 < task.solved < high + spread / 2:
            axis.set_ylim(min(low, task.solved - spread / 20), max(high, task.solved + spread / 20))
        else:
            axis.set_ylim(low, high)
    else:
        notes.append("not run yet" if results.empty else "no episode")
    axis.axvline(task.real_steps, color="0.4", linestyle=":", linewidth=1)
    axis.set_xscale("log")
    axis.set_xlim(right=task.real_steps * max(STYLES[who][1] for who in {"hsvg", *results.who.unique()}))
    left, right = axis.get_xlim()
    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0) if right < 300 * left else (1.0,), numticks=12))
    axis.xaxis.set_major_formatter(EngFormatter(sep=""))
    axis.xaxis.set_minor_formatter(NullFormatter())
    if notes:
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1}
        axis.text(0.03, 0.95, "\n".join(notes), transform=axis.transAxes, fontsize=8, verticalalignment="top", bbox=box)
    axis.grid(alpha=0.3)
