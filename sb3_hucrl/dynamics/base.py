"""The interface of all dynamics models."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import chain

import torch as th
from torch import nn

from sb3_hucrl.checks import ArgumentError, Count, validated
from sb3_hucrl.data import TransitionDataset
from sb3_hucrl.dynamics.calibration import Calibration


@dataclass(frozen=True)
class Prediction:
    """
    Elementwise distribution of the next state, in state units.

    :param mean: μ(s, a), shape (B, p)
    :param epistemic_std: diagonal of Σ(s, a), the uncertainty that more data would remove, shape (B, p)
    :param aleatoric_std: standard deviation of the noise ω, shape (B, p)
    """

    mean: th.Tensor
    epistemic_std: th.Tensor
    aleatoric_std: th.Tensor

    @property
    def predictive_std(self) -> th.Tensor:
        """Epistemic and aleatoric standard deviation combined, shape (B, p)."""
        return th.hypot(self.epistemic_std, self.aleatoric_std)


@dataclass(frozen=True)
class FitReport:
    """
    The result of a fit.

    :param train_loss: final training loss
    :param num_train: number of training transitions
    :param holdout_nll: negative log-likelihood per held-out transition, in nats, next state in state units
    :param calibration: on the held-out transitions
    """

    train_loss: float
    num_train: int
    holdout_nll: float
    calibration: Calibration


@validated
class Predictor(nn.Module, ABC):
    """
    Predicts s_{n+1} = f(s_n, a_n) + ω_n. Imagination needs nothing else.

    :param state_dim: p
    :param action_dim: q, without the hallucinated dimensions
    """

    def __init__(self, state_dim: Count, action_dim: Count) -> None:
        super().__init__()
        self.state_dim = state_dim
        self.action_dim = action_dim

    @property
    def device(self) -> th.device:
        """The device of the parameters, which states and actions must share."""
        return next(chain(self.parameters(), self.buffers()), th.zeros(0)).device

    @abstractmethod
    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        """
        :param state: shape (B, p)
        :param action: without a′, in the units of the environment, shape (B, q)
        """


class DynamicsModel(Predictor):
    """
    A predictor that learns from real transitions and is differentiable in state and action.

    Normalisation, state differences and input encodings are internal to the model.

    :param state_dim: p
    :param action_dim: q, without the hallucinated dimensions
    """

    @abstractmethod
    def fit(self, dataset: TransitionDataset, generator: th.Generator) -> FitReport:
        """
        Learn from all training transitions of the dataset. Models with weights continue from their current ones.

        :param dataset: has the state and action dimensions of the model
        :param generator: source of all randomness in the fit, on the CPU
        :raises ValueError: if there is too little data or the fit diverges
        """

    def sample_posterior(self, generator: th.Generator, num_samples: int = 1) -> Predictor:
        """
        Draw functions from the posterior. The epistemic standard deviation of a sample is 0. A sample is valid until
        the next fit.

        :param generator: draws the samples, on the CPU
        :param num_samples: number of functions; function i modulo ``num_samples`` predicts row i of a batch
        :raises ValueError: if the model cannot draw samples
        """
        raise lacking(self, "sample_posterior")

    def resampled(self, generator: th.Generator) -> Predictor:
        """
        Draw a new posterior sample for every row at every step: TS1 propagation (Chua et al. 2018).

        :param generator: draws the samples, on the CPU
        :raises ValueError: if the model cannot draw samples
        """
        return Resampled(self, generator)

    def confidence_width(self, delta: float, norm_bound: float) -> float:
        """
        β_t = B + 4σ √(I(y; f) + 1 + ln(1/δ)) of Lemmas 10 and 11, in units of this model's epistemic std.

        :param delta: δ, probability that the confidence region is wrong
        :param norm_bound: B, bound on the RKHS norm of the true (standardised) dynamics
        :raises ValueError: unless the model is a Gaussian process or has Fourier features
        """
        raise lacking(self, "confidence_width")

    def diagnostics(self) -> dict[str, float]:
        """
        :return: values to log after each refit, by name
        """
        return {}


def lacking(model: DynamicsModel, ability: str) -> ValueError:
    """
    :param model: that does not override a method of :class:`DynamicsModel`
    :param ability: the method
    :return: the error of calling it
    """
    name = type(model).__name__
    if ability == "confidence_width":
        return ArgumentError(
            "beta", f"is 'theory', which needs a Gaussian process or Fourier features, not {name}: give a number"
        )
    return ValueError(
        f"{name} has no posterior samples, which Thompson sampling and the propagations 'ts1' and 'tsinf' need: use "
        "another dynamics model or another exploration"
    )


def require_ability(model: DynamicsModel, ability: str) -> None:
    """
    Raise the error of calling a method before anything depends on it.

    :param model: fitted or not
    :param ability: a method that :class:`DynamicsModel` does not have to have
    :raises ValueError: if the model does not override it
    """
    if getattr(type(model), ability) is getattr(DynamicsModel, ability):
        raise lacking(model, ability)


class Resampled(Predictor):
    """
    Draws a new posterior sample for every row at every step: TS1 propagation (Chua et al. 2018).

    :param model: model to sample from
    :param generator: draws the samples, on the CPU
    """

    def __init__(self, model: DynamicsModel, generator: th.Generator) -> None:
        super().__init__(model.state_dim, model.action_dim)
        self._model = model
        self._generator = generator

    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        return self._model.sample_posterior(self._generator, len(state)).predict(state, action)
