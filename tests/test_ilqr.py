"""iLQR against the Riccati solution, finite differences, and a solver for bounded problems."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
import torch as th

from helpers import ENV_ID, TruePendulum, small_world
from sb3_hucrl import Bonus, Optimistic, Prediction, Task
from sb3_hucrl.dynamics import Predictor
from sb3_hucrl.dynamics.truth import TrueDynamics
from sb3_hucrl.exploration import ExplorationStrategy
from sb3_hucrl.planning import ILQR, ActionSequence, Bounds, ImaginedReturns, Plan, PlanningProblem
from sb3_hucrl.planning.derivatives import expand_step, expand_terminal
from sb3_hucrl.tasks import PendulumTask

A = th.tensor([[1.0, 0.2], [0.0, 1.0]], dtype=th.float64)
B = th.tensor([[0.0], [0.2]], dtype=th.float64)
STARTS = th.tensor([[1.0, 0.0], [-0.5, 0.8]], dtype=th.float64)
EFFORT = 0.1


class Linear(Predictor):
    """s′ = A s + B a."""

    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        mean = state @ A.T + action @ B.T
        return Prediction(mean, th.zeros_like(mean), th.zeros_like(mean))


class Quadratic(Task):
    """-(‖s‖² + 0.1 a²)."""

    state_dim = 2

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return -state.square().sum(dim=1) - EFFORT * action.square().sum(dim=1)


class Uncertain(TruePendulum):
    """The pendulum in double precision, less known the faster it is."""

    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        mean = self.step(state, action)
        return Prediction(mean, 0.1 + 0.05 * state.sin().square() * action.cosh(), th.full_like(mean, 0.3))


def generator() -> th.Generator:
    return th.Generator().manual_seed(0)


def riccati() -> tuple[th.Tensor, th.Tensor]:
    """Cost-to-go and gain of the infinite horizon."""
    r = np.array([[EFFORT]])
    p = scipy.linalg.solve_discrete_are(A.numpy(), B.numpy(), np.eye(2), r)
    return th.tensor(p), th.tensor(np.linalg.solve(r + B.T.numpy() @ p @ B.numpy(), B.T.numpy() @ p @ A.numpy()))


def regulator(limit: float, horizon: int = 12) -> PlanningProblem:
    p, _ = riccati()
    world = small_world(Linear(2, 1), Optimistic(0.0), Quadratic(), bound=limit)
    variables = ActionSequence(horizon, Bounds(world.low.double(), world.high.double()))
    return PlanningProblem(world, variables, terminal_value=lambda s: -th.einsum("bi,ij,bj->b", s, p, s))


def solve(problem: PlanningProblem, planner: ILQR, starts: th.Tensor = STARTS) -> Plan:
    objective = ImaginedReturns(problem, starts, generator())
    variables = problem.variables
    return planner.plan(objective, variables.fresh(len(starts)), variables.bounds, generator())


def test_a_linear_quadratic_problem_is_solved_as_by_riccati() -> None:
    p, gain = riccati()
    plan = solve(regulator(limit=100.0), ILQR(num_iterations=3, num_particles=0))
    state = STARTS
    for n in range(12):
        expected = -state @ gain.T
        assert (plan.actions[:, n, :1] - expected).abs().max() < 1e-6
        state = state @ A.T + expected @ B.T
    assert (plan.returns + th.einsum("bi,ij,bj->b", STARTS, p, STARTS)).abs().max() < 1e-6


def test_limits_are_respected_where_they_bind() -> None:
    problem = regulator(limit=0.8)
    plan = solve(problem, ILQR(num_iterations=20, num_particles=0))
    assert plan.actions[..., 0].abs().max() == pytest.approx(0.8)
    for index in range(len(STARTS)):
        objective = ImaginedReturns(problem, STARTS[[index]], generator())

        def cost(actions: np.ndarray, objective: ImaginedReturns = objective) -> float:
            padded = th.nn.functional.pad(th.as_tensor(actions).view(1, 1, 12, 1), (0, 2))
            return -objective(padded).item()

        best = scipy.optimize.minimize(cost, np.zeros(12), method="L-BFGS-B", bounds=[(-0.8, 0.8)] * 12, tol=1e-12)
        np.testing.assert_allclose(plan.actions[index, :, 0], best.x, atol=1e-3)
        assert plan.returns[index].item() >= -best.fun - 1e-7


def pendulum_problem(strategy: ExplorationStrategy, horizon: int = 5) -> PlanningProblem:
    world = small_world(Uncertain(), strategy, PendulumTask(0.2))
    variables = ActionSequence(horizon, Bounds(world.low.double(), world.high.double()))
    return PlanningProblem(world, variables, terminal_value=lambda s: s[:, 1].pow(3) * s[:, 0].sin())


@pytest.mark.parametrize("strategy", [Optimistic(), Bonus()], ids=["optimistic", "bonus"])
def test_derivatives_match_finite_differences(strategy: ExplorationStrategy) -> None:
    problem = pendulum_problem(strategy)
    # Close enough to upright for a reward that is not flat; efforts beyond what is free.
    state = th.tensor([[0.25, 0.7], [-0.3, -0.6], [0.1, 0.2]], dtype=th.float64)
    value = th.tensor([[0.15, 0.4, -0.3], [-0.2, 0.1, 0.5], [0.12, -0.6, 0.2]], dtype=th.float64)
    value = value[:, : len(problem.variables.bounds.low)]
    dynamics, reward = expand_step(problem, state, value)

    def step(point: th.Tensor) -> tuple[th.Tensor, th.Tensor]:
        stepped = problem.world.step(point[:, :2], point[:, 2:], None)
        return stepped.next_state, stepped.total_reward

    z, h = th.cat([state, value], dim=1), 1e-5
    for dim in range(z.shape[1]):
        away = h * th.eye(z.shape[1], dtype=th.float64)[dim]
        (up, reward_up), (down, reward_down) = step(z + away), step(z - away)
        assert th.allclose(dynamics[..., dim], (up - down) / (2 * h), atol=1e-8)
        assert th.allclose(reward.gradient[:, dim], (reward_up - reward_down) / (2 * h), atol=1e-7)


def test_second_derivatives_of_rewards_match_finite_differences() -> None:
    problem = pendulum_problem(Optimistic())
    state = th.tensor([[0.25, 0.7], [-0.3, -0.6]], dtype=th.float64)
    value = th.tensor([[0.15, 0.4, -0.3], [-0.2, 0.1, 0.5]], dtype=th.float64)
    z, h = th.cat([state, value], dim=1), 1e-5
    # The reward of this task hangs on the state before the step, so nothing is left out.
    hessian = expand_step(problem, state, value)[1].hessian
    for dim in range(5):
        away = h * th.eye(5, dtype=th.float64)[dim]
        up, down = (expand_step(problem, p[:, :2], p[:, 2:])[1].gradient for p in (z + away, z - away))
        assert th.allclose(hessian[..., dim], (up - down) / (2 * h), atol=1e-6)
    terminal = expand_terminal(problem, state)
    for dim in range(2):
        away = h * th.eye(2, dtype=th.float64)[dim]
        up, down = (expand_terminal(problem, state + each).gradient for each in (away, -away))
        assert th.allclose(terminal.hessian[..., dim], (up - down) / (2 * h), atol=1e-6)


def test_every_iteration_improves_the_plan_or_keeps_it() -> None:
    starts = th.tensor([[0.3, 0.0], [math.pi, 0.0]], dtype=th.float64)
    problem = pendulum_problem(Optimistic(), horizon=30)
    returns = [solve(problem, ILQR(n, num_particles=0), starts).returns for n in (1, 2, 4, 8)]
    for earlier, later in itertools.pairwise(returns):
        assert (later >= earlier).all()
    assert (returns[-1] > returns[0]).any()


def test_a_step_on_which_the_model_diverges_is_not_taken() -> None:
    class Cliff(Quadratic):
        """Beyond where Riccati's solution would go there is nothing."""

        def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
            reward = super().reward(state, action, next_state)
            return th.where(action[:, 0] < -1.0, th.inf, reward)

    problem = regulator(limit=100.0)
    world = small_world(Linear(2, 1), Optimistic(0.0), Cliff(), bound=100.0)
    plan = solve(PlanningProblem(world, problem.variables), ILQR(num_particles=0))
    assert th.isfinite(plan.returns).all()
    assert (plan.actions[..., 0] >= -1.0).all()


def test_what_cannot_be_differentiated_is_said() -> None:
    class Sparse(PendulumTask):
        def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
            return (next_state[:, 0].cos() > 0.9).float()

    sparse, true = small_world(task=Sparse()), small_world(TrueDynamics(2, 1, env=ENV_ID))
    for world, message in ((sparse, "differentiable reward"), (true, "differentiable dynamics")):
        problem = PlanningProblem(world, ActionSequence(3, Bounds(world.low, world.high)))
        with pytest.raises(ValueError, match=message):
            solve(problem, ILQR(), STARTS.float())
    with pytest.raises(ValueError, match="num_iterations is 0"):
        ILQR(num_iterations=0)
