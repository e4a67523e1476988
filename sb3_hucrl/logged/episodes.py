"""What all sources of logged transitions are read as."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sb3_hucrl.checks import validated

Floats = npt.NDArray[np.float32]


@validated
@dataclass(frozen=True)
class LoggedEpisode:
    """
    Part of an episode that somebody has logged, of n steps that follow each other.

    :param observations: o_0 to o_n, as the environment gives them, shape (n + 1, observation dimension)
    :param actions: without a′, in the units of the environment, shape (n, q)
    :param rewards: shape (n,)
    :param terminated: whether the episode terminated in o_n; a time limit, and the end of the log, do not terminate
    :param from_reset: whether o_0 came from a reset, and not from the middle of an episode
    :raises ValueError: if there is no step, the lengths do not fit together, or a value is not finite in float32
    """

    observations: Floats
    actions: Floats
    rewards: Floats
    terminated: bool
    from_reset: bool = True

    def __post_init__(self) -> None:
        n = len(self.rewards)
        for name, expected, dims in (("observations", n + 1, 2), ("actions", n, 2), ("rewards", n, 1)):
            array = plain_floats(f"{name} of a logged episode", getattr(self, name))
            if array.ndim != dims or len(array) != expected:
                raise ValueError(
                    f"{name} of a logged episode have shape {array.shape}: {n} rewards need {expected} rows in {dims} "
                    "dimensions"
                )
            object.__setattr__(self, name, array)
        if n == 0:
            raise ValueError("a logged episode has no step: leave it out")

    def __len__(self) -> int:
        return len(self.rewards)


def plain_floats(name: str, values: Any) -> Floats:
    """
    :param name: of the values, for errors
    :param values: an array of numbers
    :return: the same in float32
    :raises ValueError: if they are no numbers, or not finite in float32
    """
    try:
        array = np.asarray(values)
        # What is too large becomes infinite, and is refused below.
        with np.errstate(over="ignore"):
            floats = array.astype(np.float32)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} are no array of numbers ({error}): give one") from error
    broken = np.argwhere(~np.isfinite(floats))
    if len(broken):
        place = tuple(int(index) for index in broken[0])
        raise ValueError(
            f"{name} hold {array[place]} at {list(place)} (row first): logged data must be finite in float32; correct "
            "it, or leave this episode out"
        )
    return floats


def flat_observations(observations: Any) -> npt.NDArray[Any]:
    """
    :param observations: an array of n observations, or a mapping of such arrays, as environments with a goal give them
    :return: shape (n, observation dimension): the parts in the alphabetical order of their names, as
        ``gymnasium.wrappers.FlattenObservation`` puts them
    """
    if isinstance(observations, dict):
        parts = [flat_observations(observations[name]) for name in sorted(observations)]
        return np.concatenate(parts, axis=1)
    array = np.asarray(observations)
    return array.reshape(len(array), -1)
