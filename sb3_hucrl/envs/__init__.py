"""The paper's environments; importing this registers them with gymnasium."""

from __future__ import annotations

import pkgutil
from dataclasses import dataclass
from typing import Any

import gymnasium as gym

from sb3_hucrl.tasks.registry import find_task
from sb3_hucrl.wrappers.hallucination import HallucinationWrapper

__all__ = ["ENVIRONMENTS", "make_env", "register_envs"]


@dataclass(frozen=True)
class Registration:
    """
    :param entry_point: module:Class, imported when an environment is made
    :param max_episode_steps: after which episodes are truncated
    """

    entry_point: str
    max_episode_steps: int


#: the environments by their gymnasium ids
ENVIRONMENTS = {
    "HUCRL-Pendulum-v0": Registration("sb3_hucrl.envs.pendulum:PendulumEnv", 400),
    "HUCRL-CartPole-v0": Registration("sb3_hucrl.envs.cartpole:CartPoleEnv", 200),
    "HUCRL-Reacher-v0": Registration("sb3_hucrl.envs.reacher:ReacherEnv", 150),
    "HUCRL-SparseReacher-v0": Registration("sb3_hucrl.envs.reacher:SparseReacherEnv", 150),
    "HUCRL-Pusher-v0": Registration("sb3_hucrl.envs.pusher:PusherEnv", 150),
    "HUCRL-HalfCheetah-v0": Registration("sb3_hucrl.envs.half_cheetah:HalfCheetahEnv", 1000),
}


def make_env(
    env_id: str, hallucinate: bool = True, hallucinated_dim: int | None = None, **kwargs: Any
) -> gym.Env[Any, Any]:
    """
    Entry point of all environments of this package.

    :param env_id: a key of :data:`ENVIRONMENTS`
    :param hallucinate: whether the action space has room for a′, which the real environment ignores
    :param hallucinated_dim: dimensions of a′; by default those that the environment's task allows
    :param kwargs: arguments of the environment's class
    """
    env: gym.Env[Any, Any] = pkgutil.resolve_name(ENVIRONMENTS[env_id].entry_point)(**kwargs)
    if not hallucinate:
        return env
    if hallucinated_dim is None:
        # gymnasium attaches the spec only afterwards, so the wrapper cannot look the task up by itself.
        task = find_task(gym.spec(env_id), observation_dim=0)
        assert task is not None  # every environment of the package has one
        hallucinated_dim = task.hallucinated_dim
    return HallucinationWrapper(env, hallucinated_dim)


def register_envs() -> None:
    """Make the environments known to gymnasium; a second call changes nothing."""
    for env_id, registration in ENVIRONMENTS.items():
        if env_id not in gym.registry:
            gym.register(
                env_id,
                entry_point="sb3_hucrl.envs:make_env",
                max_episode_steps=registration.max_episode_steps,
                kwargs={"env_id": env_id},
            )
