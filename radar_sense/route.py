"""Paths of an aircraft from a file: one row per pose with its time, and how sure each pose is.

A route file is a table of comma-separated values (CSV) whose first line names the columns, units
included. Empty lines, and what follows a `#`, do not count. The columns, in any order:

    time_s                                  strictly increasing
    north_m, east_m, down_m                 or north_km, ...; or, instead of the three:
    latitude_deg, longitude_deg, altitude_m WGS-84; altitude is height above the ellipsoid, which
                                            differs from that above the sea by up to 107 m
    roll_deg, pitch_deg, yaw_deg            all or none; without them attitude follows the track
    std_north_m, std_east_m, std_down_m, std_roll_deg, std_pitch_deg, std_yaw_deg
                                            standard deviations of independent errors; or, instead:
    cov_north_north_m2, cov_north_east_m2, ..., cov_north_roll_m_deg, ..., cov_yaw_yaw_deg2
                                            the upper triangle of the covariance, 21 numbers,
                                            with 12 digits or so: rounding to fewer can make one
                                            with strong correlations no covariance any more

With latitude and longitude, attitude and covariance are those relative to north, east and down at
the aircraft, as a navigation filter writes them; they are turned into the frame of the origin.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from scipy.constants import g as STANDARD_GRAVITY  # noqa: N812 - a constant, 9.80665 m/s²

from radar_sense import wgs84
from radar_sense.covariance import first_problem, without_rounding
from radar_sense.limits import Limit
from radar_sense.reader import ScenarioError, did_you_mean
from radar_sense.states import AIRCRAFT, ATTITUDE, POSITION, FloatArray

MAX_ROWS = 1_000_000
#: A million rows of 28 numbers with 17 digits each are 0.7 GB.
MAX_BYTES = 2**30
#: Times nearer than this [s] are the same time, and would make speeds beyond any range.
MIN_STEP = 1e-9
#: Slower than this [m/s] an aircraft hovers: where it drifts says nothing of where its nose points.
HOVER = 0.1
#: How a route can be interpolated in time.
METHODS = ("legs", "smooth")

_READ_BYTES = 2**22
_MAX_LINE_BYTES = 2**16
#: Poses turned at a time, so that the matrices of all are never in memory at once.
_BLOCK = 2**14
#: Nearer than this [rad] to straight up or down, errors of yaw and roll grow more than 500-fold.
_STEEP = 0.002
#: Second differences of the altitude in a row that show the top of a curve.
_SHOWN = 5
#: A covariance below this is rounding of nothing, and its square would leave the range of floats.
_NOTHING = 1e-100

_DEG = np.pi / 180.0
_NUMBER = re.compile(rb"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
_NUMBER_BYTES = b"0123456789+-.eE, \t\n"
_NOT_FINITE = re.compile(r"[-+]?(inf|infinity|nan)", re.IGNORECASE)


@dataclass(frozen=True)
class _Column:
    """What a column may hold, and its unit in SI."""

    limit: Limit
    unit: float = 1.0


def _within(low: float, high: float, unit: float = 1.0) -> _Column:
    return _Column(Limit(at_least=low, at_most=high), unit)


_NED = AIRCRAFT[POSITION]
_GEODETIC = ("latitude_deg", "longitude_deg", "altitude_m")
_ATTITUDE = tuple(f"{name}_deg" for name in AIRCRAFT[ATTITUDE])
_UNITS = ("m",) * 3 + ("deg",) * 3
_STD = tuple(f"std_{name}_{unit}" for name, unit in zip(AIRCRAFT, _UNITS, strict=True))
_UPPER = tuple((i, j) for i in range(6) for j in range(i, 6))
_COV = tuple(
    f"cov_{AIRCRAFT[i]}_{AIRCRAFT[j]}_"
    + (f"{_UNITS[i]}2" if _UNITS[i] == _UNITS[j] else f"{_UNITS[i]}_{_UNITS[j]}")
    for i, j in _UPPER
)
#: Where each entry of the covariance stands among the 21.
_ENTRY = np.array([[_UPPER.index((min(i, j), max(i, j))) for j in range(6)] for i in range(6)])
_COV_UNITS = np.repeat([1.0, _DEG], 3)

#: Farther than any aircraft or satellite, 100 000 km, is a mistake in the units.
_FAR = 1e8
_TURN = 360.0
_STD_LIMITS = (_FAR,) * 3 + (_TURN,) * 3
_COLUMNS: dict[str, _Column] = {
    "time_s": _within(-1e12, 1e12),
    **{f"{axis}_m": _within(-_FAR, _FAR) for axis in _NED},
    **{f"{axis}_km": _within(-_FAR / 1e3, _FAR / 1e3, 1e3) for axis in _NED},
    "latitude_deg": _within(-90.0, 90.0, _DEG),
    "longitude_deg": _within(-180.0, 360.0, _DEG),
    "altitude_m": _within(-10e3, _FAR),
    "roll_deg": _within(-_TURN, _TURN, _DEG),
    "pitch_deg": _within(-90.0, 90.0, _DEG),
    "yaw_deg": _within(-_TURN, _TURN, _DEG),
    **{name: _within(0.0, most) for name, most in zip(_STD, _STD_LIMITS, strict=True)},
    **{
        name: _within(
            0.0 if i == j else -_STD_LIMITS[i] * _STD_LIMITS[j], _STD_LIMITS[i] * _STD_LIMITS[j]
        )
        for name, (i, j) in zip(_COV, _UPPER, strict=True)
    },
}
_ALLOWED = (
    "time_s; north_m, east_m, down_m (or _km), or latitude_deg, longitude_deg, altitude_m; "
    "roll_deg, pitch_deg, yaw_deg; std_north_m to std_yaw_deg, "
    "or cov_north_north_m2 to cov_yaw_yaw_deg2"
)


@dataclass(frozen=True, eq=False)
class Route:
    """The poses of an aircraft along a path, in SI units and radians, in one north-east-down frame.

    Attributes:
        time_s: Time of each pose (n,) [s], strictly increasing.
        aircraft: States (n, 6).
        covariance: C_aa of each pose (n, 6, 6), or None if the file says nothing of it.
        distance_m: Length of the path up to each pose (n,) [m], in space, pose to pose in straight
            lines.
        attitude_given: Whether attitude was in the file; else it was derived from the track.
        origin: Latitude, longitude [rad] and height above the ellipsoid [m] of the frame's origin,
            if the file was in latitude and longitude; else None, and level is the same everywhere.
    """

    time_s: FloatArray
    aircraft: FloatArray
    covariance: FloatArray | None
    distance_m: FloatArray
    attitude_given: bool
    origin: tuple[float, float, float] | None = None


def load_route(
    path: str | Path,
    *,
    origin: tuple[float, float, float] | None = None,
    max_gap_s: float | None = None,
) -> Route:
    """Read and check a route file.

    Args:
        path: The file; what may be in it is said at the top of this module.
        origin: Latitude, longitude [rad] and height above the ellipsoid [m] of the origin of the
            north-east-down frame; needed for a file with latitude and longitude, and only there.
        max_gap_s: The longest step of time allowed [s]; None allows any.

    Raises:
        ScenarioError: If the file cannot be read or anything in it is not allowed.
        ValueError: If the origin is no place.
    """
    source = str(path)
    if origin is not None and not (np.all(np.isfinite(origin)) and abs(origin[0]) <= np.pi / 2):
        raise ValueError(
            f"origin must be latitude and longitude [rad] and height [m], got {origin}"
        )
    if max_gap_s is not None and not max_gap_s > 0:
        raise ScenarioError(f"max_gap_s must be a number greater than 0, got {max_gap_s}")
    layout, blocks = _read(path, max_gap_s)
    if layout.geodetic and origin is None:
        raise ScenarioError(
            f"{source}:{layout.line}: latitude_deg: needs the origin of the north-east-down frame, "
            "geometry.origin in a scenario"
        )
    if not layout.geodetic and origin is not None:
        raise ScenarioError(
            f"{source}:{layout.line}: north, east and down are about an origin already, "
            "one in latitude and longitude has no use here"
        )
    time, place, attitude, covariance = _assemble(layout, blocks)
    position = place if origin is None else wgs84.ned_from_geodetic(place, origin)
    if attitude is None:
        if len(time) < 2:
            raise ScenarioError(
                f"{source}: has 1 row; attitude from the track needs 2 or more, "
                f"or the columns {', '.join(_ATTITUDE)}"
            )
        attitude = _attitude(source, place, *_motion(time, position), origin)
    if origin is not None:
        attitude = _to_origin(source, time, place, attitude, covariance, origin)
    return _route(time, position, attitude, covariance, layout.attitude is not None, origin)


def resample(route: Route, step_s: float, method: str = "legs") -> Route:
    """Interpolate a route in time.

    `legs` is for the waypoints of a planner: straight legs at constant velocity, the turns between
    them instantaneous (fly-by is not modelled). Attitude, where it is not given, is that of the
    leg, wings level; at a waypoint it is that of the leg that begins there. Between waypoints in
    latitude and longitude a leg follows the curve of the earth, its altitude linear in time.

    `smooth` is for samples of a flight, near enough to each other to show its turns: the cubic
    spline with continuous acceleration through all of them (C. de Boor, *A Practical Guide to
    Splines*, 1978, ch. IV, not-a-knot). Course, climb and bank are those of the spline itself. In
    latitude and longitude the spline is lifted to its altitude, as a leg is. Altitude stays between
    the altitudes of the two samples, unless the samples show the top of a curve (`_altitude`).

    Attitude that is given is turned from pose to pose about one axis at a constant rate (K.
    Shoemake, "Animating rotation with quaternion curves", SIGGRAPH 1985): unlike interpolated
    Euler angles that does not depend on the frame, and nothing happens to it near a pitch of 90° or
    a yaw of 180°. Covariances are interpolated linearly, which keeps them semidefinite.

    Args:
        route: The route.
        step_s: Step of time [s] from the first pose on. The last pose of the route is always there:
            the last interval may be shorter than a step.
        method: "legs" or "smooth".

    Raises:
        ScenarioError: If the step is not positive or makes too many poses, there is no such method,
            or no direction of flight can be found.
    """
    if method not in METHODS:
        raise ScenarioError(
            f"method must be one of {', '.join(METHODS)}, got {method!r}"
            + did_you_mean(method, METHODS)
        )
    time, last = times(route, step_s), float(route.time_s[-1])
    rounding = 1e-6 * min(step_s, last - float(route.time_s[0])) + 2.0 * np.spacing(abs(last))
    if last - time[-1] > rounding:
        time = np.append(time, last)
    time[-1] = last
    if len(time) > MAX_ROWS:
        raise _too_many(step_s)
    return interpolated(route, time, method)


def times(route: Route, step_s: float) -> FloatArray:
    """Times (n,) [s] at even steps from the first pose of a route on, to the last or before it.

    Raises:
        ScenarioError: If the step is not positive or makes too many of them.
    """
    first, last = float(route.time_s[0]), float(route.time_s[-1])
    # A step must be long enough to move the clock, whose floats are apart by some 1e-16 of it.
    shortest = max(MIN_STEP, 1e-15 * max(abs(first), abs(last)))
    if not (math.isfinite(step_s) and step_s >= shortest):
        raise ScenarioError(f"step_s must be a number not less than {shortest:g}, got {step_s}")
    # Rounding must not lose the last pose.
    steps = math.floor((last - first) / step_s * (1 + 1e-12) + 1e-9)
    if steps >= MAX_ROWS:
        raise _too_many(step_s)
    found: FloatArray = np.minimum(first + step_s * np.arange(steps + 1), last)
    return found


def _too_many(step_s: float) -> ScenarioError:
    return ScenarioError(f"step_s makes more than {MAX_ROWS:,} poses, got {step_s:g}")


def interpolated(route: Route, time: FloatArray, method: str = "legs") -> Route:
    """Interpolate a route, as `resample` says, at times (n,) [s] within its own, increasing.

    Raises:
        ScenarioError: If no direction of flight can be found.
    """
    if len(route.time_s) == 1:
        return route
    motion = _legs if method == "legs" else _smooth
    position, velocity, acceleration = motion(route, time)
    if route.attitude_given:
        from scipy.spatial.transform import Rotation, Slerp  # takes 0.25 s, and only this needs it

        given = Rotation.from_euler("ZYX", route.aircraft[:, :2:-1])  # yaw, pitch, roll
        to_ned = Slerp(route.time_s, given)(time).as_matrix()
        attitude = wgs84.euler_angles(np.swapaxes(to_ned, -1, -2))
    else:
        place = position
        if route.origin is not None:
            place = wgs84.geodetic_from_ned(position, route.origin)
        attitude = _attitude("route", place, velocity, acceleration, route.origin)
        if route.origin is not None:
            attitude = _to_origin("route", time, place, attitude, None, route.origin)
    covariance = None
    if route.covariance is not None:
        leg, part = _leg(route.time_s, time)
        covariance = np.empty((len(time), 6, 6))
        for some in _slices(len(time)):
            weight = part[some, np.newaxis, np.newaxis]
            before, after = route.covariance[leg[some]], route.covariance[leg[some] + 1]
            covariance[some] = (1.0 - weight) * before + weight * after
    return _route(time, position, attitude, covariance, route.attitude_given, route.origin)


def in_frame(
    covariance: FloatArray, time: FloatArray, aircraft: FloatArray, origin: tuple[float, ...]
) -> FloatArray:
    """C_aa of each pose (n, 6, 6) in the frame, from one relative to the level of the aircraft.

    Args:
        covariance: (6, 6), relative to north, east and down at the aircraft, wherever it is.
        time: Time of each pose (n,) [s], for an error.
        aircraft: States (n, 6) in the frame of the origin.
        origin: Latitude, longitude [rad] and height above the ellipsoid [m].

    Raises:
        ScenarioError: If the nose points straight up or down as the origin sees it.
    """
    place = wgs84.geodetic_from_ned(aircraft[:, POSITION], origin)
    attitude = np.empty_like(place)
    for some in _slices(len(place)):
        to_level = np.swapaxes(wgs84.turn_to_origin(place[some], origin), -1, -2)
        attitude[some] = wgs84.turned_attitude(aircraft[some, ATTITUDE], to_level)
    of_each = np.repeat(covariance[np.newaxis], len(place), axis=0)
    _to_origin("geometry", time, place, attitude, of_each, origin)
    return without_rounding(of_each)


def attitude_from_track(time: FloatArray, position: FloatArray) -> FloatArray:
    """Attitude of an aircraft that flies where its nose points and banks into its turns.

    See `attitude_from_motion` for what is assumed. Velocity and acceleration come from the samples:
    the derivative of the parabola through a sample and its two neighbours; and twice the second
    divided difference of three samples, which is the acceleration at the mean of their three times,
    carried to the time of the sample along a straight line. Both have errors of second order in the
    step of time, even or not. At the ends the nearest parabola and line are continued.

    Positions rounded to δ make the acceleration wrong by some 2δ/h² at steps h: rows that are close
    in time need positions with many digits, or attitude in the file.

    Args:
        time: (n,) [s], strictly increasing, n ≥ 2.
        position: North, east, down (n, 3) [m].

    Returns:
        Roll, pitch, yaw (n, 3) [rad].

    Raises:
        ValueError: If there is no horizontal motion anywhere.
    """
    return attitude_from_motion(*_motion(time, position))


def attitude_from_motion(velocity: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Attitude of coordinated flight without wind or angle of attack.

    With V_h the horizontal speed: yaw is the course χ = atan2(v_e, v_n); pitch is the angle of
    climb, atan2(−v_d, V_h); roll is the bank of a coordinated turn, tan φ = V_h χ̇ / g (R. W. Beard
    and T. W. McLain, *Small Unmanned Aircraft*, 2012, ch. 9, with χ = ψ), where
    V_h χ̇ = (v_n a_e − v_e a_n)/V_h is the acceleration to the right.

    Slower than `HOVER` over ground there is no course: the last one before is kept (before the
    first, the first is taken), and the wings are level. Standing still, so is the nose.

    Args:
        velocity: North, east, down (n, 3) [m/s], in the order of time.
        acceleration: The same (n, 3) [m/s²].

    Returns:
        Roll, pitch, yaw (n, 3) [rad].

    Raises:
        ValueError: If there is no horizontal motion anywhere.
    """
    north, east, down = (velocity[:, i] for i in range(3))
    speed = np.hypot(north, east)
    moves = speed >= HOVER
    if not moves.any():
        raise ValueError(f"never moves horizontally at {HOVER:g} m/s or more")
    known = np.maximum.accumulate(np.where(moves, np.arange(len(speed)), -1))
    known[known < 0] = np.argmax(moves)
    yaw = np.arctan2(east, north)[known]
    pitch = np.where(np.hypot(speed, down) >= HOVER, np.arctan2(-down, speed), 0.0)
    to_the_right = north * acceleration[:, 1] - east * acceleration[:, 0]
    roll = np.arctan(to_the_right / (STANDARD_GRAVITY * np.where(moves, speed, np.inf)))
    return np.stack([roll, pitch, yaw], axis=-1)


