"""The interface of a policy that plans are made around."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import torch as th


@runtime_checkable
class PlannedPolicy(Protocol):
    """A policy (π, η) and its critic as functions of torch tensors, in the units of the environment."""

    @property
    def gamma(self) -> float:
        """The discount that the critic was trained with; 1 without a critic."""

    def act(self, observation: th.Tensor) -> th.Tensor:
        """
        The mode of the policy.

        :param observation: shape (B, observation dimension)
        :return: (a, a′), within their bounds, shape (B, q + h)
        """

    def acting_parameters(self) -> dict[str, th.Tensor]:
        """
        :return: the parameters that the mode depends on, by name
        """

    def act_each(self, parameters: dict[str, th.Tensor], observation: th.Tensor) -> th.Tensor:
        """
        The modes of B policies in one batched call.

        :param parameters: of each policy, by name, shape (B, shape of the parameter)
        :param observation: of each policy, shape (B, observation dimension)
        :return: (a, a′), within their bounds, shape (B, q + h)
        """

    def value(self) -> Callable[[th.Tensor], th.Tensor]:
        """
        :return: the critic's value function V, which maps observations (B, observation dimension) to (B,)
        :raises ValueError: if there is no critic
        """
