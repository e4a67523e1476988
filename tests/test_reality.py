"""The task is compared with the first real episodes; wrappers that change what it says are found out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from gymnasium.wrappers import (
    ClipAction,
    DelayObservation,
    NormalizeObservation,
    NormalizeReward,
    RescaleAction,
    TimeAwareObservation,
    TimeLimit,
    TransformObservation,
    TransformReward,
)
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env

from helpers import ENV_ID, small_callback, small_sac, state_of
from sb3_hucrl import HallucinationWrapper, ImaginationVecEnv, Task
from sb3_hucrl.logged import LoggedEpisode
from sb3_hucrl.loop import Loop, ModelSettings, Problem, RealSystems, Round, Settings
from sb3_hucrl.loop.reality import EPISODES, STEPS, Reality
from sb3_hucrl.tasks import GymnasiumPendulumTask, LearnedTask, MountainCarTask

Env = gym.Env[Any, Any]


def played(env: Env, task: Task | str | None = None, episodes: int = 1) -> Reality:
    """Compares random episodes of an environment with its task."""
    problem = Problem.from_env(env, ModelSettings(task=task))
    reality = Reality(problem)
    env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(episodes):
        Round(RealSystems([env]), problem, reality=reality).play(lambda *_: env.action_space.sample()[None])
    return reality


KNOWN = [
    *(f"HUCRL-{name}-v0" for name in ("Pendulum", "CartPole", "Reacher", "SparseReacher", "Pusher", "HalfCheetah")),
    *("Pendulum-v1", "MountainCarContinuous-v0", "InvertedPendulum-v5", "InvertedDoublePendulum-v5", "Reacher-v5"),
    *("Pusher-v5", "HalfCheetah-v5", "Swimmer-v5", "Hopper-v5", "Walker2d-v5", "Ant-v5"),
]


@pytest.mark.parametrize("env_id", KNOWN)
def test_every_registered_task_agrees_with_its_environment(env_id: str) -> None:
    for name in {env_id, "HUCRL-" + env_id.removeprefix("HUCRL-")}:
        played(gym.make(name, max_episode_steps=100), episodes=3)


def rescaled(env: Env, limit: float) -> Env:
    return RescaleAction(env, np.float32(-limit), np.float32(limit))


def push(env: Env) -> Env:
    return TransformReward(env, lambda reward: float(reward) + 0.01)


WRAPPED: list[tuple[str, Callable[[Env], Env], str]] = [
    (
        "Pendulum-v1",
        NormalizeReward,
        r"GymnasiumPendulumTask, whose reward is -[\d.]+ at step 1 of real .*NormalizeRew",
    ),
    ("Pendulum-v1", push, r"whose reward is .*TransformReward"),
    ("Pendulum-v1", lambda env: rescaled(env, 1), r"reward is .*environment: RescaleAction"),
    (
        "Pendulum-v1",
        NormalizeObservation,
        r"observe\(state\(observation\)\)\[\d\] is .*environment: NormalizeObservation",
    ),
    (
        "Pendulum-v1",
        lambda env: DelayObservation(env, 2),
        r"observe\(state\(observation\)\).*environment: Delay",
    ),
    (
        "MountainCarContinuous-v0",
        NormalizeObservation,
        r"whose terminated is True at .* gave False.*NormalizeObservation",
    ),
    ("HUCRL-Pendulum-v1", NormalizeReward, "reward is .*NormalizeReward"),
    ("Hopper-v5", NormalizeObservation, "terminated is .*NormalizeObservation"),
]


@pytest.mark.parametrize(("env_id", "wrap", "message"), WRAPPED)
def test_a_wrapper_that_changes_what_the_task_says_is_found_out(
    env_id: str, wrap: Callable[[Env], Env], message: str
) -> None:
    with pytest.raises(ValueError, match=message + r".*; take that away, correct .*task: learned"):
        played(wrap(gym.make(env_id)), episodes=5)


HARMLESS: list[tuple[str, Callable[[Env], Env], Task | str | None]] = [
    ("Pendulum-v1", lambda env: TimeLimit(env, 50), None),
    # The limits that it has anyway.
    ("MountainCarContinuous-v0", lambda env: rescaled(env, 1), None),
    # What is learned may be changed.
    ("Hopper-v5", NormalizeReward, None),
    ("Hopper-v5", lambda env: rescaled(env, 2), None),
    ("Pendulum-v1", NormalizeReward, "learned"),
    ("Pendulum-v1", NormalizeObservation, "learned"),
    ("Pendulum-v1", lambda env: rescaled(env, 1), "learned"),
]


@pytest.mark.parametrize(("env_id", "wrap", "task"), HARMLESS)
def test_a_wrapper_that_changes_nothing_of_what_is_known_is_accepted(
    env_id: str, wrap: Callable[[Env], Env], task: Task | str | None
) -> None:
    played(wrap(gym.make(env_id)), task, episodes=2)


def test_another_number_of_observed_values_is_refused_before_any_real_step() -> None:
    with pytest.raises(ValueError, match=r"Task.state failed .* changes the number of observed values"):
        Problem.from_env(TimeAwareObservation(gym.make("Pendulum-v1")), ModelSettings())


def test_late_rewards_are_found_out() -> None:
    class Late(gym.Wrapper[Any, Any, Any, Any]):
        owed = 0.0

        def step(self, action: Any) -> Any:
            observation, reward, *rest = self.env.step(action)
            paid, self.owed = self.owed, float(reward)
            return observation, paid, *rest

    with pytest.raises(ValueError, match=r"reward is -\S+ at step 1 of real episode 1, where the environment gave 0:"):
        played(Late(gym.make("Pendulum-v1")))


class Track(gym.Env[Any, Any]):
    """A point that moves towards a goal, which it also observes; an episode ends where it reaches 1."""

    observation_space = spaces.Box(-10.0, 10.0, (2,), np.float32)
    action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
    goal_speed = 0.0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self.x, self.goal = 0.0, float(self.np_random.uniform(-1, 1))
        return self._observation(), {}

    def step(self, action: Any) -> Any:
        self.x += 0.5 * float(action[0])
        self.goal += self.goal_speed
        return self._observation(), -abs(self.x - self.goal), self.x >= 1.0, False, {}

    def _observation(self) -> Any:
        return np.array([self.x, self.goal], dtype=np.float32)


class TrackTask(Task):
    state_dim, context_dim = 1, 1
    shift, end = 0.0, 1.0

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return self.shift - (next_state[:, 0] - next_state[:, 1]).abs()

    def terminated(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return next_state[:, 0] >= self.end


def changed(thing: Any, **attributes: object) -> Any:
    for name, value in attributes.items():
        setattr(thing, name, value)
    return thing


@pytest.mark.parametrize(
    ("env", "task", "message"),
    [
        ({"goal_speed": 0.1}, {}, r"context\[0\] is .* at step 1 of .*a goal, or .* that changes within an episode"),
        ({}, {"shift": 0.1}, r"TrackTask, whose reward is \S+ at step 1"),
        ({}, {"shift": float("nan")}, "TrackTask, whose reward is nan at step 1"),
        ({}, {"end": 2.0}, r"terminated is False .* gave True"),
        ({}, {"end": 0.5}, r"terminated is True .* gave False"),
    ],
)
def test_a_task_that_is_wrong_is_refused_with_step_and_values(
    env: dict[str, Any], task: dict[str, Any], message: str
) -> None:
    track = TimeLimit(changed(Track(), **env), 50)
    with pytest.raises(ValueError, match=message):
        played(track, changed(TrackTask(), **task), episodes=5)
    played(TimeLimit(Track(), 50), TrackTask(), episodes=5)


def test_single_precision_at_a_threshold_is_no_disagreement() -> None:
    class OnTheEdge(Track):
        """Its numbers are double: x is just below 1, and is observed as 1."""

        def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
            super().reset(seed=seed)
            self.x = 1.0 - 1e-9
            return self._observation(), {}

        def step(self, action: Any) -> Any:
            return self._observation(), -abs(self.x - self.goal), self.x >= 1.0, False, {}

    played(TimeLimit(OnTheEdge(), 10), TrackTask(), episodes=3)


def test_rewards_that_are_nearly_zero_are_no_disagreement() -> None:
    class Faint(Track):
        def step(self, action: Any) -> Any:
            observation, _, *rest = super().step(action)
            return observation, 1.4e-43, *rest

    class FaintTask(TrackTask):
        def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
            return th.full_like(next_state[:, 0], 1.5e-43)

    played(TimeLimit(Faint(), 20), FaintTask(), episodes=2)


def test_an_episode_that_hardly_costs_anything_is_no_disagreement() -> None:
    """The pendulum pays 0.1 * (exp(-cost) - 1): of a cost of 1e-5 single precision leaves three digits."""
    env = gym.make("HUCRL-Pendulum-v0", max_episode_steps=100)
    problem = Problem.from_env(env, ModelSettings())
    systems = RealSystems([env])

    def play(reality: Reality, low: float, high: float) -> th.Tensor:
        draw = np.random.default_rng(0)
        [episode] = Round(systems, problem, reality=reality).play(
            lambda *_: draw.uniform(low, high, (1, 3)).astype(np.float32)
        )
        return episode.rewards

    paid = play(Reality(problem), -1.0, 1.0)
    quiet = play(Reality(problem, lambda: paid), 0.1, 0.1005)
    assert float(quiet.abs().max()) < 1e-4


def test_what_was_logged_tells_how_small_a_first_real_episode_pays() -> None:
    env = gym.make("HUCRL-Pendulum-v0", max_episode_steps=100)
    problem = Problem.from_env(env, ModelSettings())
    draw = np.random.default_rng(0)
    observations, rewards, actions = [env.reset(seed=0)[0]], [], draw.uniform(-1, 1, (100, 1)).astype(np.float32)
    for action in actions:
        observation, reward, *_ = env.step(np.concatenate([action, np.zeros(2, np.float32)]))
        observations.append(observation)
        rewards.append(reward)
    loop = Loop(Settings(), problem, RealSystems([env]))
    loop.add_logged([LoggedEpisode(np.array(observations), actions, np.array(rewards, np.float32), False)])
    loop.play(lambda *_: draw.uniform(0.1, 0.1005, (1, 3)).astype(np.float32))
    assert loop.state.real_steps == 100


def test_what_has_agreed_for_long_is_not_compared_any_more() -> None:
    task = TrackTask()
    env = TimeLimit(Track(), 50)
    problem = Problem.from_env(env, ModelSettings(task=task))
    reality = Reality(problem)
    steps = rounds = 0
    while steps < STEPS or rounds < EPISODES:
        [episode] = Round(RealSystems([env]), problem, reality=reality).play(lambda *_: env.action_space.sample()[None])
        steps, rounds = steps + len(episode), rounds + 1
    task.shift = 1.0
    Round(RealSystems([env]), problem, reality=reality).play(lambda *_: env.action_space.sample()[None])


def test_what_was_learned_before_a_disagreement_stays_saved(tmp_path: Path) -> None:
    class PaysMoreLater(gym.Wrapper[Any, Any, Any, Any]):
        episodes = 0

        def reset(self, **kwargs: Any) -> Any:
            self.episodes += 1
            return self.env.reset(**kwargs)

        def step(self, action: Any) -> Any:
            observation, reward, *rest = self.env.step(action)
            # SB3 resets once before training begins.
            return observation, float(reward) + (self.episodes > 3), *rest

    env = ImaginationVecEnv(make_vec_env(lambda: PaysMoreLater(gym.make(ENV_ID, max_episode_steps=20)), 2))
    model, checkpoint = small_sac(env), tmp_path / "checkpoint.zip"
    with pytest.raises(ValueError, match=r"step 1 of real episode 3, .*PaysMoreLater.*task: learned with Halluc"):
        model.learn(320, callback=small_callback(initial_steps=20, checkpoint=str(checkpoint)))
    for each in (model, SAC.load(checkpoint, device="cpu")):
        assert state_of(each).real_episodes == 2
        assert len(state_of(each).dataset) == 40


def test_clip_action_around_limited_actions_is_accepted() -> None:
    env = HallucinationWrapper(TransformObservation(ClipAction(gym.make("Pendulum-v1")), lambda x: x, None))
    assert isinstance(env.action_space, spaces.Box)
    np.testing.assert_array_equal(env.action_space.high, [2.0, 1.0, 1.0])
    played(env, episodes=2)
    greedy = HallucinationWrapper(ClipAction(gym.make("MountainCarContinuous-v0")), 0)
    assert greedy.action_space == spaces.Box(-1.0, 1.0, (1,))


def test_an_environment_made_from_its_class_needs_a_time_limit_alone() -> None:
    pendulum = gym.make("Pendulum-v1").unwrapped
    env = ImaginationVecEnv(make_vec_env(lambda: HallucinationWrapper(TimeLimit(type(pendulum)(), 30)), 2))
    assert env.get_attr("spec") == [None, None]
    model = small_sac(env).learn(80, callback=small_callback())
    assert len(state_of(model).dataset) == 60
    known = ImaginationVecEnv(make_vec_env(lambda: HallucinationWrapper(TimeLimit(type(pendulum)(), 30), 2), 2))
    small_sac(known).learn(80, callback=small_callback(task=GymnasiumPendulumTask()))


def test_actions_beyond_their_limits_are_refused() -> None:
    env = gym.make("MountainCarContinuous-v0")
    problem = Problem.from_env(env, ModelSettings())
    assert isinstance(problem.task, MountainCarTask)
    for actions, message in (
        (np.full((1, 1), 1.5, np.float32), r"action of a real step is \[1.5\]: it must lie from \[-1.0\] to \[1.0\]"),
        (np.full((1, 1), np.nan, np.float32), r"is \[nan\].* lower the learning rate of the policy"),
        (np.zeros((1, 2), np.float32), r"the actions have shape \(1, 2\): .* need \(1, 1\)"),
        (np.zeros((2, 1), np.float32), r"the actions have shape \(2, 1\)"),
    ):
        with pytest.raises(ValueError, match=message):
            Round(RealSystems([env]), problem).play(lambda *_: actions)  # noqa: B023  # used within the iteration


def test_a_learned_task_checks_its_context() -> None:
    with pytest.raises(ValueError, match=r"LearnedTask, whose context\[0\] is"):
        played(TimeLimit(changed(Track(), goal_speed=0.1), 50), LearnedTask(2, context_dims=[1]))
