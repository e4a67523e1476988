"""The paper's environments, and twins with room for a′ of all others; :func:`register_envs` tells gymnasium."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from sb3_hucrl.checks import Natural, require_arguments, validated
from sb3_hucrl.envs.twins import follow_registrations, register_twins
from sb3_hucrl.registry import Registry
from sb3_hucrl.tasks.registry import find_task
from sb3_hucrl.wrappers.hallucination import HallucinationWrapper

__all__ = ["ENVIRONMENTS", "MAX_EPISODE_STEPS", "make_env", "register_envs"]


#: the package's environments by gymnasium id
ENVIRONMENTS: Registry[gym.Env[Any, Any]] = Registry(
    "environment",
    {
        "HUCRL-Pendulum-v0": "sb3_hucrl.envs.pendulum:PendulumEnv",
        "HUCRL-CartPole-v0": "sb3_hucrl.envs.cartpole:CartPoleEnv",
        "HUCRL-Reacher-v0": "sb3_hucrl.envs.reacher:ReacherEnv",
        "HUCRL-SparseReacher-v0": "sb3_hucrl.envs.reacher:SparseReacherEnv",
        "HUCRL-Pusher-v0": "sb3_hucrl.envs.pusher:PusherEnv",
        "HUCRL-HalfCheetah-v0": "sb3_hucrl.envs.half_cheetah:HalfCheetahEnv",
    },
)
#: steps after which gymnasium truncates an episode
MAX_EPISODE_STEPS = {
    "HUCRL-Pendulum-v0": 400,
    "HUCRL-CartPole-v0": 200,
    "HUCRL-Reacher-v0": 150,
    "HUCRL-SparseReacher-v0": 150,
    "HUCRL-Pusher-v0": 150,
    "HUCRL-HalfCheetah-v0": 1000,
}


@validated
def make_env(
    env_id: str, hallucinate: bool = True, hallucinated_dim: Natural | None = None, **kwargs: Any
) -> gym.Env[Any, Any]:
    """
    Entry point of all environments of this package.

    :param env_id: registered in :data:`ENVIRONMENTS`
    :param hallucinate: whether the action space includes a′, which the real environment ignores
    :param hallucinated_dim: number of dimensions of a′; by default that of the environment's task
    :param kwargs: arguments of the environment's class
    :raises ValueError: if the id is unknown or an argument is out of range
    """
    require_arguments(kwargs, make_env, ENVIRONMENTS.resolve(env_id), reserved=("env_id",))
    env = ENVIRONMENTS.make(env_id, **kwargs)
    if not hallucinate:
        return env
    if hallucinated_dim is None:
        # gymnasium sets env.spec only after this function, so the wrapper cannot find the task.
        task = find_task(gym.spec(env_id), observation_dim=0)
        assert task is not None  # every environment of the package has one
        hallucinated_dim = task.hallucinated_dim
    return HallucinationWrapper(env, hallucinated_dim)


def register_envs() -> None:
    """
    Register the environments and the twins of all others with gymnasium; a second call changes nothing.

    Importing this package does so, and registering another environment gives it its twin. A script calls it again only
    if it imported gymnasium's ``register`` by name before this package, and registered an environment after it.
    """
    for env_id, max_episode_steps in MAX_EPISODE_STEPS.items():
        if env_id not in gym.registry:
            gym.register(
                env_id,
                entry_point="sb3_hucrl.envs:make_env",
                max_episode_steps=max_episode_steps,
                kwargs={"env_id": env_id},
            )
    register_twins()
    follow_registrations()
