"""Figure 20: imagined returns of optimism in an ensemble, and of its best member."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import pandas as pd

from benchmark import Run
from figures.curves import ALGO, draw_curve
from figures.experiment import PENDULUM, Experiment, run_process, write_whole

mpl.use("agg")
from matplotlib import pyplot as plt

SCRIPT = Path(__file__).parent.parent / "search_heads.py"
REAL_EPISODES = 10
EPISODES = (1, 5, 10)
OPTIMISM, BEST = "optimism in the ensemble", "best member"
IMAGINED_STEPS, QUICK_STEPS = 51_200, 640


@dataclass(frozen=True)
class HeadSearch:
    """
    Policy searches in the models of a run of figure 6: one in the ensemble and one in each member.

    :param experiment: the run
    """

    experiment: Experiment

    @property
    def name(self) -> str:
        """A name that is unique to the job."""
        return f"heads-{self.experiment.name}"

    def path(self, folder: Path) -> Path:
        """File name of the results."""
        return self.experiment.path(folder).with_name(f"{self.name}.csv")

    def execute(self, folder: Path) -> None:
        """
        Train and then search; what is already done is skipped.

        :param folder: of all results
        :raises RuntimeError: if it fails
        :raises InterruptedError: if it was killed, so that it may be tried again
        """
        path = self.path(folder)
        if path.exists():
            return
        self.experiment.execute(folder)
        run, unfinished = self.experiment.run, path.with_suffix(".unfinished")
        steps = QUICK_STEPS if self.experiment.quick else IMAGINED_STEPS
        words = [str(self.experiment.trajectories_path(folder)), "--penalty", str(run.action_penalty)]
        words += ["--seed", str(run.seed), "--imagined-steps", str(steps), "--output", str(unfinished)]
        words += ["--episodes", *(str(episode) for episode in (EPISODES[:1] if self.experiment.quick else EPISODES))]
        run_process([sys.executable, str(SCRIPT), *words], self.name)
        rows = pd.read_csv(unfinished)
        write_whole(rows.assign(action_penalty=run.action_penalty, seed=run.seed, commit=self.experiment.commit), path)
        unfinished.unlink()


@dataclass(frozen=True)
class BestHead:
    """
    One panel for each penalty: imagined return of optimism, and of the best member, after some real episodes.

    :param title: above the picture
    :param penalties: of the panels
    """

    title: str
    penalties: tuple[float, ...]

    def jobs(self, seeds: list[int], quick: bool) -> list[HeadSearch]:
        """
        :param seeds: of each curve
        :param quick: whether to make very short runs, and with the highest penalty only
        """
        return [
            HeadSearch(
                Experiment(
                    Run(ALGO, PENDULUM, "optimistic", "ensemble", penalty, "exploratory", seed), REAL_EPISODES, quick
                )
            )
            for seed in seeds
            for penalty in (self.penalties[-1:] if quick else self.penalties)
        ]

    def draw(self, folder: Path, seeds: list[int], quick: bool, picture: Path) -> str:
        """
        :param folder: of all results
        :param seeds: of each curve
        :param quick: whether to draw the quick runs
        :param picture: file of the picture to write
        :return: the imagined returns, for each seed
        """
        paths = [each.path(folder) for each in self.jobs(seeds, quick)]
        rows = pd.concat([pd.read_csv(path) for path in paths if path.exists()])
        rows["searched"] = rows["head"].isna().map({True: OPTIMISM, False: BEST})
        best = rows.groupby(["action_penalty", "searched", "episode", "seed"], as_index=False).imagined_return.max()
        figure, axes = plt.subplots(
            1, len(self.penalties), figsize=(4.2 * len(self.penalties), 3.6), squeeze=False, layout="constrained"
        )
        for axis, penalty in zip(axes[0], self.penalties, strict=True):
            for searched in (OPTIMISM, BEST):
                curve = best[(best.action_penalty == penalty) & (best.searched == searched)]
                values = curve.pivot_table(index="episode", columns="seed", values="imagined_return")
                draw_curve(axis, values, searched)
            axis.set_title(f"action penalty {penalty}", fontsize=10)
            axis.set_xticks(EPISODES)
            axis.set_xlabel("real episodes that the model learned from")
            axis.grid(alpha=0.3)
        axes[0][0].set_ylabel("imagined return")
        axes[0][-1].legend(fontsize=8)
        figure.suptitle(f"{self.title} (seeds: {best.seed.nunique()}; median and range)", fontsize=11)
        figure.savefig(picture, dpi=130)
        plt.close(figure)
        table = best.pivot_table(
            index=["action_penalty", "searched", "episode"], columns="seed", values="imagined_return"
        )
        text: str = table.round(0).to_string()
        return text
