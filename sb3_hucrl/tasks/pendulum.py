"""The two pendulums: the paper's swing-up and gymnasium's."""

from __future__ import annotations

import math

import torch as th

from sb3_hucrl.tasks.base import Task, tolerance


class PendulumTask(Task):
    """
    The paper's swing-up (appendix B.2.1): state (θ, ω) with θ = 0 upright, observation (sin θ, cos θ, ω).

    :param action_penalty: ρ
    """

    state_dim = 2
    angle_dims = (0,)

    def __init__(self, action_penalty: float = 0.1) -> None:
        self.action_penalty = action_penalty

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        theta, omega = state.unbind(dim=1)
        upright = tolerance(theta.cos(), 0.95, 1.0, margin=0.1)
        slow = tolerance(omega, -0.5, 0.5, margin=0.5)
        effortless = tolerance(action[:, 0], -0.1, 0.1, margin=0.1)
        return upright * slow + self.action_penalty * (effortless - 1)

    def observe(self, state: th.Tensor) -> th.Tensor:
        theta, omega = state.unbind(dim=1)
        return th.stack([theta.sin(), theta.cos(), omega], dim=1)

    def state(self, observation: th.Tensor) -> th.Tensor:
        sine, cosine, omega = observation.unbind(dim=1)
        return th.stack([th.atan2(sine, cosine), omega], dim=1)

    def exploratory_states(self, n: int, generator: th.Generator | None) -> th.Tensor:
        """θ ~ U(-π, π), nearly at rest: ω ~ N(0, 0.05²) rad/s."""
        theta = (2 * th.rand(n, generator=generator) - 1) * math.pi
        return th.stack([theta, 0.05 * th.randn(n, generator=generator)], dim=1)


class GymnasiumPendulumTask(Task):
    """gymnasium's ``Pendulum-v1``: state (θ, ω) with θ = 0 upright, observation (cos θ, sin θ, ω), ω in [-8, 8]."""

    state_dim = 2
    angle_dims = (0,)

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        theta, omega = state.unbind(dim=1)
        angle = th.remainder(theta + math.pi, 2 * math.pi) - math.pi
        return -(angle.square() + 0.1 * omega.square() + 0.001 * action[:, 0].square())

    def observe(self, state: th.Tensor) -> th.Tensor:
        theta, omega = state.unbind(dim=1)
        return th.stack([theta.cos(), theta.sin(), omega.clamp(-8, 8)], dim=1)

    def state(self, observation: th.Tensor) -> th.Tensor:
        cosine, sine, omega = observation.unbind(dim=1)
        return th.stack([th.atan2(sine, cosine), omega], dim=1)
