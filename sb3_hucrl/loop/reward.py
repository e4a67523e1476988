"""Whether real episodes have met anything that a search could look for."""

from __future__ import annotations

import torch as th

from sb3_hucrl.checks import validated
from sb3_hucrl.data import Transitions

#: part of the rewards' variance from which on more than the action decides on them
UNEXPLAINED = 1e-4
#: of the mean square of rewards that are all the same, what is left of it by rounding
ROUNDING = 1e-12


@validated
def meets_reward(transitions: Transitions) -> bool:
    """
    Where all rewards are the same, or are what actions cost, nothing is known to be better than doing nothing.

    :param transitions: real ones
    :return: whether one of them is terminal, or rewards depend on more than the action: a least-squares fit of a,
        ``|a|`` and a² of each dimension leaves more than :data:`UNEXPLAINED` of their variance
    """
    if bool(transitions.terminated.any()):
        return True
    rewards, actions = transitions.rewards.double()[:, None], transitions.actions.double()
    costs = th.cat([th.ones_like(rewards), actions, actions.abs(), actions.square()], dim=1)
    # Columns may be the same, such as a and |a| of actions that are never negative.
    left = rewards - costs @ th.linalg.lstsq(costs, rewards, driver="gelsd").solution
    least = UNEXPLAINED * rewards.var(correction=0) + ROUNDING * rewards.square().mean()
    return bool(left.square().mean() > least)
