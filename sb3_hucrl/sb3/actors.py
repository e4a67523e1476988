"""SB3 policies and planners as actors of imagined and real episodes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.imagination import Array, BatchActor
from sb3_hucrl.planning import MPCPolicy


def policy_actor(model: BaseAlgorithm, deterministic: bool) -> BatchActor:
    """
    :param model: SB3 algorithm; recurrent policies and normalised observations are taken care of
    :param deterministic: whether to play the policy's mode, or to sample it
    :return: acts for a batch, which keeps its size until a new actor is made
    """
    normalizer = model.get_vec_normalize_env()
    memory: tuple[npt.NDArray[Any], ...] | None = None

    def act(observations: Array, first: npt.NDArray[np.bool_]) -> Array:
        nonlocal memory
        inputs = observations if normalizer is None else normalizer.normalize_obs(observations)
        actions, memory = model.predict(inputs, state=memory, episode_start=first, deterministic=deterministic)
        return actions

    return act


def planner_actor(planner: MPCPolicy) -> BatchActor:
    """
    :param planner: sees observations as the environment gives them
    :return: acts for a batch, which keeps its size until a new actor is made
    """
    proposal: Any = None

    def act(observations: Array, first: npt.NDArray[np.bool_]) -> Array:
        nonlocal proposal
        actions, proposal = planner.predict(observations, proposal, first)
        return actions

    return act
