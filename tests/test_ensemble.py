"""Ensembles of networks."""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest
import torch as th

from helpers import pendulum_dataset, random_transitions
from sb3_hucrl import ProbabilisticEnsemble, TransitionDataset, Transitions
from sb3_hucrl.dynamics import DeterministicEnsemble
from sb3_hucrl.dynamics.calibration import calibration_error, reliability
from sb3_hucrl.dynamics.ensemble import Ensemble
from sb3_hucrl.dynamics.networks import BatchedLinear


def ensemble(seed: int = 0, gradient_steps: int = 500, **kwargs: Any) -> ProbabilisticEnsemble:
    generator = th.Generator().manual_seed(seed)
    return ProbabilisticEnsemble(2, 1, angle_dims=(0,), gradient_steps=gradient_steps, generator=generator, **kwargs)


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
    assert (report.calibration.error < 0.3).all()


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
    error = calibration_error(reliability(next_states - prediction.mean, prediction.predictive_std))
    assert float(error[1]) < 0.06


@pytest.mark.parametrize("impacts", [0.0, 0.02])
def test_deterministic_ensemble_finds_the_noise_of_the_data_and_not_that_of_rare_impacts(impacts: float) -> None:
    model = DeterministicEnsemble(2, 1, (0,), generator=th.Generator().manual_seed(0))
    clean, generator = random_transitions(2_000), th.Generator().manual_seed(1)
    noise = th.tensor([0.0, 0.3]) * th.randn(2_000, 2, generator=generator)
    # Without the normal noise's share, these alone have a standard deviation of 0.5.
    noise[:, 1] += 3.5 * (th.rand(2_000, generator=generator) < impacts)
    dataset = TransitionDataset(2, 1)
    dataset.append_episode(
        Transitions(clean.states, clean.actions, clean.next_states + noise, clean.rewards, clean.terminated)
    )
    model.fit(dataset, th.Generator().manual_seed(0))
    with th.no_grad():
        aleatoric = model.predict(clean.states, clean.actions).aleatoric_std
    assert (aleatoric == aleatoric[0]).all()
    assert 0.25 < float(aleatoric[0, 1]) < 0.35
    assert float(aleatoric[0, 0]) < 0.01


def test_moments_are_those_of_the_members() -> None:
    model = ensemble(gradient_steps=50)
    model.fit(pendulum_dataset(100), th.Generator().manual_seed(0))
    batch = random_transitions(7, seed=1)
    inputs = model.inputs(model.encode(batch.states, batch.actions))
    means, variances = [], []
    for member in range(model.num_members):
        # One member at a time, through its own weights.
        hidden = inputs
        for index, layer in enumerate(model.networks.layers):
            assert isinstance(layer, BatchedLinear)
            hidden = hidden @ layer.weight[member] + layer.bias[member]
            if index < len(model.networks.layers) - 1:
                hidden = th.nn.functional.silu(hidden)
        means.append(batch.states + hidden[:, :2] * model.deltas.std + model.deltas.mean)
        variances.append(model._noise(hidden[:, 2:]) * model.deltas.std**2)
    prediction = model.predict(batch.states, batch.actions)
    th.testing.assert_close(prediction.mean, th.stack(means).mean(dim=0))
    th.testing.assert_close(prediction.epistemic_std, th.stack(means).std(dim=0, correction=0), rtol=1e-3, atol=1e-5)
    th.testing.assert_close(prediction.aleatoric_std, th.stack(variances).mean(dim=0).sqrt())


@pytest.mark.parametrize("kind", [ProbabilisticEnsemble, DeterministicEnsemble])
def test_posterior_samples_are_members(kind: type[Ensemble]) -> None:
    model = kind(2, 1, (0,), gradient_steps=50, generator=th.Generator().manual_seed(0))
    model.fit(pendulum_dataset(100), th.Generator().manual_seed(0))
    batch = random_transitions(6, seed=1)
    generator = th.Generator().manual_seed(3)
    with th.no_grad():
        alone = [model.sample_posterior(generator) for _ in range(60)]
        means = {tuple(sample.predict(batch.states, batch.actions).mean.flatten().tolist()) for sample in alone}
        # 60 draws miss one of 5 members with a probability of 1e-5.
        assert len(means) == model.num_members
        average = th.tensor(sorted(means)).mean(dim=0).view(6, 2)
        th.testing.assert_close(average, model.predict(batch.states, batch.actions).mean)
        mixed = model.sample_posterior(generator, 3).predict(batch.states, batch.actions)
        repeated = th.cat([batch.states[3:], batch.states[:3]]), th.cat([batch.actions[3:], batch.actions[:3]])
        swapped = model.sample_posterior(generator.manual_seed(3), 3)
        th.testing.assert_close(
            swapped.predict(*repeated).mean.roll(3, 0), swapped.predict(batch.states, batch.actions).mean
        )
    assert (mixed.epistemic_std == 0).all()
    rows = mixed.mean.tolist()
    columns = [{tuple(mean[2 * row : 2 * row + 2]) for mean in means} for row in range(6)]
    for row, column in zip(rows, columns, strict=True):
        assert min(abs(a - row[0]) + abs(b - row[1]) for a, b in column) < 1e-5


