"""The objective of planners: the imagined return of a plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch as th

from sb3_hucrl.checks import Count, Factor, validated
from sb3_hucrl.imagination import Rollout, TerminalValue, World, roll_out
from sb3_hucrl.planning.variables import DecisionVariables


@validated
@dataclass(frozen=True)
class PlanningProblem:
    """
    Maximise Σ_n γ^n r(s_n, a_n) + γ^N V(s_N) over the decision variables.

    :param world: in which plans are tried
    :param variables: the decision variables, and the horizon N
    :param gamma: γ, above 0 and up to 1
    :param terminal_value: V; without it, rewards after the horizon are ignored
    :param rollouts: number of trajectories over which the return of a plan is averaged; they differ in their noise and,
        if the world has several posterior samples, in their sample
    """

    world: World
    variables: DecisionVariables
    gamma: Factor = 1.0
    terminal_value: TerminalValue | None = None
    rollouts: Count = 1

    def roll_out(
        self, state: th.Tensor, choose: Callable[[int, th.Tensor], th.Tensor], generator: th.Generator | None
    ) -> Rollout:
        """
        :param state: s_0, shape (M, p + c)
        :param choose: maps n and s_n to the decision variables x_n, shape (M, k)
        :param generator: draws the noise, on the world's device; None for no noise
        """
        variables = self.variables
        return roll_out(
            self.world,
            state,
            choose,
            variables.action,
            variables.horizon,
            self.gamma,
            generator,
            self.terminal_value,
        )


@validated
class ImaginedReturns:
    """
    J of Algorithm 6: all particles of all environments in one batch.

    :param problem: the planning problem
    :param states: first states of the plans, one for each of B environments, shape (B, p + c)
    :param generator: draws the noise, on the world's device
    :raises ValueError: if the states have the wrong width
    """

    def __init__(self, problem: PlanningProblem, states: th.Tensor, generator: th.Generator) -> None:
        task = problem.world.task
        if states.shape[1:] != (task.width,):
            raise ValueError(f"states have shape {tuple(states.shape)}, {type(task).__name__} needs (B, {task.width})")
        self.problem = problem
        self.states = states
        self._generator = generator

    def __call__(self, values: th.Tensor) -> th.Tensor:
        """
        :param values: of the decision variables, n plans for each environment, shape (B, n, T, k); T is N, or 1 where
            one vector serves for all steps
        :return: returns, shape (B, n)
        """
        num_envs, n, length, _ = values.shape
        rollouts = self.problem.rollouts
        by_step = values.flatten(0, 1).repeat_interleave(rollouts, dim=0).unbind(dim=1)
        starts = self.states.repeat_interleave(n * rollouts, dim=0)
        rollout = self.problem.roll_out(starts, lambda step, _: by_step[min(step, length - 1)], self._generator)
        return rollout.returns.view(num_envs, n, rollouts).mean(dim=2)
