"""Route files: the path of an aircraft, one row a pose, with the uncertainty of each pose.

A route file is CSV, in the dialect of `csv_reader`. Its columns, in any order:

    time_s                                  strictly increasing
    north_m, east_m, down_m                 or north_km, ...; or, instead of the three:
    latitude_deg, longitude_deg, altitude_m WGS-84; altitude is the height above the ellipsoid,
                                            which differs from the height above the sea by up to
                                            107 m
    roll_deg, pitch_deg, yaw_deg            all or none; without them attitude follows the track
    std_north_m, std_east_m, std_down_m, std_roll_deg, std_pitch_deg, std_yaw_deg
                                            standard deviations of independent errors; or, instead:
    cov_north_north_m2, cov_north_east_m2, ..., cov_north_roll_m_deg, ..., cov_yaw_yaw_deg2
                                            upper triangle of the covariance, 21 numbers with some
                                            12 digits; with fewer, a covariance with strong
                                            correlations may round to a matrix that is none

With latitude and longitude, attitude and covariance are relative to north, east and down at the
aircraft, as a navigation filter writes them. Reading turns them into the frame of the origin.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from radar_sense.covariance import first_problem
from radar_sense.errors import InputError
from radar_sense.limits import DEG, Limit
from radar_sense.model import geodesy
from radar_sense.model.track import (
    ATTITUDE_COLUMNS,
    attitude_of_motion,
    motion_of_samples,
    turn_to_origin,
)
from radar_sense.model.trajectory import MAX_ROWS, MIN_STEP, Route
from radar_sense.reading.csv_reader import Block, Column, Format, Header, read_csv
from radar_sense.states import AIRCRAFT, POSITION, FloatArray

#: A million rows of 28 numbers with 17 digits each are 0.7 GB.
MAX_BYTES = 2**30
_NED = AIRCRAFT[POSITION]
_GEODETIC = ("latitude_deg", "longitude_deg", "altitude_m")
_UNITS = ("m",) * 3 + ("deg",) * 3
_STD = tuple(f"std_{name}_{unit}" for name, unit in zip(AIRCRAFT, _UNITS, strict=True))
_UPPER = tuple((i, j) for i in range(6) for j in range(i, 6))
_COV = tuple(
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
    "time_s; north_m, east_m, down_m (or _km), or latitude_deg, longitude_deg, altitude_m; "
    "roll_deg, pitch_deg, yaw_deg; std_north_m to std_yaw_deg, "
    "or cov_north_north_m2 to cov_yaw_yaw_deg2"
)


def _within(low: float, high: float, unit: float = 1.0) -> Column:
    return Column(Limit(at_least=low, at_most=high), unit)


_COLUMNS: dict[str, Column] = {
    "time_s": _within(-1e12, 1e12),
    **{f"{axis}_m": _within(-_FAR, _FAR) for axis in _NED},
    **{f"{axis}_km": _within(-_FAR / 1e3, _FAR / 1e3, 1e3) for axis in _NED},
    "latitude_deg": _within(-90.0, 90.0, DEG),
    "longitude_deg": _within(-180.0, 360.0, DEG),
    "altitude_m": _within(-10e3, _FAR),
    "roll_deg": _within(-_TURN, _TURN, DEG),
    "pitch_deg": _within(-90.0, 90.0, DEG),
    "yaw_deg": _within(-_TURN, _TURN, DEG),
    **{name: _within(0.0, most) for name, most in zip(_STD, _STD_LIMITS, strict=True)},
    **{
        name: _within(
            0.0 if i == j else -_STD_LIMITS[i] * _STD_LIMITS[j], _STD_LIMITS[i] * _STD_LIMITS[j]
        )
        for name, (i, j) in zip(_COV, _UPPER, strict=True)
    },
}
_FORMAT = Format("a route file", _COLUMNS, _ALLOWED, MAX_BYTES, MAX_ROWS)


def load_route(
    path: str | Path,
    *,
    origin: tuple[float, float, float] | None = None,
    max_gap_s: float | None = None,
) -> Route:
    """Read and check a route file.

    Args:
        path: The file, in the format described at the top of `reading.route_file`.
        origin: Latitude, longitude [rad] and height above the ellipsoid [m] of the origin of the
            north-east-down frame. A file in latitude and longitude needs an origin, any other file
            must have none.
        max_gap_s: Longest time step allowed [s]; None allows any.

    Raises:
        InputError: If the origin is no place, or if the file cannot be read or holds anything that
            is not allowed.
    """
    route, _ = read_route(path, origin=origin, max_gap_s=max_gap_s)
    return route


def read_route(
    path: str | Path,
    *,
    origin: tuple[float, float, float] | None = None,
    max_gap_s: float | None = None,
    sha256: str | None = None,
) -> tuple[Route, str]:
    """Read a route file as `load_route` does, and return the SHA-256 of its bytes too.

    Args:
        path: The file.
        origin: As in `load_route`.
        max_gap_s: As in `load_route`.
        sha256: Digest that the file must have; None allows any.

    Raises:
        InputError: As in `load_route`.
    """
    source = str(path)
    if origin is not None and not geodesy.is_place(origin):
        raise InputError(
            f"origin must be latitude and longitude [rad] and height [m], got {origin!r}"
        )
    if max_gap_s is not None and not max_gap_s > 0:
        raise InputError(f"max_gap_s must be a number greater than 0, got {max_gap_s}")
    checks = _Checks(max_gap_s)
    table = read_csv(
        path, _FORMAT, check_header=checks.header, check_block=checks.block, sha256=sha256
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
    position = place if origin is None else geodesy.ned_from_geodetic(place, origin)
    if attitude is None:
        if len(time) < 2:
            raise InputError(
                f"{source}: has 1 row; attitude from the track needs 2 or more, "
                f"or the columns {', '.join(ATTITUDE_COLUMNS)}"
            )
        velocity, acceleration = motion_of_samples(time, position)
        attitude = attitude_of_motion(source, place, velocity, acceleration, origin)
    if origin is not None:
        attitude = turn_to_origin(source, time, place, attitude, covariance, origin)
    aircraft = np.hstack([position, attitude])
    given = layout.attitude is not None
    return Route(time, aircraft, covariance, given, origin), table.sha256


@dataclass(frozen=True)
class _Layout:
    """Indices of the columns."""

    names: tuple[str, ...]
    time: int
    position: list[int]
    geodetic: bool
    attitude: list[int] | None
    std: list[int] | None
    cov: list[int] | None

    def units(self, columns: Sequence[int]) -> FloatArray:
        """Return the SI value of the units of some columns."""
        return np.array([_COLUMNS[self.names[column]].unit for column in columns])


class _Checks:
    """Checks of a route from row to row, while the file is read.

    Attributes:
        layout: The columns, once the header has been checked.
    """

    layout: _Layout

    def __init__(self, max_gap_s: float | None) -> None:
        self._max_gap_s, self._last_time = max_gap_s, -math.inf

    def header(self, header: Header) -> None:
        """Keep the layout of the columns."""
        self.layout = _layout(header)

    def block(self, block: Block) -> None:
        """Check times and covariances, and set covariances of pure rounding to 0."""
        time = block.rows[:, self.layout.time]
        _check_times(time, self._last_time, self._max_gap_s, block)
        self._last_time = float(time[-1])
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
    """Return time, place, attitude and covariance in SI units, and empty the list of blocks."""
    count = sum(len(block) for block in blocks)
    time, place = np.empty(count), np.empty((count, 3))
    attitude = np.empty((count, 3)) if layout.attitude else None
    covariance = np.zeros((count, 6, 6)) if layout.std or layout.cov else None
    stop = count
    # From the last block on: the C library can only return the memory allocated last.
    while blocks:
        rows = blocks.pop()
        some = slice(stop - len(rows), stop)
        time[some] = rows[:, layout.time]
        place[some] = rows[:, layout.position] * layout.units(layout.position)
        if layout.attitude and attitude is not None:
            attitude[some] = rows[:, layout.attitude] * layout.units(layout.attitude)
        if layout.std and covariance is not None:
            diagonal = np.arange(6)
            covariance[some, diagonal, diagonal] = (rows[:, layout.std] * _COV_UNITS) ** 2
        if layout.cov and covariance is not None:
            covariance[some] = rows[:, layout.cov][:, _ENTRY] * np.outer(_COV_UNITS, _COV_UNITS)
        stop -= len(rows)
    return time, place, attitude, covariance


def _layout(header: Header) -> _Layout:
    """Return the layout of the columns."""
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
        given = [name for name in (f"{axis}_m", f"{axis}_km") if name in names]
        if len(given) > 1:
            raise header.error(f"has {' and '.join(given)}; allowed is one of them")
        ned.append(given[0] if given else f"{axis}_m")
    geodetic = bool(set(_GEODETIC) & set(names))
    if geodetic and set(ned) & set(names):
        raise header.error(
            "has north, east, down beside latitude, longitude, altitude; allowed is one or other"
        )
    position = _GEODETIC if geodetic else tuple(ned)
    layout = _Layout(
        names=names,
        time=indices(["time_s"], "which is always required")[0],
        position=indices(position, f"required are {', '.join(_GEODETIC)}, or north, east, down"),
        geodetic=geodetic,
        attitude=optional(ATTITUDE_COLUMNS),
        std=optional(_STD),
        cov=optional(_COV),
    )
    if layout.std and layout.cov:
        raise header.error(f"has {_STD[0]} beside {_COV[0]}; allowed is one or other")
    return layout


def _check_times(time: FloatArray, before: float, max_gap_s: float | None, block: Block) -> None:
    steps = np.diff(time, prepend=before)
    backwards = steps < MIN_STEP
    if backwards.any():
        row = int(np.argmax(backwards))
        earlier = float(time[row - 1]) if row else before
        enough = f", by {MIN_STEP:g} s or more" if steps[row] > 0 else ""
        raise block.error(
            row,
            f"time_s: must be later than {earlier!r}, "
            f"the time of the row before{enough}, got {float(time[row])!r}",
        )
    if max_gap_s is not None:
        gap = np.isfinite(steps) & (steps > max_gap_s)
        if gap.any():
            row = int(np.argmax(gap))
            raise block.error(
                row,
                f"time_s: must be within {max_gap_s:g} s of the row before, got {steps[row]:g} s",
            )
