"""The paper's cart-pole."""

from __future__ import annotations

import torch as th

from sb3_hucrl.tasks.angles import AngleTask

POLE_LENGTH = 0.6


class CartPoleTask(AngleTask):
    """
    State (x, θ, ẋ, θ̇) with θ = 0 hanging (appendix B.2.2).

    :param action_penalty: ρ
    """

    state_dim = 4
    angle_dims = (1,)

    def __init__(self, action_penalty: float = 0.05) -> None:
        super().__init__()
        self.action_penalty = action_penalty

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        x, theta = next_state[:, 0], next_state[:, 1]
        across = x - POLE_LENGTH * theta.sin()
        below = POLE_LENGTH * (1 + theta.cos())
        closeness = (-(across.square() + below.square()) / 0.6**2).exp()
        return closeness - self.action_penalty * action.square().sum(dim=1)
