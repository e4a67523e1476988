"""The improved cross-entropy method."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, TypeAlias

import torch as th
from pydantic import Field

from sb3_hucrl.checks import Count, Fraction, NotNegative, validated
from sb3_hucrl.planning.base import Particles
from sb3_hucrl.planning.cem import CEM, Elites, Smoothing
from sb3_hucrl.planning.proposal import Proposal

Decay: TypeAlias = Annotated[float, Field(ge=1, description="a finite number of at least 1")]


@validated
class ICEM(CEM):
    """
    Improved cross-entropy method (Pinneri et al. 2020), which needs a fraction of CEM's particles.

    Its noise is correlated in time. Some elites are kept for the next iteration and the next real step. Later
    iterations have fewer particles. The last iteration also tries the proposal's mean.

    :param num_particles: sequences per environment in the first iteration
    :param num_iterations: updates of the proposal
    :param num_elites: number of the best sequences that the update uses, at least 2
    :param smoothing: weight of the old proposal in the new one, in [0, 1)
    :param noise_exponent: the noise's power falls with its frequency f as f^-noise_exponent; 0 is white noise
    :param decay: the number of particles is divided by it in each iteration, down to twice the number of elites
    :param kept_fraction: fraction of the elites that are kept, in [0, 1]
    :raises ValueError: if a number is out of its range, or there are more elites than particles
    """

    def __init__(
        self,
        num_particles: Count = 128,
        num_iterations: Count = 5,
        num_elites: Elites = 12,
        smoothing: Smoothing = 0.1,
        noise_exponent: NotNegative = 2.0,
        decay: Decay = 1.25,
        kept_fraction: Fraction = 0.3,
    ) -> None:
        super().__init__(num_particles, num_iterations, num_elites, smoothing, noise_exponent)
        self.decay = decay
        self.kept_fraction = kept_fraction

    def sample(self, proposal: Proposal, iteration: int, generator: th.Generator | None) -> th.Tensor:
        n = max(int(self.num_particles * self.decay**-iteration), min(2 * self.num_elites, self.num_particles))
        particles = [proposal.perturbed(n, self.noise_exponent, generator)]
        if proposal.kept is not None:
            particles.append(proposal.kept)
        if iteration == self.num_iterations - 1:
            particles.append(proposal.mean.unsqueeze(1))
        return th.cat(particles, dim=1)

    def update_distribution(self, proposal: Proposal, elites: Particles) -> Proposal:
        num_kept = int(self.kept_fraction * self.num_elites)
        kept = elites.actions[:, :num_kept] if num_kept else None
        return replace(super().update_distribution(proposal, elites), kept=kept)
