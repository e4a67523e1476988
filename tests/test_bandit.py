"""Appendix A: greedy search gets stuck in a local maximum, optimism does not."""

from __future__ import annotations

import pytest
import torch as th

from sb3_hucrl.theory.bandit import BanditRun, gp_ucb

CANDIDATES = th.linspace(0, 1, 201).unsqueeze(1)


def two_hills(parameters: th.Tensor) -> th.Tensor:
    """An objective with a low maximum at 0.2 and a high one at 0.8."""
    low, high = (th.exp(-0.5 * ((parameters[:, 0] - place) / 0.08).square()) for place in (0.2, 0.8))
    return 0.6 * low + high


def run(beta: float, seed: int = 0, noise_std: float = 0.01) -> BanditRun:
    generator = th.Generator().manual_seed(seed)
    return gp_ucb(two_hills, CANDIDATES, beta, 20, 30, 0.08, noise_std, generator)


def test_greedy_gets_stuck_on_the_first_hill_and_optimism_does_not() -> None:
    for seed in range(5):
        greedy, optimistic = run(0.0, seed), run(2.0, seed)
        assert (CANDIDATES[greedy.chosen] < 0.4).all()
        assert two_hills(CANDIDATES[greedy.chosen[-1:]]).item() < 0.65
        assert (CANDIDATES[optimistic.chosen[-3:]] - 0.8).abs().max() < 0.03


def test_what_is_believed_is_the_posterior() -> None:
    found = run(2.0)
    inputs = CANDIDATES[found.chosen].double()

    def kernel(first: th.Tensor, second: th.Tensor) -> th.Tensor:
        return th.exp(-0.5 * th.cdist(first, second).square() / 0.08**2)

    cross = kernel(CANDIDATES.double(), inputs)
    inverse = (kernel(inputs, inputs) + 0.01**2 * th.eye(20, dtype=th.float64)).inverse()
    assert th.allclose(found.mean, cross @ inverse @ found.observed, atol=1e-5)
    assert th.allclose(found.std.square(), 1 - (cross @ inverse * cross).sum(dim=1), atol=1e-5)


def test_bad_numbers_say_what_to_give() -> None:
    with pytest.raises(ValueError, match=r"beta is -1\.0: give a finite number of at least 0"):
        run(-1.0)
