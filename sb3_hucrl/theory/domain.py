"""
Bounds on the distance of states from the initial state (appendix I).

A σ-sub-Gaussian ω has P(|ω| > s) ≤ exp(1 - s²/σ²) (Definition 1); a normal distribution with standard deviation v is
√2 v-sub-Gaussian.
"""

from __future__ import annotations

import math

from sb3_hucrl.checks import Count, Natural, NotNegative, Probability, validated


@validated
def noise_bound(sigma: NotNegative, dim: Count, delta: Probability) -> float:
    """
    Bound on ‖ω‖₂² that holds with probability 1 - δ, for Lemma 21: 2σ² (p ln(1 + e) + ln(1/δ)).

    The paper has 2σp + (4σ/e) ln(2/δ), which is linear in σ although ‖ω‖² is quadratic, and so too small for a large
    σ. The bound here follows from Definition 1 by E exp(ω²/(2σ²)) ≤ 1 + e and Chernoff's inequality.

    :param sigma: σ of each entry
    :param dim: p
    :param delta: δ
    """
    return 2 * sigma**2 * (dim * math.log(1 + math.e) + math.log(1 / delta))


@validated
def noise_bound_over_time(sigma: NotNegative, dim: Count, delta: Probability, step: Natural) -> float:
    """
    Bound on ‖ω_n‖₂² that holds simultaneously for all n ≥ 0 with probability 1 - δ (Lemma 22): step n fails with
    probability at most 6δ / (π (n + 1))².

    :param sigma: σ of each entry
    :param dim: p
    :param delta: δ
    :param step: n
    """
    return noise_bound(sigma, dim, delta / ((step + 1) ** 2 * math.pi**2 / 6))


@validated
def noise_sum_bound(
    sigma: NotNegative, dim: Count, delta: Probability, horizon: Count, episode: Count | None = None
) -> float:
    """
    Bound on Σ_n ‖ω_n‖₂ over one episode (Lemma 23), or simultaneously over each of all episodes (Lemma 24), with
    probability 1 - δ.

    :param sigma: σ of each entry
    :param dim: p
    :param delta: δ
    :param horizon: N
    :param episode: t ≥ 1 of Lemma 24; None for a single episode
    """
    budget = delta / horizon
    if episode is not None:
        budget /= episode**2 * math.pi**2 / 6
    return horizon * math.sqrt(noise_bound(sigma, dim, budget))


@validated
def state_deviation(closed_loop: NotNegative, first_step: NotNegative, step: Count, noise_sum: NotNegative) -> float:
    """
    Bound on ‖s_n - s_0‖, inequality (134) of Lemma 25: (1 + L_fc)^(n-1) (n ‖f(s_0) - s_0‖ + Σ_i ‖ω_i‖).

    :param closed_loop: L_fc, Lipschitz constant of the closed loop
    :param first_step: ‖f(s_0) - s_0‖
    :param step: n ≥ 1
    :param noise_sum: Σ_i ‖ω_i‖ up to step n
    """
    return (1 + closed_loop) ** (step - 1) * (step * first_step + noise_sum)


@validated
def domain_radius(
    closed_loop: NotNegative,
    first_step: NotNegative,
    sigma: NotNegative,
    dim: Count,
    delta: Probability,
    horizon: Count,
    episode: Count,
) -> float:
    """
    b_t, bound on the distance of all states of all episodes from s_0, with probability 1 - δ (Lemma 26).

    The lemma's statement has L_fc where its proof has 1 + L_fc; this function follows the proof.

    :param closed_loop: L_fc
    :param first_step: B_0, bound on ‖f(s_0) - s_0‖₂
    :param sigma: σ of each entry of the noise
    :param dim: p
    :param delta: δ
    :param horizon: N
    :param episode: t ≥ 1
    """
    return state_deviation(closed_loop, first_step, horizon, noise_sum_bound(sigma, dim, delta, horizon, episode))
