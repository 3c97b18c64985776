"""The uncertainty of a radar constant that is made of uncertain parameters.

c_r is a product of powers of its parameters and of 10^(± dB/10), so each uncertain parameter makes
a random factor, and the factors are independent. A tolerance in decibels makes a log-normal one.
That gives σ of c_r to first order, its draws, and its moments.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np
from scipy.special import ndtr

from radar_sense.limits import Limit
from radar_sense.model.radar_equation import RADARS
from radar_sense.states import FloatArray

#: A parameter that divides must stay well away from 0: its standard deviation is at most this part
#: of its value, and no draw is lower than so many standard deviations below its value (3 in ten
#: million would be). Without that c_r would have no mean.
MAX_DIVISOR_STD, LOWEST_DIVISOR = 1.0 / 6.0, -5.0
TOLERANCE_DB = Limit(at_least=0, at_most=20)
#: c_r is called not Gaussian where its mean or its standard deviation, as parts of the ones that a
#: method takes it to have, or its skewness differ by more than this.
MEAN_CHANGE, STD_CHANGE, SKEWNESS_CHANGE = 0.01, 0.02, 0.3
_NEPERS = math.log(10.0) / 10.0  # ln of a ratio of powers of 1 dB


@dataclass(frozen=True)
class Tolerance:
    """The tolerance of a parameter of a radar constant, Gaussian in the unit of its key.

    Attributes:
        key: Its key in a scenario.
        value: Its nominal value, in the unit of the key.
        std: Its standard deviation, in that unit.
        power: c_r goes with this power of it; with 10^(power · value/10) if it is in decibels.
        decibels: Whether it is.
    """

    key: str
    value: float
    std: float
    power: int
    decibels: bool

    @property
    def slope(self) -> float:
        """∂ ln c_r/∂u for the parameter at value + std · u, at u = 0: σ of c_r over c_r."""
        return self.power * self.std * (_NEPERS if self.decibels else 1.0 / self.value)

    def factor(self, white: FloatArray) -> FloatArray:
        """What c_r is multiplied by where the parameter is at value + std · white (...).

        A parameter that c_r grows with is 0 where it would be negative, as c_r itself is.
        """
        if self.decibels:
            return np.exp(self.slope * white)
        lowest = 0.0 if self.power > 0 else 1.0 + LOWEST_DIVISOR * self.std / self.value
        factor: FloatArray = np.maximum(1.0 + (self.std / self.value) * white, lowest) ** self.power
        return factor

    def moment(self, order: int) -> float:
        """Mean of the factor raised to an order: closed for decibels, otherwise by quadrature."""
        if self.decibels:
            return _log_normal_moment(order, self.slope)
        relative = self.std / self.value
        lowest = LOWEST_DIVISOR if self.power < 0 else -1.0 / max(relative, 0.1)
        points, weights = _legendre(200)
        u = lowest + 0.5 * (10.0 - lowest) * (1.0 + points)
        density = np.exp(-0.5 * u * u) / math.sqrt(2.0 * math.pi)
        above = 0.5 * (10.0 - lowest) * np.sum(weights * density * self.factor(u) ** order)
        return float(above + ndtr(lowest) * self.factor(np.array(lowest)) ** order)


#: The name that modules still import; to be removed with their next change.
Part = Tolerance


@dataclass(frozen=True)
class DataSheet:
    """The parameters that a radar constant is computed from.

    Attributes:
        kind: A name in `radar_equation.RADARS`.
        constant: c_r [J m²/K].
        values: The parameters, by the keys of a scenario file and in their units.
        search_factor: The search factor as a scenario file writes it, of a surveillance radar.
    """

    kind: str
    constant: float
    values: Mapping[str, float]
    search_factor: int | str | None = None

    def tolerances(self, std: Mapping[str, float]) -> tuple[Tolerance, ...]:
        """Return the tolerances of parameters, from their standard deviations by key."""
        return tuple(
            Tolerance(
                key,
                self.values[key],
                std[key],
                f.metadata["power"] * unit.power,
                f.metadata["decibels"],
            )
            for f in fields(RADARS[self.kind])
            for key, unit in f.metadata.get("units", {}).items()
            if key in std
        )


@dataclass(frozen=True)
class Shape:
    """Mean and standard deviation of a positive quantity over its nominal value, and skewness."""

    mean: float
    std: float
    skewness: float


def relative_std(parts: Sequence[Tolerance]) -> float:
    """σ of c_r over c_r to first order: √Σ (∂ ln c_r/∂x_k σ_k)²."""
    return math.sqrt(sum(part.slope**2 for part in parts))


def factors(parts: Sequence[Tolerance], white: FloatArray) -> FloatArray:
    """Draw what c_r is multiplied by, (...), from unit normals (..., parts)."""
    product = parts[0].factor(white[..., 0])
    for i, part in enumerate(parts[1:], start=1):
        product = product * part.factor(white[..., i])
    return product


def draw(constants: FloatArray, parts: Sequence[Tolerance], white: FloatArray) -> FloatArray:
    """Draw radar constants (...) from nominal ones (...) and unit normals (..., parts)."""
    return constants * factors(parts, white)


def shape(parts: Sequence[Tolerance]) -> Shape:
    """Mean, standard deviation and skewness of c_r as the parts make it, all factors multiplied.

    Means of powers of independent factors multiply: E c^n = Π E f_k^n.
    """
    return _shape(*(math.prod(part.moment(n) for part in parts) for n in (1, 2, 3)))


def taken_for(parts: Sequence[Tolerance], *, log_normal: bool) -> Shape:
    """Return the shape that a method of propagation takes c_r to have, with σ of first order.

    Log-normal is exact where all parts are in decibels. The other methods take c_r for Gaussian.
    """
    std = relative_std(parts)
    if not log_normal:
        return Shape(1.0, std, 0.0)
    return _shape(*(_log_normal_moment(n, std) for n in (1, 2, 3)))


def doubts(
    names: Sequence[str],
    parts: Sequence[Sequence[Tolerance]],
    method: str,
    *,
    log_normal: bool,
) -> tuple[str, ...]:
    """Return the radars (m,) whose c_r has another distribution than a method assumes.

    Args:
        names: Names of the radars; a single radar needs none.
        parts: Tolerances of the c_r of each radar; nothing for a Gaussian c_r.
        method: Name of the method.
        log_normal: Whether the method assumes a log-normal c_r, and not a Gaussian one.
    """
    texts = [doubt(some, method, log_normal=log_normal) if some else None for some in parts]
    if len(texts) == 1:
        return tuple(filter(None, texts))
    return tuple(f"{name}: {text}" for name, text in zip(names, texts, strict=True) if text)


def doubt(parts: Sequence[Tolerance], method: str, *, log_normal: bool) -> str | None:
    """Return how the distribution of c_r differs from the one that a method assumes, or None."""
    exact, taken = shape(parts), taken_for(parts, log_normal=log_normal)
    if (
        abs(exact.mean - taken.mean) <= MEAN_CHANGE
        and abs(exact.std - taken.std) <= STD_CHANGE * taken.std
        and abs(exact.skewness - taken.skewness) <= SKEWNESS_CHANGE
    ):
        return None
    kind = "log-normal" if log_normal else "Gaussian"
    return (
        f"c_r is not {kind}, the assumption of {method}: of its nominal value its mean is "
        f"{exact.mean:.1%} ({kind}: {taken.mean:.1%}), its standard deviation {exact.std:.1%} "
        f"({taken.std:.1%}), its skewness {exact.skewness:.2f} ({taken.skewness:.2f}); "
        "use montecarlo, which draws c_r from its tolerances"
    )


def describe(constant: float, parts: Sequence[Tolerance]) -> str:
    """Say in words how c_r is distributed, exactly and to first order."""
    exact, first_order = shape(parts), constant * relative_std(parts)
    return (
        f"c_r has mean {constant * exact.mean:.4g}, standard deviation {constant * exact.std:.4g} "
        f"(first order {first_order:.4g}), skewness {exact.skewness:.2f}"
    )


@lru_cache
def _legendre(points: int) -> tuple[FloatArray, FloatArray]:
    """Return points and weights of Gauss-Legendre quadrature, which take 15 ms to compute."""
    return np.polynomial.legendre.leggauss(points)


def _log_normal_moment(order: int, std: float) -> float:
    """Return E x^n of a log-normal x with median 1; about 1e308 where it is larger."""
    return math.exp(min(0.5 * (order * std) ** 2, 709.0))


def _shape(first: float, second: float, third: float) -> Shape:
    if not third < 1e300:  # no other power below overflows: none is larger than the third moment
        return Shape(math.inf, math.inf, math.inf)
    variance = max(second - first * first, 0.0)
    if variance <= 1e-12 * first * first:  # nothing but rounding
        return Shape(first, 0.0, 0.0)
    skewness = (third - 3.0 * first * variance - first**3) / variance**1.5
    return Shape(first, math.sqrt(variance), skewness)
