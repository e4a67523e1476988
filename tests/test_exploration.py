"""How predictions and hallucinated actions become next states."""

import pytest
import torch as th

from sb3_hucrl import Greedy, Optimistic, Prediction
from sb3_hucrl.exploration import make_strategy


def prediction(aleatoric: float = 0.0, rows: int = 3) -> Prediction:
    mean = th.arange(2.0 * rows).reshape(rows, 2)
    return Prediction(mean, th.tensor([0.5, 2.0]).expand(rows, 2), th.full((rows, 2), aleatoric))


@pytest.mark.parametrize("beta", [0.1, 1.0, 7.5])
@pytest.mark.parametrize("scale", [-3.0, -1.0, 0.0, 0.4, 1.0, 1.01, 50.0])
def test_optimism_stays_inside_the_confidence_region_and_reaches_its_corners(beta: float, scale: float) -> None:
    predicted = prediction()
    hallucinated = th.full((3, 2), scale)
    next_state = Optimistic(beta).next_state(predicted, hallucinated, None)
    expected = predicted.mean + beta * max(-1.0, min(1.0, scale)) * predicted.epistemic_std
    th.testing.assert_close(next_state, expected, rtol=1e-4, atol=1e-5)


def test_beta_zero_is_the_mean_model() -> None:
    predicted = prediction()
    assert th.equal(Optimistic(beta=0.0).next_state(predicted, th.ones(3, 2), None), predicted.mean)


def test_predictive_uncertainty_steers_with_the_noise_too() -> None:
    predicted = prediction(aleatoric=3.0, rows=20_000)
    for uncertainty, std in (("epistemic", predicted.epistemic_std), ("predictive", predicted.predictive_std)):
        strategy = make_strategy("optimistic", beta=2.0, uncertainty=uncertainty)
        drawn = strategy.next_state(predicted, th.ones(20_000, 2), th.Generator().manual_seed(0)) - predicted.mean
        # Five standard errors of a mean over 20,000 draws of standard deviation 3.
        assert ((drawn.mean(dim=0) - 2.0 * std[0]).abs() < 0.11).all()
        assert ((drawn.std(dim=0) - 3.0).abs() < 0.08).all()


def test_greedy_draws_from_the_predictive_distribution_and_ignores_the_hallucinated_action() -> None:
    predicted = prediction(aleatoric=1.5, rows=20_000)
    draws = [Greedy().next_state(predicted, th.ones(20_000, dim), th.Generator().manual_seed(1)) for dim in (0, 2)]
    assert th.equal(draws[0], draws[1])
    error = draws[0] - predicted.mean
    assert (error.mean(dim=0).abs() < 5 * predicted.predictive_std[0] / 141).all()
    th.testing.assert_close(error.std(dim=0), predicted.predictive_std[0], rtol=0.03, atol=0)


def test_only_optimism_widens_the_action() -> None:
    assert Optimistic().hallucinated_dim(4) == 4
    assert Greedy().hallucinated_dim(4) == 0


def test_bad_input_says_what_to_do() -> None:
    with pytest.raises(ValueError, match="beta is -1"):
        Optimistic(beta=-1.0)
    with pytest.raises(ValueError, match="beta is nan"):
        Optimistic(beta=float("nan"))
    with pytest.raises(ValueError, match="unknown uncertainty 'total'"):
        make_strategy("optimistic", uncertainty="total")
    with pytest.raises(ValueError, match=r"unknown exploration 'brave': choose one of \['greedy', 'optimistic'\]"):
        make_strategy("brave")
