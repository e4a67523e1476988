"""Differentiable rollouts of an SB3 policy in the world that its environment imagines."""

from __future__ import annotations

from collections.abc import Callable

import torch as th
from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.imagination import Rollout, TerminalValue, World, roll_out
from sb3_hucrl.planning import Bounds
from sb3_hucrl.wrappers.imagination import imagination_layer

#: maps observations (B, observation dimension) to actions scaled to [-1, 1], (B, q + h)
ScaledActor = Callable[[th.Tensor], th.Tensor]


def require_no_normalization(model: BaseAlgorithm) -> None:
    """
    :param model: SB3 algorithm that imagines
    :raises ValueError: if its environments are normalised
    """
    if model.get_vec_normalize_env() is not None:
        raise ValueError(
            f"{type(model).__name__} needs observations and rewards as they are: use no VecNormalize (normalize: false)"
        )


def imagined_world(model: BaseAlgorithm) -> World:
    """
    :param model: SB3 algorithm
    :return: the world that it trains in
    :raises ValueError: if it does not train in imagination, or sees other observations than the model predicts
    """
    env = model.get_env()
    assert env is not None  # an algorithm in training has one
    name = type(model).__name__
    require_no_normalization(model)
    layer, _ = imagination_layer(env)
    if layer is None or layer.trajectories is None:
        raise ValueError(
            f"{name} searches in imagination only: put ImaginationVecEnv around the environments, and give learn() "
            "callback=HUCRLCallback()"
        )
    return layer.trajectories.world


def imagine(
    world: World,
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

    :param world: to act in
    :param observations: where trajectories begin, shape (B, observation dimension)
    :param act: the policy
    :param horizon: N
    :param gamma: γ
    :param generator: draws the noise, on the world's device; None for no noise
    :param terminal_value: of the observation after N steps, if any
    :param first_actions: taken in the first step instead of the policy's, scaled, shape (B, q + h)
    """
    bounds = Bounds(world.low, world.high)

    def choose(n: int, state: th.Tensor) -> th.Tensor:
        return act(world.task.observe(state)) if n or first_actions is None else first_actions

    def in_env_units(scaled: th.Tensor, state: th.Tensor) -> th.Tensor:
        return bounds.unscaled(scaled)

    # MuJoCo's observations are stored in double precision.
    start = world.task.state(observations.float())
    return roll_out(world, start, choose, in_env_units, horizon, gamma, generator, terminal_value)
