"""Which of the policies found so far plays on the real environment."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch as th

from sb3_hucrl.checks import validated
from sb3_hucrl.loop.search import Search


@validated
def choose_policy(
    search: Search, kept: Any, evaluate: Callable[[], float], generator: th.Generator
) -> tuple[Any, float]:
    """
    Give the search the best solution of (7) that was found so far, judged by the newest dynamics model.

    Policy search fluctuates, and may end with a worse policy than it began with. Both are judged on the same, newest
    model, so that a policy that only exploited an earlier model's mistakes is not kept.

    :param search: at its end
    :param kept: the parameters that were chosen last time, or None at the first time
    :param evaluate: return of the search's policy on the newest dynamics
    :param generator: of the dynamics, which gives both policies the same members where these are drawn for each row
    :return: the parameters that the search has now, and their return: those found now, unless the kept ones are better
    """
    draws = generator.get_state()
    found, value = search.parameters(), evaluate()
    if kept is not None:
        search.restore(kept)
        generator.set_state(draws)
        kept_value = evaluate()
        if kept_value > value:
            return kept, kept_value
        search.restore(found)
    return found, value
