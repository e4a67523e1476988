"""Logged transitions as rows, one after another, and where the episodes in them begin and end."""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from sb3_hucrl.checks import validated
from sb3_hucrl.logged.episodes import LoggedEpisode, plain_floats

#: difference of an observation and the next observation of the row before that counts as rounding, as a fraction of the
#: largest value of the column
ROUNDING = 1e-5

Array = npt.NDArray[Any]


@validated
@dataclass(frozen=True)
class LoggedRows:
    """
    Transitions of one environment, in the order in which they were made; n rows.

    :param observations: shape (n, observation dimension)
    :param actions: without a′, in the units of the environment, shape (n, q)
    :param rewards: shape (n,)
    :param next_observations: shape (n, observation dimension); at the end of an episode the last one of that episode,
        not the first one of the next
    :param terminations: whether the episode terminated with the row, boolean or 0 and 1, shape (n,)
    :param truncations: whether it ended there for another reason, such as a time limit, boolean or 0 and 1, shape (n,)
    :raises ValueError: if there are no rows, a shape is not as above, or a value is not finite in float32
    """

    observations: Array
    actions: Array
    rewards: Array
    next_observations: Array
    terminations: Array
    truncations: Array

    def __post_init__(self) -> None:
        for field in fields(self):
            name, dims = field.name, 2 if field.name in ("observations", "actions", "next_observations") else 1
            flags = name in ("terminations", "truncations")
            read = _flags if flags else plain_floats
            array = read(f"logged {name}", getattr(self, name))
            if array.ndim != dims or len(array) != len(self.rewards):
                expected = f"({len(self.rewards)}, number of values)" if dims == 2 else f"({len(self.rewards)},)"
                raise ValueError(f"logged {name} have shape {array.shape}: {len(self.rewards)} rewards need {expected}")
            object.__setattr__(self, name, array)
        if self.next_observations.shape != self.observations.shape:
            raise ValueError(
                f"logged next_observations have shape {self.next_observations.shape}: give them the shape of "
                f"observations, {self.observations.shape}"
            )
        if len(self) == 0:
            raise ValueError("the logged data have no rows: give at least one transition")

    def __len__(self) -> int:
        return len(self.rewards)

    @property
    def gaps(self) -> npt.NDArray[np.bool_]:
        """
        Rows that no end of an episode follows, and that the next row does not go on from either, shape (n,).
        """
        scale = np.abs(self.observations).max(axis=0)
        apart = np.abs(self.next_observations[:-1] - self.observations[1:]) > ROUNDING * scale
        return np.append(apart.any(axis=1), False) & ~(self.terminations | self.truncations)

    def episodes(self, from_reset: bool = True, resets: bool = True) -> list[LoggedEpisode]:
        """
        :param from_reset: whether the first row came from a reset, and not from the middle of an episode
        :param resets: whether every row after an end came from a reset
        :return: the episodes, in order, from one end to the next
        :raises ValueError: if a row does not go on from the one before it, where no episode ends
        """
        gaps = np.flatnonzero(self.gaps)
        if len(gaps):
            row = int(gaps[0])
            raise ValueError(
                f"logged observations of row {row + 1} are not the next_observations of row {row}, and neither "
                f"terminations nor truncations are true in row {row}: write the transitions of one episode one after "
                "another, and set truncations where one is cut off"
            )
        ends = self.terminations | self.truncations
        ends[-1] = True
        bounds = [0, *(np.flatnonzero(ends) + 1).tolist()]
        return [
            LoggedEpisode(
                np.concatenate([self.observations[begin:end], self.next_observations[end - 1 : end]]),
                self.actions[begin:end],
                self.rewards[begin:end],
                bool(self.terminations[end - 1]),
                resets if begin > 0 else from_reset,
            )
            for begin, end in pairwise(bounds)
        ]


def _flags(name: str, values: Any) -> npt.NDArray[np.bool_]:
    numbers = plain_floats(name, values)
    if not np.isin(numbers, (0, 1)).all():
        raise ValueError(f"{name} hold other values than true and false, or 0 and 1: give only these")
    return numbers.astype(np.bool_)
