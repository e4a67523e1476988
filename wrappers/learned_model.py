"""A learned world as a plain gymnasium environment."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from sb3_hucrl.checks import validated
from sb3_hucrl.imagination import Array, World
from sb3_hucrl.spaces import require_action, require_vector_observation


@validated
class LearnedModelEnv(gym.Env[Any, Any]):
    """
    One imagined trajectory at a time: the same imagination as :class:`ImaginationVecEnv`, for other libraries and for
    looking at it.

    :param world: to imagine
    :param observation_space: of the real environment
    :raises ValueError: if observations are not vectors
    """

    def __init__(self, world: World, observation_space: spaces.Space[Any]) -> None:
        self.observation_space = require_vector_observation(observation_space)
        self.action_space = world.action_space
        self._trajectory = world.trajectories(1, seed=0)
        self._seeded = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        if seed is not None or not self._seeded:
            self._trajectory.seed(int(self.np_random.integers(2**31)))
            self._seeded = True
        return self._trajectory.reset()[0], {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        require_action(action, self.action_space)
        step = self._trajectory.step(action[np.newaxis])
        terminated, truncated = bool(step.terminated[0]), bool(step.truncated[0])
        return step.observations[0], float(step.rewards[0]), terminated, truncated and not terminated, {}
