"""Probabilistic ensemble (Chua et al. 2018; Lakshminarayanan et al. 2017), all members in one matrix product."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import torch as th
from torch import nn
from torch.nn.functional import silu

from sb3_hucrl.data import TransitionDataset, Transitions
from sb3_hucrl.dynamics.base import DynamicsModel, FitReport, Prediction
from sb3_hucrl.dynamics.calibration import calibration_error, gaussian_nll
from sb3_hucrl.dynamics.features import StateFeatures

# Bounds of the noise variance of a standardised target: standard deviations of 0.7 % to 160 % of its own spread.
MIN_VARIANCE, MAX_VARIANCE = 5e-5, 2.7

# More rows than this are predicted in turns, so that the hidden layers stay in the cache and the allocator keeps their
# memory: nearly twice as fast at 4,096 rows.
CACHED_ROWS = 1_024


class BatchedLinear(nn.Module):
    """
    One linear layer for each of M members, applied as one product.

    :param num_members: M
    :param in_features: input width
    :param out_features: output width
    :param generator: draws the weights
    """

    def __init__(self, num_members: int, in_features: int, out_features: int, generator: th.Generator | None) -> None:
        super().__init__()
        weight = th.randn(num_members, in_features, out_features, generator=generator) / math.sqrt(in_features)
        self.weight = nn.Parameter(weight)
        self.bias = nn.Parameter(th.zeros(num_members, 1, out_features))

    def forward(self, inputs: th.Tensor) -> th.Tensor:
        """
        :param inputs: shape (M, B, in_features)
        :return: shape (M, B, out_features)
        """
        return th.baddbmm(self.bias, inputs, self.weight)


class Standardiser(nn.Module):
    """
    Shift and scale to zero mean and unit variance on the data so far.

    :param dim: number of columns
    """

    mean: th.Tensor
    std: th.Tensor

    def __init__(self, dim: int) -> None:
        super().__init__()
        self.register_buffer("mean", th.zeros(dim))
        self.register_buffer("std", th.ones(dim))

    def update(self, values: th.Tensor) -> None:
        """
        :param values: all data so far, shape (n, dim); a constant column keeps its scale
        """
        std = values.std(dim=0, correction=0)
        self.mean.copy_(values.mean(dim=0))
        self.std.copy_(th.where(std > 1e-8, std, th.ones_like(std)))

    def forward(self, values: th.Tensor) -> th.Tensor:
        return (values - self.mean) / self.std


class ProbabilisticEnsemble(DynamicsModel):
    """
    M independent networks, each of which predicts a normal distribution of the standardised state difference.

    The members' mixture is summarised by its moments: the mean of the means, their spread (epistemic), and the mean
    of the variances (aleatoric). Each member sees the data through its own Poisson(1) weights (appendix B.1).

    :param state_dim: p
    :param action_dim: q, without the hallucinated dimensions
    :param angle_dims: indices of the state's angles, which enter as (sin, cos)
    :param num_members: M, at least 2
    :param net_arch: widths of the hidden layers
    :param learning_rate: of Adam
    :param batch_size: transitions per member and gradient step
    :param gradient_steps: per fit
    :param generator: draws the initial weights
    :raises ValueError: if there are fewer than 2 members
    """

    def __init__(
        self,
        state_dim: int,
        action_dim: int,
        angle_dims: Sequence[int] = (),
        num_members: int = 5,
        net_arch: Sequence[int] = (64, 64),
        learning_rate: float = 1e-3,
        batch_size: int = 64,
        gradient_steps: int = 1_000,
        generator: th.Generator | None = None,
    ) -> None:
        super().__init__(state_dim, action_dim)
        if num_members < 2:
            raise ValueError(f"num_members is {num_members}: disagreement needs at least 2 members")
        self.num_members = num_members
        self.learning_rate = learning_rate
        self.batch_size = batch_size
        self.gradient_steps = gradient_steps
        self.features = StateFeatures(state_dim, angle_dims)
        input_dim = self.features.output_dim + action_dim
        self.inputs = Standardiser(input_dim)
        self.deltas = Standardiser(state_dim)
        widths = [input_dim, *net_arch, 2 * state_dim]
        self.layers = nn.ModuleList(
            BatchedLinear(num_members, width, next_width, generator) for width, next_width in pairwise(widths)
        )

    def members(self, inputs: th.Tensor) -> th.Tensor:
        """
        The bare networks.

        :param inputs: standardised, shape (M, B, input_dim)
        :return: for the standardised state difference, the mean in the first p columns and what
            :meth:`noise_variance` takes in the last p, shape (M, B, 2p)
        """
        if not th.is_grad_enabled() and inputs.shape[1] > CACHED_ROWS:
            return th.cat([self.members(rows) for rows in inputs.split(CACHED_ROWS, dim=1)], dim=1)
        hidden = inputs
        for layer in self.layers[:-1]:
            # In place where no gradient needs the old values: this halves the time of a large batch.
            hidden = silu(layer(hidden), inplace=not th.is_grad_enabled())
        outputs: th.Tensor = self.layers[-1](hidden)
        return outputs

    @staticmethod
    def noise_variance(raw: th.Tensor) -> th.Tensor:
        """
        :param raw: unbounded, any shape
        :return: its variance, exponential in between and smoothly bounded at both ends
        """
        return raw.sigmoid().mul(MAX_VARIANCE).add(MIN_VARIANCE)

    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        inputs = self.inputs(th.cat([self.features(state), action], dim=-1))
        outputs = self.members(inputs.expand(self.num_members, -1, -1))
        # All columns are reduced, though half of each result is dropped: a slice of the last dimension is not
        # contiguous, and reducing that takes twenty times as long.
        average = outputs.mean(dim=0)
        spread = (outputs - average).square().mean(dim=0)
        noise = self.noise_variance(outputs).mean(dim=0)
        p, scale = self.state_dim, self.deltas.std
        return Prediction(
            mean=th.addcmul(state + self.deltas.mean, average[:, :p], scale),
            # The root of an exact zero (members that agree to the last bit) would have an infinite gradient.
            epistemic_std=spread[:, :p].clamp(min=1e-12).sqrt() * scale,
            aleatoric_std=noise[:, p:].sqrt() * scale,
        )

    def fit(self, dataset: TransitionDataset, generator: th.Generator) -> FitReport:
        train = dataset.train
        if len(train) < 2:
            raise ValueError(
                f"an ensemble needs at least 2 training transitions, got {len(train)}: collect more episodes"
            )
        device = self.inputs.mean.device
        inputs, deltas = self._training_data(train, device)
        weights = dataset.bootstrap_weights(self.num_members).T.to(device)
        optimizer = th.optim.Adam(self.parameters(), lr=self.learning_rate, fused=True)
        member = th.arange(self.num_members, device=device).unsqueeze(1)
        batches = th.randint(
            len(train), (self.gradient_steps, self.num_members, self.batch_size), generator=generator
        ).to(device)
        losses = th.zeros(self.gradient_steps)
        for step, batch in enumerate(batches):
            mean, raw = self.members(inputs[batch]).chunk(2, dim=-1)
            variance = self.noise_variance(raw)
            nll = ((deltas[batch] - mean).square() / variance + variance.log()).sum(dim=-1)
            loss = 0.5 * (weights[member, batch] * nll).mean(dim=1).sum()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            losses[step] = loss.detach()
        train_loss = float(losses[-max(1, self.gradient_steps // 10) :].mean()) / self.num_members
        if not math.isfinite(train_loss):
            raise ValueError(
                f"the ensemble's training loss is {train_loss}: lower learning_rate (now {self.learning_rate})"
            )
        holdout_nll, error = self._evaluate(dataset.holdout, device)
        return FitReport(train_loss, len(train), holdout_nll, error)

    def _training_data(self, train: Transitions, device: th.device) -> tuple[th.Tensor, th.Tensor]:
        states, actions = train.states.to(device), train.actions.to(device)
        inputs = th.cat([self.features(states), actions], dim=-1)
        deltas = self.features.difference(train.next_states.to(device), states)
        self.inputs.update(inputs)
        self.deltas.update(deltas)
        return self.inputs(inputs), self.deltas(deltas)

    @th.no_grad()
    def _evaluate(self, holdout: Transitions, device: th.device) -> tuple[float, float]:
        prediction = self.predict(holdout.states.to(device), holdout.actions.to(device))
        error = self.features.difference(holdout.next_states.to(device), prediction.mean)
        std = prediction.predictive_std
        return float(gaussian_nll(error, std).mean()), float(calibration_error(error, std).mean())
