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
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.constants import g as gravity

from radar_sense.covariance import without_rounding
from radar_sense.errors import InputError, did_you_mean
from radar_sense.model import geodesy as wgs84
from radar_sense.states import AIRCRAFT, ATTITUDE, POSITION, FloatArray

MAX_ROWS = 1_000_000
#: Times nearer than this [s] are the same time, and would make speeds beyond any range.
MIN_STEP = 1e-9
#: Slower than this [m/s] an aircraft hovers: where it drifts says nothing of where its nose points.
HOVER = 0.1
#: How a route can be interpolated in time.
METHODS = ("legs", "smooth")
#: Poses turned at a time, so that the matrices of all are never in memory at once.
_BLOCK = 2**14
#: Nearer than this [rad] to straight up or down, errors of yaw and roll grow more than 500-fold.
_STEEP = 0.002
#: Second differences of the altitude in a row that show the top of a curve.
_SHOWN = 5
#: A covariance below this is rounding of nothing, and its square would leave the range of floats.
_NOTHING = 1e-100
_ATTITUDE = tuple(f"{name}_deg" for name in AIRCRAFT[ATTITUDE])


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
        InputError: If the step is not positive or makes too many poses, there is no such method,
            or no direction of flight can be found.
    """
    if method not in METHODS:
        raise InputError(
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
        InputError: If the step is not positive or makes too many of them.
    """
    first, last = float(route.time_s[0]), float(route.time_s[-1])
    # A step must be long enough to move the clock, whose floats are apart by some 1e-16 of it.
    shortest = max(MIN_STEP, 1e-15 * max(abs(first), abs(last)))
    if not (math.isfinite(step_s) and step_s >= shortest):
        raise InputError(f"step_s must be a number not less than {shortest:g}, got {step_s}")
    # Rounding must not lose the last pose.
    steps = math.floor((last - first) / step_s * (1 + 1e-12) + 1e-9)
    if steps >= MAX_ROWS:
        raise _too_many(step_s)
    found: FloatArray = np.minimum(first + step_s * np.arange(steps + 1), last)
    return found


def _too_many(step_s: float) -> InputError:
    return InputError(f"step_s makes more than {MAX_ROWS:,} poses, got {step_s:g}")


def interpolated(route: Route, time: FloatArray, method: str = "legs") -> Route:
    """Interpolate a route, as `resample` says, at times (n,) [s] within its own, increasing.

    Raises:
        InputError: If no direction of flight can be found.
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
        InputError: If the nose points straight up or down as the origin sees it.
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
    roll = np.arctan(to_the_right / (gravity * np.where(moves, speed, np.inf)))
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
        raise InputError(
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
            raise InputError(
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
