"""Trainings on another device than the CPU, where there is none and where there is one."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch as th
from stable_baselines3 import PPO, SAC

from helpers import imagination_env, pendulum_dataset, random_transitions, small_callback, small_sac
from sb3_hucrl import export
from sb3_hucrl.algorithms import HBPTT, HMPC, HSVG
from sb3_hucrl.dynamics import LEARNED, make_dynamics

TESTS = Path(__file__).parent
on_gpu = pytest.mark.skipif(not th.cuda.is_available(), reason="there is no GPU")
#: on a machine without a GPU
ELSEWHERE = """
import sys
import numpy as np, torch
from stable_baselines3 import SAC
assert not torch.cuda.is_available()
model = SAC.load("model.zip")
assert model.hucrl.dynamics.device.type == "cpu"
np.save("actions.npy", model.predict(np.load("observations.npy"), deterministic=True)[0])
"""


@pytest.mark.slow
def test_nothing_is_on_the_wrong_device() -> None:
    """On a device that stands in for a GPU, see there."""
    pytest.importorskip("torch.utils.backend_registration")
    if not hasattr(th.utils.backend_registration, "_setup_privateuseone_for_python_backend"):
        pytest.skip("this PyTorch has no devices in Python")
    command = [sys.executable, "-W", "ignore", "-c", "import stand_in_device; stand_in_device.main()"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(TESTS), str(TESTS.parent)])}
    run = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=environment)
    result = json.loads(run.stdout.splitlines()[-1])
    assert result["mistakes"] == []
    assert result["faults"] == {}
    assert len(result["trainings"]) > 20


@pytest.mark.gpu
@on_gpu
@pytest.mark.parametrize("name", LEARNED)
def test_models_predict_on_a_gpu_as_on_the_cpu(name: str) -> None:
    model = make_dynamics(name, 2, 1, (0,), th.Generator().manual_seed(0))
    model.fit(pendulum_dataset(200), th.Generator().manual_seed(0))
    batch = random_transitions(50, seed=1)
    with th.no_grad():
        expected = model.predict(batch.states, batch.actions)
        found = model.to("cuda").predict(batch.states.cuda(), batch.actions.cuda())
    for each, known in ((found.mean, expected.mean), (found.epistemic_std, expected.epistemic_std)):
        assert each.is_cuda
        np.testing.assert_allclose(each.cpu(), known, rtol=1e-3, atol=1e-4)


@pytest.mark.gpu
@on_gpu
@pytest.mark.parametrize("name", LEARNED)
def test_models_are_fitted_on_a_gpu(name: str) -> None:
    losses = []
    for device in ("cpu", "cuda"):
        model = make_dynamics(name, 2, 1, (0,), th.Generator().manual_seed(0)).to(device)
        losses.append(model.fit(pendulum_dataset(200), th.Generator().manual_seed(0)).holdout_nll)
        assert model.device.type == device
    assert losses[1] == pytest.approx(losses[0], abs=0.5)


@pytest.mark.gpu
@on_gpu
@pytest.mark.parametrize("kind", [SAC, HSVG, HBPTT, PPO, HMPC])
def test_algorithms_train_on_a_gpu(kind: Any, tmp_path: Path) -> None:
    small = {} if kind in (PPO, HMPC) else {"batch_size": 16, "buffer_size": 1_000}
    policy, settings = ("NoPolicy", {"planner": "icem"}) if kind is HMPC else ("MlpPolicy", {})
    model = kind(policy, imagination_env(max_episode_steps=20), device="cuda", seed=0, **small)
    model.learn(1 if kind is HMPC else 160, callback=small_callback(**settings))
    assert model.hucrl.dynamics.device.type == "cuda"
    observations = np.random.default_rng(0).normal(size=(8, 3)).astype(np.float32)
    actions = model.predict(observations, deterministic=True)[0]
    assert np.isfinite(actions).all()
    if kind is not HMPC:
        exported = export(model, tmp_path / "policy")
        np.testing.assert_allclose(exported.predict(observations, deterministic=True)[0], actions[:, :1], atol=1e-4)


@pytest.mark.gpu
@on_gpu
def test_a_checkpoint_loads_on_a_machine_without_a_gpu(tmp_path: Path) -> None:
    path, observations = tmp_path / "model.zip", np.random.default_rng(0).normal(size=(8, 3)).astype(np.float32)
    model = small_sac(imagination_env(max_episode_steps=20), device="cuda")
    model.learn(160, callback=small_callback(checkpoint=str(path)))
    np.save(tmp_path / "observations.npy", observations)
    environment = {**os.environ, "CUDA_VISIBLE_DEVICES": "", "PYTHONPATH": str(TESTS.parent)}
    subprocess.run([sys.executable, "-c", ELSEWHERE], check=True, cwd=tmp_path, env=environment)
    expected = SAC.load(path, device="cuda").predict(observations, deterministic=True)[0]
    np.testing.assert_allclose(np.load(tmp_path / "actions.npy"), expected, atol=1e-4)
