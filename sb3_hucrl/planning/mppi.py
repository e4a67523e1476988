"""Model-predictive path integral control."""

from __future__ import annotations

from dataclasses import replace

from sb3_hucrl.checks import Count, NotNegative, Positive, validated
from sb3_hucrl.planning.base import Particles, ShootingPlanner
from sb3_hucrl.planning.proposal import Proposal


@validated
class MPPI(ShootingPlanner):
    """
    Model-predictive path integral control (Williams et al. 2016): the next mean is the mean of all sequences, weighted
    by exp(J / λ), where J is the return.

    The standard deviation is constant. Sequences are clipped to the bounds before they are averaged, so the mean does
    not reach the bounds.

    :param num_particles: sequences per environment and iteration
    :param num_iterations: updates of the proposal
    :param temperature: λ, in units of the return; with a small one only the best sequences count
    :param noise_exponent: the noise's power falls with its frequency f as f^-noise_exponent; 0 is white noise
    :raises ValueError: if a number is out of its range, or the temperature not positive
    """

    def __init__(
        self,
        num_particles: Count = 500,
        num_iterations: Count = 5,
        temperature: Positive = 1.0,
        noise_exponent: NotNegative = 0.0,
    ) -> None:
        super().__init__(num_particles, num_iterations, num_particles, noise_exponent)
        self.temperature = temperature

    def update_distribution(self, proposal: Proposal, elites: Particles) -> Proposal:
        weights = (elites.returns / self.temperature).softmax(dim=1)
        return replace(proposal, mean=(weights[..., None, None] * elites.actions).sum(dim=1))
