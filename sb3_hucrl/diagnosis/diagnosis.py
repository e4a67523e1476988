"""Everything that was measured of a run, and what it means."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from sb3_hucrl.algorithms import HMPC
from sb3_hucrl.diagnosis.exploration import ExplorationMeasures, measure_exploration
from sb3_hucrl.diagnosis.imagination import ImaginationMeasures, compare_returns, measure_imagination
from sb3_hucrl.diagnosis.model import ModelMeasures, measure_model
from sb3_hucrl.diagnosis.script import ScriptRun
from sb3_hucrl.diagnosis.search import SearchMeasures, measure_search
from sb3_hucrl.diagnosis.setup import Setup, setup_of
from sb3_hucrl.diagnosis.units import Units
from sb3_hucrl.diagnosis.verdict import Level, Verdict
from sb3_hucrl.diagnosis.verdicts import (
    ENOUGH_EPISODES,
    judge_actions,
    judge_confidence,
    judge_critic,
    judge_ends,
    judge_entropy,
    judge_exploration,
    judge_gain,
    judge_many_steps,
    judge_one_step,
    judge_promises,
)
from sb3_hucrl.dynamics import DynamicsModel
from sb3_hucrl.sb3 import policy_actor
from sb3_hucrl.zoo.runs import ZooRun


@dataclass(frozen=True)
class Diagnosis:
    """
    :param setup: of the run
    :param model: predictions of real episodes
    :param exploration: what real episodes visited
    :param imagination: what was promised; None where there is no policy
    :param search: what it found; None where there is no policy
    """

    setup: Setup
    model: ModelMeasures
    exploration: ExplorationMeasures
    imagination: ImaginationMeasures | None
    search: SearchMeasures | None

    @cached_property
    def verdicts(self) -> dict[str, list[Verdict]]:
        """By group, in the order of causes: what is imagined with a bad model means nothing."""
        model, imagination, search, setup = self.model, self.imagination, self.search, self.setup
        found = {"model": [judge_one_step(model, setup)]}
        if imagination is not None:
            found["model"].append(judge_many_steps(model, imagination, search, setup))
        found["model"].append(judge_confidence(model, setup))
        if imagination is not None:
            found["imagination"] = [judge_promises(imagination, search, setup), judge_ends(imagination, setup)]
        if search is not None:
            found["search"] = [judge_gain(search, setup), judge_entropy(search)]
            found["search"] += [judge_critic(search, setup), judge_actions(search)]
        found["exploration"] = [judge_exploration(self.exploration, setup)]
        return found

    @cached_property
    def answer(self) -> Verdict:
        """The most likely cause, and what to change first."""
        returns = self.exploration.returns
        earned = f"{returns[-1]:.1f} in the last real episode"
        if len(returns) < ENOUGH_EPISODES:
            count = f"only {len(returns)} real episode{'s' * (len(returns) > 1)}"
            return Verdict(Level.NOTE, f"There is too little to diagnose: {count}. Let it go on.")
        every = [verdict for group in self.verdicts.values() for verdict in group]
        # What has diverged says for sure why nothing is learned, whatever else is wrong.
        if self.search is not None:
            every = [judge_entropy(self.search), judge_critic(self.search, self.setup), *every]
        causes = [verdict for verdict in every if verdict.level is Level.CAUSE]
        if self._works or not causes:
            fine = "imagined returns come true, and the policy earns more than chance and doing nothing"
            found = f"Nothing is wrong: {fine} ({earned})" if self._works else f"No cause was found ({earned})"
            return Verdict(Level.FINE, f"{found}. If that is too little, train longer (-n).")
        return Verdict(Level.CAUSE, f"The most likely cause: {causes[0].sentence}", causes[0].settings)

    @property
    def _works(self) -> bool:
        """Then even a bad model is good enough."""
        judged = [*self.verdicts.get("imagination", []), *self.verdicts.get("search", [])]
        return bool(judged) and all(verdict.level is not Level.CAUSE for verdict in judged)


def diagnose(run: ZooRun | ScriptRun) -> Diagnosis:
    """
    :param run: finished, running or killed
    :raises ValueError: if no real episode has been finished
    """
    state = run.state
    state.require_real_episode()
    loop = run.loop(state)
    world, units = loop.begin_search(), Units(loop.problem.task)
    episodes = state.dataset.episodes

    def refit(known: int) -> DynamicsModel:
        copy = run.loop()
        logged = state.dataset.logged_episodes
        if logged:
            copy.state.dataset.append_logged(logged, [True] * len(logged))
        for episode in episodes[:known]:
            copy.state.dataset.append_episode(episode)
        copy.refit()
        return copy.state.dynamics

    imagination, search = None, None
    if not isinstance(run.model, HMPC):
        promises = compare_returns(episodes, state.promised_returns)
        act = policy_actor(run.model, deterministic=False)
        imagination = measure_imagination(world, act, state, promises)
        search = measure_search(run.model, world, state, _entropy_coefficient(run))
    return Diagnosis(
        setup=setup_of(run.settings, world.horizon, state.real_episodes, run.model),
        model=measure_model(episodes, state.dynamics, refit, units, world.horizon),
        exploration=measure_exploration(state.dataset, units),
        imagination=imagination,
        search=search,
    )


def _entropy_coefficient(run: ZooRun | ScriptRun) -> float | None:
    if "train/ent_coef" not in run.progress:
        return None
    values = run.progress["train/ent_coef"].dropna()
    return float(values.iloc[-1]) if len(values) else None
