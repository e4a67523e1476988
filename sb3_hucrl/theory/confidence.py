"""How wide a confidence region must be to hold with high probability."""

from __future__ import annotations

import math


def confidence_width(information_gain: float, noise_std: float, delta: float, norm_bound: float) -> float:
    """
    β_t = B + 4σ √(I(y; f) + 1 + ln(1/δ)) (Lemmas 10 and 11; Chowdhury and Gopalan 2017).

    :param information_gain: I(y; f) of equation (63), summed over outputs, in nats
    :param noise_std: σ
    :param delta: δ, probability with which the confidence region may be wrong
    :param norm_bound: B, bound on the RKHS norm of the true function
    """
    return norm_bound + 4 * noise_std * math.sqrt(information_gain + 1 + math.log(1 / delta))
