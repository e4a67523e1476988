"""The task of the paper's pendulum."""

from __future__ import annotations

import math

import torch as th

from sb3_hucrl.checks import NotNegative, validated
from sb3_hucrl.tasks.angles import AngleTask
from sb3_hucrl.tasks.arithmetic import Number, tolerance


@validated
class PendulumTask(AngleTask):
    """
    The paper's swing-up (appendix B.2.1): state (θ, ω) with θ = 0 upright, observation (sin θ, cos θ, ω).

    :param action_penalty: ρ, 0 or more
    """

    state_dim = 2
    angle_dims = (0,)

    def __init__(self, action_penalty: NotNegative = 0.1) -> None:
        super().__init__()
        self.action_penalty = action_penalty

    def reward_formula(self, height: Number, omega: Number, torque: Number) -> Number:
        """
        tol(cos θ)·tol(ω) + ρ·(tol(a) - 1), also the environment's reward.

        :param height: cos θ
        :param omega: angular velocity before the step, in rad/s
        :param torque: a, in N m
        """
        upright = tolerance(height, 0.95, 1.0, margin=0.1)
        slow = tolerance(omega, -0.5, 0.5, margin=0.5)
        effortless = tolerance(torque, -0.1, 0.1, margin=0.1)
        return upright * slow + self.action_penalty * (effortless - 1)

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        theta, omega = state.unbind(dim=1)
        return self.reward_formula(theta.cos(), omega, action[:, 0])

    def exploratory_states(self, n: int, generator: th.Generator | None) -> th.Tensor:
        """θ ~ U(-π, π); ω ~ N(0, 0.05²) rad/s, nearly at rest."""
        theta = (2 * th.rand(n, generator=generator) - 1) * math.pi
        return th.stack([theta, 0.05 * th.randn(n, generator=generator)], dim=1)
