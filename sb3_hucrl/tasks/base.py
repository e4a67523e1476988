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

    Every state tensor has p + c columns: after the p that the model predicts come c of context, constants of an episode
    such as a goal. Imagination carries them along; they are neither learned nor hallucinated.
    """

    #: p, the number of state dimensions
    state_dim: int
    #: c, the number of context columns that follow them
    context_dim: int = 0
    #: how many of the state's last dimensions are outcomes of the step into it, such as a learned reward: known only
    #: afterwards, and 0 in every state that a step starts from
    outcome_dim: int = 0
    #: indices of the state's angles, in radians
    angle_dims: tuple[int, ...] = ()

    @property
    def width(self) -> int:
        """p + c, the columns of a state tensor."""
        return self.state_dim + self.context_dim

    @property
    def hallucinated_dim(self) -> int:
        """How many of the state's first dimensions hallucination may steer: all but the outcomes."""
        return self.state_dim - self.outcome_dim

    @abstractmethod
    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        """
        :param state: shape (B, p + c)
        :param action: in the units of the environment and within its bounds, shape (B, q)
        :param next_state: shape (B, p + c)
        :return: shape (B,)
        """

    def terminated(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        """
        :param state: shape (B, p + c)
        :param action: in the units of the environment and within its bounds, shape (B, q)
        :param next_state: shape (B, p + c)
        :return: whether next_state ends the task, shape (B,), boolean
        """
        return th.zeros(len(state), dtype=th.bool, device=state.device)

    def observe(self, state: th.Tensor) -> th.Tensor:
        """
        :param state: shape (B, p + c)
        :return: what the policy sees, shape (B, observation dimension)
        """
        return state

    def state(self, observation: th.Tensor) -> th.Tensor:
        """
        The inverse of :meth:`observe`, angles up to whole turns.

        :param observation: shape (B, observation dimension)
        :return: shape (B, p + c)
        """
        return observation

    def exploratory_states(self, n: int, generator: th.Generator | None) -> th.Tensor | None:
        """
        Start states that cover what matters (appendix C.1: 'any exploratory distribution').

        :param n: how many
        :param generator: draws them, on the CPU
        :return: shape (n, p + c), or None where the task knows no such distribution
        """
        return None

    def sample_contexts(self, n: int, generator: th.Generator | None) -> th.Tensor | None:
        """
        Contexts as real episodes draw them, so that imagination practises on more of them than were met.

        :param n: how many
        :param generator: draws them, on the CPU
        :return: shape (n, c), or None to reuse those of real episodes
        """
        return None

    def record_outcomes(self, next_states: th.Tensor, rewards: th.Tensor, terminated: th.Tensor) -> th.Tensor:
        """
        Put what real steps led to where the model shall learn to predict it.

        :param next_states: of one real episode, shape (n, p + c)
        :param rewards: shape (n,)
        :param terminated: boolean, shape (n,)
        :return: the next states with their outcomes
        """
        return next_states

    def sample_outcomes(self, next_state: th.Tensor, generator: th.Generator | None) -> th.Tensor:
        """
        Decide in imagination what the model predicts as a probability.

        :param next_state: shape (B, p + c)
        :param generator: draws, on the state's device; None for what is more likely
        :return: the next state with its outcomes decided
        """
        return next_state


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
