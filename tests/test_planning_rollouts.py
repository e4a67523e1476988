"""Action sequences in imagination, against returns computed by hand."""

from __future__ import annotations

import pytest
import torch as th

from helpers import small_world
from sb3_hucrl import Optimistic, Prediction, Task
from sb3_hucrl.dynamics.base import Predictor
from sb3_hucrl.imagination import TerminalValue
from sb3_hucrl.planning import CEM, ActionSequence, Bounds, ImaginedReturns, PlanningProblem


def generator() -> th.Generator:
    return th.Generator().manual_seed(0)


class Race(Task):
    """A point on a line: each step pays its position, and beyond 2 it ends."""

    state_dim = 1

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return next_state[:, 0]

    def terminated(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return next_state[:, 0] > 2


class Mover(Predictor):
    """s′ = s + a, and unknown by ±0.5."""

    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        return Prediction(state + action, th.full_like(state, 0.5), th.zeros_like(state))


def race_returns(
    states: list[float], horizon: int, gamma: float = 1.0, value: TerminalValue | None = None
) -> ImaginedReturns:
    world = small_world(Mover(1, 1), Optimistic(beta=2.0), Race())
    problem = PlanningProblem(world, ActionSequence(horizon, Bounds(world.low, world.high)), gamma, value)
    return ImaginedReturns(problem, th.tensor(states).unsqueeze(1), generator())


def test_returns_are_those_of_a_computation_by_hand() -> None:
    # Two environments, two sequences each, of two steps (a, a′) that move by a + a′ (β times the std of 0.5 is 1).
    actions = th.tensor([[[0.5, 0.0], [0.25, 0.5]], [[1.0, 1.0], [1.0, 0.0]]]).repeat(2, 1, 1, 1)
    returns = race_returns([0.0, 1.0], horizon=2, gamma=0.5, value=lambda observation: 100 * observation[:, 0])(actions)
    expected = [
        [0.5 + 0.5 * 1.25 + 0.25 * 125.0, 2.0 + 0.5 * 3.0],  # the second passes 2 at its last step: no value follows
        [1.5 + 0.5 * 2.25, 3.0],  # both pass 2, the second at its first step: nothing more is paid
    ]
    assert th.allclose(returns, th.tensor(expected))


def test_hallucinated_actions_are_planned_too() -> None:
    returns = race_returns([-9.0], horizon=3)
    variables = returns.problem.variables
    plan = CEM(num_iterations=15).plan(returns, variables.fresh(1), variables.bounds, generator())
    assert th.allclose(plan.actions, th.ones(1, 3, 2), atol=0.05)
    assert plan.returns.item() == pytest.approx(-7.0 - 5.0 - 3.0, abs=0.3)


def test_bad_rollouts_say_what_to_do() -> None:
    with pytest.raises(ValueError, match=r"gamma is .*: give a number above 0 and up to 1"):
        race_returns([0.0], horizon=1, gamma=1.5)
    with pytest.raises(ValueError, match="horizon is 0: give an integer of at least 1"):
        race_returns([0.0], horizon=0)
    with pytest.raises(ValueError, match=r"needs \(B, 1\)"):
        ImaginedReturns(race_returns([0.0], horizon=1).problem, th.zeros(3, 2), generator())
