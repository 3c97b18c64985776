"""Where the radar stands as seen from the aircraft, and how that changes with every state.

North-east-down (NED) to body is the ZYX Euler sequence: a turn by yaw about z, then by pitch about
the new y, then by roll about the new x (Beard and McLain, *Small Unmanned Aircraft*, 2012, ch. 2).
The paper's `eq:DCM_zyx` prints the transpose of it, body to NED.

Each turn mixes two components only, so vectors are carried as three component arrays. The turn by
α takes the pair (u, v) to (u cos α + v sin α, v cos α − u sin α).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from radar_sense.states import ATTITUDE, POSITION, FloatArray


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
        """Make the turn by an angle [rad].

        Cosine and sine are 2/(1 + t²) − 1 and 2t/(1 + t²) with t = tan(α/2). NumPy has a tangent
        that is vectorized where its sine and cosine are not: this takes a sixth of their time, and
        is as exact (at α = π, where t is 1.6e16, nothing is lost either).
        """
        t = np.tan(np.multiply(0.5, angle, order="C"))
        scale = t * t
        scale += 1.0
        scale = 2.0 / scale
        t *= scale  # in place: this is the sine now,
        scale -= 1.0  # and this the cosine
        return cls(cos=scale, sin=t)

    def apply(self, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Turn the axes of the (u, v) plane."""
        along, across = self.cos * u, self.cos * v
        along += self.sin * v
        across -= self.sin * u
        return along, across

    def undo(self, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Turn the axes of the (u, v) plane back."""
        along, across = self.cos * u, self.cos * v
        along -= self.sin * v
        across += self.sin * u
        return along, across


class Attitude(NamedTuple):
    """The three turns from north-east-down to body."""

    roll: Turn
    pitch: Turn
    yaw: Turn

    @classmethod
    def from_state(cls, aircraft: FloatArray) -> Attitude:
        """Take the Euler angles [rad] out of aircraft states (..., 6)."""
        cosines, sines = Turn.by(np.moveaxis(aircraft[..., ATTITUDE], -1, 0))
        return cls(*map(Turn, cosines, sines))

    def to_body(self, ned: Vector) -> Vector:
        """Express a north-east-down vector in the body frame: ρ = R_n^b d."""
        x, y, z = ned
        x, y = self.yaw.apply(x, y)
        z, x = self.pitch.apply(z, x)
        y, z = self.roll.apply(y, z)
        return Vector(x, y, z)

    def pull_back(self, body: Vector, gradient: Vector) -> tuple[Vector, Vector]:
        """Carry a gradient with respect to the body-frame vector back to what it depends on.

        A turn moves its pair (u, v) by d(u, v)/dα = (v, −u), so with g the gradient at that stage
        the partial for its angle is g_u v − g_v u: one component of a cross product.

        Args:
            body: ρ, the body-frame vector.
            gradient: ∂f/∂ρ.

        Returns:
            ∂f/∂d with respect to the north-east-down vector, and ∂f/∂(roll, pitch, yaw).
        """
        (x, y, z), (gx, gy, gz) = body, gradient
        roll = gy * z - gz * y
        y, z = self.roll.undo(y, z)
        gy, gz = self.roll.undo(gy, gz)
        pitch = gz * x - gx * z
        z, x = self.pitch.undo(z, x)
        gz, gx = self.pitch.undo(gz, gx)
        yaw = gx * y - gy * x
        gx, gy = self.yaw.undo(gx, gy)
        return Vector(gx, gy, gz), Vector(roll, pitch, yaw)


def split(vectors: FloatArray) -> Vector:
    """Take vectors (..., 3) apart into their components, without a copy."""
    return Vector(vectors[..., 0], vectors[..., 1], vectors[..., 2])


def join(components: Iterable[FloatArray]) -> FloatArray:
    """Put components together as an array with the component axis last.

    In memory each component stays one contiguous run, which is what makes arithmetic on
    `array[..., i]` fast.
    """
    components = tuple(components)
    joined = np.empty((len(components), *np.shape(components[0])))
    for i, component in enumerate(components):
        joined[i] = component  # np.stack would keep other threads waiting while it copies
    return np.moveaxis(joined, 0, -1)


def radar_from_aircraft(aircraft: FloatArray, radar: FloatArray) -> Vector:
    """Vector from aircraft (..., 6) to radar (..., 4) in north-east-down [m]."""
    ends = np.broadcast_arrays(radar[..., POSITION], aircraft[..., POSITION])
    to, of = (np.moveaxis(end, -1, 0) for end in ends)
    # One call for all components, each of them contiguous, whatever the states are in memory.
    return Vector(*np.subtract(to, of, order="C"))


def body_vector(aircraft: FloatArray, radar: FloatArray) -> FloatArray:
    """Position of the radar relative to the aircraft in the body frame, `eq:prb`.

    Args:
        aircraft: (..., 6), metres and radians.
        radar: (..., 4), of which the position [m] is used.

    Returns:
        (..., 3) [m]: out of the nose, out of the right wing, out of the bottom.
    """
    return join(Attitude.from_state(aircraft).to_body(radar_from_aircraft(aircraft, radar)))


def slant_range(aircraft: FloatArray, radar: FloatArray) -> FloatArray:
    """Distance from aircraft (..., 6) to radar (..., 4) [m], `eq:range`."""
    x, y, z = radar_from_aircraft(aircraft, radar)
    return np.sqrt(x * x + y * y + z * z)


def orbit(
    azimuth: FloatArray, *, radius: float, down: float, azimuth_from: str = "east"
) -> FloatArray:
    """Positions on a level circle about the origin of the north-east-down frame.

    The paper's [R sin θ_r, R cos θ_r, p_ad] measures θ_r from east, and R is the horizontal radius;
    a compass azimuth is measured from north.

    Args:
        azimuth: θ_r (...) [rad].
        radius: Horizontal radius R [m].
        down: Down coordinate p_ad [m].
        azimuth_from: "east" or "north".

    Returns:
        (..., 3) [m].
    """
    along, across = radius * np.cos(azimuth), radius * np.sin(azimuth)
    north, east = (across, along) if azimuth_from == "east" else (along, across)
    return np.stack([north, east, np.full_like(along, down)], axis=-1)
