"""A training run of the suite, and the CSV that it writes."""

from __future__ import annotations

import json
import re
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pandas as pd

from figures.experiment import run_process, write_whole
from results_table import commit, real_episodes
from suite_parts.diagnosis import diagnosis_of
from suite_parts.plans import PLANS, Plan
from suite_parts.tasks import SuiteTask

#: of the CSV that a run without any finished episode writes
NO_EPISODE = {"episode": [0], "real_return": [np.nan], "real_steps": [0], "seconds": [0]}


@dataclass(frozen=True)
class SuiteRun:
    """
    :param task: the environment
    :param who: the side of the comparison, one of :data:`suite_parts.plans.PLANS`
    :param algo: rl_zoo3's name of the algorithm
    :param seed: of the run
    :param quick: whether to make very short searches, to check that everything works
    :param commit: of the code
    """

    task: SuiteTask
    who: str
    algo: str
    seed: int
    quick: bool = False
    commit: str = field(default_factory=commit, compare=False)

    @property
    def name(self) -> str:
        """A name that is unique to the job."""
        return f"{self.who} {self.task.env} {self.seed}"

    def path(self, folder: Path) -> Path:
        """The CSV. It exists once the run has ended, be it with an error; whoever deletes it wants a new run."""
        return folder / self.who / f"{self.task.env}_{self.seed}.csv"

    def execute(self, folder: Path) -> None:
        """
        Train, unless the CSV already exists. A training that fails writes its error to the CSV.

        :param folder: of all results
        :raises RuntimeError: if it was interrupted and ended early
        :raises InterruptedError: if it was killed, so that it may be tried again
        """
        path = self.path(folder)
        if path.exists():
            return
        plan = PLANS[self.who](self.task, self.algo, self.quick)
        with tempfile.TemporaryDirectory() as logs:
            error = ""
            try:
                run_process(plan.command(Path(logs), self.seed), self.name)
            except RuntimeError as failure:
                error = _last_error(str(failure))
            else:
                self._require_whole(plan, Path(logs))
            write_whole(self._rows(plan, Path(logs), error), path)

    def _require_whole(self, plan: Plan, logs: Path) -> None:
        # On Ctrl-C rl_zoo3 saves the model, and reports no failure.
        folders = logs.glob(f"{plan.algo}/{plan.env}_*")
        if plan.real_steps is None:
            steps, wanted, unit = (
                sum(_timesteps(each / f"{plan.env}.zip") for each in folders),
                plan.timesteps,
                "timesteps",
            )
        else:
            steps, wanted, unit = sum(map(_real_steps, folders)), plan.real_steps, "real steps"
        if steps < wanted:
            raise RuntimeError(f"{self.name} ended early, after {steps} of {wanted} {unit}")

    def _rows(self, plan: Plan, logs: Path, error: str) -> pd.DataFrame:
        monitors = list(logs.glob(f"{plan.algo}/{plan.env}_*/0.monitor.csv"))
        rows = real_episodes(str(monitors[0].parent)) if monitors else pd.DataFrame()
        if rows.empty:
            rows = pd.DataFrame(NO_EPISODE)
        return rows.assign(
            mode_return=self._mode_returns(rows, logs),
            env=self.task.env,
            seed=self.seed,
            who=self.who,
            algo=plan.algo,
            entry=plan.entry_name,
            commit=self.commit,
            error=error,
            diagnosis=self._diagnosis(plan, monitors, error),
        )

    @staticmethod
    def _diagnosis(plan: Plan, monitors: list[Path], error: str) -> str:
        """Of a training in imagination that came to its end; of any other one, nothing."""
        imagined = plan.real_steps is not None
        return diagnosis_of(monitors[0].parent) if imagined and monitors and not error else ""

    def _mode_returns(self, rows: pd.DataFrame, logs: Path) -> pd.Series[float]:
        """Evaluations of the policy's mode, each beside the episode that was being played then."""
        found = pd.Series(np.nan, index=rows.index)
        ends = rows.real_steps.cumsum().to_numpy()
        for path in logs.rglob("evaluations.npz"):
            evaluations = np.load(path)
            for step, returns in zip(evaluations["timesteps"], evaluations["results"], strict=True):
                found.iloc[min(int(np.searchsorted(ends, step)), len(rows) - 1)] = round(float(returns.mean()), 2)
        return found


def _last_error(message: str) -> str:
    """The last line of a traceback that names an exception, or else the last line."""
    lines = [line.strip() for line in message.splitlines() if line.strip()]
    named = [line for line in lines if re.match(r"[\w.]+(Error|Exception|Exit)\b", line)]
    return (named or lines)[-1]


def _timesteps(saved: Path) -> int:
    with ZipFile(saved) as file:
        return int(json.loads(file.read("data"))["num_timesteps"])


def _real_steps(folder: Path) -> int:
    # The monitor has whole episodes, and a training may end within one.
    progress = folder / "progress.csv"
    logged = pd.read_csv(progress)["real/steps"].max() if progress.exists() else 0
    return max(int(logged), int(real_episodes(str(folder)).real_steps.sum()))
