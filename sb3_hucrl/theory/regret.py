"""Regret bounds, with the constants that the paper's O(·) omits (appendices D, H and I)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from sb3_hucrl.checks import Count, NotNegative, Positive, validated


@validated
@dataclass(frozen=True)
class LipschitzConstants:
    """
    Lipschitz constants of Assumptions 1 and 3, with respect to the 2-norm.

    :param dynamics: L_f, of the true dynamics in (s, a)
    :param policy: L_π, of all policies
    :param std: L_σ, of the model's standard deviation in (s, a)
    :param reward: L_r, of the reward in (s, a)
    """

    dynamics: NotNegative
    policy: NotNegative
    std: NotNegative
    reward: NotNegative

    @property
    def through_policy(self) -> float:
        """√(1 + L_π²), Lipschitz constant of s ↦ (s, π(s)). The paper has √(1 + L_π), too small for L_π > 1."""
        return math.sqrt(1 + self.policy**2)

    @property
    def closed_loop(self) -> float:
        """L_fc of Corollary 1, of the closed loop."""
        return self.dynamics * self.through_policy

    @validated
    def deviation(self, beta: NotNegative) -> float:
        """L̄_f = 1 + L_fc + 2β L_σ √(1 + L_π²) of Lemma 4, growth per step of the imagined state's error."""
        return 1 + self.closed_loop + 2 * beta * self.std * self.through_policy

    @validated
    def performance(self, beta: NotNegative, horizon: Count) -> float:
        """L_J = 2 L_r √(1 + L_π²) β L̄_f^(N-1) of Lemma 5."""
        return 2 * self.reward * self.through_policy * beta * self.deviation(beta) ** (horizon - 1)


@validated
def regret_bound(
    constants: LipschitzConstants, beta: NotNegative, horizon: Count, episodes: Count, total_uncertainty: NotNegative
) -> float:
    """
    Bound on the regret, R_T ≤ L_J √(T N³ I_T) (Theorem 1, from Lemma 7).

    :param constants: Lipschitz constants
    :param beta: β_{T-1}
    :param horizon: N
    :param episodes: T
    :param total_uncertainty: I_T of equation (52), the largest possible sum of variances over T episodes
    """
    return constants.performance(beta, horizon) * math.sqrt(episodes * horizon**3 * total_uncertainty)


@validated
def uncertainty_bound(
    max_std: Positive, noise_std: Positive, horizon: Count, dim: Count, capacity: NotNegative
) -> float:
    """
    Bound on I_T, 2 σ_max² N p γ / ln(1 + σ_max²/σ²), for Lemma 17.

    The paper has σ_max where its proof has σ_max², and omits the factor 2 that follows from the ½ of Lemma 16.

    :param max_std: σ_max, bound on the model's standard deviation
    :param noise_std: σ
    :param horizon: N
    :param dim: p
    :param capacity: γ after T N p observations, equation (64)
    """
    return 2 * max_std**2 * horizon * dim * capacity / math.log1p((max_std / noise_std) ** 2)


@validated
def regret_bound_of_capacity(
    constants: LipschitzConstants,
    beta: NotNegative,
    horizon: Count,
    episodes: Count,
    dim: Count,
    capacity: NotNegative,
    max_std: Positive,
    noise_std: Positive,
) -> float:
    """
    Regret bound of Theorem 3, for states in a compact set: Theorem 1 with Lemma 17.

    :param constants: Lipschitz constants
    :param beta: β_{T-1}
    :param horizon: N
    :param episodes: T
    :param dim: p
    :param capacity: γ after T N p observations, equation (64)
    :param max_std: σ_max, bound on the model's standard deviation
    :param noise_std: σ
    """
    total = uncertainty_bound(max_std, noise_std, horizon, dim, capacity)
    return regret_bound(constants, beta, horizon, episodes, total)


@validated
def regret_bound_of_unbounded_states(
    constants: LipschitzConstants,
    beta: NotNegative,
    horizon: Count,
    episodes: Count,
    dim: Count,
    radius: NotNegative,
    capacity: Callable[[float], float],
    max_std: Positive,
    noise_std: Positive,
) -> float:
    """
    Regret bound of Theorem 5, for unbounded noise: Theorem 3 on a ball that contains all states with high probability.

    :param constants: Lipschitz constants
    :param beta: β_{T-1}
    :param horizon: N
    :param episodes: T
    :param dim: p
    :param radius: b_T, see :func:`sb3_hucrl.theory.domain_radius`
    :param capacity: maps the radius of a ball to γ after T N p observations there
    :param max_std: σ_max on that ball
    :param noise_std: σ
    """
    return regret_bound_of_capacity(constants, beta, horizon, episodes, dim, capacity(radius), max_std, noise_std)
