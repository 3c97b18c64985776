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


def split_unit(name: str) -> tuple[str, str]:
    """Return a name without the unit at its end, and the unit; "" without a unit.

    Examples are `range_km`, `db_per_km`, and `position_m[1]`, an entry of a list.
    """
    if name.endswith("]"):
        of_list, bracket, entry = name.rpartition("[")
        stem, unit = split_unit(of_list)
        return f"{stem}{bracket}{entry}", unit
    if name.endswith("_m_s"):
        return name.removesuffix("_m_s"), "m/s"
    stem, _, last = name.rpartition("_")
    if stem.endswith("_per"):
        stem, unit = split_unit(stem.removesuffix("_per"))
        return stem, f"{unit}/{UNITS.get(last, last)}"
    unit = UNITS.get(last, "") if stem else ""
    return (stem, unit) if unit else (name, "")


def unit_name(name: str) -> str:
    """Return the unit at the end of a name; "" without a unit."""
    return split_unit(name)[1]


def ascii_unit(name: str) -> str:
    """Return the unit at the end of a name in ASCII, for terminals and figures: `deg`, `m^2`."""
    return unit_name(name).translate({ord("°"): "deg", ord("µ"): "u", ord("²"): "^2"})
