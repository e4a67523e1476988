"""Registers ``Parking-v0``, the example of docs/extending.md: park a cart at a place that changes with each episode."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float32]


class ParkingEnv(gym.Env[Array, Array]):
    """Observation: place, speed, and the place to park at. Action: the acceleration."""

    observation_space = gym.spaces.Box(-np.inf, np.inf, (3,), np.float32)
    action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        self.place, self.speed = 0.0, 0.0
        self.goal = self.np_random.uniform(-2.0, 2.0)
        return self._observation(), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        self.speed += 0.1 * float(action[0])
        self.place += 0.1 * self.speed
        reward = -abs(self.place - self.goal) - 0.1 * float(action[0]) ** 2
        return self._observation(), reward, abs(self.place) > 10, False, {}

    def _observation(self) -> Array:
        return np.array([self.place, self.speed, self.goal], dtype=np.float32)


gym.register("Parking-v0", entry_point=f"{__name__}:ParkingEnv", max_episode_steps=100)
