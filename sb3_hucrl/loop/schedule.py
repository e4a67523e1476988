"""Imagined horizons that grow with the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class HorizonSchedule:
    """
    A horizon that is ``first`` until ``begin`` real steps, grows linearly, and is ``last`` from ``end`` real steps on
    (Janner et al. 2019, MBPO).

    :param first: horizon at the beginning, in steps
    :param last: horizon at the end, in steps
    :param begin: real steps
    :param end: real steps
    :raises ValueError: if a horizon is below 1, or ``end`` does not come after ``begin``
    """

    first: int
    last: int
    begin: int
    end: int

    def __post_init__(self) -> None:
        if min(self.first, self.last) < 1 or not 0 <= self.begin < self.end:
            raise ValueError(
                f"horizon is {[self.first, self.last, self.begin, self.end]}: give [first, last, begin, end], two "
                "horizons of at least 1 and two numbers of real steps, the second larger than the first"
            )

    @classmethod
    def read(cls, horizon: int | Sequence[int]) -> HorizonSchedule:
        """
        :param horizon: one for the whole training, or ``[first, last, begin, end]``
        :raises ValueError: if it is neither
        """
        if isinstance(horizon, Sequence):
            if len(horizon) != 4:
                raise ValueError(
                    f"horizon is {list(horizon)}: give one number, or [first, last, begin, end] such as "
                    "[1, 15, 20_000, 100_000]"
                )
            return cls(*horizon)
        if horizon < 1:
            raise ValueError(f"horizon is {horizon}: give at least 1")
        return cls(horizon, horizon, 0, 1)

    def at(self, real_steps: int) -> int:
        """
        :param real_steps: so far
        :return: the horizon, rounded down
        """
        progress = min(1.0, max(0.0, (real_steps - self.begin) / (self.end - self.begin)))
        return int(self.first + progress * (self.last - self.first))
