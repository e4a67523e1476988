"""Who acts in real episodes before there is a policy: chance."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch as th
from gymnasium import spaces

from sb3_hucrl.checks import validated
from sb3_hucrl.imagination import Array, BatchActor


@validated
def random_actor(action_space: spaces.Box, generator: th.Generator) -> BatchActor:
    """
    :param action_space: of (a, a′)
    :param generator: draws the actions, on the CPU
    :return: acts uniformly at random
    """
    low, high = th.as_tensor(action_space.low), th.as_tensor(action_space.high)

    def act(observations: Array, first: npt.NDArray[np.bool_]) -> Array:
        return (low + th.rand((len(observations), *low.shape), generator=generator) * (high - low)).numpy()

    return act
