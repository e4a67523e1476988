"""
Draws what a run of rl_zoo3 has logged, and for the pendulum its real and imagined trajectories in phase space (figures
12 to 14 of the paper).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl
import pandas as pd

mpl.use("agg")
from matplotlib import pyplot as plt
from matplotlib.ticker import MaxNLocator

from figures.phase_space import draw_phase_space
from figures.trajectories import trajectories
from sb3_hucrl.zoo.runs import ZooRun


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
    imagined = run.state.imagined_episodes
    numbers = [episode.real_episode for episode in imagined]
    promised = [float(episode.transitions.rewards.sum()) for episode in imagined]
    axes[0, 0].plot(numbers, promised, marker="o", markersize=3, linestyle="--", label="imagined before it")
    axes[0, 0].legend(fontsize=8)
    axes[0, 0].xaxis.set_major_locator(MaxNLocator(integer=True))
    axes[1, 1].set_yscale("log")
    for axis in axes[1]:
        axis.set_xlabel("real episode")
    figure.suptitle(f"{run.folder}: {len(run.state.dataset):,} real steps")
    figure.savefig(output / "progress.png", dpi=130)


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
        draw_phase_space(trajectories(run.state), str(run.folder), output / "phase_space.png")
    print(f"Pictures in {output}")


if __name__ == "__main__":
    main()
