"""The task of the paper's pusher: pushing an object to a goal."""

from __future__ import annotations

import torch as th

from sb3_hucrl.checks import NotNegative, validated
from sb3_hucrl.tasks.angles import AngleTask
from sb3_hucrl.tasks.arithmetic import Number
from sb3_hucrl.tasks.arm_kinematics import hand_position

BASE = (0.0, -0.6, 0.0)


@validated
class PusherTask(AngleTask):
    """
    State (7 angles, 7 velocities, the object's x and y), context: the object's height, and the goal position. The paper
    has the height in the state (appendix B.2.4). It never changes, as the object slides on a table: a state that
    optimism lifted off the table would have nothing to learn from.

    :param action_penalty: ρ, 0 or more
    """

    state_dim = 16
    context_dim = 4
    angle_dims = tuple(range(7))

    def __init__(self, action_penalty: NotNegative = 0.1) -> None:
        super().__init__()
        self.action_penalty = action_penalty

    def reward_formula(self, hand_to_object: Number, object_to_goal: Number, effort: Number) -> Number:
        """
        -0.5 ‖ee - object‖² - 1.25 ‖object - goal‖² - ρ Σ a², also the environment's reward.

        :param hand_to_object: squared distance, in m²
        :param object_to_goal: squared distance, in m²
        :param effort: Σ a²
        """
        return -0.5 * hand_to_object - 1.25 * object_to_goal - self.action_penalty * effort

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        object_place, goal = next_state[:, 14:17], next_state[:, 17:]
        hand = hand_position(next_state[:, :7], BASE, tool_length=0.0)
        return self.reward_formula(
            (hand - object_place).square().sum(dim=1),
            (object_place - goal).square().sum(dim=1),
            action.square().sum(dim=1),
        )
