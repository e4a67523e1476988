"""Real episodes."""

from __future__ import annotations

from typing import Any, SupportsFloat

import numpy as np
import numpy.typing as npt
import torch as th
from gymnasium import spaces

from sb3_hucrl.checks import Count, validated
from sb3_hucrl.data import Transitions
from sb3_hucrl.imagination import Array, BatchActor
from sb3_hucrl.imagination.finite import first_not_finite
from sb3_hucrl.loop.problem import Problem
from sb3_hucrl.loop.reality import Reality
from sb3_hucrl.loop.systems import Outcome, RealSystems
from sb3_hucrl.progress import progress_bar
from sb3_hucrl.tasks import Task

#: how far beyond its limits an action may lie, as a fraction of their distance
ACTION_ROUNDING = 1e-5


@validated
class Round:
    """
    Real episodes that are played at once, one in each copy of the real system. All take their steps together, and a
    copy whose episode is over is left alone until the last one is over too.

    :param systems: copies of the real system
    :param problem: the hallucinated part a′ of its actions is not stored
    :param num_episodes: played in as many copies, the first ones; None for all
    :param reality: compares the task with each episode that is over; None for no comparison
    """

    def __init__(
        self,
        systems: RealSystems,
        problem: Problem,
        num_episodes: Count | None = None,
        reality: Reality | None = None,
    ) -> None:
        count = len(systems) if num_episodes is None else num_episodes
        self._systems, self._action_space = systems, problem.action_space
        self._episodes = [_Episode(index, problem, reality) for index in range(count)]

    def play(self, act: BatchActor) -> list[Transitions]:
        """
        Play it, once.

        :param act: chooses the actions of all copies, once for each step. The batch keeps its size, because recurrent
            policies and planners remember something for each row; actions for an episode that is over are dropped
        :return: the episodes, in the order of the copies
        :raises ValueError: if an observation, a reward or an action is not finite or of another shape, an action lies
            beyond its limits, or the task disagrees with what happened
        """
        episodes = self._episodes
        for episode, observation in zip(episodes, self._systems.reset(range(len(episodes))), strict=True):
            episode.begin(observation)
        first = np.ones(len(episodes), dtype=np.bool_)
        with progress_bar(None, "real episode") as bar:
            while running := [index for index, episode in enumerate(episodes) if episode.transitions is None]:
                actions = act(np.stack([episode.observation for episode in episodes]), first)
                _require_actions(actions, len(episodes), self._action_space)
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

    def __init__(self, index: int, problem: Problem, reality: Reality | None) -> None:
        self._index, self._problem, self._reality = index, problem, reality
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
        self._actions.append(action[: self._problem.action_dim])
        self._rewards.append(self._number("reward", reward))
        self._observe(observation)
        if terminated or truncated:
            self.transitions = self._finish(bool(terminated))
        elif len(self._actions) >= self._problem.episode_length:
            raise ValueError(
                f"a real episode has not ended after {len(self._actions)} steps (environment {self._index}), which is "
                "the time limit of its specification: wrap the environment in gymnasium.wrappers.TimeLimit, which ends "
                "it there"
            )

    def _finish(self, terminated: bool) -> Transitions:
        observations = th.as_tensor(np.stack(self._observations), dtype=th.float32)
        actions = th.as_tensor(np.stack(self._actions), dtype=th.float32)
        rewards = th.tensor(self._rewards, dtype=th.float32)
        transitions = transitions_of(self._problem.task, observations, actions, rewards, terminated)
        if self._reality is not None:
            self._reality.check(observations, transitions)
        return transitions

    def _observe(self, observation: Any) -> None:
        self.observation = observation
        space = self._problem.observation_space
        self._observations.append(self._finite("observation", observation, space.shape, "as the observation space"))

    def _number(self, name: str, value: SupportsFloat) -> float:
        # Environments compute rewards from arrays, so that some have shape (1,).
        return float(self._finite(name, np.asarray(value, dtype=np.float32).reshape(-1), (1,), "one number")[0])

    def _finite(
        self, name: str, value: npt.ArrayLike, shape: tuple[int, ...], meaning: str
    ) -> npt.NDArray[np.floating[Any]]:
        # A copy: some environments write every observation into the same array.
        array = np.array(value, dtype=np.float32)
        where = f"at step {len(self._actions)} (environment {self._index})"
        if array.shape != shape:
            raise ValueError(
                f"the real environment returned {name} of shape {array.shape} {where}: it must have shape {shape}, "
                f"{meaning}"
            )
        if broken := first_not_finite(name, array):
            raise ValueError(
                f"the real environment returned {broken} {where}: it must be finite in float32; correct it there"
            )
        return array


def transitions_of(
    task: Task, observations: th.Tensor, actions: th.Tensor, rewards: th.Tensor, terminated: bool
) -> Transitions:
    """
    :param task: of the environment
    :param observations: of an episode, o_0 to o_n, shape (n + 1, observation dimension)
    :param actions: without a′, shape (n, q)
    :param rewards: shape (n,)
    :param terminated: whether it terminated in o_n
    :return: the n transitions
    """
    states = task.state(observations)
    ends = th.zeros(len(actions), dtype=th.bool)
    ends[-1] = terminated
    next_states = task.record_outcomes(states[1:], rewards, ends)
    return Transitions(states[:-1], actions, next_states, rewards, ends)


def _require_actions(actions: Array, count: int, space: spaces.Box) -> None:
    if actions.shape != (count, *space.shape):
        raise ValueError(
            f"the actions have shape {actions.shape}: {count} environments with actions {space} need "
            f"{(count, *space.shape)}"
        )
    slack = ACTION_ROUNDING * (space.high - space.low)
    wrong = ~((space.low - slack <= actions) & (actions <= space.high + slack)).all(axis=1)
    if wrong.any():
        action = actions[int(np.argmax(wrong))].tolist()
        raise ValueError(
            f"the action of a real step is {action}: it must lie from {space.low.tolist()} to {space.high.tolist()}; "
            "clip it, or if it is not finite, lower the learning rate of the policy, which has diverged"
        )
