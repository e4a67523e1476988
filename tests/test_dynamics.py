"""The probabilistic ensemble, its inputs and its calibration."""

import math

import pytest
import torch as th
from scipy import stats

from helpers import pendulum_dataset, random_transitions
from sb3_hucrl import ProbabilisticEnsemble, TransitionDataset, Transitions
from sb3_hucrl.dynamics import make_dynamics
from sb3_hucrl.dynamics.calibration import calibration_error, gaussian_nll
from sb3_hucrl.dynamics.ensemble import BatchedLinear
from sb3_hucrl.dynamics.features import StateFeatures


def ensemble(seed: int = 0, gradient_steps: int = 500) -> ProbabilisticEnsemble:
    generator = th.Generator().manual_seed(seed)
    return ProbabilisticEnsemble(2, 1, angle_dims=(0,), gradient_steps=gradient_steps, generator=generator)


def test_predicts_held_out_pendulum_transitions() -> None:
    model = ensemble(gradient_steps=1_500)
    report = model.fit(pendulum_dataset(2_000), th.Generator().manual_seed(0))
    fresh = random_transitions(500, seed=77)
    with th.no_grad():
        prediction = model.predict(fresh.states, fresh.actions)
    unexplained = (prediction.mean - fresh.next_states).var(dim=0) / (fresh.next_states - fresh.states).var(dim=0)
    assert (unexplained < 0.01).all()
    assert report.num_train > 1_700
    assert report.holdout_nll < -4
    assert report.calibration_error < 0.3


def test_epistemic_std_grows_away_from_the_data() -> None:
    model = ensemble()
    model.fit(pendulum_dataset(1_000), th.Generator().manual_seed(0))
    seen = random_transitions(100, seed=5)
    far = seen.states + th.tensor([0.0, 60.0])
    with th.no_grad():
        near_std = model.predict(seen.states, seen.actions).epistemic_std.mean(dim=0)
        far_std = model.predict(far, seen.actions).epistemic_std.mean(dim=0)
    assert (far_std > 5 * near_std).all()


def test_aleatoric_std_finds_the_noise_of_the_data() -> None:
    generator = th.Generator().manual_seed(0)
    clean = random_transitions(3_000)
    noise = 0.3 * th.randn(3_000, generator=generator)
    next_states = clean.next_states + th.stack([th.zeros(3_000), noise], dim=1)
    dataset = TransitionDataset(2, 1)
    dataset.append_episode(Transitions(clean.states, clean.actions, next_states, clean.rewards, clean.terminated))
    model = ensemble(gradient_steps=1_500)
    model.fit(dataset, generator)
    with th.no_grad():
        prediction = model.predict(clean.states, clean.actions)
    assert 0.2 < float(prediction.aleatoric_std[:, 1].mean()) < 0.4
    error = calibration_error(next_states - prediction.mean, prediction.predictive_std)
    assert float(error[1]) < 0.06


def test_moments_are_those_of_the_members() -> None:
    model = ensemble(gradient_steps=50)
    model.fit(pendulum_dataset(100), th.Generator().manual_seed(0))
    batch = random_transitions(7, seed=1)
    inputs = model.inputs(th.cat([model.features(batch.states), batch.actions], dim=1))
    means, variances = [], []
    for member in range(model.num_members):
        # One member at a time, through its own weights.
        hidden = inputs
        for index, layer in enumerate(model.layers):
            assert isinstance(layer, BatchedLinear)
            hidden = hidden @ layer.weight[member] + layer.bias[member]
            if index < len(model.layers) - 1:
                hidden = th.nn.functional.silu(hidden)
        means.append(batch.states + hidden[:, :2] * model.deltas.std + model.deltas.mean)
        variances.append(model.noise_variance(hidden[:, 2:]) * model.deltas.std**2)
    prediction = model.predict(batch.states, batch.actions)
    th.testing.assert_close(prediction.mean, th.stack(means).mean(dim=0))
    th.testing.assert_close(prediction.epistemic_std, th.stack(means).std(dim=0, correction=0), rtol=1e-3, atol=1e-5)
    th.testing.assert_close(prediction.aleatoric_std, th.stack(variances).mean(dim=0).sqrt())


