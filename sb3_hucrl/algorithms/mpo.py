"""Maximum a-posteriori policy optimisation."""

from __future__ import annotations

from collections import defaultdict
from typing import Annotated, Any, ClassVar, TypeAlias

import numpy as np
import torch as th
from gymnasium import spaces
from pydantic import Field
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import MaybeCallback, ReplayBufferSamples, Schedule
from stable_baselines3.common.utils import polyak_update
from torch.distributions import Normal
from torch.nn.functional import mse_loss
from torch.nn.utils import clip_grad_norm_
from typing_extensions import Self

from sb3_hucrl.algorithms.arguments import Environment, GradientSteps, TrainFrequency
from sb3_hucrl.algorithms.gaussian_policy import GaussianPolicy
from sb3_hucrl.algorithms.mpo_loss import MPOLoss
from sb3_hucrl.checks import Count, Fraction, Natural, NotNegative, Positive, Seed, validated

Samples: TypeAlias = Annotated[int, Field(ge=2, description="an integer of at least 2")]


@validated
class MPO(OffPolicyAlgorithm):
    """
    MPO (Abdolmaleki et al. 2018): actions of the old policy are weighted by their values (E-step), and the new policy
    is fitted to them within a trust region (M-step). Works on any environment with continuous actions.

    :param policy: ``"MlpPolicy"``
    :param env: with continuous actions
    :param learning_rate: of actor and critics, or a schedule
    :param buffer_size: of the replay buffer
    :param learning_starts: steps before the first gradient step
    :param batch_size: transitions per gradient step
    :param tau: soft update coefficient of the target critics
    :param gamma: discount
    :param train_freq: steps between trainings
    :param gradient_steps: per training
    :param replay_buffer_class: by default SB3's own
    :param replay_buffer_kwargs: its arguments
    :param n_steps: of n-step returns in the replay buffer
    :param num_samples: K, actions per state in the E-step and in the critics' targets
    :param epsilon: bound on the KL divergence of the E-step, in nats
    :param epsilon_mean: bound of the M-step on the KL divergence through the mean, in nats
    :param epsilon_std: the same through the standard deviation
    :param dual_learning_rate: of temperature and multipliers
    :param policy_interval: gradient steps after which the new policy replaces the old one
    :param max_grad_norm: bound on the norm of the policy's gradient
    :param stats_window_size: as in all of SB3's algorithms
    :param tensorboard_log: folder for TensorBoard
    :param policy_kwargs: arguments of the policy, such as ``net_arch``
    :param verbose: 1 prints what is logged
    :param seed: of all randomness
    :param device: of the networks
    :param _init_setup_model: whether to set up now, or with ``load``
    :raises ValueError: if a bound is not positive or a number below 1
    """

    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {"MlpPolicy": GaussianPolicy}
    policy: GaussianPolicy

    def __init__(
        self,
        policy: str | type[GaussianPolicy],
        env: Environment,
        learning_rate: NotNegative | Schedule = 1e-3,
        buffer_size: Count = 1_000_000,
        learning_starts: Natural = 100,
        batch_size: Count = 256,
        tau: Fraction = 0.005,
        gamma: Fraction = 0.99,
        train_freq: TrainFrequency = 1,
        gradient_steps: GradientSteps = 1,
        replay_buffer_class: type[ReplayBuffer] | None = None,
        replay_buffer_kwargs: dict[str, Any] | None = None,
        n_steps: Count = 1,
        num_samples: Samples = 20,
        epsilon: Positive = 0.1,
        epsilon_mean: Positive = 0.01,
        epsilon_std: Positive = 1e-4,
        dual_learning_rate: Positive = 1e-2,
        policy_interval: Count = 100,
        max_grad_norm: Positive = 40.0,
        stats_window_size: Count = 100,
        tensorboard_log: str | None = None,
        policy_kwargs: dict[str, Any] | None = None,
        verbose: Natural = 0,
        seed: Seed | None = None,
        device: th.device | str = "auto",
        _init_setup_model: bool = True,
    ) -> None:
        super().__init__(
            policy,
            env,  # type: ignore[arg-type]  # None where load() calls it
            learning_rate,
            buffer_size,
            learning_starts,
            batch_size,
            tau,
            gamma,
            train_freq,
            gradient_steps,
            replay_buffer_class=replay_buffer_class,
            replay_buffer_kwargs=replay_buffer_kwargs,
            n_steps=n_steps,
            policy_kwargs=policy_kwargs,
            stats_window_size=stats_window_size,
            tensorboard_log=tensorboard_log,
            verbose=verbose,
            device=device,
            seed=seed,
            sde_support=False,
            supported_action_spaces=(spaces.Box,),
            support_multi_env=True,
        )
        self.num_samples = num_samples
        self.epsilon, self.epsilon_mean, self.epsilon_std = epsilon, epsilon_mean, epsilon_std
        self.dual_learning_rate = dual_learning_rate
        self.policy_interval = policy_interval
        self.max_grad_norm = max_grad_norm
        if _init_setup_model:
            self._setup_model()

    def _setup_model(self) -> None:
        super()._setup_model()
        self.loss = MPOLoss(self.epsilon, self.epsilon_mean, self.epsilon_std).to(self.device)
        self.dual_optimizer = th.optim.Adam(self.loss.parameters(), lr=self.dual_learning_rate)

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        policy = self.policy
        policy.set_training_mode(True)
        self._update_learning_rate([policy.actor.optimizer, policy.critic.optimizer])
        noted: dict[str, list[float]] = defaultdict(list)
        assert self.replay_buffer is not None  # set up
        for _ in range(gradient_steps):
            data = self.replay_buffer.sample(batch_size, env=self._vec_normalize_env)
            noted["critic_loss"].append(self._train_critic(data))
            self._train_actor(data, noted)
            polyak_update(policy.critic.parameters(), policy.critic_target.parameters(), self.tau)
            self._n_updates += 1
            if self._n_updates % self.policy_interval == 0:
                polyak_update(policy.actor.parameters(), policy.actor_target.parameters(), 1.0)
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        for name, values in noted.items():
            self.logger.record(f"train/{name}", float(np.mean(values)))

    def _train_critic(self, data: ReplayBufferSamples) -> float:
        critic, targets = self.policy.critic, self._targets(data)
        loss = th.stack([mse_loss(values, targets) for values in critic(data.observations, data.actions)]).sum()
        critic.optimizer.zero_grad()
        loss.backward()
        critic.optimizer.step()
        return loss.item()

    @th.no_grad()
    def _targets(self, data: ReplayBufferSamples) -> th.Tensor:
        """Target values of the critics for B transitions, shape (B, 1)."""
        discounts = self.gamma if data.discounts is None else data.discounts
        next_values = self._sample_values(data.next_observations)[2].mean(dim=0).unsqueeze(1)
        return data.rewards + (1 - data.dones) * discounts * next_values

    @th.no_grad()
    def _sample_values(self, observations: th.Tensor) -> tuple[Normal, th.Tensor, th.Tensor]:
        """The old policy in each of B states, K actions drawn from it, shape (K, B, d), and their Q, shape (K, B)."""
        old = self.policy.actor_target.distribution(observations)
        actions = old.sample(th.Size([self.num_samples]))
        repeated = observations.expand(self.num_samples, *observations.shape).flatten(0, 1)
        values = th.cat(self.policy.critic_target(repeated, actions.flatten(0, 1).clamp(-1, 1)), dim=1)
        return old, actions, values.amin(dim=1).view(actions.shape[:2])

    def _train_actor(self, data: ReplayBufferSamples, noted: dict[str, list[float]]) -> None:
        actor = self.policy.actor
        old, actions, values = self._sample_values(data.observations)
        terms = self.loss(old, actor.distribution(data.observations), actions, values)
        actor.optimizer.zero_grad()
        self.dual_optimizer.zero_grad()
        (terms.policy_loss + terms.dual_loss).backward()
        clip_grad_norm_(actor.parameters(), self.max_grad_norm)
        actor.optimizer.step()
        self.dual_optimizer.step()
        noted["actor_loss"].append(terms.policy_loss.item())
        noted["temperature"].append(self.loss.temperature.item())
        noted["kl_mean"].append(terms.kl_mean.item())
        noted["kl_std"].append(terms.kl_std.item())

    def learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int = 4,
        tb_log_name: str | None = None,
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> Self:
        name = tb_log_name or type(self).__name__
        return super().learn(total_timesteps, callback, log_interval, name, reset_num_timesteps, progress_bar)

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "loss", "dual_optimizer"]

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        optimizers = ["policy.actor.optimizer", "policy.critic.optimizer", "dual_optimizer"]
        return ["policy", "loss", *optimizers], []
