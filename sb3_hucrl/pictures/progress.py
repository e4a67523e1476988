"""What a run of rl_zoo3 has logged."""

from __future__ import annotations

from pathlib import Path

import gymnasium as gym
import pandas as pd

from sb3_hucrl.loop.schedule import EarlyTimeLimit
from sb3_hucrl.zoo.runs import ZooRun

PANELS = {
    "return": "real/return",
    "negative log-likelihood of held-out steps": "dynamics/holdout_nll",
    "calibration error": "dynamics/calibration_error",
    "epistemic std in imagination": "imagined/epistemic_std",
}


def draw_progress(run: ZooRun, picture: Path) -> None:
    """
    Returns, model error, calibration and epistemic std against real episodes.

    :param run: finished, running or killed
    :param picture: is written
    """
    # Imported late, because importing matplotlib takes long.
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(9, 6), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True)
    for axis, (title, column) in zip(axes.flat, PANELS.items(), strict=True):
        values = run.progress.get(column, pd.Series(dtype=float)).dropna()
        axis.plot(values.index, values, marker="o", markersize=3, label="real")
        axis.set_title(title, fontsize=10)
        axis.grid(alpha=0.3)
    promised = run.state.promised_returns
    shortened = shortened_episodes(run)
    if shortened > 0:
        axes[0, 0].axvspan(0.5, shortened + 0.5, color="gray", alpha=0.15, linewidth=0, label="early time limit")
    numbers, returns = [each.real_episode for each in promised], [each.value for each in promised]
    axes[0, 0].plot(numbers, returns, marker="o", markersize=3, linestyle="--", label="imagined before it")
    axes[0, 0].legend(fontsize=8)
    axes[0, 0].xaxis.set_major_locator(MaxNLocator(integer=True))
    axes[1, 1].set_yscale("log")
    for axis in axes[1]:
        axis.set_xlabel("real episode")
    figure.suptitle(f"{run.folder}: {run.state.real_steps:,} real steps")
    figure.savefig(picture, dpi=130)


def shortened_episodes(run: ZooRun) -> int:
    """
    :param run: with an ``early_time_limit`` or without
    :return: number of real episodes, the first ones, that had a shorter time limit than the environment's
    """
    given, spec = run.settings.real.early_time_limit, gym.spec(run.env_id)
    if given is None or spec.max_episode_steps is None:
        return 0
    early = EarlyTimeLimit.read(given)
    if early.steps >= spec.max_episode_steps:
        return 0
    return early.count(run.state.dataset.lengths, run.settings.real.real_envs)
