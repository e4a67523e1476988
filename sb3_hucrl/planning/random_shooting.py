"""Random shooting."""

from __future__ import annotations

from sb3_hucrl.checks import Count, NotNegative, validated
from sb3_hucrl.planning.base import Particles, ShootingPlanner
from sb3_hucrl.planning.proposal import Proposal


@validated
class RandomShooting(ShootingPlanner):
    """
    The best of many independent action sequences (Richards and How 2006); the proposal does not change.

    :param num_particles: sequences per environment
    :param noise_exponent: the noise's power falls with its frequency f as f^-noise_exponent; 0 is white noise
    :raises ValueError: if a number is out of its range
    """

    def __init__(self, num_particles: Count = 2000, noise_exponent: NotNegative = 0.0) -> None:
        super().__init__(num_particles, num_iterations=1, num_elites=1, noise_exponent=noise_exponent)

    def update_distribution(self, proposal: Proposal, elites: Particles) -> Proposal:
        return proposal
