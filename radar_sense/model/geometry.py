"""The position of the radar in the body frame of the aircraft, and its derivatives.

North-east-down (NED) to body is the ZYX Euler sequence (Beard and McLain, *Small Unmanned
Aircraft*, 2012, ch. 2): a turn by yaw about z, then by pitch about the new y, then by roll about
the new x. Eq. (12) of the paper prints the transpose, body to NED.

Each turn mixes two components only. Vectors are therefore three arrays, one for each component. The
turn by α takes the pair (u, v) to (u cos α + v sin α, v cos α − u sin α).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from radar_sense.states import ATTITUDE, FloatArray, components_first

#: R² [m²] at which aircraft and radar coincide. The square of this does not underflow.
COINCIDE = 1e-100


class Vector(NamedTuple):
    """The three components of a vector, each an array of one shape."""

    x: FloatArray
    y: FloatArray
    z: FloatArray


class Turn(NamedTuple):
    """Cosine and sine of one Euler angle."""

    cos: FloatArray
    sin: FloatArray

    @classmethod
    def by(cls, angle: FloatArray) -> Turn:
        """Return the turn by an angle [rad].

        Cosine and sine are 2/(1 + t²) − 1 and 2t/(1 + t²) with t = tan(α/2). NumPy's tangent is
        vectorized, its sine and cosine are not. Rounding is no larger, even at α = π with t =
        1.6e16.
        """
        t = np.tan(np.multiply(0.5, angle, order="C"))
        scale = t * t
        scale += 1.0
        scale = 2.0 / scale
        t *= scale  # the sine
        scale -= 1.0  # the cosine
        return cls(cos=scale, sin=t)

    def apply(self, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return components (u, v) in axes turned by the angle; (v, u) are those turned back."""
        along, across = self.cos * u, self.cos * v
        along += self.sin * v
        across -= self.sin * u
        return along, across


class Attitude(NamedTuple):
    """The three turns from north-east-down to body."""

    roll: Turn
    pitch: Turn
    yaw: Turn

    @classmethod
    def from_state(cls, aircraft: FloatArray) -> Attitude:
        """Return the turns by the Euler angles [rad] of aircraft states (..., 6)."""
        cosines, sines = Turn.by(components_first(aircraft[..., ATTITUDE]))
        return cls(*map(Turn, cosines, sines))

    def to_body(self, ned: Vector) -> Vector:
        """Return a north-east-down vector d in the body frame, ρ = R_n^b d."""
        x, y, z = ned
        x, y = self.yaw.apply(x, y)
        z, x = self.pitch.apply(z, x)
        y, z = self.roll.apply(y, z)
        return Vector(x, y, z)

    def pull_back(self, body: Vector, gradient: Vector) -> tuple[Vector, Vector]:
        """Return the gradient by d and the Euler angles of a function f of ρ, by the chain rule.

        A turn of a pair (u, v) by α has the derivative d(u, v)/dα = (v, −u). With g the gradient by
        the turned pair, ∂f/∂α = g_u v − g_v u, one component of a cross product. `body` is ρ, and
        `gradient` ∂f/∂ρ.
        """
        (x, y, z), (gx, gy, gz) = body, gradient
        roll = gy * z - gz * y
        z, y = self.roll.apply(z, y)
        gz, gy = self.roll.apply(gz, gy)
        pitch = gz * x - gx * z
        x, z = self.pitch.apply(x, z)
        gx, gz = self.pitch.apply(gx, gz)
        yaw = gx * y - gy * x
        gy, gx = self.yaw.apply(gy, gx)
        return Vector(gx, gy, gz), Vector(roll, pitch, yaw)


def split(vectors: FloatArray) -> Vector:
    """Return the components of vectors (..., 3), without a copy."""
    return Vector(vectors[..., 0], vectors[..., 1], vectors[..., 2])


def join(components: Iterable[FloatArray]) -> FloatArray:
    """Return components as one array with the component axis last.

    Each component is contiguous in memory, which makes arithmetic on `array[..., i]` fast.
    """
    components = tuple(components)
    joined = np.empty((len(components), *np.shape(components[0])))
    for i, component in enumerate(components):
        joined[i] = component  # np.stack holds the interpreter lock while it copies
    return joined.transpose(*range(1, joined.ndim), 0)


def radar_from_aircraft(aircraft: FloatArray, radar: FloatArray) -> Vector:
    """Return the vector from aircraft (..., 6) to radar (..., 4) in north-east-down [m]."""
    return Vector(*(radar[..., i] - aircraft[..., i] for i in range(3)))


def range_squared(line: Vector) -> FloatArray:
    """Return R² (...) [m²], NaN where aircraft and radar coincide."""
    x, y, z = line
    squared = x * x
    squared += y * y
    squared += z * z
    apart = squared > COINCIDE
    return squared if apart.all() else np.where(apart, squared, np.nan)


def body_vector(aircraft: FloatArray, radar: FloatArray) -> FloatArray:
    """Return the vector (..., 3) [m] from aircraft to radar in the body frame, eq. (11)."""
    return join(Attitude.from_state(aircraft).to_body(radar_from_aircraft(aircraft, radar)))


def elevation_of(body_vectors: FloatArray) -> FloatArray:
    """Return the elevation (...) [rad] of body-frame vectors (..., 3), positive above."""
    x, y, z = split(body_vectors)
    return np.asarray(np.arctan2(-z, np.hypot(x, y)))


def slant_range(aircraft: FloatArray, radar: FloatArray) -> FloatArray:
    """Return the distance from aircraft (..., 6) to radar (..., 4) [m], eq. (5) of the paper."""
    x, y, z = radar_from_aircraft(aircraft, radar)
    return np.sqrt(x * x + y * y + z * z)


def orbit(
    azimuth: FloatArray, *, radius: float | FloatArray, down: float, azimuth_from: str = "east"
) -> FloatArray:
    """Return positions (..., 3) on a level circle about the origin of the north-east-down frame.

    The paper's [R sin θ_r, R cos θ_r, p_ad] measures θ_r from east, and R is the horizontal radius.
    A compass measures azimuth from north. The radius is that of all positions, or of each (...).
    """
    along, across = radius * np.cos(azimuth), radius * np.sin(azimuth)
    north, east = (across, along) if azimuth_from == "east" else (along, across)
    return np.stack([north, east, np.full_like(along, down)], axis=-1)
