"""What plans return in imagination: the objective of every planner."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch as th

from sb3_hucrl.hallucinated_system import HallucinatedSystem
from sb3_hucrl.planning.variables import DecisionVariables

#: V of observations: (B, observation dimension) to (B,)
TerminalValue = Callable[[th.Tensor], th.Tensor]


@dataclass(frozen=True)
class PlanningProblem:
    """
    What is to be maximised: Σ_n γ^n r(s_n, a_n) + γ^N V(s_N).

    :param system: in which plans are tried
    :param variables: what is decided on, and the horizon N
    :param gamma: γ
    :param terminal_value: V; without it, what follows the horizon counts nothing
    :param rollouts: trajectories over whose noise, and whose posterior samples, the return of a plan is averaged
    :raises ValueError: if γ is outside (0, 1], or there are no rollouts
    """

    system: HallucinatedSystem
    variables: DecisionVariables
    gamma: float = 1.0
    terminal_value: TerminalValue | None = None
    rollouts: int = 1

    def __post_init__(self) -> None:
        if not 0 < self.gamma <= 1:
            raise ValueError(f"gamma is {self.gamma}: give a discount above 0 and up to 1")
        if self.rollouts < 1:
            raise ValueError(f"rollouts is {self.rollouts}: give at least 1")


@dataclass(frozen=True)
class Rollout:
    """
    M imagined trajectories, step by step.

    :param states: s_0 to s_N, each of shape (M, p + c)
    :param values: x_0 to x_{N-1}, each of shape (M, k)
    :param rewards: γ^n r_n, n from 0 to N - 1, each of shape (M,)
    :param discounts: γ^n until a trajectory has ended and 0 after it, n from 0 to N, each of shape (M,)
    :param returns: shape (M,)
    """

    states: list[th.Tensor]
    values: list[th.Tensor]
    rewards: list[th.Tensor]
    discounts: list[th.Tensor]
    returns: th.Tensor


def roll_out(
    problem: PlanningProblem,
    state: th.Tensor,
    choose: Callable[[int, th.Tensor], th.Tensor],
    generator: th.Generator | None,
) -> Rollout:
    """
    Algorithm 6, lines 3 to 9.

    :param problem: system, decision variables, discount and terminal value
    :param state: s_0, shape (M, p + c)
    :param choose: maps n and s_n to x_n, shape (M, k)
    :param generator: draws the noise, on the system's device; None for none
    """
    system = problem.system
    total = th.zeros(len(state), device=state.device, dtype=state.dtype)
    states, discounts = [state], [th.ones_like(total)]
    values: list[th.Tensor] = []
    rewards: list[th.Tensor] = []
    for n in range(problem.variables.horizon):
        values.append(choose(n, state))
        step = system.step(state, problem.variables.action(values[-1], state), generator)
        rewards.append(discounts[-1] * step.total_reward)
        total = total + rewards[-1]
        # Nothing is earned after the end.
        discounts.append(problem.gamma * discounts[-1] * ~step.terminated)
        state = system.forget_outcomes(step.next_state)
        states.append(state)
    if problem.terminal_value is not None:
        total = total + discounts[-1] * problem.terminal_value(system.task.observe(state))
    return Rollout(states, values, rewards, discounts, total)


class ImaginedReturns:
    """
    J of Algorithm 6, all particles of all environments in one batch.

    :param problem: system, decision variables, discount and terminal value
    :param states: where plans begin, one for each of B environments, shape (B, p + c)
    :param generator: draws the noise, on the system's device
    :raises ValueError: if the states have the wrong width
    """

    def __init__(self, problem: PlanningProblem, states: th.Tensor, generator: th.Generator) -> None:
        task = problem.system.task
        if states.shape[1:] != (task.width,):
            raise ValueError(f"states have shape {tuple(states.shape)}, {type(task).__name__} needs (B, {task.width})")
        self.problem = problem
        self.states = states
        self._generator = generator

    def __call__(self, values: th.Tensor) -> th.Tensor:
        """
        :param values: of the decision variables, n plans for each environment, shape (B, n, T, k), T being N or, where
            one vector serves for all steps, 1
        :return: shape (B, n)
        """
        num_envs, n, length, _ = values.shape
        rollouts = self.problem.rollouts
        by_step = values.flatten(0, 1).repeat_interleave(rollouts, dim=0).unbind(dim=1)
        starts = self.states.repeat_interleave(n * rollouts, dim=0)
        rollout = roll_out(self.problem, starts, lambda step, _: by_step[min(step, length - 1)], self._generator)
        return rollout.returns.view(num_envs, n, rollouts).mean(dim=2)
