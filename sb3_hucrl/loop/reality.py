"""The task against the real environment: whether both agree on what happened in its episodes, real or logged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch as th

from sb3_hucrl.data import Transitions
from sb3_hucrl.loop.problem import Problem

#: what has agreed for so long is not compared any more: so many episodes, and so many steps
EPISODES, STEPS = 5, 1_000
#: difference of two rewards that counts as rounding, as a fraction of the largest real reward so far
REWARD_ROUNDING = 1e-4
#: the same for two observed values, as a fraction of the largest value of their column
OBSERVATION_ROUNDING = 1e-3
#: fraction of the largest value of a column by which a state in single precision may be wrong
STATE_ROUNDING = 1e-6


@dataclass(frozen=True)
class RealEpisode:
    """
    What the real environment gave in one episode.

    :param number: of the episode in this training, or in the logged data, from 1
    :param observations: o_0 to o_n, shape (n + 1, observation dimension)
    :param transitions: the n of them
    """

    number: int
    observations: th.Tensor
    transitions: Transitions


class Reality:
    """
    Compares real episodes with the task: its reward and its termination with those of the environment, what it observes
    in the state of an observation with that observation, and its context with that of the step before. Where they
    differ, imagination would optimise something else than what real episodes pay.

    :param problem: with the task
    :param rewards: gives those of other real steps so far, shape (n,), which tell what is small; None for none
    :param logged: whether the episodes were logged before the training: then all of them are compared, because others
        may have other causes, and the comparison takes no real steps
    """

    def __init__(self, problem: Problem, rewards: Callable[[], th.Tensor] | None = None, logged: bool = False) -> None:
        self._problem, self._rewards, self._logged = problem, rewards, logged
        self._episodes = self._steps = 0

    def check(self, observations: th.Tensor, transitions: Transitions) -> None:
        """
        :param observations: of an episode, o_0 to o_n
        :param transitions: the n of them
        :raises ValueError: if the task says anything else than the environment, beyond rounding
        """
        if not self._logged and self._episodes >= EPISODES and self._steps >= STEPS:
            return
        episode = RealEpisode(self._episodes + 1, observations, transitions)
        self._compare_observations(episode)
        self._compare_context(episode)
        self._compare_terminations(episode)
        self._compare_rewards(episode)
        self._episodes += 1
        self._steps += len(transitions)

    def _compare_observations(self, episode: RealEpisode) -> None:
        task, observations = self._problem.task, episode.observations
        observed = task.observe(task.state(observations))
        sizes = observations.abs().amax(dim=0)
        rounding = OBSERVATION_ROUNDING * sizes + STATE_ROUNDING * sizes.max()
        differs = ~((observed - observations).abs() <= rounding)
        if differs.any():
            step, dim = differs.nonzero()[0].tolist()
            self._refuse(
                episode,
                step,
                f"observe(state(observation))[{dim}]",
                observed[step, dim],
                observations[step, dim],
                "a wrapper that changes observations, such as NormalizeObservation or DelayObservation",
            )

    def _compare_context(self, episode: RealEpisode) -> None:
        first = self._problem.task.state_dim
        before, after = episode.transitions.states[:, first:], episode.transitions.next_states[:, first:]
        sizes = after.abs().amax(dim=0)
        differs = ~((after - before).abs() <= STATE_ROUNDING * sizes)
        if differs.any():
            row, dim = differs.nonzero()[0].tolist()
            self._refuse(
                episode,
                row + 1,
                f"context[{dim}]",
                before[row, dim],
                after[row, dim],
                "a goal, or what else the task takes for constant, that changes within an episode",
            )

    def _compare_terminations(self, episode: RealEpisode) -> None:
        real = episode.transitions
        told = self._problem.task.terminated(real.states, real.actions, real.next_states)
        for row in (told != real.terminated).nonzero()[:, 0].tolist():
            near = _neighbours(real, row)
            around = self._problem.task.terminated(near.states, near.actions, near.next_states)
            # Just at a threshold single precision decides.
            if bool((around == real.terminated[row]).any()):
                continue
            self._refuse(
                episode,
                row + 1,
                "terminated",
                told[row],
                real.terminated[row],
                "a wrapper that changes observations, such as NormalizeObservation, or one that ends episodes",
            )

    def _compare_rewards(self, episode: RealEpisode) -> None:
        real = episode.transitions
        told = self._problem.task.reward(real.states, real.actions, real.next_states)
        # Rewards that are nearly zero have hardly any digits, and a sum such as 1 - exp(-cost) loses some in an episode
        # that costs hardly anything.
        paid_so_far = real.rewards if self._rewards is None else th.cat([self._rewards(), real.rewards])
        rounding = max(REWARD_ROUNDING * float(paid_so_far.abs().max()), th.finfo(th.float32).tiny)
        for row in (~((told - real.rewards).abs() <= rounding)).nonzero()[:, 0].tolist():
            near, paid = _neighbours(real, row), float(real.rewards[row])
            around = self._problem.task.reward(near.states, near.actions, near.next_states)
            if float(around.min()) - rounding <= paid <= float(around.max()) + rounding:
                continue
            self._refuse(
                episode,
                row + 1,
                "reward",
                told[row],
                real.rewards[row],
                "a wrapper that changes rewards, such as NormalizeReward, or actions, such as RescaleAction, or "
                "observations that come late, such as those of DelayObservation",
            )

    def _refuse(
        self, episode: RealEpisode, step: int, what: str, told: th.Tensor, given: th.Tensor, cause: str
    ) -> None:
        problem = self._problem
        kind, giver, remedy = "real", "the environment gave", "take that away"
        if self._logged:
            kind, giver, remedy = "logged", "the data say", "give what this environment itself gives and takes"
            cause = (
                "another environment, or another version or other arguments of it, or data that were changed: "
                "normalised observations or rewards, actions in other units"
            )
        elif problem.wrappers:
            cause = f"what lies around the environment: {', '.join(problem.wrappers)}"
        width, room = problem.observation_space.shape[0], ""
        if 0 < problem.action_space.shape[0] - problem.action_dim != width:
            room = f" with HallucinationWrapper(env, hallucinated_dim={width})"
        raise ValueError(
            f"task is {type(problem.task).__name__}, whose {what} is {_shown(told)} at step {step} of {kind} episode "
            f"{episode.number}, where {giver} {_shown(given)}: the likely cause is {cause}; {remedy}, correct the task "
            f"or its arguments, or learn it, task: learned{room}"
        )


def _neighbours(real: Transitions, row: int) -> Transitions:
    """What a transition may have been before it was rounded to single precision."""
    both = th.cat([real.states, real.next_states], dim=1)
    steps = STATE_ROUNDING * both.abs().amax(dim=0)
    single = th.cat([th.diag(steps), steps[None], th.zeros_like(steps)[None]])
    near = both[row] + th.cat([single, -single])
    states, next_states = near.chunk(2, dim=1)
    rows = th.full((len(near),), row)
    return Transitions(states, real.actions[rows], next_states, real.rewards[rows], real.terminated[rows])


def _shown(value: th.Tensor) -> str:
    return str(bool(value)) if value.dtype == th.bool else f"{float(value):.6g}"
