"""Planners by their names."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sb3_hucrl.planning.base import Planner
from sb3_hucrl.planning.cem import CEM
from sb3_hucrl.planning.icem import ICEM
from sb3_hucrl.planning.ilqr import ILQR
from sb3_hucrl.planning.mppi import MPPI
from sb3_hucrl.planning.random_shooting import RandomShooting

#: planners by their names
PLANNERS: dict[str, Callable[..., Planner]] = {
    "random_shooting": RandomShooting,
    "cem": CEM,
    "icem": ICEM,
    "mppi": MPPI,
    "ilqr": ILQR,
}


def make_planner(name: str, **kwargs: Any) -> Planner:
    """
    Build a planner by its name.

    :param name: a key of :data:`PLANNERS`
    :param kwargs: arguments of the planner's class
    :raises ValueError: if the name is unknown
    """
    if name not in PLANNERS:
        raise ValueError(f"unknown planner {name!r}: choose one of {sorted(PLANNERS)}")
    return PLANNERS[name](**kwargs)
