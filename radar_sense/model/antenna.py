"""What a radar sees by direction: the gain of its antenna over elevation, and a mask of terrain.

Azimuth and elevation of an aircraft are in the level axes of the radar, clockwise from north and
upwards. Rays are straight. A vector d points from aircraft to radar, as in `model.geometry`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from radar_sense.errors import InputError
from radar_sense.limits import ANY, DEG, NOT_NEGATIVE, Limit, check_number
from radar_sense.model.geodesy import LEAST_RADIUS
from radar_sense.model.geometry import Vector, radar_from_aircraft
from radar_sense.model.radar_equation import NEPERS
from radar_sense.states import DOWN, FloatArray, ReadOnly, read_only

#: Elevations [deg], azimuths [deg], gains relative to the greatest [dB], and tilts [deg].
ELEVATION, AZIMUTH = Limit(at_least=-90, at_most=90), Limit(at_least=-180, at_most=360)
GAIN_DB, TILT = Limit(at_least=-200, at_most=0), Limit(at_least=-90, at_most=90)
_LEVEL = np.eye(3)


@dataclass(frozen=True, eq=False)
class _Directions(ReadOnly):
    """Values over a rising angle, in level axes.

    Attributes:
        axes: Columns (3, 3) are north, east and down at the radar, in the frame of the states.
    """

    axes: FloatArray = field(default_factory=_LEVEL.copy, kw_only=True)
    #: The angle and the value, each with what is allowed and its unit.
    NODES: ClassVar[Mapping[str, tuple[Limit, float]]]

    def __post_init__(self) -> None:
        for name in (*self.NODES, "axes"):
            object.__setattr__(self, name, read_only(name, getattr(self, name)))
        if self.axes.shape != (3, 3) or not np.allclose(self.axes @ self.axes.T, _LEVEL):
            raise InputError("axes must be a rotation (3, 3)")
        angle, values = (getattr(self, name) for name in self.NODES)
        if angle.ndim != 1 or angle.shape != values.shape or len(angle) < 2:
            raise InputError(f"{' and '.join(self.NODES)} must be two arrays of 2 values or more")
        for name, (limit, unit) in self.NODES.items():
            for value in getattr(self, name):
                check_number(name, round(float(value) / unit, 9), limit)
        if not np.all(np.diff(angle) > 0):
            raise InputError(f"{next(iter(self.NODES))} must ascend")

    @property
    def detail(self) -> float:
        """Least distance [rad] of neighbouring nodes."""
        return float(np.diff(getattr(self, next(iter(self.NODES)))).min())


@dataclass(frozen=True, eq=False)
class ElevationGain(_Directions):
    """The gain of an antenna over elevation, relative to its greatest gain.

    The gain counts twice, there and back. In decibels it is a monotone cubic between the nodes
    (F. N. Fritsch and R. E. Carlson, "Monotone piecewise cubic interpolation", SIAM J. Numer. Anal.
    17(2), 1980), so that it never exceeds them. Its slope is 0 at the first and the last node, and
    beyond these their gain holds.

    Attributes:
        elevation: Ascending elevations (n,) [rad], from the axis of the antenna.
        gain_db: One-way gains (n,) [dB], 0 at most.
        tilt: Elevation of the axis of the antenna [rad], to which its error adds.
    """

    elevation: FloatArray
    gain_db: FloatArray
    tilt: float = 0.0
    NODES: ClassVar = {"elevation": (ELEVATION, DEG), "gain_db": (GAIN_DB, 1.0)}
    term: ClassVar = "elevation_gain"
    parameter: ClassVar = "tilt"
    std_limit: ClassVar = NOT_NEGATIVE

    def __post_init__(self) -> None:
        super().__post_init__()
        tilt = check_number("tilt", self.tilt, ANY)
        check_number("tilt [deg]", tilt / DEG, TILT)
        object.__setattr__(self, "tilt", tilt)

    def __repr__(self) -> str:
        return f"<ElevationGain: {len(self.elevation)} nodes, tilt {np.rad2deg(self.tilt):g} deg>"

    def outside(self, line: Vector) -> FloatArray:
        """Return how far (...) [rad] directions d are beyond the nodes, 0 between them."""
        elevation = self._from_axis(line, np.zeros(()))
        return np.asarray(abs(elevation - self._inside(elevation)))

    def nepers(self, line: Vector, error: FloatArray) -> FloatArray:
        """Return ln of the factor (...) of the signal along d, of an antenna with a tilt error."""
        curve, _ = self._curves
        return np.asarray(curve(self._inside(self._from_axis(line, error))))

    def linearize(self, line: Vector, error: FloatArray) -> tuple[FloatArray, Vector, FloatArray]:
        """Return `nepers`, their gradient by d [1/m] and by the error of the tilt [1/rad].

        The gradient is 0 straight above and below, where it does not exist.
        """
        elevation = self._from_axis(line, error)
        inside, (curve, slope) = self._inside(elevation), self._curves
        by_elevation = slope(inside)
        # With ρ the level part of d and h along down, the elevation is atan2(h, ρ).
        level, height, across = self._level_parts(line)
        along = np.divide(-height, across, out=np.zeros_like(across), where=across > 0)
        down = self.axes[:, DOWN]
        with np.errstate(divide="ignore", invalid="ignore"):  # where both are at one point
            scale = by_elevation / (across * across + height * height)
            by_line = [scale * (along * u + across * d) for u, d in zip(level, down, strict=True)]
        return curve(inside), Vector(*by_line), -by_elevation

    def rise(self, line: Vector, error: FloatArray, part: FloatArray) -> FloatArray:
        """Return by how much (...) `nepers` may rise at most on the way, see `Factor`.

        The whole way to the radar counts, for any part. On it the elevation rises if the aircraft
        is above the level plane of the radar. If it is below, the elevation falls; very far away it
        rises first, because the earth is curved.
        """
        _, height, across = self._level_parts(line)
        elevation, (curve, _) = self._from_axis(line, error), self._curves
        inside, gain = self._inside(elevation), self.gain_db
        place = np.searchsorted(self.elevation, inside)
        higher = np.maximum.accumulate(gain[::-1])[::-1][place]
        lower = np.maximum.accumulate(gain)[np.maximum(place - 1, 0)]
        falls = -height * LEAST_RADIUS > across * across
        most = np.where(height > 0, higher, np.where(falls, lower, 0.0))
        return np.asarray(np.maximum(2.0 * NEPERS * most - curve(inside), 0.0))

    def _level_parts(self, line: Vector) -> tuple[list[FloatArray], FloatArray, FloatArray]:
        """Return the level part of d by component, its part along down, and the level distance."""
        down = self.axes[:, DOWN]
        height = _along(down, line)
        level = [x - d * height for d, x in zip(down, line, strict=True)]
        return level, height, np.sqrt(sum((u * u for u in level), np.zeros(())))

    def _from_axis(self, line: Vector, tilt_error: FloatArray) -> FloatArray:
        """Return the elevation (...) [rad] of the aircraft, from the axis of the antenna."""
        _, height, across = self._level_parts(line)
        return np.asarray(np.arctan2(height, across) - (self.tilt + tilt_error))

    def _inside(self, elevation: FloatArray) -> FloatArray:
        return np.asarray(np.clip(elevation, self.elevation[0], self.elevation[-1]))

    @cached_property
    def _curves(self) -> tuple[Any, Any]:
        """The curve of ln of the factor over elevation, and its slope."""
        from scipy.interpolate import PchipInterpolator  # slow to import

        # a further node on each side makes the slope 0 at the ends, as it is beyond them
        ends = self.elevation[[0, -1]] + [-1.0, 1.0]
        gain = np.pad(self.gain_db, 1, mode="edge")
        curve = PchipInterpolator(np.insert(ends, 1, self.elevation), 2.0 * NEPERS * gain)
        return curve, curve.derivative()


@dataclass(frozen=True, eq=False)
class Mask(_Directions):
    """The lowest elevation that terrain leaves visible, by azimuth.

    Between the nodes it is linear, once around.

    Attributes:
        azimuth: Ascending azimuths (n,) [rad], within one turn.
        elevation: Lowest visible elevations (n,) [rad].
    """

    azimuth: FloatArray
    elevation: FloatArray
    NODES: ClassVar = {"azimuth": (AZIMUTH, DEG), "elevation": (ELEVATION, DEG)}

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.azimuth[-1] - self.azimuth[0] > math.tau * (1.0 + 1e-12):
            raise InputError("azimuth must be within one turn")
        closed = np.isclose(self.azimuth[-1] - self.azimuth[0], math.tau, rtol=1e-12)
        if closed and self.elevation[0] != self.elevation[-1]:
            raise InputError("elevation must be the same at both ends of a full turn")

    def __repr__(self) -> str:
        highest = np.rad2deg(self.elevation.max())
        return f"<Mask: {len(self.azimuth)} azimuths, up to {highest:.3g} deg>"

    @cached_property
    def steepness(self) -> float:
        """Largest change of `clearance` with a turn of the line of sight [rad/rad].

        A turn changes the elevation, and the azimuth by more, the higher or lower the mask is.
        """
        across = np.diff(self.azimuth, append=self.azimuth[0] + math.tau)
        up = np.diff(self.elevation, append=self.elevation[0])
        slope = np.max(abs(up[across > 0] / across[across > 0]))
        return float(1.0 + slope / math.cos(np.max(abs(self.elevation))))

    def clearance(self, aircraft: ArrayLike, radar: ArrayLike) -> FloatArray:
        """Return the elevation (...) [rad] of aircraft (..., 6) above the mask of a radar."""
        azimuth, elevation, _ = self._direction(aircraft, radar)
        lowest = np.interp(azimuth, self.azimuth, self.elevation, period=math.tau)
        return np.asarray(elevation - lowest)

    def clearance_within(
        self, aircraft: FloatArray, radar: FloatArray, error: FloatArray, up: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return bounds of `clearance` (...) if positions are off by up to a distance (...) [m].

        Of this distance no more than a part (...) [m] is upwards or downwards.
        """
        azimuth, elevation, distance = self._direction(aircraft, radar)
        across, height = distance * np.cos(elevation), distance * np.sin(elevation)
        turn, aside = (_turn(error, of) for of in (distance, across))
        low, high = self._extremes(azimuth - aside, azimuth + aside)
        nearest, farthest = np.maximum(across - error, 0.0), across + error
        below, above = height - up, height + up
        lowest = np.arctan2(below, np.where(below > 0, farthest, nearest))
        highest = np.arctan2(above, np.where(above > 0, nearest, farthest))
        lowest = np.clip(lowest, elevation - turn, elevation)
        return lowest - high, np.clip(highest, elevation, elevation + turn) - low

    def _extremes(self, first: FloatArray, last: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the least and the greatest elevation (...) of the mask between two azimuths (...).

        The azimuths are from −2π to 2π, and at most a turn apart.
        """
        nodes = np.concatenate([self.azimuth + math.tau * turns for turns in range(-2, 3)])
        ends = np.stack([first, last])
        at_ends = np.interp(ends, self.azimuth, self.elevation, period=math.tau)
        places = np.searchsorted(nodes, ends)
        some, of_nodes = places[0] < places[1], np.tile(self.elevation, 5)
        # of every two slices of `reduceat` the first is from one azimuth to the other
        least, most = (
            of.reduceat(of_nodes, np.moveaxis(places, 0, -1).ravel())[::2].reshape(some.shape)
            for of in (np.minimum, np.maximum)
        )
        low = np.minimum(at_ends.min(axis=0), np.where(some, least, np.inf))
        return low, np.maximum(at_ends.max(axis=0), np.where(some, most, -np.inf))

    def _direction(
        self, aircraft: ArrayLike, radar: ArrayLike
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return azimuth, elevation [rad] and distance [m] of aircraft, each (...)."""
        line = radar_from_aircraft(np.asarray(aircraft), np.asarray(radar))
        north, east, down = (_along(axis, line) for axis in self.axes.T)
        across = np.hypot(north, east)
        return np.arctan2(-east, -north), np.arctan2(down, across), np.hypot(across, down)


def _turn(error: FloatArray, distance: FloatArray) -> FloatArray:
    """Return by how much (...) [rad] an error (...) turns a vector; π if in any direction."""
    apart = distance > error
    part = np.divide(error, distance, out=np.zeros_like(distance), where=apart)
    return np.where(apart, np.arcsin(part), np.pi)


def _along(axis: FloatArray, line: Vector) -> FloatArray:
    """Return the component (...) of vectors along a direction (3,)."""
    return sum((a * x for a, x in zip(axis, line, strict=True)), np.zeros(()))
