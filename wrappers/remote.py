"""An environment that is elsewhere."""

from __future__ import annotations

from typing import Any, NoReturn

import gymnasium as gym
from gymnasium import spaces

from sb3_hucrl.checks import Count, validated
from sb3_hucrl.spaces import TIME_LIMIT, require_bounded_box, require_vector_observation


@validated
class RemoteEnv(gym.Env[Any, Any]):
    """
    Stands for a real system that this process cannot step, such as a robot, so that an SB3 algorithm can be made for
    it::

        env_kwargs = dict(observation_space=..., action_space=..., episode_length=500)
        env = make_vec_env(RemoteEnv, n_envs=32, env_kwargs=env_kwargs, wrapper_class=HallucinationWrapper)
        optimizer = AskTell(SAC("MlpPolicy", ImaginationVecEnv(env)), HUCRLCallback(max_real_steps=10_000))

    :param observation_space: a vector of floats
    :param action_space: a bounded vector of floats
    :param episode_length: time limit of a real episode, in steps
    :raises ValueError: if the spaces are others
    """

    def __init__(
        self, observation_space: spaces.Space[Any], action_space: spaces.Space[Any], episode_length: Count
    ) -> None:
        self.observation_space = require_vector_observation(observation_space)
        self.action_space = require_bounded_box(action_space)
        setattr(self, TIME_LIMIT, episode_length)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> NoReturn:
        """
        :raises RuntimeError: always
        """
        self._refuse()

    def step(self, action: Any) -> NoReturn:
        """
        :raises RuntimeError: always
        """
        self._refuse()

    def _refuse(self) -> NoReturn:
        raise RuntimeError(
            "this environment stands for one that is elsewhere, and cannot be played here: use AskTell in place of "
            "learn(), and evaluate policies where the real system is"
        )
