"""The dataset of real transitions."""

import pickle

import pytest
import torch as th

from helpers import random_transitions
from sb3_hucrl import TransitionDataset, Transitions
from sb3_hucrl.data import reward_std


def grown(*lengths: int) -> TransitionDataset:
    dataset = TransitionDataset(2, 1, seed=3)
    for index, length in enumerate(lengths):
        dataset.append_episode(random_transitions(length, seed=index))
    return dataset


def test_keeps_transitions_in_order_and_remembers_where_episodes_began() -> None:
    first, second = random_transitions(30, seed=0), random_transitions(20, seed=1)
    dataset = grown(30, 20)
    assert len(dataset) == 50
    th.testing.assert_close(dataset.transitions.states, th.cat([first.states, second.states]))
    th.testing.assert_close(dataset.initial_states, th.stack([first.states[0], second.states[0]]))


def test_holdout_and_training_transitions_stay_apart_as_the_data_grow() -> None:
    dataset = grown(300)
    held_out = {tuple(state.tolist()) for state in dataset.holdout.states}
    assert 10 <= len(held_out) <= 60
    dataset.append_episode(random_transitions(300, seed=9))
    train = {tuple(state.tolist()) for state in dataset.train.states}
    assert held_out <= {tuple(state.tolist()) for state in dataset.holdout.states}
    assert not held_out & train
    assert len(dataset.train) + len(dataset.holdout) == 600


def test_bootstrap_weights_are_poisson_and_are_kept() -> None:
    dataset = grown(2_000)
    weights = dataset.bootstrap_weights(5)
    assert weights.shape == (len(dataset.train), 5)
    # Mean and variance of Poisson(1) over 9,000 draws: five standard errors are 0.05 and 0.09.
    assert abs(float(weights.mean()) - 1) < 0.06
    assert abs(float(weights.var()) - 1) < 0.1
    old = weights.clone()
    dataset.append_episode(random_transitions(100, seed=5))
    th.testing.assert_close(dataset.bootstrap_weights(5)[: len(old)], old)


def test_pickling_keeps_everything_including_the_next_draw() -> None:
    dataset = grown(100)
    dataset.bootstrap_weights(3)
    loaded = pickle.loads(pickle.dumps(dataset))
    for either in (dataset, loaded):
        either.append_episode(random_transitions(50, seed=8))
    th.testing.assert_close(loaded.train.states, dataset.train.states)
    th.testing.assert_close(loaded.bootstrap_weights(3), dataset.bootstrap_weights(3))


def test_rejects_other_dimensions_and_empty_episodes() -> None:
    with pytest.raises(ValueError, match=r"dimensions \(2, 1\), the dataset \(3, 1\)"):
        TransitionDataset(3, 1).append_episode(random_transitions(5))
    with pytest.raises(ValueError, match="at least one transition"):
        TransitionDataset(2, 1).append_episode(Transitions.empty(2, 1))


def test_names_the_variable_and_the_step_that_is_not_finite() -> None:
    good = random_transitions(5)
    rewards = good.rewards.clone()
    rewards[3] = float("nan")
    with pytest.raises(ValueError, match="rewards is not finite at step 3"):
        Transitions(good.states, good.actions, good.next_states, rewards, good.terminated)


def test_rejects_columns_of_different_lengths() -> None:
    good = random_transitions(5)
    with pytest.raises(ValueError, match="actions has 4 rows, states has 5"):
        Transitions(good.states, good.actions[:4], good.next_states, good.rewards, good.terminated)


def test_equal_rewards_have_no_spread_whatever_rounding_makes_of_them() -> None:
    for reward in (0.1, 1 / 3, -1e-4, 1e5):
        assert reward_std(th.full((500,), reward)) == 0.0
    assert reward_std(th.tensor([1.0, 3.0])) == pytest.approx(1.0)
    assert reward_std(th.tensor([1e-7, 3e-7])) == pytest.approx(1e-7)
    assert reward_std(th.zeros(3)) == 0.0
