"""The cross-entropy method."""

from __future__ import annotations

from typing import Annotated, TypeAlias

from pydantic import Field

from sb3_hucrl.checks import Count, NotNegative, validated
from sb3_hucrl.planning.base import Particles, ShootingPlanner
from sb3_hucrl.planning.proposal import Proposal

#: one elite has no standard deviation
Elites: TypeAlias = Annotated[int, Field(ge=2, description="an integer of at least 2")]
Smoothing: TypeAlias = Annotated[float, Field(ge=0, lt=1, description="a number of at least 0 and below 1")]


@validated
class CEM(ShootingPlanner):
    """
    Cross-entropy method (Botev et al. 2013): the next proposal has the elites' mean and standard deviation.

    :param num_particles: sequences per environment and iteration
    :param num_iterations: updates of the proposal
    :param num_elites: number of the best sequences that the update uses, at least 2
    :param smoothing: weight of the old proposal in the new one, in [0, 1)
    :param noise_exponent: the noise's power falls with its frequency f as f^-noise_exponent; 0 is white noise
    :raises ValueError: if a number is out of its range, or there are more elites than particles
    """

    def __init__(
        self,
        num_particles: Count = 500,
        num_iterations: Count = 5,
        num_elites: Elites = 50,
        smoothing: Smoothing = 0.1,
        noise_exponent: NotNegative = 0.0,
    ) -> None:
        super().__init__(num_particles, num_iterations, num_elites, noise_exponent)
        self.smoothing = smoothing

    def update_distribution(self, proposal: Proposal, elites: Particles) -> Proposal:
        return Proposal(
            mean=elites.actions.mean(dim=1).lerp(proposal.mean, self.smoothing),
            std=elites.actions.std(dim=1).lerp(proposal.std, self.smoothing),
        )
