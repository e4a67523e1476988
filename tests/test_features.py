"""Fourier features and Bayesian linear regression in closed form."""

import math
from typing import Any

import pytest
import torch as th

from helpers import pendulum_dataset, random_transitions
from sb3_hucrl import DynamicsModel
from sb3_hucrl.dynamics import linear, make_dynamics
from sb3_hucrl.dynamics.features import FeatureModel, QuadratureFourierModel, RandomFourierModel
from sb3_hucrl.dynamics.fourier import FourierFeatures, quadrature_features, random_features
from sb3_hucrl.dynamics.linear import BayesianLinearRegression


def pendulum_inputs(rows: int = 300) -> th.Tensor:
    """Standardised model inputs of random pendulum transitions."""
    model = QuadratureFourierModel(2, 1, (0,), nodes_per_dim=2)
    batch = random_transitions(rows)
    inputs = model.encode(batch.states, batch.actions)
    return (inputs - inputs.mean(dim=0)) / inputs.std(dim=0)


def kernel_error(features: FourierFeatures, inputs: th.Tensor, lengthscale: float) -> float:
    phi = features(inputs)
    exact = (-0.5 * th.cdist(inputs, inputs).double().square() / lengthscale**2).exp()
    return float((phi @ phi.T - exact).abs().max())


def test_quadrature_approximates_the_kernel_better_than_chance_at_the_same_count() -> None:
    inputs = pendulum_inputs()
    for lengthscale in (4.0, 10.0):
        quadrature = quadrature_features(4, 5, lengthscale)
        random_errors = [
            kernel_error(random_features(4, 626, lengthscale, th.Generator().manual_seed(seed)), inputs, lengthscale)
            for seed in range(10)
        ]
        assert quadrature.num_features == 626
        assert kernel_error(quadrature, inputs, lengthscale) < 0.5 * min(random_errors)


def test_random_features_converge_to_the_kernel() -> None:
    inputs = pendulum_inputs(100)
    errors = [
        kernel_error(random_features(4, count, 1.5, th.Generator().manual_seed(0)), inputs, 1.5)
        for count in (100, 10_000)
    ]
    assert errors[0] > 3 * errors[1]
    assert errors[1] < 0.06


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("nodes", [1, 2, 5, 6])
def test_half_of_the_grid_is_the_whole_grid(dim: int, nodes: int) -> None:
    features = quadrature_features(dim, nodes, 1.0)
    assert float(features.amplitudes.square().sum()) == pytest.approx(1.0)
    assert features.num_features == 2 * math.ceil(nodes**dim / 2)
    if nodes == 6:
        # Gauss-Hermite with 6 nodes is exact for polynomials of degree 11, so close to 0 it is the kernel.
        inputs = 0.2 * th.randn(50, dim, generator=th.Generator().manual_seed(0))
        assert kernel_error(features, inputs, 1.0) < 2e-3


def test_regression_is_the_exact_posterior_and_incremental() -> None:
    generator = th.Generator().manual_seed(0)
    phi, y, new = (th.randn(*shape, dtype=th.float64, generator=generator) for shape in ((40, 7), (40, 2), (9, 7)))
    covariance = (phi.T @ phi / 0.3**2 + th.eye(7) / 2.5).inverse()
    expected = covariance @ phi.T @ y / 0.3**2
    regression = BayesianLinearRegression(7, 2, prior_variance=2.5, noise_std=0.3)
    for rows in (slice(0, 1), slice(1, 25), slice(25, 40)):
        regression.update(phi[rows], y[rows])
    mean, std = regression.predict(new)
    th.testing.assert_close(regression.mean, expected)
    th.testing.assert_close(mean, new @ expected)
    th.testing.assert_close(std.squeeze(1), (new @ covariance @ new.T).diagonal().sqrt())
    gain = 0.5 * th.logdet(th.eye(40) + 2.5 * phi @ phi.T / 0.3**2)
    assert regression.information_gain() == pytest.approx(float(gain))
    samples = regression.sample_weights(20_000, generator)[:, :, 0]
    # Five standard errors of 20,000 draws.
    tolerance = 5 * covariance.diagonal().sqrt() / math.sqrt(20_000)
    assert ((samples.mean(dim=0) - expected[:, 0]).abs() < tolerance).all()
    th.testing.assert_close(samples.T.cov(), covariance, rtol=0.1, atol=2e-4)


@pytest.mark.parametrize("name", ["rff", "qff"])
def test_one_fit_and_many_are_the_same(name: str) -> None:
    def make() -> DynamicsModel:
        return make_dynamics(name, 2, 1, (0,), th.Generator().manual_seed(0))

    # Standardised on 300 transitions, and again at 600.
    together, apart = make(), make()
    dataset = pendulum_dataset(300)
    for size in (0, 150, 80):
        if size:
            dataset.append_episode(random_transitions(size, seed=size))
        apart.fit(dataset, th.Generator())
    assert isinstance(apart, FeatureModel)
    assert int(apart.num_seen) == len(dataset.train)
    assert int(apart.scaled_on) < 0.6 * len(dataset.train)
    dataset.append_episode(random_transitions(200, seed=9))
    for model in (together, apart):
        model.fit(dataset, th.Generator())
    batch = random_transitions(20, seed=4)
    expected, actual = (model.predict(batch.states, batch.actions) for model in (together, apart))
    th.testing.assert_close(actual.mean, expected.mean)
    th.testing.assert_close(actual.epistemic_std, expected.epistemic_std, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("name", ["rff", "qff"])
@pytest.mark.parametrize("size", [50, 400], ids=["added", "standardised again"])
@pytest.mark.parametrize(
    "place", [(linear, "safe_cholesky"), (th, "cholesky_solve"), (BayesianLinearRegression, "predict")]
)
def test_an_interrupted_fit_counts_no_transition_twice(
    name: str, size: int, place: tuple[Any, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*args: Any) -> None:
        raise KeyboardInterrupt

    few = {"num_features": 60} if name == "rff" else {"nodes_per_dim": 3}
    model, whole = (make_dynamics(name, 2, 1, (0,), th.Generator().manual_seed(0), **few) for _ in range(2))
    assert isinstance(model, FeatureModel)
    assert isinstance(whole, FeatureModel)
    dataset = pendulum_dataset(200)
    model.fit(dataset, th.Generator())
    dataset.append_episode(random_transitions(size, seed=1))
    with monkeypatch.context() as patch:
        patch.setattr(*place, interrupt)
        with pytest.raises(KeyboardInterrupt):
            model.fit(dataset, th.Generator())
    for each in (model, whole):
        each.fit(dataset, th.Generator())
        assert int(each.num_seen) == len(dataset.train)
    batch = random_transitions(20, seed=4)
    expected, actual = (each.predict(batch.states, batch.actions) for each in (whole, model))
    # Inputs may be standardised on fewer transitions, of which the posterior depends little.
    th.testing.assert_close(actual.mean, expected.mean, rtol=0.01, atol=0.02)
    gain = whole.information_gain()
    assert model.information_gain() == pytest.approx(gain, rel=0.02)
    # The precision is a sum over transitions, whose features have length 1.
    traces = [float(each.regression.precision.trace()) for each in (whole, model)]
    assert traces[1] == pytest.approx(traces[0], rel=1e-9)


def test_bad_input_says_what_to_do() -> None:
    with pytest.raises(ValueError, match=r"nodes_per_dim is 5, .* of 23 inputs: .* use dynamics 'rff'"):
        QuadratureFourierModel(17, 6)
    with pytest.raises(ValueError, match="num_features is 7: give an even number"):
        RandomFourierModel(2, 1, num_features=7)
