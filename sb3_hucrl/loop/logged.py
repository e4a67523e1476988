"""Logged episodes against the environment that the training is for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch as th

from sb3_hucrl.checks import validated
from sb3_hucrl.data import Transitions
from sb3_hucrl.logged import LoggedEpisode
from sb3_hucrl.loop.episodes import ACTION_ROUNDING, transitions_of
from sb3_hucrl.loop.problem import Problem
from sb3_hucrl.loop.reality import Reality


@validated
def checked_transitions(problem: Problem, episodes: Sequence[LoggedEpisode]) -> list[Transitions]:
    """
    :param problem: of the environment
    :param episodes: that were logged, at least one
    :return: the transitions of each
    :raises ValueError: if there are none, they have other shapes than those of the environment, an action lies beyond
        its limits, or the task disagrees with what was logged
    """
    if not episodes:
        raise ValueError("the logged data hold no episode: give at least one, or none at all")
    rewards = th.as_tensor(np.concatenate([episode.rewards for episode in episodes]))
    reality = Reality(problem, lambda: rewards, logged=True)
    found = []
    for number, episode in enumerate(episodes, 1):
        _require_shapes(problem, episode, number)
        _require_actions(problem, episode, number)
        observations = th.as_tensor(episode.observations)
        transitions = transitions_of(
            problem.task,
            observations,
            th.as_tensor(episode.actions),
            th.as_tensor(episode.rewards),
            episode.terminated,
        )
        reality.check(observations, transitions)
        found.append(transitions)
    return found


def _require_shapes(problem: Problem, episode: LoggedEpisode, number: int) -> None:
    expected = {"observations": problem.observation_space.shape[0], "actions": problem.action_dim}
    for name, width in expected.items():
        found = getattr(episode, name).shape[1]
        if found != width:
            counted = "with all its wrappers" if name == "observations" else "without the hallucinated a′"
            raise ValueError(
                f"{name} of logged episode {number} have {found} values, and those of this environment {width} "
                f"({counted}): give data that were logged in it"
            )


def _require_actions(problem: Problem, episode: LoggedEpisode, number: int) -> None:
    low, high = (limit[: problem.action_dim] for limit in (problem.action_space.low, problem.action_space.high))
    slack = ACTION_ROUNDING * (high - low)
    wrong = ((episode.actions < low - slack) | (episode.actions > high + slack)).any(axis=1)
    if wrong.any():
        step = int(np.argmax(wrong))
        raise ValueError(
            f"the action of step {step} of logged episode {number} is {episode.actions[step].tolist()}: it must lie "
            f"from {low.tolist()} to {high.tolist()}, the limits of this environment; give actions in its own units, "
            "clipped where it clips them"
        )
