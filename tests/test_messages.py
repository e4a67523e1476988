"""Mistakes that users make: each gives one short line that says what to do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from gymnasium.wrappers import FlattenObservation, FrameStackObservation
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecFrameStack, VecNormalize

from helpers import ENV_ID, imagination_env, small_callback, small_sac, small_world
from sb3_hucrl import (
    Greedy,
    HallucinationWrapper,
    ImaginationVecEnv,
    Prediction,
    StartStates,
    Task,
    TransitionDataset,
    Transitions,
)
from sb3_hucrl.dynamics.base import Predictor
from sb3_hucrl.zoo import sbx as zoo_sbx

#: characters of a line that a user reads to its end
SHORT = 400


class Robot(Task):
    """As many observed values as Humanoid-v5 has."""

    state_dim = 348

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return next_state[:, 0]


class Diverged(Predictor):
    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        return Prediction(th.full_like(state, th.nan), th.zeros_like(state), th.zeros_like(state))


def imagine_a_diverged_robot() -> None:
    dataset = TransitionDataset(348, 17)
    states = th.zeros(1, 348)
    dataset.append_episode(Transitions(states, th.zeros(1, 17), states, th.zeros(1), th.zeros(1, dtype=th.bool)))
    starts = StartStates(dataset, Robot(), {"initial": 1.0})
    trajectories = small_world(Diverged(348, 17), Greedy(), Robot(), 10, starts).trajectories(4)
    trajectories.reset()
    trajectories.step(np.zeros((4, 17), dtype=np.float32))


class BrokenRobot(gym.Wrapper[Any, Any, Any, Any]):
    def step(self, action: Any) -> Any:
        observation, *rest = self.env.step(action)
        return observation * np.nan, *rest


def play_a_broken_robot() -> None:
    env = make_vec_env("HUCRL-Humanoid-v5", 2, wrapper_class=BrokenRobot)
    small_sac(ImaginationVecEnv(env)).learn(80, callback=small_callback())


def use_sbx() -> None:
    zoo_sbx.LazyAlgorithm("SAC")("MlpPolicy", ENV_ID)


def evaluate_without_hallucination() -> None:
    evaluate_policy(small_sac(), make_vec_env(ENV_ID, 1, env_kwargs={"hallucinate": False}), n_eval_episodes=1)


MISTAKES: list[tuple[Callable[[], object], str]] = [
    (imagine_a_diverged_robot, r"imagined observation\[0\] is nan \(348 of 348 values\) at step 1 .* lower beta"),
    (play_a_broken_robot, r"returned observation\[0\] is nan \(348 of 348 values\) at step 1 .* correct it there"),
    (use_sbx, "sbx_sac needs SBX, which is not installed: pip install sbx-rl"),
    (evaluate_without_hallucination, "make the environment with the same hallucinate"),
    (lambda: ImaginationVecEnv(gym.make(ENV_ID)), "venv is a .*, not a vectorised environment: give Imag"),  # type: ignore[arg-type]  # the mistake
    (
        lambda: ImaginationVecEnv(VecFrameStack(make_vec_env(ENV_ID, 2), 4)),
        "VecFrameStack lies inside .* stack in",
    ),
    (lambda: ImaginationVecEnv(VecNormalize(make_vec_env(ENV_ID, 2))), "VecNormalize lies inside .* put it around"),
    (
        lambda: small_sac(VecFrameStack(imagination_env(), 2)).learn(80, callback=small_callback()),
        r"VecFrameStack.* wrap ImaginationVecEnv.* FlattenObservation\(FrameStackObservation\(env, 4\)\)",
    ),
]


@pytest.mark.parametrize(("make", "message"), MISTAKES, ids=[message.split(" ")[0] for _, message in MISTAKES])
def test_a_mistake_gives_one_short_line(
    make: Callable[[], object], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zoo_sbx, "find_spec", lambda name: None)
    with pytest.raises((ValueError, TypeError, ImportError), match=message) as caught:
        make()
    assert len(str(caught.value)) < SHORT
    assert "\n" not in str(caught.value)


def test_frames_that_are_stacked_as_advised_are_learned_from() -> None:
    def stacked(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
        return HallucinationWrapper(FlattenObservation(FrameStackObservation(env, 4)), 12)

    venv = make_vec_env("Pendulum-v1", 2, wrapper_class=stacked, env_kwargs={"max_episode_steps": 20})
    small_sac(ImaginationVecEnv(venv)).learn(80, callback=small_callback(task="learned"))
