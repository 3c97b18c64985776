"""From gradient and covariance to the uncertainty of P_D."""

from __future__ import annotations

import numpy as np

from radar_sense.states import FloatArray


def linear_variance(jacobian: FloatArray, covariance: FloatArray) -> FloatArray:
    """Variance to first order, A C Aᵀ of `eq:pd_var`.

    Args:
        jacobian: Partials A (..., n).
        covariance: Covariance C (..., n, n) of the state, symmetric and positive semidefinite.

    Returns:
        (...), never negative.
    """
    variance: FloatArray = np.einsum("...i,...ij,...j->...", jacobian, covariance, jacobian)
    # A C Aᵀ of a semidefinite C can round to just below zero.
    return np.maximum(variance, 0.0)
