"""The learned model as a plain gymnasium environment."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from sb3_hucrl.dynamics.base import Predictor
from sb3_hucrl.exploration import ExplorationStrategy
from sb3_hucrl.imagination import Imagination
from sb3_hucrl.spaces import require_bounded_box, require_vector_observation, widen
from sb3_hucrl.starts import StartStates
from sb3_hucrl.tasks.base import Task

Array = npt.NDArray[np.float32]


class LearnedModelEnv(gym.Env[Any, Any]):
    """
    One imagined trajectory at a time: the same imagination as :class:`ImaginationVecEnv`, for other libraries and for
    looking at it.

    :param model: the learned dynamics, or a sample of it
    :param strategy: turns prediction and a′ into the next state
    :param task: known reward, termination and observation
    :param horizon: steps after which a trajectory is truncated
    :param starts: where trajectories begin
    :param observation_space: of the real environment
    :param action_space: of the real environment; this one adds the strategy's hallucinated dimensions
    :raises ValueError: if these do not fit together
    """

    def __init__(
        self,
        model: Predictor,
        strategy: ExplorationStrategy,
        task: Task,
        horizon: int,
        starts: StartStates,
        observation_space: spaces.Space,
        action_space: spaces.Space,
    ) -> None:
        self.observation_space = require_vector_observation(observation_space)
        action_box = widen(require_bounded_box(action_space), strategy.hallucinated_dim(task.hallucinated_dim))
        self.action_space = action_box
        self._imagination = Imagination(model, strategy, task, starts, horizon, 1, action_box, seed=0)
        self._seeded = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        if seed is not None or not self._seeded:
            self._imagination.seed(int(self.np_random.integers(2**31)))
            self._seeded = True
        return self._imagination.reset()[0], {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        step = self._imagination.step(action[np.newaxis])
        terminated, truncated = bool(step.terminated[0]), bool(step.truncated[0])
        return step.observations[0], float(step.rewards[0]), terminated, truncated and not terminated, {}
