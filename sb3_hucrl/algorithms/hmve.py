"""Hallucinated model-based value expansion."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import torch as th
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecNormalize
from stable_baselines3.sac.policies import SACPolicy

from sb3_hucrl.algorithms.arguments import Environment
from sb3_hucrl.algorithms.imagined_rollouts import imagine, imagined_world
from sb3_hucrl.algorithms.imagining_sac import ImaginingSAC
from sb3_hucrl.checks import Count, validated

#: added to the variance of a horizon's target, so that one that is certain by chance does not get all the weight
SMALLEST_VARIANCE = 1e-8


class ExpandedReplayBuffer(ReplayBuffer):
    """
    The batches of one call of ``train``, expanded beforehand. Its own storage is one empty row.

    :param like: the algorithm's own buffer, which gives spaces and device
    :param expanded: transitions of all batches
    :param num_batches: number of batches
    """

    def __init__(self, like: ReplayBuffer, expanded: ReplayBufferSamples, num_batches: int) -> None:
        super().__init__(1, like.observation_space, like.action_space, like.device)
        self._expanded, self._num_batches, self._dealt = expanded, num_batches, 0

    def sample(self, batch_size: int, env: VecNormalize | None = None) -> ReplayBufferSamples:
        # Every n-th row, so that each batch gets its part of the real transitions, which come first.
        rows = slice(self._dealt, None, self._num_batches)
        self._dealt += 1
        return ReplayBufferSamples(*(each[rows] for each in self._expanded if each is not None))


@validated
class HMVE(ImaginingSAC):
    """
    H-MVE (Algorithm 5): SAC whose critics learn from N imagined steps plus the target critics' value after them. These
    steps begin in states of SAC's replay buffer: imagined ones, or with ``real_data_fraction: 1`` only real ones.

    As in SB3's n-step replay, the entropy of the steps in between is left out. All gradient steps of one call of
    ``train`` imagine in one batched call, with the policy at its beginning.

    :param policy: ``"MlpPolicy"``
    :param env: wrapped in an ImaginationVecEnv
    :param horizon: N
    :param weighting: ``"none"`` expands by N steps; ``"steve"`` by 1 to N, each with a probability proportional to the
        inverse variance of its target over critics and rollouts (Buckman et al. 2018)
    :param num_rollouts: rollouts from each state that estimate this variance
    :param kwargs: of SAC
    :raises ValueError: if a number is below 1 or the weighting unknown
    """

    unused: ClassVar[tuple[str, ...]] = ("n_steps",)

    def __init__(
        self,
        policy: str | type[SACPolicy],
        env: Environment,
        horizon: Count = 4,
        weighting: Literal["none", "steve"] = "none",
        num_rollouts: Count = 4,
        **kwargs: Any,
    ) -> None:
        self.horizon, self.weighting, self.num_rollouts = horizon, weighting, num_rollouts
        super().__init__(policy, env, **kwargs)

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        original = self.replay_buffer
        assert original is not None  # set up
        expanded = self.expand(original.sample(gradient_steps * batch_size))
        self.replay_buffer = ExpandedReplayBuffer(original, expanded, gradient_steps)
        try:
            super().train(gradient_steps, batch_size)
        finally:
            self.replay_buffer = original

    @th.no_grad()
    def expand(self, data: ReplayBufferSamples) -> ReplayBufferSamples:
        """
        Lines 7 to 11 of Algorithm 5, as a transition of several steps.

        :param data: B transitions, of which states and actions count
        :return: the same states and actions, with the discounted reward of the imagined steps, the observation after
            them, and the discount of what follows
        """
        steve = self.weighting == "steve"
        count = self.num_rollouts if steve else 1
        observations, actions = (each.repeat_interleave(count, dim=0) for each in (data.observations, data.actions))
        world = imagined_world(self)
        rollout = imagine(
            world, observations, self._sample, self.horizon, self.gamma, self._generator, first_actions=actions
        )
        observed = th.stack([world.task.observe(state) for state in rollout.states[1:]])
        discounts, rewards = th.stack(rollout.discounts[1:]), th.stack(rollout.rewards).cumsum(dim=0)
        lengths = th.full((len(data.actions),), self.horizon - 1, device=self.device)
        if steve:
            lengths = self._certain_lengths(observed, discounts, rewards, count)
        rows = th.arange(len(lengths), device=self.device)
        return data._replace(
            next_observations=observed[lengths, rows * count],
            dones=th.zeros_like(data.dones),
            rewards=rewards[lengths, rows * count].unsqueeze(1),
            discounts=discounts[lengths, rows * count].unsqueeze(1),
        )

    def _sample(self, observations: th.Tensor) -> th.Tensor:
        actions: th.Tensor = self.actor(observations)
        return actions

    def _certain_lengths(self, observed: th.Tensor, discounts: th.Tensor, rewards: th.Tensor, count: int) -> th.Tensor:
        """
        Draw the number of steps to expand each of B states by. The mean over the draws is STEVE's weighted target.

        :param observed: after 1 to N steps, shape (N, B · count, observation dimension)
        :param discounts: of what follows them, shape (N, B · count)
        :param rewards: until then, shape (N, B · count)
        :param count: rollouts per state
        :return: numbers of steps, less 1, shape (B,)
        """
        flat = observed.flatten(0, 1)
        values = th.stack(self.critic_target(flat, self._sample(flat)), dim=0).view(-1, *rewards.shape)
        targets = (rewards + discounts * values).unflatten(2, (-1, count))
        variance = targets.permute(1, 2, 0, 3).flatten(2).var(dim=2) + SMALLEST_VARIANCE
        return th.multinomial((1 / variance).T, 1, generator=self._generator).squeeze(1)
