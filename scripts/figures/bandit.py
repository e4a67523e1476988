"""Figure 5: in the bandit, expected performance gets stuck and optimism does not."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import pandas as pd
import torch as th

from figures.experiment import write_whole
from figures.job import Job
from results_table import commit
from sb3_hucrl.theory.bandit import BanditRun, gp_ucb

mpl.use("agg")
from matplotlib import pyplot as plt

#: places and heights of the hills of the objective, and the width of all
HILLS = {0.2: 0.6, 0.55: 0.3, 0.8: 1.0}
WIDTH = 0.08
#: the first point, on the slope of the first hill
FIRST = 0.15
STEPS = 20
BETAS = (0.0, 2.0)
CANDIDATES = th.linspace(0, 1, 401).unsqueeze(1)


def objective(parameters: th.Tensor) -> th.Tensor:
    """The objective, a sum of hills, at parameters of shape (n, 1); shape (n,)."""
    offsets = (parameters - th.tensor(list(HILLS))) / WIDTH
    return th.exp(-0.5 * offsets.square()) @ th.tensor(list(HILLS.values()))


class Bandit:
    """One panel for each β. It takes a second, so it needs no runs."""

    def jobs(self, seeds: list[int], quick: bool) -> list[Job]:
        """
        :param seeds: of the noise of the observations
        :param quick: makes no difference
        """
        return []

    def draw(self, folder: Path, seeds: list[int], quick: bool, picture: Path) -> str:
        """
        :param folder: of all results; the CSV is written
        :param seeds: of the noise of the observations; the first is drawn
        :param quick: makes no difference
        :param picture: file of the picture to write
        :return: the best value that each β found with each seed
        """
        runs = {(beta, seed): _run(beta, seed) for beta in BETAS for seed in seeds}
        rows = pd.concat([_rows(run).assign(beta=beta, seed=seed) for (beta, seed), run in runs.items()])
        write_whole(rows.assign(commit=commit()), folder / ("quick" if quick else "runs") / "bandit.csv")
        _draw({beta: runs[beta, seeds[0]] for beta in BETAS}, picture)
        return rows.pivot_table(index="beta", columns="seed", values="value", aggfunc="max").round(2).to_string()


def _run(beta: float, seed: int) -> BanditRun:
    first = int((CANDIDATES[:, 0] - FIRST).abs().argmin())
    return gp_ucb(objective, CANDIDATES, beta, STEPS, first, WIDTH, 0.02, th.Generator().manual_seed(seed))


def _rows(run: BanditRun) -> pd.DataFrame:
    tried = CANDIDATES[run.chosen]
    columns = {"parameter": tried[:, 0], "value": objective(tried), "observed": run.observed}
    return pd.DataFrame(
        {"step": range(1, STEPS + 1), **{name: each.numpy().round(4) for name, each in columns.items()}}
    )


def _draw(runs: dict[float, BanditRun], picture: Path) -> None:
    places, values = CANDIDATES[:, 0].numpy(), objective(CANDIDATES).numpy()
    figure, axes = plt.subplots(1, len(runs), figsize=(9, 3.4), sharey=True, layout="constrained")
    for axis, (beta, run) in zip(axes, runs.items(), strict=True):
        mean, std = run.mean.numpy(), run.std.numpy()
        axis.plot(places, values, color="black", linestyle="--", label="objective")
        axis.plot(places, mean, color="tab:blue", label="mean")
        axis.fill_between(places, mean - 2 * std, mean + 2 * std, color="tab:blue", alpha=0.15, linewidth=0)
        axis.scatter(places[run.chosen], run.observed, color="tab:orange", marker="x", label="tried", zorder=3)
        best = values[run.chosen].max()
        axis.set(title=f"β = {beta:g}: best {best:.2f} of {values.max():.2f}", xlabel="parameter θ")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("performance")
    axes[0].legend(fontsize=8)
    figure.suptitle(f"Figure 5: {STEPS} steps of GP-UCB", fontsize=11)
    figure.savefig(picture, dpi=130)
    plt.close(figure)
