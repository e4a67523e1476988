"""Tasks of gymnasium's walking robots: the termination is known, the reward is learned."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, TypeAlias

import torch as th
from pydantic import Field

from sb3_hucrl.checks import Count, Natural, validated
from sb3_hucrl.tasks.learned import LearnedReward

#: a side may be open; NaN is below every number
Bound: TypeAlias = Annotated[float, Field(ge=-math.inf, allow_inf_nan=True)]
Interval: TypeAlias = Annotated[
    Sequence[Bound], Field(min_length=2, max_length=2, description="a lower and an upper bound, which may be infinite")
]


@validated
class LocomotionTask(LearnedReward):
    """
    ``HalfCheetah-v5``, ``Hopper-v5``, ``Walker2d-v5``, ``Swimmer-v5`` and ``Ant-v5``.

    Their reward is the distance moved in a step, which is not observed (and for Ant also contact forces, which are
    observed only after clipping), so the reward is learned. They terminate when an observed value leaves its healthy
    range.

    :param observation_dim: number of observed values
    :param healthy: healthy open interval by index of the observation
    """

    def __init__(self, observation_dim: Count, healthy: Mapping[Natural, Interval]) -> None:
        super().__init__(observation_dim)
        bounds = th.tensor([[-th.inf, th.inf]]).repeat(observation_dim, 1)
        for index, interval in healthy.items():
            bounds[index] = th.tensor(interval)
        self._low, self._high = bounds.unbind(dim=1)

    def terminated(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        observation = self.observe(next_state)
        low, high = self._low.to(observation), self._high.to(observation)
        return ((observation <= low) | (observation >= high)).any(dim=1)