def test_one_member_predicts_each_row_and_every_one_as_often() -> None:
    model = ensemble(gradient_steps=20, layer_norm=True)
    model.fit(pendulum_dataset(100), th.Generator().manual_seed(0))
    batch = random_transitions(12, seed=1)
    sampled, draws = model.resampled(th.Generator().manual_seed(2)), 2_000
    with th.no_grad():
        means = th.stack([model.member(each).predict(batch.states, batch.actions).mean for each in range(5)])
        found = th.zeros(12, 5)
        for _ in range(draws):
            prediction = sampled.predict(batch.states, batch.actions)
            distance = (prediction.mean - means).abs().amax(dim=2)
            assert distance.amin(dim=0).max() < 1e-5
            found += th.nn.functional.one_hot(distance.argmin(dim=0), 5)
    assert (prediction.epistemic_std == 0).all()
    # 12 rows are no multiple of 5 members. Pearson's statistic of each row has 4 degrees of freedom: with equal
    # probabilities, one of the 12 exceeds 27.7 in one of 5,000 tests.
    expected = draws / 5
    assert ((found - expected).square() / expected).sum(dim=1).max() < 27.7


def test_hidden_layers_are_normalised_if_asked_for() -> None:
    plain, normalised = ensemble(gradient_steps=1), ensemble(gradient_steps=1, layer_norm=True)
    inputs = th.randn(5, 8, plain.input_dim, generator=th.Generator().manual_seed(0))
    # Whatever is the same for all units of a layer, and its scale, is gone.
    for model in (plain, normalised):
        weight, bias, *_ = model.networks.parameters()
        weight.data.mul_(1_000)
        bias.data.zero_()
    assert plain.networks(inputs).abs().max() > 30
    assert normalised.networks(inputs).abs().max() < 10


def test_a_linear_path_lets_normalised_members_disagree_where_there_are_no_data() -> None:
    def linear(state: th.Tensor, action: th.Tensor) -> th.Tensor:
        return state + 0.1 * (state @ th.tensor([[0.0, -1.0], [2.0, 0.5]]) + action)

    def transitions(size: float, seed: int) -> Transitions:
        generator = th.Generator().manual_seed(seed)
        states, actions = size * th.randn(200, 2, generator=generator), th.randn(200, 1, generator=generator)
        nothing = th.zeros(200)
        return Transitions(states, actions, linear(states, actions), nothing, nothing.bool())

    dataset, far = TransitionDataset(2, 1), transitions(10.0, seed=1)
    dataset.append_episode(transitions(1.0, seed=0))
    covered = []
    for linear_path in (True, False):
        generator = th.Generator().manual_seed(0)
        model = DeterministicEnsemble(2, 1, layer_norm=True, linear_path=linear_path, generator=generator)
        model.fit(dataset, th.Generator().manual_seed(0))
        prediction = model.predict(far.states, far.actions)
        error = (prediction.mean - far.next_states).abs()
        covered.append(float((error < 2 * prediction.epistemic_std).float().mean()))
    assert covered[0] > 0.9
    assert covered[1] < 0.2


def test_a_linear_path_needs_as_many_units_at_its_end() -> None:
    with pytest.raises(ValueError, match=r"net_arch is \[64, 32\]: give widths whose first and last one are the same"):
        ensemble(net_arch=[64, 32], linear_path=True)


def test_normalised_networks_do_not_jump_at_the_mean_of_the_data() -> None:
    model = ensemble(layer_norm=True)
    networks = model.networks
    step = 1e-3 * th.randn(5, 64, model.input_dim, generator=th.Generator().manual_seed(0))
    with th.no_grad():
        assert (networks(step) - networks(-step)).abs().max() < 0.05 * networks(1e3 * step).std()


