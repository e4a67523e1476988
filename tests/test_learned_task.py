"""Learned rewards and terminations, and constant context, in imagination."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from stable_baselines3.common.env_util import make_vec_env

from helpers import limits_of, small_callback, small_sac, small_world
from sb3_hucrl import (
    Greedy,
    HallucinationWrapper,
    HUCRLState,
    ImaginationVecEnv,
    Optimistic,
    Prediction,
    ProbabilisticEnsemble,
    StartStates,
    TransitionDataset,
    Transitions,
)
from sb3_hucrl.dynamics.base import Predictor
from sb3_hucrl.imagination import Trajectories
from sb3_hucrl.tasks import GymnasiumPendulumTask, LearnedReward, LearnedTask, ReacherTask, Task


class Recorder(Predictor):
    """
    Adds the action to the first dimension and predicts the given outcomes, whatever the state.

    :param outcomes: predicted for the last dimensions
    """

    def __init__(self, state_dim: int, action_dim: int = 1, outcomes: tuple[float, ...] = (), std: float = 0.0) -> None:
        super().__init__(state_dim, action_dim)
        self.outcomes, self.std = outcomes, std
        self.seen: list[th.Tensor] = []

    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        self.seen.append(state.clone())
        mean = state.clone()
        mean[:, 0] += action[:, 0]
        if self.outcomes:
            mean[:, -len(self.outcomes) :] = th.tensor(self.outcomes)
        return Prediction(mean, th.full_like(mean, self.std), th.zeros_like(mean))


def starts_at(state: list[float], task: Task) -> StartStates:
    dataset = TransitionDataset(task.width, 1)
    states = th.tensor([state])
    dataset.append_episode(Transitions(states, th.zeros(1, 1), states, th.zeros(1), th.zeros(1, dtype=th.bool)))
    return StartStates(dataset, task, {"initial": 1.0})


def imagine(
    task: Task, model: Predictor, strategy: Greedy | Optimistic, start: list[float], num_envs: int = 2
) -> Trajectories:
    return small_world(model, strategy, task, 10, starts_at(start, task)).trajectories(num_envs)


def test_outcomes_are_given_out_and_forgotten() -> None:
    task = LearnedTask(2)
    model = Recorder(4, outcomes=(7.0, 0.0))
    imagination = imagine(task, model, Greedy(), [1.0, 2.0, 0.0, 0.0])
    imagination.reset()
    for step in range(1, 4):
        outcome = imagination.step(np.full((2, 1), 0.5, dtype=np.float32))
        np.testing.assert_allclose(outcome.rewards, 7.0)
        np.testing.assert_allclose(outcome.observations, [[1.0 + 0.5 * step, 2.0]] * 2)
        assert not outcome.terminated.any()
    assert all(bool((state[:, 2:] == 0).all()) for state in model.seen)
    np.testing.assert_allclose(imagination.returns, 21.0)


@pytest.mark.parametrize(("predicted", "expected"), [(-0.1, 0.0), (0.01, 0.0), (0.3, 0.3), (1.1, 1.0)])
def test_imagined_trajectories_end_with_the_predicted_probability(predicted: float, expected: float) -> None:
    task = LearnedTask(2)
    imagination = imagine(task, Recorder(4, outcomes=(0.0, predicted)), Greedy(), [0.0] * 4, num_envs=4_000)
    imagination.reset()
    ended = imagination.step(np.zeros((4_000, 1), dtype=np.float32)).terminated
    # The standard error is 0.007.
    np.testing.assert_allclose(ended.mean(), expected, atol=0.03 * (0 < expected < 1))


def test_a_reward_is_not_imagined_far_from_those_that_were_paid() -> None:
    task = LearnedReward(1)
    dataset = TransitionDataset(task.width, 1)
    states = th.zeros(2, 2)
    next_states, paid = th.tensor([[1.0, -3.0], [2.0, -5.0]]), th.tensor([-3.0, -5.0])
    dataset.append_episode(Transitions(states, th.zeros(2, 1), next_states, paid, th.zeros(2, dtype=th.bool)))
    for predicted, expected in ((100.0, 5.0), (-4.0, -4.0), (-100.0, -10.0)):
        starts = StartStates(dataset, task, {"initial": 1.0})
        model, limits = Recorder(2, outcomes=(predicted,)), limits_of(dataset, task)
        imagination = small_world(model, Greedy(), task, 10, starts, limits=limits).trajectories(2)
        imagination.reset()
        np.testing.assert_allclose(imagination.step(np.zeros((2, 1), dtype=np.float32)).rewards, expected)


@pytest.mark.parametrize("hallucinate_reward", [False, True])
def test_outcomes_that_never_differed_are_imagined_so_unless_they_are_steered(hallucinate_reward: bool) -> None:
    task = LearnedTask(1, hallucinate_reward)
    dataset = TransitionDataset(task.width, 1)
    states, next_states = th.zeros(2, 3), th.tensor([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    dataset.append_episode(Transitions(states, th.zeros(2, 1), next_states, th.zeros(2), th.zeros(2, dtype=th.bool)))
    limits = limits_of(dataset, task)
    predicted = th.tensor([[1.5, 4.0, 0.9]])
    expected = [[1.5, 4.0 if hallucinate_reward else 0.0, 0.0]]
    assert limits.apply(states[:1], predicted).tolist() == expected


@pytest.mark.parametrize("hallucinate_reward", [False, True])
def test_reward_is_steered_only_on_request(hallucinate_reward: bool) -> None:
    task = LearnedReward(2, hallucinate_reward)
    imagination = imagine(task, Recorder(3, outcomes=(1.0,), std=0.1), Optimistic(beta=2.0), [0.0] * 3)
    imagination.reset()
    actions = np.ones((2, 1 + task.hallucinated_dim), dtype=np.float32)
    outcome = imagination.step(actions)
    np.testing.assert_allclose(outcome.observations, [[1.2, 0.2]] * 2, rtol=1e-6)
    np.testing.assert_allclose(outcome.rewards, 1.2 if hallucinate_reward else 1.0, rtol=1e-6)
    # The model never saw a state that held a reward before the step.
    np.testing.assert_array_equal(imagination.states[:, 2], 0.0)


def test_context_reaches_the_policy_and_the_reward_but_not_the_model() -> None:
    task = ReacherTask(action_penalty=0.0)
    model = Recorder(14, action_dim=7)
    dataset = TransitionDataset(task.width, 7)
    states = th.zeros(1, 17)
    dataset.append_episode(Transitions(states, th.zeros(1, 7), states, th.zeros(1), th.zeros(1, dtype=th.bool)))
    imagination = small_world(model, task=task, horizon=10, starts=StartStates(dataset, task)).trajectories(6)
    goals = imagination.reset()[:, -3:]
    # The dataset holds only one goal; the others are drawn from the environment's distribution.
    assert len(np.unique(goals, axis=0)) == 6
    for _ in range(3):
        outcome = imagination.step(np.ones((6, 21), dtype=np.float32))
        np.testing.assert_array_equal(outcome.observations[:, -3:], goals)
    assert all(state.shape == (6, 14) for state in model.seen)
    state = task.state(th.as_tensor(outcome.observations))
    np.testing.assert_allclose(outcome.rewards, -task.squared_distance(state), rtol=1e-4)


def pendulum_episodes(task: Task, steps: int) -> TransitionDataset:
    """Random transitions of gymnasium's pendulum over its whole state space."""
    known, rng = GymnasiumPendulumTask(), np.random.default_rng(0)
    env = gym.make("Pendulum-v1").unwrapped
    env.reset(seed=0)
    observations, actions, following, rewards = [], [], [], []
    for _ in range(steps):
        vars(env)["state"] = np.array([rng.uniform(-np.pi, np.pi), rng.uniform(-8, 8)])
        state = th.as_tensor(vars(env)["state"], dtype=th.float32)[None]
        action = rng.uniform(-2, 2, 1).astype(np.float32)
        observation, reward, *_ = env.step(action)
        observations.append(known.observe(state)[0])
        actions.append(action)
        following.append(observation)
        rewards.append(float(reward))
    paid, ends = th.tensor(rewards), th.zeros(steps, dtype=th.bool)
    next_states = task.record_outcomes(task.state(th.as_tensor(np.stack(following))), paid, ends)
    dataset = TransitionDataset(task.width, 1)
    episode = Transitions(task.state(th.stack(observations)), th.as_tensor(np.stack(actions)), next_states, paid, ends)
    dataset.append_episode(episode)
    return dataset