def _motion(time: FloatArray, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Velocity [m/s] and acceleration [m/s²] (n, 3) of samples, as `attitude_from_track` says."""
    if len(time) == 2:
        velocity = np.diff(position, axis=0) / np.diff(time)[:, np.newaxis]
        return np.repeat(velocity, 2, axis=0), np.zeros((2, 3))
    velocity = np.gradient(position, time, axis=0, edge_order=2)
    slope = np.diff(position, axis=0) / np.diff(time)[:, np.newaxis]
    second = 2.0 * np.diff(slope, axis=0) / (time[2:] - time[:-2])[:, np.newaxis]
    if len(second) == 1:
        return velocity, np.repeat(second, 3, axis=0)
    step = np.diff(time)
    off = (step[1:] - step[:-1]) / 3.0  # from the middle one of three times to the mean of them
    apart = (step[:-2] + step[1:-1] + step[2:]) / 3.0  # from the mean of three to the next mean
    slope = np.diff(second, axis=0) / apart[:, np.newaxis]
    # Second i belongs to row i + 1. If its time is later than the row's, the line comes from the
    # second before it, else it leads to the one after it; there is only one of them at the ends.
    rows = np.arange(len(second))
    line = np.clip(np.where(off > 0, rows - 1, rows), 0, len(slope) - 1)
    inner = second - off[:, np.newaxis] * slope[line]
    first = second[0] - (step[0] + off[0]) * slope[0]
    last = second[-1] + (step[-1] - off[-1]) * slope[-1]
    return velocity, np.concatenate([first[np.newaxis], inner, last[np.newaxis]])


def _attitude(
    source: str,
    place: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    origin: tuple[float, float, float] | None,
) -> FloatArray:
    """Attitude from motion, relative to the level of the aircraft wherever it is."""
    if origin is not None:
        velocity, acceleration = velocity.copy(), acceleration.copy()
        for some in _slices(len(place)):
            turn = wgs84.turn_to_origin(place[some], origin)
            for vectors in (velocity, acceleration):
                vectors[some] = np.einsum("...ij,...i->...j", turn, vectors[some])
    try:
        return attitude_from_motion(velocity, acceleration)
    except ValueError as error:
        raise ScenarioError(
            f"{source}: the aircraft {error}, attitude cannot be derived from the track; "
            f"give the columns {', '.join(_ATTITUDE)}"
        ) from error


def _to_origin(
    source: str,
    time: FloatArray,
    place: FloatArray,
    attitude: FloatArray,
    covariance: FloatArray | None,
    origin: tuple[float, ...],
) -> FloatArray:
    """Turn attitudes from the level of the aircraft to that of the origin; covariances in place.

    That level turns a little with an error of position is left out: 100 m are 0.001°.
    """
    turned = np.empty_like(attitude)
    for some in _slices(len(attitude)):
        turn = wgs84.turn_to_origin(place[some], origin)
        turned[some] = wgs84.turned_attitude(attitude[some], turn)
        if covariance is None:
            continue
        part = covariance[some]
        uncertain = np.any(part[:, ATTITUDE, ATTITUDE] != 0, axis=(-2, -1))
        steep = uncertain & (np.abs(turned[some, 1]) > np.pi / 2 - _STEEP)
        if steep.any():
            raise ScenarioError(
                f"{source}: at time_s {float(time[some][steep][0])!r} the aircraft's nose points "
                "straight up or down as the origin sees it, where roll and yaw have no covariance"
            )
        jacobian = np.zeros_like(part)
        jacobian[:, POSITION, POSITION] = turn
        # Where attitude is certain nothing is carried over, and the pitch may be anything.
        jacobian[uncertain, ATTITUDE, ATTITUDE] = wgs84.turned_attitude_jacobian(
            attitude[some][uncertain], turned[some][uncertain]
        )
        part = jacobian @ part @ np.swapaxes(jacobian, -1, -2)
        part = 0.5 * (part + np.swapaxes(part, -1, -2))
        # Where the sum of positive and negative terms should be no variance it may round to less.
        certain = np.diagonal(part, axis1=-2, axis2=-1) <= 0
        part[certain[:, :, np.newaxis] | certain[:, np.newaxis, :]] = 0.0
        covariance[some] = part
    return turned


def _route(
    time: FloatArray,
    position: FloatArray,
    attitude: FloatArray,
    covariance: FloatArray | None,
    attitude_given: bool,
    origin: tuple[float, float, float] | None,
) -> Route:
    legs = np.sqrt(np.sum(np.diff(position, axis=0) ** 2, axis=-1))
    distance = np.concatenate([[0.0], np.cumsum(legs)])
    route = Route(
        time, np.hstack([position, attitude]), covariance, distance, attitude_given, origin
    )
    for array in (route.time_s, route.aircraft, route.covariance, route.distance_m):
        if array is not None:
            array.flags.writeable = False
    return route


def _leg(times: FloatArray, at: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
    """Which leg each time is on, and how far along it, from 0 to 1."""
    leg = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    return leg, (at - times[leg]) / (times[leg + 1] - times[leg])


def _legs(route: Route, at: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, velocity and acceleration (n, 3) on straight legs flown at constant velocity."""
    leg, part = _leg(route.time_s, at)
    waypoints = route.aircraft[:, POSITION]
    velocity = np.diff(waypoints, axis=0) / np.diff(route.time_s)[:, np.newaxis]
    velocity = velocity[leg]
    position = waypoints[leg] + velocity * (at - route.time_s[leg])[:, np.newaxis]
    acceleration = np.zeros_like(velocity)
    if route.origin is not None:
        height = wgs84.geodetic_from_ned(waypoints, route.origin)[:, 2]
        climb = (np.diff(height) / np.diff(route.time_s))[leg]
        height = height[leg] + part * (height[leg + 1] - height[leg])
        position = _lifted(position, height, climb, velocity, acceleration, route.origin)
    return position, velocity, acceleration


def _smooth(route: Route, at: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, velocity and horizontal acceleration (n, 3) on the cubic spline."""
    from scipy.interpolate import CubicSpline  # takes 0.3 s, and only this needs it

    waypoints = route.aircraft[:, POSITION]
    spline = CubicSpline(route.time_s, waypoints)
    position, velocity, acceleration = (spline(at, order) for order in range(3))
    if route.origin is None:
        height, climb = _altitude(route.time_s, -waypoints[:, 2], at)
        position[:, 2], velocity[:, 2] = -height, -climb
    else:
        height = wgs84.geodetic_from_ned(waypoints, route.origin)[:, 2]
        height, climb = _altitude(route.time_s, height, at)
        position = _lifted(position, height, climb, velocity, acceleration, route.origin)
    return position, velocity, acceleration


def _lifted(
    position: FloatArray,
    height: FloatArray,
    climb: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    origin: tuple[float, float, float],
) -> FloatArray:
    """Positions (n, 3) at a height above the ellipsoid; changes velocity and acceleration in place.

    A line or a spline between waypoints is a tunnel through the earth. Each of its points keeps its
    latitude and longitude. Speed over ground grows with the distance from the centre of the earth.

    Args:
        position: Positions in the tunnel (n, 3) [m].
        height: Height above the ellipsoid (n,) [m].
        climb: Its rate of change (n,) [m/s].
        velocity: Velocity in the tunnel (n, 3) [m/s].
        acceleration: Acceleration there (n, 3) [m/s²]; only its horizontal part is scaled and used.
        origin: Of the north-east-down frame.
    """
    place = wgs84.geodetic_from_ned(position, origin)
    grows = (wgs84.SEMI_MAJOR + height) / (wgs84.SEMI_MAJOR + place[:, 2])
    place[:, 2] = height
    for some in _slices(len(place)):
        down = wgs84.turn_to_origin(place[some], origin)[..., 2]
        sinks = np.sum(velocity[some] * down, axis=-1)
        level = velocity[some] - sinks[:, np.newaxis] * down
        velocity[some] = grows[some, np.newaxis] * level - climb[some, np.newaxis] * down
    acceleration *= grows[:, np.newaxis]
    return wgs84.ned_from_geodetic(place, origin)


def _altitude(
    time: FloatArray, height: FloatArray, at: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Height [m] and rate of climb [m/s] (n,) between samples of the height.

    The result is a cubic Hermite spline. Its slopes at the samples are those of the cubic spline,
    limited so that the height is monotone between two samples (F. N. Fritsch and R. E. Carlson,
    "Monotone piecewise cubic interpolation", SIAM J. Numer. Anal. 17(2), 1980): not more than three
    times the slope to either neighbour, and 0 where these have different signs.

    A limit of 0 would flatten a top that the samples show. The limits do not apply where five
    second differences in a row have one sign and are within a factor of two of each other. That
    takes more than some 15 samples for a period of a wave.
    """
    from scipy.interpolate import CubicHermiteSpline, CubicSpline  # takes 0.3 s

    slope = np.diff(height) / np.diff(time)
    before, after = np.append(slope[0], slope), np.append(slope, slope[-1])
    rate = CubicSpline(time, height)(time, 1)
    most = 3.0 * np.minimum(abs(before), abs(after))
    same = (before * after > 0) & (rate * after > 0)
    limited = np.where(same, np.clip(rate, -most, most), 0.0)
    if len(time) > _SHOWN + 1:
        bend = np.diff(slope) / (time[2:] - time[:-2])
        near = np.lib.stride_tricks.sliding_window_view(bend, _SHOWN)
        low, high = near.min(axis=-1), near.max(axis=-1)
        shown = ((low > 0) & (high <= 2.0 * low)) | ((high < 0) & (low >= 2.0 * high))
        inner = slice(_SHOWN // 2 + 1, -(_SHOWN // 2 + 1))
        limited[inner] = np.where(shown, rate[inner], limited[inner])
    spline = CubicHermiteSpline(time, height, limited)
    return spline(at), spline(at, 1)


def _slices(count: int) -> Iterator[slice]:
    for start in range(0, count, _BLOCK):
        yield slice(start, start + _BLOCK)


# Reading.


@dataclass(frozen=True)
class _Layout:
    """Which column of the file holds what: indices."""

    names: tuple[str, ...]
    line: int
    time: int
    position: list[int]
    geodetic: bool
    attitude: list[int] | None
    std: list[int] | None
    cov: list[int] | None

    def units(self, columns: Sequence[int]) -> FloatArray:
        return np.array([_COLUMNS[self.names[column]].unit for column in columns])


def _assemble(
    layout: _Layout, blocks: list[FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray | None, FloatArray | None]:
    """Time, place, attitude and covariance out of the rows; these are dropped on the way."""
    count = sum(len(block) for block in blocks)
    time, place = np.empty(count), np.empty((count, 3))
    attitude = np.empty((count, 3)) if layout.attitude else None
    covariance = np.zeros((count, 6, 6)) if layout.std or layout.cov else None
    stop = count
    # From the last to the first: memory that was taken last can be given back first.
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


def _read(path: str | Path, max_gap_s: float | None) -> tuple[_Layout, list[FloatArray]]:
    """Read and check all rows, in the units of the file."""
    layout: _Layout | None = None
    blocks: list[FloatArray] = []
    count, before = 0, -math.inf
    for text in _texts(path):
        if layout is None:
            for line, content in text.lines():
                layout = _layout(content, text.source, line)
                break
            if layout is None:
                continue
            text = text.after(layout.line)
        rows = _numbers(text, layout)
        _check_limits(rows, text, layout)
        if count + len(rows) > MAX_ROWS:
            raise text.error(MAX_ROWS - count, f"has more than {MAX_ROWS:,} rows")
        if len(rows):
            _check_times(rows[:, layout.time], before, max_gap_s, text)
            count, before = count + len(rows), float(rows[-1, layout.time])
            blocks.append(rows)
        if layout.cov:
            numbers = rows[:, layout.cov]
            numbers[np.abs(numbers) < _NOTHING] = 0.0
            rows[:, layout.cov] = numbers
            bad = first_problem(numbers[:, _ENTRY])
            if bad:
                raise text.error(bad[0], f"covariance {bad[1]}")
    if layout is None:
        raise ScenarioError(f"{path}: is empty; the first line must name the columns: {_ALLOWED}")
    if not blocks:
        raise ScenarioError(f"{path}: has no rows below the names of its columns")
    return layout, blocks


@dataclass(frozen=True)
class _Text:
    """Whole lines of the file, without comments, and the number of the first."""

    source: str
    first_line: int
    content: bytes

    def lines(self) -> Iterator[tuple[int, str]]:
        """The lines that are not empty, with their numbers."""
        for line, content in enumerate(self.content.split(b"\n"), start=self.first_line):
            if content.strip():
                yield line, content.decode("utf-8").strip()

    def after(self, line: int) -> _Text:
        """The text below a line."""
        above = line + 1 - self.first_line
        pieces = self.content.split(b"\n", above)
        return replace(self, first_line=line + 1, content=b"".join(pieces[above:]))

    def row(self, index: int) -> tuple[int, list[str]]:
        """Number and cells of the line that holds a row."""
        line, content = next(found for i, found in enumerate(self.lines()) if i == index)
        return line, [cell.strip() for cell in content.split(",")]

    def error(self, row: int, message: str) -> ScenarioError:
        return ScenarioError(f"{self.source}:{self.row(row)[0]}: {message}")


def _texts(path: str | Path) -> Iterator[_Text]:
    """Read a file piece by piece.

    Raises:
        ScenarioError: If it cannot be read, is too large, or is not UTF-8 text.
    """
    try:
        with Path(path).open("rb") as file:
            for line, content in _pieces(file, str(path)):
                yield _Text(str(path), line, _without_comments(content, str(path), line))
    except IsADirectoryError as error:
        raise ScenarioError(f"{path}: is a directory, not a route file") from error
    except ScenarioError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte in it
        reason = getattr(error, "strerror", None) or error
        raise ScenarioError(f"{path}: cannot be read: {reason}") from error


def _pieces(file: BinaryIO, source: str) -> Iterator[tuple[int, bytes]]:
    """Whole lines, some megabytes at a time, with the number of the first."""
    line, size, rest = 1, 0, b""
    while data := file.read(_READ_BYTES):
        size += len(data)
        if size > MAX_BYTES:
            raise ScenarioError(f"{source}: is larger than {MAX_BYTES // 2**20} MiB")
        data = rest + data
        if line == 1:
            data = data.removeprefix(b"\xef\xbb\xbf")  # a byte order mark
        cut = data.rfind(b"\n") + 1
        data, rest = data[:cut], data[cut:]
        if data:
            yield line, data
            line += data.count(b"\n")
        if len(rest) > _MAX_LINE_BYTES:
            raise ScenarioError(f"{source}:{line}: is longer than {_MAX_LINE_BYTES} bytes")
    if rest:
        yield line, rest


def _without_comments(content: bytes, source: str, line: int) -> bytes:
    if not content.isascii():
        try:
            content.decode("utf-8")
        except UnicodeDecodeError as error:
            line += content[: error.start].count(b"\n")
            raise ScenarioError(
                f"{source}:{line}: is not UTF-8 text: byte 0x{content[error.start]:02x}"
            ) from error
    content = content.replace(b"\r\n", b"\n")
    return re.sub(rb"#[^\n]*", b"", content) if b"#" in content else content


def _layout(header: str, source: str, line: int) -> _Layout:
    """Find out what the columns are from the line that names them."""
    place = f"{source}:{line}"
    names = tuple(name.strip() for name in header.split(","))
    for i, name in enumerate(names):
        if name not in _COLUMNS:
            raise ScenarioError(
                f"{place}: unknown column {_shorten(name)}, allowed: {_ALLOWED}"
                + did_you_mean(name[:100], set(_COLUMNS) - set(names))
                + ("; columns are separated by commas" if re.search("[;\t]", name) else "")
                + ("; the first line must name the columns" if _is_number(names[0]) else "")
            )
        if name in names[:i]:
            raise ScenarioError(f"{place}: duplicate column '{name}'")

    def indices(wanted: Sequence[str], why: str) -> list[int]:
        missing = [name for name in wanted if name not in names]
        if missing:
            raise ScenarioError(f"{place}: missing column '{missing[0]}', {why}")
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
            raise ScenarioError(f"{place}: has {' and '.join(given)}; allowed is one of them")
        ned.append(given[0] if given else f"{axis}_m")
    geodetic = bool(set(_GEODETIC) & set(names))
    if geodetic and set(ned) & set(names):
        raise ScenarioError(
            f"{place}: has north, east, down beside latitude, longitude, altitude; "
            "allowed is one or other"
        )
    position = _GEODETIC if geodetic else tuple(ned)
    layout = _Layout(
        names=names,
        line=line,
        time=indices(["time_s"], "which is always required")[0],
        position=indices(position, f"required are {', '.join(_GEODETIC)}, or north, east, down"),
        geodetic=geodetic,
        attitude=optional(_ATTITUDE),
        std=optional(_STD),
        cov=optional(_COV),
    )
    if layout.std and layout.cov:
        raise ScenarioError(f"{place}: has {_STD[0]} beside {_COV[0]}; allowed is one or other")
    return layout


def _numbers(text: _Text, layout: _Layout) -> FloatArray:
    """All numbers of a text (rows, columns): at once, and if that fails one by one to see why."""
    # Nothing but plain numbers gets to NumPy, which would take other things for numbers too.
    if text.content.strip() and not text.content.translate(None, delete=_NUMBER_BYTES):
        try:
            lines = text.content.decode("ascii").split("\n")
            rows = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)
        except ValueError:
            rows = np.empty((0, 0))
        if rows.shape[-1] == len(layout.names):
            return rows
    slowly = []
    for line, content in text.lines():
        place = f"{text.source}:{line}"
        cells = [cell.strip() for cell in content.split(",")]
        if len(cells) != len(layout.names):
            raise ScenarioError(
                f"{place}: must have {len(layout.names)} values, one for each column, "
                f"got {len(cells)}"
            )
        for name, cell in zip(layout.names, cells, strict=True):
            if _NOT_FINITE.fullmatch(cell):
                raise ScenarioError(f"{place}: {name}: must be finite, got {cell}")
            if not _is_number(cell):
                raise _wrong(place, name, cell)
        slowly.append([float(cell) for cell in cells])
    return np.array(slowly, dtype=float).reshape(-1, len(layout.names))


def _check_limits(rows: FloatArray, text: _Text, layout: _Layout) -> None:
    limits = [_COLUMNS[name].limit for name in layout.names]
    low, high = (
        np.array([getattr(limit, end) for limit in limits]) for end in ("at_least", "at_most")
    )
    if rows.size and not (np.all(rows.min(axis=0) >= low) and np.all(rows.max(axis=0) <= high)):
        row, column = np.argwhere((rows < low) | (rows > high))[0]
        line, cells = text.row(row)
        raise _wrong(f"{text.source}:{line}", layout.names[column], cells[column])


def _check_times(times: FloatArray, before: float, max_gap_s: float | None, text: _Text) -> None:
    steps = np.diff(times, prepend=before)
    backwards = steps < MIN_STEP
    if backwards.any():
        row = int(np.argmax(backwards))
        line, _ = text.row(row)
        earlier = float(times[row - 1]) if row else before
        enough = f", by {MIN_STEP:g} s or more" if steps[row] > 0 else ""
        raise ScenarioError(
            f"{text.source}:{line}: time_s: must be later than {earlier!r}, "
            f"the time of the row before{enough}, got {float(times[row])!r}"
        )
    if max_gap_s is not None:
        gap = np.isfinite(steps) & (steps > max_gap_s)
        if gap.any():
            row = int(np.argmax(gap))
            raise text.error(
                row,
                f"time_s: must be within {max_gap_s:g} s of the row before, got {steps[row]:g} s",
            )


def _wrong(place: str, name: str, cell: str) -> ScenarioError:
    got = (
        "nothing" if not cell else cell if _is_number(cell) and len(cell) <= 40 else _shorten(cell)
    )
    return ScenarioError(f"{place}: {name}: must be {_COLUMNS[name].limit}, got {got}")


def _is_number(cell: str) -> bool:
    return bool(_NUMBER.fullmatch(cell.encode()))


def _shorten(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:37] + "...")
