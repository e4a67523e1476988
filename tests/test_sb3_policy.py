"""SB3's policies and critics as torch functions, against SB3's own results."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch as th
from sb3_contrib import ARS, TQC, TRPO, CrossQ, RecurrentPPO
from stable_baselines3 import A2C, DDPG, PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize

from sb3_hucrl.sb3 import SB3Policy

OFF_POLICY = [SAC, TD3, DDPG, TQC, CrossQ]
ON_POLICY = [PPO, A2C, TRPO]


def algorithm(kind: Any, normalize: bool = False) -> tuple[Any, np.ndarray, np.ndarray]:
    """An untrained algorithm, observations as the environment gives them, and as the policy sees them."""
    rng = np.random.default_rng(0)
    env: Any = make_vec_env("Pendulum-v1", 2, seed=0)
    observations = rng.normal(size=(6, 3)).astype(np.float32)
    inputs = observations
    if normalize:
        env = VecNormalize(env)
        env.reset()
        for _ in range(20):
            env.step(rng.uniform(-2, 2, (2, 1)).astype(np.float32))
        env.training = False
        inputs = env.normalize_obs(observations)
    return kind("MlpPolicy", env, seed=0, device="cpu"), observations, inputs


@pytest.mark.parametrize("kind", [*OFF_POLICY, *ON_POLICY, ARS])
@pytest.mark.parametrize("normalize", [False, True], ids=["plain", "normalized"])
def test_actions_are_those_of_predict(kind: type[BaseAlgorithm], normalize: bool) -> None:
    model, observations, inputs = algorithm(kind, normalize)
    expected = model.predict(inputs, deterministic=True)[0]
    policy = SB3Policy(model)
    with th.no_grad():
        np.testing.assert_allclose(policy.act(th.as_tensor(observations)), expected, atol=1e-5)
        each = {name: value.expand(6, *value.shape) for name, value in policy.acting_parameters().items()}
        np.testing.assert_allclose(policy.act_each(each, th.as_tensor(observations)), expected, atol=1e-5)


@pytest.mark.parametrize("kind", OFF_POLICY)
def test_values_are_the_critics_of_the_mode(kind: Any) -> None:
    model, observations, _ = algorithm(kind)
    model.policy.set_training_mode(False)
    with th.no_grad():
        tensor = th.as_tensor(observations)
        scaled = model.actor(tensor)
        if kind in (SAC, TQC, CrossQ):
            scaled = model.actor(tensor, deterministic=True)
        critic = model.critic(tensor, scaled)
        expected = critic.mean(dim=(1, 2)) if kind is TQC else th.cat(critic, dim=1).min(dim=1).values
        assert th.allclose(SB3Policy(model).value()(tensor), expected, atol=1e-5)


@pytest.mark.parametrize("kind", ON_POLICY)
def test_values_are_in_units_of_the_reward(kind: Any) -> None:
    model, observations, inputs = algorithm(kind, normalize=True)
    normalizer = model.get_vec_normalize_env()
    assert normalizer is not None
    with th.no_grad():
        values = model.policy.predict_values(th.as_tensor(inputs))[:, 0]
        expected = normalizer.unnormalize_reward(values.numpy())
        np.testing.assert_allclose(SB3Policy(model).value()(th.as_tensor(observations)), expected, rtol=1e-4)


def test_parameters_leave_out_critics_and_standard_deviations() -> None:
    model, _, _ = algorithm(PPO)
    names = SB3Policy(model).acting_parameters()
    assert len(names) == 6
    assert not any("value" in name or "log_std" in name for name in names)


def test_what_cannot_be_planned_around_is_said() -> None:
    recurrent = RecurrentPPO("MlpLstmPolicy", make_vec_env("Pendulum-v1", 2), device="cpu", n_steps=8)
    with pytest.raises(ValueError, match="sees nothing but the observation"):
        SB3Policy(recurrent)
    with pytest.raises(ValueError, match="bootstrap: false"):
        SB3Policy(algorithm(ARS)[0]).value()
