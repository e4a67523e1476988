"""A policy's network as linear layers and activations, into which scales are folded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import torch as th
from sb3_contrib.common.torch_layers import BatchRenorm
from torch import nn

from sb3_hucrl.sb3.layer_norm import NormalisedReLU


@dataclass(frozen=True)
class Scaling:
    """
    x becomes factor · x + shift, elementwise.

    :param factor: shape (width,)
    :param shift: shape (width,)
    """

    factor: th.Tensor
    shift: th.Tensor

    @classmethod
    def standardising(cls, mean: th.Tensor, std: th.Tensor) -> Scaling:
        """
        :param mean: shape (width,)
        :param std: shape (width,)
        :return: x becomes (x - mean) / std
        """
        mean, std = (each.detach().cpu().double() for each in (mean, std))
        return cls(1 / std, -mean / std)

    @classmethod
    def of(cls, normalization: BatchRenorm) -> Scaling:
        """
        :param normalization: layer that normalises by its running moments, as it does when a policy acts
        """
        moments, eps = (normalization.ra_mean, normalization.ra_var), normalization.eps
        mean, var = (moment.detach().cpu().double() for moment in moments)  # type: ignore[operator]  # typed as modules, too
        factor = normalization.scale.detach().cpu().double() / (var + eps).sqrt()
        return cls(factor, normalization.bias.detach().cpu().double() - factor * mean)


@dataclass(frozen=True)
class Dense:
    """
    A linear layer, in double precision.

    :param weight: shape (outputs, inputs)
    :param bias: shape (outputs,)
    """

    weight: th.Tensor
    bias: th.Tensor

    @classmethod
    def of(cls, layer: nn.Linear) -> Dense:
        """
        :param layer: may have no bias, which is 0 then
        """
        weight = layer.weight.detach().cpu().double()
        has_bias = layer.bias is not None
        return cls(weight, layer.bias.detach().cpu().double() if has_bias else weight.new_zeros(len(weight)))

    def after(self, scaling: Scaling) -> Dense:
        """
        :param scaling: of the inputs
        :return: a layer of the inputs before that
        """
        return Dense(self.weight * scaling.factor, self.bias + self.weight @ scaling.shift)

    def first(self, outputs: int) -> Dense:
        """
        :param outputs: how many to keep
        """
        return Dense(self.weight[:outputs], self.bias[:outputs])

    def write(self, layer: nn.Linear) -> None:
        """
        :param layer: of the same size
        """
        with th.no_grad():
            layer.weight.copy_(self.weight)
            layer.bias.copy_(self.bias)


Layers: TypeAlias = Sequence[Scaling | nn.Module]


@dataclass(frozen=True)
class Network:
    """
    Linear layers with the same activation after each but the last.

    :param hidden: all but the last
    :param activation: from torch alone and without parameters; None where there are no hidden layers
    :param output: the last
    """

    hidden: tuple[Dense, ...]
    activation: nn.Module | None
    output: Dense

    @classmethod
    def of(cls, layers: Layers) -> Network:
        """
        :param layers: in the order in which they act
        :raises ValueError: if no plain network computes the same
        """
        dense: list[Dense] = []
        activations: list[nn.Module] = []
        pending: list[Scaling] = []
        for layer in layers:
            if isinstance(layer, Scaling):
                pending.append(layer)
            elif isinstance(layer, BatchRenorm):
                pending.append(Scaling.of(layer))
            elif type(layer) is nn.Linear:
                each = Dense.of(layer)
                # What acts last on the inputs is the first to be folded.
                while pending:
                    each = each.after(pending.pop())
                dense.append(each)
            else:
                activations.append(_in_torch_alone(layer))
        kinds = {repr(each) for each in activations}
        if not dense or pending or len(kinds) > 1 or len(activations) != len(dense) - 1:
            found = [type(layer).__name__ for layer in layers]
            raise ValueError(
                f"the policy's network is {found}, and only linear layers with the same activation between each two of "
                "them can be exported: train with policy='MlpPolicy', with any net_arch and activation_fn"
            )
        return cls(tuple(dense[:-1]), activations[0] if activations else None, dense[-1])

    def first(self, outputs: int) -> Network:
        """
        :param outputs: how many to keep
        """
        return replace(self, output=self.output.first(outputs))


def _in_torch_alone(layer: nn.Module) -> nn.Module:
    if type(layer) is NormalisedReLU:
        # One group of all units. Unlike torch's LayerNorm, this need not know how many there are.
        return nn.Sequential(nn.GroupNorm(1, 1, affine=False), nn.ReLU())
    if not type(layer).__module__.startswith("torch.nn.") or layer.state_dict():
        raise ValueError(
            f"the policy's network has a layer {type(layer).__name__}: an exported policy has only linear layers and "
            "activations of torch.nn without parameters; train with such an activation_fn, for example "
            "policy_kwargs=dict(activation_fn=torch.nn.ReLU)"
        )
    return layer
