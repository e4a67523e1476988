"""What every learned dynamics model offers, whatever it is made of."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import torch as th
from torch import nn

from sb3_hucrl.data import TransitionDataset


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
    How a fit went; the last two are taken on held-out transitions.

    :param train_loss: mean training loss over the last tenth of the fit
    :param num_train: transitions that were learned from
    :param holdout_nll: negative log-likelihood per transition, in nats, next state in state units
    :param calibration_error: see :func:`sb3_hucrl.dynamics.calibration.calibration_error`
    """

    train_loss: float
    num_train: int
    holdout_nll: float
    calibration_error: float


class DynamicsModel(nn.Module, ABC):
    """
    A probabilistic model of s_{n+1} = f(s_n, a_n) + ω_n, differentiable in state and action.

    Normalisation, state differences and input encodings stay inside.

    :param state_dim: p
    :param action_dim: q, without the hallucinated dimensions
    """

    def __init__(self, state_dim: int, action_dim: int) -> None:
        super().__init__()
        self.state_dim = state_dim
        self.action_dim = action_dim

    @abstractmethod
    def fit(self, dataset: TransitionDataset, generator: th.Generator) -> FitReport:
        """
        Learn from all training transitions of the dataset, starting from what was learned before.

        :param dataset: its dimensions are the model's
        :param generator: the source of all randomness of the fit, on the CPU
        :raises ValueError: if there is too little data or the fit diverges
        """

    @abstractmethod
    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        """
        :param state: shape (B, p)
        :param action: without its hallucinated part, in the units of the environment, shape (B, q)
        """
