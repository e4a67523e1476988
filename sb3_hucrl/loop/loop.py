"""The outer loop of H-UCRL (Algorithm 2), whoever searches the policy."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch as th

from sb3_hucrl.checks import Count, NotNegative, Seed, validated
from sb3_hucrl.data import Transitions
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
from sb3_hucrl.loop.asked import AskedPolicy, FoundPolicy, freeze
from sb3_hucrl.loop.carried import follow_settings, fresh_state, require_same_dimensions
from sb3_hucrl.loop.episodes import Part
from sb3_hucrl.loop.logged import checked_transitions
from sb3_hucrl.loop.plan import Plan
from sb3_hucrl.loop.player import Player
from sb3_hucrl.loop.problem import Problem
from sb3_hucrl.loop.reality import Reality
from sb3_hucrl.loop.report import Report, scalars_of, unseen_episodes
from sb3_hucrl.loop.schedule import HorizonSchedule
from sb3_hucrl.loop.search import Search
from sb3_hucrl.loop.selection import choose_policy
from sb3_hucrl.loop.settings import Settings
from sb3_hucrl.loop.state import HUCRLState, ImaginedEpisode
from sb3_hucrl.loop.systems import RealSystem, RealSystems, require_systems
from sb3_hucrl.loop.told import Episode, read_episode, same_transitions
from sb3_hucrl.progress import begin_phase

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

    Where the real system is elsewhere, ``real`` is None. Then the loop is asked for policies, and told the episodes
    that they played::

        while not loop.finished:
            if loop.needs_search:
                world = loop.begin_search()
                ...  # search a policy in the world
            policy = loop.ask(search)
            ...  # send it, play it, get the episode
            loop.tell(episode)

    Several policies may be under way at once, and episodes be told in any order. A new loop goes on from a saved state.

    :param settings: of real episodes, search, model and planning
    :param problem: what is known of the environment
    :param real: the real system, or several copies of it; None where real episodes are told
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
        real: RealSystem | RealSystems | None,
        state: HUCRLState | None = None,
        seed: Seed | None = None,
        device: th.device | str = "cpu",
        on_episode: Callable[[], None] = lambda: None,
        on_refit: Callable[[Report], None] = lambda report: None,
    ) -> None:
        self.settings, self.problem = settings, problem
        systems = real if real is None or isinstance(real, RealSystems) else RealSystems([real])
        require_systems(systems, settings.real)
        self.state = fresh_state(problem, settings.model, seed) if state is None else state
        self._reality = Reality(problem, lambda: self.state.dataset.transitions.rewards)
        self._player = None if systems is None else Player(systems, problem, settings.real.real_envs, self._reality)
        self._on_episode, self._on_refit = on_episode, on_refit
        self._plan = Plan(settings, self.state, problem.episode_length)
        require_same_dimensions(self.state, problem)
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
        # The file of a run that is told does not say whether it was over.
        self._solved, self._searching = real is None and self._plan.is_solved, False
        #: before a real episode that has not been finished
        self._imagined: ImaginedEpisode | None = None
        self._scalars: dict[str, float] = {}
        self._rollout_seconds, self._search_started = 0.0, time.perf_counter()

    def _horizon(self) -> int:
        given, known, longest = self.settings.search.horizon, self.state.dataset, self.problem.episode_length
        if given is not None:
            return HorizonSchedule.read(given).at(len(known))
        return trusted_horizon(self.state.dynamics, known, self.problem.task, longest) if len(known) else longest

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
        while self._plan.misses_random:
            self.play(random_actor(self.problem.action_space, self.state.generator, self._plan.random_hold))
        if self._plan.unseen_steps and not self._plan.is_between_episodes:
            self.refit()

    @property
    def progress(self) -> float:
        """Fraction of the ``max_real_steps`` that are used up; 0 where there is no such number."""
        return self._plan.progress

    @property
    def next_progress(self) -> float:
        """The same, once the real episodes after the present search are played; at most 1."""
        return min(1.0, self._plan.next_progress)

    @property
    def finished(self) -> bool:
        """Whether real episodes have reached the ``reward_threshold``, or the ``max_real_steps``."""
        return self._solved or self.progress >= 1

    @property
    def imagined_steps(self) -> int:
        """Timesteps of the present search; 0 if it has ended before, and its real episodes were interrupted."""
        if self._player is not None and self._plan.is_between_episodes:
            return 0
        return self._plan.search_steps

    @property
    def needs_search(self) -> bool:
        """Whether it is time for :meth:`begin_search`, where real episodes are told: enough of them are new."""
        plan = self._plan
        return not plan.misses_random and (plan.needs_refit or not plan.is_searched)

    @validated
    def begin_search(self, num_trajectories: Count = 1, progress: NotNegative = 0.0) -> World:
        """
        Where real episodes are told, this first fits the model to those that are new.

        :param num_trajectories: number of trajectories that will be imagined in parallel
        :param progress: fraction of the training that will be over when the search ends; where real episodes are told,
            :attr:`next_progress` counts if it is larger
        :return: the World to search in until the next refit
        :raises ValueError: if random real episodes are still to be told
        """
        if self._player is None:
            if self._plan.misses_random:
                raise ValueError("random real episodes are missing: ask() for policies, and tell() what they played")
            if self._plan.needs_refit:
                self.refit()
            progress = max(progress, self.next_progress)
        self._searching, planning, horizon = True, self.settings.planning, self._horizon()
        num_samples = max(num_trajectories, planning.rollouts if planning else 1)
        self.recipe = replace(self.recipe, horizon=horizon)
        starts = self._starts.trusting(min(1.0, horizon / self.problem.episode_length))
        self.world = self.recipe.world(self.state, starts, num_samples, self._explores(progress))
        found = self.state.dynamics.diagnostics() | self.world.strategy.diagnostics()
        self._note("hucrl", {"horizon": horizon} | found)
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
        self._choose(search, deterministic)
        while self._plan.misses_real:
            planner = search.planner(deterministic)
            if planner is None and not self.state.dataset.under_way:
                self._imagined = self._imagine(search.actor(deterministic))
            self.play(planner or search.actor(deterministic))
        self.refit()

    def _choose(self, search: Search, deterministic: bool) -> None:
        """Let the search go on from the best policy so far, if it is the mode that plays."""
        self._searching = False
        self._scalars["time/search_seconds"] = time.perf_counter() - self._search_started
        self._note("imagined", search.diagnostics())
        if deterministic and search.parameters() is not None:
            self.state.best, promised = choose_policy(
                search,
                self.state.best,
                lambda: imagined_return(
                    self.world.from_real_starts(self.problem.episode_length).trajectories(JUDGED, seed=0),
                    search.actor(deterministic=True),
                ),
                self.state.generator,
            )
            self._scalars["imagined/mode_return"] = promised

    @validated
    def ask(self, search: Search | None = None) -> AskedPolicy:
        """
        A policy for one real episode that is played elsewhere. At first it acts at random. After a search it is what
        the search has found: in the first part of the training it samples the present policy, later it plays the mode
        of the best one so far. Until enough is told for another search, all policies are the same but for their seeds.

        :param search: of a policy in :attr:`world`; needed after a search
        :return: can be pickled
        :raises ValueError: if a search is needed before, or the policy cannot be pickled
        """
        state, promised = self.state, None
        if self._plan.misses_random:
            generator = th.Generator().manual_seed(state.draw_seed())
            actor = freeze(random_actor(self.problem.action_space, generator, self._plan.random_hold))
        else:
            if self._searching and search is not None:
                state.asked.found = self._find(search)
            elif self.needs_search or state.asked.found is None:
                raise ValueError(
                    "enough real episodes were told for another search: begin_search(), search in that world, and then "
                    "ask(search)"
                )
            actor, promised = state.asked.found.actor, state.asked.found.promised
        # Not from the loop's generator: no id is given twice, even if a state that was saved before goes on.
        policy = AskedPolicy(uuid.uuid4().hex, actor, self.problem, state.draw_seed())
        state.asked.open[policy.id] = promised
        return policy

    def _find(self, search: Search) -> FoundPolicy:
        deterministic = not self.world.exploring
        self._choose(search, deterministic)
        planner, promised = search.planner(deterministic), None
        if planner is None:
            promised = self._imagine(search.actor(deterministic)).transitions
        return FoundPolicy(self.state.fitted_steps, freeze(planner or search.actor(deterministic)), promised)

    @validated
    def tell(self, episode: Episode) -> bool:
        """
        Remember a real episode that was played elsewhere, for the next refit. It may be told again, for example by a
        process that was killed before it knew of the answer: it is remembered once. What was played by other policies
        than those asked for counts in the same way.

        :param episode: of a policy from :meth:`ask`, or of another one
        :return: whether it is new; False if it was told before
        :raises ValueError: if it is not what a real episode must be, or another episode was told under its policy's id
        """
        asked, dataset = self.state.asked, self.state.dataset
        index = asked.index_of(episode.policy_id, len(dataset.lengths))
        transitions = read_episode(episode, self.problem, self._reality if index is None else None)
        if index is None:
            promised = asked.open.get(episode.policy_id)
            self._imagined = None if promised is None else ImaginedEpisode(self.state.real_episodes + 1, promised)
            asked.told[episode.policy_id] = len(dataset.lengths)
            self._remember([Part(transitions, is_last=True)])
            self._imagined = None
            asked.open.pop(episode.policy_id, None)
        elif not same_transitions(transitions, dataset.episodes[index]):
            raise ValueError(
                f"another episode of policy {episode.policy_id!r} was told before: ask() for a policy for each episode"
            )
        # Also of what was told before: to save it may have failed.
        self._on_episode()
        return index is None

    def _imagine(self, act: BatchActor) -> ImaginedEpisode:
        """What the model promises of the next real episode, the first of its round."""
        episode = imagine_episode(self.world.from_real_starts(self._plan.time_limit).trajectories(1, seed=0), act)
        # Of the whole model, even where a posterior sample was imagined, which has none.
        self._scalars["imagined/epistemic_std"] = float(epistemic_std(self.state.dynamics, episode).mean())
        return ImaginedEpisode(self.state.real_episodes + 1, episode)

    @validated
    def play(self, act: BatchActor) -> list[Transitions]:
        """
        Play a round of real episodes, one in each of ``real_envs`` environments at once, and remember them for the next
        refit. If it is interrupted, those that are over are remembered. Where refits do not wait for whole episodes, it
        is played until the next refit, and the next call goes on with it.

        :param act: chooses the actions, of a batch of ``real_envs``
        :return: the episodes that are over
        :raises ValueError: if the environment gives what it must not, or something else than the task says, or is none
        """
        if self._player is None:
            raise ValueError("there is no real system here: ask() for a policy, and tell() the episode that it played")
        started, player = time.perf_counter(), self._player
        if not player.is_under_way:
            self.state.dataset.end_episode()

        try:
            label = "real episode" if self.state.fitted_steps else "random episode"
            return player.play(act, label, self._plan.part, self._plan.time_limit, self._remember_played)
        finally:
            self._rollout_seconds += time.perf_counter() - started
            if not self.state.dataset.under_way:
                self._imagined = None

    def _remember_played(self, parts: list[Part]) -> None:
        self._remember(parts)
        self._on_episode()

    def _remember(self, parts: list[Part]) -> None:
        state = self.state
        for part in parts:
            state.dataset.append_part(part.transitions, over=part.is_last)
        if not (ended := sum(part.is_last for part in parts)):
            return
        if self._imagined is not None:
            state.remember_imagined(self._imagined)
        episodes = state.dataset.episodes[-ended:]
        state.last_return = float(np.mean([float(episode.rewards.sum(dtype=th.float64)) for episode in episodes]))
        self._solved |= self._plan.is_solved

    def refit(self) -> None:
        """Fit the dynamics model to all real transitions, and report."""
        started, state = time.perf_counter(), self.state
        episodes = unseen_episodes(state, self.problem.task)
        self._scalars.update(scalars_of(state, episodes))
        fit = self._fit()
        state.new_steps = self._plan.new_steps
        state.fitted_steps = len(state.dataset)
        self._note("time", {"rollout_seconds": self._rollout_seconds, "fit_seconds": time.perf_counter() - started})
        self._on_refit(Report(self._scalars, fit, episodes))
        self._scalars, self._rollout_seconds = {}, 0.0

    def _fit(self) -> FitReport:
        begin_phase("fit")
        # A search that needs no gradients, such as ARS, may have switched them off.
        with th.enable_grad():
            return self.state.dynamics.fit(self.state.dataset, self.state.generator)

    def _note(self, group: str, values: dict[str, Any]) -> None:
        self._scalars.update({f"{group}/{name}": value for name, value in values.items()})
