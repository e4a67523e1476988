"""Pushing an object to a goal: the paper's task."""

from __future__ import annotations

import torch as th

from sb3_hucrl.tasks.angles import AngleTask
from sb3_hucrl.tasks.arm_kinematics import hand_position

BASE = (0.0, -0.6, 0.0)


class PusherTask(AngleTask):
    """
    State (7 angles, 7 velocities, the object's place), context: the goal's place (appendix B.2.4).

    :param action_penalty: ρ
    """

    state_dim = 17
    context_dim = 3
    angle_dims = tuple(range(7))

    def __init__(self, action_penalty: float = 0.1) -> None:
        super().__init__()
        self.action_penalty = action_penalty

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        thing = next_state[:, 14:17]
        near = (hand_position(next_state[:, :7], BASE, tool_length=0.0) - thing).square().sum(dim=1)
        there = (thing - next_state[:, 17:]).square().sum(dim=1)
        return -0.5 * near - 1.25 * there - self.action_penalty * action.square().sum(dim=1)
