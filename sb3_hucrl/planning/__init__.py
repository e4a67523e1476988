"""Planning online: appendices C.2 and C.3."""

from sb3_hucrl.planning.base import Bounds, Objective, Particles, Plan, Planner, Proposal, ShootingPlanner
from sb3_hucrl.planning.cem import CEM
from sb3_hucrl.planning.icem import ICEM
from sb3_hucrl.planning.ilqr import ILQR
from sb3_hucrl.planning.mpc import MPCPolicy
from sb3_hucrl.planning.mppi import MPPI
from sb3_hucrl.planning.policy_variables import PolicyNoise, PolicyParameters
from sb3_hucrl.planning.random_shooting import RandomShooting
from sb3_hucrl.planning.registry import PLANNERS, make_planner
from sb3_hucrl.planning.rollouts import ImaginedReturns, PlanningProblem, TerminalValue
from sb3_hucrl.planning.sb3_policy import SB3Policy
from sb3_hucrl.planning.settings import (
    DynaMPCSettings,
    HMPCSettings,
    PlanningRecipe,
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
    "Planner",
    "PlanningProblem",
    "PlanningRecipe",
    "PlanningSettings",
    "PolicyNoise",
    "PolicyParameters",
    "Proposal",
    "RandomShooting",
    "SB3Policy",
    "ShootingPlanner",
    "TerminalValue",
    "make_planner",
    "planning_settings",
]
