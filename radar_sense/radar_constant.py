"""The uncertainty of a radar constant that is made of uncertain parameters.

c_r is a product of powers of its parameters and of 10^(± dB/10), so each uncertain parameter makes
a random factor, and the factors are independent. A tolerance in decibels makes a log-normal one.
That gives σ of c_r to first order, its draws, and its moments.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from scipy.special import ndtr

from radar_sense.limits import NOT_NEGATIVE, Limit
from radar_sense.radar import RADARS, SEARCH_FACTORS, Unit
from radar_sense.reader import LARGEST, SMALLEST, Entry
from radar_sense.states import CONSTANT, RADAR, FloatArray

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
class Part:
    """An uncertain parameter of a radar constant, Gaussian in the unit of its key.

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
            return math.exp(0.5 * (order * self.slope) ** 2)
        relative = self.std / self.value
        lowest = LOWEST_DIVISOR if self.power < 0 else -1.0 / max(relative, 0.1)
        points, weights = np.polynomial.legendre.leggauss(200)
        u = lowest + 0.5 * (10.0 - lowest) * (1.0 + points)
        density = np.exp(-0.5 * u * u) / math.sqrt(2.0 * math.pi)
        above = 0.5 * (10.0 - lowest) * np.sum(weights * density * self.factor(u) ** order)
        return float(above + ndtr(lowest) * self.factor(np.array(lowest)) ** order)


@dataclass(frozen=True)
class Shape:
    """Mean and standard deviation of a positive quantity over its nominal value, and skewness."""

    mean: float
    std: float
    skewness: float


def relative_std(parts: Sequence[Part]) -> float:
    """σ of c_r over c_r to first order: √Σ (∂ ln c_r/∂x_k σ_k)²."""
    return math.sqrt(sum(part.slope**2 for part in parts))


def factors(parts: Sequence[Part], white: FloatArray) -> FloatArray:
    """Draw what c_r is multiplied by, (...), from unit normals (..., parts)."""
    product = parts[0].factor(white[..., 0])
    for i, part in enumerate(parts[1:], start=1):
        product = product * part.factor(white[..., i])
    return product


def draw(constants: FloatArray, parts: Sequence[Part], white: FloatArray) -> FloatArray:
    """Draw radar constants (...) from nominal ones (...) and unit normals (..., parts)."""
    return constants * factors(parts, white)


def shape(parts: Sequence[Part]) -> Shape:
    """Mean, standard deviation and skewness of c_r as the parts make it, all factors multiplied.

    Means of powers of independent factors multiply: E c^n = Π E f_k^n.
    """
    return _shape(*(math.prod(part.moment(n) for part in parts) for n in (1, 2, 3)))


def taken_for(parts: Sequence[Part], *, log_normal: bool) -> Shape:
    """Return the shape that a method of propagation takes c_r to have, with σ of first order.

    Log-normal is exact where all parts are in decibels. The other methods take c_r for Gaussian.
    """
    std = relative_std(parts)
    if not log_normal:
        return Shape(1.0, std, 0.0)
    return _shape(*(math.exp(0.5 * (n * std) ** 2) for n in (1, 2, 3)))


def doubts(
    names: Sequence[str], parts: Sequence[Sequence[Part]], method: str, *, log_normal: bool
) -> tuple[str, ...]:
    """Say so of each radar (m,) whose c_r is not distributed as a method takes it to be.

    Args:
        names: The radars' names; the constant of a single radar needs none.
        parts: What makes the c_r of each radar uncertain; nothing where that is one number.
        method: Name of the method.
        log_normal: Whether the method takes c_r for log-normal, and not for Gaussian.
    """
    found = [
        doubt(of_radar, method, log_normal=log_normal) if of_radar else None for of_radar in parts
    ]
    if len(found) == 1:
        return tuple(filter(None, found))
    return tuple(f"{name}: {said}" for name, said in zip(names, found, strict=True) if said)


def doubt(parts: Sequence[Part], method: str, *, log_normal: bool) -> str | None:
    """Say so if c_r is not distributed as a method of propagation takes it to be."""
    exact, taken = shape(parts), taken_for(parts, log_normal=log_normal)
    if (
        abs(exact.mean - taken.mean) <= MEAN_CHANGE
        and abs(exact.std - taken.std) <= STD_CHANGE * taken.std
        and abs(exact.skewness - taken.skewness) <= SKEWNESS_CHANGE
    ):
        return None
    kind = "log-normal" if log_normal else "Gaussian"
    return (
        f"c_r is not {kind}, as {method} takes it to be: of its nominal value its mean is "
        f"{exact.mean:.1%} ({kind}: {taken.mean:.1%}), its standard deviation {exact.std:.1%} "
        f"({taken.std:.1%}), its skewness {exact.skewness:.2f} ({taken.skewness:.2f}); "
        "Monte Carlo draws it as it is"
    )


def describe(constant: float, parts: Sequence[Part]) -> str:
    """Say in words how c_r is distributed, exactly and to first order."""
    exact, first_order = shape(parts), constant * relative_std(parts)
    return (
        f"c_r has mean {constant * exact.mean:.4g}, standard deviation {constant * exact.std:.4g} "
        f"(first order {first_order:.4g}), skewness {exact.skewness:.2f}"
    )


