"""Hallucinated stochastic value gradients: Algorithms 4 and 5 in one."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
import torch as th
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import Schedule
from stable_baselines3.common.utils import polyak_update
from torch.nn.functional import softplus
from torch.nn.utils import clip_grad_norm_

from sb3_hucrl.algorithms.arguments import Environment, GradientSteps, TrainFrequency
from sb3_hucrl.algorithms.critic_ensemble import CriticEnsemble, EnsemblePolicy
from sb3_hucrl.algorithms.imagined_rollouts import imagine, imagined_world
from sb3_hucrl.algorithms.imagining_sac import ImaginingSAC
from sb3_hucrl.checks import ArgumentError, Count, Natural, NotNegative, Positive, Real, validated
from sb3_hucrl.data import reward_std
from sb3_hucrl.imagination import World


@dataclass(frozen=True)
class Expansion:
    """
    N imagined steps from B states, prolonged by the critics.

    :param performance: discounted rewards and entropies plus the mean of the critics, shape (B,), differentiable
    :param target: of Q(s_0, a_0): the same with the least of the target critics, without the first entropy, shape (B,)
    :param first_action: a_0 and a′_0, scaled, shape (B, q + h)
    :param first_log_prob: of a_0, shape (B,)
    """

    performance: th.Tensor
    target: th.Tensor
    first_action: th.Tensor
    first_log_prob: th.Tensor


@validated
class HSVG(ImaginingSAC):
    """
    H-SVG: the critics learn from N imagined steps plus the target critics' value after them (Algorithm 5), and the
    actor follows the gradient of the same steps through model, reward and critics (Algorithm 4), as in DHMBPO (Kubo
    et al. 2025). Both begin in states of SAC's replay buffer, which longer imagined trajectories fill.

    The policy (π, η) is random in the real action a, with an entropy bonus, and a function of the state in a′, to which
    SB3 adds noise where trajectories fill the replay buffer. Its objective is in standard deviations of the real
    rewards so far, or of the imagined ones where those are larger, and so is the entropy coefficient. Targets stay
    within what rewards as large as those imagined so far could amount to.

    :param policy: ``"MlpPolicy"``
    :param env: wrapped in an ImaginationVecEnv
    :param learning_rate: of actor, critics and entropy coefficient
    :param horizon: N
    :param critic_updates: updates of the critics alone after each refit: the new model's values before its gradients
    :param policy_delay: updates of the critics for each one of the policy; values travel N steps with each update of
        the target critics, so that a reward that is far away needs many
    :param target_entropy: of the real action; ``"auto"`` is minus half the number of its dimensions
    :param critic_scale: one unit of the critics' outputs, in units of the objective. An update moves them by a few
        hundredths of it, so large values, such as 100 for a reward of 1 in every step, are learned sooner with a larger
        one. Where small differences decide, such as the cost of a swing-up, 1 was better
    :param max_grad_norm: bound on the norm of the policy's gradient
    :param kwargs: further arguments of SAC
    :raises ValueError: if a number is out of its range, or with gSDE
    """

    critic: CriticEnsemble  # type: ignore[assignment]  # SAC's is another
    critic_target: CriticEnsemble  # type: ignore[assignment]  # as above
    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {"MlpPolicy": EnsemblePolicy}
    policy: EnsemblePolicy
    unused: ClassVar[tuple[str, ...]] = ("n_steps", "target_update_interval")

    def __init__(
        self,
        policy: str | type[EnsemblePolicy],
        env: Environment,
        learning_rate: Positive | Schedule = 1e-3,
        horizon: Count = 5,
        critic_updates: Natural = 250,
        policy_delay: Count = 1,
        critic_scale: Positive = 10.0,
        max_grad_norm: Positive = 40.0,
        ent_coef: str | NotNegative = "auto_0.1",
        target_entropy: Real | Literal["auto"] = "auto",
        train_freq: TrainFrequency = 20,
        gradient_steps: GradientSteps = 20,
        **kwargs: Any,
    ) -> None:
        if kwargs.get("gamma") == 1:
            raise ArgumentError.of_value("gamma", 1, "less than 1: H-SVG bounds values by rewards / (1 - gamma)")
        self.horizon, self.critic_updates, self.policy_delay = horizon, critic_updates, policy_delay
        self.critic_scale, self.max_grad_norm = critic_scale, max_grad_norm
        self.chooses_target_entropy = target_entropy == "auto"
        super().__init__(
            policy,
            env,
            learning_rate,
            ent_coef=ent_coef,
            target_entropy=target_entropy,
            train_freq=train_freq,
            gradient_steps=gradient_steps,
            **kwargs,
        )

    def _setup_model(self) -> None:
        super()._setup_model()
        self._last_world: World | None = None
        self._reward_range = (np.inf, -np.inf)
        #: one unit of the objective, in units of the reward
        self.reward_unit = 1.0

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        world = imagined_world(self)
        self._begin_training()
        noted: dict[str, list[float]] = defaultdict(list)
        if world is not self._last_world:
            self._last_world = world
            if self.chooses_target_entropy:
                self.target_entropy = -0.5 * world.predictor.action_dim
            self.reward_unit = max(world.reward_std, self._imagined_reward_std(world, batch_size))
            for critic in (self.critic, self.critic_target):
                critic.adopt(self.reward_unit * self.critic_scale)
            for _ in range(self.critic_updates):
                self._update(world, batch_size, noted, with_actor=False)
        for _ in range(gradient_steps):
            self._update(world, batch_size, noted, with_actor=self._n_updates % self.policy_delay == 0)
        self._record_means(noted)

    @th.no_grad()
    def _imagined_reward_std(self, world: World, batch_size: int) -> float:
        """What pays has not been met in reality yet where real rewards are next to nothing."""
        assert self.replay_buffer is not None  # set up
        dim, observations = world.predictor.action_dim, self.replay_buffer.sample(batch_size).observations
        rollout = imagine(world, observations, lambda seen: self.act(seen, dim)[0], self.horizon, 1.0, self._generator)
        return reward_std(th.cat(rollout.rewards))

    def _update(self, world: World, batch_size: int, noted: dict[str, list[float]], with_actor: bool) -> None:
        assert self.replay_buffer is not None  # set up
        observations = self.replay_buffer.sample(batch_size).observations
        # Frozen: gradients flow through the critics to the actor, and not into them.
        self.critic.requires_grad_(False)
        with th.set_grad_enabled(with_actor):
            expansion = self.expand(world, observations)
        if with_actor:
            self.actor.optimizer.zero_grad()
            (-expansion.performance.mean() / self.reward_unit).backward()
            noted["actor_grad"].append(float(clip_grad_norm_(self.actor.parameters(), self.max_grad_norm)))
            self.actor.optimizer.step()
            noted["performance"].append(expansion.performance.mean().item())
            self._train_ent_coef(expansion.first_log_prob)
        self.critic.requires_grad_(True)
        values = self.critic.values(observations, expansion.first_action.detach())
        loss = ((values - expansion.target) / self.reward_unit).square().mean(dim=1).sum()
        self.critic.optimizer.zero_grad()
        loss.backward()
        self.critic.optimizer.step()
        polyak_update(self.critic.parameters(), self.critic_target.parameters(), self.tau)
        self._n_updates += 1
        noted["critic_loss"].append(loss.item())
        noted["critic_value"].append(values.mean().item())
        noted["ent_coef"].append(self._ent_coef().item())

    def act(self, observations: th.Tensor, action_dim: int) -> tuple[th.Tensor, th.Tensor]:
        """
        :param observations: shape (B, observation dimension)
        :param action_dim: q
        :return: (a, a′), scaled, shape (B, q + h), and the log-probability of a, shape (B,)
        """
        mean, log_std, _ = self.actor.get_action_dist_params(observations)
        noise = th.randn(len(mean), action_dim, device=mean.device, generator=self._generator)
        raw = th.cat([mean[:, :action_dim] + log_std[:, :action_dim].exp() * noise, mean[:, action_dim:]], dim=1)
        real = raw[:, :action_dim]
        # log N(real) - log(1 - tanh²), as in SAC (Haarnoja et al. 2018, appendix C).
        squash = 2 * (np.log(2) - real - softplus(-2 * real))
        log_prob = -0.5 * noise.square() - log_std[:, :action_dim] - 0.5 * np.log(2 * np.pi) - squash
        return raw.tanh(), log_prob.sum(dim=1)

    def expand(self, world: World, observations: th.Tensor) -> Expansion:
        """
        Lines 4 to 10 of Algorithm 4 and 7 to 11 of Algorithm 5, on the same trajectories.

        :param world: to act in
        :param observations: of B states, shape (B, observation dimension)
        """
        ent_coef, dim = self._ent_coef() * self.reward_unit, world.predictor.action_dim
        actions: list[th.Tensor] = []
        log_probs: list[th.Tensor] = []

        def act(visited: th.Tensor) -> th.Tensor:
            action, log_prob = self.act(visited, dim)
            actions.append(action)
            log_probs.append(log_prob)
            return action

        rollout = imagine(world, observations, act, self.horizon, self.gamma, self._generator)
        reached = world.task.observe(rollout.states[-1])
        last = act(reached)
        entropies = -ent_coef * th.stack([d * each for d, each in zip(rollout.discounts, log_probs, strict=True)])
        earned = rollout.returns + entropies.sum(dim=0)
        following = rollout.discounts[-1]
        performance = earned + following * self.critic.values(reached, last).mean(dim=0)
        with th.no_grad():
            pessimistic = self.critic_target.values(reached, last).amin(dim=0)
            target = earned - entropies[0] + following * pessimistic
            self._see_rewards(rollout.rewards)
            least, most = (each / (1 - self.gamma) for each in self._reward_range)
            target = target.clamp(min(least, 0.0), max(most, 0.0))
        return Expansion(performance, target, actions[0], log_probs[0])

    def _see_rewards(self, discounted: list[th.Tensor]) -> None:
        """Of all steps, and for good: a value is not forgotten where no state of a batch pays at once."""
        powers = [self.gamma**n for n in range(len(discounted))]
        rewards = [each / power for each, power in zip(discounted, powers, strict=True) if power > 0]
        least, most = th.stack(rewards).aminmax()
        self._reward_range = min(self._reward_range[0], float(least)), max(self._reward_range[1], float(most))

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "_last_world"]
