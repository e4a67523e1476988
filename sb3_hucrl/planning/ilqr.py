"""The iterative linear-quadratic regulator."""

from __future__ import annotations

from dataclasses import dataclass

import torch as th

from sb3_hucrl.checks import Count, Natural, NotNegative, validated
from sb3_hucrl.imagination import Rollout
from sb3_hucrl.planning.base import Plan, Planner, without_diverged
from sb3_hucrl.planning.derivatives import Quadratic, expand_step, expand_terminal
from sb3_hucrl.planning.problem import ImaginedReturns, PlanningProblem
from sb3_hucrl.planning.proposal import Bounds, Proposal

#: step sizes of the line search, all tried at once
STEP_SIZES = 0.5 ** th.arange(8)
#: of the noise of the random starts: white noise would cancel out over many short steps
NOISE_EXPONENT = 2.0
#: the regularisation is multiplied by it after a failed step, and divided by it after a good one
REGULARISATION_FACTOR = 10.0
MIN_REGULARISATION, MAX_REGULARISATION = 1e-8, 1e8


@dataclass(frozen=True)
class Feedback:
    """
    A linear feedback law: x_n = x̄_n + α k_n + K_n (s_n - s̄_n).

    :param offsets: k_n for n from 0, each of shape (B, k)
    :param gains: K_n, each of shape (B, k, p + c)
    """

    offsets: list[th.Tensor]
    gains: list[th.Tensor]


@validated
class ILQR(Planner):
    """
    Iterative linear-quadratic regulator (Li and Todorov 2004; appendix C.2) with limits on the actions (Tassa et al.
    2014). It plans without noise and needs derivatives of dynamics and reward.

    It finds a local optimum, and does not move where the reward is flat. So it starts from the best of several random
    sequences and the proposal's mean, which is the last plan if there is one.

    :param num_iterations: improvements of the plan
    :param num_particles: random sequences per environment, 0 for none
    :param regularisation: in the first iteration, in units of the return's second derivative
    :raises ValueError: if a number is out of its range
    """

    def __init__(
        self, num_iterations: Count = 10, num_particles: Natural = 64, regularisation: NotNegative = 1e-6
    ) -> None:
        self.num_iterations = num_iterations
        self.num_particles = num_particles
        self.regularisation = regularisation

    def plan(
        self, objective: ImaginedReturns, proposal: Proposal, bounds: Bounds, generator: th.Generator | None = None
    ) -> Plan:
        problem, states = objective.problem, objective.states
        if proposal.mean.shape[1] != problem.variables.horizon:
            raise ValueError("iLQR plans step by step: choose a planner that samples to search policy parameters")
        rollout = self._begin(problem, states, proposal, bounds, generator)
        regularisation = th.full((len(states),), self.regularisation, dtype=states.dtype, device=states.device)
        for _ in range(self.num_iterations):
            feedback = _improve(problem, rollout, bounds, regularisation)
            found = _search_line(problem, rollout, feedback, bounds)
            better = found.returns > rollout.returns
            factor = th.where(better, 1 / REGULARISATION_FACTOR, REGULARISATION_FACTOR)
            regularisation = (regularisation * factor).clamp(MIN_REGULARISATION, MAX_REGULARISATION)
            rollout = _where(better, found, rollout)
        actions = th.stack(rollout.choices, dim=1)
        return Plan(actions, rollout.returns, Proposal(actions, proposal.std))

    @th.no_grad()
    def _begin(
        self,
        problem: PlanningProblem,
        states: th.Tensor,
        proposal: Proposal,
        bounds: Bounds,
        generator: th.Generator | None,
    ) -> Rollout:
        candidates = proposal.mean.unsqueeze(1)
        if self.num_particles:
            random = proposal.perturbed(self.num_particles, NOISE_EXPONENT, generator)
            candidates = th.cat([candidates, random], dim=1)
        candidates = bounds.clip(candidates)
        by_step = candidates.flatten(0, 1).unbind(dim=1)
        starts = states.repeat_interleave(candidates.shape[1], dim=0)
        rollout = problem.roll_out(starts, lambda n, _: by_step[n], None)
        without_diverged(rollout.returns.view(len(states), -1))
        return _best(rollout, len(states))


