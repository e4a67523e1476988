"""Runs independent jobs in parallel, on this machine or on a Ray cluster. A killed job is tried again."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tqdm import tqdm

from figures.job import Job
from sb3_hucrl.files import replacing

SCRIPTS = Path(__file__).parent.parent
#: how often a job that was killed is tried again
RETRIES = 2


def launch(jobs: Sequence[Job], folder: Path, side_by_side: int) -> list[str]:
    """
    Run jobs as processes on this machine.

    :param jobs: each starts a process of its own
    :param folder: of all results
    :param side_by_side: number of parallel jobs
    :return: what went wrong
    """
    with ThreadPoolExecutor(side_by_side) as pool:
        return _errors(pool.map(lambda job: _attempt(job, folder), jobs), len(jobs))


def launch_on_ray(jobs: Sequence[Job], folder: Path, side_by_side: int) -> list[str]:
    """
    Run jobs on the cluster at ``RAY_ADDRESS``, or on a local one that is started for them. The nodes need this package
    installed and share no disk with this machine: results come back over the network.

    :param jobs: each takes one CPU
    :param folder: of all results, on this machine
    :param side_by_side: CPUs of the local cluster; another has its own
    :return: what went wrong
    :raises ImportError: if Ray is not installed
    """
    try:
        import ray
    except ImportError as error:
        raise ImportError("Ray is not installed: pip install '.[cluster]'") from error

    missing = [job for job in jobs if not job.path(folder).exists()]
    if not missing:
        return []
    if not ray.is_initialized():
        num_cpus = None if "RAY_ADDRESS" in os.environ else side_by_side
        ray.init(num_cpus=num_cpus, runtime_env={"working_dir": str(SCRIPTS)}, log_to_driver=False)
    remote = ray.remote(num_cpus=1, max_retries=RETRIES)(_execute_elsewhere)

    def finished() -> Iterator[str | None]:
        pending = {remote.remote(job): job for job in missing}
        while pending:
            [task], _ = ray.wait(list(pending), num_returns=1)
            job = pending.pop(task)
            try:
                _keep(ray.get(task), job, folder)
            except (RuntimeError, ray.exceptions.RayError) as error:
                yield f"{job.name}: {error}"
            else:
                yield None

    # The next figure finds Ray running; it ends with this process.
    return _errors(finished(), len(missing))


LAUNCHERS = {"local": launch, "ray": launch_on_ray}


def _errors(results: Iterable[str | None], total: int) -> list[str]:
    return [error for error in tqdm(results, total=total, unit="run") if error is not None]


def _attempt(job: Job, folder: Path) -> str | None:
    message = ""
    for _ in range(RETRIES + 1):
        try:
            job.execute(folder)
        except InterruptedError as error:
            message = str(error)
        except RuntimeError as error:
            return str(error)
        else:
            return None
    return f"{message}, {RETRIES + 1} times"


def _execute_elsewhere(job: Job) -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        error = _attempt(job, Path(folder))
        if error is not None:
            raise RuntimeError(error)
        paths = [path for path in Path(folder).rglob("*") if path.is_file()]
        return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


def _keep(files: dict[str, bytes], job: Job, folder: Path) -> None:
    # The file that marks the job as done is written last, so that an interrupted copy is repeated.
    for name, content in sorted(files.items(), key=lambda file: folder / file[0] == job.path(folder)):
        path = folder / name
        if path.exists():
            continue
        with replacing(path) as file:
            file.write(content)
