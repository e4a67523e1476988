"""The pendulum's true dynamics, for planning without model error."""

from __future__ import annotations

import torch as th

from sb3_hucrl import Prediction
from sb3_hucrl.dynamics import Predictor
from sb3_hucrl.envs.pendulum import FRICTION, GRAVITY, LENGTH, MASS, TIME_STEP


class TruePendulum(Predictor):
    """The dynamics of ``HUCRL-Pendulum-v0``: batched, differentiable and without uncertainty."""

    def __init__(self) -> None:
        super().__init__(state_dim=2, action_dim=1)

    @staticmethod
    def _slope(state: th.Tensor, torque: th.Tensor) -> th.Tensor:
        theta, omega = state.unbind(dim=1)
        turned = (torque[:, 0] - FRICTION * omega) / (MASS * LENGTH**2)
        return th.stack([omega, GRAVITY / LENGTH * theta.sin() + turned], dim=1)

    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        h = TIME_STEP
        k1 = self._slope(state, action)
        k2 = self._slope(state + h / 2 * k1, action)
        k3 = self._slope(state + h / 2 * k2, action)
        k4 = self._slope(state + h * k3, action)
        mean = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return Prediction(mean, th.zeros_like(mean), th.zeros_like(mean))
