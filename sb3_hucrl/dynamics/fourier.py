"""Fourier features, whose inner products approximate the squared exponential kernel (appendix B.4.5)."""

from __future__ import annotations

import math
from typing import Annotated, TypeAlias

import numpy as np
import torch as th
from pydantic import Field
from torch import nn

from sb3_hucrl.checks import ArgumentError, Count, Positive, validated

#: largest number of quadrature features, because a matrix of this size is stored and factorised
MAX_FEATURES = 5_000
#: a sine and a cosine for each frequency
Pairs: TypeAlias = Annotated[
    int, Field(ge=2, multiple_of=2, description="an even number of at least 2, for sines and cosines")
]


class FourierFeatures(nn.Module):
    """
    Features φ(x) = (√c cos Ωx, √c sin Ωx), so that φ(x)ᵀφ(x′) = Σ_j c_j cos(ω_jᵀ (x - x′)).

    :param frequencies: Ω, shape (F, d)
    :param weights: c, shape (F,); they sum to 1
    """

    frequencies: th.Tensor
    amplitudes: th.Tensor

    def __init__(self, frequencies: th.Tensor, weights: th.Tensor) -> None:
        super().__init__()
        self.register_buffer("frequencies", frequencies.double())
        self.register_buffer("amplitudes", weights.double().sqrt())
        self.num_features = 2 * len(frequencies)

    def forward(self, inputs: th.Tensor) -> th.Tensor:
        """
        :param inputs: shape (..., d)
        :return: shape (..., num_features), in float64
        """
        phase = inputs.double() @ self.frequencies.T
        return th.cat([phase.cos() * self.amplitudes, phase.sin() * self.amplitudes], dim=-1)


@validated
def random_features(
    input_dim: Count, num_features: Pairs, lengthscale: Positive, generator: th.Generator | None
) -> FourierFeatures:
    """
    Random Fourier features (Rahimi and Recht 2008): frequencies are drawn from the kernel's spectral density
    N(0, I / l²).

    :param input_dim: d
    :param num_features: number of features, even
    :param lengthscale: l
    :param generator: draws the frequencies
    """
    frequencies = th.randn(num_features // 2, input_dim, generator=generator, dtype=th.float64) / lengthscale
    return FourierFeatures(frequencies, th.full((len(frequencies),), 1 / len(frequencies)))


@validated
def quadrature_features(input_dim: Count, nodes_per_dim: Count, lengthscale: Positive) -> FourierFeatures:
    """
    Quadrature Fourier features (Mutny and Krause 2018): Gauss-Hermite nodes of the spectral density, on a grid.

    A frequency and its negative give equivalent features, so only one of the two is kept: about
    ``nodes_per_dim ** input_dim`` features remain.

    :param input_dim: d
    :param nodes_per_dim: grid points per input dimension
    :param lengthscale: l
    :raises ArgumentError: if the grid has too many points
    """
    if nodes_per_dim**input_dim > MAX_FEATURES:
        raise ArgumentError(
            "nodes_per_dim",
            f"is {nodes_per_dim}, which makes {nodes_per_dim**input_dim} features of {input_dim} inputs: give so few "
            f"that there are at most {MAX_FEATURES}, or use dynamics 'rff'",
        )
    nodes, weights = (th.from_numpy(values) for values in np.polynomial.hermite.hermgauss(nodes_per_dim))
    # Makes the nodes exactly symmetric, with an exact zero in the middle.
    nodes = (nodes - nodes.flip(0)) / 2
    indices = th.cartesian_prod(*[th.arange(nodes_per_dim)] * input_dim).reshape(-1, input_dim)
    # In this order the k-th point from the end is the negative of the k-th point.
    half = indices[: (len(indices) + 1) // 2]
    products = (weights / math.sqrt(math.pi))[half].prod(dim=1) * 2
    if len(indices) % 2:
        products[-1] /= 2
    return FourierFeatures(math.sqrt(2) / lengthscale * nodes[half], products)
