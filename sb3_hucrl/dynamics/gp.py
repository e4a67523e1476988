"""Exact Gaussian processes, one per state dimension, with GPyTorch's kernels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import torch as th
from gpytorch.kernels import Kernel

from sb3_hucrl.checks import Count, Natural, Positive, validated
from sb3_hucrl.data import TransitionDataset
from sb3_hucrl.dynamics.cholesky import safe_cholesky
from sb3_hucrl.dynamics.confidence import confidence_width
from sb3_hucrl.dynamics.delta import DeltaModel, Moments
from sb3_hucrl.dynamics.hyperparameters import maximise_marginal_likelihood, rbf_kernel

#: number of random frequencies in the prior part of a sampled function
PRIOR_FREQUENCIES = 512

#: number of latest training transitions that the reported loss, a squared error, averages over
LOSS_POINTS = 500


class Posterior(Protocol):
    """
    Gaussian processes conditioned on data, with a stored factorisation. All tensors are in float64.

    The p outputs have k kernels: one each (k = p), or a shared one (k = 1), which is factorised only once.
    """

    def moments(self, inputs: th.Tensor) -> tuple[th.Tensor, th.Tensor]:
        """
        :param inputs: shape (B, d)
        :return: mean and standard deviation of the noise-free function, of shapes (p, B) and (k, B)
        """

    def update_weights(self, prior: Callable[[th.Tensor], th.Tensor], generator: th.Generator) -> th.Tensor:
        """
        Pathwise conditioning (Wilson et al. 2020): a posterior sample is f(x) + k(x, Z) v, where f is a prior sample.

        :param prior: S functions from the prior, maps (1, n, d) to (S, p, n)
        :param generator: draws the noise, on the CPU
        :return: v, shape (S, p, number of centres)
        """

    @property
    def centres(self) -> th.Tensor:
        """Z, shape (1, number of centres, d)."""

    @property
    def information_gain(self) -> float:
        """I(y; f) of equation (63), summed over outputs, in nats."""


@dataclass(frozen=True)
class ExactPosterior:
    """
    The posterior of equations (60) to (62).

    :param kernel: a batch of k kernels
    :param inputs: shape (1, n, d)
    :param targets: shape (p, n)
    :param noise_variance: σ², shape (k, 1)
    :param cholesky: lower factor of K + σ² I, shape (k, n, n)
    :param weights: (K + σ² I)⁻¹ y, shape (p, n)
    """

    kernel: Kernel
    inputs: th.Tensor
    targets: th.Tensor
    noise_variance: th.Tensor
    cholesky: th.Tensor
    weights: th.Tensor

    @classmethod
    def condition(
        cls, kernel: Kernel, inputs: th.Tensor, targets: th.Tensor, noise_variance: th.Tensor
    ) -> ExactPosterior:
        """
        Factorise the kernel matrix of the data.

        :param kernel: a batch of k kernels
        :param inputs: shape (n, d)
        :param targets: shape (n, p)
        :param noise_variance: σ², shape (k, 1)
        :raises ValueError: if the kernel matrix is not positive definite
        """
        covariance = kernel(inputs).to_dense()
        cholesky = safe_cholesky(covariance + th.diag_embed(noise_variance.expand(-1, len(inputs))))
        weights = th.cholesky_solve(targets.T.unsqueeze(-1), cholesky).squeeze(-1)
        return cls(kernel, inputs.unsqueeze(0), targets.T, noise_variance, cholesky, weights)

    @property
    def centres(self) -> th.Tensor:
        return self.inputs

    def moments(self, inputs: th.Tensor) -> tuple[th.Tensor, th.Tensor]:
        cross = self.kernel(self.inputs, inputs).to_dense()
        mean = (self.weights.unsqueeze(1) @ cross).squeeze(1)
        explained = th.linalg.solve_triangular(self.cholesky, cross, upper=False).square().sum(dim=1)
        variance = self.kernel(inputs, diag=True) - explained
        # At an observed point, rounding can make the variance negative.
        return mean, variance.clamp(min=1e-12).sqrt()

    def update_weights(self, prior: Callable[[th.Tensor], th.Tensor], generator: th.Generator) -> th.Tensor:
        values = prior(self.inputs)
        noise = th.randn(values.shape, generator=generator, dtype=values.dtype).to(values.device)
        residual = self.targets - values - self.noise_variance.sqrt() * noise
        return th.cholesky_solve(residual.unsqueeze(-1), self.cholesky).squeeze(-1)

    @property
    def information_gain(self) -> float:
        gains = self.cholesky.diagonal(dim1=-2, dim2=-1).log() - 0.5 * self.noise_variance.log()
        return float(gains.sum(dim=-1).expand(len(self.targets)).sum())


@validated
class GaussianProcess(DeltaModel):
    """
    Independent Gaussian processes with the squared exponential kernel, zero prior mean and constant noise.

    As in appendix B.1 the hyperparameters are fixed by default. A fit factorises the kernel matrix once for all
    predictions.

    :param state_dim: p
    :param action_dim: q, without the hallucinated dimensions
    :param angle_dims: indices of the state's angles, which are encoded as (sin, cos)
    :param lengthscale: lengthscale of the kernel, in standard deviations of the inputs
    :param outputscale: prior standard deviation of a standardised target
    :param noise_std: σ, standard deviation of the noise of a standardised target
    :param optimize_hyperparameters: maximise the marginal likelihood over lengthscales (one per input and output),
        outputscales and noise in each fit
    :param recalibrate: scale standard deviations to match the errors on held-out transitions
    :param generator: unused, accepted so that all models have the same signature
    :raises ValueError: if a scale is not positive
    """

    noise_variance: th.Tensor
    train_inputs: th.Tensor
    train_targets: th.Tensor

    def __init__(
        self,
        state_dim: Count,
        action_dim: Count,
        angle_dims: Sequence[Natural] = (),
        lengthscale: Positive = 10.0,
        outputscale: Positive = 3.0,
        noise_std: Positive = 0.01,
        optimize_hyperparameters: bool = False,
        recalibrate: bool = False,
        generator: th.Generator | None = None,
    ) -> None:
        super().__init__(state_dim, action_dim, angle_dims, recalibrate)
        self.optimize_hyperparameters = optimize_hyperparameters
        shape = th.Size([state_dim if optimize_hyperparameters else 1])
        self.kernel = rbf_kernel(shape, self.input_dim, lengthscale, outputscale)
        self.register_buffer("noise_variance", th.full((*shape, 1), noise_std**2, dtype=th.float64))
        self.register_buffer("train_inputs", th.zeros(0, self.input_dim, dtype=th.float64))
        self.register_buffer("train_targets", th.zeros(0, state_dim, dtype=th.float64))
        self._posterior: Posterior | None = None

    def _condition(self, inputs: th.Tensor, targets: th.Tensor) -> Posterior:
        return ExactPosterior.condition(self.kernel, inputs, targets, self.noise_variance)

    @property
    def posterior(self) -> Posterior:
        """The posterior given the training data, factorised at its first use after a fit or a load."""
        if self._posterior is None:
            # The first use may be in inference mode, but a planner may need gradients through these tensors later.
            with th.inference_mode(False), th.no_grad():
                self._posterior = self._condition(self.train_inputs, self.train_targets)
        return self._posterior

    def _learn(
        self, inputs: th.Tensor, deltas: th.Tensor, dataset: TransitionDataset, generator: th.Generator
    ) -> float:
        self.inputs.update(inputs)
        self.deltas.update(deltas)
        self.train_inputs, self.train_targets = self.inputs(inputs).double(), self.deltas(deltas).double()
        self._posterior = None
        if self.optimize_hyperparameters:
            self.noise_variance = maximise_marginal_likelihood(
                self.kernel, self.noise_variance, self.train_inputs, self.train_targets, generator
            )
        with th.no_grad():
            mean, _ = self.posterior.moments(self.train_inputs[-LOSS_POINTS:])
            return float((self.train_targets[-LOSS_POINTS:] - mean.T).square().sum(dim=-1).mean())

    def _moments(self, inputs: th.Tensor) -> Moments:
        mean, std = self.posterior.moments(inputs.double())
        return self._as_moments(inputs, mean, std)

    def _as_moments(self, inputs: th.Tensor, mean: th.Tensor, std: th.Tensor) -> Moments:
        noise = self.noise_variance.sqrt().expand_as(mean)
        return Moments(mean.T.to(inputs), std.expand_as(mean).T.to(inputs), noise.T.to(inputs))

    @th.no_grad()
    def _sample(self, generator: th.Generator, num_samples: int) -> Callable[[th.Tensor], Moments]:
        p, posterior = self.state_dim, self.posterior
        lengthscale = self.kernel.base_kernel.lengthscale
        normal = th.randn(self.input_dim, PRIOR_FREQUENCIES, generator=generator, dtype=th.float64)
        frequencies = normal.to(lengthscale) / lengthscale.mT
        shape = (num_samples, p, 2 * PRIOR_FREQUENCIES)
        coefficients = th.randn(shape, generator=generator, dtype=th.float64).to(lengthscale)
        coefficients *= (self.kernel.outputscale / PRIOR_FREQUENCIES).sqrt().unsqueeze(-1)

        def features(points: th.Tensor) -> th.Tensor:
            phase = points @ frequencies
            return th.cat([phase.cos(), phase.sin()], dim=-1)

        def prior(points: th.Tensor) -> th.Tensor:
            return th.einsum("pnf,spf->spn", features(points), coefficients)

        weights = posterior.update_weights(prior, generator)

        def function(inputs: th.Tensor) -> Moments:
            points = inputs.double().unsqueeze(0)
            rows = th.arange(len(inputs), device=inputs.device) % num_samples
            cross = self.kernel(points, posterior.centres).to_dense()
            mean = th.einsum("pbf,bpf->pb", features(points), coefficients[rows])
            mean = mean + th.einsum("pbn,bpn->pb", cross, weights[rows])
            return self._as_moments(inputs, mean, th.zeros_like(mean))

        return function

    def information_gain(self) -> float:
        """I(y; f) of equation (63), summed over outputs, in nats."""
        return self.posterior.information_gain

    def confidence_width(self, delta: float, norm_bound: float) -> float:
        noise_std = float(self.noise_variance.max().sqrt())
        return confidence_width(self.information_gain(), noise_std, delta, norm_bound)

    def diagnostics(self) -> dict[str, float]:
        return {"information_gain": self.information_gain()}

    def _apply(self, fn: Callable[[th.Tensor], th.Tensor], recurse: bool = True) -> GaussianProcess:
        self._posterior = None
        super()._apply(fn, recurse)  # type: ignore[no-untyped-call]  # torch's
        return self

    def _load_from_state_dict(self, state_dict: dict[str, Any], prefix: str, *args: Any) -> None:
        for name in ("train_inputs", "train_targets"):
            # An unfitted model has no rows here, so allocate as many as were saved.
            if prefix + name in state_dict:
                setattr(self, name, th.empty_like(state_dict[prefix + name], device=self.device))
        self._posterior = None
        super()._load_from_state_dict(state_dict, prefix, *args)

    def __getstate__(self) -> dict[str, Any]:
        # The factorisation is large and quick to recompute.
        return {**self.__dict__, "_posterior": None}


@validated
class ExactGP(GaussianProcess):
    """
    Gaussian processes that keep all n training transitions: a fit takes O(n³) time and O(n²) memory.

    :param max_points: largest n; a fit with more raises ValueError
    :param settings: further arguments of :class:`GaussianProcess`
    """

    def __init__(
        self,
        state_dim: Count,
        action_dim: Count,
        angle_dims: Sequence[Natural] = (),
        max_points: Count = 5_000,
        **settings: Any,
    ) -> None:
        super().__init__(state_dim, action_dim, angle_dims, **settings)
        self.max_points = max_points

    def _learn(
        self, inputs: th.Tensor, deltas: th.Tensor, dataset: TransitionDataset, generator: th.Generator
    ) -> float:
        if len(inputs) > self.max_points:
            raise ValueError(
                f"{len(inputs)} training transitions have outgrown the exact GP, which holds max_points = "
                f"{self.max_points}: use dynamics 'sparse_gp' (or 'rff', 'ensemble'), or raise max_points; "
                f"{self.state_dim} factors of that size take {8e-9 * self.state_dim * len(inputs) ** 2:.1f} GB"
            )
        return super()._learn(inputs, deltas, dataset, generator)
