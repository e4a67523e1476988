"""What all dynamics models must do."""

import copy
import math
import pickle

import pytest
import torch as th

from helpers import pendulum_dataset, random_transitions
from sb3_hucrl import DynamicsModel, TransitionDataset, Transitions
from sb3_hucrl.dynamics import LEARNED, make_dynamics

FAST: dict[str, dict[str, int]] = {
    "ensemble": {"gradient_steps": 40},
    "deterministic_ensemble": {"gradient_steps": 40},
    "gp": {},
    "sparse_gp": {"num_inducing": 60},
    "rff": {"num_features": 200},
    "qff": {"nodes_per_dim": 4},
}

every_model = pytest.mark.parametrize("name", LEARNED)


def make(name: str, seed: int = 0, steps: int | None = None) -> DynamicsModel:
    settings = FAST[name]
    if steps is not None and "gradient_steps" in settings:
        settings = {"gradient_steps": steps}
    return make_dynamics(name, 2, 1, (0,), th.Generator().manual_seed(seed), **settings)


def fitted(name: str, dataset: TransitionDataset | None = None, steps: int | None = None) -> DynamicsModel:
    """:param steps: number of gradient steps, for models that have them"""
    model = make(name, steps=steps)
    model.fit(dataset or pendulum_dataset(300), th.Generator().manual_seed(0))
    return model


def dataset_of(states: th.Tensor, next_states: th.Tensor) -> TransitionDataset:
    dataset = TransitionDataset(2, 1, holdout_fraction=0.0)
    column = th.zeros(len(states))
    dataset.append_episode(Transitions(states, th.zeros(len(states), 1), next_states, column, column.bool()))
    return dataset


@every_model
def test_predicts_unseen_pendulum_transitions_in_state_units(name: str) -> None:
    model, fresh = fitted(name, steps=200), random_transitions(200, seed=77)
    with th.no_grad():
        prediction = model.predict(fresh.states, fresh.actions)
    assert prediction.mean.shape == prediction.epistemic_std.shape == prediction.aleatoric_std.shape == (200, 2)
    assert prediction.mean.dtype == prediction.predictive_std.dtype == th.float32
    unexplained = (prediction.mean - fresh.next_states).var(dim=0) / (fresh.next_states - fresh.states).var(dim=0)
    assert (unexplained < 0.03).all()
    assert (prediction.epistemic_std > 0).all()
    assert (prediction.aleatoric_std > 0).all()


@every_model
def test_is_differentiable_in_state_and_action(name: str) -> None:
    model = fitted(name, pendulum_dataset(60)).double()
    batch = random_transitions(3, seed=2)
    state, action = batch.states.double().requires_grad_(), batch.actions.double().requires_grad_()

    def outputs(state: th.Tensor, action: th.Tensor) -> tuple[th.Tensor, ...]:
        prediction = model.predict(state, action)
        return prediction.mean, prediction.epistemic_std, prediction.aleatoric_std

    assert th.autograd.gradcheck(outputs, (state, action), atol=1e-4)


@every_model
def test_the_same_seed_gives_the_same_fit(name: str) -> None:
    batch = random_transitions(6)
    first, second = (fitted(name).predict(batch.states, batch.actions) for _ in range(2))
    assert th.equal(first.mean, second.mean)
    assert th.equal(first.predictive_std, second.predictive_std)


@every_model
@pytest.mark.parametrize("way", ["state_dict", "pickle", "deepcopy"])
def test_survives_a_round_trip(name: str, way: str) -> None:
    model = fitted(name)
    if way == "state_dict":
        other = make(name, seed=9)
        other.load_state_dict(model.state_dict())
    else:
        other = pickle.loads(pickle.dumps(model)) if way == "pickle" else copy.deepcopy(model)
    batch = random_transitions(6)
    for before, after in ((model, other), (model.double(), other.double())):
        expected, actual = (each.predict(batch.states.double(), batch.actions.double()) for each in (before, after))
        th.testing.assert_close(actual.mean, expected.mean)
        th.testing.assert_close(actual.epistemic_std, expected.epistemic_std, rtol=1e-4, atol=1e-6)


