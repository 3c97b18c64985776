"""The two state vectors: their components, in order, and the sources of uncertainty in them.

Every array of states has its components on the last axis, in the order given here. Nothing else
in the package spells that order out. The states of several radars follow one after the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray: TypeAlias = NDArray[np.float64]
#: x_a of the paper: position in the north-east-down frame [m] and ZYX Euler angles [rad].
AIRCRAFT = ("north", "east", "down", "roll", "pitch", "yaw")
#: x_r of the paper: position in the north-east-down frame [m] and radar constant c_r [J m²/K].
RADAR = ("north", "east", "down", "constant")
POSITION = slice(0, 3)
ATTITUDE = slice(3, 6)
CONSTANT = 3
#: All of a radar.
ALL = slice(0, len(RADAR))
#: The radar constants in the states of one radar or of several.
CONSTANTS = slice(CONSTANT, None, len(RADAR))
#: A source of uncertainty: whose state, and which of its components.
Source: TypeAlias = tuple[str, slice]
#: The sources of the paper's error budget: whose state, and which of its components.
SOURCES: dict[str, Source] = {
    "aircraft_position": ("aircraft", POSITION),
    "aircraft_orientation": ("aircraft", ATTITUDE),
    "radar_position": ("radar", POSITION),
    "radar_constant": ("radar", slice(CONSTANT, CONSTANT + 1)),
}


def sources(radars: Sequence[str] = ()) -> dict[str, Source]:
    """Return the sources of an error budget, which together are all components, by name.

    Args:
        radars: The names of several radars, each a source of its own. For a single radar, named or
            not, they are `SOURCES`.
    """
    if len(radars) < 2:
        return dict(SOURCES)
    aircraft = {name: source for name, source in SOURCES.items() if source[0] == "aircraft"}
    return {**aircraft, **{name: _of_radar(i, ALL) for i, name in enumerate(radars)}}


def finer_sources(radars: Sequence[str] = ()) -> dict[str, Source]:
    """Return what else a budget of several radars shows: the aircraft as a whole, radars in parts.

    Args:
        radars: The names of the radars; for fewer than two there is nothing.
    """
    if len(radars) < 2:
        return {}
    found: dict[str, Source] = {"aircraft": ("aircraft", slice(0, len(AIRCRAFT)))}
    for i, name in enumerate(radars):
        found[f"{name}_position"] = _of_radar(i, POSITION)
        found[f"{name}_constant"] = _of_radar(i, slice(CONSTANT, CONSTANT + 1))
    return found


def constant_names(radars: Sequence[str] = ()) -> list[str]:
    """Return the names that the radar constants have among both kinds of sources."""
    return ["radar_constant"] if len(radars) < 2 else [f"{name}_constant" for name in radars]


def _of_radar(number: int, components: slice) -> Source:
    first = number * len(RADAR)
    return "radar", slice(first + components.start, first + components.stop)


def check_finite(whose: str, states: ArrayLike) -> None:
    """Raise ValueError if states (..., n) of "aircraft" or "radar" are not all finite.

    The error names the first such value, its component and its pose. Poses count from 0.
    """
    values = np.asarray(states, dtype=float)
    with np.errstate(over="ignore", invalid="ignore"):
        if math.isfinite(values.sum()):  # far quicker than to look at each value
            return
    wrong = np.argwhere(~np.isfinite(values))
    if not len(wrong):  # the sum alone is too large
        return
    *pose, component = wrong[0].tolist()
    names = AIRCRAFT if whose == "aircraft" else RADAR
    name = names[component % len(names)]
    if whose == "radar" and values.shape[-1] > len(RADAR):
        name += f" of radar {component // len(RADAR) + 1}"
    raise ValueError(
        f"{whose} states must be finite, got {values[tuple(wrong[0])]:g} for {name}{at_pose(pose)}"
    )


def at_pose(index: Sequence[int]) -> str:
    """Say which pose an index is; nothing if there is a single one."""
    if not index:
        return ""
    return f" at pose {', '.join(map(str, index))} (counted from 0)"
