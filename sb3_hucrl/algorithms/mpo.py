"""Maximum a-posteriori policy optimisation."""

from __future__ import annotations

from typing import Any

import torch as th
from stable_baselines3.common.type_aliases import GymEnv, ReplayBufferSamples
from stable_baselines3.common.utils import polyak_update
from torch.distributions import Normal

from sb3_hucrl.algorithms.actor_critic import GaussianActorCritic
from sb3_hucrl.algorithms.gaussian_policy import GaussianPolicy
from sb3_hucrl.algorithms.mpo_loss import MPOLoss


class MPO(GaussianActorCritic):
    """
    MPO (Abdolmaleki et al. 2018): actions of the old policy are weighted by what the critic says of them (E-step), and
    the new policy is fitted to them within a trust region (M-step). Works on any environment with continuous actions.

    :param policy: ``"MlpPolicy"``
    :param env: with continuous actions
    :param num_samples: K, actions per state in the E-step and in the critics' targets
    :param epsilon: bound of the E-step, in nats
    :param epsilon_mean: bound of the M-step on the KL divergence through the mean, in nats
    :param epsilon_std: the same through the standard deviation
    :param dual_learning_rate: of temperature and multipliers
    :param policy_interval: gradient steps after which the new policy takes the old one's place
    :param kwargs: of :class:`sb3_hucrl.algorithms.actor_critic.GaussianActorCritic`
    :raises ValueError: if a bound is not positive or a number below 1
    """

    def __init__(
        self,
        policy: str | type[GaussianPolicy],
        env: GymEnv | str,
        num_samples: int = 20,
        epsilon: float = 0.1,
        epsilon_mean: float = 0.01,
        epsilon_std: float = 1e-4,
        dual_learning_rate: float = 1e-2,
        policy_interval: int = 100,
        **kwargs: Any,
    ) -> None:
        if min(num_samples - 1, policy_interval) < 1:
            raise ValueError(f"num_samples is {num_samples}, policy_interval {policy_interval}: give at least 2 and 1")
        self.num_samples = num_samples
        self.epsilon, self.epsilon_mean, self.epsilon_std = epsilon, epsilon_mean, epsilon_std
        self.dual_learning_rate = dual_learning_rate
        self.policy_interval = policy_interval
        super().__init__(policy, env, **kwargs)

    def _setup_model(self) -> None:
        super()._setup_model()
        self.loss = MPOLoss(self.epsilon, self.epsilon_mean, self.epsilon_std).to(self.device)
        self.dual_optimizer = th.optim.Adam(self.loss.parameters(), lr=self.dual_learning_rate)

    def _targets(self, data: ReplayBufferSamples) -> th.Tensor:
        discounts = self.gamma if data.discounts is None else data.discounts
        next_values = self._sample_values(data.next_observations)[2].mean(dim=0).unsqueeze(1)
        return data.rewards + (1 - data.dones) * discounts * next_values

    @th.no_grad()
    def _sample_values(self, observations: th.Tensor) -> tuple[Normal, th.Tensor, th.Tensor]:
        """The old policy in each of B states, K actions that it draws, shape (K, B, d), and their Q, shape (K, B)."""
        old = self.policy.actor_target.distribution(observations)
        actions = old.sample(th.Size([self.num_samples]))
        repeated = observations.expand(self.num_samples, *observations.shape).flatten(0, 1)
        values = th.cat(self.policy.critic_target(repeated, actions.flatten(0, 1).clamp(-1, 1)), dim=1)
        return old, actions, values.amin(dim=1).view(actions.shape[:2])

    def _actor_loss(self, data: ReplayBufferSamples, noted: dict[str, list[float]]) -> th.Tensor:
        old, actions, values = self._sample_values(data.observations)
        terms = self.loss(old, self.policy.actor.distribution(data.observations), actions, values)
        noted["temperature"].append(self.loss.temperature.item())
        noted["kl_mean"].append(terms.kl_mean.item())
        noted["kl_std"].append(terms.kl_std.item())
        total: th.Tensor = terms.policy_loss + terms.dual_loss
        return total

    def _actor_optimizers(self) -> list[th.optim.Optimizer]:
        return [*super()._actor_optimizers(), self.dual_optimizer]

    def _after_gradient_step(self) -> None:
        if self._n_updates % self.policy_interval == 0:
            polyak_update(self.policy.actor.parameters(), self.policy.actor_target.parameters(), 1.0)

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "loss", "dual_optimizer"]

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        modules, tensors = super()._get_torch_save_params()
        return [*modules, "loss", "dual_optimizer"], tensors
