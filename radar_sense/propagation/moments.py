"""Numbers of a normal probit: the moments of Φ(z), and the probability of exceeding a limit."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.special import ndtr

from radar_sense.states import FloatArray


def normal_exceedance(mean: FloatArray, std: FloatArray, limit: float) -> FloatArray:
    """Return P(x > limit) (k,) for normal x; 0 or 1 where σ is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        probability = ndtr((mean - limit) / std)
    certain = np.where(np.isnan(mean), np.nan, mean > limit)
    return np.where(std == 0, certain, probability)


def probit_moments(m: FloatArray, s: FloatArray, points: int = 32) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of Φ(z) for normal z with mean m and deviation s (k,).

    The mean is Φ(h) with h = m/√(1 + s²). The variance is 2 [T(h, 1) − T(h, a)] with
    a = 1/√(1 + 2s²) and Owen's T (D. B. Owen, Ann. Math. Statist. 27(4), 1956). T(h, x) is
    the integral of exp(−h²(1 + t²)/2)/(2π(1 + t²)) from 0 to x. The difference is the integral from
    a to 1, in which nothing cancels for small s. The integral is exact to rounding for s up to 0.5
    with 8 points, and for s up to 30 with 32 points.
    """
    h = m / np.sqrt(1.0 + s * s)
    a = 1.0 / np.sqrt(1.0 + 2.0 * s * s)
    width = 2.0 * (s * a) ** 2 / (1.0 + a)  # 1 − a
    nodes, weights = _gauss_legendre(points)
    square = 1.0 + (1.0 - 0.5 * width * (1.0 - nodes)) ** 2
    integrand = np.exp(-0.5 * (h * h) * square) / square
    # a sum over rows, because a product by BLAS rounds by the number of poses
    variance = width * np.sum(weights * integrand, axis=0) / (2.0 * np.pi)
    return ndtr(h), np.sqrt(variance)


@cache
def _gauss_legendre(points: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights (points, 1) of integrals from −1 to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    return nodes[:, np.newaxis], weights[:, np.newaxis]
