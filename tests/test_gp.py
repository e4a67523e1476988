"""Gaussian processes against their closed form, scikit-learn and GPyTorch."""

import math
import pickle
from typing import Any

import gpytorch
import numpy as np
import pytest
import torch as th
from linear_operator.utils.warnings import NumericalWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from helpers import pendulum_dataset, random_transitions
from sb3_hucrl import TransitionDataset, Transitions
from sb3_hucrl.dynamics.cholesky import safe_cholesky
from sb3_hucrl.dynamics.gp import ExactGP, ExactPosterior, GaussianProcess
from sb3_hucrl.dynamics.sparse_gp import SparseGP, choose_inducing_points


def fitted(kind: type[GaussianProcess] = ExactGP, points: int = 120, **settings: Any) -> GaussianProcess:
    model = kind(2, 1, (0,), **settings)
    model.fit(pendulum_dataset(points), th.Generator().manual_seed(0))
    return model


def some_inputs(rows: int = 40) -> th.Tensor:
    return th.randn(rows, 4, dtype=th.float64, generator=th.Generator().manual_seed(3)) * 2


def dense_kernel(first: th.Tensor, second: th.Tensor, lengthscale: float, outputscale: float) -> th.Tensor:
    return outputscale**2 * (-0.5 * th.cdist(first, second).square() / lengthscale**2).exp()


def test_posterior_is_equations_60_to_62() -> None:
    model = fitted(lengthscale=2.0, outputscale=1.5, noise_std=0.1)
    x, y, new = model.train_inputs, model.train_targets, some_inputs()
    mean, std = model.posterior.moments(new)
    inverse = (dense_kernel(x, x, 2.0, 1.5) + 0.1**2 * th.eye(len(x))).inverse()
    cross = dense_kernel(new, x, 2.0, 1.5)
    variance = (dense_kernel(new, new, 2.0, 1.5) - cross @ inverse @ cross.T).diagonal()
    th.testing.assert_close(mean.T, cross @ inverse @ y, rtol=0, atol=1e-6)
    th.testing.assert_close(std[0], variance.sqrt(), rtol=0, atol=1e-6)


def test_posterior_is_that_of_scikit_learn() -> None:
    model = fitted(lengthscale=2.0, outputscale=1.5, noise_std=0.1)
    reference = GaussianProcessRegressor(ConstantKernel(1.5**2) * RBF(2.0), alpha=0.1**2, optimizer=None)
    reference.fit(model.train_inputs.numpy(), model.train_targets.numpy())
    expected, expected_std = reference.predict(some_inputs().numpy(), return_std=True)
    mean, std = model.posterior.moments(some_inputs())
    np.testing.assert_allclose(mean.T.numpy(), expected, atol=1e-6)
    np.testing.assert_allclose(std[0].numpy(), np.asarray(expected_std)[:, 0], atol=1e-6)


def test_sparse_posterior_is_the_equation_6_of_titsias() -> None:
    model = fitted(SparseGP, noise_std=0.1, lengthscale=2.0, num_inducing=25)
    x, new, centres = model.train_inputs, some_inputs(), model.posterior.centres[0]
    prior = dense_kernel(centres, centres, 2.0, 3.0) + 1e-9 * th.eye(25)
    between, cross = dense_kernel(centres, x, 2.0, 3.0), dense_kernel(new, centres, 2.0, 3.0)
    inverse = (prior + between @ between.T / 0.1**2).inverse()
    mean, std = model.posterior.moments(new)
    explained = (cross @ prior.inverse() * cross).sum(dim=1) - (cross @ inverse * cross).sum(dim=1)
    th.testing.assert_close(mean.T, cross @ inverse @ between @ model.train_targets / 0.1**2, rtol=0, atol=1e-6)
    th.testing.assert_close(std[0].square(), 9.0 - explained, rtol=0, atol=1e-5)


def test_sparse_mean_is_that_of_gpytorch() -> None:
    model = fitted(SparseGP, noise_std=0.1, lengthscale=2.0, num_inducing=25)
    posterior = model.posterior
    likelihood = gpytorch.likelihoods.GaussianLikelihood().double()
    likelihood.noise = 0.1**2

    class Reference(gpytorch.models.ExactGP):  # type: ignore[misc]  # GPyTorch is untyped
        def __init__(self) -> None:
            super().__init__(model.train_inputs, model.train_targets[:, 0], likelihood)
            base = gpytorch.kernels.ScaleKernel(gpytorch.kernels.RBFKernel()).double()
            base.outputscale, base.base_kernel.lengthscale = 9.0, 2.0
            self.kernel = gpytorch.kernels.InducingPointKernel(base, posterior.centres[0].clone(), likelihood)

        def forward(self, inputs: th.Tensor) -> gpytorch.distributions.MultivariateNormal:
            return gpytorch.distributions.MultivariateNormal(th.zeros_like(inputs[:, 0]), self.kernel(inputs))

    with th.no_grad(), gpytorch.settings.sgpr_diagonal_correction(False):
        expected = Reference().eval()(some_inputs())
        mean, _ = posterior.moments(some_inputs())
    th.testing.assert_close(mean[0], expected.mean, rtol=0, atol=1e-6)


def test_a_sparse_gp_with_all_points_is_the_exact_one() -> None:
    exact, sparse = fitted(points=60, lengthscale=1.0), fitted(SparseGP, points=60, lengthscale=1.0)
    for expected, actual in zip(
        exact.posterior.moments(some_inputs()), sparse.posterior.moments(some_inputs()), strict=True
    ):
        th.testing.assert_close(actual, expected, rtol=0, atol=1e-4)


