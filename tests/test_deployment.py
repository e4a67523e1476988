"""Exported policies: the actions of the trained ones, for the real environment, without this package."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from gymnasium.wrappers import RescaleAction
from sb3_contrib import ARS, TQC, TRPO, CrossQ, RecurrentPPO
from stable_baselines3 import A2C, DDPG, PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.common.vec_env import VecEnv, VecNormalize
from torch import nn

from helpers import imagination_env, small_callback, small_sac, state_of
from sb3_hucrl import HallucinationWrapper, ImaginationVecEnv, export, export_run
from sb3_hucrl.algorithms import HBPTT, HMPC, HMPO, HMVE, HSVG, MPO
from sb3_hucrl.sb3 import attach_state
from sb3_hucrl.sb3.layer_norm import NormalisedReLU
from sb3_hucrl.sb3.standardise import StandardisedExtractor

OBSERVATIONS = np.random.default_rng(0).normal(size=(200, 3)).astype(np.float32) * [1, 1, 4]
#: in another process, where the package does not exist, nor anything else that trained the policy
ELSEWHERE = """
import json, sys
for name in ("sb3_hucrl", "sb3_contrib", "sbx", "rl_zoo3", "gpytorch"):
    sys.modules[name] = None
import numpy as np, stable_baselines3
observations = np.load("observations.npy")
models = {file: getattr(stable_baselines3, kind).load(file, device="cpu") for kind, file in json.loads(sys.argv[1])}
np.savez("actions.npz", **{file: model.predict(observations, deterministic=True)[0] for file, model in models.items()})
"""


def real_pendulum(env: gym.Env[Any, Any] | None = None) -> gym.Env[Any, Any]:
    """Its actions are in no range that symmetry or chance could hide a mistake in."""
    return RescaleAction(env or gym.make("Pendulum-v1", max_episode_steps=30), np.float32(-0.5), np.float32(3.0))


def hallucinating() -> VecEnv:
    def wrap(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
        return HallucinationWrapper(real_pendulum(env), 3)

    kwargs = {"max_episode_steps": 30}
    return ImaginationVecEnv(make_vec_env("Pendulum-v1", 4, seed=0, wrapper_class=wrap, env_kwargs=kwargs))


def trained(kind: Any, wrap: Callable[[VecEnv], VecEnv] = lambda env: env, steps: int = 160, **kwargs: Any) -> Any:
    small = {"policy_kwargs": {"net_arch": [24, 16]}, "seed": 0, "device": "cpu"}
    if issubclass(kind, PPO | TRPO | RecurrentPPO):
        small |= {"n_steps": 20, "batch_size": 20}
    elif not issubclass(kind, A2C | ARS):
        small |= {"batch_size": 16, "buffer_size": 1_000, "learning_starts": 20}
    model = kind(kwargs.pop("policy", "MlpPolicy"), wrap(hallucinating()), **{**small, **kwargs})
    return model.learn(steps, callback=small_callback(task="learned"))


def actions_of(model: BaseAlgorithm, observations: Any = OBSERVATIONS) -> Any:
    return model.predict(observations, deterministic=True)[0]


def require_equal(exported: BaseAlgorithm, model: BaseAlgorithm, atol: float = 1e-5) -> None:
    expected = actions_of(model)[:, :1]
    # What is compared depends on the observation, and is not at a limit throughout.
    assert float(expected.std()) > 1e-3
    np.testing.assert_allclose(actions_of(exported), expected, atol=atol)


@pytest.fixture(scope="module")
def sac() -> SAC:
    model: SAC = trained(SAC)
    return model


def test_the_policy_of_sac_acts_as_before_in_the_real_spaces(sac: SAC, tmp_path: Path) -> None:
    # There is something to fold, and something that the zip file must not need.
    assert any(isinstance(each, StandardisedExtractor) and each.std[2] != 1 for each in sac.policy.modules())
    assert any(isinstance(each, NormalisedReLU) for each in sac.policy.modules())
    exported = export(sac, tmp_path / "policy")
    loaded = SAC.load(tmp_path / "policy", device="cpu")
    for each in (exported, loaded):
        assert each.action_space == spaces.Box(np.float32(-0.5), np.float32(3.0), (1,))
        assert each.observation_space == sac.observation_space
        require_equal(each, sac)


def test_it_samples_as_before(sac: SAC, tmp_path: Path) -> None:
    exported = export(sac, tmp_path / "policy")
    assert isinstance(exported, SAC)
    observations = th.as_tensor(OBSERVATIONS, dtype=th.float32)
    with th.no_grad():
        for found, expected in zip(
            exported.actor.get_action_dist_params(observations)[:2],
            sac.actor.get_action_dist_params(observations)[:2],
            strict=True,
        ):
            np.testing.assert_allclose(found, expected[:, :1], atol=1e-4)


def test_it_plays_the_real_environment_as_before(sac: SAC, tmp_path: Path) -> None:
    export(sac, tmp_path / "policy")
    raw = make_vec_env(real_pendulum, 2, seed=7)
    found, _ = evaluate_policy(SAC.load(tmp_path / "policy", device="cpu"), raw, n_eval_episodes=4)
    widened = make_vec_env(lambda: HallucinationWrapper(real_pendulum(), 3), 2, seed=7)
    expected, _ = evaluate_policy(sac, widened, n_eval_episodes=4)
    assert found == pytest.approx(expected, abs=1e-2)


def test_eval_callback_takes_the_real_environment(sac: SAC, tmp_path: Path) -> None:
    export(sac, tmp_path / "policy")
    loaded = SAC.load(tmp_path / "policy", env=make_vec_env(real_pendulum, 1), device="cpu")
    evaluation = EvalCallback(make_vec_env(real_pendulum, 1, seed=3), n_eval_episodes=2, eval_freq=4)
    # Too few steps for a gradient.
    loaded.learn(4, callback=evaluation)
    expected, _ = evaluate_policy(loaded, make_vec_env(real_pendulum, 1, seed=3), n_eval_episodes=2)
    assert evaluation.last_mean_reward == pytest.approx(expected, abs=1e-2)
    require_equal(loaded, sac)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "plain"),
    [
        *((kind, SAC) for kind in (TQC, CrossQ, HSVG, HBPTT, HMVE)),
        *((kind, TD3) for kind in (TD3, DDPG, MPO, HMPO)),
        *((kind, PPO) for kind in (PPO, A2C, TRPO)),
    ],
)
def test_other_algorithms_act_as_before(kind: Any, plain: Any, tmp_path: Path) -> None:
    model = trained(kind)
    assert type(export(model, tmp_path / "policy.zip")) is plain
    require_equal(plain.load(tmp_path / "policy.zip", device="cpu"), model)


@pytest.mark.slow
@pytest.mark.parametrize(("policy", "plain"), [("MlpPolicy", TD3), ("LinearPolicy", PPO)])
def test_both_policies_of_ars_act_as_before(policy: str, plain: Any, tmp_path: Path) -> None:
    small = {} if policy == "LinearPolicy" else {"net_arch": [16]}
    model = trained(ARS, policy=policy, policy_kwargs=small, n_delta=2)
    export(model, tmp_path / "policy")
    require_equal(plain.load(tmp_path / "policy", device="cpu"), model)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "plain"), [("SAC", SAC), ("TQC", SAC), ("TD3", TD3), ("DDPG", TD3), ("PPO", PPO)])
def test_those_of_sbx_act_as_before(kind: str, plain: Any, tmp_path: Path) -> None:
    sbx = pytest.importorskip("sbx")
    # PPO's class is no subclass of SB3's.
    small = {"n_steps": 20, "batch_size": 20} if kind == "PPO" else {}
    model = getattr(sbx, kind)("MlpPolicy", hallucinating(), policy_kwargs={"net_arch": [24, 16]}, seed=0, **small)
    model.learn(160, callback=small_callback(task="learned"))
    export(model, tmp_path / "policy")
    require_equal(plain.load(tmp_path / "policy", device="cpu"), model)


@pytest.mark.slow
def test_what_sbx_has_and_sb3_has_not_is_said(tmp_path: Path) -> None:
    sbx = pytest.importorskip("sbx")
    model = sbx.CrossQ("MlpPolicy", hallucinating(), policy_kwargs={"net_arch": [24]}, seed=0)
    with pytest.raises(ValueError, match=r"of SBX, MlpPolicy of SAC, TQC, TD3, DDPG and PPO can be exported"):
        export(model, tmp_path / "policy")


@pytest.mark.slow
def test_the_zip_files_need_nothing_but_stable_baselines3(sac: SAC, tmp_path: Path) -> None:
    models = {"sac": sac, "td3": trained(TD3), "tqc": trained(TQC), "ppo": trained(PPO), "hsvg": trained(HSVG)}
    kinds = [(type(export(model, tmp_path / f"{name}.zip")).__name__, name) for name, model in models.items()]
    np.save(tmp_path / "observations.npy", OBSERVATIONS)
    command = [sys.executable, "-c", ELSEWHERE, json.dumps([(kind, f"{name}.zip") for kind, name in kinds])]
    subprocess.run(command, cwd=tmp_path, check=True)
    found = np.load(tmp_path / "actions.npz")
    for name, model in models.items():
        np.testing.assert_allclose(found[f"{name}.zip"], actions_of(model)[:, :1], atol=1e-5)


@pytest.mark.parametrize("kind", [SAC, pytest.param(PPO, marks=pytest.mark.slow)])
def test_the_statistics_of_vec_normalize_are_in_the_network(kind: Any, tmp_path: Path) -> None:
    model = trained(kind, wrap=VecNormalize)
    normalizer = model.get_vec_normalize_env()
    assert normalizer is not None
    # VecNormalize clips what is far from all that it has seen, and the first layer does not.
    observations = OBSERVATIONS / 2
    normalised = normalizer.normalize_obs(observations)
    assert float(np.abs(normalised).max()) < normalizer.clip_obs
    expected = actions_of(model, normalised)[:, :1]
    assert float(np.abs(expected - actions_of(model, observations)[:, :1]).max()) > 1e-2
    np.testing.assert_allclose(actions_of(export(model, tmp_path / "policy"), observations), expected, atol=1e-5)
    # A model that is loaded has no environment, and carries the statistics.
    model.save(tmp_path / "model")
    loaded = kind.load(tmp_path / "model", device="cpu")
    np.testing.assert_allclose(actions_of(export(loaded, tmp_path / "policy"), observations), expected, atol=1e-5)


@pytest.mark.parametrize("activation", [nn.ReLU, nn.ELU, lambda: nn.LeakyReLU(0.3)])
def test_activations_of_torch_stay(activation: Any, sac: SAC, tmp_path: Path) -> None:
    model = small_sac(hallucinating(), policy_kwargs={"net_arch": [24, 16], "activation_fn": activation})
    attach_state(model, state_of(sac))
    export(model, tmp_path / "policy")
    loaded = SAC.load(tmp_path / "policy", device="cpu")
    assert repr(loaded.actor.latent_pi[1]) == repr(activation())
    require_equal(loaded, model)


def test_a_linear_policy_can_be_exported(sac: SAC, tmp_path: Path) -> None:
    model = small_sac(hallucinating(), policy_kwargs={"net_arch": []})
    attach_state(model, state_of(sac))
    require_equal(export(model, tmp_path / "policy"), model)


def test_a_policy_without_hallucinated_actions_keeps_all(tmp_path: Path) -> None:
    model = small_sac(imagination_env(max_episode_steps=40, hallucinate=False))
    model.learn(80, callback=small_callback(exploration="greedy"))
    exported = export(model, tmp_path / "policy")
    assert exported.action_space == model.action_space
    require_equal(exported, model)


def test_it_changes_nothing_in_the_training(sac: SAC, tmp_path: Path) -> None:
    before, numbers = actions_of(sac), th.random.get_rng_state()
    export(sac, tmp_path / "policy")
    np.testing.assert_array_equal(actions_of(sac), before)
    assert th.equal(th.random.get_rng_state(), numbers)


def test_a_training_is_not_overwritten(sac: SAC, tmp_path: Path) -> None:
    sac.save(tmp_path / "model")
    with pytest.raises(ValueError, match=r"model\.zip holds a training with its data"):
        export(sac, tmp_path / "model")
    assert state_of(SAC.load(tmp_path / "model", device="cpu")).real_episodes == state_of(sac).real_episodes
    export(sac, tmp_path / "policy")
    export(sac, tmp_path / "policy")


class Own(FlattenExtractor):
    """A class that the zip file would need."""


class Cubed(nn.Module):
    """An activation that torch does not have."""

    def forward(self, inputs: th.Tensor) -> th.Tensor:
        return inputs**3


@pytest.mark.parametrize(
    ("kwargs", "said"),
    [
        ({"policy_kwargs": {"features_extractor_class": Own}}, "features extractor Own cannot be exported"),
        ({"policy_kwargs": {"activation_fn": Cubed}}, "a layer Cubed"),
        ({"policy_kwargs": {"activation_fn": nn.PReLU}}, "a layer PReLU"),
        ({"use_sde": True}, "train with use_sde=False"),
    ],
)
def test_what_cannot_be_exported_is_said(kwargs: dict[str, Any], said: str, sac: SAC, tmp_path: Path) -> None:
    model = small_sac(hallucinating(), **kwargs)
    attach_state(model, state_of(sac))
    with pytest.raises(ValueError, match=said):
        export(model, tmp_path / "policy")
    assert list(tmp_path.iterdir()) == []


def test_planners_and_memory_cannot_be_exported(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="H-MPC has no policy to export"):
        export(HMPC("NoPolicy", hallucinating(), seed=0), tmp_path / "policy")
    with pytest.raises(ValueError, match="remembers what it has seen"):
        export(RecurrentPPO("MlpLstmPolicy", hallucinating(), n_steps=8), tmp_path / "policy")


def test_a_model_that_was_not_trained_here_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not trained with HUCRLCallback"):
        export(small_sac(hallucinating()), tmp_path / "policy")


def test_a_policy_that_uses_its_layers_otherwise_is_found(
    sac: SAC, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = sac.policy._predict
    monkeypatch.setattr(sac.policy, "_predict", lambda *args, **kwargs: -original(*args, **kwargs))
    with pytest.raises(ValueError, match=r"the exported policy differs by .* from model\.predict"):
        export(sac, tmp_path / "policy")
    assert list(tmp_path.iterdir()) == []


def test_the_command_writes_the_policy_into_the_folder_of_the_run(
    sac: SAC, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sac.save(tmp_path / "Pendulum-v1.zip")
    (tmp_path / "progress.csv").touch()
    (tmp_path / "Pendulum-v1").mkdir()
    (tmp_path / "Pendulum-v1" / "args.yml").write_text("{env: Pendulum-v1, algo: sac, env_kwargs: null}")
    (tmp_path / "Pendulum-v1" / "config.yml").write_text("callback: sb3_hucrl.HUCRLCallback")
    monkeypatch.setattr(sys, "argv", ["export_run", str(tmp_path)])
    export_run.main()
    assert capsys.readouterr().out == f"Policy in {tmp_path}/policy.zip, for stable_baselines3.SAC.load\n"
    require_equal(SAC.load(tmp_path / "policy.zip", device="cpu"), sac)
    monkeypatch.setattr(sys, "argv", ["export_run", str(tmp_path), "--output", str(tmp_path / "Pendulum-v1.zip")])
    with pytest.raises(SystemExit):
        export_run.main()
    assert "holds a training with its data" in capsys.readouterr().err
