"""A training run of a figure, and the CSVs that it writes."""

from __future__ import annotations

import subprocess
import tempfile
from dataclasses import astuple, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from benchmark import Run, command, imagined_steps
from results_table import commit, real_episodes
from sb3_hucrl.files import replacing
from sb3_hucrl.pictures import trajectories
from sb3_hucrl.zoo.runs import ZooRun

PENDULUM = "HUCRL-Pendulum-v0"
PACKAGES = ("sb3_hucrl", "stable_baselines3", "sbx_rl", "gymnasium", "torch")
LOGGED = {
    "imagined_return": "imagined/return",
    "epistemic_std": "imagined/epistemic_std",
    "search_seconds": "time/search_seconds",
    "fit_seconds": "time/fit_seconds",
}
#: settings of the callback for quick runs, which only check that everything works
QUICK_SETTINGS: dict[str, Any] = {"hucrl_imagined_steps": 640, "hucrl_horizon": 10}
QUICK_EPISODES = 4
#: of what is logged
DECIMALS = 4


def write_whole(rows: pd.DataFrame, path: Path) -> None:
    """
    Write a CSV in one step, so that no reader sees half of it.

    :param rows: of the CSV
    :param path: is compressed if it ends in .gz
    """
    compression: Literal["gzip"] | None = "gzip" if path.suffix == ".gz" else None
    with replacing(path) as file:
        rows.to_csv(file, index=False, compression=compression)


def run_process(words: list[str], name: str) -> None:
    """
    :param words: of the command
    :param name: for messages
    :raises RuntimeError: if it fails
    :raises InterruptedError: if it was killed, so that it may be tried again
    """
    process = subprocess.run(words, capture_output=True, text=True, check=False)
    if process.returncode < 0:
        raise InterruptedError(f"{name} was killed by signal {-process.returncode}")
    if process.returncode != 0:
        raise RuntimeError(f"{name} failed:\n{process.stderr[-2000:]}")


@dataclass(frozen=True)
class Experiment:
    """
    :param run: the training run
    :param episodes: real episodes, with the random first one
    :param quick: whether to make very short searches, to check that everything works
    :param commit: of the code
    """

    run: Run
    episodes: int
    quick: bool
    commit: str = field(default_factory=commit, compare=False)

    @property
    def name(self) -> str:
        """A name that is unique to the job."""
        return "-".join(str(value) for value in (*astuple(self.run), self.episodes))

    def path(self, folder: Path) -> Path:
        """Where the results are kept; several figures may share them."""
        return folder / ("quick" if self.quick else "runs") / f"{self.name}.csv"

    def trajectories_path(self, folder: Path) -> Path:
        """Where optimistic runs of the pendulum with ensembles keep their real and imagined trajectories."""
        return self.path(folder).with_name(f"{self.name}-trajectories.csv.gz")

    def _command(self, folder: str) -> list[str]:
        settings = QUICK_SETTINGS if self.quick else {}
        words = command(self.run, folder, settings)
        episodes = min(self.episodes, QUICK_EPISODES) if self.quick else self.episodes
        steps = QUICK_SETTINGS["hucrl_imagined_steps"] if self.quick else imagined_steps(self.run)
        return [*words, f"n_timesteps:{(episodes - 1) * steps}"]

    def execute(self, folder: Path) -> None:
        """
        Train, unless the CSV already exists.

        :param folder: of all results
        :raises RuntimeError: if training fails
        :raises InterruptedError: if it was killed, so that it may be tried again
        """
        path = self.path(folder)
        if path.exists():
            return
        with tempfile.TemporaryDirectory() as logs:
            run_process(self._command(logs), self.name)
            [run_folder] = Path(logs).glob(f"{self.run.algo}/{self.run.env}_*/")
            run = ZooRun(run_folder)
            if (self.run.env, self.run.exploration, self.run.dynamics) == (PENDULUM, "optimistic", "ensemble"):
                write_whole(trajectories(run.state), self.trajectories_path(folder))
            write_whole(self._rows(run), path)

    def _rows(self, run: ZooRun) -> pd.DataFrame:
        rows = real_episodes(str(run.folder))
        for name, column in LOGGED.items():
            if column in run.progress:
                rows[name] = run.progress[column].reindex(rows.episode).to_numpy().round(DECIMALS)
        versions = {package: version(package) for package in PACKAGES}
        return rows.assign(**vars(self.run), commit=self.commit, **versions)