def test_inducing_points_leave_little_unexplained() -> None:
    model = fitted(points=400)
    inputs = model.train_inputs
    chosen = choose_inducing_points(model.kernel, inputs, 40, 1e-12)
    assert len(set(chosen.tolist())) == 40

    def unexplained(indices: th.Tensor) -> float:
        cross = dense_kernel(inputs, inputs[indices], 10.0, 3.0)
        prior = dense_kernel(inputs[indices], inputs[indices], 10.0, 3.0) + 1e-9 * th.eye(len(indices))
        return float((9.0 - (cross @ prior.inverse() * cross).sum(dim=1)).max())

    assert unexplained(chosen) < 0.2 * unexplained(th.arange(40))


@pytest.mark.parametrize("kind", [ExactGP, SparseGP])
def test_lemma_12_the_std_is_lipschitz_in_the_kernel_metric(kind: type[GaussianProcess]) -> None:
    model = fitted(kind, lengthscale=1.5)
    generator = th.Generator().manual_seed(0)
    first = 3 * th.randn(2_000, 4, dtype=th.float64, generator=generator)
    step = 10 ** (-3 * th.rand(2_000, 1, dtype=th.float64, generator=generator))
    second = first + step * th.randn(2_000, 4, dtype=th.float64, generator=generator)
    with th.no_grad():
        std, other = model.posterior.moments(first)[1], model.posterior.moments(second)[1]
    similarity = (-0.5 * (first - second).square().sum(dim=1) / 1.5**2).exp()
    distance = 3.0 * (2 - 2 * similarity).sqrt()
    assert ((std - other).abs() <= distance + 1e-6).all()
    # The bound is tight: it is nearly reached somewhere.
    assert ((std - other).abs() / distance).max() > 0.5


def test_information_gain_is_equation_63() -> None:
    model = fitted(lengthscale=2.0, outputscale=1.5, noise_std=0.1)
    x = model.train_inputs
    expected = 0.5 * th.logdet(th.eye(len(x)) + dense_kernel(x, x, 2.0, 1.5) / 0.1**2)
    assert model.posterior.information_gain == pytest.approx(2 * float(expected), rel=1e-6)
    width = model.confidence_width(delta=0.05, norm_bound=2.0)
    assert width == pytest.approx(2.0 + 0.4 * math.sqrt(2 * float(expected) + 1 + math.log(20)), rel=1e-6)


def test_hyperparameters_of_the_data_are_found() -> None:
    generator = th.Generator().manual_seed(0)
    states = th.rand(400, 2, generator=generator) * 6 - 3
    noise = 0.05 * th.randn(400, 2, generator=generator)
    # Each output depends on only one input.
    change = th.stack([(1.5 * states[:, 0]).sin(), (1.5 * states[:, 1]).sin()], dim=1)
    dataset = TransitionDataset(2, 1)
    column = th.zeros(400)
    dataset.append_episode(Transitions(states, th.zeros(400, 1), states + change + noise, column, column.bool()))
    fixed, optimised = (ExactGP(2, 1, lengthscale=3.0, optimize_hyperparameters=optimise) for optimise in (False, True))
    reports = [model.fit(dataset, th.Generator().manual_seed(0)) for model in (fixed, optimised)]
    assert reports[1].holdout_nll < reports[0].holdout_nll
    lengthscales = optimised.kernel.base_kernel.lengthscale.detach().squeeze(1)
    assert lengthscales[0, 0] < 2 < lengthscales[0, 1]
    assert lengthscales[1, 1] < 2 < lengthscales[1, 0]
    predicted = optimised.predict(states[:1], th.zeros(1, 1)).aleatoric_std[0]
    th.testing.assert_close(predicted, th.tensor([0.05, 0.05]), rtol=0.3, atol=0)


def test_prediction_does_not_factorise_again(monkeypatch: pytest.MonkeyPatch) -> None:
    model, batch = fitted(), random_transitions(3)

    def refuse(*args: Any, **kwargs: Any) -> ExactPosterior:
        raise AssertionError("factorised again")

    monkeypatch.setattr(ExactPosterior, "condition", refuse)
    model.predict(batch.states, batch.actions)
    model.sample_posterior(th.Generator()).predict(batch.states, batch.actions)


@pytest.mark.parametrize("kind", [ExactGP, SparseGP])
def test_gradients_flow_although_imagination_came_first(kind: type[GaussianProcess]) -> None:
    model, batch = pickle.loads(pickle.dumps(fitted(kind, points=30))), random_transitions(3)
    with th.inference_mode():
        model.predict(batch.states, batch.actions)
    actions = batch.actions.clone().requires_grad_()
    model.predict(batch.states, actions).predictive_std.sum().backward()
    assert actions.grad is not None
    assert (actions.grad != 0).any()


def test_an_impossible_kernel_says_what_to_do() -> None:
    with pytest.raises(ValueError, match=r"matrix of 2 rows is not positive definite.*raise the model's noise_std"):
        safe_cholesky(th.tensor([[1.0, 2.0], [2.0, 1.0]]))
    with pytest.warns(NumericalWarning, match="added jitter"):
        factor = safe_cholesky(th.ones(5, 5, dtype=th.float64))
    th.testing.assert_close(factor @ factor.T, th.ones(5, 5, dtype=th.float64), atol=1e-5, rtol=0)
    for name in ("lengthscale", "outputscale", "noise_std"):
        with pytest.raises(ValueError, match=f"{name} is 0: give a finite number above 0"):
            ExactGP(2, 1, (), **{name: 0})
    with pytest.raises(ValueError, match="num_inducing is 0"):
        SparseGP(2, 1, num_inducing=0)
