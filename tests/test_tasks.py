"""Every registered task against the reward, termination and observation of its environment."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th

from sb3_hucrl import Task, register_task
from sb3_hucrl.tasks import (
    CartPoleTask,
    GymnasiumPendulumTask,
    HalfCheetahTask,
    LearnedReward,
    LearnedTask,
    MountainCarTask,
    PendulumTask,
    PusherTask,
    ReacherTask,
    SparseReacherTask,
    check_task,
    find_task,
    resolve_task,
)

OURS = ["Pendulum", "CartPole", "Reacher", "SparseReacher", "Pusher", "HalfCheetah"]
KNOWN_REWARD: list[tuple[str, dict[str, Any]]] = [
    *((f"HUCRL-{name}-v0", {"action_penalty": penalty}) for name in OURS for penalty in (0.0, 0.3)),
    ("HUCRL-SparseReacher-v0", {"action_scale": 0.01}),
    ("Pendulum-v1", {}),
    ("MountainCarContinuous-v0", {}),
    ("InvertedPendulum-v5", {}),
    ("Reacher-v5", {}),
    ("Reacher-v5", {"reward_dist_weight": 2.0, "reward_control_weight": 0.5}),
    ("Pusher-v5", {}),
    ("Pusher-v5", {"reward_near_weight": 2.0, "reward_dist_weight": 0.2, "reward_control_weight": 1.0}),
]
LEARNED_REWARD: list[tuple[str, dict[str, Any]]] = [
    ("HalfCheetah-v5", {}),
    ("Swimmer-v5", {}),
    ("Hopper-v5", {}),
    ("Hopper-v5", {"healthy_angle_range": (-0.05, 0.1)}),
    ("Walker2d-v5", {}),
    ("Walker2d-v5", {"terminate_when_unhealthy": False}),
    ("Ant-v5", {}),
    ("Ant-v5", {"include_cfrc_ext_in_observation": False}),
]


@dataclass
class Play:
    """Real transitions under random actions, and the environment's task."""

    task: Task
    states: th.Tensor
    actions: th.Tensor
    next_states: th.Tensor
    rewards: th.Tensor
    terminated: th.Tensor
    observations: th.Tensor


def play(env_id: str, kwargs: dict[str, Any], steps: int = 1_000) -> Play:
    ours = {"hallucinate": False} if env_id.startswith("HUCRL-") else {}
    env = gym.make(env_id, **ours, **kwargs)
    observation, _ = env.reset(seed=0)
    env.action_space.seed(0)
    task = find_task(env.spec, len(observation))
    assert task is not None
    columns: list[list[Any]] = [[], [], [], [], []]
    while len(columns[0]) < steps:
        # Large and small actions, because some rewards vary only near zero.
        action = env.action_space.sample() * (0.1 if len(columns[0]) % 2 else 1.0)
        following, reward, terminated, truncated, _ = env.step(action.astype(np.float32))
        for column, value in zip(columns, (observation, action, following, reward, terminated), strict=True):
            column.append(value)
        observation = env.reset()[0] if terminated or truncated else following
    env.close()
    before, actions, after, rewards, ends = (np.asarray(column) for column in columns)
    seen = th.as_tensor(before, dtype=th.float64)
    return Play(
        task=task,
        states=task.state(seen),
        actions=th.as_tensor(actions, dtype=th.float64),
        next_states=task.state(th.as_tensor(after, dtype=th.float64)),
        rewards=th.as_tensor(rewards, dtype=th.float64),
        terminated=th.as_tensor(ends),
        observations=seen,
    )


def label(case: tuple[str, dict[str, Any]]) -> str:
    return "-".join([case[0], *case[1]])


@pytest.mark.parametrize("case", KNOWN_REWARD, ids=label)
def test_task_repeats_the_environment(case: tuple[str, dict[str, Any]]) -> None:
    played = play(*case)
    task, arguments = played.task, (played.states, played.actions, played.next_states)
    assert played.states.shape == (1_000, task.width)
    th.testing.assert_close(task.reward(*arguments).double(), played.rewards, atol=1e-5, rtol=0)
    assert bool((task.terminated(*arguments) == played.terminated).all())
    # The hand of Pusher-v5 lags behind its angles, except in an episode's first observation.
    th.testing.assert_close(task.observe(played.states), played.observations, atol=1e-4, rtol=0)
    th.testing.assert_close(task.state(task.observe(played.states)), played.states, atol=1e-9, rtol=0)
    # Imagination uses single precision.
    single = task.reward(*(argument.float() for argument in arguments))
    th.testing.assert_close(single.double(), played.rewards, atol=1e-3, rtol=1e-5)


