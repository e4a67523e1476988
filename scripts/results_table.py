"""A CSV of results to which each finished run is appended, so that an interrupted benchmark can continue."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, astuple, fields
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import pandas as pd
from stable_baselines3.common.monitor import load_results
from tqdm import tqdm

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

RunT = TypeVar("RunT", bound="DataclassInstance")


@cache
def commit() -> str:
    """The commit of the results: the one that was checked out at the first call."""
    command = ["git", "describe", "--always", "--dirty"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()


def real_episodes(folder: str) -> pd.DataFrame:
    """
    :param folder: with the monitor.csv of one run
    :return: number, return, length of each real episode, and the seconds since the run's start
    """
    monitored = load_results(folder)
    return pd.DataFrame(
        {
            "episode": range(1, len(monitored) + 1),
            "real_return": monitored.r.round(2),
            "real_steps": monitored.l,
            "seconds": monitored.t.round(0).astype(int),
        }
    )


class ResultsTable(Generic[RunT]):
    """
    :param path: of the CSV; if it exists, rows are appended
    :param run_type: dataclass that describes a run; its fields are columns
    """

    def __init__(self, path: Path, run_type: type[RunT]) -> None:
        self.path = path
        self.rows = pd.read_csv(path) if path.exists() else pd.DataFrame()
        self._columns = [field.name for field in fields(run_type)]

    def fill(self, runs: Iterable[RunT], execute: Callable[[RunT], pd.DataFrame], jobs: int) -> None:
        """
        Execute the runs that are not in the CSV, and append each as soon as it is finished.

        :param runs: all runs of the benchmark
        :param execute: makes a run and returns its rows; none if it failed
        :param jobs: number of parallel runs, each in its own process
        """
        done = set() if self.rows.empty else set(self.rows[self._columns].itertuples(index=False, name=None))
        missing = [run for run in runs if astuple(run) not in done]
        version = commit()
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with ProcessPoolExecutor(jobs) as pool:
            for run, rows in zip(
                missing, tqdm(pool.map(execute, missing), total=len(missing), unit="run"), strict=True
            ):
                described: dict[str, Any] = {**asdict(run), "commit": version}
                self.rows = pd.concat([self.rows, rows.assign(**described)])
                self.rows.to_csv(self.path, index=False)
