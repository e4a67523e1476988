"""Independent networks of the same shape, evaluated by one batched matrix product per layer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import torch as th
from torch import nn
from torch.nn.functional import layer_norm, silu

# Larger batches are split into chunks of this many rows, so that hidden layers fit into the cache and their memory is
# reused: nearly twice as fast at 4,096 rows.
CACHED_ROWS = 1_024


class BatchedLinear(nn.Module):
    """
    One linear layer for each of M members, evaluated as one batched product.

    :param num_members: M
    :param in_features: input width
    :param out_features: output width
    :param generator: draws the initial weights
    """

    def __init__(self, num_members: int, in_features: int, out_features: int, generator: th.Generator | None) -> None:
        super().__init__()
        weight = th.randn(num_members, in_features, out_features, generator=generator) / math.sqrt(in_features)
        self.weight = nn.Parameter(weight)
        self.bias = nn.Parameter(th.zeros(num_members, 1, out_features))

    def forward(self, inputs: th.Tensor, member: slice) -> th.Tensor:
        """
        :param inputs: shape (m, B, in_features)
        :param member: slice of the m members to evaluate
        :return: shape (m, B, out_features)
        """
        return th.baddbmm(self.bias[member], inputs, self.weight[member])


class BatchedNetworks(nn.Module):
    """
    M multilayer perceptrons with SiLU activations, whose hidden layers can be normalised before them.

    A normalised layer hardly tells a large input from a very large one, so members agree where they know nothing. On a
    linear path the first layer's output reaches the output layer as it is, beside the last hidden layer: far from the
    data members are linear, and each has another slope.

    :param num_members: M
    :param input_dim: input width
    :param net_arch: widths of the hidden layers
    :param output_dim: output width
    :param generator: draws the initial weights
    :param layer_norm: whether hidden layers have mean 0 and variance 1 over their units (Ba et al. 2016)
    :param linear_path: whether there is one; the first and the last hidden layer must have the same width
    """

    #: of networks in files of earlier versions
    layer_norm = linear_path = False

    def __init__(
        self,
        num_members: int,
        input_dim: int,
        net_arch: Sequence[int],
        output_dim: int,
        generator: th.Generator | None,
        layer_norm: bool = False,
        linear_path: bool = False,
    ) -> None:
        super().__init__()
        self.layer_norm, self.linear_path = layer_norm, linear_path
        self.layers = nn.ModuleList(
            BatchedLinear(num_members, width, next_width, generator)
            for width, next_width in pairwise([input_dim, *net_arch, output_dim])
        )
        if layer_norm:
            # A normalised layer forgets the size of its input: without biases it would jump at 0, the mean of the data.
            nn.init.normal_(self.layers[0].get_parameter("bias"), generator=generator)

    def forward(self, inputs: th.Tensor, member: slice = slice(None)) -> th.Tensor:
        """
        :param inputs: shape (m, B, input_dim)
        :param member: slice of the m members to evaluate, all by default
        :return: shape (m, B, output_dim)
        """
        if not th.is_grad_enabled() and inputs.shape[1] > CACHED_ROWS:
            return th.cat([self(rows, member) for rows in inputs.split(CACHED_ROWS, dim=1)], dim=1)
        hidden, linear = inputs, None
        # A slice of the list would be a new module, made in every step.
        *hidden_layers, last = self.layers
        for layer in hidden_layers:
            hidden = layer(hidden, member)
            if self.linear_path and linear is None:
                linear = hidden
            if self.layer_norm:
                hidden = layer_norm(hidden, hidden.shape[-1:])
            # In place unless the old values are needed, which halves the time of a large batch.
            hidden = silu(hidden, inplace=not th.is_grad_enabled() and hidden is not linear)
        if linear is not None:
            hidden = hidden + linear
        outputs: th.Tensor = last(hidden, member)
        return outputs

    @property
    def num_members(self) -> int:
        """M."""
        return len(self.last.weight)

    @property
    def last(self) -> BatchedLinear:
        """The output layer."""
        layer = self.layers[-1]
        assert isinstance(layer, BatchedLinear)  # as all are
        return layer

    def one_each(self, inputs: th.Tensor, generator: th.Generator) -> th.Tensor:
        """
        Evaluate one member on each row, at the cost of one. Each member has the same number of places, and the rows are
        dealt to them at random, so that every row meets every member with the same probability.

        :param inputs: shape (B, input_dim)
        :param generator: deals the rows, on the CPU
        :return: shape (B, output_dim)
        """
        members, rows = self.num_members, len(inputs)
        places = -(-rows // members) * members
        place = th.randperm(places, generator=generator)[:rows].to(inputs.device)
        dealt = inputs.new_zeros(places, inputs.shape[1]).index_copy(0, place, inputs)
        outputs: th.Tensor = self(dealt.view(members, -1, inputs.shape[1])).flatten(0, 1)
        return outputs[place]
