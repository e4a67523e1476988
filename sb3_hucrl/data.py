"""Real transitions, the only data that the dynamics model learns from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from itertools import accumulate

import torch as th

from sb3_hucrl.checks import Count, Fraction, Seed, validated


@validated
@dataclass(frozen=True)
class Transitions:
    """
    A batch of n real transitions, in the units of the environment.

    :param states: s_n, shape (n, p)
    :param actions: a_n without a′, shape (n, q)
    :param next_states: s_{n+1}, shape (n, p)
    :param rewards: r(s_n, a_n), shape (n,)
    :param terminated: whether the episode terminated in s_{n+1} (a time limit truncates instead), shape (n,)
    :raises ValueError: if the lengths differ or a value is not finite
    """

    states: th.Tensor
    actions: th.Tensor
    next_states: th.Tensor
    rewards: th.Tensor
    terminated: th.Tensor

    def __post_init__(self) -> None:
        for field in fields(self):
            values = getattr(self, field.name)
            if len(values) != len(self.states):
                raise ValueError(f"Transitions: {field.name} has {len(values)} rows, states has {len(self.states)}")
            broken = (~th.isfinite(values)).nonzero()
            if len(broken):
                row = int(broken[0, 0])
                raise ValueError(f"Transitions: {field.name} is not finite at step {row}: {values[row].tolist()}")

    def __len__(self) -> int:
        return len(self.states)

    def __getitem__(self, index: th.Tensor | slice) -> Transitions:
        return Transitions(*(getattr(self, field.name)[index] for field in fields(self)))

    @staticmethod
    def concatenate(parts: Iterable[Transitions]) -> Transitions:
        columns = zip(*([getattr(part, field.name) for field in fields(Transitions)] for part in parts), strict=True)
        return Transitions(*(th.cat(column) for column in columns))

    @staticmethod
    def empty(state_dim: int, action_dim: int) -> Transitions:
        states = th.zeros(0, state_dim)
        return Transitions(states, th.zeros(0, action_dim), states, th.zeros(0), th.zeros(0, dtype=th.bool))


@validated
class TransitionDataset:
    """
    All real transitions so far, stored on the CPU.

    Each transition is assigned to training or held-out data once, when it is appended, so that no refit sees a held-out
    transition. The bootstrap weights of appendix B.1 are also drawn once.

    :param state_dim: p
    :param action_dim: q, without the hallucinated dimensions
    :param seed: seed of the held-out assignment and the bootstrap weights
    :param holdout_fraction: expected fraction of held-out transitions
    """

    def __init__(self, state_dim: Count, action_dim: Count, seed: Seed = 0, holdout_fraction: Fraction = 0.1) -> None:
        self.state_dim = state_dim
        self.action_dim = action_dim
        self.holdout_fraction = holdout_fraction
        self.transitions = Transitions.empty(state_dim, action_dim)
        self.initial_states = th.zeros(0, state_dim)
        #: number of transitions of each episode
        self.lengths: list[int] = []
        self._is_holdout = th.zeros(0, dtype=th.bool)
        self._weights = th.zeros(0, 0)
        self._generator = th.Generator().manual_seed(seed)

    def __len__(self) -> int:
        return len(self.transitions)

    def constant_dims(self, num_dims: int) -> th.Tensor:
        """
        :param num_dims: how many of the first state dimensions to look at
        :return: which of them have never changed within an episode, shape (num_dims,), boolean
        """
        real = self.transitions
        return (real.states[:, :num_dims] == real.next_states[:, :num_dims]).all(dim=0)

    def append_episode(self, episode: Transitions) -> None:
        """
        Store one real episode. Its first state becomes an initial state.

        :param episode: at least one transition, in order
        :raises ValueError: if the dimensions differ from the dataset's or the episode is empty
        """
        if len(episode) == 0:
            raise ValueError("an episode needs at least one transition, got none")
        dims = (episode.states.shape[1], episode.actions.shape[1])
        if dims != (self.state_dim, self.action_dim):
            raise ValueError(
                f"the episode has (state, action) dimensions {dims}, the dataset {(self.state_dim, self.action_dim)}: "
                "use a dataset made for this environment"
            )
        drawn = th.rand(len(episode), generator=self._generator) < self.holdout_fraction
        # One step for Python, so that an interruption leaves all or none of the episode.
        vars(self).update(
            transitions=Transitions.concatenate([self.transitions, episode]),
            initial_states=th.cat([self.initial_states, episode.states[:1]]),
            lengths=[*self.lengths, len(episode)],
            _is_holdout=th.cat([self._is_holdout, drawn]),
        )

    @property
    def episodes(self) -> list[Transitions]:
        """The real episodes, in order."""
        ends = list(accumulate(self.lengths))
        return [self.transitions[end - length : end] for end, length in zip(ends, self.lengths, strict=True)]

    @property
    def train(self) -> Transitions:
        """The transitions to learn from."""
        return self.transitions[~self._is_holdout]

    @property
    def holdout(self) -> Transitions:
        """The transitions to evaluate on; all transitions if none is held out yet."""
        return self.transitions[self._is_holdout] if self._is_holdout.any() else self.transitions

    @validated
    def bootstrap_weights(self, num_members: Count) -> th.Tensor:
        """
        Poisson(1) weights of the training transitions (Osband et al. 2016; appendix B.1), drawn once per transition.

        :param num_members: ensemble size M; if it differs from the last call's, all weights are redrawn
        :return: shape (len(train), M)
        """
        if self._weights.shape[1] != num_members:
            self._weights = th.zeros(0, num_members)
        missing = len(self) - len(self._weights)
        drawn = th.poisson(th.ones(missing, num_members), generator=self._generator)
        self._weights = th.cat([self._weights, drawn])
        return self._weights[~self._is_holdout]
