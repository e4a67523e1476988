"""Noise that is correlated in time."""

from __future__ import annotations

import torch as th


def colored_noise(
    shape: tuple[int, ...], exponent: float, like: th.Tensor, generator: th.Generator | None
) -> th.Tensor:
    """
    Gaussian noise of variance 1 whose power falls with its frequency f as f^-exponent along the last dimension, drawn
    in the frequency domain (Timmer and Koenig 1995).

    :param shape: of the noise
    :param exponent: 0 is white, 1 pink, 2 red
    :param like: a tensor with the device and dtype of the noise
    :param generator: draws the noise, on that device
    :return: noise of the given shape
    """
    length = shape[-1]
    if exponent == 0 or length == 1:
        return th.randn(shape, generator=generator, device=like.device, dtype=like.dtype)
    frequency = th.fft.rfftfreq(length, device=like.device, dtype=like.dtype)
    # Frequency 0 is the mean, where f^-exponent is infinite: it gets the power of the lowest other frequency.
    frequency[0] = 1 / length
    amplitude = frequency ** (-exponent / 2)
    real, imaginary = th.randn(
        (2, *shape[:-1], len(frequency)), generator=generator, device=like.device, dtype=like.dtype
    )
    # A real signal has no phase at frequency 0, nor at the highest of an even length: there all power is real.
    no_phase = th.zeros(len(frequency), dtype=th.bool, device=like.device)
    no_phase[0] = True
    no_phase[-1] |= length % 2 == 0
    real, imaginary = real * th.where(no_phase, 2**0.5, 1.0), imaginary * ~no_phase
    # All other frequencies count twice, once for their negative.
    power = (amplitude.square() * th.where(no_phase, 1.0, 2.0)).sum() * 2
    noise: th.Tensor = th.fft.irfft(th.complex(real, imaginary) * amplitude, n=length, norm="forward") / power.sqrt()
    return noise
