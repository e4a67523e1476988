"""Width of a confidence region that holds with high probability."""

from __future__ import annotations

import math

from sb3_hucrl.checks import NotNegative, Probability, validated


@validated
def confidence_width(
    information_gain: NotNegative, noise_std: NotNegative, delta: Probability, norm_bound: NotNegative
) -> float:
    """
    β_t = B + 4σ √(I(y; f) + 1 + ln(1/δ)) (Lemmas 10 and 11; Chowdhury and Gopalan 2017).

    :param information_gain: I(y; f) of equation (63), summed over outputs, in nats
    :param noise_std: σ, standard deviation of the observation noise
    :param delta: δ, probability that the confidence region is wrong
    :param norm_bound: B, bound on the RKHS norm of the true function
    :return: β_t, in posterior standard deviations
    """
    return norm_bound + 4 * noise_std * math.sqrt(information_gain + 1 + math.log(1 / delta))
