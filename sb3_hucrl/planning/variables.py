"""Decision variables of planners: actions, or changes to a policy."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch as th

from sb3_hucrl.checks import Count, validated
from sb3_hucrl.planning.proposal import Bounds, Proposal


@validated
class DecisionVariables(ABC):
    """
    Vectors x_n of k numbers that a planner optimises, and from which actions follow: one for each of N steps, or a
    single one for all of them.

    :param horizon: N, steps that are planned ahead, at least 1
    :param bounds: of each vector
    :param fresh: proposal of a search without an earlier plan, for a single environment
    """

    def __init__(self, horizon: Count, bounds: Bounds, fresh: Proposal) -> None:
        self.horizon, self.bounds, self._fresh = horizon, bounds, fresh

    def fresh(self, num_envs: int) -> Proposal:
        """
        :param num_envs: B
        :return: the proposal with which a search without an earlier plan begins
        """
        return self._fresh.expanded(num_envs)

    def shifted(self, proposal: Proposal) -> Proposal:
        """
        :param proposal: with which the last search ended, for B environments
        :return: the proposal for the next real step, whose first step is the plan for that step
        """
        return proposal.shifted(self.fresh(len(proposal.mean)))

    @abstractmethod
    def action(self, value: th.Tensor, state: th.Tensor) -> th.Tensor:
        """
        :param value: x_n of M trajectories, shape (M, k)
        :param state: s_n, shape (M, p + c)
        :return: (a_n, a′_n), shape (M, q + h)
        """


@validated
class ActionSequence(DecisionVariables):
    """
    The actions themselves (Algorithm 6): (a_n, a′_n) = x_n.

    The first proposal is centred, with a standard deviation of a quarter of the range (as in PETS, Chua et al. 2018).

    :param horizon: N
    :param bounds: of (a, a′)
    """

    def __init__(self, horizon: Count, bounds: Bounds) -> None:
        shape = (1, horizon, len(bounds.low))
        middle, spread = (bounds.low + bounds.high) / 2, (bounds.high - bounds.low) / 4
        super().__init__(horizon, bounds, Proposal(middle.expand(shape), spread.expand(shape)))

    def action(self, value: th.Tensor, state: th.Tensor) -> th.Tensor:
        return value
