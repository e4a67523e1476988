"""Replay buffers as logged data, against what the environments really gave and took."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import TimeLimit
from stable_baselines3 import SAC
from stable_baselines3.common.buffers import DictReplayBuffer, ReplayBuffer
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.envs import BitFlippingEnv
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from helpers import small_callback, small_sac
from recording import Drift, Recorded, Recorder, assert_same
from sb3_hucrl.logged import LoggedEpisode
from sb3_hucrl.sb3 import MixedReplayBuffer, read_logged
from sb3_hucrl.sb3.logged_replay import replay_episodes
from sb3_hucrl.tasks import LearnedTask


def pendulum() -> gym.Env[Any, Any]:
    return Recorder(gym.make("Pendulum-v1", max_episode_steps=30))


def drift() -> gym.Env[Any, Any]:
    return Recorder(TimeLimit(Drift(), 12))


def filled(make: Callable[[], gym.Env[Any, Any]], steps: int, wrap: Any = None, **kwargs: Any) -> tuple[SAC, VecEnv]:
    """A SAC that has learned a little in two environments, and these."""
    venv = make_vec_env(make, n_envs=2, seed=0)
    model = small_sac(wrap(venv) if wrap else venv, learning_starts=20, **kwargs)
    return model.learn(steps), venv


def truth_of(venv: VecEnv) -> list[Recorded]:
    """Environment by environment."""
    return [episode for played in venv.env_method("get_wrapper_attr", "played") for episode in played]


def replay_of(model: SAC) -> ReplayBuffer:
    assert isinstance(model.replay_buffer, ReplayBuffer)
    return model.replay_buffer


@pytest.mark.parametrize("make", [pendulum, drift], ids=["pendulum", "drift"])
def test_it_holds_what_two_environments_gave_and_took(make: Callable[[], gym.Env[Any, Any]], tmp_path: Path) -> None:
    model, venv = filled(make, 150)
    model.save_replay_buffer(tmp_path / "replay.pkl")
    truth = truth_of(venv)
    observation_dim = gym.spaces.flatdim(venv.observation_space)
    for source in (replay_of(model), tmp_path / "replay.pkl", str(tmp_path / "replay.pkl")):
        read = read_logged(source, LearnedTask(observation_dim))
        assert_same(read, truth)
        assert all(each.from_reset for each in read)
    # The first environment's, then the second's; time limits and cut-off episodes are no terminations.
    assert sum(len(each) for each in read) == 150
    if make is drift:
        assert {each.terminated for each in truth if each.over} == {True, False}
    else:
        assert [len(each) for each in read] == [30, 30, 15] * 2
        assert not any(each.terminated for each in read)


def test_an_old_row_that_was_overwritten_leaves_the_middle_of_an_episode() -> None:
    model, venv = filled(pendulum, 200, buffer_size=140)
    read = replay_episodes(replay_of(model))
    assert replay_of(model).full
    # Of 100 steps in each environment the last 70 are left: all but the first episode, of 30 steps.
    assert [len(each) for each in read] == [30, 30, 10] * 2
    kept = [each for played in venv.env_method("get_wrapper_attr", "played") for each in played[1:]]
    assert_same(read, kept)
    assert [each.from_reset for each in read] == [False, True, True] * 2

    model, venv = filled(pendulum, 200, buffer_size=100)
    read = replay_episodes(replay_of(model))
    assert [(len(each), each.from_reset) for each in read[:3]] == [(10, False), (30, True), (10, True)]
    middle = venv.env_method("get_wrapper_attr", "played")[0][1]
    np.testing.assert_array_equal(read[0].observations, np.float32(middle.observations[-11:]))


@pytest.mark.parametrize("buffer_size", [1_000, 120])
@pytest.mark.parametrize("saves_memory", [True, False])
def test_the_last_step_of_an_episode_is_left_out_where_nobody_knows_what_it_was(
    buffer_size: int, saves_memory: bool
) -> None:
    kwargs = {"handle_timeout_termination": False}
    model, venv = filled(
        drift, 150, buffer_size=buffer_size, optimize_memory_usage=saves_memory, replay_buffer_kwargs=kwargs
    )
    expected: list[Recorded] = []
    for played in venv.env_method("get_wrapper_attr", "played"):
        steps = [(episode, step) for episode in played for step in range(len(episode.rewards))]
        # The newest that fit; with half the memory, one row has lost its observation.
        room = buffer_size // 2 - (saves_memory and len(steps) >= buffer_size // 2)
        before: Recorded | None = None
        for episode, step in steps[-room:]:
            if episode.over and step == len(episode.rewards) - 1:
                continue
            if episode is not before:
                expected.append(Recorded([episode.observations[step]]))
            before = episode
            expected[-1].observations.append(episode.observations[step + 1])
            expected[-1].actions.append(episode.actions[step])
            expected[-1].rewards.append(episode.rewards[step])
    assert_same(replay_episodes(replay_of(model)), expected)


def test_observations_and_rewards_are_those_of_the_environment_also_with_vec_normalize() -> None:
    model, venv = filled(pendulum, 100, VecNormalize)
    # SB3 normalises the last observation of an episode, and takes that back.
    assert_same(replay_episodes(replay_of(model)), truth_of(venv), rounding=1e-5)


def test_a_second_training_begins_another_episode() -> None:
    model, venv = filled(pendulum, 50)
    model.learn(50)
    truth = truth_of(venv)
    assert [len(each.rewards) for each in truth] == [25, 25] * 2
    read = replay_episodes(replay_of(model))
    assert_same(read, truth)
    assert all(each.from_reset for each in read)


def test_goals_are_flattened_as_gymnasium_flattens_them() -> None:
    env = BitFlippingEnv(n_bits=3, continuous=True)
    model = SAC(
        "MultiInputPolicy", env, learning_starts=100, replay_buffer_class=DictReplayBuffer, buffer_size=100, seed=0
    )
    model.learn(7)
    read = replay_episodes(replay_of(model))
    first, *_ = read
    achieved, desired, observation = first.observations[0].reshape(3, 3)
    np.testing.assert_array_equal(achieved, observation)
    np.testing.assert_array_equal(desired, np.ones(3))
    assert first.observations.shape[1] == gym.spaces.flatdim(env.observation_space)
    buffer: Any = model.replay_buffer
    for name, column in (("achieved_goal", 0), ("desired_goal", 3), ("observation", 6)):
        rows = np.concatenate([each.observations[:-1] for each in read])[:, column : column + 3]
        np.testing.assert_array_equal(rows, buffer.observations[name][:7, 0])


def test_what_holds_no_real_transitions_is_refused() -> None:
    model, _ = filled(pendulum, 50)
    buffer = replay_of(model)
    with pytest.raises(ValueError, match=r"imagined transitions: give model\.hucrl\.dataset"):
        replay_episodes(MixedReplayBuffer(buffer, buffer, 0.5))
    buffer.actions[3, 0] = 1.5
    with pytest.raises(ValueError, match=r"holds an action of 1\.5: .* scaled to \[-1, 1\]; give .* \.npz file"):
        replay_episodes(buffer)
    buffer.reset()
    with pytest.raises(ValueError, match="the replay buffer is empty"):
        replay_episodes(buffer)


def test_a_buffer_that_was_filled_in_imagination_does_not_fit_the_environment() -> None:
    imagining = small_sac().learn(80, callback=small_callback())
    with pytest.raises(ValueError, match=r"actions of logged episode 1 have 3 values, .* 1 \(without the halluc"):
        small_sac().learn(80, callback=small_callback(transitions=imagining.replay_buffer))


def test_an_episode_says_what_is_wrong_with_it() -> None:
    steps = np.zeros((3, 1), np.float32), np.zeros(3, np.float32)
    with pytest.raises(
        ValueError, match=r"observations of a logged episode have shape \(3, 2\): 3 rewards need 4 rows"
    ):
        LoggedEpisode(np.zeros((3, 2), np.float32), *steps, False)
    with pytest.raises(ValueError, match="has no step"):
        LoggedEpisode(np.zeros((1, 2), np.float32), steps[0][:0], steps[1][:0], False)
