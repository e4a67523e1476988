"""MPO's dual problems against numerical optimisers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.optimize
import torch as th
from torch.distributions import Normal, kl_divergence

from sb3_hucrl.algorithms.mpo_loss import MPOLoss, split_kl, temperature_dual


def values(num_actions: int = 30, num_states: int = 4) -> th.Tensor:
    generator = th.Generator().manual_seed(0)
    scale = th.tensor([1.0, 3.0, 0.2, 5.0])[:num_states]
    return th.randn(num_actions, num_states, generator=generator) * scale


@pytest.mark.parametrize("epsilon", [0.05, 0.5])
def test_the_best_temperature_uses_up_the_bound_of_the_e_step(epsilon: float) -> None:
    q = values()

    def dual(temperature: float) -> float:
        return temperature_dual(q, th.tensor(temperature, dtype=th.float64), epsilon).item()

    best = scipy.optimize.minimize_scalar(dual, bounds=(1e-2, 100.0), method="bounded", options={"xatol": 1e-8}).x
    weights = (q / best).softmax(dim=0)
    deviation = (weights * (weights * len(q)).log()).sum(dim=0).mean()
    assert deviation.item() == pytest.approx(epsilon, rel=1e-3)


def test_gradient_steps_find_the_best_temperature() -> None:
    q, loss = values(), MPOLoss(epsilon=0.3, epsilon_mean=1.0, epsilon_std=1.0)
    policy = Normal(th.zeros(4, 1), th.ones(4, 1))
    optimizer = th.optim.Adam(loss.parameters(), lr=0.05)
    for _ in range(500):
        optimizer.zero_grad()
        loss(policy, policy, th.zeros(30, 4, 1), q).dual_loss.backward()
        optimizer.step()

    def dual(temperature: float) -> float:
        return temperature_dual(q, th.tensor(temperature, dtype=th.float64), 0.3).item()

    best = scipy.optimize.minimize_scalar(dual, bounds=(1e-2, 100.0), method="bounded").x
    assert loss.temperature.item() == pytest.approx(best, rel=1e-2)


def test_the_divergences_are_those_of_torch() -> None:
    generator = th.Generator().manual_seed(0)
    mean, other_mean = th.randn(2, 5, 3, generator=generator)
    std, other_std = th.rand(2, 5, 3, generator=generator) + 0.2
    by_mean, by_std = split_kl(Normal(mean, std), Normal(other_mean, other_std))
    assert th.allclose(by_mean, kl_divergence(Normal(mean, std), Normal(other_mean, std)).sum(dim=1), atol=1e-5)
    assert th.allclose(by_std, kl_divergence(Normal(mean, std), Normal(mean, other_std)).sum(dim=1), atol=1e-5)


def test_the_m_step_ends_at_the_constrained_optimum() -> None:
    """One state, two dimensions: weighted likelihood within both trust regions, as SLSQP solves it."""
    generator = th.Generator().manual_seed(0)
    old = Normal(th.tensor([[0.3, -0.2]]), th.tensor([[0.5, 0.8]]))
    actions = old.mean + old.stddev * th.randn(40, 1, 2, generator=generator)
    q = -(actions - th.tensor([1.5, 0.5])).square().sum(dim=2)
    loss = MPOLoss(epsilon=0.5, epsilon_mean=0.05, epsilon_std=0.01)
    mean, log_std = old.mean.clone().requires_grad_(), old.stddev.log().clone().requires_grad_()
    dual_optimizer = th.optim.Adam(loss.parameters(), lr=0.02)
    optimizer = th.optim.Adam([mean, log_std], lr=5e-3)
    for _ in range(1_500):
        terms = loss(old, Normal(mean, log_std.exp()), actions, q)
        for each in (optimizer, dual_optimizer):
            each.zero_grad()
        (terms.policy_loss + terms.dual_loss).backward()
        for each in (optimizer, dual_optimizer):
            each.step()
    weights = (q / loss.temperature.detach()).softmax(dim=0).squeeze(1).double()
    points, centre, width = (each.squeeze(-2).double() for each in (actions, old.mean, old.stddev))

    def negative_likelihood(mean: th.Tensor, std: th.Tensor) -> float:
        return -float(weights @ Normal(mean, std).log_prob(points).sum(dim=1))

    def divergence(mean: th.Tensor, std: th.Tensor) -> float:
        return kl_divergence(Normal(centre, width), Normal(mean, std)).sum().item()

    near_mean: Any = {"type": "ineq", "fun": lambda x: 0.05 - divergence(th.tensor(x), width)}
    near_std: Any = {"type": "ineq", "fun": lambda x: 0.01 - divergence(centre, th.tensor(x).exp())}

    def shifted(x: np.ndarray) -> float:
        return negative_likelihood(th.tensor(x), width)

    def widened(x: np.ndarray) -> float:
        return negative_likelihood(centre, th.tensor(x).exp())

    best_mean = scipy.optimize.minimize(shifted, centre.numpy(), constraints=near_mean).x
    best_std = scipy.optimize.minimize(widened, width.log().numpy(), constraints=near_std).x
    np.testing.assert_allclose(mean.detach()[0], best_mean, atol=5e-3)
    np.testing.assert_allclose(log_std.detach()[0], best_std, atol=5e-3)
    assert terms.kl_mean.item() == pytest.approx(0.05, rel=0.05)
    assert terms.kl_std.item() == pytest.approx(0.01, rel=0.05)


def test_bounds_are_positive() -> None:
    with pytest.raises(ValueError, match="epsilon_std is 0"):
        MPOLoss(0.1, 0.1, 0)
