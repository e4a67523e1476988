"""Real episodes."""

from __future__ import annotations

from typing import Any, Protocol, SupportsFloat

import numpy as np
import numpy.typing as npt
import torch as th

from sb3_hucrl.data import Transitions
from sb3_hucrl.imagination import Array
from sb3_hucrl.loop.actors import Actor
from sb3_hucrl.progress import progress_bar
from sb3_hucrl.tasks.base import Task


class RealSystem(Protocol):
    """The part of gymnasium's interface that real episodes need: any ``gymnasium.Env`` has it."""

    def reset(self) -> tuple[Any, dict[str, Any]]:
        """
        :return: the first observation of an episode, and infos
        """

    def step(self, action: Array, /) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """
        :param action: (a, a′), of which the system ignores a′
        :return: observation, reward, terminated, truncated, infos
        """


def collect_episode(real: RealSystem, act: Actor, task: Task, action_dim: int) -> Transitions:
    """
    Run one real episode.

    :param real: the real system
    :param act: chooses the actions
    :param task: maps observations to states
    :param action_dim: q; the hallucinated part a′ that follows in an action is not stored
    :return: the episode's transitions, in order
    :raises ValueError: if an observation or a reward is not finite
    """
    observation, _ = real.reset()
    observations = [_finite("observation", observation, 0)]
    actions: list[Array] = []
    rewards: list[float] = []
    done = terminated = False
    with progress_bar(None, "real episode") as bar:
        while not done:
            action = act(observation, not actions)
            observation, reward, terminated, truncated, _ = real.step(action)
            done = terminated or truncated
            actions.append(action[:action_dim])
            rewards.append(float(_finite("reward", reward, len(actions))))
            observations.append(_finite("observation", observation, len(actions)))
            bar.update()
    states = task.state(th.as_tensor(np.stack(observations), dtype=th.float32))
    ends = th.zeros(len(actions), dtype=th.bool)
    ends[-1] = bool(terminated)
    returned = th.tensor(rewards, dtype=th.float32)
    return Transitions(
        states=states[:-1],
        actions=th.as_tensor(np.stack(actions), dtype=th.float32),
        next_states=task.record_outcomes(states[1:], returned, ends),
        rewards=returned,
        terminated=ends,
    )


def _finite(name: str, value: npt.ArrayLike | SupportsFloat, step: int) -> npt.NDArray[np.floating[Any]]:
    array = np.asarray(value, dtype=np.float32)
    if not np.isfinite(array).all():
        raise ValueError(f"the real environment returned {name} {array.tolist()} at step {step}: it must be finite")
    return array
