"""Lengths of trajectories and episodes that grow with the data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import TypeVar

from sb3_hucrl.checks import ArgumentError, Count, Natural, validated, within

Pair = TypeVar("Pair")


def _read_pair(kind: Callable[[int, int], Pair], name: str, given: Sequence[int], expected: str) -> Pair:
    if len(given) != 2:
        raise ArgumentError.of_value(name, given, expected)
    with within(name):
        return kind(*given)


@validated
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

    first: Count
    last: Count
    begin: Natural
    end: Natural

    def __post_init__(self) -> None:
        if self.begin >= self.end:
            raise ArgumentError.of_value("end", self.end, f"a number of real steps above begin, {self.begin}")

    @classmethod
    @validated
    def read(cls, horizon: Count | Sequence[Natural]) -> HorizonSchedule:
        """
        :param horizon: one for the whole training, or ``[first, last, begin, end]``
        :raises ValueError: if it is neither
        """
        if isinstance(horizon, Sequence):
            if len(horizon) != 4:
                raise ArgumentError.of_value(
                    "horizon", horizon, "one number, or [first, last, begin, end] such as [1, 15, 20_000, 100_000]"
                )
            with within("horizon"):
                return cls(*horizon)
        return cls(horizon, horizon, 0, 1)

    def at(self, real_steps: int) -> int:
        """
        :param real_steps: so far
        :return: the horizon, rounded down
        """
        progress = min(1.0, max(0.0, (real_steps - self.begin) / (self.end - self.begin)))
        return int(self.first + progress * (self.last - self.first))


@validated
@dataclass(frozen=True)
class RewardSeeking:
    """
    What random real episodes do where they have met no reward.

    :param hold: for how many steps each action is held at most
    :param until: real steps from which on they give up
    """

    hold: Count
    until: Natural

    @classmethod
    @validated
    def read(cls, seek_reward: Sequence[Natural]) -> RewardSeeking:
        """
        :param seek_reward: ``[hold, until]``
        :raises ValueError: if it is anything else
        """
        meaning = "random actions are held for up to 50 steps, and random episodes go on until 2,000 real steps"
        return _read_pair(cls, "seek_reward", seek_reward, f"[hold, until] such as [50, 2_000]: {meaning}")


@validated
@dataclass(frozen=True)
class EarlyTimeLimit:
    """
    A time limit of the first real episodes, which begin anew more often.

    :param steps: after which they end
    :param until: real steps from which on episodes last as long as those of the environment
    """

    steps: Count
    until: Natural

    @classmethod
    @validated
    def read(cls, early_time_limit: Sequence[Natural]) -> EarlyTimeLimit:
        """
        :param early_time_limit: ``[steps, until]``
        :raises ValueError: if it is anything else
        """
        meaning = "episodes end after 200 steps until there are 2,000 real steps"
        return _read_pair(cls, "early_time_limit", early_time_limit, f"[steps, until] such as [200, 2_000]: {meaning}")

    def count(self, lengths: Sequence[int], together: int) -> int:
        """
        :param lengths: of all real episodes
        :param together: how many of them are played at once
        :return: number of those, the first ones, that this is the time limit of
        """
        begins = [0, *accumulate(lengths)]
        return sum(begins[index - index % together] < self.until for index in range(len(lengths)))
