"""Model-predictive control: plan, take one step, plan again."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import torch as th

from sb3_hucrl.checks import Seed, validated
from sb3_hucrl.planning.base import Planner
from sb3_hucrl.planning.problem import ImaginedReturns, PlanningProblem


@validated
class MPCPolicy:
    """
    H-MPC (appendix C.2) and Dyna-MPC (appendix C.3): plan true and hallucinated actions for the next N steps, take the
    first of them, and plan again.

    It has the ``predict`` method of an SB3 policy, so ``evaluate_policy`` accepts it. The ``state`` that ``predict``
    takes and returns is the planner's proposal, with which the next step's search starts.

    :param problem: the planning problem; its decision variables distinguish H-MPC from Dyna-MPC
    :param planner: solves the problem
    :param seed: of the planner's and the world's randomness
    """

    def __init__(self, problem: PlanningProblem, planner: Planner, seed: Seed = 0) -> None:
        self._problem, self._planner = problem, planner
        self._generator = th.Generator(problem.world.device).manual_seed(seed)

    def predict(
        self,
        observation: npt.NDArray[Any] | dict[str, npt.NDArray[Any]],
        state: Any = None,
        episode_start: npt.NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[npt.NDArray[np.float32], Any]:
        """
        :param observation: of B environments, not normalised, shape (B, observation dimension), or of a single one,
            without B
        :param state: returned by the last call, or None
        :param episode_start: which environments begin an episode and drop their last plan, shape (B,)
        :param deterministic: no effect: the best plan is always followed
        :return: the actions (a, a′), shape (B, q + h), or of a single environment (q + h,); and the next ``state``
        """
        world, variables = self._problem.world, self._problem.variables
        observed = th.as_tensor(np.asarray(observation), device=world.device, dtype=th.float32)
        single = observed.dim() == 1
        states = world.task.state(observed.unsqueeze(0) if single else observed)
        fresh = variables.fresh(len(states))
        proposal = fresh if state is None else state
        if episode_start is not None:
            begun = th.as_tensor(episode_start, device=world.device)
            proposal = proposal.restarted(begun, fresh)
        objective = ImaginedReturns(self._problem, states, self._generator)
        plan = self._planner.plan(objective, proposal, variables.bounds, self._generator)
        with th.no_grad():
            actions = variables.action(plan.actions[:, 0], states).cpu().numpy()
        return (actions[0] if single else actions), variables.shifted(plan.proposal)
