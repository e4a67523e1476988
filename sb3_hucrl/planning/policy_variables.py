"""Decision variables of Dyna-MPC and POPLIN: changes to a policy. The unchanged policy is always a candidate."""

from __future__ import annotations

from dataclasses import replace

import torch as th

from sb3_hucrl.checks import Count, Positive, validated
from sb3_hucrl.planning.policy import PlannedPolicy
from sb3_hucrl.planning.proposal import Bounds, Proposal
from sb3_hucrl.planning.variables import DecisionVariables
from sb3_hucrl.tasks.base import Task

#: largest change of a policy parameter, in standard deviations of the search's first changes
REACH = 5.0


@validated
class PolicyNoise(DecisionVariables):
    """
    Noise that is added to a policy's actions: (a_n, a′_n) = (π, η)(s_n) + x_n (Algorithm 7, and POPLIN-A of Wang and Ba
    2019).

    :param horizon: N
    :param bounds: of (a, a′)
    :param policy: (π, η)
    :param task: maps states to observations
    :param std: of the noise at the start of the search, as a fraction of the actions' range; positive
    """

    def __init__(self, horizon: Count, bounds: Bounds, policy: PlannedPolicy, task: Task, std: Positive) -> None:
        width = bounds.high - bounds.low
        mean = th.zeros(1, horizon, len(width), device=width.device)
        fresh = Proposal(mean, (std * width).expand_as(mean), kept=mean.unsqueeze(1))
        super().__init__(horizon, Bounds(-width, width), fresh)
        self._policy, self._task, self._actions = policy, task, bounds

    def shifted(self, proposal: Proposal) -> Proposal:
        # The last plan's changes were made for the last state, so the search begins afresh.
        return self.fresh(len(proposal.mean))

    def action(self, value: th.Tensor, state: th.Tensor) -> th.Tensor:
        return self._actions.clip(self._policy.act(self._task.observe(state)) + value)


@validated
class PolicyParameters(DecisionVariables):
    """
    Changes that are added to a policy's parameters for the whole plan: (a_n, a′_n) = (π, η)(s_n; θ + x) (POPLIN-P of
    Wang and Ba 2019, with the same x at every step).

    :param horizon: N
    :param policy: (π, η), with parameters θ
    :param task: maps states to observations
    :param std: of the changes at the start of the search, in units of the parameters; positive
    """

    def __init__(self, horizon: Count, policy: PlannedPolicy, task: Task, std: Positive) -> None:
        self._policy, self._task = policy, task
        self._parameters = policy.acting_parameters()
        count = sum(parameter.numel() for parameter in self._parameters.values())
        spread = th.full((count,), std, device=next(iter(self._parameters.values())).device)
        mean = th.zeros_like(spread)[None, None]
        fresh = Proposal(mean, spread[None, None], kept=mean.unsqueeze(1))
        super().__init__(horizon, Bounds(-REACH * spread, REACH * spread), fresh)

    def shifted(self, proposal: Proposal) -> Proposal:
        return replace(self.fresh(len(proposal.mean)), mean=proposal.mean)

    def action(self, value: th.Tensor, state: th.Tensor) -> th.Tensor:
        sizes = [parameter.numel() for parameter in self._parameters.values()]
        changed = {
            name: parameter + change.view(-1, *parameter.shape)
            for (name, parameter), change in zip(self._parameters.items(), value.split(sizes, dim=1), strict=True)
        }
        return self._policy.act_each(changed, self._task.observe(state))
