"""Probabilistic and deterministic ensembles of networks (Chua et al. 2018; Lakshminarayanan et al. 2017)."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import Annotated, Any, TypeAlias

import torch as th
from pydantic import Field

from sb3_hucrl.checks import ArgumentError, Count, Natural, NotNegative, Positive, validated
from sb3_hucrl.data import TransitionDataset
from sb3_hucrl.dynamics.base import Predictor
from sb3_hucrl.dynamics.delta import DeltaModel, Moments, SampledModel
from sb3_hucrl.dynamics.networks import BatchedNetworks
from sb3_hucrl.progress import begin_phase

# Bounds of the noise variance of a standardised target: its noise std is 0.7 % to 160 % of its own std.
MIN_VARIANCE, MAX_VARIANCE = 5e-5, 2.7
# Median of the square of a standard normal variable.
MEDIAN_OF_CHI_SQUARE = 0.4549
Members: TypeAlias = Annotated[int, Field(ge=2, description="an integer of at least 2: one member cannot disagree")]


@validated
class Ensemble(DeltaModel):
    """
    M independent networks, each of which predicts the standardised state difference.

    Members disagree where data are missing, because each starts from different parameters and, with ``bootstrap``,
    weights the transitions differently, by Poisson(1) draws (appendix B.1; without bootstrap: B.4.4).

    :param state_dim: p
    :param action_dim: q, without the hallucinated dimensions
    :param angle_dims: indices of the state's angles, which are encoded as (sin, cos)
    :param num_members: M, at least 2
    :param net_arch: widths of the hidden layers
    :param learning_rate: learning rate of Adam
    :param batch_size: transitions per member and gradient step
    :param gradient_steps: gradient steps per fit, at most
    :param steps_per_transition: gradient steps for each transition that is new since the last fit, so that frequent
        refits stay short; None for ``gradient_steps`` in each fit
    :param layer_norm: whether hidden layers are normalised: more exact where there are data, and overconfident where
        there are none
    :param linear_path: whether the first layer's output is added to the last hidden layer, which must have the same
        width: members with normalised layers disagree then where there are no data
    :param weight_decay: of AdamW, per gradient step and learning rate
    :param bootstrap: whether each member weights the transitions differently
    :param recalibrate: scale standard deviations to match the errors on held-out transitions
    :param generator: draws the initial parameters
    :raises ValueError: if there are fewer than 2 members, or the widths do not fit
    """

    #: of ensembles in files of earlier versions
    weight_decay = 0.0
    steps_per_transition: float | None = None
    #: number of transitions of the last fit
    fitted = 0
    #: network outputs per state dimension
    outputs_per_dim: int

    def __init__(
        self,
        state_dim: Count,
        action_dim: Count,
        angle_dims: Sequence[Natural] = (),
        num_members: Members = 5,
        net_arch: Sequence[Count] = (64, 64),
        learning_rate: Positive = 1e-3,
        batch_size: Count = 64,
        gradient_steps: Count = 1_000,
        steps_per_transition: Positive | None = None,
        layer_norm: bool = False,
        linear_path: bool = False,
        weight_decay: NotNegative = 0.0,
        bootstrap: bool = True,
        recalibrate: bool = False,
        generator: th.Generator | None = None,
    ) -> None:
        super().__init__(state_dim, action_dim, angle_dims, recalibrate)
        self.num_members = num_members
        self.learning_rate = learning_rate
        self.batch_size = batch_size
        self.gradient_steps, self.steps_per_transition = gradient_steps, steps_per_transition
        self.weight_decay = weight_decay
        self.bootstrap = bootstrap
        if linear_path and (not net_arch or net_arch[0] != net_arch[-1]):
            raise ArgumentError.of_value(
                "net_arch", net_arch, "widths whose first and last one are the same, or leave linear_path out"
            )
        outputs = self.outputs_per_dim * state_dim
        self.networks = BatchedNetworks(
            num_members, self.input_dim, net_arch, outputs, generator, layer_norm, linear_path
        )

    @abstractmethod
    def _loss(self, outputs: th.Tensor, deltas: th.Tensor) -> th.Tensor:
        """
        :param outputs: network outputs, shape (M, B, outputs_per_dim · p)
        :param deltas: standardised targets, shape (M, B, p)
        :return: shape (M, B)
        """

    @abstractmethod
    def _noise(self, outputs: th.Tensor) -> th.Tensor:
        """
        :param outputs: network outputs, shape (M, B, outputs_per_dim · p)
        :return: shape (M, B, outputs_per_dim · p); the last p columns are the variance of the noise
        """

    def _after_fit(self, inputs: th.Tensor, deltas: th.Tensor) -> None:
        """
        Called at the end of a fit; does nothing by default.

        :param inputs: standardised inputs of all training transitions, shape (n, input_dim)
        :param deltas: standardised targets, shape (n, p)
        """

    def _moments(self, inputs: th.Tensor) -> Moments:
        outputs = self.networks(inputs.expand(self.num_members, -1, -1))
        # Reduce all columns although some are dropped below: a slice of the last dimension is not contiguous, and
        # reducing it takes twenty times as long.
        average = outputs.mean(dim=0)
        spread = (outputs - average).square().mean(dim=0)
        noise = self._noise(outputs).mean(dim=0)
        p = self.state_dim
        # If all members agree exactly, the gradient of the square root would be infinite.
        return Moments(average[:, :p], spread[:, :p].clamp(min=1e-12).sqrt(), noise[:, -p:].sqrt())

    def _sample(self, generator: th.Generator, num_samples: int) -> Callable[[th.Tensor], Moments]:
        members = th.randint(self.num_members, (num_samples,), generator=generator)
        if num_samples == 1:
            return partial(self._member_moments, int(members))
        members = members.to(self.device)

        def function(inputs: th.Tensor) -> Moments:
            rows = th.arange(len(inputs), device=inputs.device)
            return self._certain(
                self.networks(inputs.expand(self.num_members, -1, -1))[members[rows % num_samples], rows]
            )

        return function

    def resampled(self, generator: th.Generator) -> Predictor:
        return SampledModel(self, lambda inputs: self._certain(self.networks.one_each(inputs, generator)))

    def _member_moments(self, index: int, inputs: th.Tensor) -> Moments:
        return self._certain(self.networks(inputs.unsqueeze(0), slice(index, index + 1))[0])

    def _certain(self, outputs: th.Tensor) -> Moments:
        mean = outputs[:, : self.state_dim]
        return Moments(mean, th.zeros_like(mean), self._noise(outputs)[:, -self.state_dim :].sqrt())

    @validated
    def member(self, index: Natural) -> Predictor:
        """
        One member as a predictor of its own, valid until the next fit.

        :param index: index of the member, from 0 to M - 1
        :raises ValueError: if there is no such member
        """
        if index >= self.num_members:
            raise ArgumentError.of_value("index", index, f"one from 0 to {self.num_members - 1}")
        return SampledModel(self, partial(self._member_moments, index))

    def _steps(self, transitions: int) -> int:
        if self.steps_per_transition is None:
            return self.gradient_steps
        new = max(1, transitions - self.fitted)
        return min(self.gradient_steps, math.ceil(self.steps_per_transition * new))

    def _learn(
        self, inputs: th.Tensor, deltas: th.Tensor, dataset: TransitionDataset, generator: th.Generator
    ) -> float:
        self.inputs.update(inputs)
        self.deltas.update(deltas)
        inputs, deltas = self.inputs(inputs), self.deltas(deltas)
        weights = dataset.bootstrap_weights(self.num_members).T.to(self.device)
        if not self.bootstrap:
            weights = th.ones_like(weights)
        self.requires_grad_(True)
        optimizer = th.optim.AdamW(self.parameters(), lr=self.learning_rate, weight_decay=self.weight_decay, fused=True)
        member = th.arange(self.num_members, device=self.device).unsqueeze(1)
        steps = self._steps(len(inputs))
        batches = th.randint(len(inputs), (steps, self.num_members, self.batch_size), generator=generator)
        batches = batches.to(self.device)
        # On the device: a GPU need not be waited for in every step.
        losses = th.zeros(steps, device=self.device)
        advance = begin_phase("fit", steps)
        for step, batch in enumerate(batches):
            residuals = self._loss(self.networks(inputs[batch]), deltas[batch])
            loss = (weights[member, batch] * residuals).mean(dim=1).sum()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            losses[step] = loss.detach()
            advance(1)
        # Whoever differentiates predictions does so by states and actions.
        self.requires_grad_(False)
        train_loss = float(losses[-max(1, steps // 10) :].mean()) / self.num_members
        if not math.isfinite(train_loss):
            raise ValueError(
                f"the ensemble's training loss is {train_loss}: lower learning_rate (now {self.learning_rate})"
            )
        self.fitted = len(inputs)
        self._after_fit(inputs, deltas)
        return train_loss


class ProbabilisticEnsemble(Ensemble):
    """
    Each member predicts a normal distribution, whose variance is the aleatoric noise.

    The prediction has the mean of the members' means, their standard deviation (epistemic), and the mean of the
    members' variances (aleatoric). The arguments are those of :class:`Ensemble`.
    """

    outputs_per_dim = 2

    def _loss(self, outputs: th.Tensor, deltas: th.Tensor) -> th.Tensor:
        mean, raw = outputs.chunk(2, dim=-1)
        variance = self._noise(raw)
        return 0.5 * ((deltas - mean).square() / variance + variance.log()).sum(dim=-1)

    def _noise(self, outputs: th.Tensor) -> th.Tensor:
        # A sigmoid grows exponentially at first and bounds the variance smoothly at both ends.
        return outputs.sigmoid().mul(MAX_VARIANCE).add(MIN_VARIANCE)


@validated
class DeterministicEnsemble(Ensemble):
    """
    Each member predicts a point by least squares. The aleatoric noise is constant: that of a normal distribution with
    the median of the training residuals. A few large ones, such as those of impacts, are not noise that is there in
    every state. The arguments are those of :class:`Ensemble`.
    """

    outputs_per_dim = 1
    residual_variance: th.Tensor

    def __init__(
        self, state_dim: Count, action_dim: Count, angle_dims: Sequence[Natural] = (), **settings: Any
    ) -> None:
        super().__init__(state_dim, action_dim, angle_dims, **settings)
        self.register_buffer("residual_variance", th.full((state_dim,), MIN_VARIANCE))

    def _loss(self, outputs: th.Tensor, deltas: th.Tensor) -> th.Tensor:
        return (deltas - outputs).square().sum(dim=-1)

    def _noise(self, outputs: th.Tensor) -> th.Tensor:
        return self.residual_variance.expand_as(outputs)

    @th.no_grad()
    def _after_fit(self, inputs: th.Tensor, deltas: th.Tensor) -> None:
        residual = deltas - self._moments(inputs).mean
        median = residual.square().median(dim=0).values
        self.residual_variance.copy_((median / MEDIAN_OF_CHI_SQUARE).clamp(min=MIN_VARIANCE))
