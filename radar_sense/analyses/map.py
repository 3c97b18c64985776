"""P_D over an area at one height and course."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from radar_sense import options, plotting
from radar_sense.analyses.map_export import geojson
from radar_sense.command import Figure, Option, Result, command
from radar_sense.coverage.grid import Grid, Plane, bound, grid, p_d_in_cells, worst_p_d_in_cells
from radar_sense.errors import InputError
from radar_sense.limits import FORMATS, MAP_KM, MAP_STEP_KM, PROBABILITY
from radar_sense.model.geodesy import geodetic_from_ned, turn_to_origin
from radar_sense.model.geometry import body_vector
from radar_sense.model.rcs_table import TableRCS
from radar_sense.plausibility import height_of_option
from radar_sense.propagation import AUTOMATIC, band_of_scenario, no_draws
from radar_sense.propagation.automatic import ERRORS, least_off
from radar_sense.scenario import Scenario
from radar_sense.states import ATTITUDE, DOWN, POSITION, FloatArray, blocks
from radar_sense.words import REMEDY, heading, placed, probability, warning

#: Levels of P_D with contour lines, and with areas in the report.
LEVELS = (0.1, 0.5, 0.9)
#: Most rows and columns of the cells at which the method is checked.
SAMPLED = 20
#: Height over width below which the scale of a map is below it, and not beside it.
FLAT = 0.4
#: Letters of all names of radars, in an inch of a figure with letters of 8 pt, up to which the
#: names are on the map. More have numbers there.
LETTERS = 18
#: Letters of the title in an inch.
IN_TITLE = 15
#: The default of the ends of the map.
AROUND = "around radars and path"
#: The bounds that a map can show, as options.
ENDS = ("upper", "lower")


@command(
    replace(options.LEVEL, needs=ENDS),
    options.ONE_RADAR,
    Option("upper", "Show the upper bound in place of P_D.", flag=True),
    Option("lower", "Show the lower bound in place of P_D.", flag=True, excludes=("upper",)),
    replace(options.K, needs=ENDS),
    replace(
        options.METHOD_BUT_DRAWS,
        help=f"{options.METHOD_BUT_DRAWS.help} automatic is form, checked in some cells.",
        needs=ENDS,
    ),
    Option(
        "north_km",
        "South and north end, reached or passed.",
        MAP_KM,
        "KM",
        count=2,
        default_text=AROUND,
    ),
    Option(
        "east_km",
        "West and east end, reached or passed.",
        MAP_KM,
        "KM",
        count=2,
        default_text=AROUND,
    ),
    Option(
        "step_km", "Distance of cells.", MAP_STEP_KM, "KM", default_text="1/500 of the longer side"
    ),
    options.DOWN_KM,
    options.COURSE_DEG,
    Option(
        "p_d",
        "P_D of a contour line; may be given several times.",
        PROBABILITY,
        default_text="0.1, 0.5 and 0.9",
        multiple=True,
    ),
    Option(
        "worst_heading",
        "Show the largest P_D over all headings.",
        flag=True,
        excludes=(*ENDS, "course_deg"),
    ),
    options.WORKER_THREADS,
    examples=(
        "radar-sense map",
        "radar-sense map my.yaml --upper --method probit --step-km 5",
        "radar-sense map network.yaml --lower --p-d 0.9",
        "radar-sense map --north-km -400 400 --east-km 0 800 --course-deg 45",
        "radar-sense map my.yaml --worst-heading --step-km 10",
        "radar-sense map network.yaml --radar ridge",
    ),
    formats=(*FORMATS, "geojson"),
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
    p_d: Sequence[float] = LEVELS,
    upper: bool = False,
    lower: bool = False,
    k: float | None = None,
    worst_heading: bool = False,
    workers: int = 1,
) -> Result:
    """P_D over an area at one height and course.

    The table is an NPZ file for numpy.load, with north_m, east_m, and p_d in single precision.
    A bound adds the column upper_3sigma or lower_3sigma, or upper_2sigma for a K of 2. The worst
    heading adds worst_heading_deg. An origin adds latitude_deg and longitude_deg. The figure shows
    the route in the same colours, by P_D at the attitude of each pose. With an origin the map can
    be GeoJSON too: the contours of P_D and of the bound, the radars, and the route with P_D of each
    leg.
    """
    no_draws(scenario.method)
    # draws would take too long in every cell: they check some of the cells
    scenario = scenario.with_analysis(method="form" if scenario.method == AUTOMATIC else None)
    method = scenario.method
    if not len(p_d):
        raise InputError("'p_d' must have the P_D of one contour line or more")
    k, contours, result = k or 3.0, sorted(set(p_d)), Result(scenario)
    end = "upper" if upper else "lower" if lower else ""
    add, column = result.table.add, f"{end}_{k:.12g}sigma" if end else "p_d"
    beta = -k if lower else k

    def planes(cells: Grid) -> dict[str, Plane]:
        if worst_heading:
            largest, heading = worst_p_d_in_cells(cells, workers=workers)
            return {"p_d": largest, "worst_heading_deg": heading}
        bounding = method if end else None
        found = p_d_in_cells(cells, method=bounding, beta=beta, workers=workers)
        return dict(zip(("p_d", column), found, strict=False))

    cells = grid(
        scenario,
        down=None if down_km is None else down_km * 1e3,
        course=None if course_deg is None else math.radians(course_deg),
        north_km=north_km,
        east_km=east_km,
        step_km=step_km,
        leaves=lambda border: bool(np.any(planes(border)[column] >= contours[0])),
    )
    found = planes(cells)
    shown = found[column]
    add("north_m", cells.north, "North of the rows of cells, from the origin.", "m")
    add("east_m", cells.east, "East of the columns of cells, from the origin.", "m")
    add("p_d", found["p_d"], "P_D in each cell (rows, columns).")
    if worst_heading:
        meaning = "With --worst-heading: the heading of the largest P_D."
        add("worst_heading_deg", found["worst_heading_deg"], meaning, "°")
    if end:
        add(column, shown, f"With --{end}: {end} {k:g}-sigma bound of P_D in each cell.")
    area = np.diff(cells.north)[0] * np.diff(cells.east)[0] / 1e6
    cell_km2 = np.broadcast_to(area, cells.shape)
    if scenario.origin is not None:
        places, cos_tilt = _on_earth(cells, scenario.origin)
        for name, degrees in places.items():
            meaning = f"With an origin: WGS-84 {name} of each cell (rows, columns)."
            add(f"{name}_deg", degrees, meaning, "°")
        cell_km2 = cell_km2 / cos_tilt

    area_km2 = float(np.sum(cell_km2))
    levels = np.array(contours)  # in double precision, as P_D is not
    # without the cells that have no value, and with them
    spans = [[float(np.sum(cell_km2[m])) for m in (shown >= v, ~(shown < v))] for v in levels]
    areas = {f"{v:.12g}": span[0 if lower else 1] for v, span in zip(contours, spans, strict=True)}
    route = scenario.p_d()
    if end:  # a route has few poses, and errors of its own
        route = getattr(band_of_scenario(scenario, method=AUTOMATIC, beta=k), end)
    result.summary |= {
        "north_km": [float(cells.north[0]) / 1e3, float(cells.north[-1]) / 1e3],
        "east_km": [float(cells.east[0]) / 1e3, float(cells.east[-1]) / 1e3],
        "cells": list(cells.shape),
        "down_km": float(cells.pose[DOWN]) / 1e3,
        "attitude_deg": np.rad2deg(cells.pose[ATTITUDE]).tolist(),
        "worst_heading": worst_heading,
        "shown": column,
        **({"end": end, "k": k} if end else {}),
        "area_km2": area_km2,
        "contours": contours,
        "area_km2_at_or_above": areas,
        "route": [float(np.fmin.reduce(route)), float(np.fmax.reduce(route))],
    }
    off = _off_by_draws(cells, method, beta, end) if end else {}
    unknown = _unknown(cells, shown)
    most = {"high": "at most ", "low": "at least "}.get(" and ".join(off), "")  # none if both
    quantity = f"{end} {k:g}-sigma bound of P_D ({scenario.level}, {method})" if end else "P_D"
    place = _pose_in_words(result.summary)
    result.report += [f"{quantity} in {cells.shape[0]} x {cells.shape[1]} cells, {place}:"]
    for level, span in zip(contours, spans, strict=True):
        share = " to ".join(dict.fromkeys(f"{100 * km2 / area_km2:.1f}" for km2 in span))
        size = " to ".join(dict.fromkeys(f"{float(f'{km2:.4g}'):,.10g}" for km2 in span))
        result.report.append(f"  {level:.12g} or more in {most}{share} % of the area, {size} km^2")
    ends = " to ".join(map(probability, result.summary["route"]))
    by = ", by automatic" if end else ""
    result.report += [f"along the route, at the attitude of each pose, {ends}{by}"]
    result.warnings += height_of_option(scenario, down_km)
    result.warnings += _warnings(cells, shown, method, unknown)
    without = "at the route, the bound has no value" if end else "at the route, P_D has no value"
    result.warnings += placed("no-value", np.isnan(route), scenario.axis, without)
    if off:
        remedy = "use variance at poses there" if method == "form" else REMEDY
        text = f"the {method} bound is off in some of the cells that were checked"
        by = f"{' and '.join(off.values())}, in others perhaps by more"
        result.warnings.append(warning("band-off", f"{text}: {by}; {remedy}"))
    result.exports = {"geojson": partial(geojson, cells=cells, route=route)}
    result.draw = partial(_draw, result=result, route=route, unknown=unknown)
    return result


def _on_earth(
    cells: Grid, origin: tuple[float, float, float]
) -> tuple[dict[str, FloatArray], FloatArray]:
    """Return latitude and longitude [deg] of the cells, and the cosine of their tilt.

    Each is (rows, columns). The tilt is the angle from level at the origin to level at the cell.
    """
    places, cos_tilt = np.empty((*cells.shape, 2)), np.empty(cells.shape)
    for block in blocks(cells.shape):
        place = geodetic_from_ned(cells.states(*block)[..., POSITION], origin)
        places[block] = np.rad2deg(place[..., :2])
        cos_tilt[block] = turn_to_origin(place, origin)[..., 2, 2]
    return {"latitude": places[..., 0], "longitude": places[..., 1]}, cos_tilt


def _unknown(cells: Grid, shown: Plane) -> int:
    """Return how many cells have no value, without those straight above a radar.

    The aspect has no gradient there.
    """
    unknown, axes = np.isnan(shown), (cells.north, cells.east)
    for state in cells.scenario.radar_states:
        rows, columns = (
            abs(centres - place) <= 0.5 * (centres[1] - centres[0])
            for centres, place in zip(axes, state[:DOWN], strict=True)
        )
        unknown[np.ix_(rows, columns)] = False
    return int(np.count_nonzero(unknown))


def _warnings(cells: Grid, shown: Plane, method: str, unknown: int) -> Iterator[str]:
    scenario, of_all = cells.scenario, f"of {shown.size:,} cells"
    if unknown:
        yield warning("cells-unknown", f"no number in {unknown:,} {of_all} (NaN in the file)")
    if beyond := int(np.count_nonzero((shown < 0) | (shown > 1))):
        yield warning("band-outside", f"the {method} bound leaves [0, 1] in {beyond:,} {of_all}")
    tables = [
        (model.rcs, state)
        for model, state in zip(scenario.model.models, scenario.radar_states, strict=True)
        if isinstance(model.rcs, TableRCS) and model.rcs.elevation is not None
    ]
    outside = 0
    for block in blocks(cells.shape) if tables else ():
        aircraft = cells.states(*block)
        uncovered = [table.uncovered(body_vector(aircraft, radar)) for table, radar in tables]
        outside += int(np.count_nonzero(np.any(uncovered, axis=0)))
    if outside:
        yield warning(
            "table-exceeded",
            f"in {outside:,} {of_all} the aircraft sees a radar beyond the elevations of the RCS "
            "table; there the outermost values of the table are used",
        )


def _off_by_draws(cells: Grid, method: str, beta: float, end: str) -> dict[str, str]:
    """Return in how many of the sampled cells draws say that the bound is too low or too high."""
    sampled = (slice(None, None, -(-count // SAMPLED)) for count in cells.shape)
    checked = cells.scenario.at_states(cells.states(*sampled))
    # the bound alone is shown: it may have a value where the moments have none
    shown = bound(checked, method, beta)
    by_draws = band_of_scenario(checked, method=AUTOMATIC, beta=abs(beta))
    true = getattr(by_draws, end)
    allowed = least_off(true) + ERRORS * by_draws.error
    excess = {"low": true - shown, "high": shown - true}
    return {
        name: f"too {name} in {len(off)} of {shown.size} by up to {off.max():.2g}"
        for name, by in excess.items()
        if (off := by[by > allowed]).size
    }


def _draw(figure: Figure, result: Result, route: FloatArray, unknown: int) -> None:
    """Draw the cells with contours, the route and the radars."""
    table, scenario = result.table, result.scenario
    north, east = table["north_m"] / 1e3, table["east_m"] / 1e3
    end, worst = result.summary.get("end"), "worst_heading_deg" in table
    # A figure resolves no more than 1000 cells a side, and contours of more cells take long.
    stride = max(1, -(-max(len(north), len(east)) // 1000))
    north, east = north[::stride], east[::stride]
    values = table[result.summary["shown"]][::stride, ::stride]
    half = 0.5 * (east[1] - east[0]), 0.5 * (north[1] - north[0])
    extent = (east[0] - half[0], east[-1] + half[0], north[0] - half[1], north[-1] + half[1])
    shape = (extent[3] - extent[2]) / (extent[1] - extent[0])

    width, flat = plotting.nominal_width(figure), shape < FLAT
    title = _pose_in_words(result.summary).replace(", roll", "\nroll")  # else too wide
    names, letters = scenario.model.names, sum(map(len, scenario.model.names))
    if letters > LETTERS * width:
        numbered = [(str(number), name) for number, name in enumerate(names, start=1)]
        key = ", ".join(map("\N{NO-BREAK SPACE}".join, numbered))
        title += "\n" + textwrap.fill(key, int(IN_TITLE * width))
        names = tuple(number for number, _ in numbered)
    height = min(2.25 * width / 3.5, 3.6) * shape + 0.13 * title.count("\n")
    plotting.set_height(figure, (1.5 if flat else 0.75) + height)
    figure.set_layout_engine("compressed")  # for a fixed aspect
    axes = figure.subplots()
    axes.grid(visible=False)
    axes.set_title(title, fontsize=plotting.points(7.5))
    colours = plotting.colours_of_p_d()
    image = axes.imshow(
        values, origin="lower", extent=extent, cmap=colours, vmin=0, vmax=1, aspect="equal"
    )
    if unknown:
        plotting.add_small_print(figure, "red: no value")
    low, high = np.nanmin(values, initial=1), np.nanmax(values, initial=0)
    name = r"Probability of detection $P_D$"
    if end:
        band = rf"${result.summary['k']:g}\,\sigma$ bound of $P_D$"
        name = f"{end.capitalize()} {band} ({scenario.level}, {scenario.method})"
    elif worst:
        name = "Largest $P_D$ over all headings"
    bar = figure.colorbar(
        image,
        ax=axes,
        label=name,
        extend="max" if high > 1 else "min" if low < 0 else "neither",
        **({"location": "bottom", "aspect": 40} if flat else {"fraction": 0.05, "pad": 0.03}),
    )
    levels, thin = result.summary["contours"], plotting.points(0.8)
    drawn = {v: "white" if v < 0.6 else "black" for v in levels if low < v < high}
    if drawn:
        style: dict[str, Any] = {"linestyles": "-", "linewidths": thin}
        lines = axes.contour(east, north, values, [*drawn], colors=[*drawn.values()], **style)
        if not (names or flat):  # names would cover the labels
            axes.clabel(lines, fmt="%g", fontsize=plotting.points(6.5))
        for v, colour in drawn.items():
            (bar.ax.axvline if flat else bar.ax.axhline)(v, color=colour, lw=thin)
    poses, radars = scenario.aircraft / 1e3, scenario.radar_states / 1e3
    label = "route, by its own bound" if end else r"route, by its own $P_D$"
    plotting.coloured_line(axes, poses[:, 1], poses[:, 0], route, colours, label)
    if scenario.time_s is not None:
        plotting.mark(axes, poses[:1], "o", 4.0, "start")
        plotting.mark(axes, poses[-1:], "s", 4.0, "end")
    plotting.mark(axes, radars, "^", 5.5, "radar" if len(radars) == 1 else "radars")
    axes.set(xlim=extent[:2], ylim=extent[2:], xlabel="East [km]", ylabel="North [km]")
    plotting.draw_legend(figure, axes)
    if names:
        figure.draw_without_rendering()  # the names are put beside what has its place
        plotting.label_points(axes, radars[:, 1::-1], names)


def _pose_in_words(summary: Mapping[str, Any]) -> str:
    """Describe the height and the heading of the aircraft in the cells."""
    # on the earth the level plane of the cell has another roll, pitch and yaw, with rounding
    *tilts, yaw = summary["attitude_deg"]
    roll, pitch = (round(angle, 1) + 0.0 for angle in tilts)
    course = "worst heading" if summary["worst_heading"] else heading(yaw)
    tilt = f", roll {roll:.1f} deg, pitch {pitch:.1f} deg" if roll or pitch else ""
    return f"{0.0 - summary['down_km']:.4g} km above the origin, {course}{tilt}"
