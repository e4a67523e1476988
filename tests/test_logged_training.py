"""Trainings that begin with logged data."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
import pytest
import torch as th
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env

from helpers import random_transitions, small_callback, small_sac, state_of
from sb3_hucrl import HallucinationWrapper, HUCRLCallback, ImaginationVecEnv, StartStates, TransitionDataset
from sb3_hucrl.loop import HUCRLState, Loop, ModelSettings, Problem, Settings
from sb3_hucrl.pictures import trajectories
from sb3_hucrl.sb3 import MixedReplayBuffer, read_logged
from sb3_hucrl.tasks import PendulumTask

STEPS = 20


def arrays(env_id: str = "Pendulum-v1", episodes: int = 3, **kwargs: Any) -> dict[str, Any]:
    """Random episodes of an environment, as the arrays of a file."""
    env = gym.make(env_id, max_episode_steps=STEPS, **kwargs)
    env.action_space.seed(0)
    rows: list[tuple[Any, ...]] = []
    for number in range(episodes):
        observation, _ = env.reset(seed=number)
        ended = False
        while not ended:
            action = env.action_space.sample()
            following, reward, terminated, truncated, _ = env.step(action)
            rows.append((observation, action, reward, following, terminated, truncated))
            observation, ended = following, terminated or truncated
    names = ("observations", "actions", "rewards", "next_observations", "terminations", "truncations")
    return {name: np.array(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}


def log_file(folder: Path, name: str = "log.npz", **changed: Any) -> str:
    np.savez(folder / name, **{**arrays(), **changed})
    return str(folder / name)


def logged_callback(source: Any, **kwargs: Any) -> HUCRLCallback:
    """It asks for no random episodes."""
    return small_callback(transitions=source, **{"initial_steps": None, **kwargs})


def env_of(env_id: str = "Pendulum-v1", folder: Path | None = None, **kwargs: Any) -> ImaginationVecEnv:
    settings: dict[str, Any] = {
        "wrapper_class": HallucinationWrapper,
        "env_kwargs": {"max_episode_steps": STEPS, **kwargs},
    }
    return ImaginationVecEnv(
        make_vec_env(env_id, 4, seed=0, monitor_dir=None if folder is None else str(folder), **settings)
    )


def test_it_takes_the_place_of_random_episodes_and_is_counted_apart(tmp_path: Path) -> None:
    path = log_file(tmp_path)
    callback = logged_callback(path, log_dir=str(tmp_path))
    state = state_of(small_sac(env_of(folder=tmp_path)).learn(240, callback=callback))
    logged, data = arrays(), state.dataset
    assert (state.real_episodes, state.real_steps, data.logged_steps, len(data)) == (3, 60, 60, 120)
    assert (data.lengths, data.logged_lengths) == ([STEPS] * 3, [STEPS] * 3)
    np.testing.assert_allclose(data.transitions.rewards[:60], logged["rewards"], rtol=1e-5)
    np.testing.assert_allclose(PendulumLike.observe(data.transitions.states[:60]), logged["observations"], atol=1e-5)
    # Only one's own episodes are in monitor.csv, and are the real ones.
    monitor = pd.concat([pd.read_csv(each, skiprows=1) for each in tmp_path.glob("*.monitor.csv")])
    returns = [float(each.rewards.sum()) for each in data.episodes]
    np.testing.assert_allclose(sorted(monitor.r), sorted(returns), rtol=1e-4)
    progress = pd.read_csv(tmp_path / "progress.csv")
    assert progress["logged/steps"].tolist() == [60] * 4
    assert progress["real/steps"].tolist() == [0, 20, 40, 60]
    assert progress["real/episode"].tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(progress["real/return"][1:], returns, rtol=1e-4)
    assert np.isnan(progress["real/return"][0])


class PendulumLike:
    """What gymnasium's pendulum shows of its state (angle, angular velocity)."""

    @staticmethod
    def observe(states: th.Tensor) -> th.Tensor:
        return th.stack([states[:, 0].cos(), states[:, 0].sin(), states[:, 1]], dim=1)


