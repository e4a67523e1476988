"""Hallucinated back-propagation through time."""

from __future__ import annotations

from typing import Any

import torch as th
from stable_baselines3.common.type_aliases import GymEnv, ReplayBufferSamples
from stable_baselines3.common.utils import polyak_update
from torch.distributions import kl_divergence

from sb3_hucrl.algorithms.actor_critic import GaussianActorCritic
from sb3_hucrl.algorithms.gaussian_policy import GaussianPolicy
from sb3_hucrl.algorithms.imagined_rollouts import imagine, imagined_system
from sb3_hucrl.hallucinated_system import HallucinatedSystem


class HBPTT(GaussianActorCritic):
    """
    H-BPTT (Algorithm 4): the gradient of the imagined return goes back through model, reward and policy, N steps that
    a critic prolongs. A divergence from the policy of the last search holds the new one back.

    Needs :class:`sb3_hucrl.HUCRLCallback`, a model and a task that are differentiable, and no VecNormalize.

    :param policy: ``"MlpPolicy"``
    :param env: around which is an ImaginationVecEnv
    :param horizon: N
    :param kl_weight: λ, price of a nat of divergence from the last policy, at each step
    :param kwargs: of :class:`sb3_hucrl.algorithms.actor_critic.GaussianActorCritic`
    :raises ValueError: if the horizon is below 1 or the weight negative
    """

    def __init__(
        self,
        policy: str | type[GaussianPolicy],
        env: GymEnv | str,
        horizon: int = 8,
        kl_weight: float = 0.01,
        **kwargs: Any,
    ) -> None:
        if horizon < 1 or not kl_weight >= 0:
            raise ValueError(f"horizon is {horizon}, kl_weight {kl_weight}: give at least 1 and 0")
        self.horizon, self.kl_weight = horizon, kl_weight
        self._last_system: HallucinatedSystem | None = None
        super().__init__(policy, env, **kwargs)

    def _setup_model(self) -> None:
        super()._setup_model()
        self._generator = th.Generator(self.device).manual_seed(self.seed or 0)

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        system = imagined_system(self)
        if system is not self._last_system:
            # A new search begins: what the last one ended with is what to stay close to.
            polyak_update(self.policy.actor.parameters(), self.policy.actor_target.parameters(), 1.0)
            self._last_system = system
        super().train(gradient_steps, batch_size)

    def _targets(self, data: ReplayBufferSamples) -> th.Tensor:
        discounts = self.gamma if data.discounts is None else data.discounts
        actions = self.policy.actor(data.next_observations)
        values = th.cat(self.policy.critic_target(data.next_observations, actions), dim=1).amin(dim=1, keepdim=True)
        return data.rewards + (1 - data.dones) * discounts * values

    def _actor_loss(self, data: ReplayBufferSamples, noted: dict[str, list[float]]) -> th.Tensor:
        performance, divergence = self.performance(data.observations)
        noted["imagined_performance"].append(performance.item())
        noted["kl"].append(divergence.item())
        return self.kl_weight * divergence - performance

    def performance(self, observations: th.Tensor) -> tuple[th.Tensor, th.Tensor]:
        """
        J of Algorithm 4, lines 4 to 10, mean over B start states.

        :param observations: of the start states, shape (B, observation dimension)
        :return: the discounted return with its bootstrap, and the divergence, a sum over the N steps
        """
        actor, system = self.policy.actor, imagined_system(self)
        rollout = imagine(system, observations, actor, self.horizon, self.gamma, self._generator, self._value)
        visited = system.task.observe(th.cat(rollout.states[:-1]))
        divergence = kl_divergence(
            actor.distribution(visited), self.policy.actor_target.distribution(visited)
        ).sum() / len(observations)
        return rollout.returns.mean(), divergence

    def _value(self, observations: th.Tensor) -> th.Tensor:
        return th.cat(self.policy.critic(observations, self.policy.actor(observations)), dim=1).amin(dim=1)

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "_last_system", "_generator"]
