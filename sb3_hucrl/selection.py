"""Which of the policies found so far plays on the real environment."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.actors import BatchActor
from sb3_hucrl.imagination import Imagination
from sb3_hucrl.parameters import Parameters


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


def choose_policy(
    model: BaseAlgorithm, kept: Parameters | None, evaluate: Callable[[], float]
) -> tuple[Parameters, float]:
    """
    Give the model the best solution of (7) that was found so far, as the newest dynamics model sees it.

    Policy search fluctuates: what it ends with may be worse than what it began with. Both are judged on the same,
    newest model, so that a policy that only exploited an earlier model's mistakes is not kept.

    :param model: at the end of a search
    :param kept: what was chosen last time, or None at the first time
    :param evaluate: return of the model's policy on the newest dynamics
    :return: what the model has now, and its return; what was found now unless the kept one is better
    """
    found, value = Parameters.of(model), evaluate()
    if kept is not None:
        kept.restore(model)
        kept_value = evaluate()
        if kept_value > value:
            return kept, kept_value
        found.restore(model)
    return found, value
