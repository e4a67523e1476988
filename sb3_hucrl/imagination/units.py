"""Differences and spreads of states, with angles that wrap and dimensions that never change."""

from __future__ import annotations

from dataclasses import dataclass

import torch as th

from sb3_hucrl.data import Transitions
from sb3_hucrl.dynamics.encoding import StateFeatures
from sb3_hucrl.tasks.base import Task

#: a dimension with less spread than this is constant
CONSTANT = 1e-6


@dataclass(frozen=True)
class Units:
    """
    :param task: says which dimensions are angles, outcomes and context
    """

    task: Task

    @property
    def names(self) -> list[str]:
        """Of the p predicted dimensions: their indices, and what a learned outcome is."""
        outcomes = ["reward", "termination"][: self.task.outcome_dim]
        return [*(f"dimension {index}" for index in range(self.task.hallucinated_dim)), *outcomes]

    def predicted(self, states: th.Tensor) -> th.Tensor:
        """
        :param states: shape (n, p + c)
        :return: without context, shape (n, p)
        """
        return states[:, : self.task.state_dim]

    def observed(self, states: th.Tensor) -> th.Tensor:
        """
        :param states: shape (n, p + c) or (n, p)
        :return: without context and outcomes, shape (n, p - outcomes)
        """
        return states[:, : self.task.hallucinated_dim]

    def difference(self, states: th.Tensor, reference: th.Tensor) -> th.Tensor:
        """
        :param states: of k dimensions, shape (n, k)
        :param reference: shape (n, k)
        :return: with angles in [-π, π), shape (n, k)
        """
        return StateFeatures(states.shape[1], self.task.angle_dims).difference(states, reference)

    def spread(self, states: th.Tensor) -> th.Tensor:
        """
        :param states: of k dimensions, shape (n, k)
        :return: standard deviation, NaN where nothing changes, shape (k,)
        """
        deviation = states - states.mean(dim=0)
        for dim in self.task.angle_dims:
            angle = states[:, dim]
            around = th.atan2(angle.sin().mean(), angle.cos().mean())
            deviation[:, dim] = th.remainder(angle - around + th.pi, 2 * th.pi) - th.pi
        std = deviation.square().mean(dim=0).sqrt()
        return th.where(std > CONSTANT, std, th.nan)

    def change(self, transitions: Transitions) -> th.Tensor:
        """
        :param transitions: n real ones
        :return: standard deviation of the change in one step, NaN where nothing changes, shape (p,)
        """
        return self.spread(self.difference(self.predicted(transitions.next_states), self.predicted(transitions.states)))

    def features(self, states: th.Tensor) -> th.Tensor:
        """
        :param states: shape (n, p + c)
        :return: without context and outcomes, angles as (sin, cos), standardised, shape (n, features)
        """
        observed = self.observed(states)
        features = StateFeatures(observed.shape[1], self.task.angle_dims)(observed)
        std = features.std(dim=0, correction=0)
        standardised: th.Tensor = (features - features.mean(dim=0)) / th.where(std > CONSTANT, std, 1.0)
        return standardised
