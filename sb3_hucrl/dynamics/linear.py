"""Incremental Bayesian linear regression in closed form."""

from __future__ import annotations

import math

import torch as th
from torch import nn

from sb3_hucrl.dynamics.cholesky import safe_cholesky


class BayesianLinearRegression(nn.Module):
    """
    The model y = Φ w + ε with w ~ N(0, v I) and ε ~ N(0, σ²), for several outputs that share Φ (Bishop 2006, section
    3.3).

    The posterior is N(A⁻¹ Φᵀ y / σ², A⁻¹) with the precision A = Φᵀ Φ / σ² + I / v. The sums A and Φᵀ y are stored, and
    new rows are added to them. All linear algebra is in float64.

    :param num_features: number of columns of Φ
    :param num_outputs: number of columns of y
    :param prior_variance: v
    :param noise_std: σ
    """

    precision: th.Tensor
    projection: th.Tensor
    cholesky: th.Tensor
    mean: th.Tensor

    def __init__(self, num_features: int, num_outputs: int, prior_variance: float, noise_std: float) -> None:
        super().__init__()
        self.prior_variance = prior_variance
        self.noise_variance = noise_std**2
        eye = th.eye(num_features, dtype=th.float64)
        self.register_buffer("precision", eye / prior_variance)
        self.register_buffer("projection", th.zeros(num_features, num_outputs, dtype=th.float64))
        #: lower Cholesky factor of the precision
        self.register_buffer("cholesky", eye / math.sqrt(prior_variance))
        #: posterior mean of the weights, shape (features, outputs)
        self.register_buffer("mean", th.zeros(num_features, num_outputs, dtype=th.float64))

    def reset(self) -> None:
        """Forget all data."""
        self.precision.copy_(th.eye(len(self.precision)) / self.prior_variance)
        self.projection.zero_()

    def update(self, features: th.Tensor, targets: th.Tensor) -> None:
        """
        Add data.

        :param features: rows of Φ, shape (n, features)
        :param targets: rows of y, shape (n, outputs)
        :raises ValueError: if the precision is not positive definite
        """
        self.precision.addmm_(features.T, features, alpha=1 / self.noise_variance)
        self.projection.addmm_(features.T, targets)
        self.cholesky.copy_(safe_cholesky(self.precision))
        self.mean.copy_(th.cholesky_solve(self.projection, self.cholesky) / self.noise_variance)

    def predict(self, features: th.Tensor) -> tuple[th.Tensor, th.Tensor]:
        """
        :param features: shape (B, features)
        :return: posterior mean of Φ w, shape (B, outputs), and its standard deviation, shape (B, 1)
        """
        whitened = th.linalg.solve_triangular(self.cholesky, features.T, upper=False)
        return features @ self.mean, whitened.square().sum(dim=0).sqrt().unsqueeze(-1)

    def sample_weights(self, num_samples: int, generator: th.Generator) -> th.Tensor:
        """
        Draw weights from their posterior.

        :param num_samples: S
        :param generator: draws the weights, on the CPU
        :return: samples of w, shape (S, features, outputs)
        """
        noise = th.randn(num_samples, *self.mean.shape, generator=generator, dtype=th.float64).to(self.mean.device)
        deviation: th.Tensor = th.linalg.solve_triangular(self.cholesky.T, noise, upper=True)
        return self.mean + deviation

    def information_gain(self) -> float:
        """I(y; f) of equation (63) for one output, ``½ ln |I + v Φᵀ Φ / σ²|``, in nats."""
        log_diagonal = self.cholesky.diagonal().log().sum()
        return float(log_diagonal + 0.5 * len(self.mean) * math.log(self.prior_variance))
