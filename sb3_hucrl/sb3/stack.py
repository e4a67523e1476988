"""The stack of vectorised environments that an algorithm trains on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from gymnasium.envs.registration import EnvSpec
from stable_baselines3.common.vec_env import SubprocVecEnv, VecCheckNan, VecEnv, VecMonitor, VecNormalize

from sb3_hucrl.imagination import Array
from sb3_hucrl.loop import ModelSettings, ParallelSystems, Problem, RealSystems
from sb3_hucrl.spaces import TIME_LIMIT
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
            "gymnasium wrappers around each environment instead (such as FlattenObservation(FrameStackObservation(env, "
            f"4))), or only {[wrapper.__name__ for wrapper in TRANSPARENT]} around ImaginationVecEnv"
        )
    return layer


class SingleEnv:
    """
    One of several vectorised environments, which may live in another process, as a single one. A real episode is played
    in it; its Monitor, if it has one, records that. ``VecEnv.step`` would step all environments, and begin another
    episode where one is over.

    :param venv: real environments
    :param index: of the environment
    :param on_monitored: called at the end of each episode with what Monitor says of it
    :raises RuntimeError: in all methods, if the process of the environment has ended
    """

    def __init__(self, venv: VecEnv, index: int, on_monitored: Callable[[Mapping[str, Any]], None]) -> None:
        self._venv, self._index, self._on_monitored = venv, index, on_monitored

    def reset(self) -> tuple[Any, dict[str, Any]]:
        observation, infos = self._call("reset")
        return observation, infos

    def step(self, action: Array, /) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, infos = self._call("step", action)
        if (terminated or truncated) and "episode" in infos:
            self._on_monitored(infos["episode"])
        return observation, reward, terminated, truncated, infos

    def set_wrapper_attr(self, name: str, value: Any) -> None:
        self._call("set_wrapper_attr", name, value)

    def _call(self, method: str, *arguments: Any) -> Any:
        try:
            return self._venv.env_method(method, *arguments, indices=self._index)[0]
        except (EOFError, ConnectionError) as error:
            raise RuntimeError(
                f"the process of environment {self._index} ended during {method}(): the error that ended it is printed "
                "above, if it was one; train with DummyVecEnv (without --vec-env subproc) to see it here"
            ) from error


def real_systems(venv: VecEnv, on_monitored: Callable[[Mapping[str, Any]], None] = lambda episode: None) -> RealSystems:
    """
    :param venv: real environments
    :param on_monitored: called at the end of each episode with what Monitor says of it
    :return: the same as single ones, which are called at the same time if they live in the processes of a
        SubprocVecEnv, and otherwise one after another
    """
    single = [SingleEnv(venv, index, on_monitored) for index in range(venv.num_envs)]
    # Each process has a pipe of its own, so that a thread can wait for each. What lives in this process may draw from
    # numpy's global generator, or insist on its thread.
    return ParallelSystems(single) if isinstance(venv, SubprocVecEnv) else RealSystems(single)


def read_spec(venv: VecEnv) -> EnvSpec | None:
    """
    :param venv: real environments
    :return: specification of the first one, with its time limit; None where it was made from its class
    """
    # A process that cannot send what it is asked for ends.
    name = "portable_spec" if isinstance(venv, SubprocVecEnv) and venv.has_attr("portable_spec") else "spec"
    spec: EnvSpec | None = venv.get_attr(name, indices=0)[0]
    time_limit = _number(venv, TIME_LIMIT)
    return spec if spec is None or time_limit is None else replace(spec, max_episode_steps=time_limit)


def read_problem(venv: VecEnv, settings: ModelSettings) -> Problem:
    """
    :param venv: real environments
    :param settings: name the task
    :raises ValueError: as :meth:`sb3_hucrl.loop.Problem.from_spaces`
    """
    hallucinated_dim = _number(venv, "hallucinated_dim") or 0
    time_limit = _number(venv, TIME_LIMIT)
    return Problem.from_spaces(
        read_spec(venv), venv.observation_space, venv.action_space, hallucinated_dim, settings, time_limit
    )


def _number(venv: VecEnv, name: str) -> int | None:
    return int(venv.get_attr(name, indices=0)[0]) if venv.has_attr(name) else None
