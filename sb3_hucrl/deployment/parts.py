"""What there is to a policy that can be exported."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import torch as th
from torch import nn

from sb3_hucrl.deployment.layers import Layers

#: algorithm of stable_baselines3 whose policies act in the same way: a squashed Gaussian, a squashed function of the
#: observation, or a Gaussian that is clipped
Kind: TypeAlias = Literal["SAC", "TD3", "PPO"]


@dataclass(frozen=True)
class ActorParts:
    """
    The layers of a policy over d action dimensions, a′ included.

    :param kind: how actions come from the last layers
    :param layers: all but the last, beginning with the scales of the observations
    :param mean: last layer, before actions are squashed or clipped, with d outputs
    :param log_std: last layer beside ``mean`` in SAC, parameter of shape (d,) in PPO, and None in TD3
    """

    kind: Kind
    layers: Layers
    mean: nn.Linear
    log_std: nn.Linear | th.Tensor | None = None
