"""Defaults that come from the environment and from the data."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch as th
from stable_baselines3 import SAC, TD3
from stable_baselines3.common.vec_env import VecNormalize

from helpers import imagination_env, limits_of, small_callback, small_sac, small_world, state_of
from sb3_hucrl import Optimistic, Prediction, StartStates, TransitionDataset, Transitions
from sb3_hucrl.dynamics import Predictor
from sb3_hucrl.tasks import LearnedTask, PendulumTask


@pytest.mark.parametrize(("given", "expected"), [("auto", -1.0), (-0.5, -0.5), (-2.0, -2.0)])
def test_the_automatic_entropy_target_counts_real_dimensions(given: Any, expected: float) -> None:
    model = small_sac(imagination_env(max_episode_steps=20), target_entropy=given)
    model.learn(80, callback=small_callback())
    assert model.target_entropy == expected


def test_an_entropy_target_without_hallucination_stays() -> None:
    model = small_sac(imagination_env(max_episode_steps=20, hallucinate=False))
    model.learn(80, callback=small_callback(exploration="greedy"))
    assert model.target_entropy == -1.0


def test_an_algorithm_without_entropy_target_gets_none() -> None:
    model = TD3("MlpPolicy", imagination_env(max_episode_steps=20), device="cpu", buffer_size=100, batch_size=8)
    model.learn(80, callback=small_callback())
    assert not hasattr(model, "target_entropy")


def test_the_entropy_target_survives_saving(tmp_path: Any) -> None:
    model = small_sac(imagination_env(max_episode_steps=20)).learn(80, callback=small_callback())
    model.save(tmp_path / "model")
    assert SAC.load(tmp_path / "model", device="cpu").target_entropy == -1.0


class Drifting(Predictor):
    """Predicts that everything grows by 1, and knows nothing."""

    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        return Prediction(state + 1, th.ones_like(state), th.zeros_like(state))


def goals(task: LearnedTask) -> TransitionDataset:
    """Two episodes whose first dimension moves and whose second is a goal."""
    dataset = TransitionDataset(task.width, 1)
    for goal in (3.0, 5.0):
        states = th.tensor([[0.0, goal, 0.0, 0.0], [0.5, goal, 0.0, 0.0], [1.0, goal, 0.0, 0.0]])
        next_states = states.clone()
        next_states[:, 0] += 0.5
        ends = th.zeros(3, dtype=th.bool)
        dataset.append_episode(Transitions(states, th.zeros(3, 1), next_states, th.zeros(3), ends))
    return dataset


def test_what_never_changes_within_an_episode_is_carried_and_not_hallucinated() -> None:
    task = LearnedTask(2)
    dataset = goals(task)
    starts, limits = StartStates(dataset, task, {"inflated": 1.0}), limits_of(dataset, task)
    assert limits.constant is not None
    # Outcomes, here a reward and an end that never came, are no context.
    assert limits.constant.tolist() == [False, True, False, False]
    world = small_world(Drifting(4, 1), Optimistic(), task, 50, starts, limits=limits)
    trajectories = world.trajectories(64)
    first = trajectories.reset()
    assert set(np.unique(first[:, 1])) == {3.0, 5.0}
    assert len(np.unique(first[:, 0])) > 3
    step = trajectories.step(np.ones((64, 3), dtype=np.float32))
    np.testing.assert_array_equal(step.observations[:, 1], first[:, 1])
    # Further out, a step leads back into the plausible range.
    near = np.abs(first[:, 0]) < 9
    assert near.sum() > 32
    assert (step.observations[near, 0] > first[near, 0]).all()


def test_a_task_that_knows_its_state_moves_what_has_not_moved_yet() -> None:
    dataset = TransitionDataset(2, 1)
    states = th.tensor([[3.0, 0.0], [3.1, 0.0]])
    dataset.append_episode(
        Transitions(states, th.zeros(2, 1), states + th.tensor([0.1, 0.0]), th.zeros(2), th.zeros(2, dtype=th.bool))
    )
    assert limits_of(dataset, PendulumTask()).constant is None


def test_vec_normalize_goes_by_where_imagination_begins() -> None:
    env = VecNormalize(imagination_env(max_episode_steps=40))
    model = small_sac(env).learn(160, callback=small_callback(start_states={"visited": 1.0}))
    # The last search began after two of the three real episodes.
    states = state_of(model).dataset.transitions.states[:80]
    observed = PendulumTask().observe(states).double().numpy()
    moments = env.obs_rms
    assert not isinstance(moments, dict)
    np.testing.assert_allclose(moments.mean, observed.mean(axis=0), atol=0.1)
    np.testing.assert_allclose(moments.var, observed.var(axis=0), rtol=0.1)
