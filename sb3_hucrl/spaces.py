"""Checks of the spaces that hallucination needs; the errors say how to convert other spaces."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

#: where gymnasium's TimeLimit keeps its number of steps; only some specifications of environments have it, too
TIME_LIMIT = "_max_episode_steps"


def require_bounded_box(action_space: spaces.Space[Any]) -> spaces.Box:
    """
    :param action_space: of the real environment, with or without a′
    :return: the same space
    :raises ValueError: unless it is a one-dimensional Box of floats with finite limits, low below high
    """
    if not isinstance(action_space, spaces.Box):
        raise ValueError(
            f"the action space is {action_space}: hallucination needs continuous actions, a one-dimensional Box; "
            "choose an environment that has them, such as MountainCarContinuous-v0 in place of MountainCar-v0, or an "
            "algorithm without a model"
        )
    if len(action_space.shape) != 1 or not np.issubdtype(action_space.dtype, np.floating):
        raise ValueError(
            f"the action space has shape {action_space.shape} and dtype {action_space.dtype}: hallucination needs a "
            "vector of floats; wrap the environment in gymnasium.wrappers.TransformAction, with "
            "lambda a: a.reshape(shape) and a one-dimensional Box of floats"
        )
    if not action_space.is_bounded():
        raise ValueError(
            f"the action space {action_space} is unbounded: give all actions finite limits where it is made, or with "
            "gymnasium.wrappers.TransformAction, a bounded Box and lambda a: a (limits that ClipAction hides are found "
            "by HallucinationWrapper around it)"
        )
    empty = np.flatnonzero(~(action_space.low < action_space.high)).tolist()
    if empty:
        raise ValueError(
            f"the action space {action_space} has low = high in dimensions {empty}: a policy cannot choose there; "
            "leave them out, with gymnasium.wrappers.TransformAction around the environment"
        )
    return action_space


def require_vector_observation(observation_space: spaces.Space[Any]) -> spaces.Box:
    """
    :param observation_space: of the real environment
    :return: the same space
    :raises ValueError: unless it is a one-dimensional Box of floats
    """
    if not isinstance(observation_space, spaces.Box):
        raise ValueError(
            f"the observation space is {observation_space}: a dynamics model needs a vector of floats; "
            "wrap the environment with gymnasium.wrappers.FlattenObservation, and in DtypeObservation(env, np.float32) "
            "if its values are integers, and register that under its own id "
            "(if it has a desired_goal, give task='sb3_hucrl.tasks.GoalTask' with task_kwargs)"
        )
    found = f"the observation space has shape {observation_space.shape} and dtype {observation_space.dtype}"
    if len(observation_space.shape) != 1:
        raise ValueError(
            f"{found}: a dynamics model needs a vector of floats; images are not supported, expose the state instead; "
            "wrap small matrices with gymnasium.wrappers.FlattenObservation"
        )
    if not np.issubdtype(observation_space.dtype, np.floating):
        raise ValueError(
            f"{found}: a dynamics model needs a vector of floats; wrap the environment with "
            "gymnasium.wrappers.DtypeObservation(env, np.float32)"
        )
    return observation_space


def widen(action_space: spaces.Box, hallucinated_dim: int) -> spaces.Box:
    """
    Append the dimensions of a′ to the real action space.

    :param action_space: of the real environment, with q dimensions
    :param hallucinated_dim: number of dimensions of a′, each in [-1, 1]
    :return: a Box of q + hallucinated_dim dimensions
    """
    ones = np.ones(hallucinated_dim, dtype=action_space.low.dtype)
    return spaces.Box(
        np.concatenate([action_space.low, -ones]),
        np.concatenate([action_space.high, ones]),
        dtype=action_space.low.dtype.type,
    )


def require_action(action: npt.ArrayLike, action_space: spaces.Space[Any]) -> None:
    """
    :param action: of a step
    :param action_space: of the environment that takes it
    :raises ValueError: if it has another shape, which numpy might stretch or cut to fit
    """
    if np.shape(action) != action_space.shape:
        raise ValueError(
            f"the action has shape {np.shape(action)}: this environment takes {action_space.shape}; if it comes from a "
            "policy, make the environment with the same hallucinate, hallucinated_dim and HallucinationWrapper as for "
            "its training"
        )


def first_dims(space: spaces.Box, dim: int) -> spaces.Box:
    """
    :param space: of (a, a′)
    :param dim: q, the number of real dimensions
    :return: the space of a
    """
    return spaces.Box(space.low[:dim], space.high[:dim], dtype=space.low.dtype.type)
