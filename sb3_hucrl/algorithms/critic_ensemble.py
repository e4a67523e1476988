"""SAC's networks with an ensemble of critics that is evaluated as one."""

from __future__ import annotations

from typing import Any

import torch as th
from gymnasium import spaces
from stable_baselines3.common.policies import BaseModel
from stable_baselines3.common.preprocessing import get_action_dim
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.type_aliases import PyTorchObs, Schedule
from stable_baselines3.sac.policies import SACPolicy
from torch import nn

from sb3_hucrl.dynamics.networks import BatchedNetworks


class CriticEnsemble(BaseModel):
    """
    Q(s, a) by independent networks with normalised hidden layers, one batched matrix product per layer. Their last
    layers begin at zero: nothing is hoped for yet. They learn in units of their own, whatever those of the rewards.

    :param observation_space: of the environment
    :param action_space: of the environment
    :param net_arch: widths of the hidden layers
    :param features_extractor: maps observations to features
    :param features_dim: number of features
    :param n_critics: number of networks
    :param normalize_images: whether to scale images
    :param kwargs: what else SB3 gives its critics
    """

    features_extractor: BaseFeaturesExtractor
    scale: th.Tensor

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Box,
        net_arch: list[int],
        features_extractor: BaseFeaturesExtractor,
        features_dim: int,
        n_critics: int = 2,
        normalize_images: bool = True,
        **kwargs: Any,
    ) -> None:
        super().__init__(
            observation_space, action_space, features_extractor=features_extractor, normalize_images=normalize_images
        )
        width = features_dim + get_action_dim(action_space)
        self.networks = BatchedNetworks(n_critics, width, net_arch, 1, None, layer_norm=True)
        nn.init.zeros_(self.networks.last.weight)
        self.register_buffer("scale", th.ones(()))

    @th.no_grad()
    def adopt(self, scale: float) -> None:
        """
        Learn in other units from now on. Values stay what they are.

        :param scale: one unit, in units of the reward
        """
        for parameter in self.networks.last.parameters():
            parameter.mul_(self.scale / scale)
        self.scale.fill_(scale)

    def values(self, observation: PyTorchObs, action: th.Tensor) -> th.Tensor:
        """
        :param observation: of B states
        :param action: scaled to [-1, 1], shape (B, d)
        :return: of each critic, in units of the reward, shape (critics, B)
        """
        features = self.extract_features(observation, self.features_extractor)
        inputs = th.cat([features, action], dim=1)
        outputs: th.Tensor = self.networks(inputs.expand(self.networks.num_members, -1, -1))
        return self.scale * outputs.squeeze(2)

    def forward(self, observation: PyTorchObs, action: th.Tensor) -> tuple[th.Tensor, ...]:
        """As SB3's critics answer."""
        return self.values(observation, action).unsqueeze(2).unbind()


class EnsemblePolicy(SACPolicy):
    """
    SAC's actor with smooth activations, through which gradients of the model flow, and a :class:`CriticEnsemble`.

    :param observation_space: of the environment
    :param action_space: of the environment
    :param lr_schedule: learning rate as a function of the remaining progress, from 1 to 0
    :param net_arch: widths of the hidden layers, or those of actor (``pi``) and critics (``qf``)
    :param activation_fn: of the actor
    :param kwargs: as :class:`stable_baselines3.sac.policies.SACPolicy` has them
    """

    critic: CriticEnsemble  # type: ignore[assignment]  # SAC's is another
    critic_target: CriticEnsemble  # type: ignore[assignment]  # as above

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Box,
        lr_schedule: Schedule,
        net_arch: list[int] | dict[str, list[int]] | None = None,
        activation_fn: type[nn.Module] = nn.SiLU,
        **kwargs: Any,
    ) -> None:
        super().__init__(observation_space, action_space, lr_schedule, net_arch or [128, 128], activation_fn, **kwargs)

    def make_critic(  # type: ignore[override]  # SAC's is another
        self, features_extractor: BaseFeaturesExtractor | None = None
    ) -> CriticEnsemble:
        kwargs = self._update_features_extractor(self.critic_kwargs, features_extractor)
        return CriticEnsemble(**kwargs).to(self.device)
