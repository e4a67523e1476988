"""Rollouts in torch, through which gradients flow: for planners and for policy search by gradients."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch as th

from sb3_hucrl.checks import Count, Fraction, validated
from sb3_hucrl.imagination.world import World

#: V of observations: (B, observation dimension) to (B,)
TerminalValue = Callable[[th.Tensor], th.Tensor]


@dataclass(frozen=True)
class Rollout:
    """
    M imagined trajectories of N steps.

    :param states: s_0 to s_N, each of shape (M, p + c)
    :param choices: x_0 to x_{N-1}, from which the actions were made, each of shape (M, k)
    :param rewards: γ^n r_n for n from 0 to N - 1, each of shape (M,)
    :param discounts: γ^n until a trajectory has ended and 0 after it, for n from 0 to N, each of shape (M,)
    :param returns: Σ_n γ^n r_n + γ^N V(s_N), shape (M,)
    """

    states: list[th.Tensor]
    choices: list[th.Tensor]
    rewards: list[th.Tensor]
    discounts: list[th.Tensor]
    returns: th.Tensor


@validated
def roll_out(
    world: World,
    state: th.Tensor,
    choose: Callable[[int, th.Tensor], th.Tensor],
    act: Callable[[th.Tensor, th.Tensor], th.Tensor],
    horizon: Count,
    gamma: Fraction,
    generator: th.Generator | None,
    terminal_value: TerminalValue | None = None,
) -> Rollout:
    """
    Lines 3 to 9 of Algorithm 6. Differentiable in whatever the actions depend on, where model and task are.

    :param world: the system that is imagined
    :param state: s_0, shape (M, p + c)
    :param choose: maps n and s_n to x_n, shape (M, k): an action, or what a planner decides on instead
    :param act: maps x_n and s_n to the action (a_n, a′_n), shape (M, q + h)
    :param horizon: N
    :param gamma: γ
    :param generator: draws the noise, on the world's device; None for no noise
    :param terminal_value: V; without it, what follows the horizon counts nothing
    """
    total = th.zeros(len(state), device=state.device, dtype=state.dtype)
    states, discounts = [state], [th.ones_like(total)]
    choices: list[th.Tensor] = []
    rewards: list[th.Tensor] = []
    for n in range(horizon):
        choices.append(choose(n, state))
        step = world.step(state, act(choices[-1], state), generator)
        rewards.append(discounts[-1] * step.total_reward)
        total = total + rewards[-1]
        # Nothing is earned after the end.
        discounts.append(gamma * discounts[-1] * ~step.terminated)
        state = world.forget_outcomes(step.next_state)
        states.append(state)
    if terminal_value is not None:
        total = total + discounts[-1] * terminal_value(world.task.observe(state))
    return Rollout(states, choices, rewards, discounts, total)
