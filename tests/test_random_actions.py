"""Random real actions, which may be held for a while."""

from __future__ import annotations

from itertools import groupby

import gymnasium as gym
import numpy as np
import numpy.typing as npt
import pytest
import torch as th
from gymnasium import spaces

from sb3_hucrl.loop import random_actor

BOX = spaces.Box(np.array([-1.0, 2.0], dtype=np.float32), np.array([3.0, 2.5], dtype=np.float32))


def play(steps: int, hold: int, envs: int = 1, episode: int = 10_000, seed: int = 0) -> npt.NDArray[np.float32]:
    """Actions, shape (steps, envs, 2)."""
    act = random_actor(BOX, th.Generator().manual_seed(seed), hold)
    observations = np.zeros((envs, 3), dtype=np.float32)
    return np.stack([act(observations, np.full(envs, step % episode == 0)) for step in range(steps)])


def runs(actions: npt.NDArray[np.float32]) -> list[int]:
    """For how many steps each action of one environment is held."""
    return [len([*group]) for _, group in groupby(map(tuple, actions))]


def test_by_default_actions_are_uniform_and_new_in_every_step() -> None:
    actions = play(10_000, hold=1)[:, 0]
    assert set(runs(actions)) == {1}
    units = (actions - BOX.low) / (BOX.high - BOX.low)
    for dimension in units.T:
        # Kolmogorov and Smirnov: exceeded by one sample of 10,000 numbers in a thousand.
        assert np.abs(np.sort(dimension) - np.linspace(0, 1, len(dimension))).max() < 0.0195


def test_held_actions_last_for_any_number_of_steps_up_to_the_longest() -> None:
    lengths = runs(play(10_000, hold=4)[:, 0])[:-1]
    fractions = np.bincount(lengths, minlength=5) / len(lengths)
    # One in 64 is the same as the one before, both dimensions being at the same bounds again, and goes on with it.
    assert fractions[:5] == pytest.approx(np.array([0, 0.25, 0.25, 0.25, 0.25]), abs=0.03)
    assert np.mean(lengths) == pytest.approx(2.5 * 64 / 63, rel=0.02)


def test_half_of_what_is_held_is_at_a_bound_and_no_action_is_beyond() -> None:
    actions = play(5_000, hold=2)[:, 0]
    assert BOX.contains(actions.min(axis=0))
    assert BOX.contains(actions.max(axis=0))
    at_bounds = (actions == BOX.low) | (actions == BOX.high)
    assert at_bounds.mean(axis=0) == pytest.approx(np.array([0.5, 0.5]), abs=0.03)


def test_a_new_episode_begins_with_a_new_action() -> None:
    actions = play(2_000, hold=1_000, episode=2)[:, 0].reshape(-1, 2, 2)
    assert (actions[:, 0] == actions[:, 1]).mean() > 0.99
    assert (actions[1:, 0] != actions[:-1, 1]).any(axis=1).mean() > 0.9


def test_environments_of_a_batch_act_on_their_own() -> None:
    actions = play(1_000, hold=5, envs=3)
    changes = (actions[1:] != actions[:-1]).any(axis=-1)
    assert not (changes[:, 0] == changes[:, 1]).all()
    assert np.abs(np.corrcoef(actions[:, :, 0].T) - np.eye(3)).max() < 0.25


def test_the_same_seed_acts_alike() -> None:
    np.testing.assert_array_equal(play(100, hold=7, seed=3), play(100, hold=7, seed=3))
    assert (play(100, hold=7, seed=3) != play(100, hold=7, seed=4)).any()


@pytest.mark.parametrize(("hold", "escapes"), [(1, False), (50, True)])
def test_a_car_leaves_its_valley_by_actions_that_are_held(hold: int, escapes: bool) -> None:
    env = gym.make("MountainCarContinuous-v0", max_episode_steps=500)
    assert isinstance(env.action_space, spaces.Box)
    act, ended = random_actor(env.action_space, th.Generator().manual_seed(0), hold), []
    for episode in range(10):
        observation, terminated, truncated = env.reset(seed=episode)[0], False, False
        first = np.array([True])
        while not (terminated or truncated):
            observation, _, terminated, truncated, _ = env.step(act(observation[None], first)[0])
            first = np.array([False])
        ended.append(terminated)
    assert (sum(ended) >= 4) if escapes else not any(ended)
