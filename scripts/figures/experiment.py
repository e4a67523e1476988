"""One training run of a figure, and the CSV that it leaves."""

from __future__ import annotations

import os
import subprocess
import tempfile
from dataclasses import astuple, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd

from benchmark import Run, callback_settings, command
from results_table import commit, real_episodes
from sb3_hucrl.runs import ZooRun

PACKAGES = ("sb3_hucrl", "stable_baselines3", "gymnasium", "torch")
LOGGED = {
    "imagined_return": "imagined/return",
    "epistemic_std": "imagined/epistemic_std",
    "search_seconds": "time/search_seconds",
    "fit_seconds": "time/fit_seconds",
}
#: of the callback, so small that a run shows only that everything works
QUICK_SETTINGS: dict[str, Any] = {"imagined_steps": 640, "horizon": 50}
QUICK_EPISODES = 4


@dataclass(frozen=True)
class Experiment:
    """
    :param run: what is trained
    :param episodes: real episodes, with the random first one
    :param quick: search so little that nothing is learned, to see that everything works
    """

    run: Run
    episodes: int
    quick: bool

    def path(self, folder: Path) -> Path:
        """Where the results are kept; several figures may share them."""
        name = "-".join(str(value) for value in (*astuple(self.run), self.episodes))
        return folder / ("quick" if self.quick else "runs") / f"{name}.csv"

    def _command(self, folder: str) -> list[str]:
        settings = QUICK_SETTINGS if self.quick else {}
        words = command(self.run, folder, settings)
        episodes = min(self.episodes, QUICK_EPISODES) if self.quick else self.episodes
        steps = QUICK_SETTINGS["imagined_steps"] if self.quick else callback_settings(self.run)["imagined_steps"]
        return [*words, f"n_timesteps:{(episodes - 1) * steps}"]

    def execute(self, folder: Path) -> None:
        """
        Train, unless the CSV is there already. It appears at once and whole, whatever interrupts the run.

        :param folder: of all results
        :raises RuntimeError: if training fails
        :raises InterruptedError: if it was killed, so that it may be tried again
        """
        path = self.path(folder)
        if path.exists():
            return
        with tempfile.TemporaryDirectory() as logs:
            process = subprocess.run(self._command(logs), capture_output=True, text=True, check=False)
            if process.returncode < 0:
                raise InterruptedError(f"{path.stem} was killed by signal {-process.returncode}")
            if process.returncode != 0:
                raise RuntimeError(f"{path.stem} failed:\n{process.stderr[-2000:]}")
            [run_folder] = Path(logs).glob(f"{self.run.algo}/{self.run.env}_*/")
            rows = self._rows(run_folder)
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished = path.with_suffix(f".{os.getpid()}.tmp")
        rows.to_csv(unfinished, index=False)
        unfinished.replace(path)

    def _rows(self, run_folder: Path) -> pd.DataFrame:
        rows = real_episodes(str(run_folder))
        progress = ZooRun(run_folder).progress
        for name, column in LOGGED.items():
            if column in progress:
                rows[name] = progress[column].reindex(rows.episode).to_numpy().round(4)
        versions = {package: version(package) for package in PACKAGES}
        return rows.assign(**vars(self.run), commit=commit(), **versions)
