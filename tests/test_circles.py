"""Cosines and sines that are found in the data, against environments whose angles are known."""

from __future__ import annotations

import math

import gymnasium as gym
import pytest
import torch as th

from helpers import TruePendulum
from sb3_hucrl import TransitionDataset, Transitions
from sb3_hucrl.imagination import Circles, Limits
from sb3_hucrl.tasks import LearnedTask


def visited(env_id: str, steps: int = 200) -> th.Tensor:
    """Observations of random actions."""
    env = gym.make(env_id)
    env.action_space.seed(0)
    observation, _ = env.reset(seed=0)
    observations = [observation]
    for _ in range(steps):
        observation, _, terminated, truncated, _ = env.step(env.action_space.sample())
        observations.append(observation)
        if terminated or truncated:
            observations.append(env.reset()[0])
    return th.stack([th.as_tensor(each, dtype=th.float32) for each in observations])


def pairs(circles: Circles | None) -> set[frozenset[int]]:
    if circles is None:
        return set()
    return {frozenset(pair) for pair in zip(circles.first.tolist(), circles.second.tolist(), strict=True)}


@pytest.mark.parametrize(
    ("env_id", "expected"),
    [
        ("Pendulum-v1", [{0, 1}]),
        ("InvertedDoublePendulum-v5", [{1, 3}, {2, 4}]),
        ("Reacher-v5", [{0, 2}, {1, 3}]),
        ("InvertedPendulum-v5", []),
        ("HalfCheetah-v5", []),
        ("Hopper-v5", []),
        ("MountainCarContinuous-v0", []),
    ],
)
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_the_angles_of_an_environment_are_found_in_any_unit(
    env_id: str, expected: list[set[int]], scale: float
) -> None:
    circles = Circles.find(scale * visited(env_id))
    assert pairs(circles) == set(map(frozenset, expected))
    if circles is not None:
        th.testing.assert_close(circles.radius, th.full((len(expected),), scale))


def test_values_that_hardly_change_are_no_circle() -> None:
    # A pressure of 1e5 Pa and a height: their squares' sum is the same to six digits, whatever they do.
    states = th.stack([1e5 + 0.1 * th.randn(100), th.randn(100)], dim=1)
    assert Circles.find(states) is None
    assert Circles.find(th.ones(100, 2)) is None


def test_states_end_on_the_circle_with_the_angle_that_was_predicted() -> None:
    circles = Circles(th.tensor([0]), th.tensor([2]), th.tensor([2.0]))
    states = th.tensor([[0.3, 7.0, 0.4], [-1.0, 8.0, 1.0]])
    projected = circles.project(states)
    th.testing.assert_close(projected[:, [0, 2]].norm(dim=1), th.full((2,), 2.0))
    th.testing.assert_close(th.atan2(projected[:, 2], projected[:, 0]), th.atan2(states[:, 2], states[:, 0]))
    assert projected[:, 1].tolist() == [7.0, 8.0]
    th.testing.assert_close(circles.project(projected), projected)


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.5, -1.2])
@pytest.mark.parametrize("length", [0.1, 1.5, 3.0])
def test_its_gradient_is_that_of_finite_differences(angle: float, length: float) -> None:
    circles = Circles(th.tensor([0]), th.tensor([1]), th.tensor([1.5], dtype=th.double))
    point = th.tensor([[length * math.cos(angle), length * math.sin(angle)]], dtype=th.double, requires_grad=True)
    assert th.autograd.gradcheck(circles.project, point)


def test_the_gradient_is_finite_at_the_centre() -> None:
    circles = Circles(th.tensor([0]), th.tensor([1]), th.ones(1))
    point = th.zeros(1, 2, requires_grad=True)
    circles.project(point).sum().backward()
    assert point.grad is not None
    assert point.grad.isfinite().all()


def test_imagination_stays_on_the_circles_of_a_task_that_knows_nothing() -> None:
    observations = visited("Pendulum-v1")
    dataset, task = TransitionDataset(5, 1), LearnedTask(3)
    outcomes = th.zeros(200, 2)
    dataset.append_episode(
        Transitions(
            th.cat([observations[:200], outcomes], dim=1),
            th.zeros(200, 1),
            th.cat([observations[1:201], outcomes], dim=1),
            th.zeros(200),
            th.zeros(200, dtype=th.bool),
        )
    )
    limits = Limits.from_data(dataset, task, TruePendulum(), None, unvisited=0.0)
    predicted = th.tensor([[0.9, 0.6, 1.0, -5.0, 0.0]])
    step = limits.apply(predicted, predicted)
    assert float(step[0, :2].norm()) == pytest.approx(1.0)
    th.testing.assert_close(limits.on_circles(predicted)[0, :2], step[0, :2])
