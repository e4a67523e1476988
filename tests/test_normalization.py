"""VecNormalize's statistics travel in the zip file of an algorithm."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rl_zoo3.train
from stable_baselines3 import SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

import sb3_hucrl.zoo  # noqa: F401  # for its effect
from helpers import ENV_ID, imagination_env, small_callback, small_sac
from sb3_hucrl import HUCRLCallback
from sb3_hucrl.sb3 import saved_normalization
from sb3_hucrl.zoo.runs import ZooRun

TRAIN = [
    *("train", "--algo", "sac", "--env", ENV_ID, "--eval-freq", "-1", "--env-kwargs", "max_episode_steps:40"),
    *("--device", "cpu", "-n", "320", "-params", "gradient_steps:1", "n_envs:4", "policy_kwargs:dict(net_arch=[16])"),
    *("hucrl_horizon:20", "hucrl_imagined_steps:160", "hucrl_dynamics__gradient_steps:5"),
]


def normalized_env(**kwargs: Any) -> VecNormalize:
    return VecNormalize(imagination_env(max_episode_steps=40), **kwargs)


def normalizer_of(model: BaseAlgorithm) -> VecNormalize:
    normalizer = model.get_vec_normalize_env()
    assert normalizer is not None
    return normalizer


class Spy(HUCRLCallback):
    """Notes how many returns the first search begins with, and their variance."""

    begins_with: tuple[float, float] | None = None

    def _start_search(self) -> None:
        super()._start_search()
        returns = normalizer_of(self.model).ret_rms
        self.begins_with = self.begins_with or (float(returns.count), float(returns.var))


def test_a_loaded_model_goes_on_with_the_statistics_of_its_rewards(tmp_path: Path) -> None:
    env, path = normalized_env(), tmp_path / "checkpoint.zip"
    small_sac(env).learn(160, callback=small_callback(checkpoint=str(path)))
    assert env.ret_rms.count == pytest.approx(160, abs=1)
    loaded = SAC.load(path, env=normalized_env(clip_reward=5.0), device="cpu")
    callback = Spy(imagined_steps=80, horizon=10, dynamics_kwargs={"gradient_steps": 5})
    loaded.learn(80, callback=callback, reset_num_timesteps=False)
    assert callback.begins_with == (env.ret_rms.count, float(env.ret_rms.var))
    assert normalizer_of(loaded).ret_rms.count == pytest.approx(240, abs=1)
    assert normalizer_of(loaded).clip_reward == 5.0


def test_every_zip_has_the_statistics_of_its_time(tmp_path: Path) -> None:
    env = normalized_env(gamma=0.9, clip_obs=3.0)
    model = small_sac(env)
    counts = []
    for _ in range(2):
        model.learn(80, callback=small_callback(), reset_num_timesteps=False)
        model.save(tmp_path / "model.zip")
        saved = saved_normalization(tmp_path / "model.zip")
        assert saved is not None
        counts.append(saved.returns.count)
    assert saved is not None
    assert counts == pytest.approx([80, 160], abs=1)
    observation = np.array([[0.1, -1.0, 8.0]], dtype=np.float32)
    again = saved.wrap(imagination_env(1, max_episode_steps=40))
    np.testing.assert_array_equal(again.normalize_obs(observation), env.normalize_obs(observation))
    assert (again.gamma, again.training) == (0.9, False)


def test_rewards_may_be_normalised_alone(tmp_path: Path) -> None:
    path = tmp_path / "model.zip"
    small_sac(normalized_env(norm_obs=False)).learn(80, callback=small_callback(checkpoint=str(path)))
    saved = saved_normalization(path)
    assert saved is not None
    assert saved.observations is None
    loaded = SAC.load(path, env=normalized_env(norm_obs=False), device="cpu").learn(80, callback=small_callback())
    assert normalizer_of(loaded).ret_rms.count > 81


def test_a_model_that_loses_its_normalisation_is_warned_of(tmp_path: Path) -> None:
    path = tmp_path / "model.zip"
    small_sac(normalized_env()).learn(80, callback=small_callback(checkpoint=str(path)))
    plain = SAC.load(path, env=imagination_env(max_episode_steps=40), device="cpu")
    with pytest.warns(UserWarning, match="trained with VecNormalize, and its environments now have none"):
        plain.learn(80, callback=small_callback())


def test_without_normalisation_nothing_is_kept_or_said(tmp_path: Path) -> None:
    path = tmp_path / "model.zip"
    small_sac(imagination_env(max_episode_steps=40)).learn(80, callback=small_callback(checkpoint=str(path)))
    assert saved_normalization(path) is None
    loaded = SAC.load(path, env=imagination_env(max_episode_steps=40), device="cpu")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        loaded.learn(80, callback=small_callback())


@pytest.mark.slow
@pytest.mark.parametrize("normalize", ["True", '"dict(norm_obs=True, norm_reward=True, clip_obs=3.0)"'])
def test_a_killed_run_with_normalisation_is_looked_at_and_goes_on(
    normalize: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def train(*more: str) -> None:
        monkeypatch.setattr(sys, "argv", [*TRAIN, f"normalize:{normalize}", *more])
        rl_zoo3.train.train()

    monkeypatch.chdir(tmp_path)
    train()
    folder = tmp_path / "logs" / "sac" / f"{ENV_ID}_1"
    finished = ZooRun(folder).model
    # What a killed run leaves behind.
    (folder / ENV_ID / "vecnormalize.pkl").unlink()
    (folder / f"{ENV_ID}.zip").unlink()
    killed = ZooRun(folder)
    normalizer = normalizer_of(killed.model)
    observation = np.array([[0.1, -1.0, 8.0]], dtype=np.float32)
    np.testing.assert_array_equal(
        normalizer.normalize_obs(observation), normalizer_of(finished).normalize_obs(observation)
    )
    assert normalizer.clip_obs == (10.0 if normalize == "True" else 3.0)
    assert killed.world().horizon == 20
    train("-i", str(folder / "checkpoint.zip"))
    resumed = normalizer_of(ZooRun(folder.parent / f"{ENV_ID}_2").model)
    assert resumed.ret_rms.count == pytest.approx(normalizer.ret_rms.count + 320, abs=2)