def _shape(first: float, second: float, third: float) -> Shape:
    variance = max(second - first * first, 0.0)
    if variance <= 1e-12 * first * first:  # nothing but rounding
        return Shape(first, 0.0, 0.0)
    skewness = (third - 3.0 * first * variance - first**3) / variance**1.5
    return Shape(first, math.sqrt(variance), skewness)


@dataclass(frozen=True)
class Makeup:
    """What a scenario says a radar constant is made of.

    Attributes:
        kind: A name in `radar.RADARS`.
        constant: c_r [J m²/K].
        values: Its parameters by the keys that the scenario gives.
    """

    kind: str
    constant: float
    values: Mapping[str, float]

    def parts(self, std: Mapping[str, float]) -> tuple[Part, ...]:
        """Return the uncertain parameters, from standard deviations by key."""
        found = []
        for f in fields(RADARS[self.kind]):
            for key, unit in f.metadata.get("units", {}).items():
                if key in std:
                    power = f.metadata["power"] * unit.power
                    value, decibels = self.values[key], f.metadata["decibels"]
                    found.append(Part(key, value, std[key], power, decibels))
        return tuple(found)

    def read_tolerances(self, entry: Entry) -> dict[str, float]:
        """Read standard deviations by key, each in the unit of its key.

        Raises:
            ScenarioError: If a key is not one that the radar is given by, or a number not allowed.
        """
        found = entry.mapping([], list(self.values))
        if not found:
            raise entry.error(f"needs at least one of the keys {', '.join(self.values)}")
        std: dict[str, float] = {}
        for key, value in found.items():
            part = self.parts({key: 0.0})[0]
            std[key] = value.number(TOLERANCE_DB if part.decibels else NOT_NEGATIVE)
            most = MAX_DIVISOR_STD * part.value
            if part.power < 0 and not part.decibels and std[key] > most:
                raise value.error(
                    f"must be a number not less than 0 and not greater than {most:g}, 1/6 of the "
                    f"parameter, as c_r is divided by it; got {std[key]:g}"
                )
        return std


def read_makeup(entry: Entry, kind: str) -> tuple[Makeup, dict[str, Any]]:
    """Read the parameters of a radar, each in one of the units that it may have.

    Args:
        entry: The mapping.
        kind: A name in `radar.RADARS`.

    Returns:
        What the constant is made of, and the mapping as a document.

    Raises:
        ScenarioError: If anything in it is not allowed.
    """
    cls = RADARS[kind]
    declared = [f for f in fields(cls) if "units" in f.metadata]
    alternatives: dict[str, Mapping[str, Unit]] = {f.name: f.metadata["units"] for f in declared}
    keys = [key for units in alternatives.values() for key in units]
    others = ["search_factor"] if kind == "surveillance" else []
    found = entry.mapping([], [*keys, *others])
    values: dict[str, float] = {}
    arguments: dict[str, float] = {}
    for f in declared:
        given = [key for key in f.metadata["units"] if key in found]
        if len(given) != 1:
            names = " and ".join(f"'{key}'" for key in f.metadata["units"])
            if len(f.metadata["units"]) == 1:
                raise entry.error(f"missing key {names}")
            raise entry.error(f"needs exactly one of the keys {names}")
        key = given[0]
        values[key] = found[key].number(f.metadata["limit"])
        arguments[f.name] = f.metadata["units"][key].to_si(values[key])
    document: dict[str, Any] = dict(values)
    if others:
        name = found["search_factor"].choice(SEARCH_FACTORS) if "search_factor" in found else "16"
        arguments["search_factor"] = SEARCH_FACTORS[name]
        document["search_factor"] = int(name) if name.isdigit() else name
    constant = cls(**arguments).constant()
    if not SMALLEST <= constant <= LARGEST:
        raise entry.error(
            f"makes the radar constant {constant:g} J m^2/K, allowed is {SMALLEST:g} to {LARGEST:g}"
        )
    return Makeup(kind, constant, values), document


def normals(components: int, parts: Sequence[Sequence[Part]]) -> int:
    """How many unit normals radar states take: one for each component, and for c_r its parts."""
    return components + sum(max(0, len(of_radar) - 1) for of_radar in parts)


def made_of_parts(parts: Sequence[Sequence[Part]]) -> list[int]:
    """Return the places, among the states of all radars, of each c_r that is made of parts."""
    return [len(RADAR) * i + CONSTANT for i, of_radar in enumerate(parts) if of_radar]


def columns(components: int, parts: Sequence[Sequence[Part]]) -> list[list[int]]:
    """Return which of these unit normals the parts of each radar take.

    The first takes that of its c_r, the others take more, which come after those of all components.
    """
    found, end = [], components
    for i, of_radar in enumerate(parts):
        more = range(end, end + max(0, len(of_radar) - 1))
        found.append([len(RADAR) * i + CONSTANT, *more] if of_radar else [])
        end = more.stop
    return found