def test_the_ensemble_learns_the_reward_with_an_uncertainty() -> None:
    task = LearnedTask(3)
    dataset = pendulum_episodes(task, 1_500)
    generator = th.Generator().manual_seed(0)
    model = ProbabilisticEnsemble(task.state_dim, 1, task.angle_dims, generator=generator)
    model.fit(dataset, generator)
    unseen = dataset.holdout
    with th.no_grad():
        prediction = model.predict(unseen.states, unseen.actions)
    error = unseen.rewards - prediction.mean[:, 3]
    assert float(error.square().mean() / unseen.rewards.var()) < 0.01
    assert bool((prediction.epistemic_std[:, 3] > 0).all())
    # No real episode terminated, so no imagined trajectory does.
    assert float(prediction.mean[:, 4].abs().max()) < 0.1


class PointMass(gym.Env[np.ndarray, np.ndarray]):
    """An unregistered environment: a point on a line that is rewarded near 0 and terminates at ±2."""

    def __init__(self, dtype: Any = np.float32) -> None:
        self.observation_space = spaces.Box(-10.0, 10.0, (1,), dtype)
        self.action_space = spaces.Box(-1.0, 1.0, (1,), dtype)

    def reset(self, *, seed: int | None = None, options: object = None) -> tuple[np.ndarray, dict[str, object]]:
        super().reset(seed=seed)
        self.x = self.np_random.uniform(-1, 1)
        return np.array([self.x], dtype=np.float32), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, object]]:
        self.x += 0.5 * float(action[0])
        return np.array([self.x], dtype=np.float32), -abs(self.x), abs(self.x) > 2, False, {}


