"""From latitude, longitude and height on the WGS-84 ellipsoid to a local north-east-down frame.

Three frames: geodetic (latitude [rad], longitude [rad], height above the ellipsoid [m]); ECEF,
earth-centred and earth-fixed [m], x towards latitude 0 and longitude 0, z towards the north pole;
and NED, north-east-down [m] about an origin, level there.

NED about an origin is ECEF shifted and turned. Lines of sight are straight lines of NED. At a
horizontal distance d the ground is d²/2R below the tangent plane, 20 km at 500 km. The "down" of an
aircraft in level flight grows by the same amount. Level at the aircraft differs from level at the
origin by the angle d/R, 4.5° at 500 km. An attitude relative to level at the aircraft must
therefore be turned into NED.

Sources: the ellipsoid is from NIMA TR8350.2 (*Department of Defense World Geodetic System 1984*,
third edition, 2000), table 3.1. The transformations are from B. Hofmann-Wellenhof, H. Lichtenegger
and E. Wasle, *GNSS*, 2008, ch. 8, unless another source is given.

Positions are (..., 3): `geodetic`, `ecef` or `ned` as above. An `origin` is geodetic, (3,); one
position (3,) of `geodetic_from_ned`, and places of `turn_to_origin`, may have many, (..., 3).
Attitudes are ZYX Euler angles (..., 3) [rad]: roll, pitch, yaw. Those returned have roll and yaw
from −π to π, and pitch from −π/2 to π/2.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from radar_sense.errors import InputError
from radar_sense.model.geometry import join
from radar_sense.states import FloatArray

#: Semi-major axis a [m] and flattening f: they define the ellipsoid.
SEMI_MAJOR = 6378137.0
FLATTENING = 1.0 / 298.257223563
#: Semi-minor axis b [m], first eccentricity squared e² and second e'².
SEMI_MINOR = SEMI_MAJOR * (1.0 - FLATTENING)
#: Least radius of curvature [m]: that of the meridian at the equator.
LEAST_RADIUS = SEMI_MINOR**2 / SEMI_MAJOR
ECCENTRICITY_2 = FLATTENING * (2.0 - FLATTENING)
SECOND_ECCENTRICITY_2 = ECCENTRICITY_2 / (1.0 - ECCENTRICITY_2)
#: Iterations of Bowring's method. One iteration has an error of 1 µm within 10 km of the ellipsoid
#: and of 5 cm far out. Two are exact to rounding from 1000 km below the ellipsoid to 100 000 km
#: above. A height alone is exact there after one, as it is stationary in the latitude.
_ROUNDS, _ROUNDS_OF_HEIGHT = 2, 1


def check_origin(origin: Any) -> None:
    """Raise InputError unless an origin is None, or a geodetic position (3,)."""
    try:
        place = np.zeros(3) if origin is None else np.asarray(origin, dtype=float)
    except (TypeError, ValueError):
        place = np.empty(0)
    finite = place.shape == (3,) and np.isfinite(place).all()
    if not finite or abs(place[0]) > np.pi / 2 or abs(place[1]) > 2 * np.pi:
        raise InputError(
            f"origin must be latitude and longitude [rad] and height [m], got {origin!r}"
        )


def ecef_from_geodetic(geodetic: ArrayLike) -> FloatArray:
    """Return the ECEF position of a geodetic position."""
    geodetic = np.asarray(geodetic, dtype=float)
    latitude, longitude, height = (geodetic[..., i] for i in range(3))
    sin, cos = np.sin(latitude), np.cos(latitude)
    # The radius of curvature in the prime vertical, N.
    normal = SEMI_MAJOR / np.sqrt(1.0 - ECCENTRICITY_2 * sin * sin)
    from_axis = (normal + height) * cos
    return join(
        (
            from_axis * np.cos(longitude),
            from_axis * np.sin(longitude),
            ((1.0 - ECCENTRICITY_2) * normal + height) * sin,
        )
    )


def geodetic_from_ecef(ecef: ArrayLike) -> FloatArray:
    """Return the geodetic position of an ECEF position, the longitude from −π to π.

    The position is not within some 100 km of the centre of the earth. The longitude is 0 on the
    axis of the earth.

    B. R. Bowring, "Transformation from spatial to geographical coordinates", Survey Review 23(181),
    1976: with β the reduced latitude, tan β = (1 − f) tan φ,

        tan φ = (z + e'² b sin³β) / (p − e² a cos³β),

    The code uses sines and cosines, because tangents are infinite at the poles. The height
    h = p cos φ + z sin φ − a √(1 − e² sin²φ) loses no digits at any latitude (Bowring, "The
    accuracy of geodetic latitude and height equations", Survey Review 28(218), 1985).
    """
    ecef = np.asarray(ecef, dtype=float)
    x, y, z = (ecef[..., i] for i in range(3))
    sin, cos, height = _meridian(np.hypot(x, y), z)
    return join((np.arctan2(sin, cos), np.arctan2(y, x), height))


def ned_axes(geodetic: ArrayLike) -> FloatArray:
    """Return the matrix (..., 3, 3) from ECEF to NED, with north, east and down as rows."""
    geodetic = np.asarray(geodetic, dtype=float)
    sin, cos = np.sin(geodetic[..., 0]), np.cos(geodetic[..., 0])
    sin_lon, cos_lon = np.sin(geodetic[..., 1]), np.cos(geodetic[..., 1])
    rows = (
        (-sin * cos_lon, -sin * sin_lon, cos),
        (-sin_lon, cos_lon, np.zeros_like(cos)),
        (-cos * cos_lon, -cos * sin_lon, -sin),
    )
    return _matrix(rows)


def ned_from_geodetic(geodetic: ArrayLike, origin: ArrayLike) -> FloatArray:
    """Return the position in the north-east-down frame of an origin."""
    line = ecef_from_geodetic(geodetic) - ecef_from_geodetic(origin)
    return line @ ned_axes(origin).T


def geodetic_from_ned(ned: ArrayLike, origin: ArrayLike) -> FloatArray:
    """Return the geodetic position of a north-east-down position, the longitude from −π to π."""
    return geodetic_from_ecef(
        np.asarray(ned, dtype=float) @ ned_axes(origin) + ecef_from_geodetic(origin)
    )


def height_from_ned(ned: FloatArray, origin: ArrayLike) -> FloatArray:
    """Return the height above the ellipsoid (...) [m] of positions (..., 3 or more).

    The result is the third component of `geodetic_from_ned`, without the cost of angles.
    """
    north, east, down = (ned[..., i] for i in range(3))
    latitude, _, height = np.asarray(origin, dtype=float)
    sin, cos = np.sin(latitude), np.cos(latitude)
    # x points from the axis of the earth to the origin, z to the north pole.
    x, _, z = ecef_from_geodetic((latitude, 0.0, height))
    x = x - sin * north - cos * down
    z = z + cos * north - sin * down
    _, _, above = _meridian(np.sqrt(x * x + east * east), z, _ROUNDS_OF_HEIGHT)
    return above


def turn_to_origin(geodetic: ArrayLike, origin: ArrayLike) -> FloatArray:
    """Return the matrix M (..., 3, 3) from the frame of a place to the frame of an origin.

    The columns of M are north, east and down of the place in the frame of the origin.
    """
    return np.matmul(ned_axes(origin), np.swapaxes(ned_axes(geodetic), -1, -2))


def turn_from_level(ned: ArrayLike, origin: ArrayLike) -> FloatArray:
    """Return the matrix (..., 3, 3) from level at a north-east-down position to its frame."""
    return turn_to_origin(geodetic_from_ned(ned, origin), origin)


def turned_attitude(attitude: ArrayLike, turn: FloatArray) -> FloatArray:
    """Return an attitude relative to a new north-east-down frame.

    The matrix from the new frame to body is the matrix from the old frame to body times M⁻¹ = Mᵀ,
    with the turn M (..., 3, 3) from the old frame to the new one. The angles of the product are
    exact.
    """
    return euler_angles(np.matmul(body_axes(attitude), np.swapaxes(turn, -1, -2)))


def turned_attitude_jacobian(attitude: FloatArray, turned: FloatArray) -> FloatArray:
    """Return the partials (..., 3, 3) of a turned attitude, whose pitch is not ±π/2, by the given.

    A small change δ of roll, pitch and yaw turns the body by ω = B(roll, pitch) δ, in body
    components. B is the inverse of the matrix in the kinematics of the Euler angles (Beard and
    McLain, *Small Unmanned Aircraft*, 2012, ch. 3). ω is the same for both frames:
    B(turned) d(turned) = B(attitude) d(attitude).
    """
    roll, pitch = turned[..., 0], turned[..., 1]
    sin, cos, tan = np.sin(roll), np.cos(roll), np.tan(pitch)
    one, zero, secant = np.ones_like(sin), np.zeros_like(sin), 1.0 / np.cos(pitch)
    inverse = ((one, sin * tan, cos * tan), (zero, cos, -sin), (zero, sin * secant, cos * secant))
    roll, pitch = attitude[..., 0], attitude[..., 1]
    sin, cos, across = np.sin(roll), np.cos(roll), np.cos(pitch)
    rates = ((one, zero, -np.sin(pitch)), (zero, cos, sin * across), (zero, -sin, cos * across))
    return np.matmul(_matrix(inverse), _matrix(rates))


def body_axes(attitude: ArrayLike) -> FloatArray:
    """Return the matrix R_n^b (..., 3, 3), with nose, right wing and bottom as rows.

    It is the transpose of the matrix printed as eq. (12) of the paper.
    """
    attitude = np.asarray(attitude, dtype=float)
    (sr, sp, sy), (cr, cp, cy) = (
        [function(attitude[..., i]) for i in range(3)] for function in (np.sin, np.cos)
    )
    rows = (
        (cp * cy, cp * sy, -sp),
        (sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp),
        (cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp),
    )
    return _matrix(rows)


def euler_angles(axes: FloatArray) -> FloatArray:
    """Return the attitude of a matrix R_n^b (..., 3, 3), the inverse of `body_axes`.

    The roll is computed after a turn back by the yaw. The three angles are consistent even near a
    pitch of ±π/2, where only the sum or the difference of yaw and roll is defined.
    """
    nose, wing, bottom = (axes[..., i, :] for i in range(3))
    yaw = np.arctan2(nose[..., 1], nose[..., 0])
    pitch = np.arctan2(-nose[..., 2], np.hypot(nose[..., 0], nose[..., 1]))
    sin, cos = np.sin(yaw), np.cos(yaw)
    roll = np.arctan2(
        sin * bottom[..., 0] - cos * bottom[..., 1], cos * wing[..., 1] - sin * wing[..., 0]
    )
    return join((roll, pitch, yaw))


def _matrix(rows: Sequence[Sequence[FloatArray]]) -> FloatArray:
    """Return matrices (..., 3, 3) from their entries (...)."""
    entries = [entry for row in rows for entry in row]
    return join(entries).reshape(*entries[0].shape, 3, 3)


def _meridian(
    p: FloatArray, z: FloatArray, rounds: int = _ROUNDS
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return sine and cosine of the latitude, and height [m], from p and z of Bowring's formula."""
    # A pair in proportion to sine and cosine of φ. The pair of β is (1 − f) sin φ, cos φ.
    sin, cos = z / (1.0 - FLATTENING) ** 2, p
    for _ in range(rounds):
        s, c = _unit((1.0 - FLATTENING) * sin, cos)
        # Products, because powers of arrays are slow.
        sin = z + SECOND_ECCENTRICITY_2 * SEMI_MINOR * (s * s * s)
        cos = p - ECCENTRICITY_2 * SEMI_MAJOR * (c * c * c)
    sin, cos = _unit(sin, cos)
    height = p * cos + z * sin - SEMI_MAJOR * np.sqrt(1.0 - ECCENTRICITY_2 * sin * sin)
    return sin, cos, height


def _unit(sin: FloatArray, cos: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the sine and cosine that a pair is in proportion to."""
    length = np.sqrt(sin * sin + cos * cos)  # np.hypot is slower
    return sin / length, cos / length
