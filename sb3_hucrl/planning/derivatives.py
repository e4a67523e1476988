"""Derivatives of one step of a planning problem, for iLQR."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch as th

from sb3_hucrl.planning.problem import PlanningProblem


@dataclass(frozen=True)
class Quadratic:
    """
    A second-order expansion around M points z: gᵀδ + ½ δᵀHδ.

    :param gradient: g, shape (M, z)
    :param hessian: H, shape (M, z, z)
    """

    gradient: th.Tensor
    hessian: th.Tensor

    def concave(self) -> Quadratic:
        """The same without the directions in which it curves upwards."""
        values, vectors = th.linalg.eigh(0.5 * (self.hessian + self.hessian.mT))
        return Quadratic(self.gradient, (vectors * values.clamp(max=0.0).unsqueeze(1)) @ vectors.mT)


def jacobian(outputs: th.Tensor, inputs: Sequence[th.Tensor]) -> list[th.Tensor]:
    """
    :param outputs: shape (M, y), each row of which depends on the same row of the inputs
    :param inputs: each of shape (M, z)
    :return: one Jacobian for each input, shape (M, y, z); zeros where the outputs do not depend on it
    """
    rows, width = outputs.shape
    if not outputs.requires_grad:
        return [outputs.new_zeros(rows, width, each.shape[1]) for each in inputs]
    directions = th.eye(width, device=outputs.device, dtype=outputs.dtype).unsqueeze(1).expand(-1, rows, -1)
    gradients = th.autograd.grad(
        outputs, inputs, directions, retain_graph=True, is_grads_batched=True, allow_unused=True
    )
    return [
        each.new_zeros(rows, width, each.shape[1]) if gradient is None else gradient.transpose(0, 1)
        for each, gradient in zip(inputs, gradients, strict=True)
    ]


@th.enable_grad()
def expand_step(problem: PlanningProblem, state: th.Tensor, value: th.Tensor) -> tuple[th.Tensor, Quadratic]:
    """
    Expansion of next state and reward around M points (s, x), without noise: to first order for the dynamics, which
    distinguishes iLQR from DDP (Li and Todorov 2004), and to second order for the reward.

    :param problem: the planning problem
    :param state: s, shape (M, p + c)
    :param value: x, decision variables, shape (M, k)
    :return: the Jacobian of the next state, shape (M, p + c, p + c + k), and the reward's expansion
    :raises ValueError: if dynamics or reward are not differentiable
    """
    world = problem.world
    state, value = (each.detach().clone().requires_grad_() for each in (state, value))
    action = problem.variables.action(value, state)
    step = world.step(state, action, None)
    if not step.prediction.mean.requires_grad:
        raise ValueError(
            f"iLQR needs a differentiable dynamics model, and {type(world.predictor).__name__} is not: choose another "
            "model, or a planner that samples, such as 'icem'"
        )
    dynamics = th.cat(jacobian(world.forget_outcomes(step.next_state), (state, value)), dim=2)
    reached = step.next_state.detach().requires_grad_()
    reward = world.task.reward(state, world.split(action)[0], reached)
    if not reward.requires_grad:
        raise ValueError(
            f"iLQR needs a differentiable reward, and that of {type(world.task).__name__} is not: choose a planner "
            "that samples, such as 'icem'"
        )
    gradients = th.autograd.grad(
        reward.sum(), (state, value, reached), create_graph=True, allow_unused=True, materialize_grads=True
    )
    gradient = th.cat(gradients, dim=1)
    hessian = th.cat(jacobian(gradient, (state, value, reached)), dim=2)
    # (s, x) to (s, x, s′)
    inner = th.eye(dynamics.shape[2], device=state.device, dtype=state.dtype).expand(len(state), -1, -1)
    outer = th.cat([inner, th.cat(jacobian(step.next_state, (state, value)), dim=2)], dim=1)
    total = (gradient.unsqueeze(1) @ outer).squeeze(1)
    if step.bonus is not None and step.bonus.requires_grad:
        bonus = th.autograd.grad(step.bonus.sum(), (state, value), allow_unused=True, materialize_grads=True)
        total = total + th.cat(bonus, dim=1)
    return dynamics.detach(), Quadratic(total.detach(), (outer.mT @ hessian @ outer).detach())


@th.enable_grad()
def expand_terminal(problem: PlanningProblem, state: th.Tensor) -> Quadratic:
    """
    :param problem: the planning problem
    :param state: s_N, shape (M, p + c)
    :return: expansion of the terminal value
    """
    state = state.detach().clone().requires_grad_()
    if problem.terminal_value is None:
        zeros = th.zeros_like(state)
        return Quadratic(zeros.detach(), th.diag_embed(zeros).detach())
    value = problem.terminal_value(problem.world.task.observe(state))
    [gradient] = th.autograd.grad(value.sum(), state, create_graph=True)
    [hessian] = jacobian(gradient, [state])
    return Quadratic(gradient.detach(), hessian.detach())
