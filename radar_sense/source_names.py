"""The names of the sources of an error budget, and the radars' names that collide with them."""

from __future__ import annotations

from collections.abc import Sequence

from radar_sense.states import FACTORS

#: Name of the error of the RCS; that of a band has the name of the band behind.
AIRCRAFT_RCS = "aircraft_rcs"
#: Sources that the paper does not have; their columns follow the total.
FURTHER = (AIRCRAFT_RCS, *(f"radar_{name}" for name in FACTORS))


def type_name(shared: str) -> str:
    """Return the name of the source that radars of a type share."""
    return f"type_{shared}"


def name_problem(
    names: Sequence[str], bands: Sequence[str] = (), types: Sequence[str] = ()
) -> str | None:
    """Return why these names of radars collide with rows of a budget, or None."""
    refused = f"radars cannot be named {', '.join(names)}"
    taken = {"total", "all", "interaction", "aircraft", "aircraft_position", "aircraft_orientation"}
    taken |= {AIRCRAFT_RCS, *(f"{AIRCRAFT_RCS}_{band}" for band in bands), *map(type_name, types)}
    taken |= {f"error_{name}" for name in taken}  # share_error_... is a column too
    for name in names:
        parts = (f"{name}_{part}" for part in ("position", "constant", *FACTORS))
        for row in (name, *parts, f"error_{name}"):
            if row in taken:
                return f"{refused}: {row!r} would mean two things"
            taken.add(row)
    for name in names:  # rows of the tolerances of c_r
        for start in (f"{name}_constant_", f"error_{name}_constant_"):
            if any(row.startswith(start) for row in taken):
                return f"{refused}: {start!r} begins parts of c_r"
        if any(other.startswith(f"{name}_from_") for other in names):  # columns of the range
            return f"{refused}: {f'{name}_from_'!r} begins sources of the range of {name}"
    return None
