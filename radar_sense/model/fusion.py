"""Fusion of independent radars: the probability that at least one of them detects.

With z_i = Φ⁻¹(P_i), radar i misses with probability Q_i = Φ(−z_i). Q_i keeps its digits where P_i
rounds to 1. The fused values are

    Q = Π Q_i,  z = Φ⁻¹(1 − Q),  ∂z/∂z_i = (Q/Q_i) φ(z_i)/φ(z),  ∂P_D/∂z_i = (Q/Q_i) φ(z_i).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import log_ndtr, ndtri_exp

from radar_sense.model.normal import density, hazard
from radar_sense.states import FloatArray

#: z of a radar that does not see the target. Minus infinity would make sums NaN, and Φ(−1e6) is 0.
UNSEEN = -1e6
#: Below Φ(−9) = 1e-19, P_D equals the sum of all P_i in double precision.
_RARE = -9.0
_LOG_HALF = math.log(0.5)
#: Above this z the rounding of φ(z)/Φ(−z) − z exceeds the error of a short continued fraction.
_LARGE = 100.0


def either(p: FloatArray, q: FloatArray) -> FloatArray:
    """Return 1 − (1 − p)(1 − q) without cancellation, never above 1."""
    return p + (1.0 - p) * q


def fuse_probits(z: FloatArray) -> FloatArray:
    """Return the fused z (...) of the z_i (m, ...), from the lesser of P_D and 1 − P_D."""
    if len(z) == 1:
        return z[0]
    missed = np.sum(log_ndtr(-z), axis=0)  # ln Q
    upper = missed < _LOG_HALF
    rare = z.max(axis=0) < _RARE
    hit = np.log(-np.expm1(np.where(rare | upper, -1.0, missed)))
    hit = np.where(rare, np.logaddexp.reduce(log_ndtr(np.where(rare, z, 0.0)), axis=0), hit)
    return np.where(upper, -ndtri_exp(missed), ndtri_exp(np.where(upper, -1.0, hit)))


def linearize_fusion(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the fused z (...) of the z_i (m, ...), and its partials ∂z/∂z_i (m, ...)."""
    fused = fuse_probits(z)
    # φ(z_i)/φ(z) from the difference of squares, so that neither underflows
    log_weight = _missed_by_others(z) + 0.5 * (fused - z) * (fused + z)
    return fused, np.exp(np.minimum(log_weight, 0.0))  # at most 1 without rounding


def slopes_of_p_d(z: FloatArray) -> FloatArray:
    """Return ∂P_D/∂z_i (m, ...) = exp(ln Q − ln Q_i) φ(z_i) for the z_i (m, ...)."""
    if len(z) == 1:
        return density(z)
    return np.exp(_missed_by_others(z)) * density(z)


def excess_hazard(z: FloatArray) -> FloatArray:
    """Return e(z) = φ(z)/Φ(−z) − z (...), which is positive.

    The partials w_i = ∂z/∂z_i of the fused z have the derivatives

        ∂w_i/∂z_j = δ_ij w_i e(z_i) − w_i w_j e(z),

    because φ(z)/Φ(−z) is the derivative of −ln Φ(−z), and z the derivative of −ln φ(z). For large
    z, e(z) is the continued fraction 1/(z + 2/(z + 3/(z + …))) (DLMF 7.9.1).
    """
    large = np.maximum(z, _LARGE)
    fraction = 1.0 / (large + 2.0 / (large + 3.0 / (large + 4.0 / large)))
    return np.where(z < _LARGE, hazard(z) - z, fraction)


def _missed_by_others(z: FloatArray) -> FloatArray:
    """Return ln Q − ln Q_i for each radar (m, ...), a sum over the others without subtraction."""
    others = np.zeros_like(z)
    for i, missed in enumerate(log_ndtr(-z)):
        others[:i] += missed
        others[i + 1 :] += missed
    return others
