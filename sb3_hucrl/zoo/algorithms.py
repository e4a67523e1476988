"""This package's own algorithms as rl_zoo3 algorithms: ``--algo mpo`` and so on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import optuna
from rl_zoo3.hyperparams_opt import HYPERPARAMS_CONVERTER, HYPERPARAMS_SAMPLER
from rl_zoo3.utils import ALGOS
from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.algorithms import HBPTT, HMPC, HMPO, HMVE, HSVG, MPO

OUR_ALGORITHMS: dict[str, type[BaseAlgorithm]] = {
    "hmpc": HMPC,
    "mpo": MPO,
    "hmpo": HMPO,
    "hbptt": HBPTT,
    "hmve": HMVE,
    "hsvg": HSVG,
}


def nothing_to_sample(trial: optuna.Trial, n_actions: int, n_envs: int, additional_args: Any) -> dict[str, Any]:
    """H-MPC has no hyperparameters of its own; the callback's settings are tuned with every algorithm."""
    return {}


def nothing_to_convert(sampled_params: dict[str, Any]) -> dict[str, Any]:
    """The sampled parameters of H-MPC are only the callback's settings."""
    return dict(sampled_params)


def with_sac_params(more: Callable[[optuna.Trial], dict[str, Any]]) -> Callable[..., dict[str, Any]]:
    """
    :param more: samples an algorithm's own hyperparameters
    :return: a sampler of these and of SAC's hyperparameters, which all algorithms of this package share
    """

    def sample(trial: optuna.Trial, n_actions: int, n_envs: int, additional_args: Any) -> dict[str, Any]:
        shared: dict[str, Any] = HYPERPARAMS_SAMPLER["sac"](trial, n_actions, n_envs, additional_args)
        return {**shared, **more(trial)}

    return sample


def sample_mpo_params(trial: optuna.Trial) -> dict[str, Any]:
    """Samples MPO's trust region."""
    return {
        "epsilon": trial.suggest_float("epsilon", 0.03, 1.0, log=True),
        "epsilon_mean": trial.suggest_float("epsilon_mean", 1e-3, 0.3, log=True),
        "epsilon_std": trial.suggest_float("epsilon_std", 1e-5, 1e-2, log=True),
        "policy_interval": trial.suggest_int("policy_interval", 10, 300, log=True),
    }


def sample_hbptt_params(trial: optuna.Trial) -> dict[str, Any]:
    """Samples H-BPTT's horizon and the weight of its KL penalty."""
    return {
        "horizon": trial.suggest_int("horizon", 1, 30, log=True),
        "kl_weight": trial.suggest_float("kl_weight", 1e-7, 1e-2, log=True),
    }


def sample_hmve_params(trial: optuna.Trial) -> dict[str, Any]:
    """Samples H-MVE's horizon and weighting."""
    return {
        "horizon": trial.suggest_int("horizon", 1, 20, log=True),
        "weighting": trial.suggest_categorical("weighting", ["none", "steve"]),
    }


def sample_hsvg_params(trial: optuna.Trial) -> dict[str, Any]:
    """Samples H-SVG's horizon and the updates of its critics alone."""
    return {
        "horizon": trial.suggest_int("horizon", 1, 20, log=True),
        "critic_updates": trial.suggest_int("critic_updates", 50, 1_000, log=True),
    }


def register_algorithms() -> None:
    """Register the algorithms of this package with rl_zoo3."""
    ALGOS.update(OUR_ALGORITHMS)
    HYPERPARAMS_SAMPLER["hmpc"] = nothing_to_sample
    HYPERPARAMS_CONVERTER["hmpc"] = nothing_to_convert
    searches = {
        "mpo": sample_mpo_params,
        "hmpo": sample_mpo_params,
        "hbptt": sample_hbptt_params,
        "hmve": sample_hmve_params,
        "hsvg": sample_hsvg_params,
    }
    for name, sample in searches.items():
        HYPERPARAMS_SAMPLER[name] = with_sac_params(sample)
        HYPERPARAMS_CONVERTER[name] = HYPERPARAMS_CONVERTER["sac"]
