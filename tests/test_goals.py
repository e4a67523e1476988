"""Environments with goals, as gymnasium-robotics has them."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from gymnasium.wrappers import FlattenObservation
from stable_baselines3 import SAC, HerReplayBuffer
from stable_baselines3.common.env_util import make_vec_env

from helpers import small_callback, small_sac, state_of
from sb3_hucrl import HallucinationWrapper, ImaginationVecEnv
from sb3_hucrl.tasks import GoalTask, check_task, resolve_task

ENV_ID = "Slide-v0"
TASK = "sb3_hucrl.tasks.GoalTask"


class Slide(gym.Env[Any, np.ndarray]):
    """A puck in the plane, observed as (velocity, place), to be slid to the goal."""

    observation_space = spaces.Dict(
        {
            "observation": spaces.Box(-np.inf, np.inf, (4,), np.float64),
            "desired_goal": spaces.Box(-np.inf, np.inf, (2,), np.float64),
            "achieved_goal": spaces.Box(-np.inf, np.inf, (2,), np.float64),
        }
    )
    action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)

    def __init__(self, reward_type: str = "sparse") -> None:
        self.reward_type = reward_type

    def reset(self, *, seed: int | None = None, options: object = None) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        super().reset(seed=seed)
        self.place, self.velocity = np.zeros(2), np.zeros(2)
        self.goal = self.np_random.uniform(-0.2, 0.2, 2)
        return self.observation(), {}

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        self.velocity = 0.9 * self.velocity + 0.1 * action
        self.place = self.place + self.velocity
        distance = float(np.linalg.norm(self.place - self.goal))
        reward = -float(distance > 0.15) if self.reward_type == "sparse" else -distance
        return self.observation(), reward, False, False, {}

    def observation(self) -> dict[str, np.ndarray]:
        seen = np.concatenate([self.velocity, self.place])
        return {"observation": seen, "achieved_goal": self.place.copy(), "desired_goal": self.goal.copy()}


@pytest.fixture(autouse=True)
def _known_environment() -> None:
    if ENV_ID not in gym.registry:
        gym.register(ENV_ID, entry_point=lambda **kwargs: Slide(**kwargs), max_episode_steps=30)


def slides(hallucinated_dim: int | None, reward_type: str = "sparse") -> ImaginationVecEnv:
    def wrapped(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
        return HallucinationWrapper(FlattenObservation(env), hallucinated_dim)

    return ImaginationVecEnv(
        make_vec_env(ENV_ID, 4, seed=0, wrapper_class=wrapped, env_kwargs={"reward_type": reward_type})
    )


PART: dict[str, Any] = {"goal_dim": 2, "observation_dim": 4, "achieved_dims": [2, 3], "threshold": 0.15}
APART: dict[str, Any] = {"goal_dim": 2, "observation_dim": 4, "threshold": 0.15}


@pytest.mark.parametrize("sizes", [PART, APART])
@pytest.mark.parametrize("reward", ["sparse", "dense"])
def test_the_task_reads_and_pays_what_the_environment_does(sizes: dict[str, Any], reward: str) -> None:
    env = FlattenObservation(gym.make(ENV_ID, reward_type=reward))
    task = GoalTask(**sizes, reward=reward)
    check_task(task, observation_dim=8, action_dim=2)
    observation, _ = env.reset(seed=1)
    paid, earned = [], []
    for step in range(25):
        action = np.full(2, np.cos(step / 4), dtype=np.float32)
        following, real, *_ = env.step(action)
        states = [task.state(th.as_tensor(each[None], dtype=th.float32)) for each in (observation, following)]
        np.testing.assert_allclose(task.observe(states[1])[0], following, rtol=1e-6)
        paid.append(float(real))
        earned.append(float(task.reward(states[0], th.as_tensor(action[None]), states[1])))
        observation = following
    np.testing.assert_allclose(earned, paid, atol=1e-5)
    assert len(set(paid)) > 1


@pytest.mark.parametrize(("sizes", "room"), [(PART, 4), (APART, 6)])
def test_training_begins_with_what_hindsight_replay_has_logged(sizes: dict[str, Any], room: int) -> None:
    logger = SAC(
        "MultiInputPolicy",
        make_vec_env(ENV_ID, 2, seed=3, env_kwargs={"reward_type": "dense"}),
        replay_buffer_class=HerReplayBuffer,
        learning_starts=100,
        buffer_size=1_000,
        seed=0,
    ).learn(100)
    kwargs = {**sizes, "reward": "dense"}
    callback = small_callback(transitions=logger.replay_buffer, initial_steps=None, task=TASK, task_kwargs=kwargs)
    state = state_of(small_sac(slides(room, "dense")).learn(80, callback=callback))
    assert (state.dataset.logged_lengths, state.dataset.lengths) == ([30, 20] * 2, [30])
    buffer: Any = logger.replay_buffer
    logged = state.dataset.transitions[:100]
    for name, columns in (("desired_goal", slice(room, None)), ("observation", slice(room - 4, room))):
        expected = np.concatenate([buffer.observations[name][:50, env] for env in range(2)])
        np.testing.assert_allclose(logged.states[:, columns], expected, rtol=1e-6)
    np.testing.assert_allclose(logged.rewards, buffer.rewards[:50].T.reshape(-1), rtol=1e-6)


@pytest.mark.parametrize(("sizes", "room"), [(PART, 4), (APART, 6)])
def test_training_carries_the_goals_of_real_episodes(sizes: dict[str, Any], room: int) -> None:
    goals: list[np.ndarray] = []
    env = slides(room, "dense")
    step_wait = env.step_wait

    def spy() -> Any:
        results = step_wait()
        goals.append(np.asarray(results[0])[:, 2:4])
        return results

    env.step_wait = spy  # type: ignore[method-assign]  # to see what is imagined
    callback = small_callback(initial_episodes=3, task=TASK, task_kwargs={**sizes, "reward": "dense"})
    model = small_sac(env).learn(80, callback=callback)
    state = state_of(model)
    assert state.real_episodes == 4
    assert state.dynamics.state_dim == room
    met = state.dataset.initial_states[:, room:].numpy()
    imagined = np.unique(np.concatenate(goals), axis=0)
    assert len(imagined) == 3
    assert all((goal == met).all(axis=1).any() for goal in imagined.astype(np.float32))


def test_the_room_for_hallucination_is_said() -> None:
    with pytest.raises(ValueError, match=r"on GoalTask needs 4 hallucinated ones \(its 2 columns of context"):
        small_sac(slides(None)).learn(80, callback=small_callback(task=TASK, task_kwargs=PART))


def test_a_dictionary_is_refused_with_advice() -> None:
    with pytest.raises(ValueError, match=r"FlattenObservation.* give task='sb3_hucrl.tasks.GoalTask'"):
        HallucinationWrapper(gym.make(ENV_ID))


def near(achieved: th.Tensor, desired: th.Tensor) -> th.Tensor:
    """A reward of one's own."""
    return (-(achieved - desired).square().sum(dim=1)).exp()


