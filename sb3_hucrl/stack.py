"""Finding one's way through an algorithm's stack of vectorised environments."""

from __future__ import annotations

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import VecCheckNan, VecEnv, VecEnvWrapper, VecMonitor, VecNormalize

from sb3_hucrl.wrappers.imagination import ImaginationVecEnv

TRANSPARENT = (VecNormalize, VecMonitor, VecCheckNan)


def find_imagination(env: VecEnv) -> ImaginationVecEnv:
    """
    :param env: what the algorithm trains on
    :return: the ImaginationVecEnv in it
    :raises ValueError: if there is none, or a wrapper above it changes observations in a way that real episodes,
        which are played below it, would miss
    """
    layer = env
    above: list[VecEnvWrapper] = []
    while isinstance(layer, VecEnvWrapper) and not isinstance(layer, ImaginationVecEnv):
        above.append(layer)
        layer = layer.venv
    if not isinstance(layer, ImaginationVecEnv):
        raise ValueError(
            "HUCRLCallback found no ImaginationVecEnv around the training environments: "
            "give the algorithm env=ImaginationVecEnv(vec_env), in a YAML file "
            "vec_env_wrapper: sb3_hucrl.wrappers.ImaginationVecEnv"
        )
    opaque = [type(wrapper).__name__ for wrapper in above if not isinstance(wrapper, TRANSPARENT)]
    if opaque:
        raise ValueError(
            f"{opaque} wrap ImaginationVecEnv, but real episodes are played below it and would not see them: put them "
            f"inside, or use only {[wrapper.__name__ for wrapper in TRANSPARENT]} around it"
        )
    return layer


def restart_trajectories(model: BaseAlgorithm) -> None:
    """
    Begin all of an algorithm's trajectories afresh, between two of its rollouts.

    :param model: any SB3 algorithm; what it remembers of the last step is replaced
    """
    env = model.get_env()
    assert env is not None  # an algorithm in training has one
    model._last_obs = env.reset()  # type: ignore[assignment]  # SB3 leaves out dictionary observations here
    model._last_episode_starts = np.ones((env.num_envs,), dtype=bool)
    if isinstance(model, OffPolicyAlgorithm) and model._vec_normalize_env is not None:
        model._last_original_obs = model._vec_normalize_env.get_original_obs()
    if isinstance(model, OnPolicyAlgorithm):
        model.rollout_buffer.reset()
