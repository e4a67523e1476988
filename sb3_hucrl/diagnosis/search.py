"""What the policy search has found, as imagination judges it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch as th
from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.algorithms import HSVG
from sb3_hucrl.imagination import Array, BatchActor, World, imagined_return
from sb3_hucrl.loop import JUDGED, HUCRLState
from sb3_hucrl.sb3 import SB3Policy, policy_actor, reward_unit

#: of its bound, from which on an action is saturated
SATURATED = 0.98
#: visited states on which the policy is asked
VISITED = 1_000


@dataclass(frozen=True)
class CriticMeasures:
    """
    :param value: of start states, mean
    :param earned: discounted return of the policy from there, with the critic's value of where imagination stops and
        the entropy that the algorithm aims at; mean
    :param spread: standard deviation of what single trajectories earn
    :param bound: what the largest reward, imagined or real, would earn for ever
    """

    value: float
    earned: float
    spread: float
    bound: float


@dataclass(frozen=True)
class SearchMeasures:
    """
    Returns are imagined, from where real episodes begin.

    :param mode: return of the policy's mode
    :param unsteered: the same with a hallucinated action of 0, which is the model's own opinion
    :param random: return of random actions
    :param nothing: return of doing nothing
    :param effort: mean size of the mode's actions on visited states, 1 at their bounds
    :param saturated: fraction of them beyond :data:`SATURATED` of their bounds
    :param entropy_coefficient: latest one, or None where there is none
    :param usual_reward: root mean square of the real rewards, in the units that the algorithm sees
    :param critic: None where the algorithm has none that can be asked
    """

    mode: float
    unsteered: float
    random: float
    nothing: float
    effort: float
    saturated: float
    entropy_coefficient: float | None
    usual_reward: float
    critic: CriticMeasures | None

    @property
    def gain(self) -> float:
        """
        What the mode earns more than the better of chance and doing nothing, as a fraction of the difference of these
        two or, where they differ little, of its own return.
        """
        scale = max(abs(self.random - self.nothing), 0.1 * abs(self.mode), 1e-6)
        return (self.mode - max(self.random, self.nothing)) / scale

    @property
    def value_error(self) -> float:
        """
        How wrong the critic is, as a fraction of the values or, where they are small, of what acting at random costs or
        earns; 0 where there is no critic.
        """
        critic = self.critic
        if critic is None:
            return 0.0
        scale = max(abs(critic.value), abs(critic.earned), critic.spread, abs(self.random - self.nothing), 1e-6)
        return abs(critic.value - critic.earned) / scale


def measure_search(
    model: BaseAlgorithm, world: World, state: HUCRLState, entropy_coefficient: float | None
) -> SearchMeasures:
    """
    :param model: SB3 algorithm with a policy
    :param world: that the run searches in now
    :param state: what the run has learned
    :param entropy_coefficient: latest one
    """
    world, action_dim = world.from_real_starts(), state.dataset.action_dim

    def earned(act: BatchActor) -> float:
        return imagined_return(world.trajectories(JUDGED, seed=0), act)

    effort, saturated = _actions(model, world, state)
    rewards = state.dataset.transitions.rewards
    unit = model.reward_unit if isinstance(model, HSVG) else reward_unit(model.get_vec_normalize_env())
    return SearchMeasures(
        mode=earned(policy_actor(model, deterministic=True)),
        unsteered=earned(_unsteered(policy_actor(model, deterministic=True), action_dim)),
        random=earned(_unsteered(_random(world), action_dim)),
        nothing=earned(_nothing(world)),
        effort=effort,
        saturated=saturated,
        entropy_coefficient=entropy_coefficient,
        usual_reward=float(rewards.square().mean().sqrt()) / unit,
        critic=_measure_critic(model, world, unit * (entropy_coefficient or 0.0), float(rewards.abs().max())),
    )


def _unsteered(act: BatchActor, action_dim: int) -> BatchActor:
    def unsteered(observations: Array, first: npt.NDArray[np.bool_]) -> Array:
        actions: Array = act(observations, first).copy()
        actions[:, action_dim:] = 0.0
        return actions

    return unsteered


def _random(world: World) -> BatchActor:
    generator, box = np.random.default_rng(0), world.action_space

    def act(observations: Array, first: npt.NDArray[np.bool_]) -> Array:
        return generator.uniform(box.low, box.high, (len(observations), *box.shape)).astype(np.float32)

    return act


def _nothing(world: World) -> BatchActor:
    box = world.action_space
    rest = np.zeros(box.shape, np.float32).clip(box.low, box.high)
    return lambda observations, first: np.tile(rest, (len(observations), 1))


def _actions(model: BaseAlgorithm, world: World, state: HUCRLState) -> tuple[float, float]:
    """Mean size of the mode's real actions on visited states, and the fraction that is saturated."""
    states = state.dataset.transitions.states
    some = states[th.linspace(0, len(states) - 1, min(VISITED, len(states))).long()].to(world.device)
    observations = world.task.observe(some).cpu().numpy()
    actions = policy_actor(model, deterministic=True)(observations, np.ones(len(some), dtype=np.bool_))
    q, box = state.dataset.action_dim, world.action_space
    middle, half = (box.high + box.low)[:q] / 2, (box.high - box.low)[:q] / 2
    size = np.abs((actions[:, :q] - middle) / half)
    return float(size.mean()), float((size > SATURATED).mean())


@th.no_grad()
def _measure_critic(
    model: BaseAlgorithm, world: World, entropy_coefficient: float, largest: float
) -> CriticMeasures | None:
    try:
        policy = SB3Policy(model)
        value = policy.value()
    except ValueError:
        return None
    gamma, device = policy.gamma, model.device
    trajectories = world.trajectories(JUDGED, seed=0)
    # The sampled policy, whose value the critic has learned.
    act = policy_actor(model, deterministic=False)
    observations, first = trajectories.reset(), np.ones(JUDGED, dtype=np.bool_)
    start = value(th.as_tensor(observations, device=device)).cpu().numpy()
    entropy = entropy_coefficient * float(getattr(model, "target_entropy", 0.0))
    earned, running, discount = np.zeros(JUDGED), first.copy(), 1.0
    while running.any():
        step = trajectories.step(act(observations, first))
        earned[running] += discount * (step.rewards[running] + entropy)
        largest = max(largest, float(np.abs(step.rewards[running]).max()) + abs(entropy))
        discount *= gamma
        stopped = running & step.truncated & ~step.terminated
        if stopped.any():
            rest = value(th.as_tensor(step.observations, device=device)).cpu().numpy()
            earned[stopped] += discount * rest[stopped]
        running &= ~(step.terminated | step.truncated)
        observations, first = step.observations, np.zeros_like(first)
    bound = largest / (1 - gamma) if gamma < 1 else float("inf")
    return CriticMeasures(float(start.mean()), float(earned.mean()), float(earned.std()), bound)
