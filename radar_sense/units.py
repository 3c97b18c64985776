"""The unit of a number, which is the end of the name of its key or column."""

from __future__ import annotations

#: Units by the last word of a name.
UNITS = {
    "m": "m",
    "km": "km",
    "m2": "m²",
    "deg": "°",
    "s": "s",
    "sr": "sr",
    "k": "K",
    "w": "W",
    "kw": "kW",
    "db": "dB",
    "dbi": "dBi",
    "rpm": "1/min",
    "ghz": "GHz",
    "mhz": "MHz",
    "us": "µs",
}


def unit_name(name: str) -> str:
    """Return the unit at the end of a name; "" without a unit.

    Examples are `range_km`, `db_per_km`, and `position_m[1]`, an entry of a list.
    """
    if name.endswith("]"):
        return unit_name(name.rpartition("[")[0])
    if name.endswith("_m_s"):
        return "m/s"
    stem, _, unit = name.rpartition("_")
    if stem.endswith("_per"):
        return f"{unit_name(stem.removesuffix('_per'))}/{UNITS.get(unit, unit)}"
    return UNITS.get(unit, "") if stem else ""


def ascii_unit(name: str) -> str:
    """Return the unit at the end of a name in ASCII, for terminals and figures: `deg`, `m^2`."""
    return unit_name(name).translate({ord("°"): "deg", ord("µ"): "u", ord("²"): "^2"})


def without_unit(name: str) -> str:
    """Return a name without the unit at its end."""
    if not unit_name(name):
        return name
    if name.endswith("]"):
        of_list, bracket, entry = name.rpartition("[")
        return f"{without_unit(of_list)}{bracket}{entry}"
    if name.endswith("_m_s"):
        return name.removesuffix("_m_s")
    stem = name.rpartition("_")[0]
    return without_unit(stem.removesuffix("_per")) if stem.endswith("_per") else stem
