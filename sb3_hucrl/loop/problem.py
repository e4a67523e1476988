"""The real environment, as far as it must be known before anything is learned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec

from sb3_hucrl.loop.settings import ModelSettings
from sb3_hucrl.spaces import require_bounded_box, require_vector_observation
from sb3_hucrl.tasks import Task, check_task, resolve_task


@dataclass(frozen=True)
class Problem:
    """
    What is to be solved.

    :param task: reward, termination and state, known or learned
    :param observation_space: of the environment
    :param action_space: of (a, a′)
    :param action_dim: q, the number of dimensions of a
    :param episode_length: time limit of a real episode, in steps
    """

    task: Task
    observation_space: spaces.Box
    action_space: spaces.Box
    action_dim: int
    episode_length: int

    @classmethod
    def from_spaces(
        cls,
        spec: EnvSpec | None,
        observation_space: spaces.Space[Any],
        action_space: spaces.Space[Any],
        hallucinated_dim: int,
        settings: ModelSettings,
    ) -> Problem:
        """
        :param spec: of the environment
        :param observation_space: of the environment
        :param action_space: of (a, a′)
        :param hallucinated_dim: number of dimensions of a′
        :param settings: name the task
        :raises ValueError: if the environment has no time limit, unsuitable spaces, or another task
        """
        observed = require_vector_observation(observation_space)
        observation_dim = observed.shape[0]
        task = resolve_task(settings.task, settings.task_kwargs or {}, spec, observation_dim)
        if spec is None or spec.max_episode_steps is None:
            raise ValueError(
                "the environment has no time limit, so a real episode may never end: make it with "
                "gymnasium.make(..., max_episode_steps=1000), or register it with max_episode_steps"
            )
        box = require_bounded_box(action_space)
        action_dim = box.shape[0] - hallucinated_dim
        check_task(task, observation_dim, action_dim)
        return cls(task, observed, box, action_dim, int(spec.max_episode_steps))

    @classmethod
    def from_env(cls, env: gym.Env[Any, Any], settings: ModelSettings) -> Problem:
        """
        :param env: wrapped in :class:`sb3_hucrl.HallucinationWrapper` where the strategy hallucinates
        :param settings: name the task
        :raises ValueError: as :meth:`from_spaces`
        """
        name = "hallucinated_dim"
        hallucinated_dim = int(env.get_wrapper_attr(name)) if env.has_wrapper_attr(name) else 0
        return cls.from_spaces(env.spec, env.observation_space, env.action_space, hallucinated_dim, settings)
