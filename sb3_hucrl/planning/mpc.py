"""Model-predictive control: plan, act for one step, plan again."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import torch as th

from sb3_hucrl.hallucinated_system import HallucinatedSystem
from sb3_hucrl.planning.base import Bounds, Proposal, ShootingPlanner
from sb3_hucrl.planning.rollouts import ImaginedReturns, TerminalValue


class MPCPolicy:
    """
    H-MPC (appendix C.2): at every real step the planner's best true and hallucinated actions for the next N steps, of
    which the first is taken.

    Has the ``predict`` of an SB3 policy, so that ``evaluate_policy`` plays it. The state that goes in and out there is
    the planner's proposal, from which the next step's search starts.

    :param system: in which is planned
    :param planner: how
    :param horizon: N
    :param gamma: discount of imagined rewards
    :param terminal_value: of the observation after N steps, if any
    :param seed: of the planner's and the system's randomness
    :raises ValueError: if the horizon is below 1, the discount is not in (0, 1], or an action has no finite bounds
    """

    def __init__(
        self,
        system: HallucinatedSystem,
        planner: ShootingPlanner,
        horizon: int,
        gamma: float = 1.0,
        terminal_value: TerminalValue | None = None,
        seed: int = 0,
    ) -> None:
        self._system, self._planner = system, planner
        self._horizon, self._gamma, self._terminal_value = horizon, gamma, terminal_value
        self._bounds = Bounds(system.low, system.high)
        self._generator = th.Generator(system.device).manual_seed(seed)
        self._fresh = Proposal.within(self._bounds, 1, horizon)
        self._objective(th.zeros(1, system.task.width, device=system.device))

    def _objective(self, states: th.Tensor) -> ImaginedReturns:
        return ImaginedReturns(self._system, states, self._generator, self._gamma, self._terminal_value)

    def predict(
        self,
        observation: npt.NDArray[Any] | dict[str, npt.NDArray[Any]],
        state: Any = None,
        episode_start: npt.NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[npt.NDArray[np.float32], Any]:
        """
        :param observation: of B environments, shape (B, observation dimension), or of a single one, without B
        :param state: what the last call returned, or None
        :param episode_start: where an episode begins, and the last plan is of no use, shape (B,)
        :param deterministic: without effect: the best plan is always followed
        :return: the actions (a, a′), shape (B, q + h), or of a single environment (q + h,); and the next ``state``
        """
        observed = th.as_tensor(np.asarray(observation), device=self._system.device, dtype=th.float32)
        single = observed.dim() == 1
        states = self._system.task.state(observed.unsqueeze(0) if single else observed)
        fresh = self._fresh.expanded(len(states))
        proposal = fresh if state is None else state
        if episode_start is not None:
            begun = th.as_tensor(episode_start, device=self._system.device)
            proposal = proposal.restarted(begun, fresh)
        with th.inference_mode():
            plan = self._planner.plan(self._objective(states), proposal, self._bounds, self._generator)
        actions = plan.actions[:, 0].cpu().numpy()
        return (actions[0] if single else actions), plan.proposal.shifted(fresh)
