"""Copies of an SB3 algorithm's policy and critics."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any

from stable_baselines3.common.base_class import BaseAlgorithm


@dataclass(frozen=True)
class Parameters:
    """
    Policy and critics of an algorithm at one moment. Optimiser states stay with the algorithm.

    :param torch: state dict of the policy
    :param jax: training states of a policy of sbx, which keeps nothing in torch
    """

    torch: dict[str, Any]
    jax: dict[str, Any]

    @staticmethod
    def of(model: BaseAlgorithm) -> Parameters:
        """
        :param model: any SB3 algorithm
        :return: a copy, on the CPU
        """
        torch = {name: value.detach().cpu().clone() for name, value in model.policy.state_dict().items()}
        # Never changed in place: a new one takes their place at every gradient step.
        jax = {name: value for name, value in vars(model.policy).items() if name.endswith("_state")}
        return Parameters(torch, jax)

    def restore(self, model: BaseAlgorithm) -> None:
        """
        :param model: it goes on with these parameters
        """
        model.policy.load_state_dict(self.torch)
        for name, value in self.jax.items():
            setattr(model.policy, name, copy.copy(value))
