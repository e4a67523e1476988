"""Refits and searches within a real episode, which waits for them."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
import torch as th
from stable_baselines3.common.env_util import make_vec_env

from helpers import ENV_ID, imagination_env, random_transitions, small_callback, small_sac, state_of
from sb3_hucrl import ImaginationVecEnv, Loop, TransitionDataset
from sb3_hucrl.imagination import Array
from sb3_hucrl.loop import ModelSettings, PlayedEpisode, Problem, RealSettings, Report, SearchSettings, Settings
from sb3_hucrl.loop.lines import EpisodeLines
from sb3_hucrl.sb3.curve import carried_lines, saved_curve

LENGTH = 30


def torque(value: float) -> Any:
    def act(observations: Array, first: npt.NDArray[np.bool_]) -> Array:
        return np.full((len(observations), 3), value, dtype=np.float32)

    return act


def pendulum_loop(env: gym.Env[Any, Any], **kwargs: Any) -> Loop:
    real = RealSettings(initial_steps=45, real_steps=20, whole_episodes=False)
    model = ModelSettings(dynamics_kwargs={"gradient_steps": 5, "net_arch": [16]})
    settings = Settings(real, SearchSettings(horizon=5), model)
    return Loop(settings, Problem.from_env(env, model), env, seed=0, **kwargs)


def real_env() -> gym.Env[Any, Any]:
    return gym.make(f"sb3_hucrl:{ENV_ID}", max_episode_steps=LENGTH)


def test_parts_make_up_the_episodes_that_the_environment_played() -> None:
    reports: list[Report] = []
    loop = pendulum_loop(real_env(), on_refit=reports.append)
    loop.begin()
    dataset = loop.state.dataset
    assert (dataset.lengths, dataset.under_way) == ([LENGTH], 15)
    played = []
    for number in range(3):
        played.append(loop.play(torque(0.1 * number)))
        loop.refit()
    # 15 + 20 steps end the second episode after 15 of them: the rest is the next call's.
    assert [len(each) for each in played] == [1, 0, 1]
    assert dataset.lengths == [LENGTH, LENGTH, LENGTH]
    assert loop.state.real_steps == len(dataset) == 45 + 15 + 20 + 10
    # One episode for the real system: each state is where the last transition led to.
    for episode in dataset.episodes:
        th.testing.assert_close(episode.states[1:], episode.next_states[:-1])
    assert dataset.initial_states.shape == (3, 2)
    th.testing.assert_close(played[0][0].rewards, dataset.episodes[1].rewards)
    # The policies followed one another within the last episode.
    assert dataset.episodes[2].actions.squeeze().tolist() == pytest.approx([0.1] * 20 + [0.2] * 10)
    assert [[each.number for each in report.episodes] for report in reports] == [[1], [2], [], [3]]
    assert [report.scalars["real/steps"] for report in reports] == [45, 60, 80, 90]
    assert reports[-1].scalars["real/return"] == pytest.approx(float(dataset.episodes[2].rewards.sum()))


def test_a_training_plays_exact_parts_until_it_ends_with_a_whole_episode(tmp_path: Path) -> None:
    env = ImaginationVecEnv(make_vec_env(ENV_ID, 4, seed=0, env_kwargs={"max_episode_steps": LENGTH}))
    model = small_sac(env)
    callback = small_callback(
        initial_steps=40, real_steps=20, whole_episodes=False, max_real_steps=100, log_dir=tmp_path, verbose=1
    )
    model.learn(10_000, callback=callback)
    state = state_of(model)
    # 100 steps are used up after ten of the fourth episode.
    assert (state.dataset.lengths, state.dataset.under_way) == ([LENGTH] * 4, 0)
    progress = pd.read_csv(tmp_path / "progress.csv")
    assert progress["real/steps"].to_list() == [40, 60, 80, 120]
    assert progress["real/episode"].to_list() == [1, 2, 2, 4]
    # What was imagined before the second episode's third part is not promised of the third episode.
    assert [each.real_episode for each in state.promised_returns] == [3, 4]


def test_no_episode_begins_once_the_real_steps_are_used_up() -> None:
    env = ImaginationVecEnv(make_vec_env(ENV_ID, 4, seed=0, env_kwargs={"max_episode_steps": LENGTH}))
    model = small_sac(env)
    settings: dict[str, Any] = {"initial_steps": 40, "real_steps": 40, "whole_episodes": False}
    # The third episode ends after 90 steps, of a part that would last until 120.
    model.learn(10_000, callback=small_callback(**settings, max_real_steps=85))
    assert (state_of(model).dataset.lengths, state_of(model).dataset.under_way) == ([LENGTH] * 3, 0)


def test_a_training_that_ended_within_an_episode_goes_on_with_a_new_one(tmp_path: Path) -> None:
    env = ImaginationVecEnv(make_vec_env(ENV_ID, 4, seed=0, env_kwargs={"max_episode_steps": LENGTH}))
    model = small_sac(env)
    settings: dict[str, Any] = {"initial_steps": 20, "real_steps": 20, "whole_episodes": False}
    model.learn(16, callback=small_callback(**settings))
    model.save(tmp_path / "model.zip")
    saved = saved_curve(tmp_path / "model.zip")
    loaded = type(model).load(tmp_path / "model.zip", env=imagination_env(max_episode_steps=LENGTH))
    loaded.learn(10_000, callback=small_callback(**settings, max_real_steps=100), reset_num_timesteps=False)
    dataset = state_of(loaded).dataset
    # The ten steps of the second episode stay, as an episode of their own.
    assert (dataset.lengths, dataset.under_way) == ([LENGTH, 10, LENGTH, LENGTH], 0)
    assert len(dataset.initial_states) == 4
    rows = [*map(json.loads, carried_lines(loaded)["monitor"])]
    assert [row["l"] for row in rows] == dataset.lengths
    assert saved is not None
    assert [row["l"] for row in saved["monitor"]] == [LENGTH, 10]
    returns = [float(episode.rewards.double().sum()) for episode in dataset.episodes]
    assert [row["r"] for row in rows] == pytest.approx(returns, abs=1e-4)


def test_an_interruption_within_an_episode_keeps_its_parts() -> None:
    env = real_env()
    loop = pendulum_loop(env)
    loop.begin()

    def interrupt(observations: Array, first: npt.NDArray[np.bool_]) -> Array:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        loop.play(interrupt)
    assert (loop.state.dataset.lengths, loop.state.dataset.under_way) == ([LENGTH], 15)
    loop.play(torque(0.0))
    assert (loop.state.dataset.lengths, loop.state.dataset.under_way) == ([LENGTH, 15], 20)


def test_several_environments_and_told_episodes_are_refused() -> None:
    with pytest.raises(ValueError, match="whole_episodes is False, and real_envs is 2"):
        small_sac().learn(100, callback=small_callback(whole_episodes=False, real_envs=2))
    env = real_env()
    settings = Settings(RealSettings(whole_episodes=False, max_real_steps=100))
    with pytest.raises(ValueError, match="whole_episodes is False, and real episodes are told"):
        Loop(settings, Problem.from_env(env, settings.model), None)


def test_a_dataset_knows_the_episode_that_is_under_way(tmp_path: Path) -> None:
    dataset, parts = TransitionDataset(2, 1), random_transitions(10)
    dataset.append_episode(parts[:3])
    dataset.append_part(parts[3:5], over=False)
    dataset.append_part(parts[5:6], over=False)
    assert (dataset.lengths, dataset.under_way, dataset.ends, dataset.real_steps) == ([3], 3, [3, 6], 6)
    assert [*map(len, dataset.episodes)] == [3]
    assert [*map(len, dataset.all_episodes)] == [3, 3]
    dataset.save(tmp_path / "data.npz")
    assert TransitionDataset.load(tmp_path / "data.npz").lengths == [3, 3]
    with pytest.raises(ValueError, match="append logged ones before these"):
        dataset.append_logged([parts], [True])
    dataset.append_part(parts[6:], over=True)
    dataset.end_episode()
    assert (dataset.lengths, dataset.under_way) == ([3, 7], 0)
    th.testing.assert_close(dataset.initial_states, parts.states[[0, 3]])


def test_the_seconds_of_refits_without_a_line_are_in_the_next_one(capsys: pytest.CaptureFixture[str]) -> None:
    lines = EpisodeLines()
    loop = pendulum_loop(real_env())
    loop.begin()
    fit = loop.state.dynamics.fit(loop.state.dataset, th.Generator())
    episode = PlayedEpisode(1, 30, -1.0, None, None, -1.0)
    for scalars, episodes in (({"time/fit_seconds": 1.5}, []), ({"time/fit_seconds": 2.0}, [episode])) * 2:
        lines.print(Report(dict(scalars), fit, list(episodes)))
    printed = [line for line in capsys.readouterr().out.splitlines() if "30" in line]
    assert [line.split()[-1] for line in printed] == ["3.5s", "3.5s"]
    assert all(a == b for a, b in pairwise(printed))
