"""The parameters of a radar constant, and their tolerances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from radar_sense.limits import LARGEST, NOT_NEGATIVE, SMALLEST
from radar_sense.model.radar_constant import MAX_DIVISOR_STD, TOLERANCE_DB, Part
from radar_sense.model.radar_equation import RADARS, SEARCH_FACTORS, Unit
from radar_sense.reading.yaml_reader import Entry


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
