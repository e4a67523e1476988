"""Which of the policies found so far plays on the real environment."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sb3_hucrl.checks import validated
from sb3_hucrl.loop.search import Search


@validated
def choose_policy(search: Search, kept: Any, evaluate: Callable[[], float]) -> tuple[Any, float]:
    """
    Give the search the best solution of (7) that was found so far, judged by the newest dynamics model.

    Policy search fluctuates, and may end with a worse policy than it began with. Both are judged on the same, newest
    model, so that a policy that only exploited an earlier model's mistakes is not kept.

    :param search: at its end
    :param kept: the parameters that were chosen last time, or None at the first time
    :param evaluate: return of the search's policy on the newest dynamics
    :return: the parameters that the search has now, and their return: those found now, unless the kept ones are better
    """
    found, value = search.parameters(), evaluate()
    if kept is not None:
        search.restore(kept)
        kept_value = evaluate()
        if kept_value > value:
            return kept, kept_value
        search.restore(found)
    return found, value
