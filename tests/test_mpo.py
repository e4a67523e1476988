"""MPO as an SB3 algorithm, without a model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from stable_baselines3.common.callbacks import StopTrainingOnMaxEpisodes

from sb3_hucrl.algorithms import MPO


class Guess(gym.Env[np.ndarray, np.ndarray]):
    """One step: the closer the action to twice the observation, the better."""

    observation_space = spaces.Box(-1.0, 1.0, (1,))
    action_space = spaces.Box(-4.0, 4.0, (1,))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self._number = self.np_random.uniform(-1, 1, 1).astype(np.float32)
        return self._number, {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        return self._number, -float(np.square(action - 2 * self._number).sum()), True, False, {}


def mpo(seed: int = 0, **kwargs: Any) -> MPO:
    settings: dict[str, Any] = {"batch_size": 32, "policy_kwargs": {"net_arch": [32]}, "num_samples": 8, "tau": 0.05}
    return MPO("MlpPolicy", Guess(), seed=seed, device="cpu", **{**settings, **kwargs})


def error(model: MPO) -> float:
    numbers = np.linspace(-1, 1, 21, dtype=np.float32)[:, np.newaxis]
    return float(np.abs(model.predict(numbers, deterministic=True)[0] - 2 * numbers).mean())


@pytest.mark.slow
def test_it_learns_what_the_critic_knows() -> None:
    model = mpo(learning_rate=3e-3, policy_interval=20, epsilon_mean=0.05)
    before = error(model)
    model.learn(1_200)
    assert before > 0.8
    assert error(model) < 0.25
    assert model.loss.temperature.item() != pytest.approx(mpo().loss.temperature.item())


def test_the_policy_moves_within_its_trust_region() -> None:
    model = mpo(epsilon_mean=1e-3, epsilon_std=1e-3, dual_learning_rate=0.1, policy_interval=10_000)
    model.learn(600)
    observations = th.linspace(-1, 1, 50).unsqueeze(1)
    with th.no_grad():
        old, new = (actor.distribution(observations) for actor in (model.policy.actor_target, model.policy.actor))
    moved = (0.5 * ((new.mean - old.mean) / old.stddev).square()).mean()
    assert 1e-5 < moved < 1e-2


def test_a_loaded_algorithm_goes_on_where_it_was(tmp_path: Path) -> None:
    model = mpo()
    model.learn(200)
    model.save(tmp_path / "model")
    loaded = MPO.load(tmp_path / "model", env=Guess(), device="cpu")
    assert error(loaded) == pytest.approx(error(model))
    assert loaded.loss.multipliers.tolist() == model.loss.multipliers.tolist()
    assert loaded.dual_optimizer.state_dict()["state"][0]["step"] == 100
    temperature = loaded.loss.temperature.item()
    loaded.learn(200)
    assert loaded.loss.temperature.item() != temperature


def test_the_same_seed_learns_the_same_and_callbacks_stop_it() -> None:
    errors = []
    for seed in (0, 0, 1):
        model = mpo(seed)
        model.learn(10_000, callback=StopTrainingOnMaxEpisodes(150))
        assert model.num_timesteps == 150
        errors.append(error(model))
    assert errors[0] == errors[1]
    assert errors[0] != errors[2]


def test_targets_look_several_steps_ahead() -> None:
    model = mpo(n_steps=3)
    model.learn(150)
    assert np.isfinite(error(model))


def test_bad_settings_say_what_to_do() -> None:
    with pytest.raises(ValueError, match="num_samples is 1: give an integer of at least 2"):
        mpo(num_samples=1)
    with pytest.raises(ValueError, match="epsilon_mean is -1"):
        mpo(epsilon_mean=-1.0)
