"""When a run of rl_zoo3 evaluates besides its real episodes."""

from __future__ import annotations

import inspect
import re
from argparse import Namespace
from pathlib import Path
from typing import Any

import pytest
import rl_zoo3.train
from rl_zoo3.exp_manager import ExperimentManager
from stable_baselines3.common.callbacks import EvalCallback

import sb3_hucrl.zoo  # noqa: F401  # for its effect
from helpers import ENV_ID
from sb3_hucrl.zoo.plugin import DEFAULT_EVAL_FREQ

SAID = "no evaluations besides the real episodes; --eval-freq 25600 asks for them"


def evaluates(folder: Path, env_id: str, algo: str, eval_freq: int, **kwargs: Any) -> bool:
    manager = ExperimentManager(
        Namespace(), algo, env_id, str(folder), n_timesteps=100, eval_freq=eval_freq, log_interval=-1, **kwargs
    )
    manager.setup_experiment()
    return any(isinstance(callback, EvalCallback) for callback in manager.callbacks)


@pytest.mark.parametrize(
    ("eval_freq", "expected"), [(DEFAULT_EVAL_FREQ, False), (25_600, True), (320, True), (-1, False)]
)
def test_a_run_with_our_callback_evaluates_on_request(
    eval_freq: int, expected: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert evaluates(tmp_path, ENV_ID, "sac", eval_freq) == expected
    assert (SAID in capsys.readouterr().out) == (eval_freq == DEFAULT_EVAL_FREQ)


def test_other_runs_evaluate_as_they_did(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert evaluates(tmp_path, "CartPole-v1", "ppo", DEFAULT_EVAL_FREQ)
    assert SAID not in capsys.readouterr().out


def test_a_study_says_nothing_of_evaluations(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert not evaluates(tmp_path, ENV_ID, "sac", DEFAULT_EVAL_FREQ, optimize_hyperparameters=True, n_evaluations=1)
    assert SAID not in capsys.readouterr().out


def test_it_is_rl_zoo3_s_default_that_means_never() -> None:
    [default] = re.findall(r'"--eval-freq".*?default=(\d+)', inspect.getsource(rl_zoo3.train), flags=re.DOTALL)
    assert int(default) == DEFAULT_EVAL_FREQ, "zoo/plugin.py: DEFAULT_EVAL_FREQ"
