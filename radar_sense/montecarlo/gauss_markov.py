"""The first-order Gauss-Markov process of errors along a path.

The errors at successive times have the correlation ρ = exp(−Δt/τ), and each time adds an innovation
with the standard deviation √(1 − ρ²) (A. Gelb, *Applied Optimal Estimation*, 1974, ch. 3). At τ = 0
errors at different times are independent. At τ = ∞ all times have the same error.
"""

from __future__ import annotations

import numpy as np

from radar_sense.states import FloatArray


def correlate(normals: FloatArray, time: FloatArray, correlation_time: float) -> None:
    """Replace independent unit normals (K, ...) by unit normals of the process, in their place.

    The times (K,) of the process ascend, and no two are equal.
    """
    with np.errstate(divide="ignore", over="ignore"):
        x = np.diff(time) / correlation_time
    rho, innovation_std = np.exp(-x), np.sqrt(-np.expm1(-2.0 * x))
    for k in range(1, len(normals)):
        normals[k] *= innovation_std[k - 1]
        normals[k] += rho[k - 1] * normals[k - 1]
