"""What every dynamics model offers, whatever it is made of."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import chain

import torch as th
from torch import nn

from sb3_hucrl.data import TransitionDataset
from sb3_hucrl.dynamics.calibration import Calibration


@dataclass(frozen=True)
class Prediction:
    """
    Distribution of the next state, elementwise, in state units.

    :param mean: μ(s, a), shape (B, p)
    :param epistemic_std: diagonal of Σ(s, a): what more data would remove, shape (B, p)
    :param aleatoric_std: standard deviation of the noise ω, shape (B, p)
    """

    mean: th.Tensor
    epistemic_std: th.Tensor
    aleatoric_std: th.Tensor

    @property
    def predictive_std(self) -> th.Tensor:
        """Epistemic and aleatoric together, shape (B, p)."""
        return th.hypot(self.epistemic_std, self.aleatoric_std)


@dataclass(frozen=True)
class FitReport:
    """
    How a fit went.

    :param train_loss: what the fit minimised, at its end
    :param num_train: transitions that were learned from
    :param holdout_nll: negative log-likelihood per held-out transition, in nats, next state in state units
    :param calibration: of the held-out transitions
    """

    train_loss: float
    num_train: int
    holdout_nll: float
    calibration: Calibration


class Predictor(nn.Module, ABC):
    """
    Anything that predicts s_{n+1} = f(s_n, a_n) + ω_n: all that imagination needs.

    :param state_dim: p
    :param action_dim: q, without the hallucinated dimensions
    """

    def __init__(self, state_dim: int, action_dim: int) -> None:
        super().__init__()
        self.state_dim = state_dim
        self.action_dim = action_dim

    @property
    def device(self) -> th.device:
        """Where states and actions are expected."""
        return next(chain(self.parameters(), self.buffers()), th.zeros(0)).device

    @abstractmethod
    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        """
        :param state: shape (B, p)
        :param action: without its hallucinated part, in the units of the environment, shape (B, q)
        """


class DynamicsModel(Predictor):
    """
    A predictor that learns from real transitions, differentiable in state and action.

    Normalisation, state differences and input encodings stay inside.

    :param state_dim: p
    :param action_dim: q, without the hallucinated dimensions
    """

    @abstractmethod
    def fit(self, dataset: TransitionDataset, generator: th.Generator) -> FitReport:
        """
        Learn from all training transitions of the dataset, starting from what was learned before.

        :param dataset: its dimensions are the model's
        :param generator: the source of all randomness of the fit, on the CPU
        :raises ValueError: if there is too little data or the fit diverges
        """

    def sample_posterior(self, generator: th.Generator, num_samples: int = 1) -> Predictor:
        """
        Draw functions from what the data leave possible. A sample is sure of itself: its epistemic standard deviation
        is 0. It lives until the next fit.

        :param generator: draws them, on the CPU
        :param num_samples: number of functions; row i of a batch is predicted by number i modulo ``num_samples``
        :raises ValueError: if this model has no samples
        """
        raise ValueError(
            f"{type(self).__name__} has no posterior samples, which Thompson sampling and the propagations 'ts1' and "
            "'tsinf' draw: use a model that has, or another exploration"
        )

    def information_gain(self) -> float | None:
        """
        :return: I(y; f) of equation (63), summed over outputs, in nats; None if this model is not a Gaussian process
        """
        return None

    def confidence_width(self, delta: float, norm_bound: float) -> float:
        """
        β_t = B + 4σ √(I(y; f) + 1 + ln(1/δ)) of Lemmas 10 and 11, in units of this model's epistemic std.

        :param delta: δ, probability with which the confidence region may be wrong
        :param norm_bound: B, bound on the RKHS norm of the true (standardised) dynamics
        :raises ValueError: if this model is not a Gaussian process
        """
        raise ValueError(
            f"beta 'theory' needs a Gaussian process or Fourier features, not {type(self).__name__}: give beta a number"
        )


class Resampled(Predictor):
    """
    A new posterior sample for every row and every step: TS1 propagation (Chua et al. 2018).

    :param model: draws the samples
    :param generator: of the draws, on the CPU
    """

    def __init__(self, model: DynamicsModel, generator: th.Generator) -> None:
        super().__init__(model.state_dim, model.action_dim)
        self._model = model
        self._generator = generator

    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        return self._model.sample_posterior(self._generator, len(state)).predict(state, action)
