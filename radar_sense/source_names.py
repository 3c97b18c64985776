"""The sources of uncertainty of an error budget: their names, and where the states have them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from radar_sense.model.radar_constant import ErrorKey, Tolerance
from radar_sense.states import (
    AIRCRAFT,
    ATTENUATION_ERROR,
    ATTITUDE,
    CONSTANT,
    POSITION,
    RCS_ERROR,
    TILT_ERROR,
    of_radar,
)

#: Name of the error of the RCS; that of a band has the name of the band behind.
AIRCRAFT_RCS = "aircraft_rcs"
#: Parameters that a radar may have besides c_r, by name, and where its state has their errors. In
#: the error budget of one radar each is a source if it is uncertain.
PARAMETERS = {"attenuation": ATTENUATION_ERROR, "tilt": TILT_ERROR}
#: Sources that the paper does not have; their columns follow the total.
FURTHER = (AIRCRAFT_RCS, *(f"radar_{name}" for name in PARAMETERS))
#: Kinds of sources: those that together have all errors; in a network the whole aircraft, and
#: position, constant and further parameters of each radar; and parts of c_r, one a tolerance.
SOURCE, FINER, PART = "source", "finer", "part"


@dataclass(frozen=True)
class Source:
    """A source of uncertainty: components of a state, and errors of tolerances of c_r.

    Attributes:
        kind: `SOURCE`, `FINER` or `PART`.
        owner: Whose state has the components, "aircraft" or "radar".
        components: Their places in the state of the aircraft (6,) or of all radars (7m,).
        errors: The errors of tolerances, see `Tolerance.error_key`.
        part_of: Name of the source below which a budget has a finer one or a part.
    """

    kind: str
    owner: str
    components: tuple[int, ...] = ()
    errors: frozenset[ErrorKey] = frozenset()
    part_of: str = ""

    def overlaps(self, other: Source) -> bool:
        """Return whether both have a component or an error."""
        same = self.owner == other.owner and not {*self.components}.isdisjoint(other.components)
        return same or not self.errors.isdisjoint(other.errors)


def sources(
    names: Sequence[str],
    bands: Sequence[str],
    types: Sequence[str],
    uncertain: Sequence[str],
    tolerances: Sequence[Sequence[Tolerance]],
) -> dict[str, Source]:
    """Return the sources of an error budget by name: first `SOURCE`, then `FINER`, then `PART`.

    Each radar of a network is one source, and so are the errors that radars of a type share. The
    sources of a single radar are the paper's.

    Args:
        names: Names of the radars (m,); () for a single radar without a name.
        bands: Band of each radar (m,).
        types: The types of radars that share tolerances.
        uncertain: Which of `PARAMETERS` are uncertain of any radar.
        tolerances: Tolerances of each c_r (m,).
    """
    several = len(bands) > 1
    constants = [f"{name}_constant" for name in names] if several else ["radar_constant"]
    parts: dict[str, Source] = {}
    errors: defaultdict[str, frozenset[ErrorKey]] = defaultdict(frozenset)
    for i, of_constant in enumerate(tolerances):
        for t in of_constant:
            constant = type_name(t.shared) if several and t.shared else constants[i]
            source = names[i] if several and not t.shared else constant
            error = frozenset({t.error_key(i)})
            parts[f"{constant}_{t.name}"] = Source(PART, "radar", errors=error, part_of=source)
            errors[source] |= error

    found = {
        "aircraft_position": Source(SOURCE, "aircraft", _numbers(POSITION)),
        "aircraft_orientation": Source(SOURCE, "aircraft", _numbers(ATTITUDE)),
    }
    of_radars = [_numbers(of_radar(i)) for i in range(len(bands))]
    if several:
        for name, own in zip(names, of_radars, strict=True):
            without_rcs = (*own[:RCS_ERROR], *own[RCS_ERROR + 1 :])
            found[name] = Source(SOURCE, "radar", without_rcs, errors[name])
        for name in map(type_name, types):
            found[name] = Source(SOURCE, "radar", errors=errors[name])
    else:
        found["radar_position"] = Source(SOURCE, "radar", _numbers(POSITION))
        for name in constants:
            found[name] = Source(SOURCE, "radar", (CONSTANT,), errors[name])
    different = list(dict.fromkeys(bands))
    for band in different:
        name = AIRCRAFT_RCS if len(different) == 1 else f"{AIRCRAFT_RCS}_{band}"
        own = tuple(at[RCS_ERROR] for at, b in zip(of_radars, bands, strict=True) if b == band)
        found[name] = Source(SOURCE, "radar", own)
    if several:
        found["aircraft"] = Source(FINER, "aircraft", _numbers(slice(0, len(AIRCRAFT))))
        for name, constant, own in zip(names, constants, of_radars, strict=True):
            found[f"{name}_position"] = Source(FINER, "radar", own[POSITION], part_of=name)
            found[constant] = Source(FINER, "radar", (own[CONSTANT],), errors[name], name)
        for parameter in uncertain:
            for name, own in zip(names, of_radars, strict=True):
                at = own[PARAMETERS[parameter]]
                found[f"{name}_{parameter}"] = Source(FINER, "radar", (at,), part_of=name)
    else:
        for parameter in uncertain:
            found[f"radar_{parameter}"] = Source(SOURCE, "radar", (PARAMETERS[parameter],))
    return found | parts


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
