"""H-MVE's targets, against transitions of the true dynamics."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch as th
from stable_baselines3 import SAC

from helpers import TruePendulum, imagination_env, limits_of, pendulum_dataset, small_callback, small_world
from sb3_hucrl import StartStates
from sb3_hucrl.algorithms import HMVE
from sb3_hucrl.algorithms.hmve import ExpandedReplayBuffer
from sb3_hucrl.tasks import PendulumTask

GAMMA = 0.9


def hmve(dynamics: TruePendulum | None = None, **kwargs: Any) -> HMVE:
    """After some steps on the true dynamics, without noise and uncertainty, or on others."""
    env = imagination_env()
    dataset, task = pendulum_dataset(), PendulumTask(0.2)
    starts, limits = StartStates(dataset, task), limits_of(dataset, task)
    env.imagine(small_world(dynamics, task=task, horizon=100, starts=starts, limits=limits))
    settings: dict[str, Any] = {"batch_size": 16, "buffer_size": 1_000, "policy_kwargs": {"net_arch": [16]}}
    model = HMVE("MlpPolicy", env, seed=0, device="cpu", gamma=GAMMA, learning_starts=10_000, **{**settings, **kwargs})
    model.learn(200)
    return model


def batch(model: HMVE) -> Any:
    assert model.replay_buffer is not None
    return model.replay_buffer.sample(64)


def test_one_step_is_the_one_step_target() -> None:
    model = hmve(horizon=1)
    data = batch(model)
    expanded = model.expand(data)
    assert th.equal(expanded.observations, data.observations)
    assert th.equal(expanded.actions, data.actions)
    assert th.allclose(expanded.next_observations, data.next_observations, atol=1e-5)
    assert th.allclose(expanded.rewards, data.rewards, atol=1e-5)
    assert expanded.discounts is not None
    assert th.allclose(expanded.discounts, th.full((64, 1), GAMMA))


def test_several_steps_are_the_exact_return_of_the_true_dynamics(monkeypatch: pytest.MonkeyPatch) -> None:
    model = hmve(horizon=5)
    monkeypatch.setattr(model, "_sample", lambda observations: th.zeros(len(observations), 3))
    data = batch(model)
    expanded = model.expand(data)
    task = PendulumTask(0.2)
    state, total = task.state(data.observations), th.zeros(64)
    for n in range(5):
        action = data.actions[:, :1] if n == 0 else th.zeros(64, 1)
        next_state = TruePendulum().step(state, action)
        total += GAMMA**n * task.reward(state, action, next_state)
        state = next_state
    assert th.allclose(expanded.rewards[:, 0], total, atol=1e-5)
    assert th.allclose(expanded.next_observations, task.observe(state), atol=1e-4)
    assert expanded.discounts is not None
    assert th.allclose(expanded.discounts, th.full((64, 1), GAMMA**5))


def test_steve_trusts_the_lengths_whose_targets_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    model = hmve(horizon=3, weighting="steve", num_rollouts=2)
    # Critics that disagree about everything: the longer the expansion, the less they matter.
    monkeypatch.setattr(
        model, "critic_target", lambda observations, actions: [th.full((len(actions), 1), v) for v in (-50.0, 50.0)]
    )
    expansions = [model.expand(batch(model)).discounts for _ in range(40)]
    discounts = th.cat([each for each in expansions if each is not None])
    assert len(discounts) == 40 * 64
    shares = [(discounts - GAMMA**n).abs().lt(1e-4).float().mean().item() for n in (1, 2, 3)]
    weights = np.array([GAMMA ** (-2 * n) for n in (1, 2, 3)])
    np.testing.assert_allclose(shares, weights / weights.sum(), atol=0.03)


def test_an_expansion_goes_no_further_than_imagination() -> None:
    # A model that adds 100 to every state, far beyond all that was visited.
    model = hmve(dynamics=TruePendulum(bias=100.0), horizon=5)
    data = batch(model)
    imagined, expanded = (each.next_observations[:, 2].abs().max() for each in (data, model.expand(data)))
    assert 0 < expanded <= imagined < 500


def test_each_batch_of_a_training_gets_its_share() -> None:
    model = hmve()
    expanded = model.expand(batch(model))
    assert model.replay_buffer is not None
    buffer = ExpandedReplayBuffer(model.replay_buffer, expanded, num_batches=4)
    batches = [buffer.sample(16) for _ in range(4)]
    for dealt, whole in zip(zip(*batches, strict=True), expanded, strict=True):
        assert whole is not None
        assert th.equal(th.stack(dealt, dim=1).flatten(0, 1), whole)


def test_steve_is_a_mean_over_lengths() -> None:
    model = hmve(horizon=3, weighting="steve")
    expanded = model.expand(batch(model))
    assert expanded.discounts is not None
    assert set(np.round(expanded.discounts[:, 0].tolist(), 4)) <= {0.9, 0.81, 0.729}


def test_sac_learns_from_it_and_keeps_its_own_buffer() -> None:
    env = imagination_env()
    settings: dict[str, Any] = {"batch_size": 16, "policy_kwargs": {"net_arch": [16]}, "learning_starts": 40}
    model = HMVE("MlpPolicy", env, seed=0, device="cpu", horizon=2, buffer_size=1_000, **settings)
    model.learn(160, callback=small_callback(real_data_fraction=0.5))
    plain = SAC("MlpPolicy", imagination_env(), seed=0, device="cpu", buffer_size=1_000, **settings)
    plain.learn(160, callback=small_callback(real_data_fraction=0.5))
    assert type(model.replay_buffer) is type(plain.replay_buffer)
    observation = np.array([[0.0, -1.0, 0.5]], np.float32)
    assert (
        model.predict(observation, deterministic=True)[0] != plain.predict(observation, deterministic=True)[0]
    ).any()


def test_bad_settings_say_what_to_do() -> None:
    with pytest.raises(ValueError, match="horizon is 0"):
        hmve(horizon=0)
    with pytest.raises(ValueError, match="weighting is 'mean': give 'none' or 'steve'"):
        hmve(weighting="mean")
    with pytest.raises(ValueError, match="callback=HUCRLCallback"):
        HMVE("MlpPolicy", imagination_env(), learning_starts=0).learn(20)