def test_is_differentiable_in_state_and_action() -> None:
    model = ensemble(gradient_steps=100)
    model.fit(pendulum_dataset(200), th.Generator().manual_seed(0))
    model.double()
    batch = random_transitions(4, seed=2)
    state, action = batch.states.double().requires_grad_(), batch.actions.double().requires_grad_()

    def outputs(state: th.Tensor, action: th.Tensor) -> tuple[th.Tensor, ...]:
        prediction = model.predict(state, action)
        return prediction.mean, prediction.epistemic_std, prediction.aleatoric_std

    assert th.autograd.gradcheck(outputs, (state, action))


def test_same_generator_same_fit_and_state_dict_round_trip() -> None:
    fitted = [ensemble(gradient_steps=30) for _ in range(2)]
    for model in fitted:
        model.fit(pendulum_dataset(100), th.Generator().manual_seed(4))
    other = ensemble(seed=9)
    other.load_state_dict(fitted[1].state_dict())
    batch = random_transitions(6)
    for model in (fitted[1], other):
        assert th.equal(
            model.predict(batch.states, batch.actions).mean, fitted[0].predict(batch.states, batch.actions).mean
        )


def test_survives_duplicates_and_a_constant_dimension() -> None:
    dataset = TransitionDataset(2, 1)
    states, column = th.ones(20, 2), th.zeros(20)
    dataset.append_episode(Transitions(states, th.zeros(20, 1), states, column, column.bool()))
    model = ensemble(gradient_steps=20)
    model.fit(dataset, th.Generator().manual_seed(0))
    prediction = model.predict(states, th.zeros(20, 1))
    assert th.isfinite(prediction.mean).all()
    assert (prediction.predictive_std > 0).all()


def test_bad_input_says_what_to_do() -> None:
    with pytest.raises(ValueError, match="at least 2 training transitions"):
        ensemble().fit(TransitionDataset(2, 1), th.Generator())
    with pytest.raises(ValueError, match="num_members is 1"):
        ProbabilisticEnsemble(2, 1, num_members=1)
    with pytest.raises(ValueError, match=r"angle_dims \[2\] lie outside"):
        StateFeatures(2, [2])
    with pytest.raises(ValueError, match=r"unknown dynamics 'tree': choose one of \['ensemble'\]"):
        make_dynamics("tree", 2, 1, (), th.Generator())


def test_divergence_of_the_fit_is_an_error() -> None:
    model = ProbabilisticEnsemble(2, 1, learning_rate=1e30, gradient_steps=20)
    with pytest.raises(ValueError, match="lower learning_rate"):
        model.fit(pendulum_dataset(100), th.Generator().manual_seed(0))


def test_angles_enter_as_sine_and_cosine_and_differences_are_wrapped() -> None:
    features = StateFeatures(3, [1])
    state = th.tensor([[0.5, math.pi - 0.1, -2.0]])
    th.testing.assert_close(features(state), th.tensor([[math.sin(math.pi - 0.1), math.cos(math.pi - 0.1), 0.5, -2.0]]))
    across = th.tensor([[0.5, -math.pi + 0.1, -1.0]])
    th.testing.assert_close(features.difference(across, state), th.tensor([[0.0, 0.2, 1.0]]))


def test_nll_is_that_of_scipy() -> None:
    error, std = th.tensor([[0.3, -1.0]]), th.tensor([[0.5, 2.0]])
    expected = -sum(stats.norm(0, s).logpdf(e) for e, s in zip(error[0].tolist(), std[0].tolist(), strict=True))
    assert float(gaussian_nll(error, std)) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("scale", "low", "high"), [(1.0, 0.0, 0.02), (10.0, 0.15, 0.3), (0.1, 0.15, 0.3)])
def test_calibration_error_tells_over_and_underconfidence(scale: float, low: float, high: float) -> None:
    error = th.randn(5_000, 2, generator=th.Generator().manual_seed(0))
    measured = calibration_error(error, scale * th.ones_like(error))
    assert measured.shape == (2,)
    assert ((measured >= low) & (measured <= high)).all()


def test_a_large_batch_is_predicted_as_its_rows_are() -> None:
    model = ensemble(gradient_steps=20)
    model.fit(pendulum_dataset(100), th.Generator().manual_seed(0))
    batch = random_transitions(2_500)
    with th.no_grad():
        together = model.predict(batch.states, batch.actions)
        apart = model.predict(batch.states[1_020:1_030], batch.actions[1_020:1_030])
    th.testing.assert_close(together.mean[1_020:1_030], apart.mean)
    th.testing.assert_close(together.aleatoric_std[1_020:1_030], apart.aleatoric_std)
