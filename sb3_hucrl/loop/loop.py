"""The outer loop of H-UCRL (Algorithm 2), whoever searches the policy."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import accumulate
from typing import Any

import numpy as np
import torch as th

from sb3_hucrl.checks import Count, NotNegative, Seed, validated
from sb3_hucrl.data import TransitionDataset, Transitions
from sb3_hucrl.dynamics import FitReport
from sb3_hucrl.imagination import (
    BatchActor,
    World,
    WorldRecipe,
    epistemic_std,
    imagine_episode,
    imagined_return,
    trusted_horizon,
)
from sb3_hucrl.logged import LoggedEpisode
from sb3_hucrl.loop.actors import random_actor
from sb3_hucrl.loop.budget import MOST_LOGGED, least_real_steps, search_length
from sb3_hucrl.loop.carried import follow_settings, make_model, origin_of
from sb3_hucrl.loop.episodes import Round
from sb3_hucrl.loop.logged import checked_transitions
from sb3_hucrl.loop.problem import Problem
from sb3_hucrl.loop.reality import Reality
from sb3_hucrl.loop.report import Report
from sb3_hucrl.loop.schedule import HorizonSchedule
from sb3_hucrl.loop.search import Search
from sb3_hucrl.loop.selection import choose_policy
from sb3_hucrl.loop.settings import Settings
from sb3_hucrl.loop.state import HUCRLState, ImaginedEpisode
from sb3_hucrl.loop.systems import RealSystem, RealSystems
from sb3_hucrl.seeding import seeded_generator

#: imagined trajectories by which a policy is judged
JUDGED = 32


@validated
class Loop:
    """
    Alternates real episodes with policy search in a learned World::

        loop = Loop(settings, Problem.from_env(env, settings.model), env, seed=0)
        loop.begin()
        for _ in range(10):
            world = loop.begin_search()
            ...  # search a policy in the world
            loop.play(policy)
            loop.refit()

    A :class:`Search` takes the place of the last two lines with :meth:`end_search`, which also chooses among the
    policies found so far, and records what the model promised. The loop owns what is learned (:attr:`state`) and knows
    no other library.

    :param settings: of real episodes, search, model and planning
    :param problem: what is known of the environment
    :param real: the real system, or several copies of it
    :param state: to go on with, or None to begin afresh
    :param seed: of a fresh state; None for a random one
    :param device: of the dynamics model
    :param on_episode: called after each real episode, or each round of those played at once, for example to save
    :param on_refit: called with a report after each refit
    :raises ValueError: if settings, problem and state do not fit together; no real step has been taken then
    """

    def __init__(
        self,
        settings: Settings,
        problem: Problem,
        real: RealSystem | RealSystems,
        state: HUCRLState | None = None,
        seed: Seed | None = None,
        device: th.device | str = "cpu",
        on_episode: Callable[[], None] = lambda: None,
        on_refit: Callable[[Report], None] = lambda report: None,
    ) -> None:
        self.settings, self.problem = settings, problem
        self._systems = real if isinstance(real, RealSystems) else RealSystems([real])
        self._require_enough_systems()
        self._on_episode, self._on_refit = on_episode, on_refit
        self._reality = Reality(problem)
        self.state = self._fresh_state(seed) if state is None else state
        self._require_same_dimensions()
        replaced = follow_settings(self.state, settings.model, problem.task)
        self.state.dynamics.to(device)
        if replaced and self.state.fitted_steps > 0:
            self._fit()
        search = settings.search
        self.recipe = WorldRecipe(
            search.strategy,
            problem.task,
            problem.action_space,
            self._horizon(),
            search.start_states,
            search.uncertainty_cap,
            problem.observation_space,
        )
        self._starts = self.recipe.starts(self.state)
        #: what is imagined now; before the first search a draft around the unfitted model
        self.world: World = self.recipe.draft(self.state, self._starts)
        self._solved = False
        #: before a real episode that has not been finished
        self._imagined: ImaginedEpisode | None = None
        self._scalars: dict[str, float] = {}
        self._rollout_seconds = 0.0
        self._search_started = time.perf_counter()

    def _fresh_state(self, seed: int | None) -> HUCRLState:
        generator = seeded_generator(seed)
        task, action_dim, settings = self.problem.task, self.problem.action_dim, self.settings.model
        dataset_seed = int(th.randint(2**31, (), generator=generator))
        dataset = TransitionDataset(task.width, action_dim, seed=dataset_seed)
        dynamics = make_model(settings, task, action_dim, generator)
        return HUCRLState(dataset, dynamics, generator, origin=origin_of(settings))

    def _horizon(self) -> int:
        given, known, longest = self.settings.search.horizon, self.state.dataset, self.problem.episode_length
        if given is not None:
            return HorizonSchedule.read(given).at(len(known))
        return trusted_horizon(self.state.dynamics, known, self.problem.task, longest) if len(known) else longest

    def _require_enough_systems(self) -> None:
        wanted, found = self.settings.real.real_envs, len(self._systems)
        if wanted > found:
            raise ValueError(
                f"real_envs is {wanted}, and the number of environments {found}: make more of them (n_envs), or give "
                f"at most {found}"
            )

    def _require_same_dimensions(self) -> None:
        dataset = self.state.dataset
        found, expected = (dataset.state_dim, dataset.action_dim), (self.problem.task.width, self.problem.action_dim)
        if found != expected:
            raise ValueError(
                f"the loaded model carries transitions with (state, action) dimensions {found}, this environment has "
                f"{expected}: load a model that was trained on this environment"
            )

    @validated
    def add_logged(self, episodes: Sequence[LoggedEpisode]) -> None:
        """
        Learn from what was logged before the training, too. To be called before :meth:`begin`, once.

        :param episodes: of this environment
        :raises ValueError: if they are not, as far as that can be seen, or there are real transitions already
        """
        if len(self.state.dataset):
            raise ValueError(
                f"the loaded model has learned from {len(self.state.dataset):,} transitions: logged ones must be given "
                "before these. Go on without them, or train a new model"
            )
        found = checked_transitions(self.problem, episodes)
        self.state.dataset.append_logged(found, [episode.from_reset for episode in episodes])

    def begin(self) -> None:
        """
        Play the random real episodes that are still missing, and fit the model to what it has not seen. If that was
        interrupted between the real episodes after a search, :meth:`end_search` plays the others first.
        """
        state, real = self.state, self.settings.real
        act = random_actor(self.problem.action_space, state.generator)
        if state.fitted_steps == 0 and self._begins_at_random:
            while self._misses(real.initial_episodes or 1, real.initial_steps):
                self.play(act)
        if self._unseen_steps and not self._is_between_episodes:
            self.refit()

    @property
    def _begins_at_random(self) -> bool:
        """Whether there are random real episodes: with logged data only where the settings ask for them."""
        real = self.settings.real
        asked = real.initial_episodes is not None or real.initial_steps is not None
        return asked or self.state.dataset.logged_steps == 0

    @property
    def _unseen_steps(self) -> int:
        """Transitions that the model has not been fitted to."""
        return len(self.state.dataset) - self.state.fitted_steps

    def _misses(self, episodes: int, steps: int | None) -> bool:
        """Whether there must be more real episodes before the next refit."""
        fitted = max(0, self.state.fitted_steps - self.state.dataset.logged_steps)
        unseen = sum(end > fitted for end in accumulate(self.state.dataset.lengths))
        return unseen < episodes or self.state.real_steps - fitted < self._budget(steps)

    @property
    def _is_between_episodes(self) -> bool:
        """Whether a search has ended, and some of its real episodes are played, but not all."""
        real = self.settings.real
        played = self.state.fitted_steps > 0 and self._unseen_steps > 0
        return played and self._misses(real.real_episodes, real.real_steps)

    def _budget(self, steps: int | None) -> int:
        """Real steps to play at least, where the settings leave it open: short episodes are no reason for a refit."""
        return least_real_steps(self.problem.episode_length) if steps is None else steps

    @property
    def progress(self) -> float:
        """Fraction of the ``max_real_steps`` that are used up; 0 where there is no such number."""
        most = self.settings.real.max_real_steps
        return 0.0 if most is None else self.state.real_steps / most

    @property
    def finished(self) -> bool:
        """Whether real episodes have reached the ``reward_threshold``, or the ``max_real_steps``."""
        return self._solved or self.progress >= 1

    @property
    def imagined_steps(self) -> int:
        """Timesteps of the present search; 0 if it has ended before, and its real episodes were interrupted."""
        if self._is_between_episodes:
            return 0
        if self.settings.search.imagined_steps is not None:
            return self.settings.search.imagined_steps
        new_steps = self.state.new_steps
        if new_steps is None:
            new_steps = max([self._budget(self.settings.real.real_steps), *self.state.dataset.lengths[-1:]])
        return search_length(new_steps)

    @validated
    def begin_search(self, num_trajectories: Count = 1, progress: NotNegative = 0.0) -> World:
        """
        :param num_trajectories: number of trajectories that will be imagined in parallel
        :param progress: fraction of the training that will be over when the search ends
        :return: the World to search in until the next refit
        """
        planning = self.settings.planning
        num_samples = max(num_trajectories, planning.rollouts if planning else 1)
        horizon, longest = self._horizon(), self.problem.episode_length
        self.recipe = replace(self.recipe, horizon=horizon)
        starts = self._starts.trusting(min(1.0, horizon / longest))
        self.world = self.recipe.world(self.state, starts, num_samples, self._explores(progress))
        self._note("hucrl", {"horizon": horizon})
        self._note("hucrl", self.state.dynamics.diagnostics())
        self._note("hucrl", self.world.strategy.diagnostics())
        self._search_started = time.perf_counter()
        return self.world

    def _explores(self, progress: float) -> bool:
        """Whether real episodes sample the present policy, and do not play the mode of the best one so far."""
        return max(progress, self.progress) < self.settings.real.sampling_fraction

    @validated
    def end_search(self, search: Search, progress: NotNegative) -> None:
        """
        Play rounds of real episodes with what was found, and refit. In the first part of the training they sample the
        present policy, later they play the mode of the best one so far.

        :param search: of a policy in :attr:`world`
        :param progress: fraction of the training that is over
        """
        deterministic = not self._explores(progress)
        self._scalars["time/search_seconds"] = time.perf_counter() - self._search_started
        if deterministic and search.parameters() is not None:
            self.state.best, promised = choose_policy(
                search,
                self.state.best,
                lambda: imagined_return(
                    self.world.from_real_starts(self.problem.episode_length).trajectories(JUDGED, seed=0),
                    search.actor(deterministic=True),
                ),
            )
            self._scalars["imagined/mode_return"] = promised
        uncertainties = []
        real = self.settings.real
        while self._misses(real.real_episodes, real.real_steps):
            planner = search.planner(deterministic)
            if planner is None:
                uncertainties.append(self._imagine(search.actor(deterministic)))
            self.play(planner or search.actor(deterministic))
        if uncertainties:
            self._scalars["imagined/epistemic_std"] = float(np.mean(uncertainties))
        self._note("imagined", search.diagnostics())
        self.refit()

    def _imagine(self, act: BatchActor) -> float:
        """
        Note what the model promises of the next real episode, the first of its round. Returns the mean epistemic std
        along it.
        """
        episode = imagine_episode(self.world.from_real_starts(self.problem.episode_length).trajectories(1, seed=0), act)
        self._imagined = ImaginedEpisode(self.state.real_episodes + 1, episode)
        # Of the whole model, even where a posterior sample was imagined, which has no epistemic part.
        return float(epistemic_std(self.state.dynamics, episode).mean())

    @validated
    def play(self, act: BatchActor) -> list[Transitions]:
        """
        Play a round of real episodes, one in each of ``real_envs`` environments at once, and remember them for the next
        refit. If it is interrupted, those that are over are remembered.

        :param act: chooses the actions, of a batch of ``real_envs``
        :return: the episodes, in the order of the environments
        :raises ValueError: if the environment gives what it must not, or something else than the task says
        """
        started = time.perf_counter()
        playing = Round(self._systems, self.problem, self.settings.real.real_envs, self._reality)
        try:
            return playing.play(act)
        finally:
            if finished := playing.finished():
                self._remember(finished)
                self._rollout_seconds += time.perf_counter() - started
                self._on_episode()
            self._imagined = None

    def _remember(self, episodes: list[Transitions]) -> None:
        state = self.state
        for episode in episodes:
            state.dataset.append_episode(episode)
        if self._imagined is not None:
            state.remember_imagined(self._imagined)
        state.last_return = float(np.mean([float(episode.rewards.sum(dtype=th.float64)) for episode in episodes]))
        threshold = self.settings.real.reward_threshold
        self._solved |= threshold is not None and state.last_return >= threshold

    def refit(self) -> None:
        """Fit the dynamics model to all real transitions, and report."""
        started, state = time.perf_counter(), self.state
        fit = self._fit()
        uncounted = max(0, state.dataset.logged_steps - MOST_LOGGED) if state.fitted_steps == 0 else 0
        state.new_steps = self._unseen_steps - uncounted
        state.fitted_steps = len(state.dataset)
        self._note("real", {"episode": state.real_episodes, "steps": state.real_steps})
        if state.real_episodes > 0:
            self._note("real", {"return": state.last_return})
        if state.dataset.logged_steps > 0:
            self._note("logged", {"steps": state.dataset.logged_steps})
        self._note("time", {"rollout_seconds": self._rollout_seconds, "fit_seconds": time.perf_counter() - started})
        self._on_refit(Report(self._scalars, fit))
        self._scalars, self._rollout_seconds = {}, 0.0

    def _fit(self) -> FitReport:
        # A search that needs no gradients, such as ARS, may have switched them off.
        with th.enable_grad():
            return self.state.dynamics.fit(self.state.dataset, self.state.generator)

    def _note(self, group: str, values: dict[str, Any]) -> None:
        self._scalars.update({f"{group}/{name}": value for name, value in values.items()})
