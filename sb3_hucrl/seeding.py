"""Random generators, for runs with and without a seed."""

from __future__ import annotations

import torch as th


def seeded_generator(seed: int | None, device: th.device | str = "cpu") -> th.Generator:
    """
    :param seed: of the run; without one the generator gets a seed from PyTorch's global generator, so that no two
        unseeded runs share their noise
    :param device: of the generator
    """
    if seed is None:
        seed = int(th.randint(2**31, ()))
    return th.Generator(device).manual_seed(seed)
