"""The paper's own policy search: MPO with a value critic and one imagined step."""

from __future__ import annotations

from typing import Any, ClassVar

import torch as th
from gymnasium import spaces
from stable_baselines3.common.policies import BaseModel, BasePolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, create_mlp
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from torch import nn
from torch.distributions import Normal

from sb3_hucrl.algorithms.gaussian_policy import GaussianPolicy
from sb3_hucrl.algorithms.imagined_rollouts import imagine, imagined_world, require_no_normalization
from sb3_hucrl.algorithms.mpo import MPO
from sb3_hucrl.seeding import seeded_generator


class ValueCritic(BaseModel):
    """
    State values V(s), in the place of SB3's critics Q(s, a).

    :param observation_space: of the environment
    :param action_space: of the environment
    :param net_arch: widths of the hidden layers
    :param features_extractor: maps observations to features
    :param features_dim: number of features
    :param activation_fn: between layers
    :param normalize_images: whether to scale images
    :param n_critics: number of critics
    :param share_features_extractor: whether only the actor trains the features extractor
    """

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Box,
        net_arch: list[int],
        features_extractor: BaseFeaturesExtractor,
        features_dim: int,
        activation_fn: type[nn.Module] = nn.ReLU,
        normalize_images: bool = True,
        n_critics: int = 2,
        share_features_extractor: bool = True,
    ) -> None:
        super().__init__(
            observation_space, action_space, features_extractor=features_extractor, normalize_images=normalize_images
        )
        self._share_features_extractor = share_features_extractor
        self.networks = nn.ModuleList(
            nn.Sequential(*create_mlp(features_dim, 1, net_arch, activation_fn)) for _ in range(n_critics)
        )

    def forward(self, observations: th.Tensor, actions: th.Tensor) -> tuple[th.Tensor, ...]:
        assert self.features_extractor is not None
        with th.set_grad_enabled(th.is_grad_enabled() and not self._share_features_extractor):
            features = self.extract_features(observations, self.features_extractor)
        return tuple(network(features) for network in self.networks)


class GaussianValuePolicy(GaussianPolicy):
    """Gaussian actor with critics that see no actions."""

    def make_critic(  # type: ignore[override]  # TD3's see actions
        self, features_extractor: BaseFeaturesExtractor | None = None
    ) -> ValueCritic:
        return ValueCritic(**self._update_features_extractor(self.critic_kwargs, features_extractor)).to(self.device)


class HMPO(MPO):
    """
    MPO as in the paper's experiments: only a value function is learned, and the value of an action comes from one
    imagined step, Q(s, (a, a′)) = r(s, a) + γ V(s′) (appendix B.1). Of the replayed transitions only the states are
    used.

    Needs :class:`sb3_hucrl.HUCRLCallback` and no VecNormalize. Constructed as :class:`sb3_hucrl.algorithms.MPO`.
    """

    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {"MlpPolicy": GaussianValuePolicy}

    def _setup_model(self) -> None:
        require_no_normalization(self)
        super()._setup_model()
        self._generator = seeded_generator(self.seed, self.device)

    def _targets(self, data: ReplayBufferSamples) -> th.Tensor:
        return self._sample_values(data.observations)[2].mean(dim=0).unsqueeze(1)

    @th.no_grad()
    def _sample_values(self, observations: th.Tensor) -> tuple[Normal, th.Tensor, th.Tensor]:
        actor = self.policy.actor_target
        old = actor.distribution(observations)
        actions = old.sample(th.Size([self.num_samples]))
        repeated = observations.expand(self.num_samples, *observations.shape).flatten(0, 1)
        step = imagine(
            imagined_world(self),
            repeated,
            actor,
            1,
            self.gamma,
            self._generator,
            terminal_value=self._value,
            first_actions=actions.flatten(0, 1).clamp(-1, 1),
        )
        return old, actions, step.returns.view(actions.shape[:2])

    def _value(self, observations: th.Tensor) -> th.Tensor:
        # No action is looked at.
        return th.cat(self.policy.critic_target(observations, observations), dim=1).amin(dim=1)

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "_generator"]
