"""Planners by sampling, on problems with known solutions."""

from __future__ import annotations

import math

import colorednoise
import numpy as np
import pytest
import scipy.linalg
import torch as th

from sb3_hucrl.planning import (
    CEM,
    ICEM,
    MPPI,
    ActionSequence,
    Bounds,
    Objective,
    Proposal,
    RandomShooting,
    ShootingPlanner,
    make_planner,
)
from sb3_hucrl.planning.noise import colored_noise

BOUNDS = Bounds(th.tensor([-1.0, -2.0]), th.tensor([1.0, 2.0]))
CURVATURE = th.tensor([[2.0, 0.6], [0.6, 1.0]])


def generator() -> th.Generator:
    return th.Generator().manual_seed(0)


def quadratic(optimum: th.Tensor) -> Objective:
    """J = -½ Σ (a - a*)ᵀ Q (a - a*), with an optimum of shape (B, N, d) of its own for each environment."""

    def objective(actions: th.Tensor) -> th.Tensor:
        error = actions - optimum.unsqueeze(1)
        return -0.5 * th.einsum("bnti,ij,bntj->bn", error, CURVATURE, error)

    return objective


def optima(num_envs: int, horizon: int) -> th.Tensor:
    return th.tensor([0.6, 1.2]) * (2 * th.rand(num_envs, horizon, 2, generator=generator()) - 1)


@pytest.mark.parametrize(
    ("planner", "tolerance"),
    [
        (CEM(500, num_iterations=20, num_elites=50), 1e-3),
        (ICEM(400, num_iterations=30, num_elites=40, noise_exponent=0.5), 5e-3),
        # Its standard deviation never shrinks: the error is that of a weighted mean, with few particles that count.
        (MPPI(20_000, num_iterations=30, temperature=0.3), 5e-2),
    ],
    ids=["cem", "icem", "mppi"],
)
def test_the_optimum_of_a_convex_quadratic_is_found_for_every_environment(
    planner: ShootingPlanner, tolerance: float
) -> None:
    optimum = optima(num_envs=3, horizon=2)
    # So wide that no particle is clipped, which would pull the weighted mean inwards.
    wide = Bounds(th.full((2,), -5.0), th.full((2,), 5.0))
    start = Proposal(th.zeros(3, 2, 2), th.full((3, 2, 2), 0.5))
    plan = planner.plan(quadratic(optimum), start, wide, generator())
    assert (plan.proposal.mean - optimum).abs().max() < tolerance
    assert plan.returns.shape == (3,)
    assert th.equal(plan.returns, quadratic(optimum)(plan.actions.unsqueeze(1)).squeeze(1))


@pytest.mark.parametrize("n", [1_000, 100_000])
def test_random_shooting_comes_as_close_as_its_samples_are_dense(n: int) -> None:
    optimum = optima(num_envs=20, horizon=1)
    proposal = ActionSequence(1, BOUNDS).fresh(20)
    plan = RandomShooting(n).plan(quadratic(optimum), proposal, BOUNDS, generator())
    density = th.distributions.Normal(proposal.mean, proposal.std).log_prob(optimum).sum(dim=2).exp().squeeze(1)
    # Level sets of J are ellipses of area 2π(-J)/√det Q: one that holds 12 samples on average is empty with e^-12.
    lowest = -12 * CURVATURE.det().sqrt() / (2 * math.pi * density * n)
    assert (plan.returns <= 0).all()
    assert (plan.returns > lowest).all()


def test_one_mppi_update_is_the_posterior_mean_of_its_gaussian() -> None:
    # exp(J/λ) is a Gaussian likelihood of precision Q/λ around a*, the proposal the prior.
    optimum, proposal, temperature = optima(1, 1), ActionSequence(1, BOUNDS).fresh(1), 2.0
    wide = Bounds(th.full((2,), -100.0), th.full((2,), 100.0))
    plan = MPPI(1_000_000, 1, temperature).plan(quadratic(optimum), proposal, wide, generator())
    prior = (1 / proposal.std[0, 0].square()).diag()
    expected = th.linalg.solve(CURVATURE / temperature + prior, CURVATURE @ optimum[0, 0] / temperature)
    assert th.allclose(plan.proposal.mean[0, 0], expected, atol=5e-3)


