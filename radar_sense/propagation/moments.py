"""The result of every method of propagation, and the moments of P_D where z is normal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from radar_sense.states import FloatArray

#: A pose is nonlinear if higher orders would change σ by more than this fraction of σ.
STD_CHANGE = 0.02
#: A pose is nonlinear if higher orders would change a bound by more than this.
BOUND_CHANGE = 0.005


@dataclass(frozen=True, eq=False, repr=False)
class Moments:
    """Mean, standard deviation and bounds of a probability at each pose.

    Attributes:
        p_d: P_D of the nominal states (...).
        mean: Mean of P_D (...).
        std: Standard deviation of P_D (...).
        lower: Bound that P_D falls below with probability Φ(−β) (...).
        upper: Bound that P_D stays below with probability Φ(β) (...).
        converged: Where the method's iteration has converged (...). Elsewhere mean, std and bounds
            are NaN.
        suspect: Where the method's check has to compute more to decide (...). Elsewhere the moments
            are reliable. True everywhere for a method without a first test.
    """

    p_d: FloatArray
    mean: FloatArray
    std: FloatArray
    lower: FloatArray
    upper: FloatArray
    converged: NDArray[np.bool_]
    suspect: NDArray[np.bool_] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.suspect is None:
            object.__setattr__(self, "suspect", np.ones(np.shape(self.std), dtype=bool)[()])

    def __repr__(self) -> str:
        names = ", ".join(f.name for f in fields(self))
        return f"<Moments of P_D at {np.size(self.p_d)} poses: {names}>"

    def certain_where_std_is_zero(self) -> Moments:
        """Return the moments with mean and bounds equal to P_D where σ is 0, without rounding."""
        certain = self.std == 0
        if not certain.any():
            return self
        mean, lower, upper = (
            np.where(certain, self.p_d, values) for values in (self.mean, self.lower, self.upper)
        )
        return replace(self, mean=mean, lower=lower, upper=upper)

    def reshaped(self, shape: tuple[int, ...]) -> Moments:
        """Return the moments as arrays of this shape, or scalars where it is ()."""
        return Moments(*(getattr(self, f.name).reshape(shape)[()] for f in fields(self)))

    def at(self, rows: NDArray[np.intp] | slice) -> Moments:
        """Return the moments at some poses, of moments (k,)."""
        return Moments(*(getattr(self, f.name)[rows] for f in fields(self)))

    @classmethod
    def concatenated(cls, parts: Iterable[Moments]) -> Moments:
        """Return the moments of all parts (k,), one after the other."""
        parts = list(parts)
        return cls(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)))


def differ(values: Sequence[FloatArray], better: Sequence[FloatArray]) -> NDArray[np.bool_]:
    """Return where (k,) σ or a bound differs too much from a better value, or is NaN."""
    std, lower, upper = (abs(v - b) for v, b in zip(values, better, strict=True))
    return ~((std <= STD_CHANGE * better[0]) & (lower <= BOUND_CHANGE) & (upper <= BOUND_CHANGE))


def normal_exceedance(mean: FloatArray, std: FloatArray, limit: float) -> FloatArray:
    """Return P(x > limit) (k,) for normal x; 0 or 1 where σ is 0."""
    mean = np.broadcast_to(mean, std.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        probability = ndtr((mean - limit) / std)
    certain = np.where(np.isnan(mean), np.nan, mean > limit)
    return np.where(std == 0, certain, probability)


def probit_moments(m: FloatArray, s: FloatArray, points: int = 32) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of Φ(z) for normal z with mean m and deviation s (k,).

    The mean is Φ(h) with h = m/√(1 + s²). The variance is 2 [T(h, 1) − T(h, a)] with
    a = 1/√(1 + 2s²) and Owen's T (D. B. Owen, Ann. Math. Statist. 27(4), 1956). T(h, x) is
    the integral of exp(−h²(1 + t²)/2)/(2π(1 + t²)) from 0 to x. The difference is the integral from
    a to 1, in which nothing cancels for small s. The number of points is a multiple of 8. The
    integral is exact to rounding for s up to 0.5 with 8 points, and for s up to 30 with 32 points.
    """
    h = m / np.sqrt(1.0 + s * s)
    a = 1.0 / np.sqrt(1.0 + 2.0 * s * s)
    width = 2.0 * (s * a) ** 2 / (1.0 + a)  # 1 − a
    nodes, weights = _gauss_legendre(points)
    square = (0.5 * width) * (1.0 - nodes)
    np.subtract(1.0, square, out=square)
    np.square(square, out=square)
    square += 1.0
    integrand = -0.5 * (h * h) * square
    np.exp(integrand, out=integrand)
    integrand /= square
    integrand *= weights
    # in the order in which NumPy adds the elements of a row
    terms, *others = integrand.reshape(points // 8, 8, len(width))
    for other in others:
        terms += other
    while len(terms) > 1:
        terms = terms[::2] + terms[1::2]
    variance = width * terms[0] / (2.0 * np.pi)
    return ndtr(h), np.sqrt(variance)


@cache
def _gauss_legendre(points: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights (points, 1) of integrals from −1 to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    return nodes[:, np.newaxis], weights[:, np.newaxis]