@pytest.mark.parametrize(("asked", "expected"), [({}, 0), ({"initial_episodes": 2}, 2), ({"initial_steps": 41}, 3)])
def test_random_episodes_are_played_beside_it_where_they_are_asked_for(
    tmp_path: Path, asked: dict[str, Any], expected: int
) -> None:
    begun = []

    class Spy(HUCRLCallback):
        def _start_search(self) -> None:
            begun.append(state_of(self.model).real_episodes)
            super()._start_search()

    settings: dict[str, Any] = {
        "imagined_steps": 80,
        "horizon": 5,
        "dynamics_kwargs": {"gradient_steps": 5},
        "real_steps": 1,
    }
    small_sac(env_of()).learn(80, callback=Spy(transitions=log_file(tmp_path), **settings, **asked))
    assert begun[0] == expected


def test_it_is_in_the_checkpoint_and_is_not_read_again(tmp_path: Path) -> None:
    path, checkpoint = log_file(tmp_path), tmp_path / "checkpoint.zip"
    first = small_sac(env_of()).learn(80, callback=logged_callback(path, checkpoint=str(checkpoint)))
    Path(path).unlink()
    model = SAC.load(checkpoint, env=env_of(), device="cpu")
    assert state_of(model).fitted_steps == 80
    model.learn(160, callback=logged_callback(path), reset_num_timesteps=False)
    state = state_of(model)
    assert (state.dataset.logged_lengths, state.dataset.lengths) == ([STEPS] * 3, [STEPS] * 3)
    th.testing.assert_close(state.dataset.transitions.states[:80], state_of(first).dataset.transitions.states)
    assert state.fitted_steps == len(state.dataset) == 120


def test_an_interruption_before_the_first_real_episode_loses_nothing(tmp_path: Path) -> None:
    class Stop(HUCRLCallback):
        def _start_search(self) -> None:
            raise KeyboardInterrupt

    model = small_sac(env_of())
    settings: dict[str, Any] = {
        "horizon": 5,
        "dynamics_kwargs": {"gradient_steps": 5},
        "imagined_steps": 80,
        "real_steps": 1,
    }
    with pytest.raises(KeyboardInterrupt):
        model.learn(80, callback=Stop(transitions=log_file(tmp_path), **settings))
    model.save(tmp_path / "model.zip")
    model = SAC.load(tmp_path / "model.zip", env=env_of(), device="cpu")
    model.learn(80, callback=HUCRLCallback(transitions="gone.npz", **settings))
    assert (state_of(model).real_episodes, state_of(model).dataset.logged_steps) == (1, 60)


def test_before_the_first_real_episode_there_is_nothing_to_draw(tmp_path: Path) -> None:
    env = gym.make("HUCRL-Pendulum-v0", max_episode_steps=5)
    settings = Settings(model=ModelSettings(dynamics_kwargs={"gradient_steps": 5}))
    loop = Loop(settings, Problem.from_env(env, settings.model), env, seed=0)
    loop.add_logged(
        read_logged(log_file(tmp_path, **arrays("HUCRL-Pendulum-v0", hallucinate=False)), loop.problem.task)
    )
    loop.begin()
    with pytest.raises(ValueError, match="no real episode has been finished yet"):
        trajectories(loop.state)


def test_a_run_that_has_begun_without_it_takes_none(tmp_path: Path) -> None:
    model = small_sac(env_of()).learn(80, callback=small_callback())
    with pytest.raises(ValueError, match="has learned from 40 transitions: logged ones must be given before these"):
        model.learn(80, callback=logged_callback(log_file(tmp_path)), reset_num_timesteps=False)
    # All that it has learned from can be the logged data of another run.
    other = small_sac(env_of()).learn(80, callback=logged_callback(state_of(model).dataset))
    assert (state_of(other).dataset.logged_steps, state_of(other).real_steps) == (40, 20)


def test_imagination_begins_in_logged_states_and_in_those_after_a_reset() -> None:
    dataset = TransitionDataset(2, 1)
    parts = [random_transitions(40, seed=1), random_transitions(30, seed=2)]
    dataset.append_logged(parts, [False, True])
    generator = th.Generator().manual_seed(0)
    for kind, pool in (("visited", th.cat([each.states for each in parts])), ("initial", parts[1].states[:1])):
        states, _ = StartStates(dataset, PendulumTask(), {kind: 1.0}).sample(500, generator)
        assert {tuple(each) for each in states.tolist()} == {tuple(each) for each in pool.tolist()}
    dataset.append_episode(random_transitions(10, seed=3))
    assert dataset.initial_states.shape == (2, 2)

    # Where nothing is known of resets, the first states of all parts have to do.
    unknown = TransitionDataset(2, 1)
    unknown.append_logged(parts, [False, False])
    th.testing.assert_close(unknown.initial_states, th.stack([each.states[0] for each in parts]))
    with pytest.raises(ValueError, match="holds 1 real episodes of its own"):
        dataset.append_logged(parts, [True, True])


