"""Cholesky factorisation with helpful errors."""

from __future__ import annotations

import torch as th
from linear_operator.utils.cholesky import psd_safe_cholesky
from linear_operator.utils.errors import NanError, NotPSDError


def safe_cholesky(matrix: th.Tensor) -> th.Tensor:
    """
    Cholesky factor of a matrix, with a growing jitter on the diagonal if rounding has made the matrix indefinite.

    :param matrix: symmetric, shape (..., n, n)
    :return: lower factor
    :raises ValueError: if the matrix is not positive definite even with the jitter
    """
    try:
        factor: th.Tensor = psd_safe_cholesky(matrix)
    except (NotPSDError, NanError) as error:
        raise ValueError(
            f"a kernel matrix of {matrix.shape[-1]} rows is not positive definite ({error}): raise the model's "
            "noise_std, or lower its lengthscale"
        ) from error
    return factor
