"""The poses of the aircraft, and the flight between them: orbit, radial, path, or states alone.

    geometry = scenario.geometry
    if geometry.continuous:
        finer = scenario.along(geometry.at(times))

On an orbit `at` takes azimuths [deg] in place of times, and on a radial ground ranges [km].
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_sense import axis as axes
from radar_sense.axis import Axis
from radar_sense.covariance import symmetric_square_root
from radar_sense.errors import InputError, check_choice, describe
from radar_sense.limits import MIN_RANGE
from radar_sense.model.geometry import orbit, slant_range
from radar_sense.model.horizon import Horizon
from radar_sense.model.track import covariance_in_frame, square_root_in_frame
from radar_sense.model.trajectory import METHODS, Route, distance_flown, interpolate
from radar_sense.states import ATTITUDE, FloatArray, ReadOnly, read_only

if TYPE_CHECKING:
    from typing_extensions import Self

    from radar_sense.model.radar import Radar

#: C_aa of an aircraft whose poses are certain.
CERTAIN = np.zeros((6, 6))
CERTAIN.flags.writeable = False
#: Times [s] that are one but for rounding.
SAME_TIME = 1e-4


@dataclass(frozen=True, eq=False)
class Geometry(ReadOnly):
    """Poses of the aircraft along an axis.

    Attributes:
        axis: Axis of the poses (n,).
        aircraft: States (n, 6).
        covariance: C_aa (6, 6), or one for each pose (n, 6, 6), relative to north, east and down at
            the aircraft.
    """

    axis: Axis
    aircraft: FloatArray = field(repr=False)
    covariance: FloatArray = field(repr=False, default_factory=lambda: CERTAIN)
    #: Step of the coordinate that is not halved further: the aircraft flies some centimetres in it.
    shortest: ClassVar[float] = 0.0

    @property
    def continuous(self) -> bool:
        """Whether the aircraft flies from pose to pose, so that there are poses between them."""
        return False

    @property
    def origin(self) -> tuple[float, float, float] | None:
        """The origin of the frame on the earth, see `Path`; None if the frame is flat."""
        return None

    @property
    def horizon(self) -> Horizon:
        """The earth that hides the aircraft from radars with a horizon."""
        return Horizon(self.origin)

    @property
    def square_root(self) -> FloatArray:
        """F (6, 6) or (n, 6, 6) with F Fᵀ = C_aa, for errors that are correlated along the flight.

        F is continuous in C_aa, and symmetric but for units.
        """
        return symmetric_square_root(self.covariance)

    @property
    def covariance_in_frame(self) -> FloatArray:
        """C_aa (6, 6) or (n, 6, 6) in the frame of the states."""
        return self.covariance

    @property
    def coordinate(self) -> FloatArray:
        """Coordinate of each pose (n,) for `at`: azimuth [deg], ground range [km] or time [s]."""
        return self.axis.values

    @property
    def turns(self) -> FloatArray:
        """Coordinates (k,) at which the attitude jumps."""
        return np.empty(0)

    @property
    def whole(self) -> Geometry:
        """The poses, and with them the rows of the flight that are between them."""
        return self

    def at(self, coordinate: FloatArray) -> Geometry:
        """Return the poses of the flight at other coordinates (k,), in any order."""
        raise InputError("there is no flight from pose to pose")

    def collision(self, radar: Radar, what: str) -> str | None:
        """Return where the aircraft is on top of a radar, in words; None if nowhere."""
        distance = slant_range(self.aircraft, np.asarray(radar.state))
        nearest = int(np.argmin(distance))
        if distance[nearest] >= MIN_RANGE:
            return None
        return (
            f"the aircraft is on top of {radar.called} at {what}{self.axis.at(nearest)}, "
            f"slant range {distance[nearest]:.2g} m; allowed is {MIN_RANGE:g} m or more"
        )

    def at_poses(self, poses: slice | NDArray[np.intp]) -> Geometry:
        """Return some of the poses."""
        return States(self.axis.at_poses(poses), self.aircraft[poses], self._covariance_at(poses))

    def _covariance_at(self, poses: slice | NDArray[np.intp]) -> FloatArray:
        return self.covariance if self.covariance.ndim == 2 else self.covariance[poses]


class States(Geometry):
    """Poses without a flight between them."""

    @classmethod
    def of(cls, aircraft: ArrayLike, covariance: ArrayLike = CERTAIN) -> States:
        """Return poses by number from states (n, 6) or (6,), and C_aa (6, 6) or (n, 6, 6)."""
        states = np.atleast_2d(read_only("aircraft", aircraft))
        return cls(axes.pose_number(len(states)), states, read_only("covariance", covariance))


@dataclass(frozen=True, eq=False)
class _Level(Geometry):
    """A level line about the origin or away from it, at one attitude.

    Attributes:
        down: Down coordinate [m].
        azimuth_from: Direction of azimuth 0, "east" or "north".
    """

    down: float = 0.0
    azimuth_from: str = "east"

    @classmethod
    def of(cls, axis: Axis, attitude: FloatArray, **line: Any) -> Self:
        """Return a line by its fields, with poses along an axis (n,) at an attitude (3,) [rad]."""
        at_origin = np.concatenate([np.zeros(3), attitude])[np.newaxis]
        return cls(axis, at_origin, **line).at(axis.values)

    @property
    def continuous(self) -> bool:
        """Whether there are poses between the poses: with two poses or more."""
        return len(self.axis) > 1 and self.covariance.ndim == 2

    def at(self, coordinate: FloatArray) -> Self:
        """Return the line at other azimuths (k,) [deg] or ground ranges (k,) [km]."""
        azimuth, radius = self._polar(coordinate)
        position = orbit(
            np.deg2rad(azimuth), radius=radius, down=self.down, azimuth_from=self.azimuth_from
        )
        attitude = np.broadcast_to(self.aircraft[0, ATTITUDE], position.shape)
        aircraft = np.hstack([position, attitude])
        aircraft.flags.writeable = False
        axis = dataclasses.replace(self.axis, values=coordinate)
        return dataclasses.replace(self, axis=axis, aircraft=aircraft)

    def _polar(self, coordinate: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return azimuth (k,) [deg] and horizontal distance (k,) [m] from the origin."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class Orbit(_Level):
    """A level circle about the origin, by azimuth [deg].

    Attributes:
        radius: Horizontal radius [m].
    """

    radius: float = 0.0
    shortest = 1e-5

    def _polar(self, coordinate: FloatArray) -> tuple[FloatArray, FloatArray]:
        return coordinate, np.full(coordinate.shape, self.radius)


@dataclass(frozen=True, eq=False)
class Radial(_Level):
    """A level straight line away from the origin, by ground range [km].

    Attributes:
        azimuth: Azimuth of the line [deg].
    """

    azimuth: float = 0.0
    shortest = 1e-6

    def _polar(self, coordinate: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.full(coordinate.shape, self.azimuth), 1e3 * coordinate


@dataclass(frozen=True, eq=False)
class Path(Geometry):
    """A path: poses with times, and the flight between them.

    Without a `flight` of its own, the aircraft flies straight from pose to pose. Position is linear
    in time. If the path is in latitude and longitude, the line is lifted to a height that is linear
    in time. Attitude turns the short way at a constant rate. Covariances are linear in time,
    relative to north, east and down at the aircraft.

    Attributes:
        time_s: Time of each pose (n,) [s], increasing.
        origin: Latitude, longitude [rad] and height above the ellipsoid [m] of the origin of the
            frame, for a path in latitude and longitude.
        flight: The route that the poses were interpolated on; None for the poses themselves.
        method: How the flight is interpolated, one of `trajectory.METHODS`.
        sea_level: Height of the sea level above the ellipsoid [m], for the horizon.
    """

    time_s: FloatArray = field(repr=False, kw_only=True)
    origin: tuple[float, float, float] | None = None
    flight: Route | None = field(default=None, repr=False)
    method: str = "legs"
    sea_level: float = 0.0
    shortest = 2e-4

    def __post_init__(self) -> None:
        check_choice("method", self.method, METHODS)
        if not isinstance(self.flight, Route | None):
            raise InputError(f"flight must be a Route or None, got {describe(self.flight)}")

    @classmethod
    def of(cls, time_s: ArrayLike, aircraft: ArrayLike, covariance: ArrayLike = CERTAIN) -> Path:
        """Return a path from times (n,) [s], states (n, 6), and C_aa (6, 6) or (n, 6, 6)."""
        time, states = read_only("time_s", time_s), read_only("aircraft", aircraft)
        if time.shape != states.shape[:1] or not np.isfinite(time).all():
            raise InputError(
                f"time_s must be finite, one for each state, got {time.shape} for {states.shape}"
            )
        return cls(axes.time(time), states, read_only("covariance", covariance), time_s=time)

    @property
    def continuous(self) -> bool:
        """Whether there are poses between the poses: with two poses or more."""
        return len(self.axis) > 1

    @property
    def coordinate(self) -> FloatArray:
        """Time of each pose (n,) [s]."""
        return self.time_s

    @property
    def horizon(self) -> Horizon:
        """As of `Geometry`, with its surface at the sea level."""
        return Horizon(self.origin, self.sea_level)

    @property
    def square_root(self) -> FloatArray:
        """As of `Geometry`, symmetric relative to north, east and down at the aircraft."""
        if self.origin is None or not self.covariance.any():
            return super().square_root
        return square_root_in_frame(self.covariance, self.time_s, self.aircraft, self.origin)

    @cached_property
    def covariance_in_frame(self) -> FloatArray:
        """As of `Geometry`; a nose that points straight up or down has none."""
        if self.origin is None or not self.covariance.any():
            return self.covariance
        turned = covariance_in_frame(self.covariance, self.time_s, self.aircraft, self.origin)
        turned.flags.writeable = False
        return turned

    @cached_property
    def route(self) -> Route:
        """The route that `at` interpolates."""
        if self.flight is not None:
            return self.flight
        own = self.covariance if self.covariance.ndim == 3 else None
        # the attitude is interpolated, and not derived from the track again
        return Route(self.time_s, self.aircraft, own, True, self.origin)

    @cached_property
    def whole(self) -> Path:
        """As of `Geometry`, without rows of the flight within `SAME_TIME` of a pose."""
        if self.flight is None:
            return self
        time = self.time_s
        rows = self.flight.time_s
        rows = rows[(rows > time[0]) & (rows < time[-1])]
        after = np.searchsorted(time, rows)
        nearest = np.minimum(rows - time[after - 1], time[after] - rows)
        return self.at(np.union1d(time, rows[nearest > SAME_TIME]))

    @property
    def turns(self) -> FloatArray:
        """As of `Geometry`: the waypoints of legs, at which the course jumps."""
        if self.flight is None or self.method != "legs" or self.flight.attitude_given:
            return super().turns
        return self.flight.time_s[1:]

    def at(self, coordinate: FloatArray) -> Path:
        """Return the path at other times (k,) [s] within its own."""
        first, last = self.route.time_s[[0, -1]]
        if not np.all((coordinate >= first) & (coordinate <= last)):
            raise InputError(f"coordinate must be times from {first:g} to {last:g} s")
        poses, covariance = interpolate(self.route, coordinate, self.method), self.covariance
        if covariance.ndim == 3 and poses.covariance is not None:
            covariance = poses.covariance
        if self.flight is not None and self.axis.key == axes.DISTANCE:
            values = distance_flown(self.flight, coordinate, self.method)
        else:  # the time; or the distance, along lines from pose to pose
            values = np.interp(coordinate, self.time_s, self.axis.values)
        return dataclasses.replace(
            self,
            axis=dataclasses.replace(self.axis, values=values),
            aircraft=poses.aircraft,
            covariance=covariance,
            time_s=coordinate,
        )

    def at_poses(self, poses: slice | NDArray[np.intp]) -> Path:
        """Return the path with some of its rows."""
        return dataclasses.replace(
            self,
            axis=self.axis.at_poses(poses),
            aircraft=self.aircraft[poses],
            covariance=self._covariance_at(poses),
            time_s=self.time_s[poses],
        )
