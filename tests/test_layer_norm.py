"""Normalised hidden layers of off-policy algorithms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch as th
from sb3_contrib import TQC, CrossQ
from stable_baselines3 import DDPG, PPO, SAC, TD3
from torch import nn

from helpers import imagination_env, small_callback, small_sac
from sb3_hucrl.sb3.layer_norm import NormalisedReLU


def activations(module: nn.Module) -> set[type[nn.Module]]:
    return {type(each) for each in module.modules() if isinstance(each, nn.ReLU | nn.Tanh | NormalisedReLU)}


def test_it_is_torchs_layer_norm_before_a_relu() -> None:
    inputs = 3.0 * th.randn(16, 64, generator=th.Generator().manual_seed(0)) + 1.0
    expected = nn.Sequential(nn.LayerNorm(64, elementwise_affine=False), nn.ReLU())(inputs)
    np.testing.assert_allclose(NormalisedReLU()(inputs), expected)


@pytest.mark.parametrize("algorithm", [SAC, TD3, DDPG, TQC])
def test_actors_and_critics_of_off_policy_algorithms_are_normalised(algorithm: Any) -> None:
    model = algorithm("MlpPolicy", imagination_env(max_episode_steps=20), learning_starts=0, device="cpu", seed=0)
    model.learn(40, callback=small_callback())
    for network in (model.actor, model.critic, model.critic_target):
        # TD3's and DDPG's actors end in a tanh.
        assert activations(network) - {nn.Tanh} == {NormalisedReLU}


@pytest.mark.parametrize("algorithm", [PPO, CrossQ])
def test_on_policy_algorithms_and_those_that_normalise_already_are_not(algorithm: Any) -> None:
    model = algorithm("MlpPolicy", imagination_env(max_episode_steps=20), device="cpu", seed=0)
    model.learn(40, callback=small_callback())
    assert NormalisedReLU not in activations(model.policy)


def test_an_activation_that_the_user_chose_stays() -> None:
    env = imagination_env(max_episode_steps=20)
    model = small_sac(env, policy_kwargs={"activation_fn": nn.ReLU}).learn(80, callback=small_callback())
    assert activations(model.policy) == {nn.ReLU}


def test_a_saved_policy_is_normalised_too(tmp_path: Any) -> None:
    model = small_sac(imagination_env(max_episode_steps=20)).learn(80, callback=small_callback())
    model.save(tmp_path / "model")
    loaded = SAC.load(tmp_path / "model", device="cpu")
    assert activations(loaded.policy) == {NormalisedReLU}
    observations = th.randn(8, 3, generator=th.Generator().manual_seed(0))
    with th.no_grad():
        actions = th.zeros(8, 3)
        for ours, theirs in zip(model.critic(observations, actions), loaded.critic(observations, actions), strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_a_critic_cannot_extrapolate_without_bound() -> None:
    """Of a layer with n units, the norm after the layer norm is √n, wherever the state is."""
    model = small_sac(imagination_env(max_episode_steps=20)).learn(80, callback=small_callback())
    far = 1e6 * th.randn(64, 3, generator=th.Generator().manual_seed(0))
    with th.no_grad():
        for index, values in enumerate(model.critic(far, th.zeros(64, 3))):
            network = model.critic.q_networks[index]
            assert isinstance(network, nn.Sequential)
            last = network[-1]
            assert isinstance(last, nn.Linear)
            bound = last.weight.norm() * last.in_features**0.5 + last.bias.abs()
            assert float(values.abs().max()) <= float(bound)
