"""The paper's figures."""

from __future__ import annotations

from figures.curves import Curves

PENDULUM, CARTPOLE = "HUCRL-Pendulum-v0", "HUCRL-CartPole-v0"
PENALTIES = (0.0, 0.1, 0.2)

# The paper's text names the penalties of pendulum and cart-pole only; the others have none and the environment's own.
CURVES: dict[int, Curves] = {
    6: Curves("Figure 6: inverted pendulum", PENDULUM, PENALTIES),
    7: Curves("Figure 7: cart-pole", CARTPOLE, (0.0, 0.05, 0.2), start_states="inflated"),
    8: Curves("Figure 8: reacher", "HUCRL-Reacher-v0", (0.0, 0.01), episodes=20, start_states="inflated"),
    9: Curves("Figure 9: pusher", "HUCRL-Pusher-v0", (0.0, 0.1), start_states="inflated"),
    10: Curves("Figure 10: sparse reacher", "HUCRL-SparseReacher-v0", (0.0, 0.1), episodes=20, start_states="inflated"),
    11: Curves("Figure 11: half-cheetah", "HUCRL-HalfCheetah-v0", (0.0, 0.1), start_states="inflated"),
    15: Curves("Figure 15: simulated return", PENDULUM, PENALTIES, column="imagined_return", label="imagined return"),
    16: Curves(
        "Figure 16: uncertainty in imagination", PENDULUM, PENALTIES, column="epistemic_std", label="epistemic std"
    ),
}
