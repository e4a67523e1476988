"""Faster matrix products, where they cost no precision."""

from __future__ import annotations

from functools import cache
from typing import ClassVar

import torch as th


@cache
def _is_exact() -> bool:
    """Whether "medium" products are rounded as little as single precision rounds, on this CPU."""
    generator = th.Generator().manual_seed(0)
    left, right = (th.randn(2, 64, 128, generator=generator), th.randn(2, 128, 128, generator=generator))
    expected = left.double() @ right.double()
    return float((left @ right - expected).abs().max() / expected.std()) < 1e-5


class FastProducts:
    """
    PyTorch's precision ``"medium"`` for matrix products on a CPU (:func:`torch.set_float32_matmul_precision`) until
    :meth:`end`, if this CPU rounds them no more than in single precision. They are then made by oneDNN, which uses
    AVX-512 where MKL does not: on AMD's processors, in half the time. What the user has chosen is left as it is. A
    training that an exception ends leaves products fast, until another one ends.

    :param device: of the networks; nothing is changed for any other than the CPU
    """

    #: whether the present setting was made here
    changed: ClassVar[bool] = False

    def __init__(self, device: th.device) -> None:
        if device.type != "cpu" or th.get_float32_matmul_precision() != "highest":
            return
        th.set_float32_matmul_precision("medium")
        FastProducts.changed = True
        if not _is_exact():
            self.end()

    @staticmethod
    def end() -> None:
        """Leave PyTorch as it was. A second call changes nothing."""
        if FastProducts.changed and th.get_float32_matmul_precision() == "medium":
            th.set_float32_matmul_precision("highest")
        FastProducts.changed = False
