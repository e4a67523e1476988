"""Real transitions, the only data that the dynamics model learns from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import torch as th

from sb3_hucrl.checks import Count, Fraction, Location, Seed, validated
from sb3_hucrl.files import read_npz, replacing

#: what a file of a dataset says of itself, and the version of its contents
FILE_FORMAT, FILE_VERSION = "sb3_hucrl.TransitionDataset", 1
#: rewards that differ by a smaller fraction of themselves are the same
ROUNDING = 1e-6


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


def reward_std(rewards: th.Tensor) -> float:
    """
    :param rewards: of n steps, shape (n,)
    :return: their standard deviation; 0 where they differ by no more than rounding
    """
    std = float(rewards.double().std(correction=0))
    return std if std > ROUNDING * float(rewards.abs().max()) else 0.0


@validated
class TransitionDataset:
    """
    All real transitions so far, stored on the CPU: first those that were logged before the training, if there are any,
    then those of the training's own real episodes.

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
        #: where episodes began with a reset, shape (number of these, p)
        self.initial_states = th.zeros(0, state_dim)
        #: number of transitions of each of the training's own episodes
        self.lengths: list[int] = []
        #: the same of the logged ones, which come first in :attr:`transitions`
        self.logged_lengths: list[int] = []
        #: number of transitions of the training's own episode that is under way, which come last
        self.under_way = 0
        self._is_holdout = th.zeros(0, dtype=th.bool)
        self._weights = th.zeros(0, 0)
        self._generator = th.Generator().manual_seed(seed)

    def __setstate__(self, state: dict[str, Any]) -> None:
        # Files of version 0.1 know no logged data, and no parts of episodes.
        vars(self).update({"logged_lengths": [], "under_way": 0, **state})

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
        Store one real episode of the training's own. Its first state becomes an initial state.

        :param episode: at least one transition, in order
        :raises ValueError: if the dimensions differ from the dataset's or the episode is empty
        """
        self.append_part(episode, over=True)

    def append_part(self, part: Transitions, over: bool) -> None:
        """
        Store what was played of one real episode of the training's own since its last part. The first state of its
        first part becomes an initial state.

        :param part: at least one transition, in order
        :param over: whether the episode has ended
        :raises ValueError: as above
        """
        length = self.under_way + len(part)
        lengths = {"lengths": [*self.lengths, length]} if over else {}
        self._append([part], [self.under_way == 0], **lengths, under_way=0 if over else length)

    def end_episode(self) -> None:
        """Let the episode that is under way, if any, end with its last part: nobody can go on with it."""
        if self.under_way:
            vars(self).update(lengths=[*self.lengths, self.under_way], under_way=0)

    def append_logged(self, episodes: Sequence[Transitions], from_reset: Sequence[bool]) -> None:
        """
        Store episodes that were logged before the training.

        :param episodes: each at least one transition, in order
        :param from_reset: of each, whether it began with a reset: then its first state becomes an initial state. If
            none did, all first states do, because imagination must begin somewhere
        :raises ValueError: if there are real episodes of the training's own, which come last, or as above
        """
        if self.lengths or self.under_way:
            raise ValueError(
                f"the dataset holds {len(self.lengths)} real episodes of its own: append logged ones before these"
            )
        known = from_reset if any(from_reset) else [True] * len(episodes)
        self._append(episodes, known, logged_lengths=[*self.logged_lengths, *map(len, episodes)])

    def _append(self, episodes: Sequence[Transitions], from_reset: Sequence[bool], **lengths: list[int] | int) -> None:
        for episode in episodes:
            self._require_fitting(episode)
        drawn = th.rand(sum(map(len, episodes)), generator=self._generator) < self.holdout_fraction
        began = [episode.states[:1] for episode, known in zip(episodes, from_reset, strict=True) if known]
        # One step for Python, so that an interruption leaves all or none of it.
        vars(self).update(
            transitions=Transitions.concatenate([self.transitions, *episodes]),
            initial_states=th.cat([self.initial_states, *began]),
            _is_holdout=th.cat([self._is_holdout, drawn]),
            **lengths,
        )

    def _require_fitting(self, episode: Transitions) -> None:
        if len(episode) == 0:
            raise ValueError("an episode needs at least one transition, got none")
        dims = (episode.states.shape[1], episode.actions.shape[1])
        if dims != (self.state_dim, self.action_dim):
            raise ValueError(
                f"the episode has (state, action) dimensions {dims}, the dataset {(self.state_dim, self.action_dim)}: "
                "use a dataset made for this environment"
            )

    @property
    def logged_steps(self) -> int:
        """Number of logged transitions."""
        return sum(self.logged_lengths)

    @property
    def ends(self) -> list[int]:
        """
        For each episode, the logged ones first, the number of transitions up to its end, or as far as it is under way.
        """
        return list(accumulate([*self.logged_lengths, *self._own_lengths]))

    @property
    def _own_lengths(self) -> list[int]:
        return [*self.lengths, self.under_way] if self.under_way else self.lengths

    @property
    def real_steps(self) -> int:
        """Number of transitions of the training's own."""
        return sum(self._own_lengths)

    @property
    def logged_episodes(self) -> list[Transitions]:
        """The logged episodes, in order."""
        return self.all_episodes[: len(self.logged_lengths)]

    @property
    def episodes(self) -> list[Transitions]:
        """The training's own real episodes that have ended, in order."""
        first = len(self.logged_lengths)
        return self.all_episodes[first : first + len(self.lengths)]

    @property
    def all_episodes(self) -> list[Transitions]:
        """All episodes: logged ones, the training's own, and what there is of the one that is under way."""
        ends = self.ends
        return [self.transitions[begin:end] for begin, end in zip([0, *ends], ends, strict=False)]

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

    @validated
    def save(self, path: Location) -> None:
        """
        Write everything to a ``.npz`` file of plain arrays: ``states``, ``actions``, ``next_states``, ``rewards`` and
        ``terminated`` as in :class:`Transitions`, ``initial_states``, ``lengths`` and ``logged_lengths``, the held-out
        transitions ``is_holdout``, the bootstrap ``weights``, ``generator`` (the state of its random generator),
        ``holdout_fraction``, and ``format`` and ``version``. An episode that is under way is written as one that ended.

        :param path: of the file, which is replaced in one step
        :raises OSError: if it cannot be written; what was there is left as it was
        """
        columns = {field.name: getattr(self.transitions, field.name).numpy() for field in fields(Transitions)}
        with replacing(Path(path)) as file:
            np.savez_compressed(
                file,
                format=FILE_FORMAT,
                version=FILE_VERSION,
                **columns,
                initial_states=self.initial_states.numpy(),
                lengths=np.array(self._own_lengths, dtype=np.int64),
                logged_lengths=np.array(self.logged_lengths, dtype=np.int64),
                is_holdout=self._is_holdout.numpy(),
                weights=self._weights.numpy(),
                generator=self._generator.get_state().numpy(),
                holdout_fraction=self.holdout_fraction,
            )

    @classmethod
    @validated
    def load(cls, path: Location) -> TransitionDataset:
        """
        :param path: of a file that :meth:`save` has written
        :return: the same dataset; what is appended to it is held out as it would have been
        :raises FileNotFoundError: if there is no such file
        :raises ValueError: if it is another file, or one of a newer version
        """
        found = _read_file(Path(path))
        transitions = Transitions(*(th.as_tensor(found[field.name]) for field in fields(Transitions)))
        dims = transitions.states.shape[1], transitions.actions.shape[1]
        dataset = cls(*dims, holdout_fraction=float(found["holdout_fraction"]))
        generator = th.Generator()
        generator.set_state(th.as_tensor(found["generator"]))
        vars(dataset).update(
            transitions=transitions,
            initial_states=th.as_tensor(found["initial_states"]),
            lengths=found["lengths"].tolist(),
            logged_lengths=found["logged_lengths"].tolist(),
            _is_holdout=th.as_tensor(found["is_holdout"]),
            _weights=th.as_tensor(found["weights"]),
            _generator=generator,
        )
        return dataset


def is_dataset(found: Mapping[str, Any]) -> bool:
    """
    :param found: in a ``.npz`` file, by name
    :return: whether :meth:`TransitionDataset.save` has written it
    """
    return str(found.get("format")) == FILE_FORMAT


def _read_file(path: Path) -> dict[str, Any]:
    found = read_npz(path)
    if not is_dataset(found):
        raise ValueError(f"{path} holds {sorted(found)}: give a file that TransitionDataset.save has written")
    if int(found["version"]) > FILE_VERSION:
        raise ValueError(
            f"{path} was written by a newer sb3_hucrl (version {found['version']} of the file, and this one reads up "
            f"to {FILE_VERSION}): upgrade with pip install -U sb3_hucrl"
        )
    return found