@pytest.mark.parametrize(
    ("planner", "tolerance", "loss"),
    [
        (CEM(1000, num_iterations=30, num_elites=100), 0.01, 1e-4),
        # Elites that are tried again narrow the search early.
        (ICEM(400, num_iterations=30, num_elites=40, noise_exponent=0.5), 0.5, 0.01),
        (MPPI(20_000, num_iterations=60, temperature=5.0), 0.3, 0.05),
    ],
    ids=["cem", "icem", "mppi"],
)
def test_a_linear_quadratic_problem_is_solved_as_by_riccati(
    planner: ShootingPlanner, tolerance: float, loss: float
) -> None:
    a, b = np.array([[1.0, 0.2], [0.0, 1.0]]), np.array([[0.0], [0.2]])
    q, r = np.eye(2), np.array([[0.1]])
    p = scipy.linalg.solve_discrete_are(a, b, q, r)
    gain = np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)
    starts = np.array([[1.0, 0.0], [-0.5, 0.8]])
    horizon = 8

    def objective(actions: th.Tensor) -> th.Tensor:
        state = th.tensor(starts, dtype=th.float32).unsqueeze(1).expand(-1, actions.shape[1], -1)
        cost = th.zeros(actions.shape[:2])
        for step in range(horizon):
            action = actions[:, :, step]
            cost += state.square().sum(dim=2) + 0.1 * action.square().sum(dim=2)
            state = state @ th.tensor(a.T, dtype=th.float32) + action @ th.tensor(b.T, dtype=th.float32)
        # The cost-to-go of the infinite horizon as terminal value makes the finite problem's solution the regulator.
        return -(cost + th.einsum("bni,ij,bnj->bn", state, th.tensor(p, dtype=th.float32), state))

    bounds = Bounds(th.tensor([-8.0]), th.tensor([8.0]))
    plan = planner.plan(objective, ActionSequence(horizon, bounds).fresh(2), bounds, generator())
    expected, state = [], starts
    for _ in range(horizon):
        expected.append(-state @ gain.T)
        state = state @ a.T + expected[-1] @ b.T
    optimal_return = -np.einsum("bi,ij,bj->b", starts, p, starts)
    assert np.abs(plan.proposal.mean.numpy() - np.stack(expected, axis=1)).max() < tolerance
    np.testing.assert_allclose(objective(plan.proposal.mean.unsqueeze(1))[:, 0], optimal_return, rtol=loss)


@pytest.mark.parametrize("name", ["random_shooting", "cem", "icem", "mppi"])
def test_plans_stay_within_their_bounds_and_follow_the_seed(name: str) -> None:
    far = quadratic(th.full((2, 3, 2), 50.0))
    planner, proposal = make_planner(name), ActionSequence(3, BOUNDS).fresh(2)
    assert isinstance(planner, ShootingPlanner)
    first, second = (planner.plan(far, proposal, BOUNDS, generator()) for _ in range(2))
    assert (first.actions <= BOUNDS.high).all()
    assert (first.actions >= BOUNDS.low).all()
    assert (first.actions.mean(dim=(1, 2)) > 0).all()
    assert th.equal(first.actions, second.actions)


def test_the_next_step_begins_where_the_plan_left_off() -> None:
    variables = ActionSequence(4, BOUNDS)
    fresh = variables.fresh(2)
    optimum = optima(2, 4)
    plan = ICEM().plan(quadratic(optimum), fresh, BOUNDS, generator())
    shifted = variables.shifted(plan.proposal)
    assert th.equal(shifted.mean[:, :-1], plan.proposal.mean[:, 1:])
    assert th.equal(shifted.mean[:, -1], fresh.mean[:, -1])
    assert th.equal(shifted.std, fresh.std)
    assert plan.proposal.kept is not None
    assert shifted.kept is not None
    assert th.equal(shifted.kept[:, :, :-1], plan.proposal.kept[:, :, 1:])


