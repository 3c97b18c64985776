"""The sources of uncertainty of an error budget: their names, and where the states have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from radar_sense.states import (
    AIRCRAFT,
    ATTENUATION_ERROR,
    ATTITUDE,
    CONSTANT,
    POSITION,
    RCS_ERROR,
    TILT_ERROR,
    component,
    of_radar,
)

#: Name of the error of the RCS; that of a band has the name of the band behind.
AIRCRAFT_RCS = "aircraft_rcs"
#: Parameters that a radar may have besides c_r, by name, and where its state has their errors. In
#: the error budget of one radar each is a source if it is uncertain.
PARAMETERS = {"attenuation": ATTENUATION_ERROR, "tilt": TILT_ERROR}
#: Sources that the paper does not have; their columns follow the total.
FURTHER = (AIRCRAFT_RCS, *(f"radar_{name}" for name in PARAMETERS))


@dataclass(frozen=True)
class Source:
    """A source: some components of the state of the aircraft or of those of all radars.

    Attributes:
        owner: "aircraft" or "radar".
        components: Their places in the state, (6,) or (7m,).
        part_of: Name of the source below which a budget has a finer one.
    """

    owner: str
    components: tuple[int, ...]
    part_of: str = ""


def sources(
    names: Sequence[str], bands: Sequence[str], types: Sequence[str], uncertain: Sequence[str]
) -> dict[str, Source]:
    """Return the sources of an error budget by name. Together they have all components.

    Each radar of a network is one source, and so are the errors that radars of a type share. The
    sources of a single radar are the paper's.

    Args:
        names: Names of the radars (m,); () for a single radar without a name.
        bands: Band of each radar (m,).
        types: The types of radars that share tolerances.
        uncertain: Which of `PARAMETERS` are uncertain.
    """
    found = {
        "aircraft_position": Source("aircraft", _numbers(POSITION)),
        "aircraft_orientation": Source("aircraft", _numbers(ATTITUDE)),
    }
    if len(bands) == 1:
        found["radar_position"] = Source("radar", _numbers(POSITION))
        found["radar_constant"] = Source("radar", (CONSTANT,))
    else:
        for i, name in enumerate(names):
            own = _numbers(of_radar(i))
            found[name] = Source("radar", tuple(c for c in own if c != own[RCS_ERROR]))
        found |= {type_name(shared): Source("radar", ()) for shared in types}
    different = list(dict.fromkeys(bands))
    of_rcs = _numbers(component(RCS_ERROR, len(bands)))
    for band in different:
        name = AIRCRAFT_RCS if len(different) == 1 else f"{AIRCRAFT_RCS}_{band}"
        own = tuple(c for c, other in zip(of_rcs, bands, strict=True) if other == band)
        found[name] = Source("radar", own)
    if len(bands) == 1:
        found |= {f"radar_{name}": Source("radar", (PARAMETERS[name],)) for name in uncertain}
    return found


def finer_sources(names: Sequence[str], uncertain: Sequence[str]) -> dict[str, Source]:
    """Return further sources of a budget of several radars: the aircraft, and parts of radars.

    Args:
        names: Names of the radars; fewer than two have no further sources.
        uncertain: Which of `PARAMETERS` are uncertain of any radar.
    """
    if len(names) < 2:
        return {}
    finer = {"aircraft": Source("aircraft", _numbers(slice(0, len(AIRCRAFT))))}
    for i, name in enumerate(names):
        own = _numbers(of_radar(i))
        finer[f"{name}_position"] = Source("radar", own[POSITION])
        finer[f"{name}_constant"] = Source("radar", own[CONSTANT : CONSTANT + 1])
    for parameter in uncertain:
        for i, name in enumerate(names):
            at = _numbers(of_radar(i))[PARAMETERS[parameter]]
            finer[f"{name}_{parameter}"] = Source("radar", (at,), part_of=name)
    return finer


def constant_names(names: Sequence[str]) -> list[str]:
    """Return the names of the radar constants among `sources` or `finer_sources`."""
    return ["radar_constant"] if len(names) < 2 else [f"{name}_constant" for name in names]


def type_name(shared: str) -> str:
    """Return the name of the source that radars of a type share."""
    return f"type_{shared}"


def name_problem(
    names: Sequence[str], bands: Sequence[str] = (), types: Sequence[str] = ()
) -> str | None:
    """Return why these names of radars collide with rows of a budget, or None."""
    taken = {"total", "all", "interaction", "aircraft", "aircraft_position", "aircraft_orientation"}
    taken |= {AIRCRAFT_RCS, *(f"{AIRCRAFT_RCS}_{band}" for band in bands), *map(type_name, types)}
    taken |= {f"error_{name}" for name in taken}  # share_error_... is a column too
    for name in names:
        parts = (f"{name}_{part}" for part in ("position", "constant", *PARAMETERS))
        for row in (name, *parts, f"error_{name}"):
            if row in taken:
                return f"radars cannot be named {', '.join(names)}: {row!r} would mean two things"
            taken.add(row)
    for name in names:  # rows of the tolerances of c_r
        for start in (f"{name}_constant_", f"error_{name}_constant_"):
            if any(row.startswith(start) for row in taken):
                return f"radars cannot be named {', '.join(names)}: {start!r} begins parts of c_r"
    return None


def _numbers(components: slice) -> tuple[int, ...]:
    return tuple(range(components.start, components.stop, components.step or 1))
