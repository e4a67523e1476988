"""Independent runs side by side. A killed one is tried again."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tqdm import tqdm

from figures.experiment import Experiment

#: how often a run that was killed is tried again
RETRIES = 2


def launch(experiments: Sequence[Experiment], folder: Path, jobs: int) -> list[str]:
    """
    :param experiments: what to run; each is a process of its own
    :param folder: of all results
    :param jobs: how many side by side
    :return: what went wrong
    """
    with ThreadPoolExecutor(jobs) as pool:
        results = pool.map(lambda each: _attempt(each, folder), experiments)
        return [error for error in tqdm(results, total=len(experiments), unit="run") if error is not None]


def _attempt(experiment: Experiment, folder: Path) -> str | None:
    message = ""
    for _ in range(RETRIES + 1):
        try:
            experiment.execute(folder)
        except InterruptedError as error:
            message = str(error)
        except RuntimeError as error:
            return str(error)
        else:
            return None
    return f"{message}, {RETRIES + 1} times"
