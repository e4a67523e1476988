"""The stack of vectorised environments that an algorithm trains on."""

from __future__ import annotations

from typing import Any

from gymnasium.envs.registration import EnvSpec
from stable_baselines3.common.vec_env import VecCheckNan, VecEnv, VecMonitor, VecNormalize

from sb3_hucrl.imagination import Array
from sb3_hucrl.loop import ModelSettings, Problem
from sb3_hucrl.wrappers.imagination import ImaginationVecEnv, imagination_layer

#: wrappers above ImaginationVecEnv that real episodes may do without, or that the algorithm itself applies
TRANSPARENT = (VecNormalize, VecMonitor, VecCheckNan)


def find_imagination(env: VecEnv) -> ImaginationVecEnv:
    """
    :param env: what the algorithm trains on
    :return: the ImaginationVecEnv in it
    :raises ValueError: if there is none, or a wrapper above it changes observations or actions
    """
    layer, above = imagination_layer(env)
    if layer is None:
        raise ValueError(
            "HUCRLCallback found no ImaginationVecEnv around the training environments: "
            "give the algorithm env=ImaginationVecEnv(vec_env), in a YAML file "
            "vec_env_wrapper: sb3_hucrl.wrappers.ImaginationVecEnv"
        )
    opaque = [type(wrapper).__name__ for wrapper in above if not isinstance(wrapper, TRANSPARENT)]
    if opaque:
        raise ValueError(
            f"{opaque} wrap ImaginationVecEnv, but real episodes are played below it and would not see them: use "
            "gymnasium wrappers around each environment instead (such as gymnasium.wrappers.FrameStackObservation), "
            f"or only {[wrapper.__name__ for wrapper in TRANSPARENT]} around ImaginationVecEnv"
        )
    return layer


class FirstEnv:
    """
    The first of several vectorised environments, which may live in another process, as a single one. Real episodes are
    played in it; its Monitor, if it has one, records them.

    :param venv: real environments
    """

    def __init__(self, venv: VecEnv) -> None:
        self._venv = venv

    def reset(self) -> tuple[Any, dict[str, Any]]:
        observation, infos = self._venv.env_method("reset", indices=0)[0]
        return observation, infos

    def step(self, action: Array, /) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, infos = self._venv.env_method("step", action, indices=0)[0]
        return observation, reward, terminated, truncated, infos


def read_problem(venv: VecEnv, settings: ModelSettings) -> Problem:
    """
    :param venv: real environments
    :param settings: name the task
    :raises ValueError: as :meth:`sb3_hucrl.loop.Problem.from_spaces`
    """
    spec: EnvSpec | None = venv.get_attr("spec", indices=0)[0]
    name = "hallucinated_dim"
    hallucinated_dim = int(venv.get_attr(name, indices=0)[0]) if venv.has_attr(name) else 0
    return Problem.from_spaces(spec, venv.observation_space, venv.action_space, hallucinated_dim, settings)
