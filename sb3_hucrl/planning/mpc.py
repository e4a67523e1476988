"""Model-predictive control: plan, act for one step, plan again."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import torch as th

from sb3_hucrl.planning.base import Planner
from sb3_hucrl.planning.rollouts import ImaginedReturns, PlanningProblem


class MPCPolicy:
    """
    H-MPC (appendix C.2) and Dyna-MPC (appendix C.3): at every real step the planner's best true and hallucinated
    actions for the next N steps, of which the first is taken.

    Has the ``predict`` of an SB3 policy, so that ``evaluate_policy`` plays it. The state that goes in and out there is
    the planner's proposal, from which the next step's search starts.

    :param problem: what is planned; its decision variables tell H-MPC from Dyna-MPC
    :param planner: how
    :param seed: of the planner's and the system's randomness
    """

    def __init__(self, problem: PlanningProblem, planner: Planner, seed: int = 0) -> None:
        self._problem, self._planner = problem, planner
        self._generator = th.Generator(problem.system.device).manual_seed(seed)

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
        :param state: what the last call returned, or None
        :param episode_start: where an episode begins, and the last plan is of no use, shape (B,)
        :param deterministic: without effect: the best plan is always followed
        :return: the actions (a, a′), shape (B, q + h), or of a single environment (q + h,); and the next ``state``
        """
        system, variables = self._problem.system, self._problem.variables
        observed = th.as_tensor(np.asarray(observation), device=system.device, dtype=th.float32)
        single = observed.dim() == 1
        states = system.task.state(observed.unsqueeze(0) if single else observed)
        fresh = variables.fresh(len(states))
        proposal = fresh if state is None else state
        if episode_start is not None:
            begun = th.as_tensor(episode_start, device=system.device)
            proposal = proposal.restarted(begun, fresh)
        objective = ImaginedReturns(self._problem, states, self._generator)
        plan = self._planner.plan(objective, proposal, variables.bounds, self._generator)
        with th.no_grad():
            actions = variables.action(plan.actions[:, 0], states).cpu().numpy()
        return (actions[0] if single else actions), variables.shifted(plan.proposal)
