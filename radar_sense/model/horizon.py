"""The radar horizon: how far a radar sees over the curve of the earth.

Refraction bends a radar's rays down. In the standard atmosphere they go as straight lines would
over an earth of 4/3 the radius (J. C. Schelleng, C. R. Burrows and E. B. Ferrell,
"Ultra-short-wave propagation", Proc. IRE 21(3), 1933), so that between two heights above the
surface the longest line of sight is

    R_h = √(2 a_e h_radar) + √(2 a_e h_target),  a_e = 4/3 · 6371 km

(M. I. Skolnik, Introduction to Radar Systems, 2nd ed., 1980, ch. 12), which leaves out terms of the
order h/a_e: less than 0.1 % for heights up to 20 km. Terrain is not in it. The radius of curvature
of the ellipsoid is within 1.1 % of the mean radius at every place and in every direction, which
changes R_h by 0.6 % at most. The spread of refraction is larger.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sense.model.geodesy import height_from_ned
from radar_sense.model.geometry import slant_range
from radar_sense.states import FloatArray

#: Mean radius of the earth [m].
EARTH_RADIUS = 6_371_000.0
#: a_e [m].
EFFECTIVE_RADIUS = 4.0 / 3.0 * EARTH_RADIUS


def horizon_range(radar_height: FloatArray, target_height: FloatArray) -> FloatArray:
    """R_h (...) [m] between heights above the surface (...) [m]; below the surface is on it."""
    root = np.sqrt(np.maximum(radar_height, 0.0)) + np.sqrt(np.maximum(target_height, 0.0))
    farthest: FloatArray = np.sqrt(2.0 * EFFECTIVE_RADIUS) * root
    return farthest


@dataclass(frozen=True)
class Horizon:
    """Where a target is hidden behind the earth: at a slant range above R_h.

    The down axis is straight. Whether the surface falls away from it is a matter of what the
    coordinates mean, and must be said:

    Attributes:
        tangent_plane: False where `down` is minus the height above the surface everywhere, as in a
            scenario in which an aircraft that flies level keeps its `down`. True where north, east
            and down are those of a plane that touches a spherical earth at the origin: at a
            horizontal distance d from the origin the surface is d²/2R below that plane, 7.8 km at
            316 km.
        altitude: Height of the origin above the surface [m].
        origin: Latitude, longitude [rad] and height above the WGS-84 ellipsoid [m] of the origin,
            where they are known. Heights are then those above the ellipsoid, however far from the
            origin, and `tangent_plane` and `altitude` are not used. A scenario in latitude and
            longitude has it. The ellipsoid differs from the sea by up to 107 m; a radar 10 m
            above the sea sees its horizon at 13 km, one 110 m above the sea at 43 km.
    """

    tangent_plane: bool = False
    altitude: float = 0.0
    origin: tuple[float, float, float] | None = None

    def height(self, states: FloatArray) -> FloatArray:
        """Height (...) [m] above the surface of states (..., 3 or more)."""
        if self.origin is not None:
            return height_from_ned(states, self.origin)
        north, east, down = (states[..., i] for i in range(3))
        if not self.tangent_plane:
            return self.altitude - down
        up = EARTH_RADIUS + self.altitude - down
        return np.sqrt(north * north + east * east + up * up) - EARTH_RADIUS

    def visible(self, aircraft: FloatArray, radar: FloatArray) -> NDArray[np.bool_]:
        """Say where a radar (..., 4) has a line of sight to an aircraft (..., 6)."""
        farthest = horizon_range(self.height(radar), self.height(aircraft))
        seen: NDArray[np.bool_] = slant_range(aircraft, radar) <= farthest
        return seen
