"""Normalised hidden layers in the actors and critics of off-policy algorithms."""

from __future__ import annotations

from itertools import pairwise

import torch as th
from stable_baselines3.common.base_class import BaseAlgorithm
from torch import nn
from torch.nn.functional import layer_norm

#: layers of networks that normalise nothing; a tanh ends the actor of TD3
PLAIN = {nn.Linear, nn.ReLU, nn.Tanh}


class NormalisedReLU(nn.Module):
    """
    ReLU of a hidden layer with mean 0 and variance 1 over its units (Ba et al. 2016). It has no parameters.

    Short imagined trajectories end in states from which none begins. What a plain critic extrapolates there may grow
    with every bootstrap; with normalised layers it stays bounded by the last layer's weights (Ball et al. 2023).
    """

    def forward(self, inputs: th.Tensor) -> th.Tensor:
        """
        :param inputs: shape (..., units)
        """
        return layer_norm(inputs, inputs.shape[-1:]).relu()


def insert_layer_norm(model: BaseAlgorithm) -> None:
    """
    Normalise the hidden layers of a new policy. An ``activation_fn`` that the user chose stays, and so do networks that
    normalise in their own way, as CrossQ's do, or are not in torch.

    :param model: off-policy algorithm that has not been trained yet
    """
    if "activation_fn" in model.policy_kwargs:
        return
    inserted = False
    for network in list(model.policy.modules()):
        if not isinstance(network, nn.Sequential) or not {type(layer) for layer in network} <= PLAIN:
            continue
        for index, (layer, following) in enumerate(pairwise(network), start=1):
            if type(layer) is nn.Linear and type(following) is nn.ReLU:
                network[index] = NormalisedReLU()
                inserted = True
    if inserted:
        # What a saved model is made anew from.
        model.policy_kwargs = {**model.policy_kwargs, "activation_fn": NormalisedReLU}
        model.logger.info(
            "hidden layers are normalised, so that critics do not diverge; "
            "policy_kwargs=dict(activation_fn=nn.ReLU) leaves them as they are"
        )
