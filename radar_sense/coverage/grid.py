"""The cells of a map, and P_D and a bound of it in each cell.

The aircraft is at the centre of every cell, at one height and on one course. Everything else is as
in the scenario. Cells are computed in blocks of rows, to save memory.

For a route in latitude and longitude the height is the height above the ellipsoid. Course and
attitude are relative to the horizontal plane of the cell. One "down" in all cells would be wrong,
because the surface is 20 km lower at 500 km from the origin.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from radar_sense.cost import FIRST_ORDER, OTHER, foresee
from radar_sense.errors import InputError, counted
from radar_sense.limits import MAP_STEP_KM
from radar_sense.model import geodesy
from radar_sense.model.geometry import join
from radar_sense.model.radar import ALWAYS, NEVER, PERHAPS
from radar_sense.montecarlo.parallel import in_order
from radar_sense.progress import report
from radar_sense.propagation import AUTOMATIC, METHODS
from radar_sense.propagation.automatic import least_off
from radar_sense.scenario import Scenario
from radar_sense.search import golden_section
from radar_sense.states import AIRCRAFT, ATTITUDE, DOWN, POSITION, YAW, FloatArray, blocks, slices

#: Largest number of cells of a map, which take 100 MB in single precision.
MAX_CELLS = 25_000_000
#: Default number of cells on the longer side.
CELLS = 500
#: Cells on a side in which a contour is looked for.
_ON_A_SIDE = 61
#: Headings in the narrowest lobe of the RCS, of a level aircraft. The nearest is at most a twelfth
#: of the lobe away from the peak: 3.4 % below the peak of a half sine. Beside a single high node of
#: a table, it is below the node by 1.5 % of the decibels from the neighbours to the node.
PER_LOBE = 6
#: How far a maximum may be above the highest of three samples, in their second difference. A
#: parabola rises by an eighth at most, lobes of several radars together by more.
RISE = 0.5
#: Part of the tail of a bound. A limit that only rarer errors reach is left out: at 3σ one that is
#: beyond 4.04σ. Without it a limit at 3.1σ would use up most of the tail unseen.
SPARED = 0.02
#: Maxima of z that differ by less than this are equal but for rounding. The heading is that of the
#: first of them.
ALIKE = 1e-9
#: Steps of the golden section, which shrink the bracket to 1 in 16,000.
_SECTIONS = 20

#: A quantity in all cells (rows, columns).
Plane: TypeAlias = NDArray[np.float32]
#: Some cells of a block, by their numbers.
Rows: TypeAlias = NDArray[np.intp] | slice
#: Newton's steps to find the down of a height; the error is 1 mm or less up to 6000 km away.
_ROUNDS = 8
#: Error of a height at which Newton's method ends [m]; rounding is 1e-9 m.
_HEIGHT_ERROR = 1e-6


@dataclass(frozen=True, eq=False)
class Grid:
    """A rectangle of cells, with the aircraft in each of them.

    Attributes:
        scenario: The scenario, whose first pose gives the covariance of the aircraft.
        pose: Aircraft state (6,) in every cell, see `pose_in_cells`.
        north: North coordinates of the cells' centres (rows,) [m], increasing.
        east: East coordinates (columns,) [m], increasing.
    """

    scenario: Scenario
    pose: FloatArray
    north: FloatArray
    east: FloatArray

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.north), len(self.east)

    def states(self, rows: slice = slice(None), columns: slice = slice(None)) -> FloatArray:
        """Return the aircraft states (rows, columns, 6) in a block of the cells."""
        return self.states_at(self.north[rows, np.newaxis], self.east[columns])

    def states_at(self, north: FloatArray, east: FloatArray) -> FloatArray:
        """Return the aircraft states (..., 6) at any north and east (...) [m]."""
        aircraft = join(np.broadcast_arrays(north, east, *self.pose[2:]))
        if self.scenario.origin is not None:
            put_at_height(aircraft, self.scenario.origin)
        return aircraft


def grid(
    scenario: Scenario,
    *,
    down: float | None = None,
    course: float | None = None,
    north_km: tuple[float, float] | None = None,
    east_km: tuple[float, float] | None = None,
    step_km: float | None = None,
    leaves: Callable[[Grid], bool] = lambda border: False,
) -> Grid:
    """Make the cells of a map.

    Args:
        scenario: The scenario.
        down: Down of the aircraft [m], see `pose_in_cells`.
        course: Yaw of the aircraft [rad], likewise.
        north_km: South and north end [km], which the cells reach. None takes the centre of the
            radars plus and minus 1.2 times the largest distance of radars and path from the centre,
            and more until no contour leaves the map, up to nine times that.
        east_km: West and east end [km]. None is as for `north_km`.
        step_km: Distance of the cells [km]. None takes a 500th of the longer side.
        leaves: Whether a contour goes through some cells, which are two sides of the map.
    """
    cells = partial(Grid, scenario, pose_in_cells(scenario, down, course))
    radars = scenario.radar_states[:, :DOWN]
    centre = radars.mean(axis=0)
    positions = np.vstack([scenario.aircraft[:, :DOWN], radars])
    reach = 1.2 * max(float(np.max(abs(positions - centre))), 1e3)
    if north_km is None and east_km is None:
        reach = _reach(centre, reach, lambda north, east: leaves(cells(north, east)))
    ends = []
    for axis, (name, side) in enumerate((("north", north_km), ("east", east_km))):
        if side is None:
            ends.append((float(centre[axis]) - reach, float(centre[axis]) + reach))
            continue
        if not side[0] < side[1]:
            raise InputError(
                f"'{name}_km' must go from a lesser to a greater number of km, "
                f"got {side[0]:g} to {side[1]:g}"
            )
        ends.append((side[0] * 1e3, side[1] * 1e3))
    longest = max(stop - start for start, stop in ends)
    step = longest / CELLS if step_km is None else step_km * 1e3
    if not MAP_STEP_KM.allows(step / 1e3):
        raise InputError(f"the step must be {MAP_STEP_KM} of km, got {step / 1e3:g}")
    steps = [(stop - start) / step for start, stop in ends]
    if min(steps) < 1.0 - 1e-9:
        raise InputError(
            f"a step of {step / 1e3:g} km is longer than a side of the map; each side needs at "
            "least two cells"
        )
    # the last cells are at the ends or beyond, where the step does not lead to the ends
    counts = [math.ceil(number * (1.0 - 1e-12) - 1e-9) + 1 for number in steps]
    if math.prod(counts) > MAX_CELLS:
        raise InputError(
            f"a step of {step / 1e3:g} km makes {math.prod(counts):,} cells, "
            f"allowed are {MAX_CELLS:,}"
        )
    north, east = (
        np.asarray(start + step * np.arange(count), dtype=float)
        for (start, _), count in zip(ends, counts, strict=True)
    )
    return cells(north, east)


def _reach(
    centre: FloatArray, least: float, leaves: Callable[[FloatArray, FloatArray], bool]
) -> float:
    """Return the distance of the sides from the centre (2,) beyond which no contour goes.

    Where P_D is high at any distance, and where the route would be a dot, it is `least`.
    """
    reaches, inside = least * 1.2 ** np.arange(13), 0  # up to nine times
    for number, reach in enumerate(reaches, start=1):
        north, east = (np.linspace(c - reach, c + reach, _ON_A_SIDE) for c in centre)
        try:
            # a contour may be beyond a blind zone, so that clear sides are not the end
            if leaves(north[[0, -1]], east) or leaves(north, east[[0, -1]]):
                inside = number
        except InputError:  # beyond the edge of the earth
            reaches = reaches[: number - 1]
            break
    return float(reaches[inside]) if inside < len(reaches) else least


def p_d_in_cells(
    cells: Grid, *, method: str | None = None, beta: float = 3.0, workers: int = 1
) -> list[Plane]:
    """Return P_D in each cell, and its bound at Φ(β) if a method of propagation is given.

    Both are NaN where the aircraft is at a radar, the bound also where the method does not
    converge.
    """
    scenario = cells.scenario

    def planes(aircraft: FloatArray) -> tuple[FloatArray, ...]:
        p_d = scenario.model.p_d(aircraft, scenario.radar)
        if method is None:
            return (p_d,)
        return p_d, bound(scenario.at_states(aircraft), method, beta).reshape(p_d.shape)

    at_cell = FIRST_ORDER.get(method, OTHER) if method else 1.0
    _foresee(cells, at_cell, workers)
    return _in_cells(cells, planes, workers)


def bound(scenario: Scenario, method: str, beta: float) -> FloatArray:
    """Return the bound of P_D (n,) at Φ(β) by a method, with limits that may be crossed.

    A method leaves out that an error may take the aircraft across a limit of a radar. Where errors
    of the positions may do so, see `SPARED`, the radar has no limits in an upper bound, and does
    not see the aircraft in a lower one. By `form` the band is too wide there. By `linear` and
    `probit` it may be too narrow: a further radar raises P_D and lowers σ.

    A bound by `form` on the other side of P_D is by draws. It may be right, in a null of the RCS,
    or the curvature of P_D may be too large for FORM.
    """
    states = scenario.states()
    found, side = np.zeros(len(states)), np.sign(beta)
    sight = states.sight(-float(ndtri(SPARED * ndtr(-abs(beta)))))
    sight[sight == PERHAPS] = ALWAYS if beta > 0 else NEVER
    for rows, part in states.by_sight(sight):
        by_method = METHODS[method](part)
        bounds, p_d = by_method.quantile(beta), by_method.p_d
        beyond = np.flatnonzero(side * (p_d - bounds) > least_off(p_d))
        if len(beyond):
            bounds[beyond] = METHODS[AUTOMATIC](part.at(beyond)).quantile(beta)
        found[rows] = bounds
    return found


def worst_p_d_in_cells(cells: Grid, *, workers: int = 1) -> list[Plane]:
    """Return the largest P_D over all headings in each cell, and its heading [deg].

    Every lobe of the RCS has `PER_LOBE` sampled headings, and maxima are searched beside them.
    """
    scenario = cells.scenario
    detail = min(model.rcs.detail for model in scenario.model.models)
    count = math.ceil(2.0 * np.pi * PER_LOBE / detail) or 1
    _foresee(cells, count + _SECTIONS, workers)

    def planes(aircraft: FloatArray) -> tuple[FloatArray, ...]:
        shape, aircraft, turn = aircraft.shape[:-1], aircraft.reshape(-1, len(AIRCRAFT)), None
        if scenario.origin is not None:
            turn = geodesy.turn_from_level(aircraft[:, POSITION], scenario.origin)

        def z_at(rows: Rows, heading: FloatArray | float) -> FloatArray:
            states = aircraft[rows]
            states[:, ATTITUDE] = cells.pose[ATTITUDE]
            states[:, YAW] = heading
            if turn is not None:
                states[:, ATTITUDE] = geodesy.turned_attitude(states[:, ATTITUDE], turn[rows])
            return ndtri(scenario.model.p_d(states, scenario.radar))

        z, heading = _highest(z_at, count)
        degrees = np.rad2deg(np.mod(heading, 2.0 * np.pi))
        return ndtr(z).reshape(shape), degrees.reshape(shape)

    return _in_cells(cells, planes, workers)


def _highest(
    z_at: Callable[[Rows, FloatArray | float], FloatArray], count: int
) -> tuple[FloatArray, FloatArray]:
    """Return the largest z = Φ⁻¹(P_D) of cells (n,) over all headings, and its heading (n,) [rad].

    Of a number of sampled headings, those with a larger z than their two neighbours may be beside
    the largest z of all. Several may be, because lobes can have nearly the same height. The second
    difference of the three samples says which, see `RISE`, and a golden section finds the maximum
    there.

    Args:
        z_at: From rows (k,) of cells and their headings [rad] to z (k,).
        count: Number of sampled headings.
    """
    every, step = slice(None), 2.0 * np.pi / count
    here = z_at(every, 0.0)
    best, at = here.copy(), np.zeros(len(here))
    if count == 1:  # an RCS that is the same at all aspects
        return best, at
    before = z_at(every, -step)
    promising: list[tuple[NDArray[np.intp], FloatArray, FloatArray]] = []
    for sampled in step * np.arange(count):
        after = z_at(every, sampled + step)
        better = here > best
        best[better], at[better] = here[better], sampled
        with np.errstate(invalid="ignore"):
            most = here + RISE * (2.0 * here - before - after)
            rows = np.flatnonzero((here >= before) & (here > after) & (most >= best))
        promising.append((rows, np.full(len(rows), sampled), most[rows]))
        before, here = here, after
    rows, heading, most = map(np.concatenate, zip(*promising, strict=True))
    still = most >= best[rows]
    rows, heading = rows[still], heading[still]
    found, argument = np.empty((2, len(rows)))
    for part in slices(len(rows)):
        sides = heading[part] - step, heading[part] + step
        z_of_rows = partial(z_at, rows[part])
        found[part], argument[part] = golden_section(z_of_rows, *sides, _SECTIONS)
    np.maximum.at(best, rows, found)
    largest = np.flatnonzero(found > best[rows] - ALIKE)[::-1]  # the first is put last
    at[rows[largest]] = argument[largest]
    return best, at


def _foresee(cells: Grid, evaluations: float, workers: int) -> None:
    """Say what a map takes, from the evaluations of P_D of one radar in a cell."""
    rows, columns = cells.shape
    radars = len(cells.scenario.model.radars)
    foresee(
        f"{rows:,} x {columns:,} cells of {counted(radars, 'radar')}",
        rows * columns * radars * evaluations,
        less="cells of a longer --step-km",
        workers=workers,
    )


def _in_cells(
    cells: Grid, planes: Callable[[FloatArray], tuple[FloatArray, ...]], workers: int
) -> list[Plane]:
    """Return planes (rows, columns), computed from the states (..., 6) of each block."""
    parts_of_grid = list(blocks(cells.shape))

    def compute_block(index: int) -> tuple[FloatArray, ...]:
        return planes(cells.states(*parts_of_grid[index]))

    filled: list[Plane] = []
    done, total = 0, math.prod(cells.shape)
    report("cells", done, total)
    results = in_order(compute_block, len(parts_of_grid), workers)
    for block, parts in zip(parts_of_grid, results, strict=True):
        filled = filled or [np.empty(cells.shape, dtype=np.float32) for _ in parts]
        for plane, part in zip(filled, parts, strict=True):
            plane[block] = part
        done += parts[0].size
        report("cells", done, total)
    return filled


def pose_in_cells(scenario: Scenario, down: float | None, course: float | None) -> FloatArray:
    """Return the aircraft state (6,) in every cell; north and east have no meaning.

    It is the first pose, but for `down` [m] and course [rad] if these are given. With an origin,
    down is minus the height above the origin. The attitude is relative to the horizontal plane of
    the cell.
    """
    pose = scenario.aircraft[0].copy()
    origin = scenario.origin
    if origin is not None:
        place = geodesy.geodetic_from_ned(pose[POSITION], origin)
        pose[DOWN] = origin[2] - place[2]
        from_origin = geodesy.turn_to_origin(place, origin).T
        pose[ATTITUDE] = geodesy.turned_attitude(pose[ATTITUDE], from_origin)
    if down is not None:
        pose[DOWN] = down
    if course is not None:
        pose[YAW] = course
    return pose


def put_at_height(
    aircraft: FloatArray,
    origin: tuple[float, float, float],
    aspect: FloatArray | None = None,
) -> None:
    """Change states (..., 6) in place to one height above the ellipsoid and local attitudes.

    Newton's method finds the down coordinate. The derivative of height by down is minus the cosine
    of the angle between the vertical lines of cell and origin. An azimuth (...) [rad] of the origin
    from the nose, in the level plane at the aircraft, takes the place of the yaw of the states.
    """
    height = origin[2] - aircraft[..., DOWN]
    for _ in range(_ROUNDS):
        place = geodesy.geodetic_from_ned(aircraft[..., POSITION], origin)
        turn = geodesy.turn_to_origin(place, origin)
        error = place[..., 2] - height
        if np.all(abs(error) < _HEIGHT_ERROR):
            break
        aircraft[..., DOWN] += error / np.maximum(turn[..., DOWN, DOWN], 0.05)
    if not np.all(abs(error) < 1e-2):
        raise InputError(
            "a pose is too far from the origin, beyond the edge of the earth in the local frame; "
            "choose a smaller map, or a geometry.origin nearer to the map"
        )
    if aspect is not None:
        line = np.einsum("...ij,...i->...j", turn, -aircraft[..., POSITION])
        aircraft[..., YAW] = np.arctan2(line[..., 1], line[..., 0]) - aspect
    aircraft[..., ATTITUDE] = geodesy.turned_attitude(aircraft[..., ATTITUDE], turn)