@pytest.mark.parametrize("case", LEARNED_REWARD, ids=label)
def test_walker_repeats_the_termination_and_learns_the_reward(case: tuple[str, dict[str, Any]]) -> None:
    played = play(*case)
    task = played.task
    assert isinstance(task, LearnedReward)
    assert bool((task.terminated(played.states, played.actions, played.next_states) == played.terminated).all())
    assert task.hallucinated_dim == played.observations.shape[1]
    recorded = task.record_outcomes(played.next_states, played.rewards, played.terminated)
    th.testing.assert_close(task.reward(played.states, played.actions, recorded), played.rewards)
    th.testing.assert_close(task.observe(played.states), played.observations)


@pytest.mark.parametrize("env_id", ["HUCRL-Reacher-v0", "HUCRL-Pusher-v0", "Reacher-v5", "Pusher-v5"])
def test_context_is_constant_through_an_episode_and_not_hallucinated(env_id: str) -> None:
    env = gym.make(env_id)
    task = find_task(env.spec, 0)
    assert task is not None
    assert task.hallucinated_dim == task.state_dim == task.width - task.context_dim
    observation, _ = env.reset(seed=0)
    contexts = []
    for _ in range(20):
        state = task.state(th.as_tensor(observation, dtype=th.float64)[None])
        contexts.append(state[0, task.state_dim :])
        observation, *_ = env.step(env.action_space.sample())
    assert all(th.equal(context, contexts[0]) for context in contexts)


@pytest.mark.parametrize("env_id", ["HUCRL-Reacher-v0", "Reacher-v5"])
def test_sampled_goals_are_distributed_as_the_real_ones(env_id: str) -> None:
    env = gym.make(env_id)
    task = find_task(env.spec, 0)
    assert task is not None
    resets = [env.reset(seed=seed)[0] for seed in range(500)]
    real = task.state(th.as_tensor(np.stack(resets), dtype=th.float32))[:, task.state_dim :]
    sampled = task.sample_contexts(500, th.Generator().manual_seed(0))
    assert sampled is not None
    # Five standard errors of a mean over 500, and 20 % of the spread.
    spread = real.std(dim=0)
    assert bool(((real.mean(dim=0) - sampled.mean(dim=0)).abs() < 5 * spread * (2 / 500) ** 0.5).all())
    th.testing.assert_close(sampled.std(dim=0), spread, rtol=0.2, atol=0)


@pytest.mark.parametrize(
    ("formula", "arguments", "expected"),
    [
        (PendulumTask(0.5).reward_formula, (1.0, 0.0, 0.0), 1.0),
        (PendulumTask(0.5).reward_formula, (0.85, -1.0, 0.2), 0.1 * 0.1 + 0.5 * (0.1 - 1)),
        (CartPoleTask(0.5).reward_formula, (0.36, 3.0), math.exp(-1) - 1.5),
        (ReacherTask(0.5).reward_formula, (0.2, 3.0), -0.2 - 1.5),
        (SparseReacherTask(0.5, 2.0).reward_formula, (0.2025, 3.0), math.exp(-1) + 0.5 * (math.exp(-6) - 1)),
        (PusherTask(0.5).reward_formula, (2.0, 4.0, 3.0), -1.0 - 5.0 - 1.5),
        (HalfCheetahTask(0.5).reward_formula, (-12.0, 3.0), -12.0 - 1.5),
        (HalfCheetahTask(0.5).reward_formula, (12.0, 3.0), 10.0 - 1.5),
    ],
)
def test_the_shared_formula_is_the_papers_for_floats_and_tensors(
    formula: Callable[..., Any], arguments: tuple[float, ...], expected: float
) -> None:
    assert formula(*arguments) == pytest.approx(expected, abs=1e-12)
    rows = [th.tensor([argument, argument], dtype=th.float64) for argument in arguments]
    th.testing.assert_close(formula(*rows), th.tensor([expected, expected], dtype=th.float64))


def test_registry_hands_over_the_environments_kwargs() -> None:
    task = find_task(gym.make("HUCRL-Pendulum-v0", action_penalty=0.7).spec, 3)
    assert isinstance(task, PendulumTask)
    assert task.action_penalty == 0.7
    assert find_task(None, 3) is None
    assert find_task(gym.make("CartPole-v1").spec, 4) is None


def test_a_users_own_task_is_found_by_its_id() -> None:
    register_task("MountainCarContinuous-v0", lambda kwargs, observation_dim: LearnedTask(observation_dim))
    try:
        assert isinstance(find_task(gym.make("MountainCarContinuous-v0").spec, 2), LearnedTask)
    finally:
        register_task("MountainCarContinuous-v0", lambda kwargs, observation_dim: MountainCarTask())


def test_a_walker_that_shows_its_place_is_learned_as_a_whole() -> None:
    env = gym.make("Hopper-v5", exclude_current_positions_from_observation=False)
    assert isinstance(find_task(env.spec, 12), LearnedTask)


def test_arguments_of_no_named_task_are_refused() -> None:
    for task in (None, PendulumTask()):
        with pytest.raises(ValueError, match=r"task_kwargs is \{'action_penalty': 1\}: give the task by name as well"):
            resolve_task(task, {"action_penalty": 1}, None, 3)


