"""The two state vectors: their components, in order, and the sources of uncertainty in them.

Every array of states has the components on the last axis, in the order given here. The states of
several radars follow each other. The errors of further parameters come after the radars: ε of the
RCS, and the error of ln α of each radar, with the attenuation α. Like the radar states, these
errors are the same at all poses. States have no further errors, ε alone, or ε and the error of each
ln α.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_sense.errors import InputError

FloatArray: TypeAlias = NDArray[np.float64]
#: Largest sizes of a component and of a radar constant: R⁴ and the ratio S may not overflow.
MOST, MOST_CONSTANT = 1e60, 1e200
#: x_a of the paper: position in the north-east-down frame [m] and ZYX Euler angles [rad].
AIRCRAFT = ("north", "east", "down", "roll", "pitch", "yaw")
#: x_r of the paper: position in the north-east-down frame [m] and radar constant c_r [J m²/K].
RADAR = ("north", "east", "down", "constant")
POSITION = slice(0, 3)
ATTITUDE = slice(3, 6)
DOWN, YAW = 2, 5
CONSTANT = 3
#: The errors of the RCS and of the attenuation in the state of one radar.
RCS_ERROR, ATTENUATION_ERROR = len(RADAR), len(RADAR) + 1
#: The radar constants in the states of one radar or of several, without further errors.
CONSTANTS = slice(CONSTANT, None, len(RADAR))
#: A source of uncertainty: "aircraft" or "radar", and components of that state.
Source: TypeAlias = tuple[str, slice | list[int]]
#: Name of the error of the RCS as a source, in the error budget of one radar or of several.
AIRCRAFT_RCS = "aircraft_rcs"
#: Name of the attenuation as a source, in the error budget of one radar.
RADAR_ATTENUATION = "radar_attenuation"
#: The sources of the paper's error budget.
SOURCES: dict[str, Source] = {
    "aircraft_position": ("aircraft", POSITION),
    "aircraft_orientation": ("aircraft", ATTITUDE),
    "radar_position": ("radar", POSITION),
    "radar_constant": ("radar", slice(CONSTANT, CONSTANT + 1)),
}


def sources(
    radars: Sequence[str] = (), *, rcs: bool = False, attenuation: bool = False
) -> dict[str, Source]:
    """Return the sources of an error budget by name. Together they have all components.

    Args:
        radars: Names of the radars. Each of several radars is one source. The sources of a single
            radar are `SOURCES`.
        rcs: Whether the error of the RCS is a source.
        attenuation: Whether the attenuation of a single radar is a source. In a network the
            attenuation is a part of the source of each radar.
    """
    sources = dict(SOURCES)
    if len(radars) > 1:
        sources = {name: source for name, source in SOURCES.items() if source[0] == "aircraft"}
        size = size_of(len(radars), rcs=rcs, attenuation=attenuation)
        for i, name in enumerate(radars):
            sources[name] = "radar", own_components_of(i, len(radars), size)
    if rcs:
        sources[AIRCRAFT_RCS] = "radar", [len(RADAR) * max(1, len(radars))]
    if attenuation and len(radars) < 2:
        sources[RADAR_ATTENUATION] = "radar", [ATTENUATION_ERROR]
    return sources


def finer_sources(radars: Sequence[str] = (), *, attenuation: bool = False) -> dict[str, Source]:
    """Return further sources of a budget of several radars: the aircraft, and parts of radars.

    Args:
        radars: Names of the radars; fewer than two have no further sources.
        attenuation: Whether the attenuation of each radar is a source.
    """
    if len(radars) < 2:
        return {}
    finer: dict[str, Source] = {"aircraft": ("aircraft", slice(0, len(AIRCRAFT)))}
    for i, name in enumerate(radars):
        finer[f"{name}_position"] = _of_radar(i, POSITION)
        finer[f"{name}_constant"] = _of_radar(i, slice(CONSTANT, CONSTANT + 1))
    if attenuation:
        first = len(RADAR) * len(radars) + 1
        finer |= {f"{name}_attenuation": ("radar", [first + i]) for i, name in enumerate(radars)}
    return finer


def constant_names(radars: Sequence[str] = ()) -> list[str]:
    """Return the names of the radar constants among `sources` or `finer_sources`."""
    return ["radar_constant"] if len(radars) < 2 else [f"{name}_constant" for name in radars]


def components_of(radars: Sequence[int], count: int, size: int) -> list[int]:
    """Return the places of some radars, and of their further errors, in the states of all.

    Args:
        radars: Numbers of the radars, from 0.
        count: Number of all radars, m.
        size: Number of components of the states of all radars, from `sizes_of`.
    """
    places = [len(RADAR) * i + component for i in radars for component in range(len(RADAR))]
    end = len(RADAR) * count
    if size > end:
        places.append(end)
    return places + ([end + 1 + i for i in radars] if size > end + 1 else [])


def own_components_of(radar: int, count: int, size: int) -> list[int]:
    """Return `components_of` one radar without ε of the RCS, which all radars of a network share.

    Args:
        radar: Number of the radar, from 0.
        count: Number of all radars, m.
        size: Number of components of the states of all radars, from `sizes_of`.
    """
    return [c for c in components_of([radar], count, size) if c != len(RADAR) * count]


def sizes_of(count: int) -> tuple[int, int, int]:
    """Return the possible numbers of components of states of m radars with further errors."""
    return (
        size_of(count, rcs=False, attenuation=False),
        size_of(count, rcs=True, attenuation=False),
        size_of(count, rcs=True, attenuation=True),
    )


def size_of(count: int, *, rcs: bool, attenuation: bool) -> int:
    """Return the number of components of the states of m radars with further errors."""
    if attenuation:
        return (len(RADAR) + 1) * count + 1
    return len(RADAR) * count + int(rcs)


def constants_of(count: int) -> slice:
    """Return the radar constants in the states of m radars with further errors."""
    return slice(CONSTANT, len(RADAR) * count, len(RADAR))


def _of_radar(number: int, components: slice) -> Source:
    first = number * len(RADAR)
    return "radar", slice(first + components.start, first + components.stop)


def real_array(name: str, values: ArrayLike) -> FloatArray:
    """Return values as an array of floats, the array itself if it is one.

    Raises:
        InputError: If the values are masked, ragged, or no real numbers: NumPy would drop the mask
            and the imaginary parts, and would make numbers of text, booleans and dates.
    """
    if type(values) is np.ndarray and values.dtype == float:
        return values
    if isinstance(values, np.ma.MaskedArray):
        raise InputError(f"{name} must not be a masked array: give it without the masked values")
    try:
        given = np.asarray(values)
    except ValueError as error:
        raise InputError(f"{name} must be an array of numbers: {error}") from error
    if given.dtype.kind not in "iuf":
        raise InputError(f"{name} must be an array of real numbers, got {given.dtype}")
    return given.astype(float)


def check_finite(whose: str, states: ArrayLike, radars: int = 0) -> None:
    """Raise InputError if states (..., n) of "aircraft" or "radar" are not finite, or too large.

    The error names the first value that is not allowed, its component and its pose, from 0.

    Args:
        whose: "aircraft" or "radar".
        states: The states.
        radars: Number of radars; 0 if no further errors follow them.
    """
    values = real_array(f"{whose} states", states)
    if values.min(initial=0.0) >= -MOST and values.max(initial=0.0) <= MOST:  # False for NaN
        return
    most = np.full(values.shape[-1:], MOST)
    if whose == "radar":
        most[constants_of(max(radars, 1))] = MOST_CONSTANT
    wrong = np.argwhere(~(abs(values) <= most))
    if not len(wrong):
        return
    *pose, component = wrong[0].tolist()
    names = AIRCRAFT if whose == "aircraft" else RADAR
    name = names[component % len(names)]
    end = len(RADAR) * radars
    if whose == "radar" and radars and component >= end:
        name = "the error of the RCS" if component == end else "the error of an attenuation"
    elif whose == "radar" and values.shape[-1] > len(RADAR):
        name += f" of radar {component // len(RADAR) + 1}"
    value = values[tuple(wrong[0])]
    allowed = f"at most {most[component]:g} in size" if np.isfinite(value) else "finite"
    raise InputError(f"{whose} states must be {allowed}, got {value:g} for {name}{at_pose(pose)}")


def at_pose(index: Sequence[int]) -> str:
    """Return the pose of an index for an error; "" for ()."""
    if not index:
        return ""
    return f" at pose {', '.join(map(str, index))} (counted from 0)"
