"""Progress bars."""

from __future__ import annotations

from typing import Any

from tqdm import tqdm


def progress_bar(total: int | None, what: str) -> tqdm[Any]:
    """
    A bar that appears after one second, disappears at the end, and prints nothing without a terminal.

    :param total: number of steps, None if unknown
    :param what: label of the bar
    """
    return tqdm(total=total, desc=what, unit="step", delay=1.0, leave=False, disable=None)
