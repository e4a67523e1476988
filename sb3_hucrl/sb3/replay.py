"""Replay buffers with real transitions, and with what is kept of older imagination."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import torch as th
from gymnasium import spaces
from stable_baselines3.common.buffers import NStepReplayBuffer, ReplayBuffer
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecNormalize

from sb3_hucrl.data import TransitionDataset
from sb3_hucrl.tasks.base import Task

COLUMNS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def keep_latest(buffer: ReplayBuffer, fraction: float) -> None:
    """
    Keep a fraction of a replay buffer, newest first.

    :param buffer: of the algorithm, between two of its rollouts
    :param fraction: of its steps that is kept, in [0, 1]
    """
    kept = int(fraction * buffer.size())
    rows = (buffer.pos - kept + np.arange(kept)) % buffer.buffer_size
    for name in COLUMNS if kept else ():
        column = getattr(buffer, name)
        column[:kept] = column[rows]
    buffer.pos, buffer.full = kept % buffer.buffer_size, kept == buffer.buffer_size
    if kept:
        # The trajectories go on elsewhere: no n-step return may look beyond this row.
        buffer.timeouts[kept - 1] = np.maximum(buffer.timeouts[kept - 1], 1 - buffer.dones[kept - 1])


def real_buffer(
    like: ReplayBuffer, dataset: TransitionDataset, task: Task, action_space: spaces.Box, rng: np.random.Generator
) -> ReplayBuffer:
    """
    Real transitions as a replay buffer. Their hallucinated actions are drawn from a standard normal distribution and
    clipped to [-1, 1] (appendix C.1).

    :param like: the algorithm's own, which gives class and number of steps
    :param dataset: the real transitions
    :param task: maps states to observations
    :param action_space: of (a, a′)
    :param rng: draws a′
    :return: a buffer of all of them, filled
    """
    real = dataset.transitions
    n, widened = len(real), len(action_space.low)
    kwargs: dict[str, Any] = {}
    if isinstance(like, NStepReplayBuffer):
        kwargs = {"n_steps": like.n_steps, "gamma": like.gamma}
    # One row more than is filled: a full buffer's last step would be followed by its first.
    buffer = type(like)(n + 1, like.observation_space, like.action_space, like.device, n_envs=1, **kwargs)
    buffer.observations[:n, 0] = task.observe(real.states).numpy()
    buffer.next_observations[:n, 0] = task.observe(real.next_states).numpy()
    hallucinated = np.clip(rng.standard_normal((n, widened - dataset.action_dim)), -1.0, 1.0)
    actions = np.concatenate([real.actions.numpy(), hallucinated], axis=1)
    # As SB3's own rollouts store them.
    buffer.actions[:n, 0] = 2 * (actions - action_space.low) / (action_space.high - action_space.low) - 1
    buffer.rewards[:n, 0] = real.rewards.numpy()
    last = np.zeros(n, dtype=bool)
    last[np.array(dataset.ends) - 1] = True
    terminated = real.terminated.numpy()
    buffer.dones[:n, 0] = last
    buffer.timeouts[:n, 0] = last & ~terminated
    buffer.pos = n
    return buffer


class MixedReplayBuffer(ReplayBuffer):
    """
    The algorithm's replay buffer, with a fraction of real transitions in every batch. Its own storage is one empty row:
    everything is kept in the two buffers that it is made of.

    :param imagined: the algorithm's own; new transitions go there
    :param real: real transitions
    :param fraction: fraction of real transitions in a batch, in [0, 1]
    """

    def __init__(self, imagined: ReplayBuffer, real: ReplayBuffer, fraction: float) -> None:
        super().__init__(1, imagined.observation_space, imagined.action_space, imagined.device, n_envs=imagined.n_envs)
        self.imagined, self.real, self.fraction = imagined, real, fraction

    def add(
        self,
        obs: npt.NDArray[Any],
        next_obs: npt.NDArray[Any],
        action: npt.NDArray[Any],
        reward: npt.NDArray[Any],
        done: npt.NDArray[Any],
        infos: list[dict[str, Any]],
    ) -> None:
        self.imagined.add(obs, next_obs, action, reward, done, infos)

    def reset(self) -> None:
        self.imagined.reset()

    def size(self) -> int:
        return self.imagined.size()

    def sample(self, batch_size: int, env: VecNormalize | None = None) -> ReplayBufferSamples:
        num_real = round(self.fraction * batch_size)
        if num_real == 0:
            return self.imagined.sample(batch_size, env)
        real = self.real.sample(num_real, env)
        if num_real == batch_size:
            return real
        imagined = self.imagined.sample(batch_size - num_real, env)
        discounts = None
        if real.discounts is not None and imagined.discounts is not None:
            discounts = th.cat([real.discounts, imagined.discounts])
        return ReplayBufferSamples(
            observations=th.cat([real.observations, imagined.observations]),
            actions=th.cat([real.actions, imagined.actions]),
            next_observations=th.cat([real.next_observations, imagined.next_observations]),
            dones=th.cat([real.dones, imagined.dones]),
            rewards=th.cat([real.rewards, imagined.rewards]),
            discounts=discounts,
        )
