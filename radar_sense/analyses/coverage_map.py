"""A map: P_D, or an upper bound of it, over an area, for the eye and for a planner.

The aircraft is put into every cell at one height and on one course, and the rest of the scenario is
as it is. Cells are computed some rows at a time, and only their results are kept.

Where the route is in latitude and longitude it is one height above the ellipsoid, and course and
attitude are those relative to the level of the cell. (At 500 km from the origin the surface is
20 km lower than there, so that cells at one "down" would be above all radars, or in the ground.)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from radar_sense.plotting import Figure

import dataclasses
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from radar_sense.analyses.contract import OPTIONS, Option, Progress, Result, analysis, silent
from radar_sense.covariance import variance_along
from radar_sense.errors import ScenarioError
from radar_sense.limits import MAP_KM, MAP_STEP_KM, Limit
from radar_sense.model import geodesy as wgs84
from radar_sense.model.detection_model import Model
from radar_sense.model.geometry import body_vector
from radar_sense.model.rcs_table import TableRCS
from radar_sense.propagation import check_method, upper_by_form
from radar_sense.scenario import Scenario
from radar_sense.standardized import standardize
from radar_sense.states import AIRCRAFT, ATTITUDE, POSITION, RADAR, FloatArray

#: Most cells of a map; in single precision 100 MB.
MAX_CELLS = 25_000_000
#: Cells on the longer side if nothing is said of their size.
CELLS = 500
#: Cells computed at a time.
BLOCK = 65_536
#: Levels of P_D that are drawn as lines and whose areas are given.
LEVELS = (0.1, 0.5, 0.9)
#: k of the upper bound.
BETA = 3.0
_DOWN = 2
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
        ScenarioError: If there is nothing between the ends, a number is out of range or there are
            too many cells.
    """
    radars = scenario.radar.reshape(-1, len(RADAR))[:, :_DOWN]
    centre = radars.mean(axis=0)
    everything = np.vstack([scenario.aircraft[:, :_DOWN], radars])
    reach = 1.2 * max(float(np.max(abs(everything - centre))), 1e3)
    ends = []
    for axis, (name, given) in enumerate((("north", north_km), ("east", east_km))):
        if given is None:
            ends.append((float(centre[axis]) - reach, float(centre[axis]) + reach))
            continue
        for end in given:
            if not MAP_KM.allows(end):
                raise ScenarioError(f"{name} must be {MAP_KM} of km, got {end:g}")
        if not given[0] < given[1]:
            raise ScenarioError(
                f"{name} must go from a lesser to a greater number of km, "
                f"got {given[0]:g} to {given[1]:g}"
            )
        ends.append((given[0] * 1e3, given[1] * 1e3))
    longest = max(stop - start for start, stop in ends)
    step = longest / CELLS if step_km is None else step_km * 1e3
    if not MAP_STEP_KM.allows(step / 1e3):
        raise ScenarioError(f"the step must be {MAP_STEP_KM} of km, got {step / 1e3:g}")
    counts = [math.floor((stop - start) / step * (1 + 1e-12) + 1e-9) + 1 for start, stop in ends]
    if math.prod(counts) > MAX_CELLS:
        raise ScenarioError(
            f"a step of {step / 1e3:g} km makes {math.prod(counts):,} cells, "
            f"allowed are {MAX_CELLS:,}"
        )
    if min(counts) < 2:
        raise ScenarioError(
            f"a step of {step / 1e3:g} km is longer than a side of the map; at least two cells "
            "must fit on each"
        )
    north, east = (
        np.asarray(start + step * np.arange(count), dtype=float)
        for (start, _), count in zip(ends, counts, strict=True)
    )
    return Grid(north, east)


