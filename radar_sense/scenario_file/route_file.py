"""Route files: the path of an aircraft, one row a pose, with the uncertainty of each pose.

A route file is CSV, as `table_file` reads it. Its columns, in any order:

    time_s                                  strictly increasing; or, for waypoints without times:
    speed_m_s                               speed along the leg that begins at the waypoint
    north_m, east_m, down_m                 or north_km, ...; or, instead of the three:
    latitude_deg, longitude_deg, altitude_m WGS-84; altitude is the height above the ellipsoid,
                                            which differs from the height above the sea by up to
                                            107 m
    roll_deg, pitch_deg, yaw_deg            all or none; without them attitude follows the track
    std_north_m, std_east_m, std_down_m, std_roll_deg, std_pitch_deg, std_yaw_deg
                                            standard deviations of independent errors; or, instead:
    cov_north_north_m2, cov_north_east_m2, ..., cov_north_roll_m_deg, ..., cov_yaw_yaw_deg2
                                            upper triangle of the covariance, 21 numbers with 12
                                            digits or more; fewer digits may round strong
                                            correlations to a matrix that is no covariance

With latitude and longitude, attitude and covariance are relative to north, east and down at the
aircraft, as a navigation filter writes them. Reading turns them into the frame of the origin.

Files in GPX and of ADS-B state vectors are read by `track_file`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from radar_sense.covariance import first_wrong
from radar_sense.errors import InputError
from radar_sense.limits import DEG, Limit, check_parameters
from radar_sense.model import geodesy
from radar_sense.model.track import (
    ATTITUDE_COLUMNS,
    attitude_from_motion,
    hovering,
    motion_of_samples,
)
from radar_sense.model.trajectory import MIN_STEP, Route, legs
from radar_sense.scenario_file import sections
from radar_sense.scenario_file.conversion import KM
from radar_sense.scenario_file.table_file import NumberColumn, TableFile
from radar_sense.scenario_file.text_file import TextFile, open_text
from radar_sense.scenario_file.track_file import PLACES, TIMES, Track, read_gpx, read_state_vectors
from radar_sense.states import AIRCRAFT, DOWN, POSITION, FloatArray, slices

#: What the file should be, for errors.
ROUTE_FILE = "a route file"
_NED = AIRCRAFT[POSITION]
#: Columns of a position on the earth.
GEODETIC = ("latitude_deg", "longitude_deg", "altitude_m")
_UNITS = ("m",) * 3 + ("deg",) * 3
#: Columns of standard deviations.
STD = tuple(f"std_{name}_{unit}" for name, unit in zip(AIRCRAFT, _UNITS, strict=True))
_UPPER = tuple((i, j) for i in range(6) for j in range(i, 6))
#: Columns of the upper triangle of a covariance.
COV = tuple(
    f"cov_{AIRCRAFT[i]}_{AIRCRAFT[j]}_"
    + (f"{_UNITS[i]}2" if _UNITS[i] == _UNITS[j] else f"{_UNITS[i]}_{_UNITS[j]}")
    for i, j in _UPPER
)
#: Index of each entry of the covariance among the 21 columns.
_ENTRY = np.array([[_UPPER.index((min(i, j), max(i, j))) for j in range(6)] for i in range(6)])
_COV_UNITS = np.repeat([1.0, DEG], 3)
#: Covariances below this become 0. Their squares would leave the range of floats.
_LEAST_COVARIANCE = 1e-100
#: 100 000 km. A larger distance is a mistake in the units.
_FAR = 1e8
_TURN = 360.0
_STD_LIMITS = (_FAR,) * 3 + (_TURN,) * 3
_ALLOWED = (
    "time_s or speed_m_s; north_m, east_m, down_m (or _km), "
    "or latitude_deg, longitude_deg, altitude_m; "
    "roll_deg, pitch_deg, yaw_deg; std_north_m to std_yaw_deg, "
    "or cov_north_north_m2 to cov_yaw_yaw_deg2; "
    "of ADS-B time, icao24, lat, lon, geoaltitude or baroaltitude"
)
#: Columns of which a file has either the ones or the others.
_EXCLUSIVE: tuple[tuple[Sequence[str], Sequence[str]], ...] = (
    (("time_s",), ("speed_m_s",)),
    *(((f"{axis}_m",), (f"{axis}_km",)) for axis in _NED),
    ([f"{axis}_{unit}" for axis in _NED for unit in ("m", "km")], GEODETIC),
    (STD, COV),
)


def _within(low: float, high: float, unit: float = 1.0) -> NumberColumn:
    return NumberColumn(Limit(at_least=low, at_most=high), unit)


COLUMNS: dict[str, NumberColumn] = {
    "time_s": NumberColumn(TIMES),
    "speed_m_s": NumberColumn(sections.SPEED),
    **{f"{axis}_m": _within(-_FAR, _FAR) for axis in _NED},
    **{f"{axis}_km": _within(-_FAR / 1e3, _FAR / 1e3, 1e3) for axis in _NED},
    **dict(zip(GEODETIC, map(NumberColumn, PLACES, (DEG, DEG, 1.0)), strict=True)),
    "roll_deg": _within(-_TURN, _TURN, DEG),
    "pitch_deg": _within(-90.0, 90.0, DEG),
    "yaw_deg": _within(-_TURN, _TURN, DEG),
    **{name: _within(0.0, most) for name, most in zip(STD, _STD_LIMITS, strict=True)},
    **{
        name: _within(
            0.0 if i == j else -_STD_LIMITS[i] * _STD_LIMITS[j], _STD_LIMITS[i] * _STD_LIMITS[j]
        )
        for name, (i, j) in zip(COV, _UPPER, strict=True)
    },
}


def load_route(
    path: str | Path,
    *,
    origin: tuple[float, float, float] | None = None,
    max_gap_s: float | None = None,
    altitude_above: str | None = None,
    geoid_height_m: float | None = None,
    speed_m_s: float | None = None,
    icao24: str | None = None,
) -> Route:
    """Read and check a route file: CSV, GPX or ADS-B state vectors.

    Args:
        path: The file, in a format described at the top of `scenario_file.route_file` or
            `scenario_file.track_file`.
        origin: Latitude, longitude [rad] and height above the ellipsoid [m] of the origin of the
            north-east-down frame. A file in latitude and longitude needs an origin, any other file
            must have none.
        max_gap_s: Longest time step allowed [s]; None allows any.
        altitude_above: What the altitudes are above: "ellipsoid", "sea" or "pressure". If None, the
            sea in GPX, and the ellipsoid in other files.
        geoid_height_m: Height of the sea level above the ellipsoid [m], required by altitudes
            above the sea and by pressure altitudes. Of altitudes above the ellipsoid it is allowed
            if `altitude_above` says so, and changes nothing of the route.
        speed_m_s: Speed along the legs [m/s], for waypoints without times.
        icao24: Address of the aircraft, in state vectors of several.

    Raises:
        InputError: If the origin is no place, or if the file cannot be read or holds anything that
            is not allowed.
    """
    stated = sections.Path(
        file="route",  # the path may have letters that no scenario file has
        max_gap_s=max_gap_s,
        altitude_above=altitude_above,
        geoid_height_m=geoid_height_m,
        speed_m_s=speed_m_s,
        icao24=icao24,
    )
    check_parameters(stated)
    geodesy.check_origin(origin)
    with open_text(path, ROUTE_FILE) as file:
        return read_route(file, stated, origin)


def read_route(
    file: TextFile, stated: sections.Path, origin: tuple[float, float, float] | None
) -> Route:
    """Return the route in an open file as a section states it.

    The origin, of `load_route`, is checked by the caller.
    """
    track = _read(file, stated)
    if track.altitudes:
        if origin is None:
            raise track.error(
                "latitude and longitude need the origin of the north-east-down frame, "
                "geometry.origin in a scenario"
            )
        if stated.down_km:
            raise track.error("down_km shifts north, east, down; here altitude_m shifts the route")
        shift = KM * np.array([stated.north_km, stated.east_km, 0.0])
        if shift.any():  # in the level plane of each row, whose height stays
            track.place[:, :2] = geodesy.geodetic_from_ned(shift, track.place)[:, :2]
        track.place[:, 2] += _above_ellipsoid(track, stated) + stated.altitude_m
    elif origin is not None:
        raise track.error(
            "north, east and down have an origin already, "
            "an origin in latitude and longitude is not used here"
        )
    elif (stated.altitude_above, stated.geoid_height_m) != (None, None):
        raise track.error(
            "altitude_above and geoid_height_m are for altitudes, "
            "and are not used with north, east and down"
        )
    elif stated.altitude_m:
        raise track.error("altitude_m shifts latitude and longitude; here down_km shifts the route")
    else:
        track.place[:] += KM * np.array([stated.north_km, stated.east_km, stated.down_km])
    if track.attitude is None and len(track.place) < 2:
        raise InputError(
            f"{file.source}: has {len(track.place)} row; attitude from the track needs 2 or more, "
            f"or the columns {', '.join(ATTITUDE_COLUMNS)}"
        )
    time = _times(track, stated.speed_m_s, stated.max_gap_s)
    place, attitude = track.place, track.attitude
    position, turn, down = place, None, None
    if origin is not None:
        position = geodesy.ned_from_geodetic(place, origin)
        turn = geodesy.turn_to_origin(place, origin)
        down = turn[..., DOWN]
    if attitude is None:
        still = hovering(time, position, down)
        still = np.append(still[0], still)  # a row is as the step that leads to it
        if len(time) > 2:
            motion = motion_of_samples(time, position, down)
        else:  # a leg, which follows the curve of the earth
            states = np.hstack([position, np.zeros_like(position)])
            motion = legs(Route(time, states, None, False, origin), time)[1:]
        attitude = attitude_from_motion(track.source, *motion, still, turn)
    elif turn is not None:
        attitude = geodesy.turned_attitude(attitude, turn)
    aircraft = np.hstack([position, attitude])
    return Route(time, aircraft, track.covariance, track.attitude is not None, origin)


def _read(file: TextFile, stated: sections.Path) -> Track:
    """Return the contents of a file."""
    if file.source.lower().endswith(".gpx"):
        track = read_gpx(file)
    else:
        table = TableFile(file)
        if "icao24" in table.names:
            pressure = stated.altitude_above == "pressure"
            return read_state_vectors(table, pressure=pressure, icao24=stated.icao24)
        track = _table(table)
    if stated.icao24 is not None:
        raise InputError(f"{file.source}: icao24 is for files of ADS-B state vectors only")
    return track


def _table(file: TableFile) -> Track:
    """Return the contents of a route file."""
    names = file.names
    gpx = "; the name of a GPX file ends in .gpx" if "".join(names).startswith("<") else ""
    file.require_known(COLUMNS, _ALLOWED + gpx)
    for one, other in _EXCLUSIVE:
        both = [next((name for name in group if name in names), "") for group in (one, other)]
        if all(both):
            raise file.error(f"has {' beside '.join(both)}; give only one of the two")
    given = [g for g in (GEODETIC, ATTITUDE_COLUMNS, STD, COV) if not {*g}.isdisjoint(names)]
    ned = tuple(f"{axis}_km" if f"{axis}_km" in names else f"{axis}_m" for axis in _NED)
    place = GEODETIC if GEODETIC in given else ned
    file.require(place, f"{', '.join(GEODETIC)}, or north, east, down")
    for group in given:
        several = f"{group[0]} to {group[-1]}" if len(group) > 3 else ", ".join(group)
        file.require(group, f"all of {several}, or none")
    rows = file.numbers(COLUMNS)

    def si(wanted: Sequence[str]) -> FloatArray:
        """Return columns (rows, k) in SI units."""
        units = [COLUMNS[name].unit for name in wanted]
        return rows[:, [names.index(name) for name in wanted]] * units

    return Track(
        source=file.source,
        line=file.line,
        lines=file.lines,
        place=si(place),
        altitudes=("ellipsoid", "sea") if GEODETIC in given else (),
        time=si(["time_s"])[:, 0] if "time_s" in names else None,
        time_name="time_s",
        speed=si(["speed_m_s"])[:, 0] if "speed_m_s" in names else None,
        attitude=si(ATTITUDE_COLUMNS) if ATTITUDE_COLUMNS in given else None,
        covariance=_covariance(file, rows),
    )


def _covariance(file: TableFile, rows: FloatArray) -> FloatArray | None:
    """Return C_aa (n, 6, 6) of rows in SI units, or None if the file has no columns of it."""
    group = next((group for group in (STD, COV) if group[0] in file.names), None)
    if group is None:
        return None
    columns = [file.names.index(name) for name in group]
    covariance = np.zeros((len(rows), 6, 6))
    for block in slices(len(rows)):
        numbers = rows[block, columns]
        if group == STD:
            covariance[block, range(6), range(6)] = (numbers * _COV_UNITS) ** 2
            continue
        numbers[np.abs(numbers) < _LEAST_COVARIANCE] = 0.0
        if problem := first_wrong(numbers[:, _ENTRY]):
            raise file.error(f"covariance {problem[1]}", file.lines[block][problem[0]])
        covariance[block] = numbers[:, _ENTRY] * np.outer(_COV_UNITS, _COV_UNITS)
    return covariance


def _above_ellipsoid(track: Track, stated: sections.Path) -> float:
    """Return the height of the zero of the altitudes above the ellipsoid [m]."""
    above = stated.altitude_above or track.altitudes[0]  # the convention of the format
    height = stated.geoid_height_m  # also of the horizon
    if above not in track.altitudes:
        allowed = " or ".join(track.altitudes)
        raise track.error(f"altitude_above: must be {allowed} for this file, got {above}")
    if above == "ellipsoid":
        if height is not None and stated.altitude_above is None:
            others = " or ".join(other for other in track.altitudes if other != above)
            raise track.error(
                f"geoid_height_m needs altitude_above: {others} for such altitudes, or ellipsoid "
                "for a sea level of the horizon alone"
            )
        return 0.0
    if height is None:
        raise track.error(
            "altitudes above the sea need geoid_height_m, the height of the sea level above the "
            "WGS-84 ellipsoid on the route (-107 to 86 m, by EGM96 or EGM2008); or altitude_above: "
            "ellipsoid"
        )
    return height


def _times(track: Track, speed_m_s: float | None, max_gap_s: float | None) -> FloatArray:
    """Return the time of each pose (n,) [s], from the file or from speeds along the legs."""
    if track.time is None:
        if max_gap_s is not None:
            raise track.error("has no times; max_gap_s is for rows with times")
        return _times_of_waypoints(track, speed_m_s)
    if speed_m_s is not None:
        raise track.error("has times; speed_m_s is for waypoints without times")
    steps = np.diff(track.time)
    backwards = steps < MIN_STEP
    if backwards.any():
        row = int(np.argmax(backwards)) + 1
        step = steps[row - 1]
        got = f"{-step:g} s before it" if step else "the same"
        if step > 0:
            got = f"only {step:g} s later; allowed is {MIN_STEP:g} s or more"
        raise track.error(
            f"{track.time_name}: must be later than the time of the row before, got {got}", row
        )
    if max_gap_s is not None and np.any(steps > max_gap_s):
        row = int(np.argmax(steps > max_gap_s)) + 1
        raise track.error(
            f"{track.time_name}: must be within {max_gap_s:g} s of the row before, "
            f"got {steps[row - 1]:g} s",
            row,
        )
    return track.time


def _times_of_waypoints(track: Track, speed_m_s: float | None) -> FloatArray:
    """Return times (n,) [s] from 0 on, at a speed along each leg.

    A leg in latitude and longitude is an arc at the mean of the heights of its ends, and a climb.
    """
    place, speed = track.place, track.speed
    if speed is None and speed_m_s is None:
        raise track.error(
            "has no times; waypoints without times need a speed, geometry.speed_m_s or a column "
            "speed_m_s"
        )
    if speed is None:
        speed = np.full(len(place), speed_m_s)
    elif speed_m_s is not None:
        raise track.error(
            "has the column speed_m_s beside geometry.speed_m_s; give only one of the two"
        )
    climb = np.diff(place[:, 2])
    if track.altitudes:
        height = 0.5 * (place[1:, 2] + place[:-1, 2])
        ends = [
            geodesy.ecef_from_geodetic(np.column_stack([end[:, :2], height]))
            for end in (place[:-1], place[1:])
        ]
        chord = np.linalg.norm(ends[1] - ends[0], axis=-1)
        radius = geodesy.SEMI_MAJOR + height
        level = 2.0 * radius * np.arcsin(np.minimum(chord / (2.0 * radius), 1.0))
    else:
        level = np.linalg.norm(np.diff(place[:, :2], axis=0), axis=-1)
    duration = np.hypot(level, climb) / speed[:-1]
    standing = np.flatnonzero(duration < MIN_STEP)
    if len(standing):
        raise track.error("is the same place as the point before", int(standing[0]) + 1)
    return np.concatenate([[0.0], np.cumsum(duration)])
