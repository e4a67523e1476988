"""How a World is made from what has been learned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import torch as th
from gymnasium import spaces

from sb3_hucrl.checks import Count, NotNegative, Positive, validated
from sb3_hucrl.data import TransitionDataset, reward_std
from sb3_hucrl.dynamics import DynamicsModel, Predictor
from sb3_hucrl.exploration import ExplorationStrategy
from sb3_hucrl.imagination.limits import Limits
from sb3_hucrl.imagination.starts import StartStates
from sb3_hucrl.imagination.world import World
from sb3_hucrl.tasks.base import Task


class Learned(Protocol):
    """What a run has learned, as far as imagination needs it."""

    dataset: TransitionDataset
    dynamics: DynamicsModel
    generator: th.Generator

    @property
    def real_episodes(self) -> int:
        """Number of real episodes so far."""

    def draw_seed(self) -> int:
        """A fresh seed."""


@validated
@dataclass(frozen=True)
class WorldRecipe:
    """
    The parts of a :class:`World` that stay the same from refit to refit.

    :param strategy: turns prediction and a′ into the next state
    :param task: reward, termination and observation
    :param action_space: of (a, a′)
    :param horizon: steps after which a trajectory is truncated
    :param start_states: weights of the kinds of start states, see :class:`StartStates`
    :param uncertainty_cap: multiple of the usual uncertainty at which trajectories end, see :func:`epistemic_limit`;
        None for never
    :param observation_space: bounds of start states that were not visited; None for none
    """

    strategy: ExplorationStrategy
    task: Task
    action_space: spaces.Box
    horizon: Count
    start_states: Mapping[str, NotNegative] | None = None
    uncertainty_cap: Positive | None = None
    observation_space: spaces.Box | None = None

    def starts(self, learned: Learned) -> StartStates:
        """
        :param learned: its dataset may still be empty, and grow
        :raises ValueError: if the weights do not fit the task
        """
        return StartStates(learned.dataset, self.task, self.start_states, self.observation_space)

    def draft(self, learned: Learned, starts: StartStates) -> World:
        """
        A World around a model that may not be fitted yet: to see whether all parts fit together before any real step.

        :param learned: so far
        :param starts: of all worlds of a run
        :raises ValueError: if they do not
        """
        self.strategy.require_support(learned.dynamics)
        return self._world(learned, starts, learned.dynamics, self.strategy, Limits())

    def world(self, learned: Learned, starts: StartStates, num_samples: int, exploring: bool = True) -> World:
        """
        The World of the next search.

        :param learned: with a newly fitted model
        :param starts: of all worlds of a run
        :param num_samples: number of posterior samples, where the strategy gives each trajectory one of its own
        :param exploring: see :class:`World`
        """
        model = learned.dynamics
        limits = Limits.from_data(learned.dataset, self.task, model, self.uncertainty_cap, starts.unvisited)
        strategy = self.strategy.adapted(model, learned.real_episodes)
        predictor = strategy.predictor(model, num_samples, learned.generator)
        std = reward_std(learned.dataset.transitions.rewards)
        world = self._world(learned, starts, predictor, strategy, limits, exploring)
        return replace(world, reward_std=std) if std > 0 else world

    def _world(
        self,
        learned: Learned,
        starts: StartStates,
        predictor: Predictor,
        strategy: ExplorationStrategy,
        limits: Limits,
        exploring: bool = True,
    ) -> World:
        seed = learned.draw_seed()
        return World(predictor, strategy, self.task, self.action_space, self.horizon, starts, limits, seed, exploring)
