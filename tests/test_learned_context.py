"""Observed values that never change within an episode, where the task is learned."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from stable_baselines3.common.env_util import make_vec_env

from helpers import small_callback, small_sac, state_of
from sb3_hucrl import HallucinationWrapper, ImaginationVecEnv
from sb3_hucrl.tasks import LearnedReward, LearnedTask, check_task

ENV_ID = "Docking-v0"


class Docking(gym.Env[np.ndarray, np.ndarray]):
    """Observation: goal, place, speed. The goal, which changes from episode to episode, comes first."""

    observation_space = spaces.Box(-np.inf, np.inf, (3,), np.float32)
    action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed: int | None = None, options: object = None) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        self.goal, self.place, self.speed = self.np_random.uniform(-1, 1), 0.0, 0.0
        return self.observation(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        self.speed += 0.1 * float(action[0])
        self.place += 0.1 * self.speed
        return self.observation(), -abs(self.place - self.goal), False, False, {}

    def observation(self) -> np.ndarray:
        return np.array([self.goal, self.place, self.speed], dtype=np.float32)


@pytest.fixture(autouse=True)
def _known_environment() -> None:
    if ENV_ID not in gym.registry:
        gym.register(ENV_ID, entry_point=lambda **kwargs: Docking(**kwargs), max_episode_steps=30)


def docks(hallucinated_dim: int) -> ImaginationVecEnv:
    wrapper = {"hallucinated_dim": hallucinated_dim}
    return ImaginationVecEnv(make_vec_env(ENV_ID, 4, 0, wrapper_class=HallucinationWrapper, wrapper_kwargs=wrapper))


@pytest.mark.parametrize("task_class", [LearnedReward, LearnedTask])
@pytest.mark.parametrize("context_dims", [(), (0,), (3, 1)])
def test_context_follows_the_outcomes_and_is_observed_where_it_was(
    task_class: type[LearnedReward], context_dims: tuple[int, ...]
) -> None:
    task = task_class(5, context_dims=context_dims)
    check_task(task, observation_dim=5, action_dim=1)
    observation = th.arange(10.0).reshape(2, 5)
    state = task.state(observation)
    predicted = [dim for dim in range(5) if dim not in context_dims]
    assert task.hallucinated_dim == len(predicted)
    th.testing.assert_close(state[:, : len(predicted)], observation[:, predicted])
    assert bool((state[:, len(predicted) : task.state_dim] == 0).all())
    th.testing.assert_close(state[:, task.state_dim :], observation[:, list(context_dims)])
    th.testing.assert_close(task.observe(state), observation)


def test_outcomes_are_recorded_before_the_context() -> None:
    task = LearnedTask(3, hallucinate_reward=True, context_dims=[0])
    assert (task.state_dim, task.context_dim, task.hallucinated_dim) == (4, 1, 3)
    states = task.state(th.tensor([[7.0, 1.0, 2.0], [7.0, 3.0, 4.0]]))
    recorded = task.record_outcomes(states, th.tensor([-5.0, -6.0]), th.tensor([False, True]))
    assert recorded.tolist() == [[1, 2, -5, 0, 7], [3, 4, -6, 1, 7]]
    assert task.reward(states, states, recorded).tolist() == [-5, -6]
    assert task.terminated(states, states, recorded).tolist() == [False, True]
    unlikely = recorded.clone()
    unlikely[:, 3] = 0.3
    assert task.sample_outcomes(unlikely, None).tolist() == [[1, 2, -5, 0, 7], [3, 4, -6, 0, 7]]


@pytest.mark.parametrize("dims", [[3], [0, 0], [0, 1, 2]])
def test_context_must_be_some_of_the_observed_values(dims: list[int]) -> None:
    with pytest.raises(ValueError, match="give different indices from 0 to 2, and leave at least one of the 3"):
        LearnedTask(3, context_dims=dims)


def test_a_goal_is_carried_along_and_not_hallucinated() -> None:
    goals: list[np.ndarray] = []
    env = docks(2)
    callback = small_callback(initial_episodes=3, task="learned", task_kwargs={"context_dims": [0]})
    step_wait = env.step_wait

    def spy() -> Any:
        results = step_wait()
        if env.trajectories is not None:
            goals.append(np.asarray(results[0])[:, 0])
        return results

    env.step_wait = spy  # type: ignore[method-assign]  # to see what is imagined
    model = small_sac(env).learn(80, callback=callback)
    state = state_of(model)
    assert state.dynamics.state_dim == 4
    met = state.dataset.transitions.states[:, 4].unique()
    assert len(met) == 4
    # Imagination knows the goals of the three episodes before it, as they were.
    assert len(np.unique(goals)) == 3
    assert np.isin(np.unique(goals), met.numpy()).all()


def test_room_for_context_is_one_dimension_too_many() -> None:
    callback = small_callback(task="learned", task_kwargs={"context_dims": [0]})
    with pytest.raises(ValueError, match=r"needs 2 hallucinated ones \(its 1 columns of context are not hallucinated"):
        small_sac(docks(3)).learn(80, callback=callback)
