"""How long imagination lasts where no horizon is given."""

from __future__ import annotations

import numpy as np
import pytest
import torch as th

from sb3_hucrl import Prediction, StartStates, TransitionDataset, Transitions
from sb3_hucrl.dynamics import Predictor
from sb3_hucrl.imagination import trusted_horizon
from sb3_hucrl.tasks import LearnedTask, PendulumTask


class Off(Predictor):
    """Predicts no change, and is off by a given distance."""

    def __init__(self, state_dim: int, distance: float) -> None:
        super().__init__(state_dim, 1)
        self.distance = distance

    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        return Prediction(state + self.distance, th.zeros_like(state), th.zeros_like(state))


def resting(
    task: LearnedTask | PendulumTask, std: float, moving: slice = slice(None), steps: int = 2_000
) -> TransitionDataset:
    """States spread by a given standard deviation, from which nothing moves by more than a trifle."""
    dataset = TransitionDataset(task.width, 1)
    states = std * th.randn(steps, task.width, generator=th.Generator().manual_seed(0))
    ends = th.zeros(len(states), dtype=th.bool)
    next_states = states.clone()
    next_states[:, moving] += 1e-5 * std
    dataset.append_episode(Transitions(states, th.zeros(len(states), 1), next_states, th.zeros(len(states)), ends))
    return dataset


@pytest.mark.parametrize(("distance", "expected"), [(0.0, 500), (0.001, 500), (0.01, 100), (0.25, 4), (7.0, 1)])
@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_the_horizon_ends_where_errors_would_add_up_to_a_standard_deviation(
    distance: float, expected: int, unit: float
) -> None:
    task = LearnedTask(2)
    horizon = trusted_horizon(Off(task.state_dim, unit * distance), resting(task, unit), task, 500)
    assert horizon == pytest.approx(expected, rel=0.05)


def test_errors_where_imagination_carries_what_never_changes_do_not_count() -> None:
    task = LearnedTask(3)

    class OffInTheGoal(Off):
        def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
            off = th.tensor([0.001, 0.5, 0.5, 0.0, 0.0])
            return Prediction(state + off, th.zeros_like(state), th.zeros_like(state))

    model = OffInTheGoal(task.state_dim, 0.0)
    assert trusted_horizon(model, resting(task, 1.0, slice(0, 1)), task, 500) == 500
    assert trusted_horizon(model, resting(task, 1.0), task, 500) == 2


def test_a_full_turn_is_no_error() -> None:
    task = PendulumTask()
    dataset = resting(task, 1.0)

    class Turning(Off):
        def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
            turned = state + th.tensor([2 * np.pi, 0.0])
            return Prediction(turned, th.zeros_like(state), th.zeros_like(state))

    assert trusted_horizon(Turning(2, 0.0), dataset, task, 300) == 300


def test_an_environment_in_which_nothing_moves_is_trusted() -> None:
    task = LearnedTask(2)
    assert trusted_horizon(Off(task.state_dim, 0.0), resting(task, 0.0), task, 50) == 50


def shares(starts: StartStates, dataset: TransitionDataset) -> float:
    """Fraction of starts that were visited."""
    visited = {tuple(row) for row in dataset.transitions.states.tolist()}
    states, initial = starts.sample(1_000, th.Generator().manual_seed(0))
    return float(np.mean([tuple(row) in visited for row in states.tolist()])) - float(initial.float().mean())


def test_short_trajectories_begin_in_visited_states() -> None:
    task = LearnedTask(2)
    dataset = resting(task, 1.0, steps=1_000)
    starts = StartStates(dataset, task)
    assert shares(starts.trusting(1.0), dataset) == pytest.approx(1 / 3, abs=0.05)
    assert shares(starts.trusting(0.01), dataset) > 0.95


def test_the_more_has_been_visited_the_fewer_begin_beyond_it() -> None:
    task = LearnedTask(2)
    for steps, expected in ((500, 1 / 3), (1_000, 1 / 3), (4_000, 1 / 2.25)):
        dataset = resting(task, 1.0, steps=steps)
        assert shares(StartStates(dataset, task).trusting(1.0), dataset) == pytest.approx(expected, abs=0.04)


def test_given_start_states_stay() -> None:
    task = LearnedTask(2)
    dataset = resting(task, 1.0, steps=20_000)
    starts = StartStates(dataset, task, {"initial": 1.0})
    _, initial = starts.trusting(0.01).sample(100, None)
    assert bool(initial.all())
    both = StartStates(dataset, task, {"visited": 1.0, "inflated": 1.0}).trusting(1.0)
    assert shares(both, dataset) == pytest.approx(1 / 2, abs=0.05)
