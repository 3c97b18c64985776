"""From gradient and covariance to the uncertainty of P_D."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from radar_sense.states import FloatArray


def linear_variance(jacobian: FloatArray, covariance: ArrayLike) -> FloatArray:
    """Variance to first order, A C Aᵀ of `eq:pd_var`.

    Args:
        jacobian: Partials A (..., n).
        covariance: Covariance C (..., n, n) of the state, symmetric and positive semidefinite.

    Returns:
        (...), never negative.

    Raises:
        ValueError: If the covariance is not (..., n, n).
    """
    covariance = np.asarray(covariance, dtype=float)
    n = jacobian.shape[-1]
    if covariance.shape[-2:] != (n, n):
        raise ValueError(f"covariance must have shape (..., {n}, {n}), got {covariance.shape}")
    variance: FloatArray = np.einsum("...i,...ij,...j->...", jacobian, covariance, jacobian)
    # A C Aᵀ of a semidefinite C can round to just below zero.
    return np.maximum(variance, 0.0)
