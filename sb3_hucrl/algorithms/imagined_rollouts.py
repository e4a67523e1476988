"""A policy's trajectories in the system that its environment imagines, for algorithms that look inside."""

from __future__ import annotations

from collections.abc import Callable

import torch as th
from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.hallucinated_system import HallucinatedSystem
from sb3_hucrl.planning import ActionSequence, Bounds, PlanningProblem, TerminalValue
from sb3_hucrl.planning.rollouts import Rollout, roll_out
from sb3_hucrl.stack import find_imagination

#: maps observations (B, observation dimension) to actions scaled to [-1, 1], (B, q + h)
ScaledActor = Callable[[th.Tensor], th.Tensor]


def imagined_system(model: BaseAlgorithm) -> HallucinatedSystem:
    """
    :param model: SB3 algorithm
    :return: the hallucinated system that it trains in
    :raises ValueError: if it does not train in imagination, or sees other observations than the model predicts
    """
    env = model.get_env()
    assert env is not None  # an algorithm in training has one
    name = type(model).__name__
    if model.get_vec_normalize_env() is not None:
        raise ValueError(f"{name} needs observations and rewards as they are: use no VecNormalize (normalize: false)")
    imagination = find_imagination(env).imagination
    if imagination is None:
        raise ValueError(f"{name} searches in imagination only: give learn() callback=HUCRLCallback()")
    return imagination.system


def imagine(
    system: HallucinatedSystem,
    observations: th.Tensor,
    act: ScaledActor,
    horizon: int,
    gamma: float,
    generator: th.Generator | None,
    terminal_value: TerminalValue | None = None,
    first_actions: th.Tensor | None = None,
) -> Rollout:
    """
    Differentiable in whatever the policy depends on, where model and task are.

    :param system: in which to act
    :param observations: where trajectories begin, shape (B, observation dimension)
    :param act: the policy
    :param horizon: N
    :param gamma: γ
    :param generator: draws the noise, on the system's device; None for none
    :param terminal_value: of the observation after N steps, if any
    :param first_actions: taken in the first step instead of the policy's, scaled, shape (B, q + h)
    """
    bounds = Bounds(system.low, system.high)

    def choose(n: int, state: th.Tensor) -> th.Tensor:
        scaled = act(system.task.observe(state)) if n or first_actions is None else first_actions
        return bounds.unscaled(scaled)

    problem = PlanningProblem(system, ActionSequence(horizon, bounds), gamma, terminal_value)
    return roll_out(problem, system.task.state(observations), choose, generator)
