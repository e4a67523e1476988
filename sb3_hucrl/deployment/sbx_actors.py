"""The networks of SBX's policies, which are in JAX."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import torch as th
from stable_baselines3.common.base_class import BaseAlgorithm
from torch import nn

from sb3_hucrl.deployment.parts import ActorParts

#: by the names of jax.nn
ACTIVATIONS: dict[str, nn.Module] = {
    "relu": nn.ReLU(),
    "tanh": nn.Tanh(),
    "elu": nn.ELU(),
    "silu": nn.SiLU(),
    "leaky_relu": nn.LeakyReLU(),
    "gelu": nn.GELU(approximate="tanh"),
}


def is_sbx(model: BaseAlgorithm) -> bool:
    """
    :param model: SB3 algorithm
    """
    return any(base.__module__.startswith("sbx.") for base in type(model).__mro__)


def sbx_actor(model: BaseAlgorithm) -> ActorParts:
    """
    :param model: algorithm of SBX
    :raises ValueError: if its policy has other layers than Dense, or an activation that torch does not have
    """
    from sbx.common.policies import SquashedGaussianActor
    from sbx.ppo.policies import Actor as PPOActor
    from sbx.td3.policies import Actor as TD3Actor

    policy: Any = model.policy
    actor = policy.actor
    activation = ACTIVATIONS.get(policy.activation_fn.__name__)
    if type(actor) not in (SquashedGaussianActor, PPOActor, TD3Actor) or activation is None:
        raise ValueError(
            f"the policy is {type(policy).__name__} of SBX with {type(actor).__name__} and the activation function "
            f"{policy.activation_fn.__name__}: of SBX, MlpPolicy of SAC, TQC, TD3, DDPG and PPO can be exported, with "
            f"{sorted(ACTIVATIONS)}; or train the same algorithm of stable-baselines3 or sb3-contrib"
        )
    parameters = policy.actor_state.params["params"]
    names = sorted((name for name in parameters if name.startswith("Dense_")), key=lambda name: int(name[6:]))
    dense = [_linear(parameters[name]) for name in names]
    number = 2 if type(actor) is SquashedGaussianActor else 1
    hidden: list[nn.Module] = []
    for layer in dense[:-number]:
        hidden += [layer, activation]
    if type(actor) is SquashedGaussianActor:
        return ActorParts("SAC", hidden, dense[-2], dense[-1])
    if type(actor) is PPOActor:
        return ActorParts("PPO", hidden, dense[-1], _tensor(parameters["log_std"]))
    return ActorParts("TD3", hidden, dense[-1])


def _linear(parameters: Mapping[str, npt.ArrayLike]) -> nn.Linear:
    weight, bias = _tensor(parameters["kernel"]).T, _tensor(parameters["bias"])
    layer = nn.Linear(weight.shape[1], weight.shape[0])
    with th.no_grad():
        layer.weight.copy_(weight)
        layer.bias.copy_(bias)
    return layer


def _tensor(values: npt.ArrayLike) -> th.Tensor:
    return th.from_numpy(np.array(values))
