"""Interrupted training runs lose no real step, and long ones leak no memory."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import IO

import pytest
import torch as th
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env

from helpers import ENV_ID, EPISODE_STEPS, imagination_env, small_callback, small_sac, state_of
from sb3_hucrl import HallucinationWrapper, ImaginationVecEnv, TransitionDataset
from sb3_hucrl.dynamics import FitReport, ProbabilisticEnsemble
from sb3_hucrl.sb3 import save_atomically
from sb3_hucrl.zoo.runs import ZooRun

ROOT = Path(__file__).parents[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algo", "vec_env", "kills"),
    [("sac", "dummy", 2), ("sac", "subproc", 1), ("ppo", "dummy", 1), ("sbx_sac", "dummy", 1)],
)
def test_killed_trainings_go_on_where_their_checkpoint_was(algo: str, vec_env: str, kills: int) -> None:
    if algo.startswith("sbx"):
        pytest.importorskip("sbx")
    script = str(ROOT / "scripts" / "kill_and_resume.py")
    command = [sys.executable, script, "--kills", str(kills), "--algo", algo, "--vec-env", vec_env]
    process = subprocess.run(command, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr
    assert "nothing lost" in process.stdout


RUN = "import runpy; runpy.run_module('sb3_hucrl.zoo', run_name='__main__')"
#: takes its time to write the final model, and says so
SLOW = f"""
import time, zipfile
writestr = zipfile.ZipFile.writestr

def write_slowly(self, *args, **kwargs):
    if "{ENV_ID}.zip" in str(self.filename):
        print("saving", flush=True)
        time.sleep(60)
    return writestr(self, *args, **kwargs)

zipfile.ZipFile.writestr = write_slowly
{RUN}
"""


def training(folder: Path, code: str = RUN) -> tuple[subprocess.Popen[str], Path]:
    """A training run that has written its first checkpoint, and its folder."""
    callback = {"horizon": 20, "imagined_steps": 320, "dynamics_kwargs": {"gradient_steps": 20}}
    command = [
        *(sys.executable, "-c", code, "train", "--algo", "sac", "--env", ENV_ID, "-n", "1000000"),
        *("--eval-freq", "-1", "--num-threads", "1", "-params", "gradient_steps:1", "n_envs:4"),
        f"callback:[{{'sb3_hucrl.callbacks.HUCRLCallback': {callback}}}]",
    ]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    run, deadline = folder / "logs" / "sac" / f"{ENV_ID}_1", time.monotonic() + 120
    while not (run / "checkpoint.zip").exists():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return process, run


def require_whole(path: Path) -> None:
    state = state_of(SAC.load(path, device="cpu"))
    assert state.real_episodes == len(state.dataset.lengths) >= 1


@pytest.mark.slow
def test_a_polite_end_saves_what_was_learned(tmp_path: Path) -> None:
    process, run = training(tmp_path)
    process.send_signal(signal.SIGTERM)
    output, _ = process.communicate(timeout=120)
    assert process.returncode == 0, output
    require_whole(run / f"{ENV_ID}.zip")


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.05])
def test_a_second_request_to_end_leaves_a_whole_checkpoint(delay: float, tmp_path: Path) -> None:
    process, run = training(tmp_path)
    known = len(state_of(SAC.load(run / "checkpoint.zip", device="cpu")).dataset)
    process.send_signal(signal.SIGTERM)
    time.sleep(delay)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=120)
    require_whole(run / "checkpoint.zip")
    assert len(state_of(SAC.load(run / "checkpoint.zip", device="cpu")).dataset) >= known


@pytest.mark.slow
def test_a_second_request_to_end_leaves_no_half_of_the_final_model(tmp_path: Path) -> None:
    process, run = training(tmp_path, SLOW)
    process.send_signal(signal.SIGTERM)
    assert process.stdout is not None
    assert any(line == "saving\n" for line in process.stdout)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=120)
    assert process.returncode == -signal.SIGTERM
    assert not (run / f"{ENV_ID}.zip").exists()
    assert ZooRun(run).state.real_episodes >= 1


class InterruptedFit(ProbabilisticEnsemble):
    """Is interrupted in its second fit, and never again."""

    fits = 0

    def fit(self, dataset: TransitionDataset, generator: th.Generator) -> FitReport:
        type(self).fits += 1
        if self.fits == 2:
            raise KeyboardInterrupt
        return super().fit(dataset, generator)


def test_a_resumed_run_begins_its_episodes_elsewhere(tmp_path: Path) -> None:
    starts = []
    for _ in range(2):
        env = ImaginationVecEnv(make_vec_env("Pendulum-v1", n_envs=2, wrapper_class=HallucinationWrapper))
        model = small_sac(env).learn(80, callback=small_callback())
        for _ in range(2):
            model.save(tmp_path / "model")
            model = SAC.load(tmp_path / "model", env=env).learn(
                80, callback=small_callback(), reset_num_timesteps=False
            )
        starts.append(state_of(model).dataset.initial_states)
    assert len(starts[0].unique(dim=0)) == len(starts[0]) == 4
    # And the same ones each time.
    assert th.equal(*starts)


def test_an_interrupted_refit_is_made_up_for(tmp_path: Path) -> None:
    model = small_sac()
    checkpoint = tmp_path / "checkpoint.zip"
    with pytest.raises(KeyboardInterrupt):
        model.learn(240, callback=small_callback(dynamics=InterruptedFit(2, 1), checkpoint=str(checkpoint)))
    # The episode that the fit was for is there, on disk as well.
    loaded = SAC.load(checkpoint, env=imagination_env(), device="cpu")
    for each in (model, loaded):
        assert state_of(each).real_episodes == 2
        assert state_of(each).fitted_steps == EPISODE_STEPS
    loaded.learn(80, callback=small_callback(dynamics=InterruptedFit(2, 1)))
    assert state_of(loaded).real_episodes == 3
    assert state_of(loaded).fitted_steps == 3 * EPISODE_STEPS


def test_a_save_that_fails_leaves_the_last_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model, path = small_sac(), tmp_path / "run" / "checkpoint.zip"
    save_atomically(model, path)
    before = path.read_bytes()

    def half(file: IO[bytes]) -> None:
        file.write(b"PK")
        raise OSError("disk full")

    monkeypatch.setattr(model, "save", half)
    with pytest.raises(OSError, match="disk full"):
        save_atomically(model, path)
    assert path.read_bytes() == before


@pytest.mark.slow
def test_imagination_does_not_eat_memory() -> None:
    def resident() -> int:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE")

    if not Path("/proc/self/statm").exists():
        pytest.skip("no /proc here")
    env = imagination_env(32)
    model = small_sac(env, train_freq=4, buffer_size=10_000)
    sizes = []
    for _ in range(10):
        model.learn(10_000, callback=small_callback(imagined_steps=5_000, horizon=100))
        sizes.append(resident())
    assert sizes[-1] < 1.05 * sizes[1]
