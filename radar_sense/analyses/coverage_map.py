"""A map: P_D, or an upper bound of it, over an area, for the eye and for a planner."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from radar_sense.plotting import Figure

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_sense.analyses.contract import OPTIONS, Option, Progress, Result, analysis, silent
from radar_sense.analyses.grid import DOWN, Grid, blocks, grid, p_d_in_cells, pose_in_cells
from radar_sense.errors import InputError
from radar_sense.limits import MAP_KM, MAP_STEP_KM, Limit
from radar_sense.model.geometry import body_vector
from radar_sense.model.rcs_table import TableRCS
from radar_sense.scenario import Scenario
from radar_sense.states import ATTITUDE, RADAR, FloatArray

#: Levels of P_D that are drawn as lines and whose areas are given.
LEVELS = (0.1, 0.5, 0.9)


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
        raise InputError("a method is for the upper bound; ask for that with --upper")
    down = None if down_km is None else down_km * 1e3
    course = None if course_deg is None else math.radians(course_deg)
    cells = grid(scenario, north_km=north_km, east_km=east_km, step_km=step_km)
    with progress(math.prod(cells.shape), "cells") as advance:
        p_d, bound = p_d_in_cells(
            scenario,
            cells,
            down=down,
            course=course,
            method=method if upper else None,
            progress=advance,
        )
    pose = pose_in_cells(scenario, down, course)
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
        "down_km": float(pose[DOWN]) / 1e3,
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
        for _, aircraft in blocks(cells, pose, scenario.origin):
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