@every_model
def test_two_points_duplicates_and_constant_dimensions_are_survived(name: str) -> None:
    for rows in (2, 20):
        states = th.ones(rows, 2)
        prediction = fitted(name, dataset_of(states, states), steps=80).predict(states, th.zeros(rows, 1))
        th.testing.assert_close(prediction.mean, states, rtol=0, atol=0.3)
        assert (prediction.predictive_std > 0).all()
    states = random_transitions(50).states
    dataset = dataset_of(states, states + th.tensor([0.1, 0.0]))
    moving = fitted(name, dataset, steps=80).predict(states, th.zeros(50, 1))
    th.testing.assert_close(moving.mean, states + th.tensor([0.1, 0.0]), rtol=0, atol=0.3)


@every_model
def test_too_few_points_are_an_error(name: str) -> None:
    for rows in (0, 1):
        dataset = TransitionDataset(2, 1, holdout_fraction=0.0)
        if rows:
            dataset = dataset_of(th.zeros(rows, 2), th.zeros(rows, 2))
        with pytest.raises(ValueError, match=f"at least 2 training transitions, got {rows}"):
            make(name).fit(dataset, th.Generator())


@every_model
def test_ten_thousand_points(name: str) -> None:
    dataset = pendulum_dataset(10_000)
    if name == "gp":
        with pytest.raises(ValueError, match=r"outgrown the exact GP.*max_points = 5000: use dynamics 'sparse_gp'"):
            make(name).fit(dataset, th.Generator().manual_seed(0))
        return
    report = make(name).fit(dataset, th.Generator().manual_seed(0))
    assert report.num_train > 8_500
    assert math.isfinite(report.holdout_nll)


@every_model
def test_a_second_fit_learns_from_the_new_data(name: str) -> None:
    dataset = dataset_of(*[random_transitions(100, seed=1).states] * 2)
    model = fitted(name, dataset, steps=200)
    real = random_transitions(2_000, seed=2)
    dataset.append_episode(real)
    report = model.fit(dataset, th.Generator().manual_seed(0))
    assert report.num_train == 2_100
    fresh = random_transitions(100, seed=3)
    with th.no_grad():
        error = model.predict(fresh.states, fresh.actions).mean - fresh.next_states
    assert (error.var(dim=0) < 0.1 * (fresh.next_states - fresh.states).var(dim=0)).all()


@every_model
def test_samples_have_the_mean_and_variance_of_the_posterior(name: str) -> None:
    model = fitted(name, pendulum_dataset(60))
    batch = random_transitions(4, seed=5)
    # States between the data and far outside of them, so that the posterior is wide.
    batch.states[2:, 1] += 30.0
    draws = 2_000
    with th.no_grad():
        expected = model.predict(batch.states, batch.actions)
        many = model.sample_posterior(th.Generator().manual_seed(1), draws).predict(
            batch.states.repeat_interleave(draws, dim=0), batch.actions.repeat_interleave(draws, dim=0)
        )
    samples = many.mean.view(4, draws, 2)
    # 5 standard errors: all 8 means are within them with probability 1 - 5e-6. Samples of a function process use
    # 512 random frequencies, which adds some per cent to the error of their standard deviation.
    standard_error = expected.epistemic_std / math.sqrt(draws)
    assert ((samples.mean(dim=1) - expected.mean).abs() < 5 * standard_error + 1e-5).all()
    th.testing.assert_close(samples.std(dim=1), expected.epistemic_std, rtol=0.15, atol=1e-4)
    th.testing.assert_close(
        many.aleatoric_std.view(4, draws, 2).square().mean(dim=1).sqrt(), expected.aleatoric_std, rtol=0.1, atol=1e-5
    )


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"unknown dynamics 'tree': choose one of \['deterministic_ensemble', 'ense"):
        make_dynamics("tree", 2, 1, (), th.Generator())
    with pytest.raises(ValueError, match=r"\(did you mean 'ensemble'\?\)"):
        make_dynamics("ensembel", 2, 1, (), th.Generator())


@every_model
def test_diagnoses_the_information_gain_where_there_is_one(name: str) -> None:
    diagnostics = fitted(name, steps=1).diagnostics()
    if name.endswith("ensemble"):
        assert diagnostics == {}
    else:
        assert list(diagnostics) == ["information_gain"]
        assert diagnostics["information_gain"] > 0
