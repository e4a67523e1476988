"""Exploration strategies: next states from predictions and hallucinated actions."""

import pytest
import torch as th

from helpers import TruePendulum, pendulum_dataset, random_transitions
from sb3_hucrl import Bonus, DynamicsModel, ExplorationStrategy, Greedy, Optimistic, Prediction, Thompson
from sb3_hucrl.dynamics import Predictor, make_dynamics
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
    for strategy in (Greedy(), Thompson(), Bonus()):
        assert strategy.hallucinated_dim(4) == 0


def fitted_ensemble() -> DynamicsModel:
    model = make_dynamics("ensemble", 2, 1, (0,), th.Generator().manual_seed(0), gradient_steps=30)
    model.fit(pendulum_dataset(100), th.Generator().manual_seed(0))
    return model


def member_of_each_row(model: DynamicsModel, predictor: Predictor, rows: int) -> list[int]:
    """Index of the ensemble member that predicts each row."""
    batch = random_transitions(1)
    states, actions = batch.states.expand(rows, 2), batch.actions.expand(rows, 1)
    with th.no_grad():
        generator = th.Generator().manual_seed(5)
        drawn = [model.sample_posterior(generator).predict(states[:1], actions[:1]).mean[0] for _ in range(80)]
        known = th.stack(drawn).unique(dim=0)
        assert len(known) == 5
        mean = predictor.predict(states, actions).mean
    nearest: list[int] = (mean.unsqueeze(1) - known).abs().sum(dim=2).argmin(dim=1).tolist()
    return nearest


def test_ts1_draws_members_anew_at_each_step_and_tsinf_keeps_them() -> None:
    model, rows = fitted_ensemble(), 64
    for propagation, kept in (("ts1", False), ("tsinf", True)):
        strategy = make_strategy("greedy", propagation=propagation)
        predictor = strategy.predictor(model, rows, th.Generator().manual_seed(0))
        first, second = (member_of_each_row(model, predictor, rows) for _ in range(2))
        # 64 rows miss one of 5 members with a probability of 3e-6.
        assert set(first) == set(range(5))
        assert (first == second) is kept
    assert Greedy("ds").predictor(model, rows, th.Generator()) is model


def test_thompson_draws_one_member_for_each_search() -> None:
    model, generator = fitted_ensemble(), th.Generator().manual_seed(0)
    searches = [Thompson().predictor(model, 8, generator) for _ in range(20)]
    members = [member_of_each_row(model, search, 8) for search in searches]
    assert all(len(set(rows)) == 1 for rows in members)
    assert len({rows[0] for rows in members}) > 1
    predicted = prediction(rows=2)
    assert th.equal(Thompson().next_state(predicted, th.ones(2, 0), None), predicted.mean)


def test_bonus_pays_for_uncertainty_and_fades() -> None:
    strategy, predicted, model = Bonus(weight=2.0, decay=0.5), prediction(), TruePendulum()
    norm = (0.5**2 + 2.0**2) ** 0.5
    for real_episodes, weight in ((1, 2.0), (2, 1.0), (4, 0.25)):
        adapted = strategy.adapted(model, real_episodes)
        assert adapted.predictor(model, 8, th.Generator()) is model
        assert adapted.diagnostics() == {"bonus_weight": weight}
        bonus = adapted.bonus(predicted)
        assert bonus is not None
        th.testing.assert_close(bonus, th.full((3,), weight * norm))
    assert th.equal(strategy.next_state(predicted, th.ones(3, 0), None), predicted.mean)
    assert Optimistic().bonus(predicted) is None


def test_theoretical_beta_follows_the_information_gain() -> None:
    strategy = make_strategy("optimistic", beta="theory", delta=0.05, norm_bound=2.0)
    model = make_dynamics("sparse_gp", 2, 1, (0,), th.Generator())
    widths = []
    for points in (50, 500):
        model.fit(pendulum_dataset(points), th.Generator().manual_seed(0))
        adapted = strategy.adapted(model, 1)
        assert adapted.diagnostics() == {"beta": model.confidence_width(0.05, 2.0)}
        widths.append(model.confidence_width(0.05, 2.0))
    assert 2.0 < widths[0] < widths[1]
    predicted = prediction()
    raised = adapted.next_state(predicted, th.ones(3, 2), None) - predicted.mean
    th.testing.assert_close(raised, widths[1] * predicted.epistemic_std)
    with pytest.raises(ValueError, match="beta is 'theory', which needs a Gaussian process or Fourier features"):
        strategy.adapted(fitted_ensemble(), 1)
    assert strategy.diagnostics() == {}
    with pytest.raises(ValueError, match=r"beta is 'theory': call adapted"):
        strategy.next_state(predicted, th.ones(3, 2), None)


class Plain(ExplorationStrategy):
    """A user's strategy that is not a dataclass."""

    def __init__(self, shift: float) -> None:
        self.shift = shift

    def next_state(
        self, prediction: Prediction, hallucinated_action: th.Tensor, generator: th.Generator | None
    ) -> th.Tensor:
        return prediction.mean + self.shift


def test_a_users_plain_class_needs_only_the_next_state() -> None:
    strategy, model, predicted = Plain(shift=2.0), TruePendulum(), prediction()
    assert strategy.adapted(model, 3) is strategy
    assert strategy.predictor(model, 8, th.Generator()) is model
    assert strategy.diagnostics() == {}
    assert th.equal(strategy.next_state(predicted, th.ones(3, 0), None), predicted.mean + 2.0)


def test_the_built_in_strategies_are_immutable_values() -> None:
    model = TruePendulum()
    for strategy in (Optimistic(), Greedy(), Thompson(), Bonus()):
        assert strategy.adapted(model, 5) == strategy
        with pytest.raises(AttributeError):
            strategy.beta = 3.0  # type: ignore[misc, union-attr]  # frozen
    assert Optimistic(2.0) == Optimistic(beta=2.0) != Optimistic(1.0)


def test_bad_input_says_what_to_do() -> None:
    with pytest.raises(ValueError, match="beta is -1"):
        Optimistic(beta=-1.0)
    with pytest.raises(ValueError, match="beta is nan"):
        Optimistic(beta=float("nan"))
    with pytest.raises(ValueError, match="uncertainty is 'total': give 'epistemic' or 'predictive'"):
        make_strategy("optimistic", uncertainty="total")
    with pytest.raises(ValueError, match="beta is 'large': give a finite number of at least 0 or 'theory'"):
        make_strategy("optimistic", beta="large")
    with pytest.raises(ValueError, match=r"delta is 1\.0: give a probability"):
        Optimistic(delta=1.0)
    with pytest.raises(ValueError, match="propagation is 'ts2': give 'ds', 'ts1' or 'tsinf'"):
        make_strategy("greedy", propagation="ts2")
    with pytest.raises(ValueError, match="weight is -1"):
        Bonus(weight=-1.0)
    with pytest.raises(ValueError, match=r"decay is 1\.5"):
        Bonus(decay=1.5)
    with pytest.raises(ValueError, match=r"unknown exploration 'brave': choose one of \['bonus', 'greedy', 'optimist"):
        make_strategy("brave")


def test_a_model_without_samples_says_so() -> None:
    with pytest.raises(ValueError, match="TruePendulum has no posterior samples"):
        Thompson().predictor(TruePendulum(), 8, th.Generator())
