"""Environments of unusual spaces, values and lengths: each is learned from, or refused in one line."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import TimeLimit, TransformAction
from stable_baselines3 import SAC
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

from helpers import small_callback, small_sac, state_of
from sb3_hucrl import HallucinationWrapper, ImaginationVecEnv
from sb3_hucrl.tasks import GymnasiumPendulumTask

OBSERVED, ACTIONS = spaces.Box(-10.0, 10.0, (2,)), spaces.Box(-1.0, 1.0, (2,))


class Odd(gym.Env[Any, Any]):
    """
    A point in the plane, driven by the sum of all actions. A subclass or a function changes what is odd about it.

    :param observation_space: whose shape and dtype observations have
    :param action_space: of any shape
    :param reward: made of a plain number
    :param terminated: made of the first observed value and the number of the step
    :param constant: whether the second observed value never changes
    """

    def __init__(
        self,
        observation_space: spaces.Space[Any] = OBSERVED,
        action_space: spaces.Space[Any] = ACTIONS,
        reward: Callable[[float], Any] = float,
        terminated: Callable[[Any, int], Any] = lambda x, step: abs(x) > 2,
        constant: bool = False,
    ) -> None:
        self.observation_space, self.action_space = observation_space, action_space
        self.reward, self.terminated, self.constant = reward, terminated, constant
        self.steps = self.episodes = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self.place, self.steps = self.np_random.uniform(-0.5, 0.5, 2), 0
        self.episodes += 1
        return self.observe(), {}

    def step(self, action: Any) -> Any:
        self.steps += 1
        self.place[0] += 0.2 * float(np.sum(action))
        self.place[1] += 0.0 if self.constant else 0.1 * float(np.max(action))
        reward = self.reward(-abs(self.place[0]))
        return self.observe(), reward, self.terminated(self.place[0], self.steps), False, {}

    def observe(self) -> Any:
        shape, dtype = self.observation_space.shape, self.observation_space.dtype
        assert shape is not None
        return np.resize(self.place, shape).astype(dtype)


class OneArray(Odd):
    """Writes every observation into the same array, and actions over the old ones."""

    def observe(self) -> Any:
        self.shown = getattr(self, "shown", np.zeros(2, dtype=np.float32))
        self.shown[:] = self.place
        return self.shown

    def step(self, action: Any) -> Any:
        result = super().step(action)
        action[:] = 0.0
        return result


class OtherReset(Odd):
    """Its second reset has one value more."""

    def reset(self, **kwargs: Any) -> Any:
        observation, infos = super().reset(**kwargs)
        return np.zeros(3, dtype=np.float32) if self.episodes > 2 else observation, infos


class Raises(Odd):
    """Breaks in the middle of its third episode."""

    def step(self, action: Any) -> Any:
        # SB3 resets once before training begins.
        if self.episodes == 4 and self.steps == 3:
            raise RuntimeError("out of order")
        return super().step(action)


class Dies(Odd):
    """Takes its process with it in the middle of its second episode."""

    def step(self, action: Any) -> Any:
        if self.episodes == 3 and self.steps == 3:
            os._exit(1)
        return super().step(action)


def odd(kind: type[Odd] = Odd, **kwargs: Any) -> gym.Env[Any, Any]:
    return HallucinationWrapper(TimeLimit(kind(**kwargs), 10))


def stack(
    kind: type[Odd] = Odd, vec_env: type[DummyVecEnv] | type[SubprocVecEnv] = DummyVecEnv, **kwargs: Any
) -> ImaginationVecEnv:
    return ImaginationVecEnv(vec_env([partial(odd, kind, **kwargs)] * 2))


def learn(env: ImaginationVecEnv) -> SAC:
    return small_sac(env, seed=0).learn(80, callback=small_callback(initial_episodes=3, imagined_steps=40))


def box(low: float, high: float, shape: tuple[int, ...] = (2,), dtype: Any = np.float32) -> spaces.Box:
    return spaces.Box(low, high, shape, dtype)


def limits(low: list[float], high: list[float]) -> spaces.Box:
    return spaces.Box(np.array(low, np.float32), np.array(high, np.float32))


LEARNED: dict[str, dict[str, Any]] = {
    "a termination as numpy's bool": {"terminated": lambda x, step: np.abs(x) > 2},
    "a termination as an array": {"terminated": lambda x, step: np.array([abs(x) > 2])},
    "a reward as a number of numpy": {"reward": np.float64},
    "a reward as an array": {"reward": lambda r: np.array([r], dtype=np.float32)},
    "a reward as an array without dimensions": {"reward": np.array},
    "a reward as an integer": {"reward": lambda r: int(10 * r)},
    "a reward as an integer of numpy": {"reward": lambda r: np.int64(10 * r)},
    "a reward as a tensor": {"reward": th.tensor},
    "rewards of 1e9": {"reward": lambda r: 1e9 * r},
    "rewards of 1e-9": {"reward": lambda r: 1e-9 * r},
    "rewards that never change": {"reward": lambda r: 1.0},
    "double observations": {"observation_space": box(-10.0, 10.0, (2,), np.float64)},
    "double actions": {"action_space": box(-1.0, 1.0, (2,), np.float64)},
    "limits that are not the same": {"action_space": limits([-3.0, 0.0], [1.0, 100.0])},
    "a constant dimension": {"constant": True},
    "more observed values": {"observation_space": box(-10.0, 10.0, (7,))},
    "an end at step 1": {"terminated": lambda x, step: True},
}


@pytest.mark.parametrize("name", LEARNED)
def test_learns_from(name: str) -> None:
    env = stack(**LEARNED[name])
    model = learn(env)
    state = state_of(model)
    assert state.real_episodes >= 5
    assert len(state.dataset) == sum(state.dataset.lengths)
    for parameter in model.policy.parameters():
        assert bool(th.isfinite(parameter).all())
    for episode in state.dataset.episodes:
        assert bool(episode.terminated[-1]) == (len(episode) < 10)
    if name == "an end at step 1":
        assert set(state.dataset.lengths) == {1}


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "actions of shape (2, 2)": (
        {"action_space": box(-1.0, 1.0, (2, 2))},
        r"action space has shape \(2, 2\) .*TransformAction.* lambda a: a.reshape",
    ),
    "an action without dimensions": ({"action_space": box(-1.0, 1.0, ())}, r"action space has shape \(\)"),
    "integer actions": ({"action_space": box(0, 9, (2,), np.int64)}, "dtype int64: .*TransformAction"),
    "half-bounded actions": (
        {"action_space": limits([-1.0, 0.0], [1.0, np.inf])},
        "is unbounded: give all actions",
    ),
    "an action with low = high": ({"action_space": limits([-1.0, 0.5], [1.0, 0.5])}, r"low = high in dimensions \[1\]"),
    "discrete actions": ({"action_space": spaces.Discrete(3)}, "needs continuous actions"),
    "integer observations": (
        {"observation_space": box(-9, 9, (2,), np.int64)},
        r"dtype int64: .*DtypeObservation\(env, np.float32\)",
    ),
    "observations of shape (2, 2)": ({"observation_space": box(-1.0, 1.0, (2, 2))}, "FlattenObservation"),
    "observations without dimensions": ({"observation_space": box(-1.0, 1.0, ())}, r"shape \(\)"),
    "a reward of two values": (
        {"reward": lambda r: np.array([r, r])},
        r"reward of shape \(2,\) at step 1 ",
    ),
    "a reward that is nan": ({"reward": lambda r: float("nan")}, "returned reward is nan at step 1 "),
    "no reward": ({"reward": lambda r: None}, "returned reward is nan at step 1 "),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refuses(name: str) -> None:
    options, message = REFUSED[name]
    with pytest.raises(ValueError, match=message):
        learn(stack(**options))


def test_an_environment_may_use_its_arrays_again() -> None:
    once, always = (state_of(learn(stack(kind))).dataset.transitions for kind in (Odd, OneArray))
    assert th.equal(once.states, always.states)
    assert th.equal(once.next_states, always.next_states)
    assert th.equal(once.actions, always.actions)


def test_an_episode_that_its_time_limit_does_not_end_is_refused() -> None:
    def endless() -> gym.Env[Any, Any]:
        return HallucinationWrapper(gym.make("Pendulum-v1", max_episode_steps=-1))

    def unlimited() -> gym.Env[Any, Any]:
        env = Odd(terminated=lambda x, step: False)
        env.spec = EnvSpec("Unlimited-v0", max_episode_steps=30)
        return HallucinationWrapper(env)

    with pytest.raises(ValueError, match=r"not ended after 30 steps \(environment 0\), .*wrappers.TimeLimit"):
        small_sac(ImaginationVecEnv(DummyVecEnv([unlimited] * 2))).learn(80, callback=small_callback())
    with pytest.raises(ValueError, match="has no time limit"):
        small_sac(ImaginationVecEnv(DummyVecEnv([endless] * 2))).learn(80, callback=small_callback())


def test_a_reset_of_another_shape_is_refused_and_what_was_learned_stays() -> None:
    model = small_sac(stack(OtherReset), seed=0)
    message = r"returned observation of shape \(3,\) at step 0 \(environment 0\): it must have shape \(2,\)"
    with pytest.raises(ValueError, match=message):
        model.learn(80, callback=small_callback(initial_episodes=3))
    assert state_of(model).real_episodes == 1


def test_an_environment_that_raises_loses_nothing_that_was_learned(tmp_path: Path) -> None:
    model, checkpoint = small_sac(stack(Raises), seed=0), tmp_path / "checkpoint.zip"
    with pytest.raises(RuntimeError, match="out of order"):
        model.learn(80, callback=small_callback(initial_episodes=3, checkpoint=str(checkpoint)))
    for each in (model, SAC.load(checkpoint, device="cpu")):
        assert state_of(each).real_episodes == 2
    resumed = SAC.load(checkpoint, env=stack(), device="cpu").learn(80, callback=small_callback())
    assert state_of(resumed).real_episodes == 3


def reshaped(hallucinated_dim: int, time_limit: int) -> gym.Env[Any, Any]:
    """Wrapped in functions that no process can send to another."""
    flat = spaces.Box(-1.0, 1.0, (1,))
    env = TransformAction(gym.make("Pendulum-v1"), lambda action: 2.0 * action.reshape(1), flat)
    return TimeLimit(HallucinationWrapper(env, hallucinated_dim), time_limit)


@pytest.mark.slow
def test_processes_need_not_send_the_functions_of_wrappers() -> None:
    env = ImaginationVecEnv(SubprocVecEnv([partial(reshaped, 2, 20)] * 2))
    with pytest.raises(ValueError, match=r"whose reward is .* around the environment: TransformAction; take"):
        small_sac(env, seed=0).learn(80, callback=small_callback(task=GymnasiumPendulumTask()))
    env.close()
    env = ImaginationVecEnv(SubprocVecEnv([partial(reshaped, 3, 20)] * 2))
    learned = small_sac(env, seed=0).learn(80, callback=small_callback(task="learned"))
    assert state_of(learned).dataset.lengths == [20, 20]
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("real_envs", [1, 2])
def test_a_worker_that_dies_is_named_and_what_was_learned_stays(real_envs: int) -> None:
    env = stack(Dies, SubprocVecEnv)
    model = small_sac(env, seed=0)
    with pytest.raises(RuntimeError, match=r"the process of environment 0 ended during step\(\): .*DummyVecEnv"):
        model.learn(80, callback=small_callback(initial_episodes=4, real_envs=real_envs))
    assert state_of(model).real_episodes == real_envs
