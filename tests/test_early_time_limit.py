"""The first real episodes may be shorter than the environment's own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import SubprocVecEnv

from helpers import ENV_ID, small_callback, small_sac, state_of
from sb3_hucrl import ImaginationVecEnv, Loop
from sb3_hucrl.imagination import Array
from sb3_hucrl.loop import ModelSettings, Problem, RealSettings, SearchSettings, Settings
from sb3_hucrl.loop.schedule import EarlyTimeLimit
from sb3_hucrl.spaces import TIME_LIMIT

LENGTH = 30
MODEL = ModelSettings(dynamics_kwargs={"gradient_steps": 5, "net_arch": [16]})


def no_torque(observations: Array, first: npt.NDArray[np.bool_]) -> Array:
    return np.zeros((len(observations), 3), dtype=np.float32)


def pendulum_loop(env: gym.Env[Any, Any], **real: Any) -> Loop:
    settings = Settings(RealSettings(initial_steps=8, **real), SearchSettings(horizon=5), MODEL)
    return Loop(settings, Problem.from_env(env, MODEL), env, seed=0)


def real_env(length: int = LENGTH) -> gym.Env[Any, Any]:
    return gym.make(f"sb3_hucrl:{ENV_ID}", max_episode_steps=length)


def test_episodes_that_begin_early_are_short_and_later_ones_as_long_as_ever() -> None:
    env = real_env()
    loop = pendulum_loop(env, early_time_limit=[10, 25])
    for _ in range(5):
        loop.play(no_torque)
        # Whoever else uses the environment finds it as it was.
        assert env.get_wrapper_attr(TIME_LIMIT) == LENGTH
    assert loop.state.dataset.lengths == [10, 10, 10, LENGTH, LENGTH]
    # It was cut short, and is not the end of the task.
    assert not loop.state.dataset.transitions.terminated.any()
    assert len(loop.state.dataset.initial_states) == 5
    assert EarlyTimeLimit(10, 25).count(loop.state.dataset.lengths, together=1) == 3


def test_of_a_round_all_episodes_are_short_or_none() -> None:
    assert EarlyTimeLimit(10, 15).count([10, 10, 10, 10, 30, 30], together=2) == 2
    assert EarlyTimeLimit(10, 15).count([10, 10, 10, 10, 30, 30], together=1) == 2
    assert EarlyTimeLimit(10, 25).count([10, 10, 10, 10, 30, 30], together=2) == 4
    assert EarlyTimeLimit(10, 0).count([30, 30], together=1) == 0


def test_a_limit_beyond_that_of_the_environment_changes_nothing() -> None:
    loop = pendulum_loop(real_env(), early_time_limit=[2 * LENGTH, 1_000])
    loop.play(no_torque)
    assert loop.state.dataset.lengths == [LENGTH]


def test_an_episode_that_is_played_in_parts_keeps_the_limit_that_it_began_with() -> None:
    loop = pendulum_loop(real_env(), early_time_limit=[20, 10], real_steps=8, whole_episodes=False)
    loop.begin()
    while loop.state.real_steps < 50:
        loop.play(no_torque)
        loop.refit()
    assert loop.state.dataset.lengths == [20, LENGTH]


def test_an_interruption_leaves_the_environment_as_it_was() -> None:
    env = real_env()
    loop = pendulum_loop(env, early_time_limit=[10, 25])

    def interrupt(observations: Array, first: npt.NDArray[np.bool_]) -> Array:
        assert env.get_wrapper_attr(TIME_LIMIT) == 10
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        loop.play(interrupt)
    assert env.get_wrapper_attr(TIME_LIMIT) == LENGTH


def test_an_interruption_that_ends_the_process_of_the_environment_stays_one() -> None:
    class Ends(gym.Wrapper[Any, Any, Any, Any]):
        ended = False

        def step(self, action: Any) -> Any:
            self.ended = True
            raise KeyboardInterrupt

        def set_wrapper_attr(self, name: str, value: Any, *, force: bool = True) -> bool:
            if self.ended:
                raise RuntimeError("the process of environment 0 ended")
            return super().set_wrapper_attr(name, value, force=force)

    loop = pendulum_loop(Ends(real_env()), early_time_limit=[10, 25])
    with pytest.raises(KeyboardInterrupt):
        loop.play(no_torque)


def test_a_short_episode_solves_nothing() -> None:
    # Hanging costs nothing: every return is 0, up to rounding.
    loop = pendulum_loop(real_env(), early_time_limit=[10, 15], reward_threshold=-1.0)
    solved = []
    for _ in range(3):
        loop.play(no_torque)
        solved.append(loop.finished)
    assert solved == [False, False, True]


@pytest.mark.parametrize(
    "kind", [None, pytest.param(SubprocVecEnv, marks=pytest.mark.slow)], ids=["one process", "processes"]
)
def test_monitor_writes_short_episodes_and_the_model_promises_as_many_steps(kind: Any, tmp_path: Path) -> None:
    limited = {"max_episode_steps": LENGTH}
    venv = make_vec_env(
        f"sb3_hucrl:{ENV_ID}", 4, seed=0, env_kwargs=limited, monitor_dir=str(tmp_path), vec_env_cls=kind
    )
    model = small_sac(ImaginationVecEnv(venv))
    callback = small_callback(initial_steps=1, real_steps=1, early_time_limit=[10, 20], max_real_steps=70)
    model.learn(10_000, callback=callback)
    venv.close()
    assert pd.read_csv(tmp_path / "0.monitor.csv", skiprows=1)["l"].to_list() == [10, 10, LENGTH, LENGTH]
    assert state_of(model).dataset.lengths == [10, 10, LENGTH, LENGTH]
    promised = state_of(model).imagined_episodes
    assert [len(each.transitions) for each in promised] == [10, LENGTH, LENGTH]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([200], r"early_time_limit.*is \[200\].*\[steps, until\] such as"),
        ([0, 100], "early_time_limit"),
        (200, "early_time_limit"),
    ],
)
def test_what_is_no_limit_is_refused(given: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RealSettings(early_time_limit=given)


def test_a_system_whose_limit_cannot_be_changed_is_refused() -> None:
    class Robot:
        def reset(self) -> tuple[Any, dict[str, Any]]:
            raise AssertionError

        def step(self, action: Array, /) -> Any:
            raise AssertionError

    settings = Settings(RealSettings(early_time_limit=[10, 20]), model=MODEL)
    problem = Problem.from_env(real_env(), MODEL)
    with pytest.raises(ValueError, match=r"early_time_limit is \[10, 20\], and the real system is no gymnasium.Env"):
        Loop(settings, problem, Robot())
    with pytest.raises(ValueError, match=r"early_time_limit is \[10, 20\], and real episodes are told"):
        Loop(settings, problem, None)


def test_an_environment_that_takes_no_notice_is_refused() -> None:
    class Stubborn(gym.Wrapper[Any, Any, Any, Any]):
        def set_wrapper_attr(self, name: str, value: Any, *, force: bool = True) -> bool:
            return False

    loop = pendulum_loop(Stubborn(real_env()), early_time_limit=[10, 20])
    with pytest.raises(ValueError, match=r"has not ended after 10 steps .* wrap the environment in .*TimeLimit"):
        loop.play(no_torque)
