"""Progress bars."""

from __future__ import annotations

from typing import Any

from tqdm import tqdm


def progress_bar(total: int | None, label: str) -> tqdm[Any]:
    """
    A bar that appears after one second, disappears at the end, and prints nothing without a terminal.

    :param total: number of steps, None if unknown
    :param label: text in front of the bar
    """
    return tqdm(total=total, desc=label, unit="step", delay=1.0, leave=False, disable=None)
