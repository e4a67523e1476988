"""Every algorithm of SB3, sb3-contrib, SBX and this package trains with the callback, unmodified."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sbx
import torch as th
from sb3_contrib import ARS, TQC, TRPO, CrossQ, RecurrentPPO
from stable_baselines3 import A2C, DDPG, PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from helpers import EPISODE_STEPS, imagination_env, small_callback
from sb3_hucrl.algorithms import HBPTT, HMPO, HMVE, HSVG, MPO
from sb3_hucrl.sb3 import Parameters, get_state

OFF_POLICY: dict[str, Any] = {"batch_size": 16, "buffer_size": 1_000, "learning_starts": 40}
ON_POLICY: dict[str, Any] = {"n_steps": 10}
SMALL: dict[str, Any] = {"policy_kwargs": {"net_arch": [16]}}

ALGORITHMS: dict[str, tuple[type[BaseAlgorithm], str, dict[str, Any]]] = {
    "sac": (SAC, "MlpPolicy", {**OFF_POLICY, **SMALL}),
    "td3": (TD3, "MlpPolicy", {**OFF_POLICY, **SMALL}),
    "ddpg": (DDPG, "MlpPolicy", {**OFF_POLICY, **SMALL}),
    "tqc": (TQC, "MlpPolicy", {**OFF_POLICY, **SMALL}),
    "crossq": (CrossQ, "MlpPolicy", {**OFF_POLICY, **SMALL}),
    "ppo": (PPO, "MlpPolicy", {**ON_POLICY, **SMALL, "batch_size": 20, "n_epochs": 2}),
    "a2c": (A2C, "MlpPolicy", {**ON_POLICY, **SMALL}),
    "trpo": (TRPO, "MlpPolicy", {**ON_POLICY, **SMALL, "batch_size": 20}),
    "ppo_lstm": (RecurrentPPO, "MlpLstmPolicy", {**ON_POLICY, "policy_kwargs": {"lstm_hidden_size": 8}}),
    "ars": (ARS, "LinearPolicy", {"n_delta": 2}),
    "mpo": (MPO, "MlpPolicy", {**OFF_POLICY, **SMALL, "num_samples": 4}),
    "hmpo": (HMPO, "MlpPolicy", {**OFF_POLICY, **SMALL, "num_samples": 4}),
    "hbptt": (HBPTT, "MlpPolicy", {**OFF_POLICY, **SMALL, "horizon": 2}),
    "hmve": (HMVE, "MlpPolicy", {**OFF_POLICY, **SMALL, "horizon": 2}),
    "hsvg": (HSVG, "MlpPolicy", {**OFF_POLICY, **SMALL, "horizon": 2, "critic_updates": 3, "train_freq": 4}),
    "sbx_sac": (sbx.SAC, "MlpPolicy", {**OFF_POLICY, **SMALL}),
    "sbx_td3": (sbx.TD3, "MlpPolicy", {**OFF_POLICY, **SMALL}),
    "sbx_tqc": (sbx.TQC, "MlpPolicy", {**OFF_POLICY, **SMALL}),
    "sbx_crossq": (sbx.CrossQ, "MlpPolicy", {**OFF_POLICY, **SMALL}),
    "sbx_ppo": (sbx.PPO, "MlpPolicy", {**ON_POLICY, **SMALL, "batch_size": 20, "n_epochs": 2}),
}


def make(name: str, **kwargs: Any) -> BaseAlgorithm:
    algorithm, policy, settings = ALGORITHMS[name]
    # rl_zoo3 gives ARS one environment, whatever the YAML says.
    env = imagination_env(1 if name == "ars" else 4)
    # SB3 writes into the dictionaries that it is given.
    return algorithm(policy, env, device="cpu", **copy.deepcopy({"seed": 0, **settings, **kwargs}))


@pytest.mark.slow
@pytest.mark.parametrize("name", ALGORITHMS)
def test_the_loop_runs_saves_loads_and_predicts(name: str, tmp_path: Path) -> None:
    model = make(name)
    model.learn(240, callback=small_callback())
    state = get_state(model)
    assert state is not None
    # A random episode and one after each search; every refit saw all that came before it.
    assert state.real_episodes >= 3
    assert state.fitted_steps == len(state.dataset) == state.real_episodes * EPISODE_STEPS
    model.save(tmp_path / "model")
    loaded = type(model).load(tmp_path / "model", env=imagination_env(1 if name == "ars" else 4), device="cpu")
    observations = np.array([[0.0, -1.0, 0.5], [1.0, 0.0, -2.0]], dtype=np.float32)
    expected, _ = model.predict(observations, deterministic=True)
    actual, _ = loaded.predict(observations, deterministic=True)
    assert expected.shape == (2, 3)
    np.testing.assert_allclose(actual, expected, rtol=1e-5, atol=1e-6)
    episodes = state.real_episodes
    loaded.learn(80, callback=small_callback())
    resumed = get_state(loaded)
    assert resumed is not None
    assert resumed.real_episodes > episodes


@pytest.mark.slow
@pytest.mark.parametrize("name", ALGORITHMS)
def test_parameters_give_back_the_policy_that_was_found(name: str) -> None:
    observations = np.random.default_rng(0).normal(size=(5, 3)).astype(np.float32)
    model = make(name)
    model.learn(80, callback=small_callback())
    found = Parameters.of(model)
    before, _ = model.predict(observations, deterministic=True)
    state = get_state(model)
    assert state is not None
    state.best = None  # or training may end with this very policy
    model.learn(160, callback=small_callback())
    changed, _ = model.predict(observations, deterministic=True)
    assert np.abs(changed - before).max() > 1e-4
    found.restore(model)
    after, _ = model.predict(observations, deterministic=True)
    np.testing.assert_allclose(after, before, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", ["mpo", "hmpo", "hbptt", "hmve", "hsvg"])
def test_our_algorithms_learn_the_same_from_the_same_seed(name: str) -> None:
    observations = np.random.default_rng(0).normal(size=(5, 3)).astype(np.float32)
    found = []
    for seed in (0, 0, 1):
        model = make(name, seed=seed)
        model.learn(160, callback=small_callback())
        found.append(model.predict(observations, deterministic=True)[0])
    np.testing.assert_array_equal(found[0], found[1])
    assert np.abs(found[0] - found[2]).max() > 1e-4


@pytest.mark.parametrize("name", ["hbptt", "hmve", "hsvg"])
def test_what_they_cannot_look_into_is_said(name: str) -> None:
    with pytest.raises(ValueError, match="callback=HUCRLCallback"):
        make(name, learning_starts=0).learn(20)
    algorithm, policy, settings = ALGORITHMS[name]
    # Before any real step is taken.
    with pytest.raises(ValueError, match="use no VecNormalize"):
        algorithm(policy, VecNormalize(imagination_env()), **copy.deepcopy(settings))
    with pytest.raises(ValueError, match="horizon is 0"):
        make(name, horizon=0)
    with pytest.raises(ValueError, match="leave use_sde out"):
        make(name, use_sde=True)


@pytest.mark.parametrize(
    ("name", "argument"),
    [("hsvg", "n_steps"), ("hsvg", "target_update_interval"), ("hbptt", "target_update_interval"), ("hmve", "n_steps")],
)
def test_arguments_of_sac_that_would_change_nothing_are_refused(name: str, argument: str) -> None:
    make(name, **{argument: 1})
    with pytest.raises(ValueError, match=f"makes no use of {argument}: leave it out"):
        make(name, **{argument: 2})


def test_ars_searches_on_around_the_policy_that_was_given_back() -> None:
    model = make("ars", delta_std=1e-6, learning_rate=0.0, zero_policy=False)
    assert isinstance(model, ARS)
    found = Parameters.of(model)
    model.learn(80, callback=small_callback())
    with th.no_grad():
        next(model.policy.parameters()).add_(1.0)
    found.restore(model)
    before = next(model.policy.parameters()).detach().clone()
    model.learn(80, callback=small_callback())
    np.testing.assert_allclose(next(model.policy.parameters()).detach().numpy(), before.numpy(), atol=1e-5)


@pytest.mark.parametrize("name", ["hbptt", "hmpo", "hmve", "hsvg"])
def test_unseeded_runs_do_not_share_their_noise(name: str) -> None:
    seeds = [vars(make(name, seed=seed))["_generator"].initial_seed() for seed in (None, None, 0, 0)]
    assert len(set(seeds[:2])) == 2
    assert seeds[2:] == [0, 0]
