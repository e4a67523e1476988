"""``HUCRL-Hopper-v5`` beside ``Hopper-v5``: every registered environment once more, with room for a′."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec, WrapperSpec

from sb3_hucrl.checks import Natural, validated
from sb3_hucrl.tasks.registry import TWIN_PREFIX
from sb3_hucrl.wrappers.hallucination import HallucinationWrapper

__all__ = ["Twin", "UnsupportedEnvironmentError", "follow_registrations", "register_twins"]


class UnsupportedEnvironmentError(ValueError):
    """An environment has spaces for which there is no hallucination."""


@validated
@dataclass(frozen=True)
class Twin:
    """
    Makes an environment with room for a′: the entry point of the id ``HUCRL-X``, where ``X`` is the original's.

    It holds the original's specification and not its id alone, because processes of a SubprocVecEnv have not imported
    the user's package that registered it.

    :param original: specification of the environment without a′
    """

    original: EnvSpec

    @validated
    def __call__(
        self, hallucinate: bool = True, hallucinated_dim: Natural | None = None, **kwargs: Any
    ) -> gym.Env[Any, Any]:
        """
        :param hallucinate: whether the action space includes a′, which the real environment ignores
        :param hallucinated_dim: number of dimensions of a′; by default that of the environment's task, or the
            observation's dimension if no task is registered
        :param kwargs: arguments of the original environment
        :raises UnsupportedEnvironmentError: if the environment has other spaces than vectors of numbers
        """
        env = gym.make(self._inner, **kwargs)
        if not hallucinate:
            return env
        try:
            return HallucinationWrapper(env, hallucinated_dim)
        except ValueError as error:
            env.close()
            raise UnsupportedEnvironmentError(f"there is no {self._inner.id}: {error}") from None

    @property
    def spec(self) -> EnvSpec:
        """What gymnasium's registry has under the twin's id."""
        return replace(
            self.original,
            id=TWIN_PREFIX + self.original.id,
            entry_point=self,
            max_episode_steps=None if self._wrappers else self.original.max_episode_steps,
            additional_wrappers=(),
            vector_entry_point=None,
        )

    @property
    def _wrappers(self) -> tuple[WrapperSpec, ...]:
        return self.original.additional_wrappers

    @property
    def _inner(self) -> EnvSpec:
        # gymnasium checks the environment, enforces the order of calls and limits the time around the twin. Only under
        # wrappers that were registered with the environment the time limit stays where it was: they may repeat actions.
        return replace(
            self.original,
            id=TWIN_PREFIX + self.original.id,
            max_episode_steps=self.original.max_episode_steps if self._wrappers else None,
            order_enforce=False,
            disable_env_checker=True,
        )


def register_twins() -> None:
    """Give each registered environment its twin, unless something else has its id; a second call changes nothing."""
    registry = gym.registry
    twins = {env_id: spec.entry_point for env_id, spec in registry.items() if isinstance(spec.entry_point, Twin)}
    for env_id, twin in twins.items():
        if registry.get(twin.original.id) is not twin.original:
            del registry[env_id]  # the original was replaced or removed
    originals = [spec for env_id, spec in registry.items() if env_id not in twins]
    names = {(spec.namespace, spec.name) for spec in originals if spec.id.startswith(TWIN_PREFIX)}
    for original in originals:
        twin_id = TWIN_PREFIX + original.id
        if original.id.startswith(TWIN_PREFIX) or original.entry_point is None or twin_id in registry:
            continue
        spec = Twin(original).spec
        if (spec.namespace, spec.name) in names:
            # Or gymnasium would warn that HUCRL-Pendulum-v0 is out of date, because there is HUCRL-Pendulum-v1.
            spec.name, spec.version = spec.id, None
        # gymnasium's register would compare each with all others.
        registry[twin_id] = spec


def _remove_twins() -> None:
    for env_id in [env_id for env_id, spec in gym.registry.items() if isinstance(spec.entry_point, Twin)]:
        del gym.registry[env_id]


@functools.cache
def follow_registrations() -> None:
    """Let gymnasium's ``register`` make the twin as well; a second call changes nothing."""
    original = gym.register

    @functools.wraps(original)
    def register(id: str, *args: Any, **kwargs: Any) -> None:
        if id.startswith(TWIN_PREFIX):
            # An environment of the user's own is in no conflict with ours.
            _remove_twins()
        try:
            original(id, *args, **kwargs)
        finally:
            register_twins()

    for module in (gym, gym.envs, gym.envs.registration):
        vars(module)["register"] = register
