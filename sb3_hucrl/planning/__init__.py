"""Planning at every real step: H-MPC (appendix C.2) and Dyna-MPC (appendix C.3)."""

from sb3_hucrl.planning.base import Objective, Particles, Plan, Planner, ShootingPlanner
from sb3_hucrl.planning.cem import CEM
from sb3_hucrl.planning.icem import ICEM
from sb3_hucrl.planning.ilqr import ILQR
from sb3_hucrl.planning.mpc import MPCPolicy
from sb3_hucrl.planning.mppi import MPPI
from sb3_hucrl.planning.policy import PlannedPolicy
from sb3_hucrl.planning.policy_variables import PolicyNoise, PolicyParameters
from sb3_hucrl.planning.problem import ImaginedReturns, PlanningProblem
from sb3_hucrl.planning.proposal import Bounds, Proposal
from sb3_hucrl.planning.random_shooting import RandomShooting
from sb3_hucrl.planning.registry import PLANNERS, make_planner
from sb3_hucrl.planning.settings import (
    DynaMPCSettings,
    HMPCSettings,
    PlanningSettings,
    planning_settings,
)
from sb3_hucrl.planning.variables import ActionSequence, DecisionVariables

__all__ = [
    "CEM",
    "ICEM",
    "ILQR",
    "MPPI",
    "PLANNERS",
    "ActionSequence",
    "Bounds",
    "DecisionVariables",
    "DynaMPCSettings",
    "HMPCSettings",
    "ImaginedReturns",
    "MPCPolicy",
    "Objective",
    "Particles",
    "Plan",
    "PlannedPolicy",
    "Planner",
    "PlanningProblem",
    "PlanningSettings",
    "PolicyNoise",
    "PolicyParameters",
    "Proposal",
    "RandomShooting",
    "ShootingPlanner",
    "make_planner",
    "planning_settings",
]
