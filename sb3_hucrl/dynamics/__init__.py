"""Learned dynamics models, chosen by name."""

from __future__ import annotations

import pkgutil
from collections.abc import Sequence
from typing import Any

import torch as th

from sb3_hucrl.dynamics.base import DynamicsModel, FitReport, Prediction, Predictor
from sb3_hucrl.dynamics.ensemble import DeterministicEnsemble, ProbabilisticEnsemble

__all__ = [
    "DYNAMICS",
    "NOT_LEARNED",
    "DeterministicEnsemble",
    "DynamicsModel",
    "FitReport",
    "Prediction",
    "Predictor",
    "ProbabilisticEnsemble",
    "make_dynamics",
    "require_known",
]

#: where each model lives; GPyTorch is imported only for the models that need it
DYNAMICS = {
    "ensemble": "sb3_hucrl.dynamics.ensemble:ProbabilisticEnsemble",
    "deterministic_ensemble": "sb3_hucrl.dynamics.ensemble:DeterministicEnsemble",
    "gp": "sb3_hucrl.dynamics.gp:ExactGP",
    "sparse_gp": "sb3_hucrl.dynamics.sparse_gp:SparseGP",
    "rff": "sb3_hucrl.dynamics.features:RandomFourierModel",
    "qff": "sb3_hucrl.dynamics.features:QuadratureFourierModel",
}
#: what is no model at all, and takes a model's place to find out what a search can do
NOT_LEARNED = {"truth": "sb3_hucrl.dynamics.truth:TrueDynamics"}


def require_known(name: str) -> None:
    """
    :param name: of a model
    :raises ValueError: unless it is a key of :data:`DYNAMICS` or :data:`NOT_LEARNED`
    """
    known = DYNAMICS | NOT_LEARNED
    if name not in known:
        raise ValueError(f"unknown dynamics {name!r}: choose one of {sorted(known)}")


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

    :param name: a key of :data:`DYNAMICS` or :data:`NOT_LEARNED`
    :param state_dim: p
    :param action_dim: q, without the hallucinated dimensions
    :param angle_dims: indices of the state's angles
    :param generator: draws what is random about an unfitted model
    :param kwargs: further arguments of the model's class
    :raises ValueError: if the name is unknown
    """
    require_known(name)
    model: DynamicsModel = pkgutil.resolve_name((DYNAMICS | NOT_LEARNED)[name])(
        state_dim, action_dim, angle_dims, generator=generator, **kwargs
    )
    return model
