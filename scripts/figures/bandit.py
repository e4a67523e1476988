"""Figure 5: expected performance gets stuck in the bandit where optimism does not."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import torch as th

mpl.use("agg")
from matplotlib import pyplot as plt

from sb3_hucrl.theory.bandit import gp_ucb

#: places and heights of the hills of the objective, and the width of all
HILLS = {0.2: 0.6, 0.55: 0.3, 0.8: 1.0}
WIDTH = 0.08
#: is tried first: on the slope of the first hill
FIRST = 0.15
STEPS = 20


def objective(parameters: th.Tensor) -> th.Tensor:
    """Sum of hills, of parameters (n, 1), shape (n,)."""
    offsets = (parameters - th.tensor(list(HILLS))) / WIDTH
    return th.exp(-0.5 * offsets.square()) @ th.tensor(list(HILLS.values()))


def draw_bandit(path: Path, seed: int) -> None:
    """
    :param path: of the picture
    :param seed: of the noise of the observations
    """
    candidates = th.linspace(0, 1, 401).unsqueeze(1)
    first = int((candidates[:, 0] - FIRST).abs().argmin())
    places, values = candidates[:, 0].numpy(), objective(candidates).numpy()
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), sharey=True, layout="constrained")
    for axis, beta in zip(axes, (0.0, 2.0), strict=True):
        generator = th.Generator().manual_seed(seed)
        found = gp_ucb(objective, candidates, beta, STEPS, first, WIDTH, 0.02, generator)
        mean, std = found.mean.numpy(), found.std.numpy()
        axis.plot(places, values, color="black", linestyle="--", label="objective")
        axis.plot(places, mean, color="tab:blue", label="mean")
        axis.fill_between(places, mean - 2 * std, mean + 2 * std, color="tab:blue", alpha=0.15, linewidth=0)
        axis.scatter(places[found.chosen], found.observed, color="tab:orange", marker="x", label="tried", zorder=3)
        best = values[found.chosen].max()
        axis.set(title=f"β = {beta:g}: best {best:.2f} of {values.max():.2f}", xlabel="parameter θ")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("performance")
    axes[0].legend(fontsize=8)
    figure.suptitle(f"Figure 5: {STEPS} steps of GP-UCB", fontsize=11)
    figure.savefig(path, dpi=130)
    plt.close(figure)
