"""The real environment, as far as it must be known before anything is learned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec

from sb3_hucrl.checks import Count, validated
from sb3_hucrl.loop.settings import ModelSettings
from sb3_hucrl.spaces import TIME_LIMIT, first_dims, require_bounded_box, require_vector_observation
from sb3_hucrl.tasks import Task, check_task, resolve_task
from sb3_hucrl.tasks.registry import TWIN_PREFIX

#: wrappers that leave observations, actions and rewards as they are
HARMLESS = frozenset(
    [
        "HallucinationWrapper",
        "Monitor",
        "TimeLimit",
        "OrderEnforcing",
        "PassiveEnvChecker",
        "ClipAction",
        "RecordVideo",
        "RecordEpisodeStatistics",
        "Autoreset",
        "HumanRendering",
        "RenderCollection",
    ]
)


@validated
@dataclass(frozen=True)
class Problem:
    """
    What is to be solved.

    :param task: reward, termination and state, known or learned
    :param observation_space: of the environment
    :param action_space: of (a, a′)
    :param action_dim: q, the number of dimensions of a
    :param episode_length: time limit of a real episode, in steps
    :param wrappers: names of those that may change observations, actions or rewards
    """

    task: Task
    observation_space: spaces.Box
    action_space: spaces.Box
    action_dim: Count
    episode_length: Count
    wrappers: tuple[str, ...] = ()

    @property
    def real_action_space(self) -> spaces.Box:
        """Of a alone."""
        return first_dims(self.action_space, self.action_dim)

    @classmethod
    def from_spaces(
        cls,
        spec: EnvSpec | None,
        observation_space: spaces.Space[Any],
        action_space: spaces.Space[Any],
        hallucinated_dim: int,
        settings: ModelSettings,
        time_limit: int | None = None,
    ) -> Problem:
        """
        :param spec: of the environment; None where it was made from its class
        :param observation_space: of the environment
        :param action_space: of (a, a′)
        :param hallucinated_dim: number of dimensions of a′
        :param settings: name the task
        :param time_limit: of the environment, in steps; None for that of the specification
        :raises ValueError: if the environment has no time limit, unsuitable spaces, or another task
        """
        observed = require_vector_observation(observation_space)
        observation_dim = observed.shape[0]
        task = resolve_task(settings.task, settings.task_kwargs or {}, spec, observation_dim)
        if time_limit is None and spec is not None:
            time_limit = spec.max_episode_steps
        if time_limit is None or time_limit < 1:
            raise ValueError(
                "the environment has no time limit, so a real episode may never end: make it with "
                "gymnasium.make(..., max_episode_steps=1000), register it with max_episode_steps, or wrap it in "
                "gymnasium.wrappers.TimeLimit"
            )
        box = require_bounded_box(action_space)
        action_dim = box.shape[0] - hallucinated_dim
        check_task(task, observation_dim, action_dim)
        return cls(task, observed, box, action_dim, time_limit, changing_wrappers(spec))

    @classmethod
    def from_env(cls, env: gym.Env[Any, Any], settings: ModelSettings) -> Problem:
        """
        :param env: wrapped in :class:`sb3_hucrl.HallucinationWrapper` where the strategy hallucinates
        :param settings: name the task
        :raises ValueError: as :meth:`from_spaces`
        """
        hallucinated_dim, time_limit = (
            int(env.get_wrapper_attr(name)) if env.has_wrapper_attr(name) else None
            for name in ("hallucinated_dim", TIME_LIMIT)
        )
        return cls.from_spaces(
            env.spec, env.observation_space, env.action_space, hallucinated_dim or 0, settings, time_limit
        )


def changing_wrappers(spec: EnvSpec | None) -> tuple[str, ...]:
    """
    :param spec: of the environment
    :return: names of the wrappers around it that may change observations, actions or rewards, from the inside out;
        those that were registered with the environment belong to it
    """
    if spec is None:
        return ()
    original = gym.registry.get(spec.id.removeprefix(TWIN_PREFIX))
    registered = () if original is None else original.additional_wrappers
    names = [each.name for each in spec.additional_wrappers if each not in registered]
    return tuple(name for name in names if name not in HARMLESS)
