"""The tasks of the paper's reachers: state (7 angles, 7 velocities), context: the goal position."""

from __future__ import annotations

import torch as th

from sb3_hucrl.checks import NotNegative, validated
from sb3_hucrl.tasks.angles import AngleTask
from sb3_hucrl.tasks.arithmetic import Number, exp
from sb3_hucrl.tasks.arm_kinematics import hand_position

BASE = (0.0, -0.188, 0.0)
#: from the wrist to the gripper's tool point, in m
TOOL_LENGTH = 0.16828
GOAL_MEAN = (0.0, 0.25, 0.0)
GOAL_STD = 0.1


@validated
class ReacherTask(AngleTask):
    """
    Dense reward -‖ee - goal‖² - ρ Σ a² (appendix B.2.3).

    :param action_penalty: ρ, 0 or more
    """

    state_dim = 14
    context_dim = 3
    angle_dims = tuple(range(7))

    def __init__(self, action_penalty: NotNegative = 0.01) -> None:
        super().__init__()
        self.action_penalty = action_penalty

    def reward_formula(self, squared_distance: Number, effort: Number) -> Number:
        """
        The reward of the class's description, also the environment's reward.

        :param squared_distance: ‖ee - goal‖², in m²
        :param effort: Σ a²
        """
        return -squared_distance - self.action_penalty * effort

    def squared_distance(self, state: th.Tensor) -> th.Tensor:
        """
        :param state: shape (B, 17)
        :return: ‖ee - goal‖², in m², shape (B,)
        """
        return (hand_position(state[:, :7], BASE, TOOL_LENGTH) - state[:, 14:]).square().sum(dim=1)

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return self.reward_formula(self.squared_distance(next_state), action.square().sum(dim=1))

    def sample_contexts(self, n: int, generator: th.Generator | None) -> th.Tensor:
        """Goals ~ N((0, 0.25, 0), 0.1²)."""
        return th.tensor(GOAL_MEAN) + GOAL_STD * th.randn(n, 3, generator=generator)


@validated
class SparseReacherTask(ReacherTask):
    """
    Sparse reward exp(-‖ee - goal‖²/0.45²) + ρ (exp(-k Σ a²) - 1) (appendix B.2.5).

    :param action_penalty: ρ, 0 or more
    :param action_scale: k, 0 or more
    """

    def __init__(self, action_penalty: NotNegative = 0.1, action_scale: NotNegative = 1.0) -> None:
        super().__init__(action_penalty)
        self.action_scale = action_scale

    def reward_formula(self, squared_distance: Number, effort: Number) -> Number:
        effortless = exp(-self.action_scale * effort)
        return exp(-squared_distance / 0.45**2) + self.action_penalty * (effortless - 1)
