"""The uncertainty of a radar constant that is computed from uncertain parameters.

c_r is a product of powers of its parameters and of 10^(± dB/10). Each uncertain parameter
contributes a random factor, and the factors are independent. The factor of a tolerance in decibels
is log-normal. The factors give σ of c_r to first order, its draws, and its moments.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from typing import TypeAlias

import numpy as np
from scipy.special import ndtr

from radar_sense.errors import InputError
from radar_sense.limits import ANY, NAME, NOT_NEGATIVE, TYPE, Checked, Limit, Text, declared
from radar_sense.model.radar_equation import LOSSES_KEY, MOST_NEPERS, NEPERS, RADARS, Unit
from radar_sense.states import FloatArray

#: Largest standard deviation of a divisor of c_r as a fraction of its value, and lowest draw in
#: standard deviations. c_r has no mean if a divisor may be 0. Without the limit 3 draws in ten
#: million would be lower.
MAX_DIVISOR_STD, LOWEST_DIVISOR = 1.0 / 6.0, -5.0
#: The type of radar whose radars share an error, or none.
SHARED = Text(f"({TYPE.pattern})?", f"{TYPE}, or empty")
_LOSS = f"{LOSSES_KEY}."  # begins the key of a loss by name
#: Points and weights of Gauss-Legendre quadrature, which take 15 ms to compute.
_legendre = cache(np.polynomial.legendre.leggauss)
#: What identifies the error of a tolerance: the number of a radar, or a type, and the parameter.
ErrorKey: TypeAlias = tuple[int | str, str]


@dataclass(frozen=True)
class Tolerance(Checked):
    """The tolerance of a parameter of a radar constant, in the unit of its key.

    The parameter is Gaussian, or rectangular: any value within limits, as a data sheet gives them,
    is as likely as another (JCGM 101:2008, 6.4.2).

    Attributes:
        key: Key of the parameter in a scenario file; `losses_db.NAME` for a loss by name.
        value: Nominal value of the parameter, in the unit of the key.
        std: Standard deviation of the parameter, in the unit of the key.
        power: c_r is proportional to this power of the parameter, or to 10^(power · value/10) for a
            parameter in decibels.
        decibels: Whether the parameter is in decibels.
        rectangular: Whether it is rectangular, with the half width √3 · std.
        shared: The type of radar whose radars have one error of this parameter; "" for one radar.
    """

    key: str = declared(NAME)
    value: float = declared(ANY)
    std: float = declared(NOT_NEGATIVE)
    power: int = declared(Limit(whole=True))
    decibels: bool = declared(bool)
    rectangular: bool = declared(bool, default=False)
    shared: str = declared(SHARED, default="")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.decibels and not self.value > 0:
            raise InputError(f"value must be greater than 0 if not in decibels, got {self.value:g}")

    @property
    def name(self) -> str:
        """Name of the parameter in tables: its key, or `NAME_db` of a loss by name."""
        return column_name(self.key)

    @property
    def slope(self) -> float:
        """Contribution to σ of c_r over c_r: ∂ ln c_r/∂x of value + std · x at x = 0."""
        return self.power * self.std * (NEPERS if self.decibels else 1.0 / self.value)

    def error_key(self, radar: int) -> ErrorKey:
        """Return the key of the error of a radar with this number; radars of a type share it."""
        return self.shared or radar, self.key

    def factor(self, normals: FloatArray) -> FloatArray:
        """Return the factor of c_r (...) where the parameter is value + std · normals.

        Unit normals become rectangular numbers of the same variance where the parameter is.
        The parameter is limited from below: to 0 where c_r is proportional to it, and to
        `LOWEST_DIVISOR` standard deviations where c_r is divided by it. A standard deviation above
        `MAX_DIVISOR_STD`, of a search for factors, has the limit of `MAX_DIVISOR_STD`.
        """
        if self.rectangular:
            normals = math.sqrt(3.0) * (2.0 * ndtr(normals) - 1.0)
        if self.decibels:
            return np.exp(np.minimum(self.slope * normals, MOST_NEPERS))
        relative_std = min(self.std / self.value, MAX_DIVISOR_STD)
        lowest = 0.0 if self.power > 0 else 1.0 + LOWEST_DIVISOR * relative_std
        relative = np.maximum(1.0 + (self.std / self.value) * normals, lowest)
        return relative**self.power

    def moment(self, order: int) -> float:
        """Return the mean of the factor raised to an order, by quadrature if not in closed form."""
        if self.decibels and not self.rectangular:  # log-normal; about 1e308 where it is larger
            return math.exp(min(0.5 * (order * self.slope) ** 2, 709.0))
        relative = 0.1 if self.decibels else self.std / self.value
        lowest = LOWEST_DIVISOR if self.power < 0 else -1.0 / max(relative, 0.1)
        lowest = -10.0 if self.rectangular else lowest
        points, weights = _legendre(200)
        u = lowest + 0.5 * (10.0 - lowest) * (1.0 + points)
        density = np.exp(-0.5 * u * u) / math.sqrt(2.0 * math.pi)
        above = 0.5 * (10.0 - lowest) * np.sum(weights * density * self.factor(u) ** order)
        return float(above + ndtr(lowest) * self.factor(np.array(lowest)) ** order)


@dataclass(frozen=True)
class DataSheet:
    """The parameters that a radar constant is computed from.

    Attributes:
        kind: A name in `radar_equation.RADARS`.
        constant: c_r [J m²/K].
        values: The parameters, by the keys of a scenario file and in the units of these keys;
            losses by name under `losses_db.NAME`.
        scan_time: Time of one scan [s]; None of a radar that does not scan.
    """

    kind: str
    constant: float
    values: Mapping[str, float]
    scan_time: float | None = None

    def tolerances(
        self, std: Mapping[str, float], rectangular: Collection[str] = ()
    ) -> tuple[Tolerance, ...]:
        """Return the tolerances of parameters, from standard deviations by key."""
        return tuple(
            Tolerance(
                key, self.values[key], std[key], power * unit.power, decibels, key in rectangular
            )
            for key, unit, power, decibels in self._parameters()
            if key in std
        )

    def terms(self) -> dict[str, float]:
        """Return the factors of c_r in decibels of SI units, by the names of `Tolerance`.

        Their sum is c_r but for the numbers of the radar equation.
        """
        terms = {}
        for key, unit, power, decibels in self._parameters():
            value = unit.to_si(self.values[key])
            terms[column_name(key)] = power * (value if decibels else 10 * math.log10(value))
        return terms

    def _parameters(self) -> Iterator[tuple[str, Unit, int, bool]]:
        """Yield key, unit, power of c_r, and whether it is in decibels, of each parameter."""
        for f in fields(RADARS[self.kind]):
            for key, unit in f.metadata.get("units", {}).items():
                if key in self.values:
                    yield key, unit, f.metadata["power"], f.metadata["decibels"]
        for key in self.values:
            if key.startswith(_LOSS):
                yield key, Unit(), -1, True


def loss_key(name: str) -> str:
    """Return the key of a loss by name."""
    return f"{_LOSS}{name}"


def column_name(key: str) -> str:
    """Return the name of a parameter in tables."""
    return f"{key.removeprefix(_LOSS)}_db" if key.startswith(_LOSS) else key


def relative_std(tolerances: Sequence[Tolerance]) -> float:
    """Return σ of c_r over c_r to first order, √Σ (∂ ln c_r/∂x_k σ_k)²."""
    return math.sqrt(sum(tolerance.slope**2 for tolerance in tolerances))


def factors(tolerances: Sequence[Tolerance], normals: FloatArray) -> FloatArray:
    """Return random factors of c_r (...) from unit normals (..., tolerances)."""
    most = math.exp(MOST_NEPERS)
    product = tolerances[0].factor(normals[..., 0])
    for i, tolerance in enumerate(tolerances[1:], start=1):
        product = np.minimum(product * tolerance.factor(normals[..., i]), most)
    return product


def moments(tolerances: Sequence[Tolerance]) -> tuple[float, float, float]:
    """Return mean and standard deviation of c_r over its nominal value, and its skewness.

    Means of powers of independent factors multiply: E c^n = Π E f_k^n.
    """
    first, second, third = (
        math.prod(tolerance.moment(n) for tolerance in tolerances) for n in (1, 2, 3)
    )
    if not third < 1e300:  # no other power below overflows: none is larger than the third moment
        return math.inf, math.inf, math.inf
    variance = second - first * first
    if variance <= 1e-12 * first * first:  # nothing but rounding
        return first, 0.0, 0.0
    skewness = (third - 3.0 * first * variance - first**3) / variance**1.5
    small = variance <= 1e-8 * first * first  # the skewness is below 0.001, as is its rounding
    return first, math.sqrt(variance), 0.0 if small else skewness
