"""GP-UCB, to which H-UCRL reduces for one step and a linear reward (appendix A)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch as th

from sb3_hucrl.checks import ArgumentError, Count, Natural, NotNegative, Positive, validated
from sb3_hucrl.dynamics.gp import ExactPosterior
from sb3_hucrl.dynamics.hyperparameters import rbf_kernel


@dataclass(frozen=True)
class BanditRun:
    """
    Decisions and final posterior of a bandit algorithm.

    :param chosen: index of the candidate chosen in each step, shape (T,)
    :param observed: noisy values of the chosen candidates, shape (T,)
    :param mean: posterior mean of all candidates after the last step, shape (m,)
    :param std: posterior standard deviation of all candidates after the last step, shape (m,)
    """

    chosen: th.Tensor
    observed: th.Tensor
    mean: th.Tensor
    std: th.Tensor


@validated
@th.no_grad()
def gp_ucb(
    objective: Callable[[th.Tensor], th.Tensor],
    candidates: th.Tensor,
    beta: NotNegative,
    num_steps: Count,
    first: Natural,
    lengthscale: Positive,
    noise_std: Positive,
    generator: th.Generator,
    outputscale: Positive = 1.0,
) -> BanditRun:
    """
    GP-UCB (Srinivas et al. 2012): each step chooses the candidate that maximises μ(θ) + β σ(θ). With β = 0 it maximises
    the expected performance, equation (16), which is greedy.

    :param objective: J, maps parameters (n, d) to values (n,)
    :param candidates: parameters θ to choose from, shape (m, d)
    :param beta: β
    :param num_steps: T, at least 1
    :param first: index of the candidate chosen in the first step
    :param lengthscale: lengthscale of the squared exponential kernel
    :param noise_std: σ of the observations
    :param generator: draws the noise, on the CPU
    :param outputscale: prior standard deviation
    :raises ValueError: if the number of steps is below 1 or β is negative
    """
    if first >= len(candidates):
        raise ArgumentError.of_value("first", first, f"the index of one of {len(candidates)} candidates")
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
