"""The paper's figures."""

from __future__ import annotations

from figures.bandit import Bandit
from figures.curves import STRATEGIES, Curves
from figures.experiment import PENDULUM
from figures.heads import BestHead
from figures.job import Figure
from figures.phase_space import PhaseSpace

PENALTIES = (0.0, 0.1, 0.2)
MEMBERS = {"thompson": "5 members", **{f"thompson_{number}": f"{number} members" for number in (10, 20, 50, 100)}}
BETAS = {**STRATEGIES, "optimistic": "H-UCRL, β = 1", "optimistic_beta_3": "H-UCRL, β = 3"}
NO_BOOTSTRAP = {f"{name}_no_bootstrap": label for name, label in STRATEGIES.items()}

# The penalties of pendulum and cart-pole, and 1 for the half-cheetah, are from the paper's text; all others are 0 and
# the environment's default.
FIGURES: dict[int, Figure] = {
    5: Bandit(),
    6: Curves("Figure 6: inverted pendulum", PENDULUM, PENALTIES),
    7: Curves(
        "Figure 7: cart-pole",
        "HUCRL-CartPole-v0",
        (0.0, 0.05, 0.2),
        explorations=BETAS,
        episodes=15,
        solved=100.0,
    ),
    8: Curves("Figure 8: reacher", "HUCRL-Reacher-v0", (0.0, 0.01), episodes=20, start_states="inflated", solved=-50.0),
    9: Curves("Figure 9: pusher", "HUCRL-Pusher-v0", (0.0, 0.1), start_states="inflated", solved=-32.0),
    10: Curves(
        "Figure 10: sparse reacher",
        "HUCRL-SparseReacher-v0",
        (0.0, 0.1),
        episodes=20,
        start_states="inflated",
        solved=75.0,
    ),
    11: Curves("Figure 11: half-cheetah", "HUCRL-HalfCheetah-v0", (0.0, 0.1, 1.0), start_states="inflated", solved=0.0),
    12: PhaseSpace("Figure 12", 0.0),
    13: PhaseSpace("Figure 13", 0.1),
    14: PhaseSpace("Figure 14", 0.2),
    15: Curves("Figure 15: imagined return", PENDULUM, PENALTIES, column="imagined_return", label="imagined return"),
    16: Curves(
        "Figure 16: uncertainty in imagination",
        PENDULUM,
        PENALTIES,
        column="epistemic_std",
        label="epistemic std",
        solved=None,
        scale="log",
    ),
    17: Curves("Figure 17: Thompson sampling by ensemble size", PENDULUM, PENALTIES, explorations=MEMBERS),
    18: Curves("Figure 18: without bootstrap", PENDULUM, PENALTIES, explorations=NO_BOOTSTRAP),
    19: Curves("Figure 19: Fourier features", PENDULUM, PENALTIES, dynamics=("rff", "qff")),
    20: BestHead("Figure 20: optimism and the best head", PENALTIES),
}
