"""Information gain of observations of a Gaussian process (appendix F.1)."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch as th

from sb3_hucrl.checks import Count, Positive, validated

#: kernel matrix of points, maps (m, d) and (n, d) to (m, n)
KernelFunction = Callable[[th.Tensor, th.Tensor], th.Tensor]


@validated
def information_gain(kernel_matrix: th.Tensor, noise_std: Positive) -> float:
    """
    The information gain I(y; f) = ``½ ln |I + K / σ²|``, equation (63).

    :param kernel_matrix: K of the observed points, shape (n, n)
    :param noise_std: σ
    :return: in nats
    """
    identity = th.eye(len(kernel_matrix), dtype=kernel_matrix.dtype, device=kernel_matrix.device)
    return 0.5 * float(th.logdet(identity + kernel_matrix / noise_std**2))


@validated
def greedy_information_gains(
    kernel: KernelFunction, candidates: th.Tensor, noise_std: Positive, num_observations: Count
) -> th.Tensor:
    """
    Information gains of a greedy sequence of observations, each at the largest posterior variance. A point may be
    observed more than once.

    :param kernel: kernel of the Gaussian process
    :param candidates: points that can be observed, shape (m, d)
    :param noise_std: σ
    :param num_observations: t
    :return: I(y; f) after 1 to t observations, shape (t,)
    """
    covariance = kernel(candidates, candidates).double().clone()
    gains = th.empty(num_observations, dtype=th.float64)
    total = 0.0
    for n in range(num_observations):
        variances = covariance.diagonal()
        best = int(variances.argmax())
        total += 0.5 * math.log1p(max(0.0, float(variances[best])) / noise_std**2)
        gains[n] = total
        column = covariance[:, best].clone()
        covariance -= th.outer(column, column) / (column[best] + noise_std**2)
    return gains


@validated
def information_capacity(
    kernel: KernelFunction, candidates: th.Tensor, noise_std: Positive, num_observations: Count
) -> float:
    """
    Upper bound on γ_t of equation (64) over the candidates. The information gain is monotone and submodular, so the
    greedy sequence reaches at least 1 - 1/e of its maximum (Nemhauser et al. 1978; Srinivas et al. 2012).

    :param kernel: kernel of the Gaussian process
    :param candidates: points that can be observed, shape (m, d)
    :param noise_std: σ
    :param num_observations: t
    """
    gains = greedy_information_gains(kernel, candidates, noise_std, num_observations)
    return float(gains[-1]) / (1 - math.exp(-1))
