"""Tasks of gymnasium's classic control environments with continuous actions."""

from __future__ import annotations

import math

import torch as th

from sb3_hucrl.checks import Real, validated
from sb3_hucrl.tasks.base import Task


class GymnasiumPendulumTask(Task):
    """gymnasium's ``Pendulum-v1``: state (θ, ω) with θ = 0 upright, observation (cos θ, sin θ, ω), ω in [-8, 8]."""

    state_dim = 2
    angle_dims = (0,)

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        theta, omega = state.unbind(dim=1)
        angle = th.remainder(theta + math.pi, 2 * math.pi) - math.pi
        # The environment clips ω, and imagination must not be punished for speeds beyond that.
        omega = omega.clamp(-8, 8)
        return -(angle.square() + 0.1 * omega.square() + 0.001 * action[:, 0].square())

    def observe(self, state: th.Tensor) -> th.Tensor:
        theta, omega = state.unbind(dim=1)
        return th.stack([theta.cos(), theta.sin(), omega.clamp(-8, 8)], dim=1)

    def state(self, observation: th.Tensor) -> th.Tensor:
        cosine, sine, omega = observation.unbind(dim=1)
        return th.stack([th.atan2(sine, cosine), omega], dim=1)


@validated
class MountainCarTask(Task):
    """
    ``MountainCarContinuous-v0``: state (position, velocity), reward 100 for reaching the flag, minus 0.1 a².

    :param goal_velocity: smallest velocity at the flag
    """

    state_dim = 2
    goal_position = 0.45

    def __init__(self, goal_velocity: Real = 0.0) -> None:
        self.goal_velocity = goal_velocity

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return 100.0 * self.terminated(state, action, next_state) - 0.1 * action[:, 0].square()

    def terminated(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        position, velocity = next_state.unbind(dim=1)
        return (position >= self.goal_position) & (velocity >= self.goal_velocity)