@pytest.mark.parametrize(("logged", "expected"), [(300, 25_600), (1_000, 64_000), (5_000, 64_000)])
def test_long_logs_make_the_first_search_no_longer(logged: int, expected: int) -> None:
    env = gym.make("HUCRL-Pendulum-v0", max_episode_steps=5)
    settings = Settings(model=ModelSettings(dynamics_kwargs={"gradient_steps": 5}))
    loop = Loop(settings, Problem.from_env(env, settings.model), env, seed=0)
    long = TransitionDataset(2, 1)
    long.append_episode(random_transitions(logged))
    loop.add_logged(read_logged(long, loop.problem.task))
    loop.begin()
    assert (loop.state.real_episodes, loop.imagined_steps) == (0, expected)
    loop.begin_search()
    loop.play(lambda observations, first: np.zeros((1, 3), dtype=np.float32))
    loop.refit()
    assert (loop.state.real_episodes, loop.imagined_steps) == (1, 5 * 128)


@pytest.mark.parametrize("settings", [{}, {"task": "learned"}], ids=["known", "learned"])
def test_batches_of_real_data_and_learned_rewards_have_it_too(tmp_path: Path, settings: dict[str, Any]) -> None:
    def make() -> gym.Env[Any, Any]:
        return HallucinationWrapper(gym.make("Pendulum-v1", max_episode_steps=STEPS), 3 if settings else None)

    model = small_sac(ImaginationVecEnv(make_vec_env(make, 4)))
    model.learn(160, callback=logged_callback(log_file(tmp_path), real_data_fraction=0.5, **settings))
    assert (state_of(model).real_episodes, len(state_of(model).dataset)) == (2, 100)
    assert isinstance(model.replay_buffer, MixedReplayBuffer)
    rewards = model.replay_buffer.real.rewards[:60, 0]
    np.testing.assert_allclose(rewards, arrays()["rewards"], rtol=1e-5)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rewards": lambda r: r / 100}, r"whose reward is .* at step 1 of logged episode 1, where the data say"),
        ({"actions": lambda a: a / 2}, "whose reward is .* actions in other units; give what this environment itself"),
        ({"actions": lambda a: a * 3}, r"the action of step \d+ of logged episode \d is .* from \[-2\.0\] to \[2\.0\]"),
        ({"terminations": lambda t: np.arange(len(t)) == 19}, "terminated is False at step 20 of logged episode 1"),
        (
            {"observations": lambda o: o / 2, "next_observations": lambda o: o / 2},
            r"whose observe\(state\(observation\)\)",
        ),
        (
            {"observations": lambda o: o[:, :2], "next_observations": lambda o: o[:, :2]},
            r"observations of logged episode 1 have 2 values, and those of this environment 3 \(with all its",
        ),
    ],
    ids=["reward", "unscaled", "box", "termination", "normalised", "shape"],
)
def test_data_of_something_else_are_refused_before_anything_is_played(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    logged = arrays()
    path = log_file(tmp_path, **{name: change(logged[name]) for name, change in changes.items()})
    model = small_sac(env_of())
    with pytest.raises(ValueError, match=message):
        model.learn(80, callback=logged_callback(path))
    assert not hasattr(model, "hucrl")


def test_later_logged_episodes_are_compared_as_well(tmp_path: Path) -> None:
    logged = arrays(episodes=60)
    logged["rewards"][-1] += 1
    with pytest.raises(ValueError, match="at step 20 of logged episode 60"):
        small_sac(env_of()).learn(80, callback=logged_callback(log_file(tmp_path, **logged)))


def test_a_state_of_an_earlier_version_has_no_logged_data() -> None:
    dataset = TransitionDataset(2, 1)
    dataset.append_episode(random_transitions(5))
    old = {name: value for name, value in vars(dataset).items() if name != "logged_lengths"}
    loaded = TransitionDataset.__new__(TransitionDataset)
    loaded.__setstate__(old)
    assert (loaded.logged_steps, len(loaded.episodes), loaded.logged_episodes) == (0, 1, [])
    assert HUCRLState(loaded, None, th.Generator()).real_steps == 5  # type: ignore[arg-type]  # no model is needed
