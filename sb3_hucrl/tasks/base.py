"""The interface of all tasks."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch as th


class Task(ABC):
    """
    Known reward, known termination and the map between state and observation, in batched torch.

    The dynamics model predicts the state, and hallucination acts on it. The state may be smaller than the observation,
    so that every imagined observation is possible. By default the observation is the state and the task never
    terminates. The actions passed to a task never contain a′.

    Every state tensor has p + c columns: p that the model predicts, then c columns of context, which are constant in an
    episode, such as a goal. Imagination copies the context; it is neither learned nor hallucinated.
    """

    #: p, the number of state dimensions
    state_dim: int
    #: c, the number of context columns that follow them
    context_dim: int = 0
    #: number of the state's last dimensions that are outcomes of a step, such as a learned reward: predicted as part of
    #: the next state, and 0 in the state that a step starts from
    outcome_dim: int = 0
    #: whether dimensions that never changed within a real episode are taken for context: carried through imagination,
    #: neither hallucinated nor inflated. A task that knows its context says so by ``context_dim`` instead
    carries_constants: bool = False
    #: indices of the state's angles, in radians
    angle_dims: tuple[int, ...] = ()

    @property
    def width(self) -> int:
        """p + c, the columns of a state tensor."""
        return self.state_dim + self.context_dim

    @property
    def hallucinated_dim(self) -> int:
        """Number of the state's first dimensions that may be hallucinated: all but the outcomes."""
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
        :return: whether the episode terminates in next_state, shape (B,), boolean
        """
        return th.zeros(len(state), dtype=th.bool, device=state.device)

    def observe(self, state: th.Tensor) -> th.Tensor:
        """
        :param state: shape (B, p + c)
        :return: observation for the policy, shape (B, observation dimension)
        """
        return state

    def state(self, observation: th.Tensor) -> th.Tensor:
        """
        The inverse of :meth:`observe`, with angles up to multiples of 2π.

        :param observation: shape (B, observation dimension)
        :return: shape (B, p + c)
        """
        return observation

    def exploratory_states(self, n: int, generator: th.Generator | None) -> th.Tensor | None:
        """
        Start states that cover the relevant part of the state space (appendix C.1: 'any exploratory distribution').

        :param n: number of states
        :param generator: draws the states, on the CPU
        :return: shape (n, p + c), or None if the task defines no such distribution
        """
        return None

    def sample_contexts(self, n: int, generator: th.Generator | None) -> th.Tensor | None:
        """
        Contexts from the distribution of real episodes, so that imagination is not limited to the contexts seen so far.

        :param n: number of contexts
        :param generator: draws the contexts, on the CPU
        :return: shape (n, c), or None to reuse the contexts of real episodes
        """
        return None

    def record_outcomes(self, next_states: th.Tensor, rewards: th.Tensor, terminated: th.Tensor) -> th.Tensor:
        """
        Write the real rewards and terminations into the state dimensions that the model learns to predict.

        :param next_states: of one real episode, shape (n, p + c)
        :param rewards: shape (n,)
        :param terminated: boolean, shape (n,)
        :return: next states with outcomes, shape (n, p + c)
        """
        return next_states

    def sample_outcomes(self, next_state: th.Tensor, generator: th.Generator | None) -> th.Tensor:
        """
        Sample the outcomes that the model predicts as probabilities, in imagination.

        :param next_state: shape (B, p + c)
        :param generator: draws the outcomes, on the state's device; None for the more likely outcome
        :return: next state with sampled outcomes, shape (B, p + c)
        """
        return next_state