def test_a_reward_of_ones_own_is_a_function_or_the_place_of_one() -> None:
    state = th.tensor([[0.0, 0.0, 1.0, 2.0, 1.0, 2.0], [0.0, 0.0, 1.0, 2.0, 1.0, 3.0]])
    for reward in (near, "test_goals.near"):
        task = resolve_task(TASK, {**PART, "reward": reward}, None, 8)
        th.testing.assert_close(task.reward(state, state, state), th.tensor([0.0, -1.0]).exp())


def test_an_episode_may_end_at_the_goal() -> None:
    state = th.tensor([[0.0, 0.0, 1.0, 2.0, 1.1, 2.0], [0.0, 0.0, 1.0, 2.0, 1.2, 2.0]])
    assert GoalTask(**PART, terminates=True).terminated(state, state, state).tolist() == [True, False]
    assert GoalTask(**PART).terminated(state, state, state).tolist() == [False, False]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"achieved_dims": [0]}, r"achieved_dims is \[0\]: give 2 indices \(goal_dim\) from 0 to 3"),
        ({"achieved_dims": [2, 4]}, "give 2 indices"),
        ({"reward": "nowhere.reward"}, "reward 'nowhere.reward' cannot be imported .* 'sparse', 'dense', or module.f"),
    ],
)
def test_wrong_settings_say_what_to_do(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        GoalTask(**{**PART, **wrong})


def test_sizes_that_are_not_those_of_the_environment_are_refused() -> None:
    with pytest.raises(ValueError, match=r"GoalTask.state gave shape \(2, 6\) for 2 rows, expected \(2, 7\)"):
        small_sac(slides(4)).learn(
            80, callback=small_callback(task=TASK, task_kwargs={**PART, "goal_dim": 2, "observation_dim": 5})
        )
