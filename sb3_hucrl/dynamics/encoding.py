"""Input encoding and standardisation."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch as th
from torch import nn


class StateFeatures(nn.Module):
    """
    Encodes angles as (sin, cos), because the angles themselves jump at ±π.

    :param state_dim: p
    :param angle_dims: indices of the state's angles, in radians
    :raises ValueError: if an index lies outside the state
    """

    angle_dims: th.Tensor
    linear_dims: th.Tensor

    def __init__(self, state_dim: int, angle_dims: Sequence[int] = ()) -> None:
        super().__init__()
        outside = [dim for dim in angle_dims if not 0 <= dim < state_dim]
        if outside:
            raise ValueError(f"angle_dims {outside} lie outside a state of {state_dim} dimensions")
        linear_dims = [dim for dim in range(state_dim) if dim not in angle_dims]
        self.register_buffer("angle_dims", th.tensor(angle_dims, dtype=th.long), persistent=False)
        self.register_buffer("linear_dims", th.tensor(linear_dims, dtype=th.long), persistent=False)
        self.output_dim = len(linear_dims) + 2 * len(angle_dims)

    def forward(self, state: th.Tensor) -> th.Tensor:
        """
        :param state: shape (..., p)
        :return: shape (..., output_dim)
        """
        if len(self.angle_dims) == 0:
            return state
        angles = state.index_select(-1, self.angle_dims)
        return th.cat([angles.sin(), angles.cos(), state.index_select(-1, self.linear_dims)], dim=-1)

    def difference(self, state: th.Tensor, reference: th.Tensor) -> th.Tensor:
        """
        state - reference, with angle differences wrapped to [-π, π).

        :param state: shape (..., p)
        :param reference: shape (..., p)
        :return: shape (..., p)
        """
        delta = state - reference
        delta[..., self.angle_dims] = (delta[..., self.angle_dims] + math.pi) % (2 * math.pi) - math.pi
        return delta


class Standardiser(nn.Module):
    """
    Shifts and scales columns to zero mean and unit variance on the data so far.

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
        Compute mean and standard deviation.

        :param values: all data so far, shape (n, dim); the scale of a constant column is 1
        """
        std = values.std(dim=0, correction=0)
        self.mean.copy_(values.mean(dim=0))
        self.std.copy_(th.where(std > 1e-8, std, th.ones_like(std)))

    def forward(self, values: th.Tensor) -> th.Tensor:
        return (values - self.mean) / self.std
