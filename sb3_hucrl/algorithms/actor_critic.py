"""What MPO and H-BPTT have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import defaultdict
from typing import Any, ClassVar

import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import GymEnv, MaybeCallback, ReplayBufferSamples, Schedule
from stable_baselines3.common.utils import polyak_update
from torch.nn.functional import mse_loss
from torch.nn.utils import clip_grad_norm_
from typing_extensions import Self

from sb3_hucrl.algorithms.gaussian_policy import GaussianPolicy


class GaussianActorCritic(OffPolicyAlgorithm, ABC):
    """
    An off-policy algorithm with a Gaussian policy, critics, and targets of both. Subclasses say what the critics shall
    predict and what the policy shall maximise.

    :param policy: ``"MlpPolicy"``
    :param env: with continuous actions
    :param learning_rate: of actor and critics, or a schedule
    :param buffer_size: of the replay buffer
    :param learning_starts: steps before the first gradient step
    :param batch_size: transitions per gradient step
    :param tau: share of the critics that their targets take over at each gradient step
    :param gamma: discount
    :param train_freq: steps between trainings
    :param gradient_steps: per training
    :param replay_buffer_class: by default SB3's own
    :param replay_buffer_kwargs: its arguments
    :param n_steps: of the transitions that are replayed
    :param max_grad_norm: bound on the norm of the policy's gradient
    :param stats_window_size: as in all of SB3's algorithms
    :param tensorboard_log: folder for TensorBoard
    :param policy_kwargs: arguments of the policy, such as ``net_arch``
    :param verbose: 1 prints what is logged
    :param seed: of all randomness
    :param device: of the networks
    :param _init_setup_model: whether to set up now, or with ``load``
    """

    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {"MlpPolicy": GaussianPolicy}
    policy: GaussianPolicy

    def __init__(
        self,
        policy: str | type[GaussianPolicy],
        env: GymEnv | str,
        learning_rate: float | Schedule = 1e-3,
        buffer_size: int = 1_000_000,
        learning_starts: int = 100,
        batch_size: int = 256,
        tau: float = 0.005,
        gamma: float = 0.99,
        train_freq: int | tuple[int, str] = 1,
        gradient_steps: int = 1,
        replay_buffer_class: type[ReplayBuffer] | None = None,
        replay_buffer_kwargs: dict[str, Any] | None = None,
        n_steps: int = 1,
        max_grad_norm: float = 40.0,
        stats_window_size: int = 100,
        tensorboard_log: str | None = None,
        policy_kwargs: dict[str, Any] | None = None,
        verbose: int = 0,
        seed: int | None = None,
        device: th.device | str = "auto",
        _init_setup_model: bool = True,
    ) -> None:
        super().__init__(
            policy,
            env,
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
        self.max_grad_norm = max_grad_norm
        if _init_setup_model:
            self._setup_model()

    @abstractmethod
    def _targets(self, data: ReplayBufferSamples) -> th.Tensor:
        """
        :param data: B transitions
        :return: what the critics shall predict, shape (B, 1)
        """

    @abstractmethod
    def _actor_loss(self, data: ReplayBufferSamples, noted: dict[str, list[float]]) -> th.Tensor:
        """
        :param data: B transitions
        :param noted: takes what shall be logged, its mean over a training, by name
        :return: to be minimised
        """

    def _actor_optimizers(self) -> list[th.optim.Optimizer]:
        """Of all that the actor's loss depends on."""
        return [self.policy.actor.optimizer]

    def _after_gradient_step(self) -> None:
        """Called when both losses have made their step."""

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        policy = self.policy
        policy.set_training_mode(True)
        self._update_learning_rate([policy.actor.optimizer, policy.critic.optimizer])
        noted: dict[str, list[float]] = defaultdict(list)
        assert self.replay_buffer is not None  # set up
        for _ in range(gradient_steps):
            data = self.replay_buffer.sample(batch_size, env=self._vec_normalize_env)
            noted["critic_loss"].append(self._train_critic(data))
            noted["actor_loss"].append(self._train_actor(data, noted))
            polyak_update(policy.critic.parameters(), policy.critic_target.parameters(), self.tau)
            self._n_updates += 1
            self._after_gradient_step()
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        for name, values in noted.items():
            self.logger.record(f"train/{name}", float(np.mean(values)))

    def _train_critic(self, data: ReplayBufferSamples) -> float:
        critic = self.policy.critic
        with th.no_grad():
            targets = self._targets(data)
        loss = sum(mse_loss(values, targets) for values in critic(data.observations, data.actions))
        assert isinstance(loss, th.Tensor)  # there is a critic
        critic.optimizer.zero_grad()
        loss.backward()
        critic.optimizer.step()
        return loss.item()

    def _train_actor(self, data: ReplayBufferSamples, noted: dict[str, list[float]]) -> float:
        loss = self._actor_loss(data, noted)
        optimizers = self._actor_optimizers()
        for optimizer in optimizers:
            optimizer.zero_grad()
        loss.backward()
        clip_grad_norm_(self.policy.actor.parameters(), self.max_grad_norm)
        for optimizer in optimizers:
            optimizer.step()
        return loss.item()

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

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        return ["policy", "policy.actor.optimizer", "policy.critic.optimizer"], []
