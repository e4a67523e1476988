"""Epistemic uncertainty along transitions, and a limit on it that is learned from the real ones."""

from __future__ import annotations

import torch as th

from sb3_hucrl.checks import Positive, validated
from sb3_hucrl.data import Transitions
from sb3_hucrl.dynamics.base import Predictor

#: fraction of the real transitions whose uncertainty counts as ordinary
QUANTILE = 0.95


@validated
@th.no_grad()
def epistemic_std(model: Predictor, transitions: Transitions) -> th.Tensor:
    """
    :param model: newly fitted
    :param transitions: n real or imagined ones
    :return: diagonal of Σ(s, a), in state units, shape (n, p)
    """
    states = transitions.states[:, : model.state_dim].to(model.device)
    return model.predict(states, transitions.actions.to(model.device)).epistemic_std


@validated
def epistemic_limit(model: Predictor, transitions: Transitions, multiple: Positive) -> th.Tensor:
    """
    A multiple of the epistemic std that 95 % of the real transitions stay below, as in MACURA (Frauenknecht et al.
    2024).

    :param model: newly fitted
    :param transitions: all real ones
    :param multiple: of that quantile
    :return: one limit per state dimension, shape (p,)
    """
    return multiple * epistemic_std(model, transitions).quantile(QUANTILE, dim=0)
