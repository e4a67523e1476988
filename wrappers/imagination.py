"""The learned model in place of the real environments, for any SB3 algorithm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch as th
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from sb3_hucrl.dynamics.base import Predictor
from sb3_hucrl.exploration import ExplorationStrategy
from sb3_hucrl.imagination import Imagination
from sb3_hucrl.spaces import require_bounded_box, require_vector_observation
from sb3_hucrl.starts import StartStates
from sb3_hucrl.tasks.base import Task


class ImaginationVecEnv(VecEnvWrapper):
    """
    Passes everything through to the real environments, until :meth:`imagine` puts the learned model in their place.

    In imagination one step is one batched model call for all environments. The end of the horizon is a truncation
    (``TimeLimit.truncated``), an end of the task a termination; both restart the trajectory, and the infos carry
    ``terminal_observation`` and ``episode`` as SB3 expects them.

    :param venv: real environments, wrapped in :class:`HallucinationWrapper` if the exploration strategy hallucinates
    :raises ValueError: if actions are not bounded and continuous, or observations are not vectors
    """

    def __init__(self, venv: VecEnv) -> None:
        super().__init__(venv)
        self._action_box = require_bounded_box(venv.action_space)
        require_vector_observation(venv.observation_space)
        self._imagination: Imagination | None = None
        self._actions = np.empty(0, dtype=np.float32)

    @property
    def imagination(self) -> Imagination | None:
        """The imagined trajectories, or None while the environments are the real ones."""
        return self._imagination

    def imagine(
        self,
        model: Predictor,
        strategy: ExplorationStrategy,
        task: Task,
        horizon: int,
        starts: StartStates,
        seed: int = 0,
        max_epistemic_std: th.Tensor | None = None,
    ) -> Imagination:
        """
        Switch into imagination; call ``reset()`` next.

        :param model: the learned dynamics, or a sample of it
        :param strategy: turns prediction and a′ into the next state
        :param task: known reward, termination and observation
        :param horizon: steps after which an imagined trajectory is truncated
        :param starts: where imagined trajectories begin
        :param seed: of the imagined noise and start states
        :param max_epistemic_std: trajectories are truncated where any dimension is more uncertain than this, shape (p,)
        :return: the imagined trajectories, with their statistics
        :raises ValueError: if these do not fit together, or to the action space
        """
        self._imagination = Imagination(
            model, strategy, task, starts, horizon, self.num_envs, self._action_box, seed, max_epistemic_std
        )
        return self._imagination

    def real(self) -> None:
        """Switch back to the real environments; call ``reset()`` next."""
        self._imagination = None

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        if self._imagination is not None and seed is not None:
            self._imagination.seed(seed)
        return super().seed(seed)

    def reset(self) -> VecEnvObs:
        if self._imagination is None:
            observations = self.venv.reset()
            self.reset_infos = self.venv.reset_infos
            return observations
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return self._imagination.reset()

    def step_async(self, actions: np.ndarray) -> None:
        if self._imagination is None:
            self.venv.step_async(actions)
        else:
            self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        imagination = self._imagination
        if imagination is None:
            results = self.venv.step_wait()
            self.reset_infos = self.venv.reset_infos
            return results
        step = imagination.step(self._actions)
        observations, dones = step.observations, step.terminated | step.truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        finished = np.flatnonzero(dones)
        if len(finished):
            for index in finished:
                infos[index] = {
                    "terminal_observation": observations[index],
                    "TimeLimit.truncated": bool(step.truncated[index] and not step.terminated[index]),
                    "episode": {"r": float(imagination.returns[index]), "l": int(imagination.lengths[index])},
                }
            observations = observations.copy()
            observations[finished] = imagination.reset(finished)
        return observations, step.rewards, dones, infos
