"""Progress bars of long steps."""

from __future__ import annotations

from tqdm import tqdm


def progress_bar(total: int | None, what: str) -> tqdm:
    """
    :param total: number of steps, None if nobody knows
    :param what: in front of the bar
    :return: a bar that shows up after a second, goes away at the end, and is silent where there is no terminal
    """
    return tqdm(total=total, desc=what, unit="step", delay=1.0, leave=False, disable=None)
