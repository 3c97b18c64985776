"""Route files: the path of an aircraft, one row a pose, with the uncertainty of each pose.

A route file is CSV, in the dialect of `csv_reader`. Its columns, in any order:

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

Files in GPX, KML and of ADS-B state vectors are read by `track_file`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radar_sense import keys
from radar_sense.covariance import first_problem
from radar_sense.errors import InputError, check_choice, describe
from radar_sense.limits import DEG, Limit, check_number
from radar_sense.model import geodesy
from radar_sense.model.track import (
    ATTITUDE_COLUMNS,
    attitude_of_motion,
    motion_of_samples,
    turn_to_origin,
)
from radar_sense.model.trajectory import MAX_ROWS, MIN_STEP, Route
from radar_sense.provenance import Conventions
from radar_sense.reading.csv_reader import Block, Column, Format, Header, read_csv
from radar_sense.reading.text_file import check_path
from radar_sense.reading.track_file import Samples, is_track, read_track
from radar_sense.states import AIRCRAFT, POSITION, FloatArray

#: A million rows of 28 numbers with 17 digits each are 0.7 GB.
MAX_BYTES = 2**30
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
_NEEDS_SPEED = "waypoints without times need a speed, geometry.speed_m_s or a column speed_m_s"
_UNUSED_SPEED = "speed_m_s is for waypoints without times"
_ALLOWED = (
    "time_s or speed_m_s; north_m, east_m, down_m (or _km), "
    "or latitude_deg, longitude_deg, altitude_m; "
    "roll_deg, pitch_deg, yaw_deg; std_north_m to std_yaw_deg, "
    "or cov_north_north_m2 to cov_yaw_yaw_deg2"
)


def _within(low: float, high: float, unit: float = 1.0) -> Column:
    return Column(Limit(at_least=low, at_most=high), unit)


COLUMNS: dict[str, Column] = {
    "time_s": _within(-1e12, 1e12),
    "speed_m_s": _within(1e-3, 1e5),
    **{f"{axis}_m": _within(-_FAR, _FAR) for axis in _NED},
    **{f"{axis}_km": _within(-_FAR / 1e3, _FAR / 1e3, 1e3) for axis in _NED},
    "latitude_deg": _within(-90.0, 90.0, DEG),
    "longitude_deg": _within(-180.0, 360.0, DEG),
    "altitude_m": _within(-10e3, _FAR),
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
FORMAT = Format("a route file", COLUMNS, _ALLOWED, MAX_BYTES, MAX_ROWS)


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
    """Read and check a route file: CSV, GPX, KML or ADS-B state vectors.

    Args:
        path: The file, in a format described at the top of `reading.route_file` or
            `reading.track_file`.
        origin: Latitude, longitude [rad] and height above the ellipsoid [m] of the origin of the
            north-east-down frame. A file in latitude and longitude needs an origin, any other file
            must have none.
        max_gap_s: Longest time step allowed [s]; None allows any.
        altitude_above: What the altitudes are above: "ellipsoid", "sea" or "pressure". If None, the
            sea in GPX and KML, and the ellipsoid in other files.
        geoid_height_m: Height of the sea level above the ellipsoid [m], required by altitudes
            above the sea and by pressure altitudes.
        speed_m_s: Speed along the legs [m/s], for waypoints without times.
        icao24: Address of the aircraft, in state vectors of several.

    Raises:
        InputError: If the origin is no place, or if the file cannot be read or holds anything that
            is not allowed.
    """
    check_path(path)
    conventions = Conventions(altitude_above, geoid_height_m, speed_m_s, icao24)
    given = (max_gap_s, altitude_above, geoid_height_m, speed_m_s, icao24)
    for key, value in zip((keys.MAX_GAP, *keys.CONVENTIONS), given, strict=True):
        if value is not None and key.limit is not None:
            check_number(key.name, value, key.limit)
        elif value is not None and key.choices:
            check_choice(key.name, value, key.choices)
        elif value is not None and not re.fullmatch(key.pattern, str(value)):
            raise InputError(f"{key.name} must be {key.allowed}, got {describe(value)}")
    route, _ = read_route(path, origin=origin, max_gap_s=max_gap_s, conventions=conventions)
    return route


def read_route(
    path: str | Path,
    *,
    origin: tuple[float, float, float] | None = None,
    max_gap_s: float | None = None,
    conventions: Conventions | None = None,
    sha256: str | None = None,
) -> tuple[Route, str]:
    """Read a route file as `load_route` does, and return the SHA-256 of its bytes too.

    Args:
        path: The file.
        origin: As in `load_route`.
        max_gap_s: As in `load_route`.
        conventions: Choices that the file does not state, such as the reference of its altitudes.
        sha256: Digest that the file must have; None allows any.

    Raises:
        InputError: As in `load_route`.
    """
    source = str(path)
    if origin is not None and not geodesy.is_place(origin):
        raise InputError(
            f"origin must be latitude and longitude [rad] and height [m], got {origin!r}"
        )
    conventions = conventions or Conventions()
    if is_track(path):
        return _track(path, origin, max_gap_s, conventions, sha256)
    if conventions.icao24 is not None:
        raise InputError(f"{source}: icao24 is for files of ADS-B state vectors only")
    checks = _Checks(max_gap_s, conventions.speed_m_s)
    table = read_csv(
        path, FORMAT, check_header=checks.header, check_block=checks.block, sha256=sha256
    )
    layout = checks.layout
    if layout.geodetic and origin is None:
        raise table.header.error(
            "latitude_deg: needs the origin of the north-east-down frame, "
            "geometry.origin in a scenario"
        )
    if not layout.geodetic and origin is not None:
        raise table.header.error(
            "north, east and down have an origin already, "
            "an origin in latitude and longitude is not used here"
        )
    time, place, attitude, covariance = _assemble(layout, table.blocks)
    if layout.geodetic:
        place[:, 2] += _above_ellipsoid(source, ("ellipsoid", "sea"), conventions)
    elif (conventions.altitude_above, conventions.geoid_height_m) != (None, None):
        raise table.header.error(
            "altitude_above and geoid_height_m are for altitudes, "
            "and are not used with north, east and down"
        )
    if not layout.has_times:
        time = _times_of_waypoints(
            place,
            time if conventions.speed_m_s is None else np.full(len(time), conventions.speed_m_s),
            geodetic=layout.geodetic,
            place_of=lambda row: f"{source}:{checks.lines()[row]}",
        )
    if attitude is None:
        _require_two(source, len(time), f", or the columns {', '.join(ATTITUDE_COLUMNS)}")
    return _route(source, time, place, attitude, covariance, origin), table.sha256


def _track(
    path: str | Path,
    origin: tuple[float, float, float] | None,
    max_gap_s: float | None,
    conventions: Conventions,
    sha256: str | None,
) -> tuple[Route, str]:
    """Read GPX, KML or ADS-B state vectors."""
    source = str(path)
    samples = read_track(
        path,
        pressure=conventions.altitude_above == "pressure",
        icao24=conventions.icao24,
        sha256=sha256,
    )
    if origin is None:
        raise InputError(
            f"{source}: latitude and longitude need the origin of the north-east-down frame, "
            "geometry.origin in a scenario"
        )
    place, speed = samples.place, conventions.speed_m_s
    place[:, 2] += _above_ellipsoid(source, samples.altitudes, conventions)
    _require_two(source, len(place))
    if samples.time is None and speed is None:
        raise samples.error(0, f"has no times; {_NEEDS_SPEED}")
    if samples.time is not None and speed is not None:
        raise samples.error(0, f"has times; {_UNUSED_SPEED}")
    if samples.time is not None:
        time = samples.time - samples.time[0]
        _check_times(time, -math.inf, max_gap_s, samples, "time")
    else:
        time = _times_of_waypoints(
            place,
            np.full(len(place), speed),
            geodetic=True,
            place_of=lambda row: f"{source}:{samples.lines[row]}",
        )
    return _route(source, time, place, None, None, origin), samples.sha256


def _require_two(source: str, count: int, otherwise: str = "") -> None:
    if count < 2:
        raise InputError(
            f"{source}: has {count} row; attitude from the track needs 2 or more{otherwise}"
        )


def _route(
    source: str,
    time: FloatArray,
    place: FloatArray,
    attitude: FloatArray | None,
    covariance: FloatArray | None,
    origin: tuple[float, float, float] | None,
) -> Route:
    """Return the route in the frame of the origin; attitude from the track if it is None."""
    attitude_given = attitude is not None
    position = place if origin is None else geodesy.ned_from_geodetic(place, origin)
    if attitude is None:
        velocity, acceleration = motion_of_samples(time, position)
        attitude = attitude_of_motion(source, place, velocity, acceleration, origin)
    if origin is not None:
        attitude = turn_to_origin(source, time, place, attitude, covariance, origin)
    return Route(time, np.hstack([position, attitude]), covariance, attitude_given, origin)


def _above_ellipsoid(source: str, allowed: tuple[str, ...], conventions: Conventions) -> float:
    """Return the height of the zero of the altitudes above the ellipsoid [m].

    Args:
        source: Name of the file, for errors.
        allowed: What altitudes of the file may be above, the convention of the format first.
        conventions: What the user states.
    """
    above = conventions.altitude_above or allowed[0]
    height = conventions.geoid_height_m
    if above not in allowed:
        raise InputError(
            f"{source}: altitude_above: must be {' or '.join(allowed)} for this file, got {above}"
        )
    if above == "ellipsoid":
        if height is not None:
            raise InputError(
                f"{source}: geoid_height_m is not used with altitudes above the ellipsoid; "
                "altitude_above: sea states altitudes above the sea"
            )
        return 0.0
    if height is None:
        other = "; or altitude_above: ellipsoid" if "ellipsoid" in allowed else ""
        raise InputError(
            f"{source}: altitudes above the sea need geoid_height_m, the height of the sea level "
            f"above the WGS-84 ellipsoid on the route (-107 to 86 m, by EGM96 or EGM2008){other}"
        )
    return height


def _times_of_waypoints(
    place: FloatArray, speed: FloatArray, *, geodetic: bool, place_of: Callable[[int], str]
) -> FloatArray:
    """Return times (n,) [s] from 0 on, at a speed along each leg.

    A leg in latitude and longitude is an arc at the mean of the heights of its ends, and a climb.

    Args:
        place: North, east, down [m], or latitude, longitude [rad] and height [m] (n, 3).
        speed: Speed along the leg that begins at each waypoint (n,) [m/s].
        geodetic: Whether the places are in latitude and longitude.
        place_of: Returns file and line of a waypoint, for errors.
    """
    climb = np.diff(place[:, 2])
    if geodetic:
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
        raise InputError(f"{place_of(int(standing[0]) + 1)}: is the same place as the point before")
    return np.concatenate([[0.0], np.cumsum(duration)])


@dataclass(frozen=True)
class _Layout:
    """Indices of the columns.

    The column `time` has times, or else speeds. It is None for waypoints at one speed.
    """

    names: tuple[str, ...]
    time: int | None
    has_times: bool
    position: list[int]
    geodetic: bool
    attitude: list[int] | None
    std: list[int] | None
    cov: list[int] | None

    def units(self, columns: Sequence[int]) -> FloatArray:
        """Return the SI value of the units of some columns."""
        return np.array([COLUMNS[self.names[column]].unit for column in columns])


class _Checks:
    """Checks of a route from row to row, while the file is read.

    Attributes:
        layout: The columns, once the header has been checked.
    """

    layout: _Layout

    def __init__(self, max_gap_s: float | None, speed: float | None) -> None:
        self._max_gap_s, self._last_time, self._speed = max_gap_s, -math.inf, speed
        self._lines: list[NDArray[np.intp]] = []

    def header(self, header: Header) -> None:
        """Keep the layout of the columns."""
        self.layout = _layout(header, self._speed)

    def lines(self) -> NDArray[np.intp]:
        """Return the line of each waypoint."""
        return np.concatenate(self._lines)

    def block(self, block: Block) -> None:
        """Check times and covariances, and set covariances of pure rounding to 0."""
        if self.layout.has_times:
            time = block.rows[:, self.layout.time]
            _check_times(time, self._last_time, self._max_gap_s, block)
            self._last_time = float(time[-1])
        else:
            self._lines.append(block.line_numbers())
        if self.layout.cov:
            numbers = block.rows[:, self.layout.cov]
            numbers[np.abs(numbers) < _LEAST_COVARIANCE] = 0.0
            block.rows[:, self.layout.cov] = numbers
            problem = first_problem(numbers[:, _ENTRY])
            if problem:
                raise block.error(problem[0], f"covariance {problem[1]}")


def _assemble(
    layout: _Layout, blocks: list[FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray | None, FloatArray | None]:
    """Return time, place, attitude and covariance in SI units, and empty the list of blocks.

    Waypoints have speeds in place of times, or zeros.
    """
    count = sum(len(block) for block in blocks)
    time, place = np.zeros(count), np.empty((count, 3))
    attitude = np.empty((count, 3)) if layout.attitude else None
    covariance = np.zeros((count, 6, 6)) if layout.std or layout.cov else None
    stop = count
    # From the last block on: the C library can only return the memory allocated last.
    while blocks:
        rows = blocks.pop()
        block = slice(stop - len(rows), stop)
        if layout.time is not None:
            time[block] = rows[:, layout.time]
        place[block] = rows[:, layout.position] * layout.units(layout.position)
        if layout.attitude and attitude is not None:
            attitude[block] = rows[:, layout.attitude] * layout.units(layout.attitude)
        if layout.std and covariance is not None:
            diagonal = np.arange(6)
            covariance[block, diagonal, diagonal] = (rows[:, layout.std] * _COV_UNITS) ** 2
        if layout.cov and covariance is not None:
            covariance[block] = rows[:, layout.cov][:, _ENTRY] * np.outer(_COV_UNITS, _COV_UNITS)
        stop -= len(rows)
    return time, place, attitude, covariance


def _layout(header: Header, speed: float | None) -> _Layout:
    """Return the layout of the columns.

    Args:
        header: The columns.
        speed: Speed of a file without times and speeds, or None.
    """
    names = header.names

    def indices(wanted: Sequence[str], why: str) -> list[int]:
        missing = [name for name in wanted if name not in names]
        if missing:
            raise header.error(f"missing column '{missing[0]}', {why}")
        return [names.index(name) for name in wanted]

    def optional(wanted: Sequence[str]) -> list[int] | None:
        if not set(wanted) & set(names):
            return None
        several = f"{wanted[0]} to {wanted[-1]}" if len(wanted) > 3 else ", ".join(wanted)
        return indices(wanted, f"required are all of {several}, or none")

    ned = []
    for axis in _NED:
        present = [name for name in (f"{axis}_m", f"{axis}_km") if name in names]
        if len(present) > 1:
            raise header.error(f"has {' and '.join(present)}; give only one of them")
        ned.append(present[0] if present else f"{axis}_m")
    geodetic = bool(set(GEODETIC) & set(names))
    if geodetic and set(ned) & set(names):
        raise header.error(
            "has north, east, down beside latitude, longitude, altitude; give only one of the two"
        )
    position = GEODETIC if geodetic else tuple(ned)
    has_times, has_speeds = "time_s" in names, "speed_m_s" in names
    if has_times and (has_speeds or speed is not None):
        raise header.error(f"has time_s; {_UNUSED_SPEED}")
    if has_speeds and speed is not None:
        raise header.error(
            "has the column speed_m_s beside geometry.speed_m_s; give only one of the two"
        )
    if not (has_times or has_speeds or speed is not None):
        raise header.error(f"missing column 'time_s'; {_NEEDS_SPEED}")
    moment = "time_s" if has_times else "speed_m_s"
    layout = _Layout(
        names=names,
        time=names.index(moment) if moment in names else None,
        has_times=has_times,
        position=indices(position, f"required are {', '.join(GEODETIC)}, or north, east, down"),
        geodetic=geodetic,
        attitude=optional(ATTITUDE_COLUMNS),
        std=optional(STD),
        cov=optional(COV),
    )
    if layout.std and layout.cov:
        raise header.error(f"has {STD[0]} beside {COV[0]}; give only one of the two")
    return layout


def _check_times(
    time: FloatArray,
    before: float,
    max_gap_s: float | None,
    block: Block | Samples,
    name: str = "time_s",
) -> None:
    steps = np.diff(time, prepend=before)
    backwards = steps < MIN_STEP
    if backwards.any():
        row = int(np.argmax(backwards))
        earlier = float(time[row - 1]) if row else before
        enough = f", by {MIN_STEP:g} s or more" if steps[row] > 0 else ""
        raise block.error(
            row,
            f"{name}: must be later than {earlier!r}, "
            f"the time of the row before{enough}, got {float(time[row])!r}",
        )
    if max_gap_s is not None:
        gap = np.isfinite(steps) & (steps > max_gap_s)
        if gap.any():
            row = int(np.argmax(gap))
            raise block.error(
                row,
                f"{name}: must be within {max_gap_s:g} s of the row before, got {steps[row]:g} s",
            )
