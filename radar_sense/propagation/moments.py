"""What every method answers, and the moments of a normal probit."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.special import ndtr

from radar_sense.propagation.draws import Estimate
from radar_sense.states import FloatArray
from radar_sense.uncertain_states import UncertainStates

#: Number of σ from the mean to a bound, if no other number is given: the paper's.
BETA = 3.0
#: Nodes and weights (16, 1) of integrals from −1 to 1.
_NODES, _WEIGHTS = (x[:, np.newaxis] for x in np.polynomial.legendre.leggauss(16))


class Distribution:
    """The distribution of P_D of uncertain states at each of k poses, by a method.

    A value is NaN where the method has none.
    """

    def __init__(self, states: UncertainStates) -> None:
        self.states = states

    @cached_property
    def p_d(self) -> FloatArray:
        """P_D of the nominal states (k,)."""
        return self.states.model.unchecked_p_d(self.states.aircraft, self.states.radar)

    @cached_property
    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation of P_D (k,)."""
        raise NotImplementedError

    @property
    def mean(self) -> FloatArray:
        """Mean of P_D (k,): P_D itself, without rounding, where nothing is uncertain."""
        mean, std = self.moments
        return np.where((std == 0) & np.isfinite(self.p_d), self.p_d, mean)

    @property
    def std(self) -> FloatArray:
        """Standard deviation of P_D (k,)."""
        return self.moments[1]

    def quantile(self, beta: float) -> FloatArray:
        """Return the quantile of P_D (k,) at Φ(β)."""
        raise NotImplementedError

    def error(self, beta: float) -> FloatArray:
        """Return the standard error of the quantiles at ±β (k,), 0 without draws."""
        return np.zeros(len(self.states))

    def drawn(self, beta: float) -> Estimate | None:
        """Return what draws say that judge the quantiles at ±β, None if none do."""

    def exceedance(self, p_max: float) -> FloatArray:
        """Return P(P_D > p_max) (k,)."""
        raise NotImplementedError

    def with_covariances(self, changed: UncertainStates) -> Distribution:
        """Return the distribution for the same states with other covariances."""
        return type(self)(changed)


def normal_exceedance(mean: FloatArray, std: FloatArray, limit: float) -> FloatArray:
    """Return P(x > limit) (k,) for normal x; 0 or 1 where σ is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        probability = ndtr((mean - limit) / std)
    certain = np.where(np.isnan(mean), np.nan, mean > limit)
    return np.where(std == 0, certain, probability)


def probit_moments(m: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of Φ(z) for normal z with mean m and deviation s (k,).

    The mean is Φ(h) with h = m/√(1 + s²). The variance is 2 [T(h, 1) − T(h, a)] with
    a = 1/√(1 + 2s²) and Owen's T (D. B. Owen, Ann. Math. Statist. 27(4), 1956). T(h, x) is
    the integral of exp(−h²(1 + t²)/2)/(2π(1 + t²)) from 0 to x. The difference is the integral from
    a to 1, in which nothing cancels for small s. With 16 points it is exact to rounding for |m| up
    to 14.
    """
    h = m / np.sqrt(1.0 + s * s)
    a = 1.0 / np.sqrt(1.0 + 2.0 * s * s)
    width = 2.0 * (s * a) ** 2 / (1.0 + a)  # 1 − a
    square = 1.0 + (1.0 - 0.5 * width * (1.0 - _NODES)) ** 2
    integrand = np.exp(-0.5 * (h * h) * square) / square
    # a sum over rows, because a product by BLAS rounds by the number of poses
    variance = width * np.sum(_WEIGHTS * integrand, axis=0) / (2.0 * np.pi)
    return ndtr(h), np.sqrt(variance)
