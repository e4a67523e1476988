"""Calibration of predicted uncertainty, and recalibration."""

from __future__ import annotations

from dataclasses import dataclass

import torch as th

#: confidence levels at which coverage is measured
LEVELS = th.linspace(0.05, 0.95, 19)

#: recalibration multiplies or divides standard deviations by at most this factor
MAX_SCALE = 100.0

#: with fewer held-out transitions, a scale would fit their noise
MIN_HOLDOUT = 20


@dataclass(frozen=True)
class Calibration:
    """
    Calibration of a model on held-out transitions.

    :param coverage: fraction of errors below the predicted quantile at each of :data:`LEVELS`, shape (levels, p)
    :param error: :func:`calibration_error`, shape (p,)
    :param raw_error: the same before recalibration, shape (p,)
    :param scale: factor that recalibration applies to the standard deviations, shape (p,)
    """

    coverage: th.Tensor
    error: th.Tensor
    raw_error: th.Tensor
    scale: th.Tensor

    @classmethod
    def measure(cls, error: th.Tensor, std: th.Tensor, scale: th.Tensor) -> Calibration:
        """
        :param error: observed minus predicted on held-out transitions, shape (n, p)
        :param std: predicted standard deviation before recalibration, shape (n, p)
        :param scale: recalibration factor, shape (p,)
        """
        coverage, raw_coverage = reliability(error, scale * std), reliability(error, std)
        results = (coverage, calibration_error(coverage), calibration_error(raw_coverage), scale.clone())
        return cls(*(result.cpu() for result in results))


def gaussian_nll(error: th.Tensor, std: th.Tensor) -> th.Tensor:
    """
    Negative log-likelihood of independent normal errors, summed over dimensions.

    :param error: observed minus predicted, shape (n, p)
    :param std: predicted standard deviation, shape (n, p)
    :return: nats per row, shape (n,)
    """
    log_density: th.Tensor = th.distributions.Normal(th.zeros_like(std), std).log_prob(error)
    return -log_density.sum(dim=-1)


def reliability(error: th.Tensor, std: th.Tensor) -> th.Tensor:
    """
    The reliability curve: a calibrated model has a fraction c of its errors below the predicted c-quantile (Kuleshov et
    al. 2018, equation 3).

    :param error: observed minus predicted, shape (n, p)
    :param std: predicted standard deviation, shape (..., n, p)
    :return: coverage at each of :data:`LEVELS`, shape (..., levels, p)
    """
    quantile = th.special.ndtr(error / std)
    levels = LEVELS.to(error)
    return th.stack([(quantile <= level).to(error.dtype).mean(dim=-2) for level in levels], dim=-2)


def calibration_error(coverage: th.Tensor) -> th.Tensor:
    """
    Mean absolute difference of confidence and coverage: 0 is perfect; an unbiased model whose standard deviation is
    far too small or far too large has 0.25.

    :param coverage: a :func:`reliability` curve, shape (..., levels, p)
    :return: one value per dimension, shape (..., p)
    """
    return (coverage - LEVELS.to(coverage).unsqueeze(-1)).abs().mean(dim=-2)


def recalibration_scale(error: th.Tensor, std: th.Tensor) -> th.Tensor:
    """
    The factor of the predicted std that minimises the calibration error, per dimension (the one-parameter case of
    Kuleshov et al. 2018; in model-based RL: Malik et al. 2019). It is 1 if no other factor is better.

    :param error: observed minus predicted on held-out transitions, shape (n, p)
    :param std: predicted standard deviation, shape (n, p)
    :return: shape (p,), between 1 / :data:`MAX_SCALE` and :data:`MAX_SCALE`
    """
    if len(error) < MIN_HOLDOUT:
        return th.ones_like(error[0])
    steps = th.linspace(0, 1, 41)
    # Sorted by distance from 1, so that argmin picks the mildest of equally good factors.
    factors = MAX_SCALE ** th.stack([steps, -steps], dim=1).flatten()[1:].to(error)
    errors = calibration_error(reliability(error, factors.view(-1, 1, 1) * std))
    return factors[errors.argmin(dim=0)]
