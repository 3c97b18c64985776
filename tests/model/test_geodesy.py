"""Latitude, longitude and height to a local frame: against the definitions, in fifty digits."""

import numpy as np
import pytest
from mpmath import mp, mpf
from scipy.spatial.transform import Rotation

from radar_sense.model import geodesy as wgs84

A, F = mpf(6378137), 1 / mpf("298.257223563")
EARTH = 6.37e6


def by_definition(latitude, longitude, height):
    """ECEF position: where x²/a² + y²/a² + z²/b² = 1 has the normal n, and h n on top of it."""
    with mp.workdps(50):
        lat, lon, h = mpf(latitude), mpf(longitude), mpf(height)
        n = (mp.cos(lat) * mp.cos(lon), mp.cos(lat) * mp.sin(lon), mp.sin(lat))
        # The gradient (x/a², y/a², z/b²) is in proportion to n: the point is s (a² n, a² n, b² n).
        squares = (A**2, A**2, (A * (1 - F)) ** 2)
        s = 1 / mp.sqrt(sum(q * c * c for q, c in zip(squares, n, strict=True)))
        return [float(s * q * c + h * c) for q, c in zip(squares, n, strict=True)]


def places(count, seed=0, low=-1e4, high=1e5):
    half = np.pi / 2
    lowest, highest = [-half, -np.pi, low], [half, np.pi, high]
    return np.random.default_rng(seed).uniform(lowest, highest, (count, 3))


def test_ecef_follows_the_definition():
    edges = [[0, 0, 0], [np.pi / 2, 0, 0], [-np.pi / 2, 1, 50], [0, np.pi, 1e8], [1e-9, -2, -1e4]]
    for place in [*edges, *places(300), *places(100, 1, 1e5, 1e8)]:
        far = wgs84.SEMI_MAJOR + abs(place[2])
        ecef = wgs84.ecef_from_geodetic(place)
        np.testing.assert_allclose(ecef, by_definition(*place), rtol=0, atol=4e-16 * far)


def test_a_published_example():
    # The reference point of the tests of pymap3d (M. Hirsch, JOSS 3(23), 2018), from MATLAB.
    origin = np.array([np.radians(42.0), np.radians(-82.0), 200.0])
    place = np.array([np.radians(42.002582), np.radians(-81.997752), 1139.7018])
    np.testing.assert_allclose(
        wgs84.ecef_from_geodetic(origin), [660675.2518247, -4700948.68316, 4245737.66222], atol=6e-6
    )
    # The place is given to 1e-6 degrees, 0.06 m to either side.
    np.testing.assert_allclose(
        wgs84.ned_from_geodetic(place, origin), [286.842228, 186.277521, -939.692621], atol=0.06
    )


@pytest.mark.parametrize(
    ("low", "high", "height"), [(-1e6, -1e4, 1e-8), (-1e4, 1e5, 1e-8), (1e5, 1e8, 6e-8)]
)
def test_there_and_back(low, high, height):
    """To 6 nm on the ground."""
    there = places(50_000, 2, low, high)
    there[:4, 0] = [0.0, np.pi / 2, -np.pi / 2, 1e-300]
    back = wgs84.geodetic_from_ecef(wgs84.ecef_from_geodetic(there))
    assert np.all(np.max(np.abs(back - there), axis=0) < [1e-15, 1e-14, height])


def test_there_and_back_by_way_of_an_origin():
    there, origin = places(10_000, 3, 0, 2e4), [0.7, -2.0, 300.0]
    back = wgs84.geodetic_from_ned(wgs84.ned_from_geodetic(there, origin), origin)
    off = (back - there) * [EARTH, EARTH, 1]
    off[:, 1] *= np.cos(there[:, 0])
    assert np.max(np.abs(off)) < 2e-8


def test_the_turn_to_the_origin_takes_the_axes_of_a_place_with_it():
    origin = np.array([0.8, 0.1, 0.0])
    for place in places(50, 4):
        turn = wgs84.turn_to_origin(place, origin)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=4e-16)
        steps = np.eye(3) * [1e-5, 1e-5, -1e3]
        for column, step in zip(turn.T, steps, strict=True):
            moved = wgs84.ned_from_geodetic(place + step, origin) - wgs84.ned_from_geodetic(
                place - step, origin
            )
            np.testing.assert_allclose(column, moved / np.linalg.norm(moved), atol=2e-9)


def random_attitudes(count, seed):
    rng = np.random.default_rng(seed)
    half = np.pi / 2
    return rng.uniform([-np.pi, -half, -np.pi], [np.pi, half, np.pi], (count, 3))


def body_to_ned(attitude):
    """Return SciPy's rotation, which is a quaternion."""
    return Rotation.from_euler("ZYX", np.asarray(attitude)[..., ::-1])


def test_body_axes_and_back():
    attitude = random_attitudes(2000, 5)
    axes = wgs84.body_axes(attitude)
    np.testing.assert_allclose(axes, body_to_ned(attitude).inv().as_matrix(), atol=1e-15)
    shallow = np.abs(attitude[:, 1]) < 1.5
    off = wgs84.euler_angles(axes) - attitude
    assert np.max(np.abs(off[shallow])) < 2e-14
    np.testing.assert_allclose(wgs84.body_axes(wgs84.euler_angles(axes)), axes, atol=2e-15)


@pytest.mark.parametrize("away", [0.0, 1e-300, 1e-16, 1e-12, 1e-8, 1e-4])
@pytest.mark.parametrize("sign", [-1, 1])
def test_euler_angles_straight_up_and_down_keep_the_attitude(sign, away):
    attitude = random_attitudes(200, 6)
    attitude[:, 1] = sign * (np.pi / 2 - away)
    axes = wgs84.body_axes(attitude)
    np.testing.assert_allclose(wgs84.body_axes(wgs84.euler_angles(axes)), axes, atol=2e-15)
    exact = np.array([[0.0, 0, -1], [0.6, 0.8, 0], [0.8, -0.6, 0]])  # not a rounded one
    np.testing.assert_allclose(wgs84.body_axes(wgs84.euler_angles(exact)), exact, atol=1e-15)


def test_an_attitude_turned_is_the_same_attitude_in_space():
    attitude, there, origin = random_attitudes(500, 7), places(500, 8), np.array([0.5, 1.0, 0.0])
    turn = wgs84.turn_to_origin(there, origin)
    turned = wgs84.turned_attitude(attitude, turn)
    expected = Rotation.from_matrix(turn) * body_to_ned(attitude)
    assert np.max((body_to_ned(turned) * expected.inv()).magnitude()) < 3e-15


def test_errors_of_attitude_turn_as_differences():
    attitude = random_attitudes(300, 9)
    turn = wgs84.turn_to_origin(places(300, 10), [0.9, -0.4, 0.0])
    turned = wgs84.turned_attitude(attitude, turn)
    shallow = np.abs(turned[:, 1]) < 1.4
    jacobian = wgs84.turned_attitude_jacobian(attitude, turned)
    step = 1e-5
    for i in range(3):
        ends = [
            wgs84.turned_attitude(attitude + sign * step * np.eye(3)[i], turn) for sign in (1, -1)
        ]
        slope = (ends[0] - ends[1] + np.pi) % (2 * np.pi) - np.pi  # across ±180°
        off = jacobian[shallow, :, i] - slope[shallow] / (2 * step)
        assert np.max(np.abs(off)) < 1e-7
