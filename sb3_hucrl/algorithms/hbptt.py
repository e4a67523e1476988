"""Hallucinated back-propagation through time."""

from __future__ import annotations

from collections import defaultdict
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, ClassVar

import torch as th
from stable_baselines3.common.distributions import SquashedDiagGaussianDistribution
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.utils import polyak_update
from stable_baselines3.sac.policies import SACPolicy
from torch.distributions import Normal, kl_divergence
from torch.nn.functional import mse_loss
from torch.nn.utils import clip_grad_norm_

from sb3_hucrl.algorithms.arguments import Environment
from sb3_hucrl.algorithms.imagined_rollouts import imagine, imagined_world
from sb3_hucrl.algorithms.imagining_sac import ImaginingSAC
from sb3_hucrl.checks import Count, NotNegative, Positive, validated
from sb3_hucrl.imagination import World


@dataclass(frozen=True)
class Performance:
    """
    Performance of a policy in B imagined trajectories.

    :param value: discounted rewards and entropies plus the terminal critic value, mean over trajectories
    :param divergence: from the last policy, sum over the N steps, mean over trajectories
    :param first_log_prob: of each first action, shape (B,)
    """

    value: th.Tensor
    divergence: th.Tensor
    first_log_prob: th.Tensor


@validated
class HBPTT(ImaginingSAC):
    """
    H-BPTT (Algorithm 4): the policy follows the gradient of the imagined return through model, reward and policy. The
    return is that of N model steps plus a terminal critic value. A penalty on the divergence from the last search's
    policy is optional.

    Policy, critics and entropy bonus are SAC's: an action at its limit passes no gradient, and the entropy keeps the
    policy away from the limits.

    Needs :class:`sb3_hucrl.HUCRLCallback`, a model and a task that are differentiable, and no VecNormalize.

    :param policy: ``"MlpPolicy"``
    :param env: wrapped in an ImaginationVecEnv
    :param horizon: N
    :param kl_weight: λ, weight of the divergence from the last policy at each step, per nat; 0 for none
    :param policy_delay: gradient steps of the critics for each one of the policy, which takes many times as long
    :param max_grad_norm: bound on the norm of the policy's gradient
    :param kwargs: further arguments of SAC
    :raises ValueError: if a number is out of its range, or with gSDE
    """

    unused: ClassVar[tuple[str, ...]] = ("target_update_interval",)

    def __init__(
        self,
        policy: str | type[SACPolicy],
        env: Environment,
        horizon: Count = 8,
        kl_weight: NotNegative = 0.0,
        policy_delay: Count = 2,
        max_grad_norm: Positive = 40.0,
        **kwargs: Any,
    ) -> None:
        self.horizon, self.kl_weight = horizon, kl_weight
        self.policy_delay, self.max_grad_norm = policy_delay, max_grad_norm
        super().__init__(policy, env, **kwargs)

    def _setup_model(self) -> None:
        super()._setup_model()
        self._last_actor = deepcopy(self.actor).requires_grad_(False)
        self._last_world: World | None = None

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        world = imagined_world(self)
        if world is not self._last_world:
            # A new search begins: it stays close to the policy that the last one ended with.
            self._last_actor = deepcopy(self.actor).requires_grad_(False)
            self._last_world = world
        self._begin_training()
        noted: dict[str, list[float]] = defaultdict(list)
        assert self.replay_buffer is not None  # set up
        for _ in range(gradient_steps):
            data = self.replay_buffer.sample(batch_size, env=self._vec_normalize_env)
            noted["ent_coef"].append(self._ent_coef().item())
            noted["critic_loss"].append(self._train_critic(data))
            polyak_update(self.critic.parameters(), self.critic_target.parameters(), self.tau)
            self._n_updates += 1
            if self._n_updates % self.policy_delay == 0:
                self._train_actor(data, noted)
        self._record_means(noted)

    def _train_critic(self, data: ReplayBufferSamples) -> float:
        discounts = self.gamma if data.discounts is None else data.discounts
        with th.no_grad():
            actions, log_prob = self.actor.action_log_prob(data.next_observations)
            values = th.cat(self.critic_target(data.next_observations, actions), dim=1).amin(dim=1)
            following = (values - self._ent_coef() * log_prob).unsqueeze(1)
            targets = data.rewards + (1 - data.dones) * discounts * following
        loss = th.stack([mse_loss(values, targets) for values in self.critic(data.observations, data.actions)]).sum()
        self.critic.optimizer.zero_grad()
        loss.backward()
        self.critic.optimizer.step()
        return loss.item()

    def _train_actor(self, data: ReplayBufferSamples, noted: dict[str, list[float]]) -> None:
        imagined = self.performance(data.observations)
        self.actor.optimizer.zero_grad()
        (self.kl_weight * imagined.divergence - imagined.value).backward()
        clip_grad_norm_(self.actor.parameters(), self.max_grad_norm)
        self.actor.optimizer.step()
        noted["imagined_performance"].append(imagined.value.item())
        noted["kl"].append(imagined.divergence.item())
        self._train_ent_coef(imagined.first_log_prob)

    def performance(self, observations: th.Tensor) -> Performance:
        """
        J of Algorithm 4, lines 4 to 10.

        :param observations: of B start states, shape (B, observation dimension)
        """
        world, ent_coef = imagined_world(self), self._ent_coef()
        log_probs: list[th.Tensor] = []
        divergences: list[th.Tensor] = []

        def act(visited: th.Tensor) -> th.Tensor:
            mean, log_std, _ = self.actor.get_action_dist_params(visited)
            assert isinstance(self.actor.action_dist, SquashedDiagGaussianDistribution)  # no gSDE
            actions, log_prob = self.actor.action_dist.log_prob_from_params(mean, log_std)
            log_probs.append(log_prob)
            old_mean, old_log_std, _ = self._last_actor.get_action_dist_params(visited)
            # Squashing changes both policies alike, so the divergence is that of the Gaussians.
            new, old = Normal(mean, log_std.exp()), Normal(old_mean, old_log_std.exp())
            divergences.append(kl_divergence(new, old).sum(dim=1))
            return actions

        def value(reached: th.Tensor) -> th.Tensor:
            actions, log_prob = self.actor.action_log_prob(reached)
            return th.cat(self.critic(reached, actions), dim=1).amin(dim=1) - ent_coef * log_prob

        rollout = imagine(world, observations, act, self.horizon, self.gamma, self._generator, value)
        surprise = sum(discount * each for discount, each in zip(rollout.discounts, log_probs, strict=False))
        return Performance(
            value=(rollout.returns - ent_coef * surprise).mean(),
            divergence=th.stack(divergences).sum(dim=0).mean(),
            first_log_prob=log_probs[0],
        )

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "_last_actor", "_last_world"]
