"""The radar horizon: how far a radar sees over the curve of the earth.

Refraction bends rays down. In the standard atmosphere they are like straight lines over an earth of
4/3 the radius (J. C. Schelleng, C. R. Burrows and E. B. Ferrell, "Ultra-short-wave propagation",
Proc. IRE 21(3), 1933). Between two heights above the surface the longest line of sight is

    R_h = √(2 a_e h_radar) + √(2 a_e h_target),  a_e = 4/3 · 6371 km

(M. I. Skolnik, Introduction to Radar Systems, 2nd ed., 1980, ch. 12). The formula leaves out
terrain, and terms of the order h/a_e: less than 0.1 % for heights up to 20 km. The radius of
curvature of the ellipsoid is within 1.1 % of the mean radius everywhere, which changes R_h by 0.6 %
at most. Refraction varies more than this.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radar_sense.covariance import largest_variance, variance_along
from radar_sense.limits import ANY, check_number
from radar_sense.model.geodesy import check_origin, height_from_ned, turn_from_level
from radar_sense.states import DOWN, POSITION, FloatArray

#: Mean radius of the earth [m].
EARTH_RADIUS = 6_371_000.0
#: a_e [m].
EFFECTIVE_RADIUS = 4.0 / 3.0 * EARTH_RADIUS


def horizon_range(radar_height: FloatArray, target_height: FloatArray) -> FloatArray:
    """Return R_h (...) [m] between heights above the surface (...) [m].

    A height below the surface counts as 0.
    """
    roots = np.sqrt(np.maximum(radar_height, 0.0)) + np.sqrt(np.maximum(target_height, 0.0))
    return np.sqrt(2.0 * EFFECTIVE_RADIUS) * roots


@dataclass(frozen=True)
class Horizon:
    """The earth, which hides a target at a slant range above R_h.

    Attributes:
        origin: Latitude, longitude [rad] and height above the WGS-84 ellipsoid [m] of the origin of
            the north-east-down frame. Heights are then heights above the ellipsoid at any distance
            from the origin. Without an origin the height is minus `down` everywhere, so that an
            aircraft in level flight keeps its `down`.
        surface: Height of the surface [m], in heights of the frame. The ellipsoid differs from the
            sea by up to 107 m: a radar 10 m above the surface has its horizon at 13 km, a radar
            110 m above the surface at 43 km.
    """

    origin: tuple[float, float, float] | None = None
    surface: float = 0.0

    def __post_init__(self) -> None:
        check_origin(self.origin)
        if self.origin is not None:
            object.__setattr__(self, "origin", tuple(self.origin))
        check_number("surface", self.surface, ANY)

    def height(self, states: FloatArray) -> FloatArray:
        """Return the height above the surface (...) [m] of states (..., 3 or more)."""
        if self.origin is not None:
            return height_from_ned(states, self.origin) - self.surface
        return -states[..., 2] - self.surface

    def height_error(
        self, states: FloatArray, covariance: FloatArray, reach: float = 1.0
    ) -> FloatArray:
        """Return by how much (k,) [m] errors of up to `reach` σ change the height of states (k, n).

        The covariances of the positions are (k, 3, 3). On the round earth an error in the level
        plane leads upwards, too.
        """
        if self.origin is None:
            return reach * np.sqrt(covariance[:, DOWN, DOWN])
        down = turn_from_level(states[:, POSITION], self.origin)[..., DOWN]
        aside = reach * reach * largest_variance(covariance)
        return reach * np.sqrt(variance_along(down, covariance)) + aside / (2.0 * EARTH_RADIUS)

    def range(self, aircraft: FloatArray, radar: FloatArray) -> FloatArray:
        """Return R_h (...) [m] between a radar (..., 4) and an aircraft (..., 6)."""
        return horizon_range(self.height(radar), self.height(aircraft))