def imagination_of(env_id: str, hallucinated_dim: int | None = None) -> ImaginationVecEnv:
    wrapper_kwargs = {"hallucinated_dim": hallucinated_dim}
    venv = make_vec_env(env_id, 4, seed=0, wrapper_class=HallucinationWrapper, wrapper_kwargs=wrapper_kwargs)
    return ImaginationVecEnv(venv)


@pytest.mark.parametrize("hallucinate_reward", [False, True])
def test_an_unregistered_environment_runs_with_learned_reward_and_termination(
    hallucinate_reward: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    if "PointMass-v0" not in gym.registry:
        gym.register("PointMass-v0", entry_point=lambda **kwargs: PointMass(**kwargs), max_episode_steps=40)
    model = small_sac(imagination_of("PointMass-v0", 1 + int(hallucinate_reward)), verbose=1)
    settings = {"task": "learned", "task_kwargs": {"hallucinate_reward": True}} if hallucinate_reward else {}
    model.learn(160, callback=small_callback(initial_episodes=5, **settings))
    state = vars(model)["hucrl"]
    assert isinstance(state, HUCRLState)
    assert state.real_episodes == 7
    assert "the dynamics model learns the reward, too" in capsys.readouterr().out
    transitions = state.dataset.transitions
    np.testing.assert_allclose(transitions.next_states[:, 1], transitions.rewards)
    np.testing.assert_array_equal(transitions.next_states[:, 2] > 0.5, transitions.terminated)
    assert bool(transitions.terminated.any())


def test_double_precision_is_welcome() -> None:
    # As dm_control gives and takes everything.
    if "DoublePointMass-v0" not in gym.registry:
        gym.register(
            "DoublePointMass-v0", entry_point=lambda **kwargs: PointMass(np.float64, **kwargs), max_episode_steps=40
        )
    model = small_sac(imagination_of("DoublePointMass-v0"))
    model.learn(80, callback=small_callback(initial_episodes=2))
    state = vars(model)["hucrl"]
    assert isinstance(state, HUCRLState)
    assert state.real_episodes == 3
    assert state.dataset.transitions.actions.dtype == th.float32


def test_learning_a_known_task_says_how_much_room_it_needs() -> None:
    # The known task's state is an angle and a speed; to learn it, all three observed values are hallucinated.
    settings = {"task": "learned", "initial_episodes": 1}
    with pytest.raises(ValueError, match=r"HallucinationWrapper\(env, hallucinated_dim=3\)"):
        small_sac(imagination_of("Pendulum-v1")).learn(80, callback=small_callback(**settings))
    model = small_sac(imagination_of("Pendulum-v1", 3)).learn(80, callback=small_callback(**settings))
    assert isinstance(vars(model)["hucrl"], HUCRLState)
