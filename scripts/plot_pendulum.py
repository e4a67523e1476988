"""Draws real returns by real steps, with median and range over seeds, from the CSV of benchmark.py."""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl
import pandas as pd

mpl.use("agg")
from matplotlib import pyplot as plt

EPISODE_STEPS = 400
COLOURS = {"optimistic": "tab:blue", "greedy": "tab:orange"}


def draw(results: pd.DataFrame, output: Path) -> None:
    """One panel for each action penalty and kind of start states."""
    panels = results.groupby(["action_penalty", "start_states"], sort=True)
    figure, axes = plt.subplots(1, len(panels), figsize=(4.2 * len(panels), 3.4), sharey=True, squeeze=False)
    for axis, ((penalty, starts), panel) in zip(axes[0], panels, strict=True):
        for exploration, runs in panel.groupby("exploration", sort=False):
            returns = runs.pivot_table(index="episode", columns="seed", values="real_return")
            steps = returns.index * EPISODE_STEPS
            colour = COLOURS[str(exploration)]
            label = f"{exploration}, seeds: {returns.shape[1]}"
            axis.plot(steps, returns.median(axis=1), color=colour, marker="o", markersize=3, label=label)
            axis.fill_between(steps, returns.min(axis=1), returns.max(axis=1), color=colour, alpha=0.2, linewidth=0)
        axis.set_title(f"action penalty {penalty}, {starts} starts", fontsize=10)
        axis.set_xlabel("real steps")
        axis.grid(alpha=0.3)
        axis.legend(loc="center right", fontsize=8)
    axes[0][0].set_ylabel("real return")
    figure.tight_layout()
    output.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(output, dpi=130)


def main() -> None:
    """Read the CSV and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--input", type=Path, default=Path("results/pendulum.csv"))
    parser.add_argument("--output", type=Path, default=Path("docs/pendulum.png"))
    args = parser.parse_args()
    draw(pd.read_csv(args.input), args.output)


if __name__ == "__main__":
    main()
