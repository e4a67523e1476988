"""Which of the policies found so far plays on the real environment."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.imagination import Imagination
from sb3_hucrl.rollout import Actor, Array

#: maps observations of all trajectories, and whether each is a trajectory's first, to actions (a, a′)
BatchActor = Callable[[Array, npt.NDArray[np.bool_]], Array]


def one_by_one(act: BatchActor) -> Actor:
    """
    :param act: for a batch
    :return: the same for a batch of one
    """
    return lambda observation, first: act(observation[np.newaxis], np.array([first]))[0]


def imagined_return(imagination: Imagination, act: BatchActor) -> float:
    """
    :param imagination: trajectories to begin afresh
    :param act: chooses the actions of all of them
    :return: mean over the trajectories, each up to its first end
    """
    observations = imagination.reset()
    first = np.ones(imagination.num_envs, dtype=np.bool_)
    running = first.copy()
    returns = np.zeros(imagination.num_envs)
    while running.any():
        step = imagination.step(act(observations, first))
        returns[running] += step.rewards[running]
        running &= ~(step.terminated | step.truncated)
        observations, first = step.observations, np.zeros_like(first)
    return float(returns.mean())


class BestPolicy:
    """
    Keeps the best solution of (7) that was found so far, as the latest model sees it.

    Policy search fluctuates: what it ends with may be worse than what it began with. Both are judged on the same,
    newest model, so that a policy that only exploited an earlier model's mistakes is not kept.
    """

    def __init__(self) -> None:
        self._parameters: Mapping[str, Any] | None = None

    def choose(self, model: BaseAlgorithm, evaluate: Callable[[], float]) -> float:
        """
        Give the model's policy back the parameters of the last chosen one, unless the new ones are at least as good.

        :param model: at the end of a search
        :param evaluate: return of the model's policy on the newest dynamics
        :return: that of the chosen one
        """
        found = copy.deepcopy(model.policy.state_dict())
        value = evaluate()
        if self._parameters is not None:
            model.policy.load_state_dict(self._parameters)
            kept_value = evaluate()
            if kept_value > value:
                return kept_value
            model.policy.load_state_dict(found)
        self._parameters = found
        return value
