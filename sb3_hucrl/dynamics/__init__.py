"""Dynamics models, chosen by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch as th

from sb3_hucrl.checks import Count, Natural, validated
from sb3_hucrl.dynamics.base import DynamicsModel, FitReport, Prediction, Predictor
from sb3_hucrl.dynamics.ensemble import DeterministicEnsemble, ProbabilisticEnsemble
from sb3_hucrl.registry import Registry

__all__ = [
    "DYNAMICS",
    "LEARNED",
    "DeterministicEnsemble",
    "DynamicsModel",
    "FitReport",
    "Prediction",
    "Predictor",
    "ProbabilisticEnsemble",
    "make_dynamics",
]

#: dynamics models by name; GPyTorch is imported only for the models that need it
DYNAMICS: Registry[DynamicsModel] = Registry(
    "dynamics",
    {
        "ensemble": ProbabilisticEnsemble,
        "deterministic_ensemble": DeterministicEnsemble,
        "gp": "sb3_hucrl.dynamics.gp:ExactGP",
        "sparse_gp": "sb3_hucrl.dynamics.sparse_gp:SparseGP",
        "rff": "sb3_hucrl.dynamics.features:RandomFourierModel",
        "qff": "sb3_hucrl.dynamics.features:QuadratureFourierModel",
        "truth": "sb3_hucrl.dynamics.truth:TrueDynamics",
    },
)
#: the built-in models that learn; ``"truth"`` steps the environment instead, to show what a policy search can reach
LEARNED = tuple(name for name in DYNAMICS if name != "truth")


@validated
def make_dynamics(
    name: str,
    state_dim: Count,
    action_dim: Count,
    angle_dims: Sequence[Natural],
    generator: th.Generator,
    **kwargs: Any,
) -> DynamicsModel:
    """
    Build a dynamics model by name.

    :param name: registered in :data:`DYNAMICS`
    :param state_dim: p
    :param action_dim: q, without the hallucinated dimensions
    :param angle_dims: indices of the state's angles
    :param generator: draws the initial parameters
    :param kwargs: further arguments of the model's class
    :raises ValueError: if the name is unknown or an argument is out of range
    """
    return DYNAMICS.make(name, state_dim, action_dim, angle_dims, generator=generator, **kwargs)
