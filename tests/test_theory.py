"""Theory's functions against closed forms, scipy and simulation."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy.linalg
import scipy.stats
import torch as th

from helpers import TruePendulum, imagination_env, pendulum_dataset, small_callback, small_sac
from sb3_hucrl import Prediction
from sb3_hucrl.dynamics.gp import ExactGP
from sb3_hucrl.sb3 import get_state
from sb3_hucrl.theory import (
    LipschitzConstants,
    confidence_width,
    domain_radius,
    estimate_lipschitz,
    greedy_information_gains,
    information_capacity,
    information_gain,
    noise_bound,
    noise_bound_over_time,
    noise_sum_bound,
    regret_bound,
    regret_bound_of_capacity,
    regret_bound_of_unbounded_states,
    state_deviation,
    uncertainty_bound,
)


def rbf(first: th.Tensor, second: th.Tensor) -> th.Tensor:
    return th.exp(-0.5 * th.cdist(first.double(), second.double()).square())


def linear(first: th.Tensor, second: th.Tensor) -> th.Tensor:
    return (first @ second.T).double()


def test_the_information_gain_is_that_of_scipys_determinant() -> None:
    points = th.rand(12, 3, generator=th.Generator().manual_seed(0)) * 4
    matrix = rbf(points, points)
    expected = 0.5 * np.log(scipy.linalg.det(np.eye(12) + matrix.numpy() / 0.3**2))
    assert information_gain(matrix, 0.3) == pytest.approx(expected)
    # One observation of one variable: ½ ln(1 + k/σ²).
    assert information_gain(th.tensor([[2.0]]), 0.5) == pytest.approx(0.5 * math.log(9.0))


def test_what_independent_points_tell_adds_up() -> None:
    far_apart = th.tensor([[0.0], [100.0], [200.0]])
    assert information_gain(rbf(far_apart, far_apart), 0.1) == pytest.approx(3 * 0.5 * math.log(101.0))


def test_greedy_gains_are_those_of_the_points_that_they_stand_for() -> None:
    def uneven(first: th.Tensor, second: th.Tensor) -> th.Tensor:
        return rbf(first, second) + 0.1 * linear(first, second)

    def gain(points: list[int]) -> float:
        return information_gain(uneven(candidates[points], candidates[points]), 0.2)

    candidates = th.linspace(0, 5, 41).unsqueeze(1)
    gains = greedy_information_gains(uneven, candidates, 0.2, 6)
    points: list[int] = []
    for expected in gains.tolist():
        points.append(max(range(len(candidates)), key=lambda index: gain([*points, index])))
        assert gain(points) == pytest.approx(expected, rel=1e-6)


def test_the_capacity_bounds_every_choice_of_points() -> None:
    candidates = th.rand(7, 2, generator=th.Generator().manual_seed(1)) * 3
    choices = itertools.combinations_with_replacement(range(7), 3)
    largest = max(information_gain(rbf(candidates[list(c)], candidates[list(c)]), 0.3) for c in choices)
    greedy = greedy_information_gains(rbf, candidates, 0.3, 3)[-1].item()
    capacity = information_capacity(rbf, candidates, 0.3, 3)
    assert greedy <= largest + 1e-9
    assert largest <= capacity < 2 * largest


def test_a_linear_kernels_capacity_grows_like_p_log_t() -> None:
    # Lemma 28. On the axes of the unit ball: p/2 ln(1 + t/(p σ²)), exactly.
    for p in (1, 2, 4):
        gains = greedy_information_gains(linear, th.eye(p), 1.0, 400)
        expected = 0.5 * p * np.log1p(np.arange(p, 401, p) / p)
        np.testing.assert_allclose(gains[p - 1 :: p], expected, rtol=1e-9)
        growth = (gains[399] - gains[99]) / math.log(4)
        assert growth.item() == pytest.approx(p / 2, rel=0.05)


def test_the_confidence_width_is_lemma_10s() -> None:
    assert confidence_width(information_gain=3.0, noise_std=0.5, delta=math.exp(-5), norm_bound=2.0) == 2 + 2 * 3.0


@pytest.mark.parametrize("std", [0.1, 1.0, 10.0])
def test_noise_stays_within_its_bound_whatever_its_size(std: float) -> None:
    noise = std * np.random.default_rng(0).normal(size=(200_000, 3))
    norms = np.square(noise).sum(axis=1)
    for delta in (0.3, 0.01):
        bound = noise_bound(math.sqrt(2) * std, 3, delta)
        assert (norms > bound).mean() <= delta
        exact = std**2 * scipy.stats.chi2(3).ppf(1 - delta)
        assert exact <= bound < 8 * exact


def test_the_budgets_of_all_steps_and_episodes_add_up_to_delta() -> None:
    # The bound of a step is the plain bound at that step's fraction of delta.
    delta, sigma, p = 0.1, 0.7, 2
    shares = [6 * delta / (math.pi * (n + 1)) ** 2 for n in range(100_000)]
    assert sum(shares) == pytest.approx(delta, rel=1e-4)
    for n in (0, 1, 7):
        assert noise_bound_over_time(sigma, p, delta, n) == pytest.approx(noise_bound(sigma, p, shares[n]))
        bound = 50 * math.sqrt(noise_bound(sigma, p, shares[n] / 50))
        assert noise_sum_bound(sigma, p, delta, 50, episode=n + 1) == pytest.approx(bound)
    assert noise_sum_bound(sigma, p, delta, 50) == pytest.approx(50 * math.sqrt(noise_bound(sigma, p, delta / 50)))


def test_simulated_states_stay_within_the_radius() -> None:
    # s' = 1 + 0.9 s + ω from 0, with L_fc = 0.9 and B_0 = 1.
    rng, horizon, std = np.random.default_rng(0), 10, 0.2
    states, farthest, noise = np.zeros(20_000), np.zeros(20_000), np.zeros(20_000)
    for n in range(1, horizon + 1):
        omega = std * rng.normal(size=20_000)
        states, noise = 1 + 0.9 * states + omega, noise + np.abs(omega)
        assert (np.abs(states) <= [state_deviation(0.9, 1.0, n, each) for each in noise]).all()
        farthest = np.maximum(farthest, np.abs(states))
    radius = domain_radius(0.9, 1.0, math.sqrt(2) * std, dim=1, delta=0.1, horizon=horizon, episode=1)
    assert (farthest <= radius).mean() >= 0.9
    assert domain_radius(0.9, 1.0, math.sqrt(2) * std, 1, 0.1, horizon, episode=100) > radius


def test_regret_bounds_of_hand_picked_numbers() -> None:
    constants = LipschitzConstants(dynamics=2.0, policy=math.sqrt(3), std=0.25, reward=0.5)
    assert constants.through_policy == pytest.approx(2.0)
    assert constants.closed_loop == pytest.approx(4.0)
    # 1 + 4 + 2·3·0.25·2 = 8, and 2·0.5·2·3·8² = 384.
    assert constants.deviation(beta=3.0) == pytest.approx(8.0)
    assert constants.performance(beta=3.0, horizon=3) == pytest.approx(384.0)
    # √(12 · 27 · 4) = 36.
    assert regret_bound(constants, 3.0, 3, 12, 4.0) == pytest.approx(384 * 36)
    # 2 · 4 · 3 · 2 · 5 / ln(1 + 4).
    total = uncertainty_bound(max_std=2.0, noise_std=1.0, horizon=3, dim=2, capacity=5.0)
    assert total == pytest.approx(240 / math.log(5))
    bounded = regret_bound_of_capacity(constants, 3.0, 3, 12, 2, 5.0, 2.0, 1.0)
    assert bounded == pytest.approx(regret_bound(constants, 3.0, 3, 12, total))
    unbounded = regret_bound_of_unbounded_states(
        constants, 3.0, 3, 12, 2, radius=2.5, capacity=lambda radius: 2 * radius, max_std=2.0, noise_std=1.0
    )
    assert unbounded == pytest.approx(bounded)


def test_the_sum_of_variances_stays_within_lemma_17s_bound() -> None:
    # Greedy observations, N per episode in each of T episodes, with the variance from before the episode.
    candidates, noise_std, horizon, episodes = th.linspace(0, 3, 31).unsqueeze(1), 0.3, 4, 5
    matrix, total = rbf(candidates, candidates), 0.0
    seen: list[int] = []
    for _ in range(episodes):
        variances = matrix.diagonal()
        if seen:
            known = matrix[seen][:, seen] + noise_std**2 * th.eye(len(seen))
            variances = variances - (matrix[:, seen] @ known.inverse() * matrix[:, seen]).sum(dim=1)
        best = int(variances.argmax())
        total += horizon * float(variances[best])
        seen += [best] * horizon
    capacity = information_capacity(rbf, candidates, noise_std, horizon * episodes)
    assert 0 < total <= uncertainty_bound(1.0, noise_std, horizon, 1, capacity)


def test_lipschitz_estimates_are_the_slopes_of_the_function() -> None:
    class Known(TruePendulum):
        def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
            prediction = super().predict(state, action)
            mean = th.stack([3 * state[:, 0] + 4 * action[:, 0], 0.5 * state[:, 1]], dim=1)
            return Prediction(mean, (0.1 * state).sin() + 2, prediction.aleatoric_std)

    states, actions = th.zeros(8, 2), th.rand(8, 1)
    estimate = estimate_lipschitz(Known(), states, actions)
    assert estimate.mean == pytest.approx(5.0)
    assert estimate.std == pytest.approx(0.1)
    assert estimate_lipschitz(TruePendulum(), states, actions).std == 0.0


def test_a_learned_model_is_as_steep_as_finite_differences_say() -> None:
    model = ExactGP(2, 1, angle_dims=[0])
    dataset = pendulum_dataset(200)
    model.fit(dataset, th.Generator().manual_seed(0))
    states, actions = dataset.transitions.states[:50], dataset.transitions.actions[:50]
    estimate = estimate_lipschitz(model, states, actions)
    generator, steepest = th.Generator().manual_seed(1), 0.0
    with th.no_grad():
        for _ in range(200):
            step = th.nn.functional.normalize(th.randn(50, 3, generator=generator), dim=1) * 1e-2
            there = model.predict(states + step[:, :2], actions + step[:, 2:]).mean
            steepest = max(steepest, float((there - model.predict(states, actions).mean).norm(dim=1).max()) / 1e-2)
    assert steepest <= 1.05 * estimate.mean
    assert steepest >= 0.8 * estimate.mean


def test_the_loop_logs_what_theory_says(tmp_path: Path) -> None:
    exploration = {"beta": "theory", "delta": 0.2, "norm_bound": 0.5}
    callback = small_callback(dynamics="qff", dynamics_kwargs={}, exploration_kwargs=exploration, log_dir=str(tmp_path))
    model = small_sac(imagination_env(max_episode_steps=40))
    model.learn(160, callback=callback)
    state = get_state(model)
    assert state is not None
    noise_std = vars(state.dynamics)["noise_std"]
    rows = pd.read_csv(tmp_path / "progress.csv").dropna(subset=["hucrl/beta"])
    assert len(rows) == 2
    for gain, beta in zip(rows["hucrl/information_gain"], rows["hucrl/beta"], strict=True):
        assert beta == pytest.approx(confidence_width(gain, noise_std, 0.2, 0.5), rel=1e-4)
