"""The radar cross section by aspect: a polar cut and a map."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_sense import options, plotting
from radar_sense.axis import Axis
from radar_sense.command import Figure, Result, command
from radar_sense.errors import InputError
from radar_sense.model.geometry import body_vector, elevation_of
from radar_sense.model.rcs import RCS, SpikeballRCS
from radar_sense.model.rcs_table import MAX_NODES, TableRCS
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray
from radar_sense.words import decibels, describe_poses, table_warnings, warning

#: Largest steps of azimuth and elevation [deg].
AZIMUTH_STEP, ELEVATION_STEP = 1.0, 5.0
#: Azimuths in a lobe. Between 8 of them the top of a lobe |sin| is missed by 0.09 dB at most. With
#: fewer than LEAST a lobe may be missed.
IN_LOBE, LEAST = 8, 2
#: Values that differ by a smaller part are equal.
ROUNDING = 1e-9
#: Straight above and below a model has one value if the values 0.1 deg aside, by this factor on the
#: elevation, differ from it by less than this part.
ASIDE, ALIKE = 89.9 / 90.0, 0.01
#: Parts of each step of elevation of a table, between which the extremes are looked for.
PARTS = 8


def directions(azimuth_deg: FloatArray, elevation_deg: FloatArray) -> FloatArray:
    """Return body-frame unit vectors (..., 3) to azimuths and elevations (...) [deg]."""
    azimuth, elevation = np.deg2rad(azimuth_deg), np.deg2rad(elevation_deg)
    # cos(π/2) rounds to 6e-17, but h must be 0 straight above and below.
    h = np.where(abs(elevation_deg) == 90, 0.0, np.cos(elevation))
    parts = h * np.cos(azimuth), h * np.sin(azimuth), -np.sin(elevation)
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def pattern(rcs: RCS, azimuth_deg: FloatArray, elevation_deg: FloatArray) -> FloatArray:
    """Return σ_r (...) [m²] by azimuth and elevation (...) [deg] in the body frame."""
    return rcs.cross_section(directions(azimuth_deg, elevation_deg))


@command(options.ONE_RADAR, examples=("radar-sense rcs", "radar-sense rcs my.yaml --format png"))
def rcs(scenario: Scenario) -> Result:
    """The radar cross section by aspect: a polar cut and a map.

    A scenario can use the written table, as `rcs: {model: table, file: ...}`, if no cross section
    in it is 0.
    """
    if len(set(scenario.bands)) > 1:
        raise InputError(
            f"the RCS differs by band ({', '.join(dict.fromkeys(scenario.bands))}): choose one of "
            f"the radars {', '.join(scenario.model.names)} with --radar"
        )
    result, model = Result(scenario), scenario.radars[0].model.rcs
    spread = getattr(model, "spread", None)
    elevation = np.arange(-90.0, 90.0 + ELEVATION_STEP, ELEVATION_STEP)
    ends = model.elevation if isinstance(model, TableRCS) else None
    if ends is not None:
        elevation = np.union1d(elevation, np.rad2deg(ends).round(9))
    lobes = _lobes(model)
    turns = max(1.0 / AZIMUTH_STEP, IN_LOBE / max(lobes["azimuth"], 1e-9))  # azimuths in a degree
    most = MAX_NODES // len(elevation) // 360  # of a table
    azimuth = np.linspace(-180.0, 180.0, 360 * min(math.ceil(turns - 1e-9), most), endpoint=False)
    written = [of for of in (model, spread) if of is not None]
    maps = [np.array(pattern(of, azimuth, elevation[:, np.newaxis])) for of in written]
    for pole in (0, -1):  # straight above and below, a table needs one value for all azimuths
        beside = [pattern(of, azimuth, ASIDE * elevation[pole]) for of in written]
        each = list(zip(maps, beside, strict=True))
        one = all(np.allclose(values, of[pole, 0], rtol=ALIKE, atol=0) for of, values in each)
        elevation[pole] *= 1.0 if one else ASIDE
        for of, values in each:
            of[pole] = of[pole, 0] if one else values
    azimuths, elevations = (a.ravel() for a in np.meshgrid(azimuth, elevation))
    sigma, *of_spread = map(np.ravel, maps)
    # the lines of sight (mn, 3) from the aircraft at n poses to m radars
    lines = np.concatenate([body_vector(scenario.aircraft, r) for r in scenario.radar_states])
    seen, seen_elevation = model.cross_section(lines), np.rad2deg(elevation_of(lines))
    seen_azimuth = np.rad2deg(np.arctan2(lines[:, 1], lines[:, 0]))

    add = result.table.add
    add(
        "azimuth_deg", azimuths, "Azimuth of the radar seen from the aircraft, 0 off the nose.", "°"
    )
    meaning = "Elevation of the radar seen from the aircraft, positive above."
    add("elevation_deg", elevations, meaning, "°")
    add("rcs_m2", sigma, "Radar cross section in this direction.", "m²")
    for std_db in of_spread:
        meaning = "Standard deviation of the cross section, if the RCS table has std_db."
        add("std_db", std_db, meaning, "dB")

    low, high = (-90.0, 90.0) if ends is None else np.rad2deg(ends[[0, -1]])
    beyond = abs(elevation - np.clip(elevation, low, high))  # the outermost values again
    within = beyond <= 0.5 * ELEVATION_STEP
    every = "any elevation" if ends is None else "any elevation of the table"
    marks = _marks(model, len(azimuth))
    both = [maps[0][within], pattern(model, marks, elevation[within, np.newaxis])]
    around, first = np.unique(np.append(azimuth, marks).round(9), return_index=True)
    rows, looked = [np.hstack(both)[:, first]], elevation[within]
    if ends is not None:  # the curve between two nodes may be beyond both
        parts = np.rad2deg(np.linspace(ends[:-1], ends[1:], PARTS, endpoint=False)[1:]).ravel()
        rows.append(pattern(model, around, parts[:, np.newaxis]))
        looked = np.append(looked, parts)
    order = np.argsort(looked)
    _add_extremes(result, around, looked[order], np.vstack(rows)[order], every)
    low, high = decibels(np.array([seen.min(), seen.max()])).round(1) + 0.0
    extremes = seen_elevation.min(), seen_elevation.max()
    at_elevation = " to ".join(dict.fromkeys(f"{end.round(1) + 0.0}" for end in extremes))
    result.report.append(
        f"RCS in the geometry {low:.1f} to {high:.1f} dBsm, at elevation {at_elevation} deg"
    )
    result.summary |= {
        "horizon_mean_m2": float(pattern(model, azimuth, np.zeros(1)).mean()),
        "geometry": {
            "elevation_deg": [float(seen_elevation.min()), float(seen_elevation.max())],
            "rcs_m2": [float(seen.min()), float(seen.max())],
        },
    }
    if np.allclose(maps[0][1:-1], maps[0][1], rtol=ROUNDING, atol=0.0):
        lobes["elevation"] = math.inf  # the RCS does not depend on it
    steps = {"azimuth": 360.0 / len(azimuth), "elevation": ELEVATION_STEP}
    result.warnings += [
        warning(
            "rcs-fine",
            f"the RCS may have lobes of {lobes[name]:.2g} deg, and the table has steps of "
            f"{step:.2g} deg in {name}: it may miss lobes, and so may the extremes",
        )
        for name, step in steps.items()
        if step > (1.0 + ROUNDING) * lobes[name] / LEAST
    ]
    result.warnings += table_warnings(scenario)
    result.draw = partial(
        _draw, model=model, seen_azimuth=seen_azimuth, seen_elevation=seen_elevation
    )
    return result


def _lobes(model: RCS) -> dict[str, float]:
    """Return the width [deg] of the narrowest lobe by azimuth and by elevation."""
    if not isinstance(model, TableRCS):
        return dict.fromkeys(("azimuth", "elevation"), math.degrees(model.detail))
    # two steps of nodes make a lobe; the written table has the elevations of the nodes
    return {"azimuth": 2.0 * math.degrees(np.min(np.diff(model.azimuth))), "elevation": math.inf}


def _marks(model: RCS, most: int) -> FloatArray:
    """Return azimuths [deg] at which the extremes of a model may be, up to a number."""
    if isinstance(model, TableRCS):
        return (np.rad2deg(model.azimuth) + 180.0) % 360.0 - 180.0
    if isinstance(model, SpikeballRCS) and 2 * model.lobes <= most:  # tops and bottoms of lobes
        return np.linspace(-180.0, 180.0, 2 * model.lobes, endpoint=False)
    return np.zeros(0)


def _add_extremes(
    result: Result, azimuth: FloatArray, elevation: FloatArray, sigma: FloatArray, every: str
) -> None:
    """Add the largest and the smallest σ_r (m, n) [m²] by elevation (m,) and azimuth (n,) [deg].

    `every` is what all elevations together are called.
    """
    poles = abs(elevation) == 90.0
    sigma = sigma.astype(float)
    sigma[poles, 1:] = np.nan  # straight above and below there is no azimuth
    for name, value in (("largest", np.nanmax(sigma)), ("smallest", np.nanmin(sigma))):
        at = np.isclose(sigma, value, rtol=ROUNDING, atol=0.0)
        columns, rows = np.any(at, axis=0), np.any(at, axis=1)
        row, column = np.argwhere(at)[0]
        if not np.array_equal(at[~poles], np.outer(rows, columns)[~poles]):
            first = f"azimuth {azimuth[column]:g}, elevation {elevation[row]:g} deg"
            place = f"in {np.count_nonzero(at)} directions, the first at {first}"
        elif rows[~poles].any():
            rows |= poles & rows[~poles].all()
            place = f"at {_in_words('azimuth', azimuth, columns, 'any azimuth')}, "
            place += _in_words("elevation", elevation, rows, every)
        else:
            ways = ("above" if end > 0 else "below" for end in elevation[rows])
            place = f"straight {' and '.join(ways)}"
        shown = decibels(np.array(value)).round(1) + 0.0  # + 0.0 makes -0 a 0
        result.report.append(f"{name} RCS {shown} dBsm {place}")
        result.summary[name] = {
            "rcs_m2": float(value),
            "azimuth_deg": float(azimuth[column]),
            "elevation_deg": float(elevation[row]),
        }


def _in_words(name: str, values: FloatArray, mask: NDArray[np.bool_], whole: str) -> str:
    """Return the angles [deg] of a mask in words, or what stands for the whole mask."""
    if mask.all():
        return whole
    axis = Axis(name, name, "deg", values, "g", 1e-3, f"{name}s")
    words = describe_poses(mask, axis).removeprefix("at ")
    return words if axis.places in words else f"{name} {words}"


def _draw(figure: Figure, model: RCS, seen_azimuth: FloatArray, seen_elevation: FloatArray) -> None:
    """Draw cuts at the horizon and at one elevation, and the map with the geometry's directions."""
    if plotting.nominal_width(figure) > 5.0:
        plotting.set_height(figure, 2.8)
        grid = figure.add_gridspec(1, 2, width_ratios=(1.0, 1.2))
    else:
        plotting.set_height(figure, 6.0)
        grid = figure.add_gridspec(2, 1, height_ratios=(1.1, 1.0))
    polar: Any = figure.add_subplot(grid[0], projection="polar")
    plane = figure.add_subplot(grid[1])

    middle = float(np.median(seen_elevation))
    azimuth = np.arange(-180.0, 180.25, 0.25)
    horizon, seen = (pattern(model, azimuth, np.array(of)) for of in (0.0, middle))
    top = max(horizon.max(), seen.max())
    # Deep nulls would compress the rest of the scale. A cross section of 0 has no decibels.
    floor = max(min(horizon.min(), seen.min()), 1e-5 * top)
    for sigma, label, style in (
        (horizon, "at the horizon", plotting.LINES[0]),
        (seen, f"at elevation {middle:.1f} deg, as in the geometry", plotting.LINES[1]),
    ):
        plotting.draw_line(
            polar, np.deg2rad(azimuth), decibels(np.maximum(sigma, floor)), style, label=label
        )
    low, high = decibels(np.array([floor, top]))
    margin = max(1.0, 0.05 * (high - low))
    polar.set_ylim(low - margin, high + margin)
    plotting.set_compass(polar, plotting.ASPECTS, "RCS [dBsm]")

    azimuth, elevation = np.arange(-180.0, 180.5, 0.5), np.arange(-90.0, 91.0, 1.0)
    sigma = pattern(model, azimuth, elevation[:, np.newaxis])
    level = decibels(np.maximum(sigma, 1e-5 * sigma.max()))
    drawn = plane.pcolormesh(azimuth, elevation, level, shading="nearest", rasterized=True)
    bar = figure.colorbar(
        drawn, ax=plane, label="RCS [dBsm]", orientation="horizontal", aspect=40, pad=0.04
    )
    bar.ax.locator_params(nbins=6)
    if np.ptp(level) > 0.1:
        line: dict[str, Any] = {"linestyles": "-", "linewidths": plotting.points(0.3)}
        bar.add_lines(plane.contour(azimuth, elevation, level, 6, colors="white", **line))
    dot: dict[str, Any] = {"color": plotting.BAND[0], "ms": plotting.points(2.5)}
    plane.plot(seen_azimuth, seen_elevation, ".", label="the radar in the geometry", **dot)
    if isinstance(model, TableRCS) and model.elevation is not None:
        line = {"colors": "black", "linestyles": "--", "lw": plotting.points(0.8)}
        ends = np.rad2deg(model.elevation[[0, -1]])
        plane.hlines(ends, -180, 180, label="ends of the table", **line)
    plane.set(xlim=(-180, 180), ylim=(-90, 90))
    plane.set(xticks=range(-180, 181, 45), yticks=range(-90, 91, 45))
    plane.tick_params(axis="x", pad=plotting.points(7))  # clear of the lowest elevation
    plane.set_xlabel("Azimuth in the body frame [deg]")
    plane.set_ylabel("Elevation [deg]")
    plotting.draw_legend(figure, polar, plane)
