"""Registers SBX, SB3's algorithms in JAX, with rl_zoo3 as ``sbx_sac`` and so on."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, cast

from rl_zoo3.hyperparams_opt import HYPERPARAMS_CONVERTER, HYPERPARAMS_SAMPLER
from rl_zoo3.utils import ALGOS
from stable_baselines3.common.base_class import BaseAlgorithm

PREFIX = "sbx_"
CLASSES = {"sac": "SAC", "td3": "TD3", "tqc": "TQC", "crossq": "CrossQ", "ppo": "PPO"}
#: names of activation functions in torch.nn, and in jax.nn
ACTIVATIONS = {"Tanh": "tanh", "ReLU": "relu", "ELU": "elu", "LeakyReLU": "leaky_relu"}


class LazyAlgorithm:
    """
    Imports an algorithm when it is first used: importing JAX takes seconds, and most runs do not need it.

    :param name: of the class in ``sbx``
    :raises ImportError: when it is first used, if SBX is not installed
    """

    def __init__(self, name: str) -> None:
        self._name = name

    def _load(self) -> type[BaseAlgorithm]:
        if find_spec("sbx") is None:
            raise ImportError(
                f"{PREFIX}{self._name.lower()} needs SBX, which is not installed: pip install sbx-rl, or use "
                f"{self._name.lower()}, the same algorithm in PyTorch"
            )
        return cast("type[BaseAlgorithm]", getattr(importlib.import_module("sbx"), self._name))

    def __call__(self, *args: Any, **kwargs: Any) -> BaseAlgorithm:
        return self._load()(*args, **kwargs)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._load(), name)


def translated(function: Callable[..., dict[str, Any]]) -> Callable[..., dict[str, Any]]:
    """
    :param function: returns hyperparameters of an SB3 algorithm
    :return: a function that returns those of the SBX algorithm, with JAX's activation functions
    """

    @functools.wraps(function)
    def translate(*args: Any, **kwargs: Any) -> dict[str, Any]:
        hyperparams = function(*args, **kwargs)
        policy_kwargs = hyperparams.get("policy_kwargs", {})
        if "activation_fn" in policy_kwargs:
            name = ACTIVATIONS[policy_kwargs["activation_fn"].__name__]
            policy_kwargs["activation_fn"] = getattr(importlib.import_module("jax.nn"), name)
        return hyperparams

    return translate


def register_sbx() -> None:
    """Register SBX's algorithms with rl_zoo3; they are tuned like their SB3 versions."""
    for algo, name in CLASSES.items():
        ALGOS[PREFIX + algo] = cast("type[BaseAlgorithm]", LazyAlgorithm(name))
        if algo in HYPERPARAMS_SAMPLER:
            HYPERPARAMS_SAMPLER[PREFIX + algo] = translated(HYPERPARAMS_SAMPLER[algo])
            HYPERPARAMS_CONVERTER[PREFIX + algo] = translated(HYPERPARAMS_CONVERTER[algo])
