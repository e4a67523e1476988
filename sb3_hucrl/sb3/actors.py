"""SB3 policies and planners as actors of imagined and real episodes."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.vec_env import VecNormalize

from sb3_hucrl.imagination import Array, BatchActor
from sb3_hucrl.planning import MPCPolicy


class PolicyActor:
    """
    A policy that acts for a batch, whose size stays. What is pickled is a copy of the part that acts, without critics
    and optimisers.

    :param predictor: SB3 algorithm, or a policy of its own
    :param normalizer: of its observations, if any
    :param deterministic: whether to play the policy's mode, or to sample it
    """

    def __init__(self, predictor: BaseAlgorithm | BasePolicy, normalizer: VecNormalize | None, deterministic: bool):
        self._predictor, self._normalizer, self._deterministic = predictor, normalizer, deterministic
        self._memory: tuple[npt.NDArray[Any], ...] | None = None

    def __call__(self, observations: Array, first: npt.NDArray[np.bool_]) -> Array:
        inputs = observations if self._normalizer is None else self._normalizer.normalize_obs(observations)
        actions, self._memory = self._predictor.predict(
            inputs, state=self._memory, episode_start=first, deterministic=self._deterministic
        )
        return actions

    def __reduce__(self) -> tuple[Any, ...]:
        predictor = self._predictor
        policy = _acting_part(predictor.policy) if isinstance(predictor, BaseAlgorithm) else predictor
        return PolicyActor, (policy, self._normalizer, self._deterministic)


def _acting_part(policy: BasePolicy) -> BasePolicy:
    actor = getattr(policy, "actor", None)
    part = copy.copy(actor if isinstance(actor, BasePolicy) else policy)
    part.set_training_mode(False)
    vars(part).pop("optimizer", None)
    return part


class PlannerActor:
    """
    A planner that acts for a batch, whose size stays.

    :param planner: sees observations as the environment gives them
    """

    def __init__(self, planner: MPCPolicy) -> None:
        self._planner = planner
        self._proposal: Any = None

    def __call__(self, observations: Array, first: npt.NDArray[np.bool_]) -> Array:
        actions, self._proposal = self._planner.predict(observations, self._proposal, first)
        return actions


def policy_actor(model: BaseAlgorithm, deterministic: bool) -> BatchActor:
    """
    :param model: SB3 algorithm; recurrent policies and normalised observations are taken care of
    :param deterministic: whether to play the policy's mode, or to sample it
    :return: acts for a batch, which keeps its size until a new actor is made
    """
    return PolicyActor(model, model.get_vec_normalize_env(), deterministic)


def planner_actor(planner: MPCPolicy) -> BatchActor:
    """
    :param planner: sees observations as the environment gives them
    :return: acts for a batch, which keeps its size until a new actor is made
    """
    return PlannerActor(planner)
