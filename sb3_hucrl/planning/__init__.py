"""Planning online: appendices C.2 and C.3."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sb3_hucrl.planning.base import Bounds, Objective, Particles, Plan, Proposal, ShootingPlanner
from sb3_hucrl.planning.cem import CEM
from sb3_hucrl.planning.icem import ICEM
from sb3_hucrl.planning.mpc import MPCPolicy
from sb3_hucrl.planning.mppi import MPPI
from sb3_hucrl.planning.random_shooting import RandomShooting
from sb3_hucrl.planning.rollouts import ImaginedReturns, TerminalValue

PLANNERS: dict[str, Callable[..., ShootingPlanner]] = {
    "random_shooting": RandomShooting,
    "cem": CEM,
    "icem": ICEM,
    "mppi": MPPI,
}


def make_planner(name: str, **kwargs: Any) -> ShootingPlanner:
    """
    Build a planner by its name.

    :param name: a key of :data:`PLANNERS`
    :param kwargs: arguments of the planner's class
    :raises ValueError: if the name is unknown
    """
    if name not in PLANNERS:
        raise ValueError(f"unknown planner {name!r}: choose one of {sorted(PLANNERS)}")
    return PLANNERS[name](**kwargs)


__all__ = [
    "CEM",
    "ICEM",
    "MPPI",
    "PLANNERS",
    "Bounds",
    "ImaginedReturns",
    "MPCPolicy",
    "Objective",
    "Particles",
    "Plan",
    "Proposal",
    "RandomShooting",
    "ShootingPlanner",
    "TerminalValue",
    "make_planner",
]