def area(
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
        ScenarioError: If there is no such method.
    """
    if method is not None:
        check_method(method)
    pose = _pose(scenario, down, course)
    cov_aircraft = scenario.cov_aircraft.reshape(-1, len(AIRCRAFT), len(AIRCRAFT))[0]
    cov_radar = scenario.cov_radar[scenario.level]
    rows, columns = cells.shape
    p_d = np.empty((rows, columns), dtype=np.float32)
    bound = None if method is None else np.empty((rows, columns), dtype=np.float32)
    for block, aircraft in _blocks(cells, pose, scenario.origin):
        p_d[block] = scenario.model.p_d(aircraft, scenario.radar)
        if bound is not None and method is not None:
            bound[block] = upper_bound(
                scenario.model,
                aircraft,
                scenario.radar,
                cov_aircraft,
                cov_radar,
                method=method,
                log_constant=scenario.log_constant,
            )
        if progress:
            progress(aircraft.shape[0] * aircraft.shape[1])
    return p_d, bound


def upper_bound(
    model: Model,
    aircraft: FloatArray,
    radar: FloatArray,
    cov_aircraft: FloatArray,
    cov_radar: FloatArray,
    *,
    method: str,
    beta: float = BETA,
    log_constant: ArrayLike = False,
) -> FloatArray:
    """Return `upper` of `propagate` without what else that finds.

    By `linear` and `probit` this takes a hundredth of the time, without the second order behind the
    warning; by `form`, which needs that, a quarter, and where it settles at this β alone there is a
    bound while `propagate` has none.

    Args:
        model: The detection model.
        aircraft: Nominal aircraft states (..., 6).
        radar: Nominal radar states (..., 4), or (..., 4m) of a network of m.
        cov_aircraft: C_aa (6, 6).
        cov_radar: C_rr (4, 4), or (4m, 4m).
        method: Name of the method.
        beta: β of the bound.
        log_constant: Whether ln c_r is Gaussian, of all radars or of each, as in `propagate`; the
            first order of `linear` and `probit` is the same.
    """
    if method == "linear":
        lin = model.linearize(aircraft, radar)
        return lin.p_d + beta * lin.std(cov_aircraft, cov_radar)
    if method == "probit":
        z, by_aircraft, by_radar = model.linearize_probit(aircraft, radar)
        variance = variance_along(by_aircraft, cov_aircraft) + variance_along(by_radar, cov_radar)
        return np.asarray(ndtr(z + beta * np.sqrt(variance)))
    shape, blocks = standardize(
        model, aircraft, radar, cov_aircraft, cov_radar, log_constant=log_constant
    )
    return np.concatenate([upper_by_form(z, beta) for z in blocks]).reshape(shape)


def plot(result: Result, figure: Figure) -> None:
    """Draw the figure."""
    from radar_sense.plotting import BAND, OUTLINE, WIDTH, draw_legend, draw_line

    table, scenario = result.table, result.scenario
    north, east = table["north_m"] / 1e3, table["east_m"] / 1e3
    bounded = "upper_3sigma" in table
    # A figure has room for no more cells than this; lines through more would take long.
    every = max(1, -(-max(len(north), len(east)) // 1000))
    north, east = north[::every], east[::every]
    values = table["upper_3sigma" if bounded else "p_d"][::every, ::every]
    half = 0.5 * (east[1] - east[0]), 0.5 * (north[1] - north[0])
    extent = (east[0] - half[0], east[-1] + half[0], north[0] - half[1], north[-1] + half[1])
    shape = (extent[3] - extent[2]) / (extent[1] - extent[0])

    figure.set_size_inches(WIDTH, min(8.0, 0.55 + 2.4 * shape))
    axes = figure.subplots()
    axes.grid(visible=False)
    # cividis is as light as it is high, so that it reads the same in grey
    image = axes.imshow(
        values, origin="lower", extent=extent, cmap="cividis", vmin=0, vmax=1, aspect="equal"
    )
    name = rf"Upper $3\,\sigma$ bound of $P_D$ ({scenario.level}, {result.method})"
    bar = figure.colorbar(
        image,
        ax=axes,
        label=name if bounded else r"Probability of detection $P_D$",
        extend="max" if np.nanmax(values, initial=0) > 1 else "neither",
        fraction=0.05,
        pad=0.03,
    )
    drawn = [v for v in LEVELS if np.nanmin(values, initial=1) < v < np.nanmax(values, initial=0)]
    if drawn:
        lines = axes.contour(
            east,
            north,
            values,
            drawn,
            colors=["white" if v < 0.6 else "black" for v in drawn],
            linestyles="-",
            linewidths=0.8,
        )
        if len(scenario.model.names) <= 3:  # else labels cover what they are about
            axes.clabel(lines, fmt="%g", fontsize=6.5)
        for v in drawn:
            bar.ax.axhline(v, color="white" if v < 0.6 else "black", lw=0.8)
    path_north, path_east = scenario.aircraft[:, 0] / 1e3, scenario.aircraft[:, 1] / 1e3
    draw_line(axes, path_east, path_north, (BAND[0], "--"), label="path")
    radars = scenario.radar.reshape(-1, len(RADAR)) / 1e3
    axes.plot(
        radars[:, 1],
        radars[:, 0],
        "^",
        color="white",
        mec="black",
        mew=0.7,
        ms=5.5,
        label="radar" if len(radars) == 1 else "radars",
    )
    for name, radar in zip(scenario.model.names, radars, strict=False):
        axes.annotate(
            name,
            (radar[1], radar[0]),
            xytext=(4.5, 0),
            textcoords="offset points",
            va="center",
            fontsize=6.5,
            color="white",
            path_effects=OUTLINE,
        )
    axes.set(xlim=extent[:2], ylim=extent[2:], xlabel="East [km]", ylabel="North [km]")
    draw_legend(figure, axes)
    # As the aspect is given, one round of layout can leave a label outside the page. (A map that is
    # flat has room for its labels, and would only get flatter.)
    if shape > 0.5:
        figure.draw_without_rendering()


_OPTIONS = (
    Option("upper", "Show the upper 3-sigma bound in place of P_D.", flag=True),
    dataclasses.replace(OPTIONS["method"], help=f"For --upper. {OPTIONS['method'].help}"),
    Option(
        "north_km",
        "South and north end.",
        MAP_KM,
        count=2,
        default_text="around radars and path",
    ),
    Option("east_km", "West and east end.", MAP_KM, count=2, default_text="around radars and path"),
    Option("step_km", "Distance of cells.", MAP_STEP_KM, default_text="1/500 of the longer side"),
    Option("down_km", "Down coordinate.", MAP_KM, default_text="that of the first pose"),
    Option(
        "course_deg",
        "Yaw of the aircraft.",
        Limit(at_least=-360, at_most=360),
        default_text="that of the first pose",
    ),
)


@analysis(
    plot=plot,
    options=["level", "radar", *_OPTIONS],
    examples=[
        "radar-sense map",
        "radar-sense map my.yaml --upper --method probit --step-km 5",
        "radar-sense map --north-km -400 400 --east-km 0 800 --course-deg 45",
        "radar-sense map network.yaml --radar ridge",
    ],
    name="map",
)
def coverage_map(
    scenario: Scenario,
    *,
    north_km: tuple[float, float] | None = None,
    east_km: tuple[float, float] | None = None,
    step_km: float | None = None,
    down_km: float | None = None,
    course_deg: float | None = None,
    upper: bool = False,
    method: str = "linear",
    progress: Progress = silent,
) -> Result:
    """P_D over an area at one height and course.

    The numbers are written as NPZ, for numpy.load, in single precision: north_m, east_m, p_d, and
    upper_3sigma with --upper.

    Args:
        scenario: The scenario.
        north_km: South and north end [km], as in `grid`.
        east_km: West and east end [km].
        step_km: Distance of the cells [km].
        down_km: Down coordinate [km]; the first pose's if None.
        course_deg: Yaw [deg]; the first pose's if None.
        upper: Whether to find the upper bound at Φ(3) too, and show that.
        method: Method that gives the bound.
        progress: Shows the cells that are done.

    Raises:
        InputError: If there is no such method, one is named and no bound is asked for, or the
            area is not allowed.
    """
    if method != "linear" and not upper:
        raise ScenarioError("a method is for the upper bound; ask for that with --upper")
    down = None if down_km is None else down_km * 1e3
    course = None if course_deg is None else math.radians(course_deg)
    cells = grid(scenario, north_km=north_km, east_km=east_km, step_km=step_km)
    with progress(math.prod(cells.shape), "cells") as advance:
        p_d, bound = area(
            scenario,
            cells,
            down=down,
            course=course,
            method=method if upper else None,
            progress=advance,
        )
    pose = _pose(scenario, down, course)
    shown = p_d if bound is None else bound
    size = (cells.north[1] - cells.north[0]) * (cells.east[1] - cells.east[0]) / 1e6
    whole = size * shown.size
    areas = {f"{level:g}": size * int(np.count_nonzero(shown >= level)) for level in LEVELS}
    what = "P_D" if bound is None else f"upper 3-sigma bound of P_D ({scenario.level}, {method})"
    rows, columns = cells.shape
    summary: dict[str, Any] = {
        "north_km": [float(cells.north[0]) / 1e3, float(cells.north[-1]) / 1e3],
        "east_km": [float(cells.east[0]) / 1e3, float(cells.east[-1]) / 1e3],
        "cells": [rows, columns],
        "down_km": float(pose[_DOWN]) / 1e3,
        "attitude_deg": np.rad2deg(pose[ATTITUDE]).tolist(),
        "shown": "p_d" if bound is None else "upper_3sigma",
        "area_km2": whole,
        "area_km2_at_or_above": areas,
    }
    table: dict[str, Any] = {"north_m": cells.north, "east_m": cells.east, "p_d": p_d}
    if bound is not None:
        table["upper_3sigma"] = bound
    return Result(
        scenario=scenario,
        method=method,
        table=table,
        summary=summary,
        report=(
            f"{what} in {rows} x {columns} cells, {-summary['down_km']:g} km above the origin, "
            f"heading {summary['attitude_deg'][2]:g} deg",
            *(
                f"  {level} or more in {100 * found / whole:.1f} % of the area, {found:.4g} km^2"
                for level, found in areas.items()
            ),
        ),
        warnings=_doubts(scenario, cells, pose, shown, method),
    )


def _pose(scenario: Scenario, down: float | None, course: float | None) -> FloatArray:
    """State (6,) of the aircraft in every cell; its north and east have no meaning.

    With an origin down is minus the height above that of the origin, and attitude is relative to
    the level of the place.
    """
    pose: FloatArray = scenario.aircraft[0].copy()
    origin = scenario.origin
    if origin is not None:
        place = wgs84.geodetic_from_ned(pose[POSITION], origin)
        pose[_DOWN] = origin[2] - place[2]
        from_origin = wgs84.turn_to_origin(place, origin).T
        pose[ATTITUDE] = wgs84.turned_attitude(pose[ATTITUDE], from_origin)
    if down is not None:
        pose[_DOWN] = down
    if course is not None:
        pose[_YAW] = course
    return pose


def _blocks(
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
        ScenarioError: If a cell is so far from the origin that its line down passes the earth.
    """
    wanted = origin[2] - aircraft[..., _DOWN]
    for _ in range(_ROUNDS):
        place = wgs84.geodetic_from_ned(aircraft[..., POSITION], origin)
        turn = wgs84.turn_to_origin(place, origin)
        wrong = place[..., 2] - wanted
        aircraft[..., _DOWN] += wrong / np.maximum(turn[..., _DOWN, _DOWN], 0.05)
    if not np.all(abs(wrong) < 1e-2):
        raise ScenarioError(
            "the map reaches too far from the origin, over the edge of the earth as the origin "
            "sees it; choose a smaller map, or a geometry.origin nearer to it"
        )
    aircraft[..., ATTITUDE] = wgs84.turned_attitude(aircraft[..., ATTITUDE], turn)


def _doubts(
    scenario: Scenario, cells: Grid, pose: FloatArray, shown: NDArray[np.float32], method: str
) -> tuple[str, ...]:
    said = []
    unknown = int(np.count_nonzero(np.isnan(shown)))
    if unknown:
        said.append(f"nothing is known in {unknown:,} of {shown.size:,} cells (NaN in the file)")
    beyond = int(np.count_nonzero(shown > 1))
    if beyond:
        said.append(f"the {method} bound passes 1 in {beyond:,} of {shown.size:,} cells")
    rcs = scenario.model.rcs
    if isinstance(rcs, TableRCS) and rcs.elevation is not None:
        outside = 0
        for _, aircraft in _blocks(cells, pose, scenario.origin):
            outside += int(
                max(
                    np.count_nonzero(rcs.uncovered(body_vector(aircraft, radar)))
                    for radar in scenario.radar.reshape(-1, len(RADAR))
                )
            )
        if outside:
            said.append(
                f"in {outside:,} of {shown.size:,} cells the aircraft sees a radar beyond the "
                "elevations of the RCS table; there its outermost values are used"
            )
    return tuple(said)
