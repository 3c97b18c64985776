"""The route of an aircraft, and its interpolation in time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from radar_sense.errors import InputError, check_choice
from radar_sense.model import geodesy
from radar_sense.model.track import (
    attitude_from_motion,
    hovering,
    largest_climb,
    over_ground,
    velocity_on_legs,
)
from radar_sense.states import DOWN, POSITION, FloatArray, ReadOnly, read_only, slices

if TYPE_CHECKING:
    from scipy.interpolate import CubicHermiteSpline
    from scipy.spatial.transform import Slerp

#: Most poses of a route.
MAX_ROWS = 1_000_000
#: Times nearer than this [s] count as equal. Nearer times would make speeds beyond any range.
MIN_STEP = 1e-9
#: How a route can be interpolated in time.
METHODS = ("legs", "smooth")
#: Number of consecutive second differences of the altitude that show the top of a curve.
_TOP_DIFFERENCES = 5
#: Cosine that is 0 but for rounding.
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Route(ReadOnly):
    """The poses of an aircraft along a path, in SI units and radians, in one north-east-down frame.

    Its arrays are read-only.

    Attributes:
        time_s: Time of each pose (n,) [s], strictly increasing.
        aircraft: States (n, 6).
        covariance: C_aa of each pose (n, 6, 6), relative to north, east and down at the aircraft,
            or None if the route has none.
        attitude_given: Whether attitude was given, and not derived from the track.
        origin: Latitude, longitude [rad] and height above the ellipsoid [m] of the frame's origin,
            for a route in latitude and longitude. None for any other route, with the same level
            everywhere.
    """

    time_s: FloatArray
    aircraft: FloatArray
    covariance: FloatArray | None
    attitude_given: bool
    origin: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("time_s", "aircraft", "covariance"):
            if (values := getattr(self, name)) is not None:
                object.__setattr__(self, name, read_only(name, values))

    def __repr__(self) -> str:
        return (
            f"<Route: {len(self.time_s)} poses, time {self.time_s[0]:.13g} "
            f"to {self.time_s[-1]:.13g} s>"
        )

    @cached_property
    def down(self) -> FloatArray | None:
        """Down at each pose (n, 3) in the frame; None without an origin, where it is (0, 0, 1)."""
        if self.origin is None:
            return None
        turn = geodesy.turn_from_level(self.aircraft[:, POSITION], self.origin)
        return turn[..., DOWN]

    @cached_property
    def hovers(self) -> NDArray[np.bool_]:
        """Whether the aircraft hovers on each leg (n − 1,)."""
        return hovering(self.time_s, self.aircraft[:, POSITION], self.down)

    @cached_property
    def turning(self) -> Slerp:
        """The attitude as a function of time, for poses whose attitude was given."""
        from scipy.spatial.transform import Rotation, Slerp  # takes 0.25 s to import

        yaw_pitch_roll = self.aircraft[:, :2:-1]
        return Slerp(self.time_s, Rotation.from_euler("ZYX", yaw_pitch_roll))

    @cached_property
    def spline(self) -> CubicHermiteSpline:
        """The position as a smooth function of time.

        Its slopes at the samples are those of the cubic spline, over ground within the limits of
        `_limited`. Without these the spline would swing through a place where the aircraft stops.
        """
        from scipy.interpolate import CubicHermiteSpline, CubicSpline  # takes 0.3 s to import

        time, position = self.time_s, self.aircraft[:, POSITION]
        slope = CubicSpline(time, position)(time, 1)
        leg, _ = velocity_on_legs(time, position, self.down)
        leg[self.hovers] = 0.0  # a drift shows no course
        level = over_ground(slope, self.down)
        limited = _limited(level, leg)
        return CubicHermiteSpline(time, position, slope + (limited - level))

    @cached_property
    def smooth_height(self) -> CubicHermiteSpline:
        """The height [m] as a smooth function of time, above the ellipsoid if there is an origin.

        Its slopes at the samples are the slopes of the cubic spline, within limits. The limits make
        the height monotone between two samples (F. N. Fritsch and R. E. Carlson, "Monotone
        piecewise cubic interpolation", SIAM J. Numer. Anal. 17(2), 1980). A slope is at most three
        times the slope to either neighbour, and 0 where the two have different signs.

        A limit of 0 would flatten a top that the samples show. The limits do not apply where five
        consecutive second differences have one sign and are within a factor of two of each other. A
        wave needs some 15 samples a period for this. `largest_climb` limits the slope
        everywhere, so that a flight does not climb at the row where it stops over ground.
        """
        from scipy.interpolate import CubicHermiteSpline, CubicSpline  # takes 0.3 s to import

        time, height = self.time_s, -self.aircraft[:, DOWN]
        if self.origin is not None:
            height = geodesy.geodetic_from_ned(self.aircraft[:, POSITION], self.origin)[:, 2]
        slope, rate = np.diff(height) / np.diff(time), CubicSpline(time, height)(time, 1)
        before, after = np.append(slope[0], slope), np.append(slope, slope[-1])
        limit = 3.0 * np.minimum(abs(before), abs(after))
        same_sign = (before * after > 0) & (rate * after > 0)
        limited = np.where(same_sign, np.clip(rate, -limit, limit), 0.0)
        if len(time) > _TOP_DIFFERENCES + 1:
            bend = np.diff(slope) / (time[2:] - time[:-2])
            windows = np.lib.stride_tricks.sliding_window_view(bend, _TOP_DIFFERENCES)
            low, high = windows.min(axis=-1), windows.max(axis=-1)
            top = ((low > 0) & (high <= 2.0 * low)) | ((high < 0) & (low >= 2.0 * high))
            inner = slice(_TOP_DIFFERENCES // 2 + 1, -(_TOP_DIFFERENCES // 2 + 1))
            limited[inner] = np.where(top, rate[inner], limited[inner])
        position = self.aircraft[:, POSITION]
        ground = np.linalg.norm(over_ground(self.spline(time, 1), self.down), axis=1)
        most = largest_climb(time, position, ground, self.down)
        limited = np.clip(limited, -most, most)
        return CubicHermiteSpline(time, height, limited)


def _limited(slope: FloatArray, leg: FloatArray) -> FloatArray:
    """Return velocities at samples (n, 3) within limits by those on the legs (n − 1, 3).

    A velocity is at most twice that on either leg beside it, as where an aircraft brakes evenly to
    a stop. One against a leg has the direction between the two legs.
    """
    size, given = (np.linalg.norm(of, axis=1, keepdims=True) for of in (leg, slope))
    along = np.divide(leg, size, out=np.zeros_like(leg), where=size > 0)
    before, after = np.vstack([along[:1], along]), np.vstack([along, along[-1:]])
    between = before + after
    length = np.linalg.norm(between, axis=1, keepdims=True)
    between = np.divide(between, length, out=np.zeros_like(between), where=length > _ROUNDING)
    least = np.minimum(*(np.sum(slope * of, axis=1, keepdims=True) for of in (before, after)))
    slope = np.where(least < -_ROUNDING * given, given * between, slope)
    most = 2.0 * np.minimum(np.vstack([size[:1], size]), np.vstack([size, size[-1:]]))
    return slope * np.divide(most, given, out=np.ones_like(given), where=given > most)


def resample(route: Route, step_s: float, method: str = "legs") -> Route:
    """Return a route interpolated at equal steps of time.

    "legs" is for the waypoints of a planner. Legs are straight with constant velocity, and turns
    are instantaneous (fly-by is not modelled). An attitude that is not given follows the leg with
    level wings. At a waypoint the attitude follows the next leg. Between waypoints in latitude and
    longitude a leg follows the curve of the earth, with altitude linear in time.

    "smooth" is for samples of a flight that are close enough to show its turns. The path is the
    cubic spline through all samples (C. de Boor, *A Practical Guide to Splines*, 1978, ch. IV,
    not-a-knot), with continuous acceleration but where it slows or turns sharply (`Route.spline`):
    it does not swing through a place where the aircraft stops. Course, climb and bank come from the
    spline. In latitude and longitude the spline is lifted to its altitude, like a leg. Altitude
    stays between the altitudes of two samples, unless the samples show the top of a curve
    (`Route.smooth_height`).

    A given attitude turns from pose to pose about one axis at a constant rate (K. Shoemake,
    "Animating rotation with quaternion curves", SIGGRAPH 1985). Unlike interpolated Euler angles,
    the result does not depend on the frame. There is no singularity at a pitch of 90° or a yaw of
    180°. Covariances are interpolated linearly, which keeps them semidefinite. They are relative to
    north, east and down at the aircraft, so that the origin of the frame changes nothing.

    The step [s] counts from the first pose on. The last pose of the route is always kept, so the
    last interval may be shorter than a step.
    """
    check_choice("method", method, METHODS)
    time, last = even_times(route.time_s, step_s), float(route.time_s[-1])
    rounding = 1e-6 * min(step_s, last - float(route.time_s[0])) + 2.0 * np.spacing(abs(last))
    if last - time[-1] > rounding:
        time = np.append(time, last)
    time[-1] = last
    if len(time) > MAX_ROWS:
        raise _too_many(step_s)
    return interpolate(route, time, method)


def even_times(time_s: FloatArray, step_s: float, name: str = "step_s") -> FloatArray:
    """Return times (n,) [s] at equal steps from the first of some times (m,) [s] up to the last.

    Errors have a name for the step.
    """
    first, last = float(time_s[0]), float(time_s[-1])
    # A step must be longer than the spacing of floats at this time, some 1e-16 of the time.
    shortest = max(MIN_STEP, 1e-15 * max(abs(first), abs(last)))
    if not (math.isfinite(step_s) and step_s >= shortest):
        raise InputError(f"{name} must be a number not less than {shortest:g}, got {step_s}")
    # Rounding must not lose the last pose.
    steps = math.floor((last - first) / step_s * (1 + 1e-12) + 1e-9)
    if steps >= MAX_ROWS:
        raise _too_many(step_s, name)
    return np.minimum(first + step_s * np.arange(steps + 1), last)


def _too_many(step_s: float, name: str = "step_s") -> InputError:
    return InputError(f"{name} makes more than {MAX_ROWS:,} poses, got {step_s:g}")


def interpolate(route: Route, time: FloatArray, method: str = "legs") -> Route:
    """Return a route at times (n,) [s] within its own, in any order, by a method of `resample`."""
    if len(route.time_s) == 1:
        return route
    motion = legs if method == "legs" else _smooth
    # an aircraft that hovers has the course of the leg before it, or of the first leg
    beside = () if route.attitude_given else (route.time_s, *_beside_stops(route))
    asked, time = time, np.unique(np.concatenate([time, *beside]))
    position, velocity, acceleration = motion(route, time)
    if route.attitude_given:
        to_ned = route.turning(time).as_matrix()
        attitude = geodesy.euler_angles(np.swapaxes(to_ned, -1, -2))
    else:
        origin = route.origin
        turn = None if origin is None else geodesy.turn_from_level(position, origin)
        hovers = route.hovers[_leg(route.time_s, time)[0]]
        attitude = attitude_from_motion("route", velocity, acceleration, hovers, turn)
    aircraft = np.hstack([position, attitude])[np.searchsorted(time, asked)]
    return Route(asked, aircraft, _covariance(route, asked), route.attitude_given, route.origin)


def _beside_stops(route: Route) -> tuple[FloatArray, FloatArray]:
    """Return times at the ends of legs before a stop, and at the starts of legs after a stop.

    At the row itself the aircraft may stand. A millionth of the leg away its course is known.
    """
    time, aside = route.time_s, 1e-6 * np.diff(route.time_s)
    ends = np.minimum(time[1:] - aside, np.nextafter(time[1:], -np.inf))
    starts = np.maximum(time[:-1] + aside, np.nextafter(time[:-1], np.inf))
    return ends[np.append(route.hovers[1:], True)], starts[np.append(True, route.hovers[:-1])]


def distance_flown(route: Route, time: FloatArray, method: str = "legs") -> FloatArray:
    """Return the length of the path (n,) [m] up to times (n,) [s], by a method of `resample`."""
    rows = route.time_s
    if len(rows) == 1:
        return np.zeros(len(time))
    up_to_row = np.append(0.0, np.cumsum(_lengths(route, rows[:-1], rows[1:], method)))
    leg, fraction = _leg(rows, time)
    distance, between = up_to_row[leg], fraction > 0
    distance[between] += _lengths(route, rows[leg[between]], time[between], method)
    return distance


def _lengths(route: Route, start: FloatArray, end: FloatArray, method: str) -> FloatArray:
    """Return the lengths of the path (n,) [m] from times to times (n,) [s] of the same legs.

    They are the limit of chords by L. F. Richardson's extrapolation. With 16 chords, half a turn
    between two rows is off by a millionth. A leg on the earth bends less, and has four.
    """
    motion, parts = (legs, 4) if method == "legs" else (_smooth, 16)
    lengths = np.empty(len(start))
    for block in slices(len(start)):
        steps = (end - start)[block, np.newaxis] * np.linspace(0.0, 1.0, parts + 1)
        at = np.minimum(start[block, np.newaxis] + steps, end[block, np.newaxis])
        place = motion(route, at.ravel())[0].reshape(*at.shape, 3)
        half, whole = (
            np.linalg.norm(np.diff(place[:, ::every], axis=1), axis=-1).sum(axis=-1)
            for every in (2, 1)
        )
        lengths[block] = whole + (whole - half) / 3.0
    return lengths


def _covariance(route: Route, time: FloatArray) -> FloatArray | None:
    """Return C_aa (n, 6, 6), linear between poses."""
    if route.covariance is None:
        return None
    leg, fraction = _leg(route.time_s, time)
    covariance = np.empty((len(time), 6, 6))
    for block in slices(len(time)):
        before, after = (route.covariance[leg[block] + end] for end in (0, 1))
        weight = fraction[block, np.newaxis, np.newaxis]
        covariance[block] = (1.0 - weight) * before + weight * after
    return covariance


def _leg(times: FloatArray, at: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
    """Return the leg of each time, and the fraction of the leg flown, from 0 to 1."""
    leg = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    return leg, (at - times[leg]) / (times[leg + 1] - times[leg])


def legs(route: Route, at: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return position, velocity and acceleration (n, 3) on legs of constant speed over ground."""
    leg, fraction = _leg(route.time_s, at)
    waypoints = route.aircraft[:, POSITION]
    chord, step = np.diff(waypoints, axis=0)[leg], np.diff(route.time_s)[leg]
    if route.origin is None:
        velocity = chord / step[:, np.newaxis]
        position = waypoints[leg] + velocity * (at - route.time_s[leg])[:, np.newaxis]
        return position, velocity, np.zeros_like(velocity)
    place = geodesy.geodetic_from_ned(waypoints, route.origin)
    height = place[:, 2]
    climb = (np.diff(height) / np.diff(route.time_s))[leg]
    height = height[leg] + fraction * (height[leg + 1] - height[leg])
    # Seen from the centre of the earth the aircraft turns evenly. The law of cosines has the angle
    # of a leg, and the law of sines the point of its chord below each point of it.
    radius = np.linalg.norm(geodesy.ecef_from_geodetic(place), axis=-1)
    start, end = radius[leg], radius[leg + 1]
    square = np.sum(chord * chord, axis=1) - (end - start) ** 2
    angle = 2.0 * np.arcsin(np.sqrt(np.clip(square / (4.0 * start * end), 1e-18, 1.0)))
    flown, left = start * np.sin(fraction * angle), end * np.sin((1.0 - fraction) * angle)
    position = waypoints[leg] + chord * (flown / (flown + left))[:, np.newaxis]
    growth = start * end * angle * np.sin(angle) / (flown + left) ** 2
    velocity = chord * (growth / step)[:, np.newaxis]
    acceleration = np.zeros_like(velocity)
    position = _lifted(position, height, climb, velocity, acceleration, route.origin)
    return position, velocity, acceleration


def _smooth(route: Route, at: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return position, velocity and horizontal acceleration (n, 3) on the cubic spline."""
    position, velocity, acceleration = (route.spline(at, order) for order in range(3))
    height, climb = (route.smooth_height(at, order) for order in range(2))
    if route.origin is None:
        position[:, DOWN], velocity[:, DOWN] = -height, -climb
    else:
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
    """Return positions (n, 3) lifted to a height; velocity and acceleration change in place.

    A line or a spline between waypoints is a tunnel through the earth. Each of its points keeps its
    latitude and longitude. Speed over ground grows with the distance from the centre of the earth.
    Of the acceleration only the horizontal part is used. `climb` is the rate of change of the
    height above the ellipsoid (n,).
    """
    place = geodesy.geodetic_from_ned(position, origin)
    growth = (geodesy.SEMI_MAJOR + height) / (geodesy.SEMI_MAJOR + place[:, 2])
    place[:, 2] = height
    down = geodesy.turn_to_origin(place, origin)[..., DOWN]
    sink_rate = np.sum(velocity * down, axis=-1)
    level = velocity - sink_rate[:, np.newaxis] * down
    velocity[:] = growth[:, np.newaxis] * level - climb[:, np.newaxis] * down
    acceleration *= growth[:, np.newaxis]
    return geodesy.ned_from_geodetic(place, origin)
