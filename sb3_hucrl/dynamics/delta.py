"""Base class of the learned models: standardised inputs, standardised state differences, calibration."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch as th

from sb3_hucrl.checks import Count, Natural, validated
from sb3_hucrl.data import TransitionDataset, Transitions
from sb3_hucrl.dynamics.base import DynamicsModel, FitReport, Prediction, Predictor
from sb3_hucrl.dynamics.calibration import Calibration, gaussian_nll, recalibration_scale
from sb3_hucrl.dynamics.encoding import Standardiser, StateFeatures


@dataclass(frozen=True)
class Moments:
    """
    Prediction of the standardised state difference.

    :param mean: shape (B, p)
    :param epistemic_std: shape (B, p)
    :param aleatoric_std: shape (B, p)
    """

    mean: th.Tensor
    epistemic_std: th.Tensor
    aleatoric_std: th.Tensor


@validated
class DeltaModel(DynamicsModel):
    """
    Predicts the difference of successive states from inputs (state features, action). Inputs and targets are
    standardised on the data so far, so that a subclass only implements regression between standardised tensors.

    :param state_dim: p
    :param action_dim: q, without the hallucinated dimensions
    :param angle_dims: indices of the state's angles, which are encoded as (sin, cos)
    :param recalibrate: scale standard deviations per dimension to match the errors on held-out transitions
    """

    std_scale: th.Tensor

    def __init__(self, state_dim: Count, action_dim: Count, angle_dims: Sequence[Natural], recalibrate: bool) -> None:
        super().__init__(state_dim, action_dim)
        self.recalibrate = recalibrate
        self.features = StateFeatures(state_dim, angle_dims)
        self.input_dim = self.features.output_dim + action_dim
        self.inputs = Standardiser(self.input_dim)
        self.deltas = Standardiser(state_dim)
        self.register_buffer("std_scale", th.ones(state_dim))

    @abstractmethod
    def _learn(
        self, inputs: th.Tensor, deltas: th.Tensor, dataset: TransitionDataset, generator: th.Generator
    ) -> float:
        """
        Fit the regression.

        :param inputs: all training inputs in order, shape (n, input_dim); standardise them with :attr:`inputs`
        :param deltas: state differences, shape (n, p); standardise them with :attr:`deltas`
        :param dataset: source of inputs and deltas
        :param generator: source of all randomness in the fit, on the CPU
        :return: final training loss
        """

    @abstractmethod
    def _moments(self, inputs: th.Tensor) -> Moments:
        """
        Predict standardised differences.

        :param inputs: standardised, shape (B, input_dim)
        """

    @abstractmethod
    def _sample(self, generator: th.Generator, num_samples: int) -> Callable[[th.Tensor], Moments]:
        """
        Draw functions from the posterior.

        :param generator: draws the functions, on the CPU
        :param num_samples: number of functions; function i modulo ``num_samples`` predicts row i of the inputs
        :return: maps standardised inputs to moments with an epistemic std of 0
        """

    def encode(self, state: th.Tensor, action: th.Tensor) -> th.Tensor:
        """
        :param state: shape (B, p)
        :param action: shape (B, q)
        :return: model inputs before standardisation, shape (B, input_dim)
        """
        return th.cat([self.features(state), action], dim=-1)

    def in_state_units(self, state: th.Tensor, moments: Moments) -> Prediction:
        """
        :param state: s, to which the difference is added, shape (B, p)
        :param moments: of the standardised difference
        """
        std_scale = self.deltas.std * self.std_scale
        return Prediction(
            mean=th.addcmul(state + self.deltas.mean, moments.mean, self.deltas.std),
            epistemic_std=moments.epistemic_std * std_scale,
            aleatoric_std=moments.aleatoric_std * std_scale,
        )

    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        return self.in_state_units(state, self._moments(self.inputs(self.encode(state, action))))

    def sample_posterior(self, generator: th.Generator, num_samples: int = 1) -> Predictor:
        return SampledModel(self, self._sample(generator, num_samples))

    def fit(self, dataset: TransitionDataset, generator: th.Generator) -> FitReport:
        train = dataset.train
        if len(train) < 2:
            raise ValueError(
                f"a dynamics model needs at least 2 training transitions, got {len(train)}: collect more episodes"
            )
        states, next_states = self._without_context(train)
        inputs = self.encode(states, train.actions.to(self.device))
        deltas = self.features.difference(next_states, states)
        loss = self._learn(inputs, deltas, dataset, generator)
        nll, calibration = self._judge(dataset.holdout)
        return FitReport(loss, len(train), nll, calibration)

    def _without_context(self, transitions: Transitions) -> tuple[th.Tensor, th.Tensor]:
        states, next_states = transitions.states, transitions.next_states
        return states[:, : self.state_dim].to(self.device), next_states[:, : self.state_dim].to(self.device)

    @th.no_grad()
    def _judge(self, holdout: Transitions) -> tuple[float, Calibration]:
        self.std_scale.fill_(1.0)
        states, next_states = self._without_context(holdout)
        prediction = self.predict(states, holdout.actions.to(self.device))
        error = self.features.difference(next_states, prediction.mean)
        std = prediction.predictive_std
        if self.recalibrate:
            self.std_scale.copy_(recalibration_scale(error, std))
        return float(gaussian_nll(error, self.std_scale * std).mean()), Calibration.measure(error, std, self.std_scale)


class SampledModel(Predictor):
    """
    Posterior samples of a model, in state units.

    :param model: the sampled model
    :param function: maps standardised inputs to moments of standardised differences
    """

    def __init__(self, model: DeltaModel, function: Callable[[th.Tensor], Moments]) -> None:
        super().__init__(model.state_dim, model.action_dim)
        self._model = model
        self._function = function

    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        model = self._model
        return model.in_state_units(state, self._function(model.inputs(model.encode(state, action))))
