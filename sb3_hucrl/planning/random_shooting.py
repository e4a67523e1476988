"""Random shooting."""

from __future__ import annotations

from sb3_hucrl.planning.base import Particles, Proposal, ShootingPlanner


class RandomShooting(ShootingPlanner):
    """
    The best of many independent action sequences (Richards and How 2006); the proposal stays as it is.

    :param num_particles: sequences per environment
    """

    def __init__(self, num_particles: int = 2000) -> None:
        super().__init__(num_particles, num_iterations=1, num_elites=1)

    def update_distribution(self, proposal: Proposal, elites: Particles) -> Proposal:
        return proposal
