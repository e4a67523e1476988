"""The improved cross-entropy method."""

from __future__ import annotations

from dataclasses import replace

import torch as th

from sb3_hucrl.planning.base import Particles, Proposal, perturbed
from sb3_hucrl.planning.cem import CEM


class ICEM(CEM):
    """
    Improved cross-entropy method (Pinneri et al. 2020), which needs a fraction of CEM's particles.

    Its noise is correlated in time, some elites are tried again in the next iteration and at the next real step, later
    iterations have fewer particles, and the last one tries the proposal's mean.

    :param num_particles: sequences per environment in the first iteration
    :param num_iterations: updates of the proposal
    :param num_elites: how many of the best sequences the update sees, at least 2
    :param smoothing: share of the old proposal in the new one, in [0, 1)
    :param noise_exponent: the noise's power falls with its frequency f as f^-noise_exponent; 0 is white
    :param decay: each iteration has this many times fewer particles than the one before, and at least twice the elites
    :param kept_fraction: share of the elites that are tried again, in [0, 1]
    :raises ValueError: if a number is out of its range, or there are more elites than particles
    """

    def __init__(
        self,
        num_particles: int = 128,
        num_iterations: int = 5,
        num_elites: int = 12,
        smoothing: float = 0.1,
        noise_exponent: float = 2.0,
        decay: float = 1.25,
        kept_fraction: float = 0.3,
    ) -> None:
        super().__init__(num_particles, num_iterations, num_elites, smoothing)
        if noise_exponent < 0 or decay < 1 or not 0 <= kept_fraction <= 1:
            raise ValueError(
                f"noise_exponent is {noise_exponent}, decay {decay}, kept_fraction {kept_fraction}: give 0 or more, 1 "
                "or more, and a share between 0 and 1"
            )
        self.noise_exponent = noise_exponent
        self.decay = decay
        self.kept_fraction = kept_fraction

    def sample(self, proposal: Proposal, iteration: int, generator: th.Generator | None) -> th.Tensor:
        n = max(int(self.num_particles * self.decay**-iteration), min(2 * self.num_elites, self.num_particles))
        num_envs, horizon, dim = proposal.mean.shape
        noise = colored_noise((num_envs, n, dim, horizon), self.noise_exponent, proposal.mean, generator).transpose(
            2, 3
        )
        particles = [perturbed(proposal, noise)]
        if proposal.kept is not None:
            particles.append(proposal.kept)
        if iteration == self.num_iterations - 1:
            particles.append(proposal.mean.unsqueeze(1))
        return th.cat(particles, dim=1)

    def update_distribution(self, proposal: Proposal, elites: Particles) -> Proposal:
        num_kept = int(self.kept_fraction * self.num_elites)
        kept = elites.actions[:, :num_kept] if num_kept else None
        return replace(super().update_distribution(proposal, elites), kept=kept)


def colored_noise(
    shape: tuple[int, ...], exponent: float, like: th.Tensor, generator: th.Generator | None
) -> th.Tensor:
    """
    Gaussian noise of variance 1 whose power falls with its frequency f as f^-exponent along the last dimension, drawn
    in the frequency domain (Timmer and Koenig 1995).

    :param shape: of the noise
    :param exponent: 0 is white, 1 pink, 2 red
    :param like: of the wanted device and dtype
    :param generator: draws, on that device
    :return: of the given shape
    """
    length = shape[-1]
    frequency = th.fft.rfftfreq(length, device=like.device, dtype=like.dtype)
    # Below the lowest frequency that fits there is only the mean: it gets that frequency's power.
    frequency[0] = 1 / length
    amplitude = frequency ** (-exponent / 2)
    real, imaginary = th.randn(
        (2, *shape[:-1], len(frequency)), generator=generator, device=like.device, dtype=like.dtype
    )
    # A real signal has no phase at frequency 0, nor at the highest of an even length: all power is real.
    no_phase = th.zeros(len(frequency), dtype=th.bool, device=like.device)
    no_phase[0] = True
    no_phase[-1] |= length % 2 == 0
    real, imaginary = real * th.where(no_phase, 2**0.5, 1.0), imaginary * ~no_phase
    # Each frequency but those counts twice, once for its negative.
    power = (amplitude.square() * th.where(no_phase, 1.0, 2.0)).sum() * 2
    return th.fft.irfft(th.complex(real, imaginary) * amplitude, n=length, norm="forward") / power.sqrt()
