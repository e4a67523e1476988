"""Registers ``Pendulum1e-3-v0``, ``Pendulum1e0-v0`` and ``Pendulum1e3-v0``: the same task in other units."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.envs.classic_control import PendulumEnv
from gymnasium.wrappers import TransformObservation

Array = npt.NDArray[np.float32]

#: exponents of ten by which observations are multiplied
EXPONENTS = (-3, 0, 3)


class ScaledPendulum(TransformObservation[Array, Array, Array]):
    """
    The pendulum of ``Pendulum-v1`` with other units of observation.

    :param factor: that observations are multiplied by
    """

    def __init__(self, factor: float) -> None:
        env = PendulumEnv()
        bounds = (factor * np.array([1, 1, env.max_speed])).astype(np.float32)
        space = gym.spaces.Box(-bounds, bounds, dtype=np.float32)
        super().__init__(env, lambda observation: np.float32(factor) * observation, space)


for exponent in EXPONENTS:
    gym.register(
        f"Pendulum1e{exponent}-v0",
        entry_point=f"{__name__}:ScaledPendulum",
        max_episode_steps=200,
        kwargs={"factor": 10.0**exponent},
    )