def test_icem_tries_its_elites_again() -> None:
    optimum = optima(2, 4)
    fresh = ActionSequence(4, BOUNDS).fresh(2)
    lucky = Proposal(fresh.mean, fresh.std, kept=optimum.unsqueeze(1))
    plan = ICEM(num_iterations=1).plan(quadratic(optimum), lucky, BOUNDS, generator())
    assert th.allclose(plan.actions, optimum)


@pytest.mark.parametrize("length", [1, 2, 7, 64])
@pytest.mark.parametrize("exponent", [0.0, 1.0, 2.0])
def test_colored_noise_has_variance_one(exponent: float, length: int) -> None:
    noise = colored_noise((50_000, length), exponent, th.zeros(0), generator())
    assert noise.shape == (50_000, length)
    assert th.allclose(noise.var(dim=0), th.ones(length), atol=0.04)


@pytest.mark.parametrize("exponent", [1.0, 2.0])
@pytest.mark.parametrize("length", [31, 64])
def test_the_spectrum_of_the_noise_is_that_of_colorednoise(exponent: float, length: int) -> None:
    ours = colored_noise((20_000, length), exponent, th.zeros(0), generator()).numpy()
    theirs = colorednoise.powerlaw_psd_gaussian(exponent, (20_000, length), random_state=np.random.default_rng(0))
    power, expected = (np.square(np.abs(np.fft.rfft(noise))).mean(axis=0) for noise in (ours, theirs))
    # Theirs has variance 1 around its mean, ours around 0.
    ratio = power / expected
    np.testing.assert_allclose(ratio / ratio.mean(), 1, atol=0.06)
    assert theirs.var() > 1.1


def test_bad_settings_say_what_to_do() -> None:
    with pytest.raises(ValueError, match="num_elites is 11: give at most num_particles, 10"):
        CEM(num_particles=10, num_elites=11)
    with pytest.raises(ValueError, match="num_iterations is 0"):
        MPPI(num_iterations=0)
    with pytest.raises(ValueError, match="num_elites is 1: give an integer of at least 2"):
        CEM(num_elites=1)
    with pytest.raises(ValueError, match="smoothing"):
        CEM(smoothing=1.0)
    with pytest.raises(ValueError, match="noise_exponent"):
        RandomShooting(noise_exponent=-1.0)
    with pytest.raises(ValueError, match="decay"):
        ICEM(decay=0.5)
    with pytest.raises(ValueError, match="temperature is 0"):
        MPPI(temperature=0.0)
    with pytest.raises(ValueError, match="horizon is 0"):
        ActionSequence(0, BOUNDS).fresh(1)
    with pytest.raises(ValueError, match="finite"):
        Bounds(th.tensor([-math.inf]), th.tensor([1.0]))
    with pytest.raises(ValueError, match="unknown planner 'cme'"):
        make_planner("cme")


@pytest.mark.parametrize("name", ["random_shooting", "cem", "icem", "mppi"])
def test_plans_on_which_the_model_diverges_are_not_followed(name: str) -> None:
    optimum = optima(2, 3)

    def diverges_left(actions: th.Tensor) -> th.Tensor:
        returns = quadratic(optimum)(actions)
        return th.where(actions[:, :, 0, 0] < 0, th.inf, returns)

    planner = make_planner(name)
    assert isinstance(planner, ShootingPlanner)
    plan = planner.plan(diverges_left, ActionSequence(3, BOUNDS).fresh(2), BOUNDS, generator())
    assert (plan.actions[:, 0, 0] >= 0).all()
    assert th.isfinite(plan.returns).all()
    assert th.isfinite(plan.proposal.mean).all()


def test_a_model_that_always_diverges_stops_the_plan() -> None:
    with pytest.raises(ValueError, match="no planned return is finite"):
        CEM().plan(lambda actions: actions.sum(dim=(2, 3)) / 0, ActionSequence(2, BOUNDS).fresh(1), BOUNDS, generator())
