"""The base class of all planners, and that of planners by sampling (Algorithm 6)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import torch as th

from sb3_hucrl.checks import ArgumentError, Count, NotNegative, validated
from sb3_hucrl.planning.problem import ImaginedReturns
from sb3_hucrl.planning.proposal import Bounds, Proposal

#: returns J of action sequences: (B, n, N, d) to (B, n)
Objective = Callable[[th.Tensor], th.Tensor]


@dataclass(frozen=True)
class Particles:
    """
    Action sequences and their imagined returns, for B environments.

    :param actions: shape (B, n, N, d)
    :param returns: shape (B, n)
    """

    actions: th.Tensor
    returns: th.Tensor


@dataclass(frozen=True)
class Plan:
    """
    The best action sequence that was found for each of B environments.

    :param actions: shape (B, N, d)
    :param returns: shape (B,)
    :param proposal: with which the search ended; the next search begins with it
    """

    actions: th.Tensor
    returns: th.Tensor
    proposal: Proposal


class Planner(ABC):
    """Maximises the return of the next N steps, for B environments at once."""

    @abstractmethod
    def plan(
        self, objective: ImaginedReturns, proposal: Proposal, bounds: Bounds, generator: th.Generator | None = None
    ) -> Plan:
        """
        :param objective: returns of plans within the bounds
        :param proposal: where to begin
        :param bounds: of the decision variables
        :param generator: the source of the planner's own randomness, on the proposal's device
        :return: the best plan that was found
        :raises ValueError: if no return is finite
        """


@validated
class ShootingPlanner(Planner):
    """
    Hallucinated shooting (Algorithm 6): sample action sequences, and move the proposal to the best of them (elites).

    :param num_particles: sequences per environment and iteration
    :param num_iterations: updates of the proposal
    :param num_elites: number of the best sequences that the update uses
    :param noise_exponent: the noise's power falls with its frequency f as f^-noise_exponent; 0 is white noise, which
        cancels out over many short steps, 2 explores further
    :raises ValueError: if a number is out of its range, or there are more elites than particles
    """

    def __init__(
        self, num_particles: Count, num_iterations: Count, num_elites: Count, noise_exponent: NotNegative
    ) -> None:
        if num_elites > num_particles:
            raise ArgumentError.of_value(
                "num_elites", num_elites, f"at most num_particles, {num_particles}, among which elites are chosen"
            )
        self.num_particles = num_particles
        self.num_iterations = num_iterations
        self.num_elites = num_elites
        self.noise_exponent = noise_exponent

    def sample(self, proposal: Proposal, iteration: int, generator: th.Generator | None) -> th.Tensor:
        """
        :param proposal: d(·)
        :param iteration: from 0
        :param generator: draws, on the proposal's device
        :return: action sequences, which may exceed the bounds, with those kept from before, shape (B, n, N, d)
        """
        particles = proposal.perturbed(self.num_particles, self.noise_exponent, generator)
        return particles if proposal.kept is None else th.cat([particles, proposal.kept], dim=1)

    def elite_actions(self, particles: Particles) -> Particles:
        """
        EliteActions of Algorithm 6.

        :param particles: all particles of this iteration
        :return: those with the highest returns, the best first
        """
        returns, indices = particles.returns.topk(self.num_elites, dim=1)
        return Particles(_pick(particles.actions, indices), returns)

    @abstractmethod
    def update_distribution(self, proposal: Proposal, elites: Particles) -> Proposal:
        """
        UpdateDistribution of Algorithm 6.

        :param proposal: from which the particles were drawn
        :param elites: the best of them
        :return: the proposal of the next iteration
        """

    @th.inference_mode()
    def plan(
        self, objective: Objective, proposal: Proposal, bounds: Bounds, generator: th.Generator | None = None
    ) -> Plan:
        best: Plan | None = None
        for iteration in range(self.num_iterations):
            actions = bounds.clip(self.sample(proposal, iteration, generator))
            returns = without_diverged(objective(actions))
            particles = Particles(actions, returns)
            proposal = self.update_distribution(proposal, self.elite_actions(particles))
            best = _better(best, particles, proposal)
        assert best is not None  # there is at least one iteration
        return best


def without_diverged(returns: th.Tensor) -> th.Tensor:
    """
    :param returns: of n plans for each of B environments, shape (B, n)
    :return: the same, with -∞ for plans on which the model diverged
    :raises ValueError: if it diverged on all plans of an environment
    """
    finite = th.isfinite(returns)
    if not finite.any(dim=1).all():
        raise ValueError(
            "no planned return is finite: either the task's reward is not, or the dynamics model has diverged; shorten "
            "the planner's horizon, or collect more real episodes"
        )
    return returns.masked_fill(~finite, -th.inf)


def _pick(actions: th.Tensor, indices: th.Tensor) -> th.Tensor:
    return actions.gather(1, indices[..., None, None].expand(-1, -1, *actions.shape[2:]))


def _better(best: Plan | None, particles: Particles, proposal: Proposal) -> Plan:
    returns, indices = particles.returns.max(dim=1)
    actions = _pick(particles.actions, indices.unsqueeze(1)).squeeze(1)
    if best is None:
        return Plan(actions, returns, proposal)
    improved = returns > best.returns
    return Plan(
        actions=th.where(improved[:, None, None], actions, best.actions),
        returns=th.where(improved, returns, best.returns),
        proposal=proposal,
    )
