"""Who acts in real episodes before there is a policy: chance."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch as th
from gymnasium import spaces

from sb3_hucrl.checks import Count, validated
from sb3_hucrl.imagination import Array, BatchActor


@validated
def random_actor(action_space: spaces.Box, generator: th.Generator, hold: Count = 1) -> BatchActor:
    """
    Acts at random. Actions that are new in every step cancel out over time, and a car stays in its valley. Those that
    are held for a while, as by Dabney et al. (2021), may get it out.

    :param action_space: of (a, a′)
    :param generator: draws the actions, on the CPU
    :param hold: each action is held for 1 to so many steps, all numbers being equally likely, and not beyond the end of
        an episode. With 1, actions are uniform. With more, each dimension is drawn from twice its range and clipped, so
        that half of all actions are at a bound
    :return: acts so; with ``hold`` it remembers the actions of a batch of environments from step to step
    """
    low, high = th.as_tensor(action_space.low), th.as_tensor(action_space.high)
    held, left = low[None], th.zeros(0, dtype=th.long)

    def uniform(count: int) -> th.Tensor:
        return low + th.rand((count, *low.shape), generator=generator) * (high - low)

    def act(observations: Array, first: npt.NDArray[np.bool_]) -> Array:
        nonlocal held, left
        count = len(observations)
        if hold == 1:
            return uniform(count).numpy()
        if len(left) != count:
            held, left = low.expand(count, *low.shape), th.zeros(count, dtype=th.long)
        ends = (left == 0) | th.as_tensor(first)
        middle = (low + high) / 2
        drawn = (middle + 2 * (uniform(count) - middle)).clamp(low, high)
        held = th.where(ends[:, None], drawn, held)
        left = th.where(ends, th.randint(hold, (count,), generator=generator), left - 1)
        return held.numpy()

    return act
