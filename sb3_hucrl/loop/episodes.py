"""Real episodes."""

from __future__ import annotations

from dataclasses import dataclass
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
from sb3_hucrl.progress import begin_phase
from sb3_hucrl.tasks import Task

#: how far beyond its limits an action may lie, as a fraction of their distance
ACTION_ROUNDING = 1e-5


@dataclass(frozen=True)
class Part:
    """
    What was played of a real episode since its last part.

    :param transitions: at least one
    :param is_last: whether the episode is over
    """

    transitions: Transitions
    is_last: bool


@validated
class Round:
    """
    Real episodes that are played at once, one in each copy of the real system. All take their steps together, and a
    copy whose episode is over is left alone until the last one is over too. They can be played in parts.

    :param systems: copies of the real system
    :param problem: the hallucinated part a′ of its actions is not stored
    :param num_episodes: played in as many copies, the first ones; None for all
    :param reality: compares the task with each episode that is over; None for no comparison
    :param time_limit: after which the systems end an episode, in steps; None for that of the problem
    """

    def __init__(
        self,
        systems: RealSystems,
        problem: Problem,
        num_episodes: Count | None = None,
        reality: Reality | None = None,
        time_limit: Count | None = None,
    ) -> None:
        count = len(systems) if num_episodes is None else num_episodes
        self._systems, self._action_space = systems, problem.action_space
        self.time_limit, self._begun = time_limit or problem.episode_length, False
        self._episodes = [
            EpisodeRecorder(f"environment {index}", problem, self.time_limit, reality) for index in range(count)
        ]

    def play(self, act: BatchActor, label: str = "real episode", steps: Count | None = None) -> list[Transitions]:
        """
        Play it, once, or go on with it.

        :param act: chooses the actions of all copies, once for each step. The batch keeps its size, because recurrent
            policies and planners remember something for each row, from here on; actions for an episode that is over
            are dropped
        :param label: of the progress bar
        :param steps: after which to stop at the latest; None for the end of all episodes
        :return: the episodes that are over, in the order of the copies
        :raises ValueError: if an observation, a reward or an action is not finite or of another shape, an action lies
            beyond its limits, or the task disagrees with what happened
        """
        episodes = self._episodes
        if not self._begun:
            for episode, observation in zip(episodes, self._systems.reset(range(len(episodes))), strict=True):
                episode.begin(observation)
            self._begun = True
        first = np.ones(len(episodes), dtype=np.bool_)
        most = self.time_limit if steps is None else steps
        advance = begin_phase(label, most)
        for _ in range(most):
            running = [index for index, episode in enumerate(episodes) if episode.transitions is None]
            if not running:
                break
            actions = act(np.stack([episode.observation for episode in episodes]), first)
            require_actions(actions, len(episodes), self._action_space)
            outcomes = self._systems.step(running, actions[running])
            for index, outcome in zip(running, outcomes, strict=True):
                episodes[index].record(actions[index], outcome)
            first = np.zeros_like(first)
            advance(1)
        return self.finished()

    def finished(self) -> list[Transitions]:
        """
        :return: the episodes that are over, in the order of the copies: fewer than there are copies where playing was
            interrupted
        """
        return [episode.transitions for episode in self._episodes if episode.transitions is not None]

    @property
    def is_over(self) -> bool:
        """Whether all episodes are over."""
        return len(self.finished()) == len(self._episodes)

    def take(self, whole: bool) -> list[Part]:
        """
        :param whole: whether to leave out episodes that are not over
        :return: of each episode what was played since the last call, if anything was
        """
        taken = [episode for episode in self._episodes if episode.transitions is not None or not whole]
        parts = [episode.take_part() for episode in taken]
        return [part for part in parts if len(part.transitions)]


class EpisodeRecorder:
    """
    One real episode, as far as it has been played.

    :param where: it is played, for error messages
    :param problem: the hallucinated part a′ of its actions is not stored
    :param time_limit: after which it ends, in steps
    :param reality: compares the task with the episode when it is over; None for no comparison
    """

    def __init__(self, where: str, problem: Problem, time_limit: int, reality: Reality | None) -> None:
        self._where, self._problem, self._time_limit, self._reality = where, problem, time_limit, reality
        self._observations: list[Array] = []
        self._actions: list[Array] = []
        self._rewards: list[float] = []
        #: the latest one, as the system gave it
        self.observation: Any = None
        #: all of them, once it is over
        self.transitions: Transitions | None = None
        self._taken = 0

    def begin(self, observation: Any) -> None:
        """
        :param observation: the first one
        :raises ValueError: if it is not finite or of another shape
        """
        self._observe(observation)

    def record(self, action: Array, outcome: Outcome) -> None:
        """
        :param action: of a step, with or without a′
        :param outcome: of it
        :raises ValueError: as :meth:`Round.play`
        """
        observation, reward, terminated, truncated, _ = outcome
        self._actions.append(action[: self._problem.action_dim])
        self._rewards.append(self._number("reward", reward))
        self._observe(observation)
        if terminated or truncated:
            self.transitions = self._finish(bool(terminated))
        elif len(self._actions) >= self._time_limit:
            raise ValueError(
                f"a real episode has not ended after {len(self._actions)} steps ({self._where}), which is its time "
                "limit: wrap the environment in gymnasium.wrappers.TimeLimit, which ends it there"
            )

    def take_part(self) -> Part:
        """
        :return: what was played since the last call; nothing if no step was
        """
        whole = self._so_far(terminated=False) if self.transitions is None else self.transitions
        part = whole[self._taken :]
        self._taken = len(whole)
        return Part(part, is_last=self.transitions is not None)

    def _finish(self, terminated: bool) -> Transitions:
        transitions = self._so_far(terminated)
        if self._reality is not None:
            self._reality.check(th.as_tensor(np.stack(self._observations), dtype=th.float32), transitions)
        return transitions

    def _so_far(self, terminated: bool) -> Transitions:
        observations = th.as_tensor(np.stack(self._observations), dtype=th.float32)
        actions = th.as_tensor(np.stack(self._actions), dtype=th.float32)
        rewards = th.tensor(self._rewards, dtype=th.float32)
        return transitions_of(self._problem.task, observations, actions, rewards, terminated)

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
        where = f"at step {len(self._actions)} ({self._where})"
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


def require_actions(actions: Array, count: int, space: spaces.Box) -> None:
    """
    :param actions: of one step each
    :param count: how many there must be
    :param space: that they must be in, up to rounding
    :raises ValueError: if one is not, or the shape is another
    """
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
