"""Tasks of gymnasium's MuJoCo environments whose reward is a function of the observation."""

from __future__ import annotations

import math

import torch as th

from sb3_hucrl.checks import Real, validated
from sb3_hucrl.tasks.arm_kinematics import hand_position
from sb3_hucrl.tasks.base import Task
from sb3_hucrl.tasks.pusher import BASE as PUSHER_BASE


class InvertedPendulumTask(Task):
    """``InvertedPendulum-v5``: state (x, θ, ẋ, θ̇), reward 1 unless the pole tilts beyond 0.2 rad."""

    state_dim = 4

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return (~self.terminated(state, action, next_state)).to(next_state.dtype)

    def terminated(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return next_state[:, 1].abs() > 0.2


@validated
class GymnasiumReacherTask(Task):
    """
    ``Reacher-v5``: state (2 angles, 2 velocities, the fingertip's x and y), context: the target's x and y.

    The fingertip is part of the state because the environment observes and rewards its position in the middle of
    MuJoCo's last step, which cannot be computed from the angles at the end of the step.

    :param reward_dist_weight: weight of the distance between fingertip and target
    :param reward_control_weight: weight of Σ a²
    """

    state_dim = 6
    context_dim = 2
    angle_dims = (0, 1)

    def __init__(self, reward_dist_weight: Real = 1.0, reward_control_weight: Real = 1.0) -> None:
        self.reward_dist_weight = reward_dist_weight
        self.reward_control_weight = reward_control_weight

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        distance: th.Tensor = (next_state[:, 4:6] - next_state[:, 6:]).norm(dim=1)
        return -self.reward_dist_weight * distance - self.reward_control_weight * action.square().sum(dim=1)

    def observe(self, state: th.Tensor) -> th.Tensor:
        angles, velocities, fingertip, target = state.tensor_split([2, 4, 6], dim=1)
        return th.cat([angles.cos(), angles.sin(), target, velocities, fingertip - target], dim=1)

    def state(self, observation: th.Tensor) -> th.Tensor:
        cosines, sines, target, velocities, offset = observation.tensor_split([2, 4, 6, 8], dim=1)
        return th.cat([th.atan2(sines, cosines), velocities, target + offset, target], dim=1)

    def sample_contexts(self, n: int, generator: th.Generator | None) -> th.Tensor:
        """Targets, uniform in a disc of radius 0.2 m."""
        radius, turn = th.rand(2, n, generator=generator)
        radius, angle = 0.2 * radius.sqrt(), 2 * math.pi * turn
        return th.stack([radius * angle.cos(), radius * angle.sin()], dim=1)


@validated
class GymnasiumPusherTask(Task):
    """
    ``Pusher-v5``: state (7 angles, 7 velocities, the object's x and y), context: the object's height, which never
    changes, and the goal position.

    The environment observes and rewards the hand's position one MuJoCo step of 0.01 s before the angles, and so does
    this task.

    :param reward_near_weight: weight of the distance between hand and object
    :param reward_dist_weight: weight of the distance between object and goal
    :param reward_control_weight: weight of Σ a²
    """

    state_dim = 16
    context_dim = 4
    angle_dims = tuple(range(7))

    def __init__(
        self, reward_near_weight: Real = 0.5, reward_dist_weight: Real = 1.0, reward_control_weight: Real = 0.1
    ) -> None:
        self.reward_near_weight = reward_near_weight
        self.reward_dist_weight = reward_dist_weight
        self.reward_control_weight = reward_control_weight

    @staticmethod
    def _hand(state: th.Tensor) -> th.Tensor:
        angles, velocities = state[:, :7], state[:, 7:14]
        return hand_position(angles - 0.01 * velocities, PUSHER_BASE, tool_length=0.0)

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        object_place = next_state[:, 14:17]
        near: th.Tensor = (object_place - self._hand(next_state)).norm(dim=1)
        there: th.Tensor = (object_place - next_state[:, 17:]).norm(dim=1)
        effort = action.square().sum(dim=1)
        return -(self.reward_near_weight * near + self.reward_dist_weight * there + self.reward_control_weight * effort)

    def observe(self, state: th.Tensor) -> th.Tensor:
        return th.cat([state[:, :14], self._hand(state), state[:, 14:]], dim=1)

    def state(self, observation: th.Tensor) -> th.Tensor:
        return th.cat([observation[:, :14], observation[:, 17:]], dim=1)
