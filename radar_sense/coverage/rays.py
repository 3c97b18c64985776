"""Rays from a radar, and the aircraft on each ray.

A ray leaves the radar at one bearing. The aircraft is on the ray at one height, roll, pitch and
yaw. The distance along a ray is horizontal, in the level plane of the radar.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sense.coverage.grid import pose_in_cells, put_at_height
from radar_sense.model import geodesy
from radar_sense.model.geometry import slant_range
from radar_sense.model.radar import Radar
from radar_sense.propagation import distribution
from radar_sense.scenario import Scenario
from radar_sense.states import AIRCRAFT, ATTITUDE, DOWN, POSITION, YAW, FloatArray

#: Nearest and farthest distance of the search [m].
NEAREST, FARTHEST = 1.0, 5e6


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays of one radar.

    Attributes:
        scenario: The scenario of one radar, without the limits of the radar.
        limited: The same scenario with the limits.
        bearing: Bearing from the radar (n,) [rad].
        yaw: Yaw of the aircraft on each ray (n,) [rad], relative to the level plane at the
            aircraft.
        pose: State of the aircraft (6,). Only down, roll and pitch are used. With an origin, down
            is minus the height above the origin.
        aspect: Bearing of the radar from the heading (n,) [rad], which gives the yaw with an
            origin: north is another direction at each distance. None for rays of one yaw each.
    """

    scenario: Scenario
    limited: Scenario
    bearing: FloatArray
    yaw: FloatArray
    pose: FloatArray
    aspect: FloatArray | None = None

    def states(self, distance: FloatArray) -> FloatArray:
        """Return aircraft states (n, ..., 6) at distances (n, ...) [m]."""
        radar, origin = self.scenario.radar, self.scenario.origin
        of_ray = (slice(None), *[np.newaxis] * (distance.ndim - 1))
        states = np.empty((*distance.shape, len(AIRCRAFT)))
        states[...] = self.pose
        bearing = self.bearing[of_ray]
        states[..., 0], states[..., 1] = distance * np.cos(bearing), distance * np.sin(bearing)
        states[..., YAW] = self.yaw[of_ray]
        if origin is None:
            states[..., :DOWN] += radar[:DOWN]
            return states
        # first in the frame of the radar, whose level plane contains the rays
        place = geodesy.geodetic_from_ned(radar[POSITION], origin)
        states[..., DOWN] += place[2] - origin[2]
        aspect = None if self.aspect is None else self.aspect[of_ray]
        put_at_height(states, (place[0], place[1], place[2]), aspect)
        turn = geodesy.turn_to_origin(place, origin)
        states[..., POSITION] = states[..., POSITION] @ turn.T + radar[POSITION]
        states[..., ATTITUDE] = geodesy.turned_attitude(states[..., ATTITUDE], turn)
        return states

    def at(self, distance: FloatArray, *, limits: bool = False) -> Scenario:
        """Return the scenario with the poses at distances (n, ...), one pose after the other.

        It is without the limits of the radar, or with those, which errors may cross.
        """
        scenario = self.limited if limits else self.scenario
        return scenario.at_states(self.states(distance))

    def slant_range(self, distance: FloatArray) -> FloatArray:
        """Return the slant ranges (n,) [m] at distances (n,) [m]; 0 for 0, and NaN for NaN."""
        exists = np.nan_to_num(distance) > 0
        states = self.states(np.where(exists, distance, NEAREST))
        return np.where(exists, slant_range(states, self.scenario.radar), distance)

    def part(self, rays: slice | NDArray[np.intp]) -> Rays:
        """Return some of the rays."""
        aspect = None if self.aspect is None else self.aspect[rays]
        return dataclasses.replace(
            self, bearing=self.bearing[rays], yaw=self.yaw[rays], aspect=aspect
        )

    def p_d(self, distance: FloatArray) -> FloatArray:
        """Return P_D (n, ...) at distances (n, ...), without limits of the radar."""
        return self.scenario.model.p_d(self.states(distance), self.scenario.radar)

    @property
    def outer(self) -> Radar:
        """The radar with all limits but the minimum range."""
        return dataclasses.replace(self.limited.radars[0], min_range=0.0)

    def within(self, distance: FloatArray) -> NDArray[np.bool_]:
        """Return where (n, ...) distances (n, ...) are within all limits but the minimum range."""
        return self.outer.visible(self.states(distance), self.scenario.radar)

    def visible(self, distance: FloatArray) -> NDArray[np.bool_]:
        """Return where (n,) distances (n,) are within the limits of the radar; not at 0."""
        (radar,) = self.limited.radars
        seen = radar.visible(self.states(np.maximum(distance, NEAREST)), self.scenario.radar)
        return seen & (distance > 0)

    def quantile(self, distance: FloatArray, method: str, beta: float) -> FloatArray:
        """Return the quantile of P_D (n, ...) at Φ(β) by a method at distances (n, ...)."""
        return distribution(self.at(distance), method).quantile(beta).reshape(distance.shape)


def rays(
    scenario: Scenario,
    angle: FloatArray,
    *,
    by_aspect: bool,
    down: float | None,
    course: float | None,
) -> Rays:
    """Return the rays of a scenario of one radar at bearings (n,) [rad], clockwise from north.

    With `by_aspect` the angles are bearings of the radar from the heading, in the level plane at
    the aircraft, which turns at the first pose's bearing. The first pose gives height and attitude,
    unless `down` [m] or course [rad] is given.
    """
    pose = pose_in_cells(scenario, down, course)
    (radar,) = scenario.radars
    without = dataclasses.replace(scenario, radars=(radar.without_limits(),))
    bearing, yaw = angle, np.full(len(angle), pose[YAW])
    if by_aspect:
        first = _bearing(scenario)
        bearing, yaw = np.full(len(angle), first), first + math.pi - angle
    return Rays(without, scenario, bearing, yaw, pose, angle if by_aspect else None)


def _bearing(scenario: Scenario) -> float:
    """Return the bearing [rad] of the first pose from the radar, in the radar's level plane."""
    line = scenario.aircraft[0, POSITION] - scenario.radar[POSITION]
    if scenario.origin is not None:
        line = line @ geodesy.turn_from_level(scenario.radar[POSITION], scenario.origin)
    return math.atan2(line[1], line[0])
