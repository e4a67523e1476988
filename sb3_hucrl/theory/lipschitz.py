"""Lipschitz constants of a learned model."""

from __future__ import annotations

from dataclasses import dataclass

import torch as th

from sb3_hucrl.checks import validated
from sb3_hucrl.dynamics.base import Predictor


@dataclass(frozen=True)
class LipschitzEstimate:
    """
    Lower bounds on a model's Lipschitz constants.

    :param mean: L_f, of μ in (s, a)
    :param std: L_σ, of the epistemic σ in (s, a)
    """

    mean: float
    std: float


@validated
@th.enable_grad()
def estimate_lipschitz(model: Predictor, states: th.Tensor, actions: th.Tensor) -> LipschitzEstimate:
    """
    The largest spectral norms of the model's Jacobians at the given points, estimates of L_f and L_σ of Assumption 3.

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
    # Rows of a batch are independent, so the gradient of their sum holds each row's own gradient.
    rows = [
        th.autograd.grad(output.sum(), inputs, retain_graph=True, materialize_grads=True)[0]
        for output in outputs.unbind(dim=1)
    ]
    return float(th.linalg.matrix_norm(th.stack(rows, dim=1), ord=2).max())
