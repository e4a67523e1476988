"""H-BPTT: its gradient, and its penalty on the divergence from the last policy."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch as th
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from helpers import TruePendulum, imagination_env, small_callback, small_world
from sb3_hucrl.algorithms import HBPTT
from sb3_hucrl.tasks import PendulumTask


class Noisy(TruePendulum):
    """The true mean, with both kinds of uncertainty."""

    def predict(self, state: th.Tensor, action: th.Tensor) -> Any:
        mean = self.step(state, action)
        prediction = super().predict(state, action)
        return type(prediction)(mean, 0.05 + 0.1 * state.cos().square(), th.full_like(mean, 0.02))


def hbptt(env: Any = None, **kwargs: Any) -> HBPTT:
    settings: dict[str, Any] = {"batch_size": 16, "buffer_size": 1_000, "policy_delay": 1}
    settings["policy_kwargs"] = {"net_arch": [16]}
    return HBPTT("MlpPolicy", env or imagination_env(), seed=0, device="cpu", **{**settings, **kwargs})


def imagining(**kwargs: Any) -> HBPTT:
    env = imagination_env()
    env.imagine(small_world(Noisy(), task=PendulumTask(0.2), horizon=100))
    return hbptt(env, **kwargs)


@pytest.mark.parametrize("horizon", [1, 6])
def test_the_gradient_is_that_of_finite_differences(horizon: int) -> None:
    model = imagining(horizon=horizon, gamma=0.9)
    angles = th.linspace(-0.6, 0.6, 64)
    observations = PendulumTask().observe(th.stack([angles, 0.5 * angles], dim=1))
    parameters = list(model.actor.parameters())

    def performance() -> th.Tensor:
        th.manual_seed(0)
        model._generator.manual_seed(0)
        return model.performance(observations).value

    start = parameters_to_vector(parameters).detach().clone()
    gradient = parameters_to_vector(th.autograd.grad(performance(), parameters))
    generator = th.Generator().manual_seed(1)
    for _ in range(3):
        direction = th.randn(len(start), generator=generator)
        direction = direction / direction.norm() + gradient / gradient.norm()
        values = []
        for size in (1e-2, -1e-2):
            vector_to_parameters(start + size * direction, parameters)
            values.append(performance().item())
        assert (gradient @ direction).item() == pytest.approx((values[0] - values[1]) / 2e-2, rel=0.03)


def test_the_divergence_is_from_the_policy_of_the_last_search() -> None:
    model = imagining(horizon=3, learning_starts=0, kl_weight=0.0, learning_rate=1e-2)
    observations = PendulumTask().observe(th.tensor([[0.1, 0.0], [math.pi, 0.0]]))
    assert model.performance(observations).divergence.item() == pytest.approx(0.0, abs=1e-6)
    model.learn(80)
    assert model.performance(observations).divergence.item() > 1e-3


def test_its_price_holds_the_policy_back() -> None:
    moved = []
    for weight in (0.0, 100.0):
        model = imagining(horizon=3, learning_starts=0, kl_weight=weight, learning_rate=1e-3)
        before = parameters_to_vector(model._last_actor.parameters()).clone()
        model.learn(120)
        assert th.equal(parameters_to_vector(model._last_actor.parameters()), before)
        moved.append((parameters_to_vector(model.actor.parameters()) - before).norm().item())
    assert moved[1] < 0.5 * moved[0]


def test_the_policy_waits_for_the_critics() -> None:
    model = imagining(learning_starts=0, policy_delay=1_000)
    before = [parameters_to_vector(each.parameters()).clone() for each in (model.actor, model.critic)]
    model.learn(40)
    after = [parameters_to_vector(each.parameters()) for each in (model.actor, model.critic)]
    assert [th.equal(old, new) for old, new in zip(before, after, strict=True)] == [True, False]


def test_a_new_search_trusts_the_policy_that_the_last_one_found() -> None:
    model = hbptt(learning_starts=0, horizon=2)
    model.learn(160, callback=small_callback())
    found = parameters_to_vector(model.actor.parameters())
    last = parameters_to_vector(model._last_actor.parameters())
    assert not th.equal(found, last)
    model.learn(80, callback=small_callback())
    assert not th.equal(last, parameters_to_vector(model._last_actor.parameters()))
