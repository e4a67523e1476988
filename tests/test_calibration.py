"""Calibration and recalibration."""

import numpy as np
import pytest
import torch as th
from scipy import stats
from uncertainty_toolbox.metrics_calibration import get_proportion_lists_vectorized, mean_absolute_calibration_error

from helpers import pendulum_dataset
from sb3_hucrl.dynamics import make_dynamics
from sb3_hucrl.dynamics.calibration import (
    LEVELS,
    MIN_HOLDOUT,
    Calibration,
    calibration_error,
    gaussian_nll,
    recalibration_scale,
    reliability,
)


def test_nll_is_that_of_scipy() -> None:
    error, std = th.tensor([[0.3, -1.0]]), th.tensor([[0.5, 2.0]])
    expected = -sum(stats.norm(0, s).logpdf(e) for e, s in zip(error[0].tolist(), std[0].tolist(), strict=True))
    assert float(gaussian_nll(error, std)) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("scale", "low", "high"), [(1.0, 0.0, 0.02), (10.0, 0.15, 0.3), (0.1, 0.15, 0.3)])
def test_calibration_error_tells_over_and_underconfidence(scale: float, low: float, high: float) -> None:
    error = th.randn(5_000, 2, generator=th.Generator().manual_seed(0))
    measured = calibration_error(reliability(error, scale * th.ones_like(error)))
    assert measured.shape == (2,)
    assert ((measured >= low) & (measured <= high)).all()


def test_reliability_is_that_of_scipy() -> None:
    generator = th.Generator().manual_seed(0)
    error, std = th.randn(300, 2, generator=generator), 0.5 + th.rand(300, 2, generator=generator)
    curve = reliability(error, std)
    for dim in range(2):
        for index, level in enumerate(LEVELS.tolist()):
            below = error[:, dim].numpy() <= stats.norm(0, std[:, dim].numpy()).ppf(level)
            assert float(curve[index, dim]) == pytest.approx(below.mean(), abs=1e-6)


def test_calibration_is_that_of_uncertainty_toolbox() -> None:
    generator = th.Generator().manual_seed(0)
    error, std = 0.3 + th.randn(300, 2, generator=generator), 0.3 + th.rand(300, 2, generator=generator)
    curve, measured = reliability(error, std), calibration_error(reliability(error, std))
    scale = recalibration_scale(error, std).tolist()
    for dim in range(2):
        # It counts how often the truth is below the prediction's quantile, from that prediction's side.
        theirs = error[:, dim].numpy(), std[:, dim].numpy(), np.zeros(300)
        levels, coverage = get_proportion_lists_vectorized(*theirs, num_bins=21, prop_type="quantile")
        np.testing.assert_allclose(levels[1:-1], LEVELS, atol=1e-6)
        np.testing.assert_allclose(curve[:, dim], coverage[1:-1], atol=1e-6)
        # Its mean includes the levels 0 and 1, where there is no error.
        mean = mean_absolute_calibration_error(*theirs, num_bins=21, prop_type="quantile")
        assert float(measured[dim]) == pytest.approx(mean * 21 / 19, abs=1e-6)
        # By their measure, too, no other factor is better.
        factors = [scale[dim], scale[dim] * 1.13, scale[dim] / 1.13, scale[dim] * 2, 1.0]
        errors = [
            mean_absolute_calibration_error(theirs[0], factor * theirs[1], theirs[2], num_bins=21, prop_type="quantile")
            for factor in factors
        ]
        assert min(errors) == pytest.approx(errors[0], abs=1e-6)
        assert errors[0] < errors[-1]


@pytest.mark.parametrize("wrong", [0.05, 0.5, 1.0, 3.0, 20.0])
def test_recalibration_finds_the_factor(wrong: float) -> None:
    error = th.randn(4_000, 2, generator=th.Generator().manual_seed(0)) * th.tensor([1.0, 0.1])
    std = wrong * th.tensor([1.0, 0.1]).expand_as(error)
    scale = recalibration_scale(error, std)
    # The grid is 12 % wide, the standard error of a std over 4,000 errors 1 %.
    assert ((scale * wrong > 0.88) & (scale * wrong < 1.14)).all()
    calibration = Calibration.measure(error, std, scale)
    assert (calibration.error < 0.02).all()
    assert (calibration.error <= calibration.raw_error).all()


def test_few_transitions_are_not_recalibrated_on() -> None:
    error = th.randn(MIN_HOLDOUT - 1, 2)
    assert th.equal(recalibration_scale(error, 50 * th.ones_like(error)), th.ones(2))


def test_a_recalibrated_model_predicts_with_the_scaled_std() -> None:
    dataset = pendulum_dataset(400)
    models = [make_dynamics("sparse_gp", 2, 1, (0,), th.Generator(), recalibrate=repair) for repair in (False, True)]
    reports = [model.fit(dataset, th.Generator().manual_seed(0)) for model in models]
    batch = dataset.holdout
    with th.no_grad():
        before, after = (model.predict(batch.states, batch.actions) for model in models)
    scale = reports[1].calibration.scale
    assert th.equal(reports[0].calibration.scale, th.ones(2))
    assert (scale < 0.9).all()
    th.testing.assert_close(after.epistemic_std, scale * before.epistemic_std)
    th.testing.assert_close(after.aleatoric_std, scale * before.aleatoric_std)
    th.testing.assert_close(reports[1].calibration.raw_error, reports[0].calibration.error)
    assert (reports[1].calibration.error < reports[0].calibration.error).all()
    assert reports[1].holdout_nll < reports[0].holdout_nll
