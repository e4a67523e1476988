"""The task of the paper's half-cheetah."""

from __future__ import annotations

import math

import torch as th

from sb3_hucrl.checks import NotNegative, validated
from sb3_hucrl.tasks.angles import AngleTask
from sb3_hucrl.tasks.arithmetic import Number, clamp

MAX_REWARDED_SPEED = 10.0


@validated
class HalfCheetahTask(AngleTask):
    """
    State (height, 7 angles, 9 velocities) (appendix B.2.6).

    :param action_penalty: ρ, 0 or more
    """

    state_dim = 17
    angle_dims = tuple(range(1, 8))

    def __init__(self, action_penalty: NotNegative = 0.1) -> None:
        super().__init__()
        self.action_penalty = action_penalty

    def reward_formula(self, speed: Number, effort: Number) -> Number:
        """
        min(v, 10) - ρ Σ a², also the environment's reward.

        :param speed: v, forward velocity after the step, in m/s
        :param effort: Σ a²
        """
        return clamp(speed, -math.inf, MAX_REWARDED_SPEED) - self.action_penalty * effort

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return self.reward_formula(next_state[:, 8], action.square().sum(dim=1))
