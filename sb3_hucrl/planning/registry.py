"""Planners by name."""

from __future__ import annotations

from typing import Any

from sb3_hucrl.checks import validated
from sb3_hucrl.planning.base import Planner
from sb3_hucrl.planning.cem import CEM
from sb3_hucrl.planning.icem import ICEM
from sb3_hucrl.planning.ilqr import ILQR
from sb3_hucrl.planning.mppi import MPPI
from sb3_hucrl.planning.random_shooting import RandomShooting
from sb3_hucrl.registry import Registry

#: planners by name
PLANNERS: Registry[Planner] = Registry(
    "planner", {"random_shooting": RandomShooting, "cem": CEM, "icem": ICEM, "mppi": MPPI, "ilqr": ILQR}
)


@validated
def make_planner(name: str, **kwargs: Any) -> Planner:
    """
    Build a planner by name.

    :param name: registered in :data:`PLANNERS`
    :param kwargs: arguments of the planner's class
    :raises ValueError: if the name is unknown or an argument is out of range
    """
    return PLANNERS.make(name, **kwargs)
