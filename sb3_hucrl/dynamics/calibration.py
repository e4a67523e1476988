"""How well predicted uncertainty matches the errors that are made."""

from __future__ import annotations

import torch as th

CONFIDENCE_LEVELS = 19


def gaussian_nll(error: th.Tensor, std: th.Tensor) -> th.Tensor:
    """
    Negative log-density of independent normal errors, summed over dimensions.

    :param error: observed minus predicted, shape (n, p)
    :param std: predicted standard deviation, shape (n, p)
    :return: nats per row, shape (n,)
    """
    return -th.distributions.Normal(th.zeros_like(std), std).log_prob(error).sum(dim=-1)


def calibration_error(error: th.Tensor, std: th.Tensor) -> th.Tensor:
    """
    Mean gap between confidence and coverage (Kuleshov et al. 2018, with absolute instead of squared gaps).

    For each level c in {0.05, ..., 0.95} a calibrated model has a share c of its errors below the predicted
    c-quantile. 0 is perfect, 0.5 the worst.

    :param error: observed minus predicted, shape (n, p)
    :param std: predicted standard deviation, shape (n, p)
    :return: one value per dimension, shape (p,)
    """
    cdf = th.special.ndtr(error / std)
    levels = th.linspace(0, 1, CONFIDENCE_LEVELS + 2, device=error.device)[1:-1]
    coverage = (cdf.unsqueeze(-1) <= levels).float().mean(dim=0)
    return (coverage - levels).abs().mean(dim=-1)