def test_weights_decay_if_asked_for() -> None:
    sizes = []
    for decay in (0.0, 1.0):
        model = ensemble(gradient_steps=300, weight_decay=decay)
        model.fit(pendulum_dataset(100), th.Generator().manual_seed(0))
        sizes.append(float(th.nn.utils.parameters_to_vector(model.parameters()).norm()))
    assert sizes[1] < 0.9 * sizes[0]


def test_refits_are_as_long_as_there_are_new_transitions(monkeypatch: pytest.MonkeyPatch) -> None:
    phases: list[int] = []

    def begin_phase(name: str, total: int) -> Callable[[int], None]:
        phases.append(total)
        return lambda _: None

    monkeypatch.setattr("sb3_hucrl.dynamics.ensemble.begin_phase", begin_phase)
    model, dataset = ensemble(gradient_steps=60, steps_per_transition=0.5), pendulum_dataset(100)
    trained_on = [0]
    for new in (40, 400, 0):
        model.fit(dataset, th.Generator().manual_seed(0))
        trained_on.append(len(dataset.train))
        if new:
            dataset.append_episode(random_transitions(new, seed=new))
    first, second = (math.ceil(0.5 * (after - before)) for before, after in pairwise(trained_on[:3]))
    assert phases == [first, second, 60]


def test_gradients_go_to_states_and_actions_and_not_to_a_fitted_model() -> None:
    model = ensemble(gradient_steps=5)
    model.fit(pendulum_dataset(100), th.Generator().manual_seed(0))
    batch = random_transitions(4)
    actions = batch.actions.clone().requires_grad_()
    model.predict(batch.states, actions).mean.sum().backward()
    assert actions.grad is not None
    assert all(parameter.grad is None or not parameter.requires_grad for parameter in model.parameters())


def test_each_member_is_a_model_of_its_own() -> None:
    model = ensemble(gradient_steps=20)
    model.fit(pendulum_dataset(100), th.Generator().manual_seed(0))
    batch = random_transitions(6, seed=1)
    with th.no_grad():
        whole = model.predict(batch.states, batch.actions)
        alone = [model.member(index).predict(batch.states, batch.actions) for index in range(model.num_members)]
    means = th.stack([prediction.mean for prediction in alone])
    th.testing.assert_close(means.mean(dim=0), whole.mean)
    th.testing.assert_close(means.std(dim=0, correction=0), whole.epistemic_std, rtol=1e-3, atol=1e-6)
    assert all((prediction.epistemic_std == 0).all() for prediction in alone)
    with pytest.raises(ValueError, match="index is 5: give one from 0 to 4"):
        model.member(5)


def test_without_bootstrap_all_members_weigh_the_data_alike() -> None:
    def fit(bootstrap: bool, scale: float) -> th.Tensor:
        model = ProbabilisticEnsemble(
            2, 1, (0,), gradient_steps=10, bootstrap=bootstrap, generator=th.Generator().manual_seed(0)
        )
        dataset = pendulum_dataset(100)
        dataset.bootstrap_weights(5)
        dataset._weights = dataset._weights * scale
        model.fit(dataset, th.Generator().manual_seed(0))
        return next(model.networks.parameters()).detach()

    assert th.equal(fit(False, 1.0), fit(False, 0.0))
    assert not th.equal(fit(True, 1.0), fit(True, 0.0))


def test_fewer_than_two_members_are_an_error() -> None:
    with pytest.raises(ValueError, match="num_members is 1"):
        ProbabilisticEnsemble(2, 1, num_members=1)


def test_divergence_of_the_fit_is_an_error() -> None:
    model = ProbabilisticEnsemble(2, 1, learning_rate=1e30, gradient_steps=20)
    with pytest.raises(ValueError, match="lower learning_rate"):
        model.fit(pendulum_dataset(100), th.Generator().manual_seed(0))


def test_a_large_batch_is_predicted_as_its_rows_are() -> None:
    model = ensemble(gradient_steps=20)
    model.fit(pendulum_dataset(100), th.Generator().manual_seed(0))
    batch = random_transitions(2_500)
    with th.no_grad():
        together = model.predict(batch.states, batch.actions)
        apart = model.predict(batch.states[1_020:1_030], batch.actions[1_020:1_030])
    th.testing.assert_close(together.mean[1_020:1_030], apart.mean)
    th.testing.assert_close(together.aleatoric_std[1_020:1_030], apart.aleatoric_std)
