"""Sparse Gaussian processes, for more transitions than an exact Gaussian process can handle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import torch as th
from gpytorch.kernels import Kernel

from sb3_hucrl.checks import Count, Natural, validated
from sb3_hucrl.dynamics.cholesky import safe_cholesky
from sb3_hucrl.dynamics.gp import GaussianProcess, Posterior

#: added to the diagonal of the inducing points' kernel matrix, relative to the prior variance, to condition it well
JITTER = 1e-8


@dataclass(frozen=True)
class SparsePosterior:
    """
    Titsias' variational posterior (2009, equation 6) in the factorisation of Matthews et al.:
    L Lᵀ = K_zz, A = L⁻¹ K_zx / σ, R Rᵀ = I + A Aᵀ.

    :param kernel: a batch of k kernels
    :param centres: inducing points z, shape (1, m, d)
    :param prior_cholesky: L, shape (k, m, m)
    :param data_cholesky: R, shape (k, m, m)
    :param projection: R⁻¹ A y / σ, shape (p, m, 1)
    """

    kernel: Kernel
    centres: th.Tensor
    prior_cholesky: th.Tensor
    data_cholesky: th.Tensor
    projection: th.Tensor

    @classmethod
    def condition(
        cls,
        kernel: Kernel,
        centres: th.Tensor,
        inputs: th.Tensor,
        targets: th.Tensor,
        noise_variance: th.Tensor,
    ) -> SparsePosterior:
        """
        Factorise the kernel matrices of the data.

        :param kernel: a batch of k kernels
        :param centres: inducing points, shape (m, d)
        :param inputs: shape (n, d)
        :param targets: shape (n, p)
        :param noise_variance: σ², shape (k, 1)
        :raises ValueError: if a kernel matrix is not positive definite
        """
        noise_std = noise_variance.sqrt().unsqueeze(-1)
        prior = kernel(centres).to_dense()
        jitter = JITTER * kernel(centres, diag=True)
        prior_cholesky = safe_cholesky(prior + th.diag_embed(jitter))
        cross = kernel(centres, inputs).to_dense()
        whitened = th.linalg.solve_triangular(prior_cholesky, cross, upper=False) / noise_std
        eye = th.eye(len(centres)).to(whitened)
        data_cholesky = safe_cholesky(eye + whitened @ whitened.mT)
        projection = th.linalg.solve_triangular(
            data_cholesky, whitened @ targets.T.unsqueeze(-1) / noise_std, upper=False
        )
        return cls(kernel, centres.unsqueeze(0), prior_cholesky, data_cholesky, projection)

    def moments(self, inputs: th.Tensor) -> tuple[th.Tensor, th.Tensor]:
        cross = self.kernel(self.centres, inputs).to_dense()
        prior = th.linalg.solve_triangular(self.prior_cholesky, cross, upper=False)
        data = th.linalg.solve_triangular(self.data_cholesky, prior, upper=False)
        mean = (self.projection.mT @ data).squeeze(1)
        variance = self.kernel(inputs, diag=True) - prior.square().sum(dim=1) + data.square().sum(dim=1)
        return mean, variance.clamp(min=1e-12).sqrt()

    def update_weights(self, prior: Callable[[th.Tensor], th.Tensor], generator: th.Generator) -> th.Tensor:
        values = prior(self.centres)
        noise = th.randn(values.shape, generator=generator, dtype=values.dtype).to(values.device)
        # A sample of the function at the inducing points: L R⁻ᵀ (R⁻¹ A y / σ + ε).
        whitened = th.linalg.solve_triangular(self.data_cholesky.mT, self.projection + noise.unsqueeze(-1), upper=True)
        sample = self.prior_cholesky @ whitened
        return th.cholesky_solve(sample - values.unsqueeze(-1), self.prior_cholesky).squeeze(-1)

    @property
    def information_gain(self) -> float:
        gains = self.data_cholesky.diagonal(dim1=-2, dim2=-1).log().sum(dim=-1)
        return float(gains.expand(len(self.projection)).sum())


@th.no_grad()
def choose_inducing_points(kernel: Kernel, inputs: th.Tensor, num_points: int, tolerance: float) -> th.Tensor:
    """
    Choose the input with the largest remaining variance, again and again: a pivoted Cholesky factorisation (Burt et al.
    2020, section 4.3) of the average kernel.

    :param kernel: a batch of k kernels
    :param inputs: shape (n, d)
    :param num_points: largest number of inducing points
    :param tolerance: stop when every input's remaining variance is below this fraction of the prior variance
    :return: indices of the chosen inputs, shape (m,)
    """
    remaining = kernel(inputs, diag=True).mean(dim=0)
    prior = remaining.max()
    rank = min(num_points, len(inputs))
    factor = th.zeros(rank, len(inputs)).to(inputs)
    chosen: list[int] = []
    for row in range(rank):
        pivot = int(remaining.argmax())
        if row > 0 and remaining[pivot] < tolerance * prior:
            break
        chosen.append(pivot)
        column = kernel(inputs, inputs[pivot : pivot + 1]).to_dense().mean(dim=0).squeeze(-1)
        factor[row] = (column - factor[:row, pivot] @ factor[:row]) / remaining[pivot].sqrt()
        remaining = (remaining - factor[row].square()).clamp(min=0)
    return th.tensor(chosen, device=inputs.device)


@validated
class SparseGP(GaussianProcess):
    """
    Gaussian processes that approximate the posterior with m inducing points, chosen from the n transitions in each fit,
    which takes O(n m²) time.

    :param num_inducing: largest m
    :param settings: further arguments of :class:`sb3_hucrl.dynamics.gp.GaussianProcess`
    :raises ValueError: if there is no inducing point or a scale is not positive
    """

    #: below this fraction of the prior variance, a further inducing point would add only rounding errors
    tolerance = 1e-7

    def __init__(
        self,
        state_dim: Count,
        action_dim: Count,
        angle_dims: Sequence[Natural] = (),
        num_inducing: Count = 300,
        **settings: Any,
    ) -> None:
        super().__init__(state_dim, action_dim, angle_dims, **settings)
        self.num_inducing = num_inducing

    def _condition(self, inputs: th.Tensor, targets: th.Tensor) -> Posterior:
        chosen = choose_inducing_points(self.kernel, inputs, self.num_inducing, self.tolerance)
        return SparsePosterior.condition(self.kernel, inputs[chosen], inputs, targets, self.noise_variance)
