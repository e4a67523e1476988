"""The task of the paper's cart-pole."""

from __future__ import annotations

import math

import torch as th

from sb3_hucrl.checks import NotNegative, validated
from sb3_hucrl.tasks.angles import AngleTask
from sb3_hucrl.tasks.arithmetic import Number, exp

POLE_LENGTH = 0.6
#: half of the slider's range, in m
EXPLORED_POSITION = 1.25


@validated
class CartPoleTask(AngleTask):
    """
    State (x, θ, ẋ, θ̇) with θ = 0 hanging (appendix B.2.2).

    :param action_penalty: ρ, 0 or more
    """

    state_dim = 4
    angle_dims = (1,)

    def __init__(self, action_penalty: NotNegative = 0.05) -> None:
        super().__init__()
        self.action_penalty = action_penalty

    def reward_formula(self, squared_distance: Number, effort: Number) -> Number:
        """
        exp(-d²/0.6²) - ρ a², also the environment's reward.

        :param squared_distance: d², from the pole's tip to the point 0.6 m above the middle of the rail, in m²
        :param effort: a²
        """
        return exp(-squared_distance / 0.6**2) - self.action_penalty * effort

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        x, theta = next_state[:, 0], next_state[:, 1]
        across = x - POLE_LENGTH * theta.sin()
        below = POLE_LENGTH * (1 + theta.cos())
        return self.reward_formula(across.square() + below.square(), action.square().sum(dim=1))

    def exploratory_states(self, n: int, generator: th.Generator | None) -> th.Tensor:
        """x ~ U(-1.25, 1.25) m, θ ~ U(-π, π); ẋ and θ̇ ~ N(0, 0.05²), nearly at rest."""
        pose = (2 * th.rand(n, 2, generator=generator) - 1) * th.tensor([EXPLORED_POSITION, math.pi])
        return th.cat([pose, 0.05 * th.randn(n, 2, generator=generator)], dim=1)
