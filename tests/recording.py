"""What an environment gave and took, written down beside whoever else stores it: the truth of tests of logged data."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np

from sb3_hucrl.logged import LoggedEpisode


@dataclass
class Recorded:
    """One episode; it is over if its last step says so."""

    observations: list[Any]
    actions: list[Any] = field(default_factory=list)
    rewards: list[float] = field(default_factory=list)
    terminated: bool = False
    over: bool = False


class Recorder(gym.Wrapper[Any, Any, Any, Any]):
    """
    :param env: to write down
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.episodes: list[Recorded] = []

    def reset(self, **kwargs: Any) -> tuple[Any, dict[str, Any]]:
        observation, info = super().reset(**kwargs)
        self.episodes.append(Recorded([np.array(observation)]))
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        step = observation, reward, terminated, truncated, _ = super().step(action)
        now = self.episodes[-1]
        now.observations.append(np.array(observation))
        now.actions.append(np.array(action))
        now.rewards.append(float(reward))
        now.terminated, now.over = terminated, terminated or truncated
        return step

    @property
    def played(self) -> list[Recorded]:
        """All episodes with at least one step."""
        return [episode for episode in self.episodes if episode.rewards]


class Drift(gym.Env[Any, Any]):
    """A walk with limits of its own, whose position and last action are observed; it terminates beyond 1."""

    observation_space = gym.spaces.Box(-10.0, 10.0, (2,), np.float32)
    action_space = gym.spaces.Box(np.array([-1.0], np.float32), np.array([3.0], np.float32))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self.position, self.action = float(self.np_random.uniform(-0.5, 0.0)), 0.0
        return self._observation(), {}

    def step(self, action: Any) -> Any:
        self.action = float(action[0])
        self.position += 0.1 * self.action
        return self._observation(), self.position - 0.01 * self.action**2, self.position > 1, False, {}

    def _observation(self) -> Any:
        return np.array([self.position, self.action], dtype=np.float32)


def assert_same(read: list[LoggedEpisode], truth: list[Recorded], rounding: float = 0.0) -> None:
    """What was read of a source is what the environment gave and took, up to a relative rounding of observations."""
    assert [len(each) for each in read] == [len(each.rewards) for each in truth]
    for found, expected in zip(read, truth, strict=True):
        np.testing.assert_allclose(found.observations, np.array(expected.observations, np.float32), rtol=rounding)
        # Scaling to [-1, 1] and back costs a digit.
        np.testing.assert_allclose(found.actions, np.array(expected.actions, np.float32), atol=1e-6)
        np.testing.assert_array_equal(found.rewards, np.array(expected.rewards, np.float32))
        assert found.terminated == expected.terminated
