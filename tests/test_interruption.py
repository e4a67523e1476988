"""What remains of a training that did not come to its end."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest
import torch as th
from sb3_contrib import ARS
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback, EvalCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecNormalize

from helpers import EPISODE_STEPS, imagination_env, small_callback, small_sac, state_of
from sb3_hucrl import HUCRLCallback
from sb3_hucrl.zoo.interrupt import Termination

#: of a training that a test interrupts
NOT_YET = 60


class Interrupt(BaseCallback):
    """Ends a training as Ctrl-C does."""

    def _on_step(self) -> bool:
        if self.num_timesteps >= NOT_YET:
            raise KeyboardInterrupt
        return True


def interrupted(model: BaseAlgorithm) -> BaseAlgorithm:
    with pytest.raises(KeyboardInterrupt):
        model.learn(1_000, callback=[small_callback(), Interrupt()])
    return model


@pytest.mark.parametrize("algorithm", ["sac", "ppo", "ars"])
def test_an_evaluation_after_an_interruption_is_real(algorithm: str) -> None:
    env = imagination_env(max_episode_steps=25)
    if algorithm == "sac":
        model: BaseAlgorithm = small_sac(env)
    elif algorithm == "ppo":
        model = PPO("MlpPolicy", VecNormalize(env), n_steps=10, batch_size=20, device="cpu", seed=0)
    else:
        model = ARS("LinearPolicy", env, n_delta=2, device="cpu", seed=0)
    interrupted(model)
    assert env.trajectories is not None
    before = sum(env.get_attr("total_steps"))
    vec_env = model.get_env()
    assert vec_env is not None
    with pytest.warns(UserWarning, match="was interrupted: from this reset on they are the real ones again"):
        evaluate_policy(model, vec_env, n_eval_episodes=4)
    assert sum(env.get_attr("total_steps")) - before == 4 * 25
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        vec_env.reset()


def test_an_interrupted_training_goes_on() -> None:
    model = interrupted(small_sac(imagination_env(max_episode_steps=25)))
    with pytest.warns(UserWarning, match="was interrupted"):
        model.learn(80, callback=small_callback())
    assert state_of(model).real_episodes == 2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        interrupted(model).learn(80, callback=small_callback(), reset_num_timesteps=False)


def test_an_evaluation_during_training_leaves_imagination_alone() -> None:
    env = imagination_env(max_episode_steps=25)
    seen: list[bool] = []

    class Spy(BaseCallback):
        def _on_step(self) -> bool:
            seen.append(env.trajectories is not None)
            return True

    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        evaluation = EvalCallback(imagination_env(1, max_episode_steps=25), eval_freq=10, verbose=0, warn=False)
        ARS("LinearPolicy", env, n_delta=2, device="cpu", seed=0).learn(
            160, callback=[small_callback(), evaluation, Spy()]
        )
    assert all(seen)
    assert env.trajectories is None


def test_an_interrupted_search_is_not_played_for_real() -> None:
    class InterruptsItself(HUCRLCallback):
        def _on_step(self) -> bool:
            if self.num_timesteps == 40:
                raise KeyboardInterrupt
            return True

    callback, env = InterruptsItself(imagined_steps=80, dynamics_kwargs={"gradient_steps": 5}), imagination_env()
    model = small_sac(env)
    with pytest.raises(KeyboardInterrupt):
        model.learn(160, callback=callback)
    callback.on_training_end()
    assert state_of(model).real_episodes == 1
    assert env.trajectories is None


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_request_to_end_that_python_drops_is_met_at_the_next_step() -> None:
    def request(phase: str, info: dict[str, int]) -> None:
        os.kill(os.getpid(), signal.SIGTERM)

    class Collects(BaseCallback):
        def _on_step(self) -> bool:
            if self.num_timesteps == 40:
                gc.callbacks.append(request)
                gc.collect()
                gc.callbacks.remove(request)
            return True

    termination, model = Termination(), small_sac()
    before = signal.getsignal(signal.SIGTERM)
    with termination.listening(), pytest.raises(KeyboardInterrupt):
        model.learn(1_000, callback=[small_callback(), Collects(), termination])
    assert model.num_timesteps == 40
    assert signal.getsignal(signal.SIGTERM) == before


SCRIPT = """
import sys
from helpers import imagination_env, small_callback, small_sac
from stable_baselines3.common.callbacks import CheckpointCallback
checkpoints = CheckpointCallback(25, sys.argv[1])
small_sac(imagination_env()).learn(1_000_000, callback=[small_callback(), checkpoints])
"""


@pytest.mark.slow
def test_a_killed_run_goes_on_from_its_last_checkpoint(tmp_path: Path) -> None:
    process = subprocess.Popen([sys.executable, "-c", SCRIPT, str(tmp_path)], cwd=Path(__file__).parent)
    deadline = time.monotonic() + 120
    while len(checkpoints := sorted(tmp_path.glob("*.zip"), key=lambda path: path.stat().st_mtime)) < 4:
        assert time.monotonic() < deadline
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    # The newest file may have been cut off while it was written; the one before it is whole.
    model = SAC.load(checkpoints[-2], env=imagination_env(), device="cpu")
    saved = state_of(model).dataset.transitions
    episodes = state_of(model).real_episodes
    assert len(saved) == EPISODE_STEPS * episodes > 0
    model.learn(80, callback=small_callback())
    now = state_of(model).dataset.transitions
    assert th.equal(now.states[: len(saved)], saved.states)
    assert state_of(model).real_episodes == episodes + 1
