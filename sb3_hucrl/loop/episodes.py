"""Real episodes."""

from __future__ import annotations

from typing import Any, SupportsFloat

import numpy as np
import numpy.typing as npt
import torch as th

from sb3_hucrl.data import Transitions
from sb3_hucrl.imagination import Array, BatchActor
from sb3_hucrl.loop.systems import Outcome, RealSystems
from sb3_hucrl.progress import progress_bar
from sb3_hucrl.tasks.base import Task


class Round:
    """
    Real episodes that are played at once, one in each copy of the real system. All take their steps together, and a
    copy whose episode is over is left alone until the last one is over too.

    :param systems: copies of the real system
    :param task: maps observations to states
    :param action_dim: q; the hallucinated part a′ that follows in an action is not stored
    :param num_episodes: played in as many copies, the first ones; None for all
    """

    def __init__(self, systems: RealSystems, task: Task, action_dim: int, num_episodes: int | None = None) -> None:
        count = len(systems) if num_episodes is None else num_episodes
        self._systems = systems
        self._episodes = [_Episode(index, task, action_dim) for index in range(count)]

    def play(self, act: BatchActor) -> list[Transitions]:
        """
        Play it, once.

        :param act: chooses the actions of all copies, once for each step. The batch keeps its size, because recurrent
            policies and planners remember something for each row; actions for an episode that is over are dropped
        :return: the episodes, in the order of the copies
        :raises ValueError: if an observation or a reward is not finite
        """
        episodes = self._episodes
        for episode, observation in zip(episodes, self._systems.reset(range(len(episodes))), strict=True):
            episode.begin(observation)
        first = np.ones(len(episodes), dtype=np.bool_)
        with progress_bar(None, "real episode") as bar:
            while running := [index for index, episode in enumerate(episodes) if episode.transitions is None]:
                actions = act(np.stack([episode.observation for episode in episodes]), first)
                outcomes = self._systems.step(running, actions[running])
                for index, outcome in zip(running, outcomes, strict=True):
                    episodes[index].record(actions[index], outcome)
                first = np.zeros_like(first)
                bar.update(len(running))
        return self.finished()

    def finished(self) -> list[Transitions]:
        """
        :return: the episodes that are over, in the order of the copies: fewer than there are copies where playing was
            interrupted
        """
        return [episode.transitions for episode in self._episodes if episode.transitions is not None]


class _Episode:
    """One of them, as far as it has been played."""

    def __init__(self, index: int, task: Task, action_dim: int) -> None:
        self._index, self._task, self._action_dim = index, task, action_dim
        self._observations: list[Array] = []
        self._actions: list[Array] = []
        self._rewards: list[float] = []
        #: the latest one, as the system gave it
        self.observation: Any = None
        #: all of them, once it is over
        self.transitions: Transitions | None = None

    def begin(self, observation: Any) -> None:
        self._observe(observation)

    def record(self, action: Array, outcome: Outcome) -> None:
        observation, reward, terminated, truncated, _ = outcome
        self._actions.append(action[: self._action_dim])
        self._rewards.append(float(self._finite("reward", reward)))
        self._observe(observation)
        if terminated or truncated:
            self.transitions = self._finish(bool(terminated))

    def _finish(self, terminated: bool) -> Transitions:
        states = self._task.state(th.as_tensor(np.stack(self._observations), dtype=th.float32))
        ends = th.zeros(len(self._actions), dtype=th.bool)
        ends[-1] = terminated
        rewards = th.tensor(self._rewards, dtype=th.float32)
        return Transitions(
            states=states[:-1],
            actions=th.as_tensor(np.stack(self._actions), dtype=th.float32),
            next_states=self._task.record_outcomes(states[1:], rewards, ends),
            rewards=rewards,
            terminated=ends,
        )

    def _observe(self, observation: Any) -> None:
        self.observation = observation
        self._observations.append(self._finite("observation", observation))

    def _finite(self, name: str, value: npt.ArrayLike | SupportsFloat) -> npt.NDArray[np.floating[Any]]:
        array = np.asarray(value, dtype=np.float32)
        if not np.isfinite(array).all():
            raise ValueError(
                f"the real environment returned {name} {array.tolist()} at step {len(self._actions)} (environment "
                f"{self._index}): it must be finite"
            )
        return array
