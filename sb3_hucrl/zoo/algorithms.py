"""This package's own algorithms as rl_zoo3 algorithms: ``--algo hmpc``."""

from __future__ import annotations

from typing import Any

import optuna
from rl_zoo3.hyperparams_opt import HYPERPARAMS_CONVERTER, HYPERPARAMS_SAMPLER
from rl_zoo3.utils import ALGOS

from sb3_hucrl.algorithms import HMPC


def nothing_to_sample(trial: optuna.Trial, n_actions: int, n_envs: int, additional_args: Any) -> dict[str, Any]:
    """H-MPC is all in the callback, whose settings are tuned with every algorithm."""
    return {}


def nothing_to_convert(sampled_params: dict[str, Any]) -> dict[str, Any]:
    """As what there is to sample."""
    return {}


def register_algorithms() -> None:
    """Make them known to rl_zoo3."""
    ALGOS["hmpc"] = HMPC
    HYPERPARAMS_SAMPLER["hmpc"] = nothing_to_sample
    HYPERPARAMS_CONVERTER["hmpc"] = nothing_to_convert