def _improve(problem: PlanningProblem, rollout: Rollout, bounds: Bounds, regularisation: th.Tensor) -> Feedback:
    """The backward pass: optimal feedback for the problem's expansion around a rollout, for B environments at once."""
    num_envs, width = rollout.states[0].shape
    horizon = len(rollout.choices)
    dynamics, rewards = expand_step(problem, th.cat(rollout.states[:-1]), th.cat(rollout.choices))
    # Directions of positive curvature have no maximum: iLQR treats them as flat.
    rewards = rewards.concave()
    by_step = (horizon, num_envs)
    f = dynamics.unflatten(0, by_step)
    g, h = rewards.gradient.unflatten(0, by_step), rewards.hessian.unflatten(0, by_step)
    terminal = expand_terminal(problem, rollout.states[-1]).concave()
    discount = rollout.discounts[-1]
    v = Quadratic(discount[:, None] * terminal.gradient, discount[:, None, None] * terminal.hessian)
    offsets, gains = [], []
    for n in reversed(range(horizon)):
        discount = rollout.discounts[n]
        q_gradient = discount[:, None] * g[n] + (f[n].mT @ v.gradient.unsqueeze(2)).squeeze(2)
        q_hessian = discount[:, None, None] * h[n] + f[n].mT @ v.hessian @ f[n]
        qs, qx = q_gradient.split([width, q_gradient.shape[1] - width], dim=1)
        qss, qxs, qxx = q_hessian[:, :width, :width], q_hessian[:, width:, :width], q_hessian[:, width:, width:]
        regular = qxx - th.diag_embed(regularisation[:, None].expand_as(qx))
        offset, gain = _box_step(regular, qx, qxs, bounds.low - rollout.choices[n], bounds.high - rollout.choices[n])
        offsets.append(offset)
        gains.append(gain)
        k = offset.unsqueeze(2)
        v = Quadratic(
            gradient=qs + (gain.mT @ (qxx @ k + qx.unsqueeze(2)) + qxs.mT @ k).squeeze(2),
            hessian=qss + gain.mT @ qxx @ gain + gain.mT @ qxs + qxs.mT @ gain,
        )
    return Feedback(offsets[::-1], gains[::-1])


def _box_step(
    hessian: th.Tensor, gradient: th.Tensor, cross: th.Tensor, low: th.Tensor, high: th.Tensor
) -> tuple[th.Tensor, th.Tensor]:
    """
    Maximise gᵀk + ½ kᵀHk within limits: dimensions that exceed a limit are fixed there, and the others solved again.

    :param hessian: H, negative definite, shape (B, k, k)
    :param gradient: g, shape (B, k)
    :param cross: derivative of g by the state, shape (B, k, p + c)
    :param low: shape (B, k)
    :param high: shape (B, k)
    :return: k, and its derivative by the state, which is 0 for fixed dimensions
    """
    free = th.ones_like(gradient, dtype=th.bool)
    offset = th.zeros_like(gradient)
    identity = th.eye(gradient.shape[1], device=gradient.device, dtype=gradient.dtype)
    for _ in range(gradient.shape[1] + 1):
        both_free = free.unsqueeze(1) & free.unsqueeze(2)
        fixed = th.where(free, 0.0, offset)
        right = th.cat([gradient.unsqueeze(2) + hessian @ fixed.unsqueeze(2), cross], dim=2) * free.unsqueeze(2)
        solution = -th.linalg.solve(th.where(both_free, hessian, identity), right)
        offset = fixed + solution[..., 0]
        still_free = free & (offset >= low) & (offset <= high)
        offset = offset.clamp(low, high)
        if th.equal(still_free, free):
            break
        free = still_free
    return offset, solution[..., 1:] * free.unsqueeze(2)


@th.no_grad()
def _search_line(problem: PlanningProblem, rollout: Rollout, feedback: Feedback, bounds: Bounds) -> Rollout:
    """The forward pass: tries all step sizes at once and returns the best trajectory."""
    num_envs, num_sizes = len(rollout.returns), len(STEP_SIZES)
    sizes = STEP_SIZES.to(rollout.returns).repeat(num_envs).unsqueeze(1)

    def repeated(each: th.Tensor) -> th.Tensor:
        return each.repeat_interleave(num_sizes, dim=0)

    def choose(n: int, state: th.Tensor) -> th.Tensor:
        offset, gain = repeated(feedback.offsets[n]), repeated(feedback.gains[n])
        away = (state - repeated(rollout.states[n])).unsqueeze(2)
        return bounds.clip(repeated(rollout.choices[n]) + sizes * offset + (gain @ away).squeeze(2))

    return _best(problem.roll_out(repeated(rollout.states[0]), choose, None), num_envs)


def _best(rollout: Rollout, num_envs: int) -> Rollout:
    """The best of each environment's trajectories, which lie next to each other."""
    returns = rollout.returns.view(num_envs, -1)
    returns = returns.masked_fill(~th.isfinite(returns), -th.inf)
    best = returns.argmax(dim=1)
    rows = best + th.arange(num_envs, device=best.device) * returns.shape[1]
    return Rollout(
        states=[each[rows] for each in rollout.states],
        choices=[each[rows] for each in rollout.choices],
        rewards=[each[rows] for each in rollout.rewards],
        discounts=[each[rows] for each in rollout.discounts],
        returns=returns.flatten()[rows],
    )


def _where(condition: th.Tensor, one: Rollout, other: Rollout) -> Rollout:
    rows = condition.unsqueeze(1)
    return Rollout(
        states=[th.where(rows, *each) for each in zip(one.states, other.states, strict=True)],
        choices=[th.where(rows, *each) for each in zip(one.choices, other.choices, strict=True)],
        rewards=[th.where(condition, *each) for each in zip(one.rewards, other.rewards, strict=True)],
        discounts=[th.where(condition, *each) for each in zip(one.discounts, other.discounts, strict=True)],
        returns=th.where(condition, one.returns, other.returns),
    )
