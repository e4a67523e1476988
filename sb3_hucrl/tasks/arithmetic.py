"""Arithmetic of reward formulas, which environments evaluate on floats and tasks on tensors."""

from __future__ import annotations

import math
from typing import TypeVar

import torch as th

#: one number, or a tensor with one number per row of a batch
Number = TypeVar("Number", float, th.Tensor)


def exp(value: Number) -> Number:
    """
    :param value: exponent
    :return: e to the power of it
    """
    return math.exp(value) if isinstance(value, float) else value.exp()


def clamp(value: Number, lower: float, upper: float) -> Number:
    """
    :param value: number to be limited
    :param lower: smallest result
    :param upper: largest result
    """
    return min(max(value, lower), upper) if isinstance(value, float) else value.clamp(lower, upper)


def tolerance(value: Number, lower: float, upper: float, margin: float) -> Number:
    """
    dm_control's Gaussian tolerance: 1 within [lower, upper], 0.1 at a distance of one margin.

    :param value: number to be rated
    :param lower: lower end of the interval
    :param upper: upper end of the interval
    :param margin: distance from the interval at which the result is 0.1
    """
    distance = value - clamp(value, lower, upper)
    return exp(distance**2 * (math.log(0.1) / margin**2))
