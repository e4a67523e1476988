"""Values that are not finite, in a few words."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


def first_not_finite(name: str, values: npt.NDArray[np.floating[Any]]) -> str | None:
    """
    :param name: of the values
    :param values: of one step, a number or a vector
    :return: the first of them that is NaN or infinite, such as ``"observation[3] is nan (2 of 17 values)"``; None where
        all are finite. Observations of a robot have hundreds of values, which would hide what is wrong
    """
    flat = np.ravel(values)
    broken = np.flatnonzero(~np.isfinite(flat))
    if not len(broken):
        return None
    if len(flat) == 1:
        return f"{name} is {flat[0]}"
    return f"{name}[{broken[0]}] is {flat[broken[0]]} ({len(broken)} of {len(flat)} values)"
