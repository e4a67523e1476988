"""The paper's environments; importing this registers them with gymnasium."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from sb3_hucrl.envs.pendulum import PendulumEnv
from sb3_hucrl.wrappers.hallucination import HallucinationWrapper

__all__ = ["PendulumEnv", "make_pendulum", "register_envs"]


def make_pendulum(hallucinate: bool = True, **kwargs: Any) -> gym.Env[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """
    Entry point of ``HUCRL-Pendulum-v0``.

    :param hallucinate: whether the action space has room for a′, which the real pendulum ignores
    :param kwargs: arguments of :class:`PendulumEnv`
    """
    env = PendulumEnv(**kwargs)
    return HallucinationWrapper(env, state_dim=2) if hallucinate else env


def register_envs() -> None:
    """Make the environments known to gymnasium; a second call changes nothing."""
    if "HUCRL-Pendulum-v0" not in gym.registry:
        gym.register("HUCRL-Pendulum-v0", entry_point="sb3_hucrl.envs:make_pendulum", max_episode_steps=400)
