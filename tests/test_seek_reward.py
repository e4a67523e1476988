"""Random episodes that meet no reward hold their actions, and go on."""

from __future__ import annotations

from collections.abc import Callable
from itertools import groupby
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
import numpy.typing as npt
import pytest
import torch as th

from sb3_hucrl import Greedy, Loop
from sb3_hucrl.data import Transitions
from sb3_hucrl.loop import ModelSettings, Problem, RealSettings, SearchSettings, Settings, meets_reward

LENGTH = 40
#: of a position and an action of one dimension
Reward = Callable[[float, float], float]


class Corridor(gym.Env[npt.NDArray[np.float32], npt.NDArray[np.float32]]):
    """A position in [-1, 1], which an action changes by a twentieth of it."""

    def __init__(self, reward: Reward) -> None:
        self.observation_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self._reward, self._position = reward, 0.0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self._position = 0.0
        return np.zeros(1, dtype=np.float32), {}

    def step(self, action: npt.NDArray[np.float32]) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        self._position = float(np.clip(self._position + 0.05 * action[0], -1.0, 1.0))
        reward = self._reward(self._position, float(action[0]))
        return np.array([self._position], dtype=np.float32), reward, False, False, {}


def costs_alone(position: float, action: float) -> float:
    return -0.1 * action**2


def far_away(position: float, action: float) -> float:
    return 1.0 * (position > 0.9) - 0.1 * action**2


def everywhere(position: float, action: float) -> float:
    return -abs(position)


def corridor_loop(reward: Reward, told: bool = False, **real: Any) -> Loop:
    env = gym.wrappers.TimeLimit(Corridor(reward), LENGTH)
    model = ModelSettings(dynamics_kwargs={"gradient_steps": 5})
    settings = Settings(RealSettings(**{"seek_reward": [30, 600], **real}), SearchSettings(Greedy()), model)
    return Loop(settings, Problem.from_env(env, model), None if told else env, seed=0)


def played(reward: Reward, **real: Any) -> Loop:
    loop = corridor_loop(reward, **real)
    loop.begin()
    return loop


def held(actions: npt.NDArray[np.float32]) -> float:
    """Fraction of the actions that are the ones before."""
    return 1 - len([*groupby(map(tuple, actions))]) / len(actions)


def test_where_every_reward_says_something_nothing_changes() -> None:
    loop, plain = played(everywhere), played(everywhere, seek_reward=None)
    assert loop.state.dataset.lengths == [LENGTH]
    assert loop.state.dataset.transitions.actions.equal(plain.state.dataset.transitions.actions)


def test_where_a_reward_is_far_away_random_episodes_hold_their_actions_until_they_meet_it() -> None:
    loop = played(far_away)
    first, *others = loop.state.dataset.episodes
    assert held(first.actions.numpy()) == 0
    assert others
    assert all(held(each.actions.numpy()) > 0.5 for each in others)
    assert loop.state.real_steps < 600
    found = [bool((each.rewards > 0.5).any()) for each in loop.state.dataset.episodes]
    assert found == [False] * len(others) + [True]


def test_where_there_is_none_they_give_up() -> None:
    assert played(costs_alone).state.real_steps == 600
    assert played(costs_alone, max_real_steps=100).state.real_steps == 120
    assert played(costs_alone, initial_steps=800).state.real_steps == 800


def test_where_refits_do_not_wait_for_whole_episodes_they_seek_as_well() -> None:
    loop = played(far_away, whole_episodes=False, initial_steps=50, real_steps=10)
    assert bool((loop.state.dataset.transitions.rewards > 0.5).any())
    assert loop.state.real_steps < 600


def test_policies_that_are_asked_for_seek_as_well() -> None:
    loop = corridor_loop(far_away, told=True, max_real_steps=1_000)
    system = gym.wrappers.TimeLimit(Corridor(far_away), LENGTH)
    first = loop.ask().play(system)
    loop.tell(first)
    second = loop.ask().play(system)
    assert held(np.array(first.actions)) == 0
    assert held(np.array(second.actions)) > 0.5


def transitions(rewards: th.Tensor, actions: th.Tensor, terminated: bool = False) -> Transitions:
    ends = th.zeros(len(rewards), dtype=th.bool)
    ends[-1] = terminated
    states = th.zeros(len(rewards), 1)
    return Transitions(states, actions, states, rewards.float(), ends)


def test_what_counts_as_a_reward() -> None:
    generator = th.Generator().manual_seed(0)
    actions = th.rand(300, 2, generator=generator) * 2 - 1
    cost = -0.3 * actions.square().sum(dim=1) - 0.1 * actions[:, 0].abs() + 5
    other = th.rand(300, generator=generator)
    assert not meets_reward(transitions(cost, actions))
    assert not meets_reward(transitions(th.full((300,), 0.1), actions))
    assert not meets_reward(transitions(th.zeros(300), actions))
    assert not meets_reward(transitions(-0.1 * actions[:, 0].abs(), actions.abs()))
    assert meets_reward(transitions(cost + 0.05 * other, actions))
    assert meets_reward(transitions(cost, actions, terminated=True))
    once = cost.clone()
    once[100] += 1.0
    assert meets_reward(transitions(once, actions))


@pytest.mark.parametrize("given", [[50], [0, 100], 50, [50, -1], [1, 2, 3]])
def test_anything_else_is_refused(given: object) -> None:
    with pytest.raises(ValueError, match="seek_reward"):
        RealSettings(seek_reward=given)  # type: ignore[arg-type]  # what a YAML file may say
