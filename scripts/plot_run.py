"""
Draws what a run of rl_zoo3 has logged, and for the pendulum its real and imagined trajectories in phase space (figures
12 to 14 of the paper).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd

mpl.use("agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.ticker import MaxNLocator

from sb3_hucrl.data import Transitions
from sb3_hucrl.runs import ZooRun

EPISODES = 6


def draw_progress(run: ZooRun, output: Path) -> None:
    """Returns, model error, calibration and epistemic std against real episodes."""
    panels = {
        "return": "real/return",
        "negative log-likelihood of held-out steps": "dynamics/holdout_nll",
        "calibration error": "dynamics/calibration_error",
        "epistemic std in imagination": "imagined/epistemic_std",
    }
    figure, axes = plt.subplots(2, 2, figsize=(9, 6), sharex=True, layout="constrained")
    for axis, (title, column) in zip(axes.flat, panels.items(), strict=True):
        values = run.progress.get(column, pd.Series(dtype=float)).dropna()
        axis.plot(values.index, values, marker="o", markersize=3, label="real")
        axis.set_title(title, fontsize=10)
        axis.grid(alpha=0.3)
    promised = [float(episode.rewards.sum()) for episode in run.state.imagined_episodes]
    numbers = np.arange(len(promised)) + run.state.real_episodes - len(promised) + 1
    axes[0, 0].plot(numbers, promised, marker="o", markersize=3, linestyle="--", label="imagined before it")
    axes[0, 0].legend(fontsize=8)
    axes[0, 0].xaxis.set_major_locator(MaxNLocator(integer=True))
    axes[1, 1].set_yscale("log")
    for axis in axes[1]:
        axis.set_xlabel("real episode")
    figure.suptitle(f"{run.folder}: {len(run.state.dataset):,} real steps")
    figure.savefig(output / "progress.png", dpi=130)


def draw_phase_space(run: ZooRun, output: Path) -> None:
    """Angle and angular velocity of the first real episodes, and below each what was imagined before it."""
    state = run.state
    real = [state.dataset.transitions[slice(end - n, end)] for n, end in
            zip(state.dataset.lengths, np.cumsum(state.dataset.lengths), strict=True)]  # fmt: skip
    # Nothing was imagined before the first, random episodes, nor before those that were planned.
    imagined = [*[None] * (len(real) - len(state.imagined_episodes)), *state.imagined_episodes]
    shown = min(EPISODES, len(real))
    figure, axes = plt.subplots(
        2, shown, figsize=(2.4 * shown + 0.8, 5), sharex=True, sharey=True, squeeze=False, layout="constrained"
    )
    for number in range(shown):
        _trajectory(axes[0, number], real[number])
        _trajectory(axes[1, number], imagined[number])
        axes[0, number].set_title(f"episode {number + 1}: {float(real[number].rewards.sum()):.0f}", fontsize=9)
        axes[1, number].set_xlabel("angle (rad), 0 is up")
    axes[0, 0].set_ylabel("real\nangular velocity (rad/s)")
    axes[1, 0].set_ylabel("imagined\nangular velocity (rad/s)")
    figure.colorbar(ScalarMappable(Normalize(0, 1)), ax=axes, label="size of the action", shrink=0.8)
    figure.savefig(output / "phase_space.png", dpi=130)


def _trajectory(axis: Axes, episode: Transitions | None) -> None:
    axis.set_xlim(-np.pi, np.pi)
    axis.grid(alpha=0.3)
    if episode is None:
        axis.text(0.5, 0.5, "nothing imagined", transform=axis.transAxes, ha="center", fontsize=8)
        return
    angle = (episode.states[:, 0] + np.pi) % (2 * np.pi) - np.pi
    effort = episode.actions.abs().amax(dim=1)
    axis.scatter(angle, episode.states[:, 1], c=effort, s=4, vmin=0, vmax=1)


def main() -> None:
    """Read a run's folder, write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path, help="folder of the run, such as logs/sac/HUCRL-Pendulum-v0_1")
    parser.add_argument("--output", type=Path, help="folder for the pictures; by default the run's own")
    args = parser.parse_args()
    run, output = ZooRun(args.run), args.output or args.run
    output.mkdir(parents=True, exist_ok=True)
    draw_progress(run, output)
    if "Pendulum" in run.env_id:
        draw_phase_space(run, output)
    print(f"Pictures in {output}")


if __name__ == "__main__":
    main()
