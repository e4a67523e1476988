"""Learned dynamics models, chosen by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch as th

from sb3_hucrl.dynamics.base import DynamicsModel, FitReport, Prediction
from sb3_hucrl.dynamics.ensemble import ProbabilisticEnsemble

__all__ = ["DYNAMICS", "DynamicsModel", "FitReport", "Prediction", "ProbabilisticEnsemble", "make_dynamics"]

DYNAMICS: dict[str, type[ProbabilisticEnsemble]] = {"ensemble": ProbabilisticEnsemble}


def make_dynamics(
    name: str,
    state_dim: int,
    action_dim: int,
    angle_dims: Sequence[int],
    generator: th.Generator,
    **kwargs: Any,
) -> DynamicsModel:
    """
    Build a model by its name.

    :param name: a key of :data:`DYNAMICS`
    :param state_dim: p
    :param action_dim: q, without the hallucinated dimensions
    :param angle_dims: indices of the state's angles
    :param generator: draws the initial weights
    :param kwargs: further arguments of the model's class
    :raises ValueError: if the name is unknown
    """
    if name not in DYNAMICS:
        raise ValueError(f"unknown dynamics {name!r}: choose one of {sorted(DYNAMICS)}")
    return DYNAMICS[name](state_dim, action_dim, angle_dims, generator=generator, **kwargs)
