"""The paper's half-cheetah."""

from __future__ import annotations

import torch as th

from sb3_hucrl.tasks.angles import AngleTask


class HalfCheetahTask(AngleTask):
    """
    State (height, 7 angles, 9 velocities); reward min(v, 10) - ρ Σ a² of the next state (appendix B.2.6).

    :param action_penalty: ρ
    """

    state_dim = 17
    angle_dims = tuple(range(1, 8))

    def __init__(self, action_penalty: float = 0.1) -> None:
        super().__init__()
        self.action_penalty = action_penalty

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return next_state[:, 8].clamp(max=10.0) - self.action_penalty * action.square().sum(dim=1)
