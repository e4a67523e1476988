"""Algorithm 6: what all planners by random sampling have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import torch as th

#: returns J of action sequences: (B, n, N, d) to (B, n)
Objective = Callable[[th.Tensor], th.Tensor]


@dataclass(frozen=True)
class Bounds:
    """
    Limits of an action with its hallucinated part, which lies in [-1, 1].

    :param low: shape (d,)
    :param high: shape (d,)
    :raises ValueError: if they are not finite, or a lower one is not below its upper one
    """

    low: th.Tensor
    high: th.Tensor

    def __post_init__(self) -> None:
        if not (th.isfinite(self.low).all() and th.isfinite(self.high).all() and (self.low < self.high).all()):
            raise ValueError(
                f"action bounds are {self.low.tolist()} and {self.high.tolist()}: planners need finite ones, "
                "each lower one below its upper one"
            )

    def clip(self, actions: th.Tensor) -> th.Tensor:
        """The nearest actions within the limits, shape of ``actions`` (..., d)."""
        return actions.clamp(self.low, self.high)


@dataclass(frozen=True)
class Proposal:
    """
    d(·) of Algorithm 6: Gaussians over the action sequences of B environments, independent by dimension.

    :param mean: shape (B, N, d)
    :param std: shape (B, N, d)
    :param kept: sequences worth trying again, shape (B, k, N, d); None for none
    """

    mean: th.Tensor
    std: th.Tensor
    kept: th.Tensor | None = None

    @staticmethod
    def within(bounds: Bounds, num_envs: int, horizon: int) -> Proposal:
        """
        Centred, with a standard deviation of a quarter of the range (as in PETS, Chua et al. 2018).

        :param bounds: of the actions
        :param num_envs: B
        :param horizon: N
        :raises ValueError: if the horizon is below 1
        """
        if horizon < 1:
            raise ValueError(f"horizon is {horizon}: a plan needs at least 1 step")
        shape = (num_envs, horizon, len(bounds.low))
        return Proposal(
            mean=((bounds.low + bounds.high) / 2).expand(shape), std=((bounds.high - bounds.low) / 4).expand(shape)
        )

    def expanded(self, num_envs: int) -> Proposal:
        """The same for each of ``num_envs`` environments, from a proposal for one that keeps no sequences."""
        shape = (num_envs, *self.mean.shape[1:])
        return Proposal(self.mean.expand(shape), self.std.expand(shape))

    def restarted(self, begun: th.Tensor, fresh: Proposal) -> Proposal:
        """
        :param begun: environments whose episode has just begun, shape (B,)
        :param fresh: takes their place
        """
        rows = begun[:, None, None]
        kept = self.kept
        if kept is not None:
            kept = th.where(rows[..., None], fresh.mean.unsqueeze(1), kept)
        return Proposal(th.where(rows, fresh.mean, self.mean), th.where(rows, fresh.std, self.std), kept)

    def shifted(self, fresh: Proposal) -> Proposal:
        """
        The proposal for the next real step: what was planned for it comes first, the last step begins anew.

        :param fresh: gives the mean of the last step, and all standard deviations
        """
        kept = self.kept
        if kept is not None:
            kept = th.cat([kept[:, :, 1:], kept[:, :, -1:]], dim=2)
        return Proposal(mean=th.cat([self.mean[:, 1:], fresh.mean[:, -1:]], dim=1), std=fresh.std, kept=kept)


@dataclass(frozen=True)
class Particles:
    """
    Action sequences and what they return, for B environments.

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
    :param proposal: what the search ended with, to begin the next one
    """

    actions: th.Tensor
    returns: th.Tensor
    proposal: Proposal


class ShootingPlanner(ABC):
    """
    Hallucinated shooting (Algorithm 6): sample action sequences, keep the elites, move the proposal to them.

    :param num_particles: sequences per environment and iteration
    :param num_iterations: updates of the proposal
    :param num_elites: how many of the best sequences the update sees
    :raises ValueError: if a number is below 1, or there are more elites than particles
    """

    def __init__(self, num_particles: int, num_iterations: int, num_elites: int) -> None:
        if min(num_particles, num_iterations, num_elites) < 1:
            raise ValueError(
                f"num_particles is {num_particles}, num_iterations {num_iterations}, num_elites {num_elites}: give 1 "
                "or more"
            )
        if num_elites > num_particles:
            raise ValueError(
                f"num_elites is {num_elites} of num_particles {num_particles}: elites are chosen among the particles, "
                "so give at most as many"
            )
        self.num_particles = num_particles
        self.num_iterations = num_iterations
        self.num_elites = num_elites

    def sample(self, proposal: Proposal, iteration: int, generator: th.Generator | None) -> th.Tensor:
        """
        :param proposal: d(·)
        :param iteration: from 0
        :param generator: draws, on the proposal's device
        :return: action sequences that may exceed their bounds, shape (B, n, N, d)
        """
        mean = proposal.mean
        num_envs, horizon, dim = mean.shape
        shape = (num_envs, self.num_particles, horizon, dim)
        return perturbed(proposal, th.randn(shape, generator=generator, device=mean.device, dtype=mean.dtype))

    def elite_actions(self, particles: Particles) -> Particles:
        """
        EliteActions of Algorithm 6.

        :param particles: all of this iteration
        :return: those with the highest returns, the best first
        """
        returns, indices = particles.returns.topk(self.num_elites, dim=1)
        return Particles(_pick(particles.actions, indices), returns)

    @abstractmethod
    def update_distribution(self, proposal: Proposal, elites: Particles) -> Proposal:
        """
        UpdateDistribution of Algorithm 6.

        :param proposal: which the particles were drawn from
        :param elites: the best of them
        :return: from which the next are drawn
        """

    @th.no_grad()
    def plan(
        self, objective: Objective, proposal: Proposal, bounds: Bounds, generator: th.Generator | None = None
    ) -> Plan:
        """
        :param objective: returns of action sequences within the bounds
        :param proposal: where to begin
        :param bounds: of the actions
        :param generator: the source of all randomness, on the proposal's device
        :return: the best sequence of all iterations
        :raises ValueError: if a return is not finite
        """
        best: Plan | None = None
        for iteration in range(self.num_iterations):
            actions = bounds.clip(self.sample(proposal, iteration, generator))
            returns = objective(actions)
            if not th.isfinite(returns).all():
                raise ValueError(
                    f"a planned return is not finite in iteration {iteration}: the dynamics model has diverged; "
                    "shorten the horizon, or collect more real episodes"
                )
            particles = Particles(actions, returns)
            proposal = self.update_distribution(proposal, self.elite_actions(particles))
            best = _better(best, particles, proposal)
        assert best is not None  # there is at least one iteration
        return best


def perturbed(proposal: Proposal, noise: th.Tensor) -> th.Tensor:
    """
    :param proposal: d(·)
    :param noise: of mean 0 and variance 1, shape (B, n, N, d)
    :return: n sequences for each environment, shape (B, n, N, d)
    """
    return th.addcmul(proposal.mean.unsqueeze(1), proposal.std.unsqueeze(1), noise)


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
