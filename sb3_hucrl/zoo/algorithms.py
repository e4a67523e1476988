"""This package's own algorithms as rl_zoo3 algorithms: ``--algo hmpc`` and ``--algo mpo``."""

from __future__ import annotations

from typing import Any

import optuna
from rl_zoo3.hyperparams_opt import HYPERPARAMS_CONVERTER, HYPERPARAMS_SAMPLER
from rl_zoo3.utils import ALGOS

from sb3_hucrl.algorithms import HMPC, MPO


def nothing_to_sample(trial: optuna.Trial, n_actions: int, n_envs: int, additional_args: Any) -> dict[str, Any]:
    """H-MPC is all in the callback, whose settings are tuned with every algorithm."""
    return {}


def nothing_to_convert(sampled_params: dict[str, Any]) -> dict[str, Any]:
    """As what there is to sample."""
    return {}


def sample_mpo_params(trial: optuna.Trial, n_actions: int, n_envs: int, additional_args: Any) -> dict[str, Any]:
    """
    What SAC has, and MPO's trust region.

    :param trial: gets the parameters
    :param n_actions: dimensions of the action
    :param n_envs: number of environments
    :param additional_args: rl_zoo3's own
    """
    hyperparams: dict[str, Any] = HYPERPARAMS_SAMPLER["sac"](trial, n_actions, n_envs, additional_args)
    hyperparams["epsilon"] = trial.suggest_float("epsilon", 0.03, 1.0, log=True)
    hyperparams["epsilon_mean"] = trial.suggest_float("epsilon_mean", 1e-3, 0.3, log=True)
    hyperparams["epsilon_std"] = trial.suggest_float("epsilon_std", 1e-5, 1e-2, log=True)
    hyperparams["policy_interval"] = trial.suggest_int("policy_interval", 10, 300, log=True)
    return hyperparams


def register_algorithms() -> None:
    """Make them known to rl_zoo3."""
    ALGOS["hmpc"] = HMPC
    HYPERPARAMS_SAMPLER["hmpc"] = nothing_to_sample
    HYPERPARAMS_CONVERTER["hmpc"] = nothing_to_convert
    ALGOS["mpo"] = MPO
    HYPERPARAMS_SAMPLER["mpo"] = sample_mpo_params
    HYPERPARAMS_CONVERTER["mpo"] = HYPERPARAMS_CONVERTER["sac"]
