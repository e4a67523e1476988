"""Who acts in a real episode: chance, or whoever acts for a batch."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch as th
from gymnasium import spaces

from sb3_hucrl.imagination import Array, BatchActor

#: maps an observation, and whether it is an episode's first, to an action (a, a′)
Actor = Callable[[Array, bool], Array]


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


def one_by_one(act: BatchActor) -> Actor:
    """
    :param act: for a batch
    :return: the same for a batch of one
    """
    return lambda observation, first: act(observation[np.newaxis], np.array([first]))[0]
