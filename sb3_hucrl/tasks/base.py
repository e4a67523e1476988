"""What a task knows, so that no model has to learn it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import torch as th


class Task(ABC):
    """
    Reward, termination and the map between state and observation, in batched torch.

    The state is what the dynamics model predicts and what hallucination acts on. It may be smaller than the
    observation, so that every imagined observation is a possible one. The defaults suit a task whose observation is
    its state and which never terminates. No method ever sees a hallucinated action.
    """

    #: p, the number of state dimensions
    state_dim: int
    #: indices of the state's angles, in radians
    angle_dims: tuple[int, ...] = ()

    @abstractmethod
    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        """
        :param state: shape (B, p)
        :param action: in the units of the environment and within its bounds, shape (B, q)
        :param next_state: shape (B, p)
        :return: shape (B,)
        """

    def terminated(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        """
        :param state: shape (B, p)
        :param action: in the units of the environment and within its bounds, shape (B, q)
        :param next_state: shape (B, p)
        :return: whether next_state ends the task, shape (B,), boolean
        """
        return th.zeros(len(state), dtype=th.bool, device=state.device)

    def observe(self, state: th.Tensor) -> th.Tensor:
        """
        :param state: shape (B, p)
        :return: what the policy sees, shape (B, observation dimension)
        """
        return state

    def state(self, observation: th.Tensor) -> th.Tensor:
        """
        The inverse of :meth:`observe`, angles up to whole turns.

        :param observation: shape (B, observation dimension)
        :return: shape (B, p)
        """
        return observation

    def exploratory_states(self, n: int, generator: th.Generator | None) -> th.Tensor | None:
        """
        Start states that cover what matters (appendix C.1: 'any exploratory distribution').

        :param n: how many
        :param generator: draws them, on the CPU
        :return: shape (n, p), or None where the task knows no such distribution
        """
        return None


def tolerance(values: th.Tensor, lower: float, upper: float, margin: float) -> th.Tensor:
    """
    dm_control's gaussian tolerance: 1 within [lower, upper], 0.1 at a distance of one margin.

    :param values: any shape
    :param lower: lower end of the interval
    :param upper: upper end of the interval
    :param margin: distance at which the value has fallen to 0.1
    :return: the shape of values
    """
    distance = values - values.clamp(lower, upper)
    return (distance.square() * (math.log(0.1) / margin**2)).exp()
