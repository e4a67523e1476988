"""Who acts in an episode: chance, the policy, or a planner."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import torch as th
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.planning import MPCPolicy

Array = npt.NDArray[np.float32]
#: maps an observation, and whether it is an episode's first, to an action (a, a′)
Actor = Callable[[Array, bool], Array]
#: maps observations of all trajectories, and whether each is a trajectory's first, to actions (a, a′)
BatchActor = Callable[[Array, npt.NDArray[np.bool_]], Array]


def random_actor(action_space: spaces.Box, generator: th.Generator) -> Actor:
    """
    :param action_space: of (a, a′)
    :param generator: draws the actions, on the CPU
    :return: acts uniformly at random
    """
    low, high = th.as_tensor(action_space.low), th.as_tensor(action_space.high)

    def act(observation: Array, first: bool) -> Array:
        return (low + th.rand(low.shape, generator=generator) * (high - low)).numpy()

    return act


def policy_actor(model: BaseAlgorithm, deterministic: bool) -> BatchActor:
    """
    :param model: SB3 algorithm; recurrent policies and normalised observations are taken care of
    :param deterministic: whether to play the policy's mode, or to sample it
    :return: acts for a batch, which keeps its size until a new actor is made
    """
    normalizer = model.get_vec_normalize_env()
    memory: tuple[np.ndarray, ...] | None = None

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
    proposal = None

    def act(observations: Array, first: npt.NDArray[np.bool_]) -> Array:
        nonlocal proposal
        actions, proposal = planner.predict(observations, proposal, first)
        return actions

    return act


def one_by_one(act: BatchActor) -> Actor:
    """
    :param act: for a batch
    :return: the same for a batch of one
    """
    return lambda observation, first: act(observation[np.newaxis], np.array([first]))[0]
