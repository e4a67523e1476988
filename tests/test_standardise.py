"""Policies that see standardised observations."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.callbacks import ConvertCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.common.vec_env import VecNormalize

from helpers import imagination_env, small_callback, small_sac, state_of
from sb3_hucrl import HallucinationWrapper, ImaginationVecEnv
from sb3_hucrl.sb3.standardise import StandardisedExtractor
from sb3_hucrl.tasks import PendulumTask


def extractors(model: Any) -> list[StandardisedExtractor]:
    return [module for module in model.policy.modules() if isinstance(module, StandardisedExtractor)]


def plain(model: Any) -> list[FlattenExtractor]:
    return [module for module in model.policy.modules() if type(module) is FlattenExtractor]


def test_every_network_sees_observations_as_imagination_begins() -> None:
    model = small_sac(imagination_env(max_episode_steps=40))
    # In the second of two searches, before the better of two policies is chosen, which may be that of the first.
    stop = ConvertCallback(lambda local, _: local["self"].num_timesteps < 120)
    model.learn(160, callback=[small_callback(start_states={"visited": 1.0}), stop])
    # Actor, critic and target critic.
    assert len(extractors(model)) == 3
    assert not plain(model)
    observed = PendulumTask().observe(state_of(model).dataset.transitions.states)
    assert len(observed) == 80
    for extractor in extractors(model):
        np.testing.assert_allclose(extractor.mean, observed.mean(dim=0), atol=0.1)
        np.testing.assert_allclose(extractor.std, observed.std(dim=0), rtol=0.1)
        np.testing.assert_allclose(extractor(observed).mean(dim=0), th.zeros(3), atol=0.2)


def test_a_saved_policy_sees_the_same(tmp_path: Any) -> None:
    model = small_sac(imagination_env(max_episode_steps=40)).learn(160, callback=small_callback())
    observations = np.random.default_rng(0).normal(size=(8, 3)).astype(np.float32)
    expected, _ = model.predict(observations, deterministic=True)
    model.save(tmp_path / "model")
    loaded = SAC.load(tmp_path / "model", device="cpu")
    np.testing.assert_array_equal(loaded.predict(observations, deterministic=True)[0], expected)
    assert float(extractors(loaded)[0].std.min()) < 1


@pytest.mark.parametrize("algorithm", [PPO, TD3])
def test_other_algorithms_do_too(algorithm: Any) -> None:
    model = algorithm("MlpPolicy", imagination_env(max_episode_steps=20), device="cpu", seed=0)
    model.learn(80, callback=small_callback())
    assert extractors(model)
    assert not plain(model)
    assert all(float(each.std.min()) != 1.0 for each in extractors(model))


def test_what_the_user_chose_stays() -> None:
    class Mine(FlattenExtractor):
        pass

    env = imagination_env(max_episode_steps=20)
    chosen = small_sac(env, policy_kwargs={"features_extractor_class": Mine}).learn(80, callback=small_callback())
    assert not extractors(chosen)
    off = small_sac(env).learn(80, callback=small_callback(standardise=False))
    assert not extractors(off)
    assert "features_extractor_class" not in off.policy_kwargs
    normalised = small_sac(VecNormalize(imagination_env(max_episode_steps=20))).learn(80, callback=small_callback())
    assert not extractors(normalised)


def test_a_policy_that_has_learned_before_stays() -> None:
    model = small_sac(imagination_env(max_episode_steps=20), learning_starts=4)
    model.learn(40)
    assert not extractors(model.learn(80, callback=small_callback()))


class Scaled(gym.ObservationWrapper[Any, Any, Any]):
    """Observations in other units."""

    def __init__(self, env: gym.Env[Any, Any], factor: float) -> None:
        super().__init__(env)
        self.factor, box = factor, env.observation_space
        assert isinstance(box, gym.spaces.Box)
        self.observation_space = gym.spaces.Box(box.low * factor, box.high * factor, dtype=np.float32)

    def observation(self, observation: Any) -> Any:
        return observation * np.float32(self.factor)


def first_search(factor: float) -> tuple[Any, Any]:
    """What the actor sees of the first real episode before any search, and what it then does."""

    def wrap(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
        return HallucinationWrapper(Scaled(env, factor), 3)

    env = ImaginationVecEnv(make_vec_env("Pendulum-v1", 4, seed=0, wrapper_class=wrap))
    model = small_sac(env, learning_starts=1_000, n_steps=1)
    model.learn(8, callback=small_callback(task="learned", imagined_steps=8, dynamics_kwargs={"gradient_steps": 20}))
    observed = state_of(model).dataset.episodes[0].states[:, :3]
    inputs = extractors(model)[0](observed).numpy()
    return inputs, model.predict(observed.numpy(), deterministic=True)[0]


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_units_make_no_difference_to_the_policy(factor: float) -> None:
    (inputs, actions), (scaled_inputs, scaled_actions) = first_search(1.0), first_search(factor)
    np.testing.assert_allclose(scaled_inputs, inputs, atol=1e-3)
    np.testing.assert_allclose(scaled_actions, actions, atol=1e-3)
