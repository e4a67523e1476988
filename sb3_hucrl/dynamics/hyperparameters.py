"""Kernel hyperparameters of maximum marginal likelihood, with GPyTorch."""

from __future__ import annotations

import torch as th
from gpytorch.constraints import GreaterThan
from gpytorch.distributions import MultivariateNormal
from gpytorch.kernels import Kernel, RBFKernel, ScaleKernel
from gpytorch.likelihoods import GaussianLikelihood
from gpytorch.means import ZeroMean
from gpytorch.mlls import ExactMarginalLogLikelihood
from gpytorch.models import ExactGP
from gpytorch.settings import fast_computations

#: largest number of transitions in the likelihood; of more, a random subset is used
MAX_POINTS = 300
#: iterations of L-BFGS, which works on the logarithms of the hyperparameters
MAX_ITERATIONS = 50
#: lower bound on the noise variance of a standardised target
MIN_NOISE_VARIANCE = 1e-6


def rbf_kernel(shape: th.Size, input_dim: int, lengthscale: float, outputscale: float) -> ScaleKernel:
    """
    Squared exponential kernel in float64 with one lengthscale per input; its parameters are stored as logarithms.

    :param shape: number of kernels
    :param input_dim: number of inputs
    :param lengthscale: initial lengthscale, in units of the inputs
    :param outputscale: prior standard deviation of the function
    """
    base = RBFKernel(ard_num_dims=input_dim, batch_shape=shape, lengthscale_constraint=_logarithmic(0.0))
    kernel = ScaleKernel(base, batch_shape=shape, outputscale_constraint=_logarithmic(0.0)).double()
    base.lengthscale = lengthscale
    kernel.outputscale = outputscale**2
    return kernel.requires_grad_(False)


def _logarithmic(lower_bound: float) -> GreaterThan:
    return GreaterThan(lower_bound, transform=th.exp, inv_transform=th.log)


class _Regression(ExactGP):  # type: ignore[misc]  # GPyTorch is untyped
    def __init__(self, kernel: Kernel, inputs: th.Tensor, targets: th.Tensor, likelihood: GaussianLikelihood) -> None:
        super().__init__(inputs, targets, likelihood)
        self.mean = ZeroMean()
        self.kernel = kernel

    def forward(self, inputs: th.Tensor) -> MultivariateNormal:
        return MultivariateNormal(self.mean(inputs), self.kernel(inputs))


def maximise_marginal_likelihood(
    kernel: Kernel, noise_variance: th.Tensor, inputs: th.Tensor, targets: th.Tensor, generator: th.Generator
) -> th.Tensor:
    """
    Maximise the exact log marginal likelihood by L-BFGS, starting from the current hyperparameters.

    :param kernel: a batch of p kernels, changed in place
    :param noise_variance: initial σ², shape (p, 1)
    :param inputs: shape (n, d)
    :param targets: shape (n, p)
    :param generator: draws the subset of transitions, on the CPU
    :return: optimised σ², shape (p, 1)
    :raises ValueError: if the likelihood is not finite
    """
    chosen = th.randperm(len(inputs), generator=generator)[:MAX_POINTS].to(inputs.device)
    shape, constraint = noise_variance.shape[:1], _logarithmic(MIN_NOISE_VARIANCE)
    likelihood = GaussianLikelihood(noise_constraint=constraint, batch_shape=shape).to(noise_variance)
    likelihood.noise = noise_variance.clamp(min=2 * MIN_NOISE_VARIANCE)
    kernel.requires_grad_(True)
    regression = _Regression(kernel, inputs[chosen], targets[chosen].T, likelihood)
    regression.train()
    objective = ExactMarginalLogLikelihood(likelihood, regression)
    optimizer = th.optim.LBFGS(regression.parameters(), max_iter=MAX_ITERATIONS, line_search_fn="strong_wolfe")

    def closure() -> float:
        optimizer.zero_grad()
        loss: th.Tensor = -objective(regression(inputs[chosen]), targets[chosen].T).sum()
        if not th.isfinite(loss):
            raise ValueError(
                f"the marginal likelihood is {float(-loss)}: switch optimize_hyperparameters off, or start with a "
                "larger noise_std"
            )
        loss.backward()
        return float(loss)

    with th.enable_grad(), fast_computations(False, False, False):
        optimizer.step(closure)
    kernel.requires_grad_(False).eval()
    noise: th.Tensor = likelihood.noise.detach()
    return noise
