"""The two state vectors: their components, in order, and the sources of uncertainty in them.

Every array of states has its components on the last axis, in the order given here. The states of
several radars follow each other. The error of an uncertain RCS is the last component, after the
radars. Like the radar states, the error is the same at all poses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_sense.errors import InputError

FloatArray: TypeAlias = NDArray[np.float64]
#: x_a of the paper: position in the north-east-down frame [m] and ZYX Euler angles [rad].
AIRCRAFT = ("north", "east", "down", "roll", "pitch", "yaw")
#: x_r of the paper: position in the north-east-down frame [m] and radar constant c_r [J m²/K].
RADAR = ("north", "east", "down", "constant")
POSITION = slice(0, 3)
ATTITUDE = slice(3, 6)
CONSTANT = 3
#: The error of the RCS in the state of one radar.
RCS_ERROR = len(RADAR)
#: All components of a radar.
ALL = slice(0, len(RADAR))
#: The radar constants in the states of one radar or of several.
CONSTANTS = slice(CONSTANT, None, len(RADAR))
#: A source of uncertainty: "aircraft" or "radar", and components of that state.
Source: TypeAlias = tuple[str, slice]
#: Name of the error of the RCS as a source, in the error budget of one radar or of several.
AIRCRAFT_RCS = "aircraft_rcs"
#: The sources of the paper's error budget.
SOURCES: dict[str, Source] = {
    "aircraft_position": ("aircraft", POSITION),
    "aircraft_orientation": ("aircraft", ATTITUDE),
    "radar_position": ("radar", POSITION),
    "radar_constant": ("radar", slice(CONSTANT, CONSTANT + 1)),
}


def sources(radars: Sequence[str] = (), *, rcs: bool = False) -> dict[str, Source]:
    """Return the sources of an error budget by name. Together they have all components.

    Args:
        radars: Names of the radars. Each of several radars is one source. The sources of a single
            radar are `SOURCES`.
        rcs: Whether the radar states end with the error of the RCS.
    """
    several = dict(SOURCES)
    if len(radars) > 1:
        several = {name: source for name, source in SOURCES.items() if source[0] == "aircraft"}
        several |= {name: _of_radar(i, ALL) for i, name in enumerate(radars)}
    end = len(RADAR) * max(1, len(radars))
    return {**several, **({AIRCRAFT_RCS: ("radar", slice(end, end + 1))} if rcs else {})}


def finer_sources(radars: Sequence[str] = ()) -> dict[str, Source]:
    """Return further sources of a budget of several radars: the aircraft, and parts of radars.

    Args:
        radars: Names of the radars; fewer than two have no further sources.
    """
    if len(radars) < 2:
        return {}
    finer: dict[str, Source] = {"aircraft": ("aircraft", slice(0, len(AIRCRAFT)))}
    for i, name in enumerate(radars):
        finer[f"{name}_position"] = _of_radar(i, POSITION)
        finer[f"{name}_constant"] = _of_radar(i, slice(CONSTANT, CONSTANT + 1))
    return finer


def constant_names(radars: Sequence[str] = ()) -> list[str]:
    """Return the names of the radar constants among `sources` or `finer_sources`."""
    return ["radar_constant"] if len(radars) < 2 else [f"{name}_constant" for name in radars]


def components_of(radars: Sequence[int], count: int, size: int) -> list[int]:
    """Return the components of some radars in the states of all, with the error of the RCS.

    Args:
        radars: Numbers of the radars, from 0.
        count: Number of all radars, m.
        size: Components of the states of all radars, 4m or 4m + 1.
    """
    components = [len(RADAR) * i + component for i in radars for component in range(len(RADAR))]
    return components + list(range(len(RADAR) * count, size))


def _of_radar(number: int, components: slice) -> Source:
    first = number * len(RADAR)
    return "radar", slice(first + components.start, first + components.stop)


def check_finite(whose: str, states: ArrayLike) -> None:
    """Raise InputError if states (..., n) of "aircraft" or "radar" are not all finite.

    The error names the first value that is not finite, its component and its pose, from 0.
    """
    values = np.asarray(states, dtype=float)
    with np.errstate(over="ignore", invalid="ignore"):
        if math.isfinite(values.sum()):  # faster than np.isfinite
            return
    wrong = np.argwhere(~np.isfinite(values))
    if not len(wrong):  # only the sum overflows
        return
    *pose, component = wrong[0].tolist()
    names = AIRCRAFT if whose == "aircraft" else RADAR
    name = names[component % len(names)]
    if component == values.shape[-1] - 1 and component % len(names) == 0:
        name = "the error of the RCS"
    elif whose == "radar" and values.shape[-1] > len(RADAR):
        name += f" of radar {component // len(RADAR) + 1}"
    raise InputError(
        f"{whose} states must be finite, got {values[tuple(wrong[0])]:g} for {name}{at_pose(pose)}"
    )


def at_pose(index: Sequence[int]) -> str:
    """Return the pose of an index for an error; "" for ()."""
    if not index:
        return ""
    return f" at pose {', '.join(map(str, index))} (counted from 0)"
