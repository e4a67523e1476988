"""The launchers of the paper's figures: killed jobs are tried again, failed ones reported, and none runs twice."""

from __future__ import annotations

import os
import signal
import sys
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pytest

from figures.experiment import run_process, write_whole
from figures.launcher import RETRIES, launch, launch_on_ray

pytestmark = pytest.mark.slow

KILL_YOURSELF = "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"


@dataclass(frozen=True)
class Pretended:
    """
    Draws numbers where others train.

    :param seed: of the numbers
    :param attempts: folder outside of the results, in which each attempt leaves a mark
    :param trouble: what happens first: the process that it starts is killed ("process", and each time, "processes"),
        or its own ("worker"), or it fails ("failure")
    """

    seed: int
    attempts: Path
    trouble: str = ""

    @property
    def name(self) -> str:
        return f"job {self.seed}"

    def path(self, folder: Path) -> Path:
        return folder / f"{self.seed}.csv"

    def execute(self, folder: Path) -> None:
        mark = self.attempts / str(self.seed)
        with mark.open("a") as file:
            file.write("x")
        first = mark.stat().st_size == 1
        if self.trouble == "worker" and first:
            os.kill(os.getpid(), signal.SIGKILL)
        if self.trouble == "processes" or (self.trouble == "process" and first):
            run_process([sys.executable, "-c", KILL_YOURSELF], self.name)
        if self.trouble == "failure":
            run_process([sys.executable, "-c", "raise SystemExit('no such thing')"], self.name)
        write_whole(pd.DataFrame({"seed": [self.seed]}), folder / f"{self.seed}-z.csv")
        write_whole(pd.DataFrame({"seed": [self.seed], "square": [self.seed**2]}), self.path(folder))


def results(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir()}


def attempts(folder: Path) -> dict[str, int]:
    return {path.name: path.stat().st_size for path in folder.iterdir()}


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """For results and for attempts."""
    for name in ("results", "attempts"):
        (tmp_path / name).mkdir()
    return tmp_path / "results", tmp_path / "attempts"


def test_killed_jobs_are_tried_again_and_failing_ones_reported(folders: tuple[Path, Path]) -> None:
    output, marks = folders
    troubles = ["", "process", "failure", "processes"]
    errors = launch([Pretended(seed, marks, trouble) for seed, trouble in enumerate(troubles)], output, 2)
    assert set(results(output)) == {"0.csv", "0-z.csv", "1.csv", "1-z.csv"}
    assert attempts(marks) == {"0": 1, "1": 2, "2": 1, "3": RETRIES + 1}
    assert len(errors) == 2
    assert "no such thing" in errors[0]
    assert "killed by signal 9" in errors[1]


def test_ray_gives_the_same_files_though_a_worker_is_killed(folders: tuple[Path, Path], tmp_path: Path) -> None:
    ray = pytest.importorskip("ray")
    # Workers cannot import this module.
    ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])
    output, marks = folders
    troubles = ["", "worker", "process", "failure"]
    errors = launch_on_ray([Pretended(seed, marks, trouble) for seed, trouble in enumerate(troubles)], output, 2)
    assert attempts(marks) == {"0": 1, "1": 2, "2": 2, "3": 1}
    assert len(errors) == 1
    assert "job 3" in errors[0]
    assert "no such thing" in errors[0]
    # The file that says that a job is done came last.
    times = {path.name: path.stat().st_mtime_ns for path in output.iterdir()}
    assert all(times[f"{seed}-z.csv"] <= times[f"{seed}.csv"] for seed in range(3))

    local, others = tmp_path / "local", tmp_path / "others"
    local.mkdir()
    others.mkdir()
    launch([Pretended(seed, others) for seed in range(3)], local, 2)
    assert results(output) == results(local)

    launch_on_ray([Pretended(seed, marks) for seed in range(3)], output, 2)
    assert attempts(marks) == {"0": 1, "1": 2, "2": 2, "3": 1}
    ray.shutdown()
