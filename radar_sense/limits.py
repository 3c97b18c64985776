"""The limits of parameters, declared once for the classes and for the reader."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from numbers import Real
from typing import Any

from radar_sense.errors import InputError, check_choice, describe

DEG = math.pi / 180.0
#: Most radars of a scenario.
MAX_RADARS = 64
#: Largest number of letters in the name of a scenario.
MAX_NAME = 100
#: Least slant range [m]. The model holds in the far field of the antenna only.
MIN_RANGE = 1.0
#: Outside these sizes the fourth power of a number overflows or underflows.
SMALLEST, LARGEST = 1e-20, 1e20


@dataclass(frozen=True)
class Limit:
    """An interval of numbers.

    Attributes:
        above: Exclusive lower end.
        at_least: Inclusive lower end.
        below: Exclusive upper end.
        at_most: Inclusive upper end.
        whole: Whether the number must be whole.
        infinite: Whether it may be infinite.
    """

    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    whole: bool = False
    infinite: bool = False

    def allows(self, value: Any) -> bool:
        """Return whether the value is a number within the limit."""
        if isinstance(value, bool) or not isinstance(value, Real):
            return False
        number: Any = value
        most = math.inf if self.infinite else sys.float_info.max
        return (
            # an int too large for a float is allowed where it stays an int, such as a seed
            ((self.whole and isinstance(number, int)) or abs(number) <= most)
            and (self.above is None or number > self.above)
            and (self.at_least is None or number >= self.at_least)
            and (self.below is None or number < self.below)
            and (self.at_most is None or number <= self.at_most)
            and (not self.whole or number == int(number))
        )

    def __str__(self) -> str:
        ends = (
            ("greater than", self.above),
            ("not less than", self.at_least),
            ("less than", self.below),
            ("not greater than", self.at_most),
        )
        conditions = [f"{words} {end:g}" for words, end in ends if end is not None]
        kind = "a whole number" if self.whole else "a number"
        finite = " ".join([kind, " and ".join(conditions)]).strip()
        return f"{finite}, or .inf" if self.infinite else finite


@dataclass(frozen=True)
class Text:
    """Text that matches a regular expression, which is in words too."""

    pattern: str
    words: str

    def allows(self, value: object) -> bool:
        """Return whether the value is such a text."""
        return isinstance(value, str) and re.fullmatch(self.pattern, value) is not None

    def __str__(self) -> str:
        return self.words


#: Names become parts of the names of files and columns.
NAME = Text(
    f"[A-Za-z0-9][A-Za-z0-9_.-]{{0,{MAX_NAME - 1}}}",
    f"a name of up to {MAX_NAME} letters A to Z, digits, '_', '-' or '.'",
)
RADAR_NAME, LEVEL_NAME, BAND, TYPE = (
    Text(
        "[A-Za-z0-9][A-Za-z0-9_-]{0,39}",
        f"the name of a {what}, up to 40 letters A to Z, digits, '_' or '-'",
    )
    for what in ("radar", "level", "band", "type")
)
ANY = Limit()
POSITIVE = Limit(above=0)
NOT_NEGATIVE = Limit(at_least=0)
#: Correlation time of pose errors [s].
CORRELATION = Limit(at_least=0, infinite=True)
#: Standard deviation in decibels.
STD_DB = Limit(at_least=0, at_most=20)
PROBABILITY = Limit(at_least=1e-100, below=1)
#: Ends of a map [km], and the distance between its cells [km].
MAP_KM = Limit(at_least=-1e5, at_most=1e5)
MAP_STEP_KM = Limit(at_least=1e-6, at_most=1e5)
#: 3σ of P_D: the standard deviation of a probability is 0.5 at most.
TARGET = Limit(above=0, at_most=1.5)
#: P_max and P_min of a threshold test, and its number of σ. Between poses a P_min near 0 would be
#: within the noise of its bound.
THRESHOLD, P_MIN = Limit(above=0, at_most=1), Limit(at_least=0.01, below=1)
SIGMAS = Limit(above=0, at_most=10)
#: The probability of P_D beyond P_max or P_min in place of a number of σ.
ABOVE = Limit(at_least=1e-20, below=0.5)
#: m and n of m-of-n, limited by the 2^(n − 1) histories of `mission.tracks`.
WINDOW = Limit(at_least=1, at_most=12, whole=True)
RUNS = Limit(at_least=2, at_most=1e9, whole=True)
SEED = Limit(at_least=0, whole=True)
WORKERS = Limit(at_least=1, at_most=256, whole=True)

#: How uncertain states become a distribution of P_D: the methods by name, each a module and a class
#: of `propagation`. "automatic" chooses the method that is right.
METHODS = {
    "linear": "linear:Linear",
    "probit": "probit:Probit",
    "form": "form:Form",
    "montecarlo": "plain:PlainDraws",
    "automatic": "automatic:Automatic",
}
#: Formats of a figure.
FORMATS = ("png", "pdf", "svg")
#: Sizes of a figure: a journal's column, its page, and a slide.
STYLES = ("one-column", "two-columns", "slides", "paper")


def parameter(
    key: str, meaning: str, kind: Limit | type | Mapping[str, type], *, default: Any = MISSING
) -> Any:
    """Declare a dataclass field that a scenario file sets.

    Args:
        key: Key in the file, with the SI unit in the name.
        meaning: Meaning of the field, a sentence.
        kind: The numbers allowed. Or, for a mapping, the dataclass of the field, or dataclasses by
            the `type` in the mapping.
        default: Value of a missing key. Without a default the key is required.
    """
    return field(default=default, metadata={"key": key, "meaning": meaning, "kind": kind})


def declared(kind: Limit | Text | tuple[str, ...] | type, *, default: Any = MISSING) -> Any:
    """Declare a dataclass field that `check_parameters` checks. A default of None is allowed."""
    return field(default=default, metadata={"kind": kind})


def plain_number(value: Any) -> Any:
    """Return a NumPy scalar or an array without axes as a Python number; else the value."""
    return value.item() if getattr(value, "ndim", None) == 0 else value


def check_number(name: str, value: Any, limit: Limit) -> Any:
    """Return an allowed value as a Python number, which is an int if the number must be whole."""
    number = plain_number(value)
    if not limit.allows(number):
        raise InputError(f"{name} must be {limit}, got {describe(number)}")
    if limit.whole:
        return int(number)
    return number if isinstance(number, int) else float(number)


def check_flag(name: str, value: object) -> None:
    """Raise InputError unless a value is True or False."""
    if not isinstance(value, bool):
        raise InputError(f"{name} must be True or False, got {describe(value)}")


class Checked:
    """A dataclass whose declared fields are checked, see `check_parameters`."""

    def __post_init__(self) -> None:
        check_parameters(self)


def check_parameters(instance: Any) -> None:
    """Check the fields that are declared with a kind, and make Python's of NumPy's scalars."""
    for f in fields(instance):
        value, kind = plain_number(getattr(instance, f.name)), f.metadata.get("kind")
        if kind is None or (value is None and f.default is None):
            continue
        if isinstance(kind, Limit):
            value = check_number(f.name, value, kind)
        elif kind is bool:
            check_flag(f.name, value)
        elif isinstance(kind, Text):
            if not kind.allows(value):
                raise InputError(f"{f.name} must be {kind}, got {describe(value)}")
        elif isinstance(kind, tuple):
            check_choice(f.name, value, kind)
        elif isinstance(kind, type | Mapping):
            classes = (kind,) if isinstance(kind, type) else tuple(kind.values())
            if not isinstance(value, classes):
                allowed = ", ".join(cls.__name__ for cls in classes)
                raise InputError(f"{f.name} must be {allowed} or None, got {value!r}")
        object.__setattr__(instance, f.name, value)  # the classes are frozen
