"""Real transitions and stale imagination in an off-policy algorithm's replay buffer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from stable_baselines3.common.buffers import DictReplayBuffer, NStepReplayBuffer, ReplayBuffer

from helpers import EPISODE_STEPS, imagination_env, small_callback, small_sac
from sb3_hucrl import TransitionDataset, Transitions
from sb3_hucrl.sb3.replay import MixedReplayBuffer, keep_latest, real_buffer
from sb3_hucrl.tasks import PendulumTask

OBSERVATION = spaces.Box(-np.inf, np.inf, (1,))
ACTION = spaces.Box(-1.0, 1.0, (1,))


def counting_buffer(steps: int, size: int = 10, n_envs: int = 2, **kwargs: Any) -> ReplayBuffer:
    """Step t has observation t, reward t, and never ends."""
    kind = NStepReplayBuffer if kwargs else ReplayBuffer
    buffer = kind(size * n_envs, OBSERVATION, ACTION, n_envs=n_envs, device="cpu", **kwargs)
    for step in range(steps):
        column = np.full((n_envs, 1), step, dtype=np.float32)
        zeros = np.zeros(n_envs)
        buffer.add(column, column + 1, np.zeros((n_envs, 1)), zeros + step, zeros, [{}] * n_envs)
    return buffer


@pytest.mark.parametrize(
    ("steps", "share", "expected"),
    [(6, 0.5, [3, 4, 5]), (14, 0.5, [9, 10, 11, 12, 13]), (14, 1.0, [*range(4, 14)]), (6, 0.0, [])],
)
def test_the_latest_steps_stay_in_order(steps: int, share: float, expected: list[int]) -> None:
    buffer = counting_buffer(steps)
    keep_latest(buffer, share)
    assert buffer.size() == len(expected)
    for env in range(2):
        assert buffer.observations[: len(expected), env, 0].tolist() == expected
        assert buffer.next_observations[: len(expected), env, 0].tolist() == [step + 1 for step in expected]
        assert buffer.rewards[: len(expected), env].tolist() == expected


def test_no_return_reaches_from_kept_imagination_into_new() -> None:
    buffer = counting_buffer(8, n_steps=3, gamma=1.0)
    keep_latest(buffer, 0.5)
    zeros = np.zeros(2)
    for _ in range(3):
        buffer.add(zeros[:, None], zeros[:, None], zeros[:, None], zeros + 1_000, zeros, [{}] * 2)
    sample = buffer._get_samples(np.arange(4))
    # Rewards 4 to 7 are kept: 4+5+6, 5+6+7, 6+7, 7; the next state is where the sum ends, and is bootstrapped from.
    assert sample.rewards[:, 0].tolist() == [15.0, 18.0, 13.0, 7.0]
    assert sample.next_observations[:, 0].tolist() == [7.0, 8.0, 8.0, 8.0]
    assert sample.dones[:, 0].tolist() == [0.0] * 4


def dataset_of(lengths: list[int], terminated: list[bool]) -> TransitionDataset:
    """Episodes of the pendulum whose reward in step t of all is t."""
    dataset = TransitionDataset(2, 1)
    step = 0
    for length, ends in zip(lengths, terminated, strict=True):
        states = th.stack([th.linspace(0, 1, length + 1) + step, th.ones(length + 1)], dim=1)
        rewards = th.arange(step, step + length, dtype=th.float32)
        over = th.zeros(length, dtype=th.bool)
        over[-1] = ends
        dataset.append_episode(Transitions(states[:-1], th.full((length, 1), 0.5), states[1:], rewards, over))
        step += length
    return dataset


def real(dataset: TransitionDataset, **kwargs: Any) -> ReplayBuffer:
    observation = spaces.Box(-np.inf, np.inf, (3,))
    action = spaces.Box(np.array([-2, -1, -1], dtype=np.float32), np.array([2, 1, 1], dtype=np.float32))
    kind = NStepReplayBuffer if kwargs else ReplayBuffer
    like = kind(100, observation, action, n_envs=4, device="cpu", **kwargs)
    return real_buffer(like, dataset, PendulumTask(), action, np.random.default_rng(0))


def test_real_transitions_are_what_the_environment_did() -> None:
    dataset = dataset_of([3, 4], [True, False])
    buffer = real(dataset)
    sample = buffer._get_samples(np.arange(7))
    task, transitions = PendulumTask(), dataset.transitions
    th.testing.assert_close(sample.observations, task.observe(transitions.states))
    th.testing.assert_close(sample.next_observations, task.observe(transitions.next_states))
    assert sample.rewards[:, 0].tolist() == [0, 1, 2, 3, 4, 5, 6]
    # The first episode terminated, the second ran out of time.
    assert sample.dones[:, 0].tolist() == [0, 0, 1, 0, 0, 0, 0]
    # 0.5 of at most 2, as SB3 scales it.
    assert sample.actions[:, 0].tolist() == [0.25] * 7


def test_real_n_step_returns_stay_within_their_episode() -> None:
    sample = real(dataset_of([3, 4], [True, False]), n_steps=2, gamma=0.5)._get_samples(np.arange(7))
    assert sample.rewards[:, 0].tolist() == [0.5, 2.0, 2.0, 5.0, 6.5, 8.0, 6.0]
    assert sample.dones[:, 0].tolist() == [0, 1, 1, 0, 0, 0, 0]
    assert sample.discounts is not None
    assert sample.discounts[:, 0].tolist() == [0.25, 0.25, 0.5, 0.25, 0.25, 0.25, 0.5]


def test_hallucinated_actions_of_real_transitions_are_clipped_normals() -> None:
    buffer = real(dataset_of([20_000], [False]))
    hallucinated = buffer.actions[:20_000, 0, 1:]
    assert hallucinated.min() == -1.0
    assert hallucinated.max() == 1.0
    # P(|z| >= 1) is 0.3173; 40,000 draws put its estimate within 5 standard errors, 0.0116.
    assert abs(float((np.abs(hallucinated) == 1.0).mean()) - 0.3173) < 0.0116
    assert abs(float(hallucinated.mean())) < 0.02


def test_a_batch_has_the_stated_share_of_real_transitions() -> None:
    mixed = MixedReplayBuffer(counting_buffer(10), counting_buffer(5), 0.25)
    mixed.real.rewards[:] = -1.0
    rewards = mixed.sample(200).rewards
    assert int((rewards == -1.0).sum()) == 50


def test_training_replays_real_transitions_and_keeps_stale_ones(tmp_path: Any) -> None:
    model = small_sac(imagination_env(), n_steps=3)
    model.learn(160, callback=small_callback(real_data_fraction=0.5, stale_fraction=0.5))
    buffer = model.replay_buffer
    assert isinstance(buffer, MixedReplayBuffer)
    assert buffer.real is not None
    # 80 steps of 4 environments make 20 rows a search: half of the first search's and all of the second's.
    assert buffer.size() == 30
    assert buffer.real.size() == 2 * EPISODE_STEPS
    model.save_replay_buffer(tmp_path / "buffer")
    model.load_replay_buffer(tmp_path / "buffer")
    model.learn(80, callback=small_callback(real_data_fraction=0.5))
    assert isinstance(model.replay_buffer, MixedReplayBuffer)
    assert not isinstance(model.replay_buffer.imagined, MixedReplayBuffer)


def test_a_buffer_with_real_transitions_stops_mixing_in_a_run_without(tmp_path: Path) -> None:
    model = small_sac(imagination_env(max_episode_steps=40))
    model.learn(160, callback=small_callback(real_data_fraction=0.5))
    model.save_replay_buffer(tmp_path / "buffer")
    other = small_sac(imagination_env(max_episode_steps=40))
    other.load_replay_buffer(tmp_path / "buffer")
    assert isinstance(other.replay_buffer, MixedReplayBuffer)
    other.learn(80, callback=small_callback())
    assert not isinstance(other.replay_buffer, MixedReplayBuffer)
    assert other.replay_buffer is not None
    # 20 rows of 4 environments, and nothing of before.
    assert other.replay_buffer.size() == 20


def test_a_mixed_buffer_is_a_buffer_of_its_own() -> None:
    mixed = MixedReplayBuffer(counting_buffer(4), counting_buffer(2), 0.5)
    # Whatever SB3 may ask any buffer, its own empty storage answers.
    assert (mixed.buffer_size, mixed.pos, mixed.full) == (1, 0, False)
    assert mixed.size() == 4
    row = np.zeros((2, 1), dtype=np.float32)
    mixed.add(row, row, row, np.zeros(2), np.zeros(2), [{}] * 2)
    assert (mixed.size(), mixed.imagined.size(), mixed.pos) == (5, 5, 0)
    mixed.reset()
    assert mixed.size() == 0


@pytest.mark.parametrize("fraction", ["real_data_fraction", "stale_fraction"])
def test_a_buffer_without_next_observations_is_refused_with_advice(fraction: str) -> None:
    env = imagination_env()
    model = small_sac(env, optimize_memory_usage=True, replay_buffer_kwargs={"handle_timeout_termination": False})
    with pytest.raises(ValueError, match="set optimize_memory_usage=False"):
        model.learn(80, callback=small_callback(**{fraction: 0.5}))
    assert env.get_attr("total_steps")[0] == 0


def test_a_buffer_of_dictionaries_is_refused_with_advice() -> None:
    model = small_sac()
    space = spaces.Dict({"observation": OBSERVATION})
    model.replay_buffer = DictReplayBuffer(10, space, ACTION)
    with pytest.raises(ValueError, match="DictReplayBuffer, for observations that are dictionaries"):
        model.learn(80, callback=small_callback())
