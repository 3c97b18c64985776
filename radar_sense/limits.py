"""What a parameter may be, said once: for the classes that hold it and for the scenario reader."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any


@dataclass(frozen=True)
class Limit:
    """The numbers that a parameter may take; all of them finite.

    Attributes:
        above: Exclusive lower end.
        at_least: Inclusive lower end.
        below: Exclusive upper end.
        at_most: Inclusive upper end.
        whole: Whether only whole numbers will do.
    """

    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    whole: bool = False

    def allows(self, value: float) -> bool:
        """Say whether the value is within the limit."""
        return (
            (isinstance(value, int) or math.isfinite(value))  # an int may be too large for a float
            and (self.above is None or value > self.above)
            and (self.at_least is None or value >= self.at_least)
            and (self.below is None or value < self.below)
            and (self.at_most is None or value <= self.at_most)
            and (not self.whole or value == int(value))
        )

    def __str__(self) -> str:
        ends = (
            ("greater than", self.above),
            ("not less than", self.at_least),
            ("less than", self.below),
            ("not greater than", self.at_most),
        )
        said = [f"{words} {end:g}" for words, end in ends if end is not None]
        kind = "a whole number" if self.whole else "a number"
        return " ".join([kind, " and ".join(said)]).strip()


ANY = Limit()
POSITIVE = Limit(above=0)
NOT_NEGATIVE = Limit(at_least=0)
PROBABILITY = Limit(at_least=1e-100, below=1)
#: Where a map may reach [km], and how far its cells may be apart [km].
MAP_KM = Limit(at_least=-1e5, at_most=1e5)
MAP_STEP_KM = Limit(at_least=1e-6, at_most=1e5)
#: 3σ of a probability is never more.
TARGET = Limit(above=0, at_most=1.5)
#: P_max of a threshold test, and how many σ below it P_D must stay.
THRESHOLD = Limit(above=0, at_most=1)
SIGMAS = Limit(above=0, at_most=10)
#: m and n of m-of-n; more than the 12 of `mission.tracks.MAX_WINDOW` would take too many histories.
WINDOW = Limit(at_least=1, at_most=12, whole=True)
RUNS = Limit(at_least=2, at_most=1e9, whole=True)
SEED = Limit(at_least=0, whole=True)


def parameter(key: str, limit: Limit) -> Any:
    """Declare a dataclass field that a scenario sets under `key` (units in its name)."""
    return field(metadata={"key": key, "limit": limit})


def parameter_keys(cls: Any) -> list[str]:
    """Return the keys under which a scenario sets the fields declared with `parameter`."""
    return [f.metadata["key"] for f in fields(cls) if "key" in f.metadata]


def check_parameters(instance: Any) -> None:
    """Raise ValueError if a field declared with `parameter` is outside its limit."""
    for f in fields(instance):
        if "limit" in f.metadata:
            value = getattr(instance, f.name)
            if not f.metadata["limit"].allows(value):
                raise ValueError(f"{f.name} must be {f.metadata['limit']}, got {value}")
