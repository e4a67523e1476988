"""The paper's theory as functions. Import :mod:`sb3_hucrl.theory.bandit`, which needs GPyTorch, by its own name."""

from sb3_hucrl.dynamics.confidence import confidence_width
from sb3_hucrl.theory.domain import domain_radius, noise_bound, noise_bound_over_time, noise_sum_bound, state_deviation
from sb3_hucrl.theory.information import greedy_information_gains, information_capacity, information_gain
from sb3_hucrl.theory.lipschitz import LipschitzEstimate, estimate_lipschitz
from sb3_hucrl.theory.regret import (
    LipschitzConstants,
    regret_bound,
    regret_bound_of_capacity,
    regret_bound_of_unbounded_states,
    uncertainty_bound,
)

__all__ = [
    "LipschitzConstants",
    "LipschitzEstimate",
    "confidence_width",
    "domain_radius",
    "estimate_lipschitz",
    "greedy_information_gains",
    "information_capacity",
    "information_gain",
    "noise_bound",
    "noise_bound_over_time",
    "noise_sum_bound",
    "regret_bound",
    "regret_bound_of_capacity",
    "regret_bound_of_unbounded_states",
    "state_deviation",
    "uncertainty_bound",
]
