"""The paper's reachers: state (7 angles, 7 velocities), context: the goal."""

from __future__ import annotations

import torch as th

from sb3_hucrl.tasks.angles import AngleTask
from sb3_hucrl.tasks.arm_kinematics import hand_position

BASE = (0.0, -0.188, 0.0)
#: from the wrist to the gripper's tool point, in m
TOOL_LENGTH = 0.16828
GOAL_MEAN = (0.0, 0.25, 0.0)
GOAL_STD = 0.1


class ReacherTask(AngleTask):
    """
    Reward -‖ee - goal‖² - ρ Σ a² (appendix B.2.3).

    :param action_penalty: ρ
    """

    state_dim = 14
    context_dim = 3
    angle_dims = tuple(range(7))

    def __init__(self, action_penalty: float = 0.01) -> None:
        super().__init__()
        self.action_penalty = action_penalty

    def squared_distance(self, state: th.Tensor) -> th.Tensor:
        """
        :param state: shape (B, 17)
        :return: between tool and goal, in m², shape (B,)
        """
        return (hand_position(state[:, :7], BASE, TOOL_LENGTH) - state[:, 14:]).square().sum(dim=1)

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return -self.squared_distance(next_state) - self.action_penalty * action.square().sum(dim=1)

    def sample_contexts(self, n: int, generator: th.Generator | None) -> th.Tensor:
        """Goals ~ N((0, 0.25, 0), 0.1²)."""
        return th.tensor(GOAL_MEAN) + GOAL_STD * th.randn(n, 3, generator=generator)


class SparseReacherTask(ReacherTask):
    """
    Reward exp(-‖ee - goal‖²/0.45²) + ρ (exp(-k Σ a²) - 1) (appendix B.2.5).

    :param action_penalty: ρ
    :param action_scale: k
    """

    def __init__(self, action_penalty: float = 0.1, action_scale: float = 1.0) -> None:
        super().__init__(action_penalty)
        self.action_scale = action_scale

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        effort = (-self.action_scale * action.square().sum(dim=1)).exp() - 1
        return (-self.squared_distance(next_state) / 0.45**2).exp() + self.action_penalty * effort
