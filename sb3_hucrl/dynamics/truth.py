"""The environment's own dynamics in place of a model, to tell a failing policy search from a failing model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, cast

import gymnasium as gym
import numpy as np
import numpy.typing as npt
import torch as th
from gymnasium.envs.mujoco import MujocoEnv

from sb3_hucrl.checks import ArgumentError, Count, Natural, validated
from sb3_hucrl.data import TransitionDataset
from sb3_hucrl.dynamics.base import DynamicsModel, FitReport, Prediction
from sb3_hucrl.dynamics.calibration import Calibration
from sb3_hucrl.spaces import require_vector_observation
from sb3_hucrl.tasks.registry import find_task


class SettableEnv(Protocol):
    """An environment whose state can be set, like all environments of this package."""

    def set_state(self, state: npt.ArrayLike) -> npt.NDArray[np.float32]: ...

    def step(
        self, action: npt.NDArray[np.float32]
    ) -> tuple[npt.NDArray[np.float32], float, bool, bool, dict[str, Any]]: ...


@validated
class TrueDynamics(DynamicsModel):
    """
    Predicts without uncertainty by stepping a real environment. There is nothing to fit.

    A policy search that fails with these dynamics needs other hyperparameters, not a better model. Predictions are not
    differentiable, and slow, because each row of a batch is a separate step of the environment.

    :param state_dim: p
    :param action_dim: q, without the hallucinated dimensions
    :param angle_dims: unused
    :param env: id of an environment of this package
    :param generator: unused
    :raises ValueError: if the environment has no ``set_state`` of its own, no task, or another state dimension
    """

    def __init__(
        self,
        state_dim: Count,
        action_dim: Count,
        angle_dims: Sequence[Natural] = (),
        env: str = "",
        generator: th.Generator | None = None,
    ) -> None:
        super().__init__(state_dim, action_dim)
        if not env:
            raise ArgumentError("env", "is missing: give the environment, dynamics_kwargs: {env: HUCRL-Pendulum-v0}")
        self.env_id = env
        self._make()

    def _make(self) -> None:
        made = gym.make(self.env_id)
        self._env = cast("SettableEnv", made.unwrapped)
        # gymnasium's set_state takes MuJoCo's positions and velocities, which are not what is observed.
        settable = hasattr(made.unwrapped, "set_state") and not isinstance(made.unwrapped, MujocoEnv)
        task = find_task(made.spec, require_vector_observation(made.observation_space).shape[0]) if settable else None
        if task is None:
            raise ValueError(
                f"the state of {self.env_id} cannot be set from what is observed: the true dynamics are for the "
                "environments of this package, and others with a task and a method set_state(state)"
            )
        if task.state_dim != self.state_dim:
            raise ValueError(f"{self.env_id} has {task.state_dim} state dimensions, but the model has {self.state_dim}")
        self._task = task

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in ("_env", "_task")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)  # type: ignore[no-untyped-call]  # torch's
        self._make()

    def fit(self, dataset: TransitionDataset, generator: th.Generator) -> FitReport:
        perfect = Calibration.measure(th.zeros(1, self.state_dim), th.ones(1, self.state_dim), th.ones(self.state_dim))
        return FitReport(train_loss=0.0, num_train=len(dataset.train), holdout_nll=float("nan"), calibration=perfect)

    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        rows = []
        for each, act in zip(state.numpy(force=True), action.numpy(force=True), strict=True):
            self._env.set_state(each)
            rows.append(self._env.step(act)[0])
        observations = th.as_tensor(np.stack(rows), device=state.device)
        mean = self._task.state(observations)[:, : self.state_dim]
        return Prediction(mean, th.zeros_like(mean), th.zeros_like(mean))
