"""A loop that is told its real episodes: each is checked, and recorded once."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th

from helpers import ENV_ID, elsewhere, real_pendulum
from sb3_hucrl import Episode, Loop
from sb3_hucrl.loop import ModelSettings, Problem, RealSettings, SearchSettings, Settings
from sb3_hucrl.tasks import PendulumTask
from test_loop import LinearPolicy

LENGTH = 20


def small_loop(state: Any = None, **real: Any) -> Loop:
    settings = Settings(
        real=RealSettings(**{"max_real_steps": 10 * LENGTH, "initial_steps": 1, "real_steps": 1, **real}),
        search=SearchSettings(horizon=5, start_states={"initial": 1.0}),
        model=ModelSettings(dynamics_kwargs={"gradient_steps": 20, "net_arch": [16]}),
    )
    env = gym.make(f"sb3_hucrl:{ENV_ID}", max_episode_steps=LENGTH)
    return Loop(settings, Problem.from_env(env, settings.model), None, state=state, seed=0)


def returns(loop: Loop) -> list[float]:
    return [float(each.rewards.sum()) for each in loop.state.dataset.episodes]


def test_the_loop_asks_for_a_search_whenever_enough_was_told() -> None:
    loop, env = small_loop(initial_episodes=2, real_episodes=2), real_pendulum(LENGTH)
    asked: list[bool] = []
    search: LinearPolicy | None = None
    exploring = []
    while not loop.finished:
        asked.append(loop.needs_search)
        if loop.needs_search:
            with pytest.raises(ValueError, match="begin_search"):
                loop.ask(search)
            world = loop.begin_search(num_trajectories=8)
            search = search or LinearPolicy(3, world)
            search.improve(world, tries=2)
            exploring.append(world.exploring)
        loop.tell(loop.ask(search).play(env))
    assert asked == [False, False, *[True, False] * 4]
    # Of ten planned episodes, four, six, eight and ten are over with the searches' ones: half of them sample.
    assert exploring == [True, False, False, False]
    assert [each.real_episode for each in loop.state.promised_returns] == list(range(3, 11))


def test_what_is_recorded_is_what_the_system_did() -> None:
    loop, env = small_loop(), real_pendulum(LENGTH)
    episode = elsewhere(loop.ask()).play(env)
    assert loop.tell(episode)
    [recorded] = loop.state.dataset.episodes
    states = PendulumTask().state(th.as_tensor(episode.observations))
    assert th.equal(recorded.states, states[:-1])
    assert th.equal(recorded.next_states, states[1:])
    np.testing.assert_array_equal(recorded.actions, episode.actions)
    np.testing.assert_array_equal(recorded.rewards, episode.rewards)
    assert episode.actions.shape == (LENGTH, 1)
    assert np.ptp(episode.actions) > 1  # at random
    assert not recorded.terminated.any()


def test_several_systems_tell_in_any_order() -> None:
    loop, env = small_loop(real_episodes=3), real_pendulum(LENGTH)
    first = [loop.ask() for _ in range(3)]
    loop.tell(first[2].play(env))
    search = LinearPolicy(3, loop.begin_search())
    searched = [loop.ask(search) for _ in range(3)]
    assert len({policy.id for policy in first + searched}) == 6
    order = [searched[1], first[0], searched[0], first[1], searched[2]]
    episodes = [policy.play(env) for policy in order]
    for episode in episodes:
        assert loop.tell(episode)
    told = loop.state.asked.told
    assert [told[policy.id] for policy in order] == [1, 2, 3, 4, 5]
    np.testing.assert_allclose(returns(loop)[1:], [each.rewards.sum() for each in episodes], rtol=1e-5)
    # Random ones were not promised anything.
    assert [each.real_episode for each in loop.state.promised_returns] == [2, 4, 6]
    assert loop.state.asked.open == {}


def test_an_episode_is_recorded_once_however_often_it_is_told() -> None:
    loop, env = small_loop(), real_pendulum(LENGTH)
    episode, other = loop.ask().play(env), loop.ask().play(env)
    assert [loop.tell(episode), loop.tell(episode)] == [True, False]
    resumed = small_loop(pickle.loads(pickle.dumps(loop.state)))
    assert not resumed.tell(episode)
    assert resumed.tell(other)
    assert resumed.state.real_episodes == 2
    with pytest.raises(ValueError, match="another episode of policy"):
        resumed.tell(replace(other, policy_id=episode.policy_id))


def test_what_was_interrupted_before_it_was_stored_is_new(monkeypatch: pytest.MonkeyPatch) -> None:
    loop, env = small_loop(), real_pendulum(LENGTH)
    episode, other = loop.ask().play(env), loop.ask().play(env)

    def interrupted(*args: Any, **kwargs: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(loop.state.dataset, "append_part", interrupted)
    with pytest.raises(KeyboardInterrupt):
        loop.tell(episode)
    monkeypatch.undo()
    assert loop.tell(other)
    assert loop.tell(episode)
    assert loop.state.asked.told == {other.policy_id: 0, episode.policy_id: 1}


def test_a_state_of_an_earlier_version_was_asked_nothing() -> None:
    state = small_loop().state.__getstate__()
    del state["asked"]
    loaded = pickle.loads(pickle.dumps(small_loop().state))
    loaded.__setstate__(state)
    assert loaded.asked.told == {}


Change = Callable[[dict[str, Any]], dict[str, Any]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: {"actions": c["actions"][:-1]}, r"actions has shape \(19, 1\), and there are 20 rewards"),
        (lambda c: {"observations": c["observations"][:-1]}, "with the observation after the last step"),
        (lambda c: {"truncated": np.zeros(LENGTH, dtype=bool)}, r"no step ended it: set truncated\[-1\] to True"),
        (lambda c: {"terminated": np.arange(LENGTH) == 3}, "it ended with step 4, and has 20 steps"),
        (lambda c: {"terminated": np.zeros(LENGTH)}, "terminated has shape .* dtype float64: give a boolean"),
        (lambda c: {"rewards": np.zeros((LENGTH, 1))}, "give one number for each step"),
        (lambda c: {"rewards": c["rewards"] * np.nan}, "returned reward is nan at step 1"),
        (lambda c: {"observations": c["observations"] / 0}, r"observation\[0\] is .* at step 0 \(episode of policy"),
        (lambda c: {"observations": c["observations"][:, :2]}, r"observation of shape \(2,\) at step 0"),
        (lambda c: {"actions": np.repeat(c["actions"], 3, axis=1)}, r"give \(20, 1\), the real actions without a′"),
        (lambda c: {"actions": c["actions"] * 5}, "it must lie from"),
        (lambda c: {"rewards": c["rewards"] + 1}, "task is PendulumTask, whose reward is"),
        (lambda c: {name: np.concatenate([each, each[-1:]]) for name, each in c.items()}, "it ended with step 20"),
    ],
)
@pytest.mark.filterwarnings("ignore:(divide|invalid)")
def test_what_is_wrong_is_refused_and_nothing_recorded(change: Change, message: str) -> None:
    loop = small_loop()
    episode = loop.ask().play(real_pendulum(LENGTH))
    names = ("observations", "actions", "rewards", "terminated", "truncated")
    columns = {name: getattr(episode, name) for name in names}
    with pytest.raises(ValueError, match=message):
        loop.tell(replace(episode, **change(columns)))
    assert loop.state.real_episodes == 0
    assert loop.tell(episode)


def test_an_episode_survives_its_file(tmp_path: Path) -> None:
    episode = small_loop().ask().play(real_pendulum(LENGTH))
    episode.save(tmp_path / "one.npz")
    loaded = Episode.load(tmp_path / "one.npz")
    assert loaded.policy_id == episode.policy_id
    for name in ("observations", "actions", "rewards", "terminated", "truncated"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(episode, name))
    assert [path.name for path in tmp_path.iterdir()] == ["one.npz"]
    (tmp_path / "half.npz").write_bytes((tmp_path / "one.npz").read_bytes()[:200])
    with pytest.raises(ValueError, match=r"half.npz is not the npz file of an episode"):
        Episode.load(tmp_path / "half.npz")


class Endless:
    """A system that ends no episode, and writes all observations into one array."""

    def __init__(self) -> None:
        self.observation = np.zeros(3, dtype=np.float32)

    def reset(self) -> tuple[Any, dict[str, Any]]:
        return self.observation, {}

    def step(self, action: Any, /) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.observation += 1
        return self.observation, 0.0, False, False, {}


def test_a_policy_truncates_at_the_time_limit_and_copies_what_it_sees() -> None:
    episode = small_loop().ask().play(Endless())
    np.testing.assert_array_equal(episode.observations[:, 0], np.arange(LENGTH + 1))
    assert episode.truncated.tolist() == [False] * (LENGTH - 1) + [True]
    assert not episode.terminated.any()


def test_a_policy_refuses_observations_of_another_system() -> None:
    policy = small_loop().ask()
    with pytest.raises(ValueError, match=r"shape \(2,\): this policy takes one observation of shape \(3,\)"):
        policy.act(np.zeros(2))
    with pytest.raises(ValueError, match=r"observation.* is nan"):
        policy.act(np.full(3, np.nan))


def test_a_loop_that_is_told_needs_a_plan_and_no_copies() -> None:
    with pytest.raises(ValueError, match="max_real_steps is None, and real episodes are told"):
        small_loop(max_real_steps=None)
    with pytest.raises(ValueError, match="real_envs is 2, and real episodes are told: leave it out"):
        small_loop(real_envs=2)
    loop = small_loop()
    with pytest.raises(ValueError, match="there is no real system here"):
        loop.begin()
    with pytest.raises(ValueError, match="random real episodes are missing"):
        loop.begin_search()