def test_a_wrong_argument_of_a_named_task_is_named() -> None:
    for task, argument in (("sb3_hucrl.tasks.PendulumTask", "action_penalt"), ("learned", "hallucinate_rewrd")):
        with pytest.raises(ValueError, match=rf"task_kwargs\.{argument} is no argument .*did you mean"):
            resolve_task(task, {argument: 1}, None, 3)
    with pytest.raises(ValueError, match=r"task_kwargs\.action_penalty is -1: give a finite number of at least 0"):
        resolve_task("sb3_hucrl.tasks.PendulumTask", {"action_penalty": -1}, None, 3)


def test_task_is_given_by_name_learned_or_imported() -> None:
    spec = gym.make("Pendulum-v1").spec
    learned = resolve_task("learned", {"hallucinate_reward": True}, spec, 3)
    assert isinstance(learned, LearnedTask)
    assert (learned.state_dim, learned.hallucinated_dim) == (5, 4)
    imported = resolve_task("sb3_hucrl.tasks.PendulumTask", {"action_penalty": 0.4}, spec, 3)
    assert isinstance(imported, PendulumTask)
    assert imported.action_penalty == 0.4
    assert isinstance(resolve_task(None, {}, None, 6), LearnedTask)


@pytest.mark.parametrize(
    ("task", "message"),
    [
        ("nowhere.MyTask", "task 'nowhere.MyTask' cannot be imported .* 'learned', or module.Class"),
        ("sb3_hucrl.tasks.Missing", "cannot be imported"),
        ("collections.Counter", "is a Counter: it must be a subclass of sb3_hucrl.tasks.Task"),
        ("sb3_hucrl.tasks.resolve_task", "is a function: it must be a subclass"),
    ],
)
def test_a_wrong_task_says_what_to_do(task: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        resolve_task(task, {}, None, 3)


def test_what_is_no_task_is_not_called(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"task 'os\.mkdir' is a builtin_function_or_method: it must be a subclass"):
        resolve_task("os.mkdir", {"path": str(tmp_path / "made")}, None, 3)
    assert not list(tmp_path.iterdir())


class Lamp(Task):
    """A task with two observed values, whose methods and attributes can be replaced by wrong ones."""

    state_dim = 2

    def __init__(self, **wrong: object) -> None:
        for name, value in wrong.items():
            setattr(self, name, value)

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return next_state[:, 0]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"state_dim": 3},
            r"Lamp.state gave shape \(2, 2\) for 2 rows, expected \(2, 3\): state_dim \+ context_dim",
        ),
        ({"context_dim": 1}, r"Lamp.state gave shape \(2, 2\) for 2 rows, expected \(2, 3\)"),
        ({"angle_dims": (0, 2)}, r"Lamp.angle_dims \[2\] lie outside its 2 state dimensions"),
        (
            {"reward": lambda s, a, n: n[:, :1]},
            r"Lamp.reward gave shape \(2, 1\) .* expected \(2,\): one number per row",
        ),
        ({"observe": lambda s: s[:, :1]}, r"Lamp.observe gave shape \(2, 1\) .* the environment's observation"),
        ({"terminated": lambda s, a, n: n[:, 0]}, r"Lamp.terminated gave torch.float32: it must give torch.bool"),
        (
            {"exploratory_states": lambda n, generator: th.zeros(n, 1)},
            r"Lamp.exploratory_states gave shape \(2, 1\)",
        ),
        ({"sample_contexts": lambda n, generator: th.zeros(n, 1)}, r"Lamp.sample_contexts gave shape \(2, 1\)"),
    ],
)
def test_a_task_whose_shapes_do_not_fit_is_refused(wrong: dict[str, Any], message: str) -> None:
    check_task(Lamp(), observation_dim=2, action_dim=1)
    with pytest.raises(ValueError, match=message):
        check_task(Lamp(**wrong), observation_dim=2, action_dim=1)


def test_pendulum_v1_does_not_pay_for_speeds_that_it_does_not_have() -> None:
    task, action = GymnasiumPendulumTask(), th.zeros(2, 1)
    state = th.tensor([[0.5, 8.0], [0.5, 80.0]])
    slow, fast = task.reward(state, action, state)
    assert slow == fast


def test_the_cart_poles_exploratory_states_cover_the_slider_and_all_angles_slowly() -> None:
    task = CartPoleTask()
    states = task.exploratory_states(5_000, th.Generator().manual_seed(0))
    for column, reach in ((0, 1.25), (1, math.pi)):
        assert (th.histc(states[:, column], 8, -reach, reach) > 500).all()
    assert float(states[:, 2:].abs().max()) < 0.5
    # Some are upright in the middle of the rail, so that imagination meets the highest reward.
    action = th.zeros(len(states), 1)
    assert float(task.reward(states, action, states).max()) > 0.95
