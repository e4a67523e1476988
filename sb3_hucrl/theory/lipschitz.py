"""How steep a learned model is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch as th

if TYPE_CHECKING:
    from sb3_hucrl.dynamics.base import Predictor


@dataclass(frozen=True)
class LipschitzEstimate:
    """
    The steepest that was found: a lower bound on the constant.

    :param mean: of μ in (s, a)
    :param std: of the epistemic σ in (s, a)
    """

    mean: float
    std: float


@th.enable_grad()
def estimate_lipschitz(model: Predictor, states: th.Tensor, actions: th.Tensor) -> LipschitzEstimate:
    """
    The largest spectral norm of the model's Jacobians at these points, L_f and L_σ of Assumption 3.

    :param model: differentiable dynamics
    :param states: shape (B, p)
    :param actions: shape (B, q)
    """
    inputs = th.cat([states, actions], dim=1).detach().requires_grad_()
    prediction = model.predict(*inputs.split([states.shape[1], actions.shape[1]], dim=1))
    return LipschitzEstimate(_steepest(prediction.mean, inputs), _steepest(prediction.epistemic_std, inputs))


def _steepest(outputs: th.Tensor, inputs: th.Tensor) -> float:
    if not outputs.requires_grad:
        return 0.0
    # Rows of a batch do not depend on each other, so a sum over them has each row's own gradient.
    rows = [
        th.autograd.grad(output.sum(), inputs, retain_graph=True, materialize_grads=True)[0]
        for output in outputs.unbind(dim=1)
    ]
    return float(th.linalg.matrix_norm(th.stack(rows, dim=1), ord=2).max())
