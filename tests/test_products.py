"""Faster matrix products change neither results nor what the user has chosen."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch as th
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env

from sb3_hucrl import HUCRLCallback, products
from sb3_hucrl.products import FastProducts
from sb3_hucrl.wrappers import ImaginationVecEnv

CPU = th.device("cpu")


@pytest.fixture(autouse=True)
def forget_the_cpu() -> Iterator[None]:
    products._is_exact.cache_clear()
    yield
    products._is_exact.cache_clear()
    FastProducts(CPU).end()
    th.set_float32_matmul_precision("highest")


@pytest.mark.parametrize("rows", [1, 51, 1024])
@pytest.mark.parametrize("width", [17, 200, 256])
def test_products_are_as_exact_as_single_precision(rows: int, width: int) -> None:
    left, right = th.randn(5, rows, width), th.randn(5, width, 200)
    expected = left.double() @ right.double()
    fast = FastProducts(CPU)
    found = left @ right
    fast.end()
    assert float((found - expected).abs().max() / expected.std()) < 1e-5


def test_a_cpu_that_would_round_more_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(products, "_is_exact", lambda: False)
    FastProducts(CPU)
    assert th.get_float32_matmul_precision() == "highest"


def test_rounding_to_half_the_digits_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    product = th.Tensor.__matmul__

    def rounded(left: th.Tensor, right: th.Tensor) -> th.Tensor:
        return product(left, right) if left.dtype == th.double else product(left.bfloat16(), right.bfloat16()).float()

    monkeypatch.setattr(th.Tensor, "__matmul__", rounded)
    assert not products._is_exact()


def test_what_the_user_has_chosen_is_kept() -> None:
    th.set_float32_matmul_precision("high")
    fast = FastProducts(CPU)
    assert th.get_float32_matmul_precision() == "high"
    fast.end()
    assert th.get_float32_matmul_precision() == "high"


def test_other_devices_are_left_alone() -> None:
    FastProducts(th.device("cuda"))
    assert th.get_float32_matmul_precision() == "highest"


def test_they_last_as_long_as_a_training(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(products, "_is_exact", lambda: True)
    env = ImaginationVecEnv(make_vec_env("HUCRL-Pendulum-v0", n_envs=4))
    seen = []

    class Watched(SAC):
        def train(self, gradient_steps: int, batch_size: int = 64) -> None:
            seen.append(th.get_float32_matmul_precision())

    model = Watched("MlpPolicy", env, learning_starts=0, seed=0)
    model.learn(8, callback=HUCRLCallback(imagined_steps=8, dynamics_kwargs={"gradient_steps": 1}))
    assert set(seen) == {"medium"}
    assert th.get_float32_matmul_precision() == "highest"


def test_what_an_interrupted_training_left_is_undone_by_the_next_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(products, "_is_exact", lambda: True)
    FastProducts(CPU)
    following = FastProducts(CPU)
    assert th.get_float32_matmul_precision() == "medium"
    following.end()
    assert th.get_float32_matmul_precision() == "highest"
