"""The cells of a map, and P_D and its upper bound in each of them.

The aircraft is put into every cell at one height and on one course, and the rest of the scenario is
as it is. Cells are computed some rows at a time, and only their results are kept.

Where the route is in latitude and longitude it is one height above the ellipsoid, and course and
attitude are those relative to the level of the cell. (At 500 km from the origin the surface is
20 km lower than there, so that cells at one "down" would be above all radars, or in the ground.)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    pass

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sense.errors import InputError
from radar_sense.limits import MAP_KM, MAP_STEP_KM
from radar_sense.model import geodesy as wgs84
from radar_sense.propagation import check_method, upper_bound
from radar_sense.scenario import Scenario
from radar_sense.states import AIRCRAFT, ATTITUDE, POSITION, RADAR, FloatArray

#: Most cells of a map; in single precision 100 MB.
MAX_CELLS = 25_000_000
#: Cells on the longer side if nothing is said of their size.
CELLS = 500
#: Cells computed at a time.
BLOCK = 65_536
#: k of the upper bound.
BETA = 3.0
DOWN = 2
_YAW = 5
#: Newton's steps to find the down of a height. After them 1 mm or less is left up to 6000 km away.
_ROUNDS = 8


@dataclass(frozen=True, eq=False)
class Grid:
    """A rectangle of cells.

    Attributes:
        north: North coordinates of the cells' centres (rows,) [m], increasing.
        east: East coordinates (columns,) [m], increasing.
    """

    north: FloatArray
    east: FloatArray

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.north), len(self.east)


def grid(
    scenario: Scenario,
    *,
    north_km: tuple[float, float] | None = None,
    east_km: tuple[float, float] | None = None,
    step_km: float | None = None,
) -> Grid:
    """Make the cells of a map.

    Args:
        scenario: The scenario.
        north_km: From where to where in north [km]. If None, as far to each side of the radars'
            centre as the farthest of radars and path, and a fifth more.
        east_km: From where to where in east [km]; likewise.
        step_km: Distance of the cells [km]; if None, a 500th of the longer side.

    Raises:
        InputError: If there is nothing between the ends, a number is out of range or there are
            too many cells.
    """
    radars = scenario.radar.reshape(-1, len(RADAR))[:, :DOWN]
    centre = radars.mean(axis=0)
    everything = np.vstack([scenario.aircraft[:, :DOWN], radars])
    reach = 1.2 * max(float(np.max(abs(everything - centre))), 1e3)
    ends = []
    for axis, (name, given) in enumerate((("north", north_km), ("east", east_km))):
        if given is None:
            ends.append((float(centre[axis]) - reach, float(centre[axis]) + reach))
            continue
        for end in given:
            if not MAP_KM.allows(end):
                raise InputError(f"{name} must be {MAP_KM} of km, got {end:g}")
        if not given[0] < given[1]:
            raise InputError(
                f"{name} must go from a lesser to a greater number of km, "
                f"got {given[0]:g} to {given[1]:g}"
            )
        ends.append((given[0] * 1e3, given[1] * 1e3))
    longest = max(stop - start for start, stop in ends)
    step = longest / CELLS if step_km is None else step_km * 1e3
    if not MAP_STEP_KM.allows(step / 1e3):
        raise InputError(f"the step must be {MAP_STEP_KM} of km, got {step / 1e3:g}")
    counts = [math.floor((stop - start) / step * (1 + 1e-12) + 1e-9) + 1 for start, stop in ends]
    if math.prod(counts) > MAX_CELLS:
        raise InputError(
            f"a step of {step / 1e3:g} km makes {math.prod(counts):,} cells, "
            f"allowed are {MAX_CELLS:,}"
        )
    if min(counts) < 2:
        raise InputError(
            f"a step of {step / 1e3:g} km is longer than a side of the map; at least two cells "
            "must fit on each"
        )
    north, east = (
        np.asarray(start + step * np.arange(count), dtype=float)
        for (start, _), count in zip(ends, counts, strict=True)
    )
    return Grid(north, east)


def p_d_in_cells(
    scenario: Scenario,
    cells: Grid,
    *,
    down: float | None = None,
    course: float | None = None,
    method: str | None = None,
    progress: Callable[[int], None] | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """P_D in each cell, and its upper bound at Φ(3) by a method of propagation if one is named.

    Roll and pitch, and height and course where they are not given, are those of the scenario's
    first pose, as is the covariance of the aircraft's state if it changes along the path.

    Args:
        scenario: The scenario.
        cells: The cells.
        down: Down coordinate [m]; where the route is in latitude and longitude, that above the
            origin, and everywhere the same height above the ellipsoid as there.
        course: Yaw [rad].
        method: Method that gives the bound, None for no bound.
        progress: Called with the number of cells that have come in since the last call.

    Returns:
        P_D and bound (rows, columns) in single precision; NaN where the aircraft would be at the
        radar, or the method does not know.

    Raises:
        InputError: If there is no such method.
    """
    if method is not None:
        check_method(method)
    pose = pose_in_cells(scenario, down, course)
    cov_aircraft = scenario.cov_aircraft.reshape(-1, len(AIRCRAFT), len(AIRCRAFT))[0]
    cov_radar = scenario.cov_radar[scenario.level]
    rows, columns = cells.shape
    p_d = np.empty((rows, columns), dtype=np.float32)
    bound = None if method is None else np.empty((rows, columns), dtype=np.float32)
    for block, aircraft in blocks(cells, pose, scenario.origin):
        p_d[block] = scenario.model.p_d(aircraft, scenario.radar)
        if bound is not None and method is not None:
            bound[block] = upper_bound(
                scenario.model,
                aircraft,
                scenario.radar,
                cov_aircraft,
                cov_radar,
                method=method,
                beta=BETA,
                log_constant=scenario.log_constant,
            )
        if progress:
            progress(aircraft.shape[0] * aircraft.shape[1])
    return p_d, bound


def pose_in_cells(scenario: Scenario, down: float | None, course: float | None) -> FloatArray:
    """State (6,) of the aircraft in every cell; its north and east have no meaning.

    With an origin down is minus the height above that of the origin, and attitude is relative to
    the level of the place.
    """
    pose: FloatArray = scenario.aircraft[0].copy()
    origin = scenario.origin
    if origin is not None:
        place = wgs84.geodetic_from_ned(pose[POSITION], origin)
        pose[DOWN] = origin[2] - place[2]
        from_origin = wgs84.turn_to_origin(place, origin).T
        pose[ATTITUDE] = wgs84.turned_attitude(pose[ATTITUDE], from_origin)
    if down is not None:
        pose[DOWN] = down
    if course is not None:
        pose[_YAW] = course
    return pose


def blocks(
    cells: Grid, pose: FloatArray, origin: tuple[float, float, float] | None
) -> Iterator[tuple[tuple[slice, slice], FloatArray]]:
    """Give parts of the grid, as an index, and the aircraft states (rows, columns, 6) in them."""
    rows, columns = cells.shape
    width = min(columns, BLOCK)
    height = max(1, BLOCK // width)
    for row in range(0, rows, height):
        for column in range(0, columns, width):
            block = slice(row, row + height), slice(column, column + width)
            north, east = cells.north[block[0]], cells.east[block[1]]
            states = np.empty((len(AIRCRAFT), len(north), len(east)))
            states[0], states[1] = north[:, np.newaxis], east
            states[2:] = pose[2:, np.newaxis, np.newaxis]
            aircraft: FloatArray = np.moveaxis(states, 0, -1)
            if origin is not None:
                _bend(aircraft, origin)
            yield block, aircraft


def _bend(aircraft: FloatArray, origin: tuple[float, float, float]) -> None:
    """Put states (..., 6) at one height above the ellipsoid and level where they are, in place.

    Newton's method on down: a metre down at the origin is the cosine of the angle between the two
    vertical lines in height.

    Raises:
        InputError: If a cell is so far from the origin that its line down passes the earth.
    """
    wanted = origin[2] - aircraft[..., DOWN]
    for _ in range(_ROUNDS):
        place = wgs84.geodetic_from_ned(aircraft[..., POSITION], origin)
        turn = wgs84.turn_to_origin(place, origin)
        wrong = place[..., 2] - wanted
        aircraft[..., DOWN] += wrong / np.maximum(turn[..., DOWN, DOWN], 0.05)
    if not np.all(abs(wrong) < 1e-2):
        raise InputError(
            "the map reaches too far from the origin, over the edge of the earth as the origin "
            "sees it; choose a smaller map, or a geometry.origin nearer to it"
        )
    aircraft[..., ATTITUDE] = wgs84.turned_attitude(aircraft[..., ATTITUDE], turn)
