"""Model-based reinforcement learning at its simplest: one step, linear reward, a bandit (appendix A)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch as th

from sb3_hucrl.dynamics.gp import ExactPosterior
from sb3_hucrl.dynamics.hyperparameters import rbf_kernel


@dataclass(frozen=True)
class BanditRun:
    """
    What was tried, and what is believed in the end.

    :param chosen: index of the candidate of each step, shape (T,)
    :param observed: noisy values of these, shape (T,)
    :param mean: posterior mean of all candidates after the last step, shape (m,)
    :param std: posterior standard deviation of the same, shape (m,)
    """

    chosen: th.Tensor
    observed: th.Tensor
    mean: th.Tensor
    std: th.Tensor


@th.no_grad()
def gp_ucb(
    objective: Callable[[th.Tensor], th.Tensor],
    candidates: th.Tensor,
    beta: float,
    num_steps: int,
    first: int,
    lengthscale: float,
    noise_std: float,
    generator: th.Generator,
    outputscale: float = 1.0,
) -> BanditRun:
    """
    GP-UCB (Srinivas et al. 2012): try what maximises μ(θ) + β σ(θ). With β = 0 it is the expected performance of
    equation (16), which is greedy.

    :param objective: J of parameters (n, d), shape (n,)
    :param candidates: parameters θ among which is chosen, shape (m, d)
    :param beta: β
    :param num_steps: T, at least 1
    :param first: index of the candidate that is tried before anything is known
    :param lengthscale: of the squared exponential kernel
    :param noise_std: σ of the observations
    :param generator: draws the noise, on the CPU
    :param outputscale: prior standard deviation
    :raises ValueError: if there is no step, or β is negative
    """
    if num_steps < 1 or not beta >= 0:
        raise ValueError(f"num_steps is {num_steps}, beta {beta}: give at least 1 and 0")
    values, candidates = objective(candidates).double(), candidates.double()
    kernel = rbf_kernel(th.Size([1]), candidates.shape[1], lengthscale, outputscale)
    noise_variance = th.full((1, 1), noise_std**2, dtype=th.float64)
    chosen, observed = [first], [_observe(values, first, noise_std, generator)]
    while True:
        inputs, targets = candidates[chosen], th.stack(observed).unsqueeze(1)
        mean, std = (
            each[0] for each in ExactPosterior.condition(kernel, inputs, targets, noise_variance).moments(candidates)
        )
        if len(chosen) == num_steps:
            return BanditRun(th.tensor(chosen), th.stack(observed), mean, std)
        chosen.append(int((mean + beta * std).argmax()))
        observed.append(_observe(values, chosen[-1], noise_std, generator))


def _observe(values: th.Tensor, index: int, noise_std: float, generator: th.Generator) -> th.Tensor:
    return values[index] + noise_std * th.randn((), generator=generator, dtype=th.float64)
