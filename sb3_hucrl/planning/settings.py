"""Settings of planning, which build the policy that plans."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, Literal

from sb3_hucrl.checks import ArgumentError, Count, Factor, Positive, require_arguments, validated, within
from sb3_hucrl.imagination import World
from sb3_hucrl.planning.mpc import MPCPolicy
from sb3_hucrl.planning.policy import PlannedPolicy
from sb3_hucrl.planning.policy_variables import PolicyNoise, PolicyParameters
from sb3_hucrl.planning.problem import PlanningProblem
from sb3_hucrl.planning.proposal import Bounds
from sb3_hucrl.planning.registry import PLANNERS, make_planner
from sb3_hucrl.planning.variables import ActionSequence, DecisionVariables


@validated
class PlanningSettings(ABC):
    """
    Settings of the planning at every real step.

    :param rollouts: number of trajectories over which the return of a plan is averaged
    """

    def __init__(self, rollouts: Count) -> None:
        self.rollouts = rollouts

    @property
    def needs_policy(self) -> bool:
        """Whether plans are changes to a policy. Real episodes that sample the policy are then not planned."""
        return False

    @abstractmethod
    def build(self, world: World, policy: PlannedPolicy | None, seed: int) -> MPCPolicy:
        """
        :param world: in which plans are made
        :param policy: to plan around; None where :attr:`needs_policy` is False
        :param seed: of all randomness
        :return: the policy that plans
        :raises ValueError: if these do not fit together
        """


@validated
class HMPCSettings(PlanningSettings):
    """
    Planning without a policy: H-MPC (appendix C.2). With ``planner="cem"``, Greedy's propagation "tsinf" and several
    rollouts it is PETS (Chua et al. 2018).

    :param planner: name of a planner, a key of :data:`sb3_hucrl.planning.PLANNERS`
    :param horizon: N, steps that are planned ahead
    :param gamma: discount of imagined rewards
    :param rollouts: number of trajectories over which the return of a plan is averaged
    :param planner_kwargs: further arguments of the planner
    :raises ValueError: if the planner is unknown or a number out of its range
    """

    def __init__(
        self, planner: str, horizon: Count = 50, gamma: Factor = 1.0, rollouts: Count = 1, **planner_kwargs: Any
    ) -> None:
        super().__init__(rollouts)
        self._horizon, self._gamma = horizon, gamma
        self._planner = make_planner(planner, **planner_kwargs)

    def build(self, world: World, policy: PlannedPolicy | None, seed: int) -> MPCPolicy:
        variables = ActionSequence(self._horizon, Bounds(world.low, world.high))
        problem = PlanningProblem(world, variables, self._gamma, rollouts=self.rollouts)
        return MPCPolicy(problem, self._planner, seed)


@validated
class DynaMPCSettings(PlanningSettings):
    """
    Planning around a policy, with its critic as terminal value: Dyna-MPC (Algorithm 7). Without the critic it is POPLIN
    (Wang and Ba 2019), in policy-noise or policy-parameter space.

    :param horizon: N, steps that are planned ahead
    :param samples: plans per real step and iteration, besides the policy's own actions
    :param planner: name of a planner, a key of :data:`sb3_hucrl.planning.PLANNERS`
    :param space: whether plans change the policy's actions (``"noise"``) or its parameters (``"parameters"``)
    :param std: size of these changes: a fraction of the actions' range, or in units of the parameters
    :param bootstrap: whether the critic values what follows the horizon
    :param rollouts: number of trajectories over which the return of a plan is averaged
    :param planner_kwargs: further arguments of the planner
    :raises ValueError: if the planner is unknown or a number out of its range
    """

    def __init__(
        self,
        horizon: Count = 8,
        samples: Count = 64,
        planner: str = "cem",
        space: Literal["noise", "parameters"] = "noise",
        std: Positive = 0.2,
        bootstrap: bool = True,
        rollouts: Count = 1,
        **planner_kwargs: Any,
    ) -> None:
        super().__init__(rollouts)
        if planner == "ilqr" and space == "parameters":
            raise ArgumentError.of_value(
                "planner", planner, "one that samples, such as 'cem', to plan in the space of 'parameters'"
            )
        if planner in ("cem", "icem"):
            planner_kwargs = {"num_elites": max(2, samples // 4), "num_iterations": 3, **planner_kwargs}
        self._horizon, self._space, self._std, self._bootstrap = horizon, space, std, bootstrap
        self._planner = make_planner(planner, num_particles=samples, **planner_kwargs)

    @property
    def needs_policy(self) -> bool:
        return True

    def build(self, world: World, policy: PlannedPolicy | None, seed: int) -> MPCPolicy:
        if policy is None:
            raise ValueError("Dyna-MPC needs a policy to plan around: use planner (H-MPC) instead of dyna_mpc")
        variables: DecisionVariables
        if self._space == "noise":
            bounds = Bounds(world.low, world.high)
            variables = PolicyNoise(self._horizon, bounds, policy, world.task, self._std)
        else:
            variables = PolicyParameters(self._horizon, policy, world.task, self._std)
        value = policy.value() if self._bootstrap else None
        problem = PlanningProblem(world, variables, policy.gamma, value, self.rollouts)
        return MPCPolicy(problem, self._planner, seed)


@validated
def planning_settings(
    planner: str | None, planner_kwargs: Mapping[str, Any] | None, dyna_mpc: Mapping[str, Any] | None
) -> PlanningSettings | None:
    """
    :param planner: of H-MPC
    :param planner_kwargs: arguments of :class:`HMPCSettings`
    :param dyna_mpc: arguments of :class:`DynaMPCSettings`
    :return: the settings, or None without planning
    :raises ValueError: if both are given, or an argument is wrong
    """
    if dyna_mpc is not None:
        if planner is not None:
            raise ValueError("give planner (H-MPC) or dyna_mpc, not both; dyna_mpc: {planner: ...} names Dyna-MPC's")
        with within("dyna_mpc"):
            around = PLANNERS.resolve(dyna_mpc.get("planner", "cem"))
            require_arguments(dyna_mpc, DynaMPCSettings, around, reserved=("num_particles",))
            return DynaMPCSettings(**dyna_mpc)
    given = planner_kwargs or {}
    if planner is not None:
        with within("planner_kwargs"):
            require_arguments(given, HMPCSettings, PLANNERS.resolve(planner), reserved=("planner",))
            return HMPCSettings(planner, **given)
    if given:
        raise ArgumentError.of_value("planner_kwargs", dict(given), "the planner as well, such as planner: icem")
    return None
