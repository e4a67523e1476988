"""Extends the action space of a real environment by the hallucinated action."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import RecordConstructorArgs
from gymnasium.wrappers import ClipAction

from sb3_hucrl.checks import Natural, validated
from sb3_hucrl.spaces import require_action, require_bounded_box, require_vector_observation, widen
from sb3_hucrl.tasks.registry import find_task

Array = npt.NDArray[np.float32]


@validated
class HallucinationWrapper(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """
    Extends the action from a to (a, a′). ``step`` passes only a to the real environment and stores a′ in
    ``info["hallucinated_action"]``. The limits of a are those of the environment, also where ClipAction hides them.

    :param env: environment with continuous actions and vector observations
    :param hallucinated_dim: number of dimensions of a′; by default that of the environment's registered task, or the
        observation's dimension if no task is registered
    :raises ValueError: if the environment has other spaces, or room for a′ already
    """

    def __init__(self, env: gym.Env[Any, Any], hallucinated_dim: Natural | None = None) -> None:
        RecordConstructorArgs.__init__(self, hallucinated_dim=hallucinated_dim)
        super().__init__(env)
        if env.has_wrapper_attr("hallucinated_dim"):
            raise ValueError(
                f"env {env} has room for a′ already, as every environment has whose id begins with HUCRL-: take one of "
                "the two HallucinationWrappers away, or make it with hallucinate=False"
            )
        observation_space = require_vector_observation(env.observation_space)
        action_space = require_bounded_box(_limits(env))
        if hallucinated_dim is None:
            task = find_task(env.unwrapped.spec, observation_space.shape[0])
            hallucinated_dim = observation_space.shape[0] if task is None else task.hallucinated_dim
        self.hallucinated_dim = hallucinated_dim
        self._real_dim = action_space.shape[0]
        self.action_space = widen(action_space, hallucinated_dim)

    @property
    def portable_spec(self) -> EnvSpec | None:
        """
        The specification without functions, such as arguments of a wrapper, which cannot be sent from the processes of
        a SubprocVecEnv.
        """
        spec = self.spec
        if spec is None:
            return None
        wrappers = tuple(replace(each, kwargs=None) for each in spec.additional_wrappers)
        return replace(spec, entry_point=None, vector_entry_point=None, additional_wrappers=wrappers)

    def step(self, action: Array) -> tuple[Array, SupportsFloat, bool, bool, dict[str, Any]]:
        require_action(action, self.action_space)
        observation, reward, terminated, truncated, info = self.env.step(action[: self._real_dim])
        info["hallucinated_action"] = action[self._real_dim :]
        return observation, reward, terminated, truncated, info


def _limits(env: gym.Env[Any, Any]) -> spaces.Space[Any]:
    inner = env
    while isinstance(inner, gym.Wrapper) and not isinstance(inner, gym.ActionWrapper):
        inner = inner.env
    return inner.env.action_space if isinstance(inner, ClipAction) else env.action_space
