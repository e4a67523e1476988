"""Actor-critic networks with a Gaussian policy and targets of both."""

from __future__ import annotations

from typing import Any

import torch as th
from gymnasium import spaces
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.preprocessing import get_action_dim
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, create_mlp
from stable_baselines3.common.type_aliases import PyTorchObs, Schedule
from stable_baselines3.td3.policies import TD3Policy
from torch import nn
from torch.distributions import Normal
from torch.nn.functional import softplus

#: standard deviations at the start and at least, in actions scaled to [-1, 1]
INITIAL_STD, SMALLEST_STD = 0.5, 1e-3


class GaussianActor(BasePolicy):
    """
    Diagonal Gaussian over actions scaled to [-1, 1]: tanh mean, and samples clipped to [-1, 1].

    :param observation_space: of the environment
    :param action_space: of the environment
    :param net_arch: widths of the hidden layers
    :param features_extractor: maps observations to features
    :param features_dim: number of features
    :param activation_fn: between layers
    :param normalize_images: whether to scale images
    """

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Box,
        net_arch: list[int],
        features_extractor: nn.Module,
        features_dim: int,
        activation_fn: type[nn.Module] = nn.ReLU,
        normalize_images: bool = True,
    ) -> None:
        super().__init__(
            observation_space,
            action_space,
            features_extractor=features_extractor,
            normalize_images=normalize_images,
            squash_output=True,
        )
        width = net_arch[-1] if net_arch else features_dim
        self.latent = nn.Sequential(*create_mlp(features_dim, -1, net_arch, activation_fn))
        self.mean_std = nn.Linear(width, 2 * get_action_dim(action_space))

    def distribution(self, observation: PyTorchObs) -> Normal:
        """
        :param observation: of B states
        :return: of scaled actions, shape (B, d)
        """
        assert self.features_extractor is not None
        latent = self.latent(self.extract_features(observation, self.features_extractor))
        mean, std = self.mean_std(latent).chunk(2, dim=1)
        return Normal(mean.tanh(), softplus(std) * (INITIAL_STD / softplus(th.zeros(()))) + SMALLEST_STD)

    def forward(self, observation: PyTorchObs, deterministic: bool = False) -> th.Tensor:
        return self._predict(observation, deterministic)

    def _predict(self, observation: PyTorchObs, deterministic: bool = False) -> th.Tensor:
        distribution = self.distribution(observation)
        return distribution.mean if deterministic else distribution.rsample().clamp(-1, 1)


class GaussianPolicy(TD3Policy):
    """
    TD3's networks (actor, critics and the targets of both) with a Gaussian actor.

    :param observation_space: of the environment
    :param action_space: of the environment
    :param lr_schedule: learning rate as a function of the remaining progress, from 1 to 0
    :param net_arch: widths of the hidden layers, or those of actor (``pi``) and critics (``qf``)
    :param kwargs: as :class:`stable_baselines3.td3.policies.TD3Policy` has them
    """

    actor: GaussianActor  # type: ignore[assignment]  # TD3's is another
    actor_target: GaussianActor  # type: ignore[assignment]  # as above

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Box,
        lr_schedule: Schedule,
        net_arch: list[int] | dict[str, list[int]] | None = None,
        **kwargs: Any,
    ) -> None:
        # TD3's own are wider, and MPO evaluates its critics on many actions per state.
        super().__init__(observation_space, action_space, lr_schedule, net_arch or [256, 256], **kwargs)

    def make_actor(  # type: ignore[override]  # TD3's is another
        self, features_extractor: BaseFeaturesExtractor | None = None
    ) -> GaussianActor:
        return GaussianActor(**self._update_features_extractor(self.actor_kwargs, features_extractor)).to(self.device)

    def _predict(self, observation: PyTorchObs, deterministic: bool = False) -> th.Tensor:
        action: th.Tensor = self.actor(observation, deterministic)
        return action
