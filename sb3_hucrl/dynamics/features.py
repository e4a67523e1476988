"""Bayesian linear regression on Fourier features of the squared exponential kernel (appendix B.4.5)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch as th

from sb3_hucrl.checks import Count, Natural, Positive, validated
from sb3_hucrl.data import TransitionDataset
from sb3_hucrl.dynamics.confidence import confidence_width
from sb3_hucrl.dynamics.delta import DeltaModel, Moments
from sb3_hucrl.dynamics.fourier import FourierFeatures, Pairs, quadrature_features, random_features
from sb3_hucrl.dynamics.linear import BayesianLinearRegression


@validated
class FeatureModel(DeltaModel):
    """
    A Gaussian process in weight space with the kernel φ(x)ᵀφ(x′). Its cost per prediction does not grow with the data.

    A fit adds only the new transitions. A new standardisation changes the features of all transitions, so inputs and
    targets are standardised again, and all transitions added again, only when the number of transitions has doubled.

    :param features: makes φ from the number of inputs, the lengthscale and the generator
    :param state_dim: p
    :param action_dim: q, without the hallucinated dimensions
    :param angle_dims: indices of the state's angles, which are encoded as (sin, cos)
    :param lengthscale: lengthscale of the kernel, in standard deviations of the inputs
    :param outputscale: prior standard deviation of a standardised target
    :param noise_std: σ, standard deviation of the noise of a standardised target
    :param recalibrate: scale standard deviations to match the errors on held-out transitions
    :param generator: draws the features if they are random
    :raises ValueError: if a scale is not positive
    """

    scaled_on: th.Tensor
    num_seen: th.Tensor

    def __init__(
        self,
        features: Callable[[int, float, th.Generator | None], FourierFeatures],
        state_dim: Count,
        action_dim: Count,
        angle_dims: Sequence[Natural] = (),
        lengthscale: Positive = 10.0,
        outputscale: Positive = 3.0,
        noise_std: Positive = 0.01,
        recalibrate: bool = False,
        generator: th.Generator | None = None,
    ) -> None:
        super().__init__(state_dim, action_dim, angle_dims, recalibrate)
        self.fourier = features(self.input_dim, lengthscale, generator)
        self.noise_std = noise_std
        self.regression = BayesianLinearRegression(self.fourier.num_features, state_dim, outputscale**2, noise_std)
        #: number of transitions at the last standardisation, and number of transitions learned from
        self.register_buffer("scaled_on", th.zeros((), dtype=th.long))
        self.register_buffer("num_seen", th.zeros((), dtype=th.long))

    @th.no_grad()
    def _learn(
        self, inputs: th.Tensor, deltas: th.Tensor, dataset: TransitionDataset, generator: th.Generator
    ) -> float:
        scaled_on = int(self.scaled_on)
        # If this fit is interrupted, nobody knows which transitions are in: the next one begins from none.
        self.scaled_on.zero_()
        if len(inputs) >= 2 * scaled_on:
            self.inputs.update(inputs)
            self.deltas.update(deltas)
            self.regression.reset()
            self.num_seen.zero_()
            scaled_on = len(inputs)
        new_inputs, new_deltas = inputs[self.num_seen :], deltas[self.num_seen :]
        self.regression.update(self.fourier(self.inputs(new_inputs)), self.deltas(new_deltas).double())
        self.num_seen.fill_(len(inputs))
        self.scaled_on.fill_(scaled_on)
        mean, _ = self.regression.predict(self.fourier(self.inputs(inputs)))
        return float((self.deltas(deltas) - mean).square().sum(dim=-1).mean())

    def _moments(self, inputs: th.Tensor) -> Moments:
        mean, std = self.regression.predict(self.fourier(inputs))
        return self._as_moments(inputs, mean, std.expand_as(mean))

    def _sample(self, generator: th.Generator, num_samples: int) -> Callable[[th.Tensor], Moments]:
        weights = self.regression.sample_weights(num_samples, generator)

        def function(inputs: th.Tensor) -> Moments:
            features = self.fourier(inputs)
            if num_samples == 1:
                mean = features @ weights[0]
            else:
                rows = th.arange(len(inputs), device=inputs.device) % num_samples
                mean = (features.unsqueeze(1) @ weights[rows]).squeeze(1)
            return self._as_moments(inputs, mean, th.zeros_like(mean))

        return function

    def _as_moments(self, inputs: th.Tensor, mean: th.Tensor, std: th.Tensor) -> Moments:
        return Moments(mean.to(inputs), std.to(inputs), th.full_like(mean, self.noise_std).to(inputs))

    def information_gain(self) -> float:
        """I(y; f) of equation (63), summed over outputs, in nats."""
        return self.state_dim * self.regression.information_gain()

    def confidence_width(self, delta: float, norm_bound: float) -> float:
        return confidence_width(self.information_gain(), self.noise_std, delta, norm_bound)

    def diagnostics(self) -> dict[str, float]:
        return {"information_gain": self.information_gain()}


@validated
class RandomFourierModel(FeatureModel):
    """
    Feature model with random Fourier features.

    :param state_dim: p
    :param action_dim: q, without the hallucinated dimensions
    :param angle_dims: indices of the state's angles, which are encoded as (sin, cos)
    :param num_features: number of features, even; the paper uses 1,296
    :param settings: further arguments of :class:`FeatureModel`
    """

    def __init__(
        self,
        state_dim: Count,
        action_dim: Count,
        angle_dims: Sequence[Natural] = (),
        num_features: Pairs = 1_296,
        **settings: Any,
    ) -> None:
        def features(input_dim: int, lengthscale: float, generator: th.Generator | None) -> FourierFeatures:
            return random_features(input_dim, num_features, lengthscale, generator)

        super().__init__(features, state_dim, action_dim, angle_dims, **settings)


@validated
class QuadratureFourierModel(FeatureModel):
    """
    Feature model with quadrature Fourier features, for at most four or five input dimensions.

    :param state_dim: p
    :param action_dim: q, without the hallucinated dimensions
    :param angle_dims: indices of the state's angles, which are encoded as (sin, cos)
    :param nodes_per_dim: grid points per input dimension; the paper has 625 features, from 5 in each of 4 dimensions
    :param settings: further arguments of :class:`FeatureModel`
    :raises ValueError: if the grid has too many points
    """

    def __init__(
        self,
        state_dim: Count,
        action_dim: Count,
        angle_dims: Sequence[Natural] = (),
        nodes_per_dim: Count = 5,
        **settings: Any,
    ) -> None:
        def features(input_dim: int, lengthscale: float, generator: th.Generator | None) -> FourierFeatures:
            return quadrature_features(input_dim, nodes_per_dim, lengthscale)

        super().__init__(features, state_dim, action_dim, angle_dims, **settings)
