"""Route files, allowed and refused, and the routes that are read.

A refusal is an `InputError` that names file, line, column, value and the allowed values.
"""

import math

import numpy as np
import pytest
from routes import (
    ATTITUDE,
    COV,
    DEG,
    GEO,
    HEAD,
    ORIGIN,
    POSE_HEAD,
    STD,
    UPPER,
    geodetic,
    load,
    ned,
    random_covariance,
    same,
    triangle,
)
from scenario_file.refused import refused
from scipy.spatial.transform import Rotation

from radar_sense import states
from radar_sense.covariance import problem
from radar_sense.model import geodesy as wgs84
from radar_sense.model.track import covariance_in_frame
from radar_sense.model.trajectory import resample
from radar_sense.scenario_file import text_file

G = 9.80665
SIMPLE = f"{HEAD}\n0,0,0,-1000\n1,100,0,-1000\n2,200,0,-1000\n"


pytestmark = pytest.mark.usefixtures("here")


# The content of a file.


def test_a_route_has_times_and_states():
    found = load(SIMPLE)
    np.testing.assert_array_equal(found.time_s, [0, 1, 2])
    np.testing.assert_array_equal(found.aircraft[:, :3], [[n, 0, -1000] for n in (0, 100, 200)])
    np.testing.assert_array_equal(found.aircraft[:, 3:], 0.0)
    assert found.covariance is None
    assert not found.attitude_given
    assert found.origin is None
    with pytest.raises(ValueError, match="read-only"):
        found.aircraft[0, 0] = 1.0


def test_the_same_route_with_other_columns():
    same(
        load("down_m,time_s,north_km,east_km\n-1000,0,0,0\n-1000,1,0.1,0\n-1000,2,0.2,0\n"),
        load(SIMPLE),
    )


def test_attitude_and_standard_deviations():
    header = ",".join([HEAD, *ATTITUDE, *STD])
    found = load(f"{header}\n5,1,2,3,10,-20,300,1,2,3,0.1,0.2,0.3\n")
    assert found.attitude_given
    np.testing.assert_allclose(found.aircraft, [[1, 2, 3, *DEG * np.array([10, -20, 300])]], 1e-15)
    std = [1, 2, 3, 0.1 * DEG, 0.2 * DEG, 0.3 * DEG]
    np.testing.assert_allclose(found.covariance, [np.diag(np.square(std))])


@pytest.mark.parametrize("rank", [1, 3, 6])
def test_the_upper_triangle_is_a_covariance(rank):
    rng = np.random.default_rng(rank)
    covariance = random_covariance(rng, 50, rank)
    path = ned(np.arange(50.0), rng.uniform(-1e5, 1e5, (50, 3)))
    columns = {**path, **triangle(covariance)}
    shuffled = {name: columns[name] for name in rng.permutation(list(columns))}
    found = load(shuffled).covariance
    units = np.array([1, 1, 1, DEG, DEG, DEG])
    np.testing.assert_allclose(found, covariance * np.outer(units, units), rtol=1e-15)


def test_a_covariance_may_be_nothing():
    columns = ned(np.arange(2.0), np.array([[0, 0, 0], [100.0, 0, 0]]))
    found = load({**columns, **triangle(np.zeros((2, 6, 6)))})
    assert not found.covariance.any()
    tiny = np.full((2, 6, 6), 1e-200)
    assert not load({**columns, **triangle(tiny)}).covariance.any()


# Latitude and longitude.


def in_frame(route):
    """C_aa of a route in the frame of its origin."""
    return covariance_in_frame(route.covariance, route.time_s, route.aircraft, route.origin)


def test_attitude_and_covariance_of_the_aircrafts_level_are_turned():
    rng = np.random.default_rng(1)
    count = 30
    place = np.array(ORIGIN) + rng.uniform(-1, 1, (count, 3)) * [0.3, 0.3, 1000]
    attitude = rng.uniform([-180, -60, -180], [180, 60, 180], (count, 3))
    covariance = random_covariance(rng, count)
    found = load(
        {
            **geodetic(np.arange(float(count)), place),
            **dict(zip(ATTITUDE, attitude.T, strict=True)),
            **triangle(covariance),
        },
        origin=ORIGIN,
    )
    turned = in_frame(found)
    for i in range(count):
        # The pose of the file, with a small error along each of its six components.
        axes = wgs84.ned_axes(ORIGIN) @ wgs84.ned_axes(place[i]).T

        def moved(by, i=i, axes=axes):
            local = Rotation.from_euler("ZYX", (attitude[i] * DEG + by[3:])[::-1])
            turned = (Rotation.from_matrix(axes) * local).as_euler("ZYX")[::-1]
            return np.hstack([wgs84.ned_from_geodetic(place[i], ORIGIN) + axes @ by[:3], turned])

        np.testing.assert_allclose(found.aircraft[i], moved(np.zeros(6)), rtol=1e-10, atol=1e-9)
        step = 1e-5
        slopes = [moved(step * unit) - moved(-step * unit) for unit in np.eye(6)]
        slopes = np.array(slopes).T
        slopes[3:] = (slopes[3:] + np.pi) % (2 * np.pi) - np.pi
        units = np.array([1, 1, 1, DEG, DEG, DEG])
        jacobian = slopes / (2 * step) * units
        expected = jacobian @ covariance[i] @ jacobian.T
        scale = np.sqrt(np.outer(np.diagonal(expected), np.diagonal(expected)))
        assert np.max(np.abs(turned[i] - expected) / scale) < 3e-3  # of position: 1e-4 m
        assert problem(turned[i]) is None
    np.testing.assert_array_equal(turned, np.swapaxes(turned, -1, -2))


def test_a_variance_of_zero_does_not_round_below_zero():
    # Position is uncertain along one axis of the origin's frame only.
    rng = np.random.default_rng(8)
    place = np.array(ORIGIN) + rng.uniform(-1, 1, (200, 3)) * [0.3, 0.3, 1000]
    axes = wgs84.turn_to_origin(place, ORIGIN)
    covariance = np.zeros((200, 6, 6))
    covariance[:, :3, :3] = 900 * axes[:, 0, :, np.newaxis] * axes[:, 0, np.newaxis, :]
    columns = {**geodetic(np.arange(200.0), place), **triangle(covariance)}
    found = in_frame(load(columns, origin=ORIGIN))
    np.testing.assert_allclose(found[:, 0, 0], 900, rtol=1e-12)
    variances = np.diagonal(found, axis1=-2, axis2=-1)
    assert np.all(variances >= 0)
    assert not np.any(found[variances == 0])


def test_the_size_of_the_blocks_changes_nothing(monkeypatch):
    rng = np.random.default_rng(7)
    time = np.cumsum(rng.uniform(0.5, 1.5, 50))
    place = np.array(ORIGIN) + np.outer(time, [3e-5, -2e-5, 10.0])
    columns = {**geodetic(time, place), **triangle(random_covariance(rng, 50))}
    found = []
    for block in (7, 2**14):
        monkeypatch.setattr(states, "BLOCK", block)
        path = load(columns, origin=ORIGIN)
        paths = path, resample(path, 0.5), resample(path, 0.5, "smooth")
        found += [(path, in_frame(path)) for path in paths]
    for (a, own), (b, other) in zip(found[:3], found[3:], strict=True):
        same(a, b)
        np.testing.assert_array_equal(a.covariance, b.covariance)
        np.testing.assert_array_equal(own, other)


def test_the_track_along_the_equator_is_level_where_the_aircraft_is():
    time = np.arange(0.0, 2000.0, 10.0)
    longitude = 250.0 / (wgs84.SEMI_MAJOR + 1e4) * time
    place = np.stack([0 * time, longitude, np.full_like(time, 1e4)], axis=-1)
    roll, pitch, yaw = load(geodetic(time, place), origin=(0.0, 0.0, 0.0)).aircraft[:, 3:].T
    np.testing.assert_allclose(roll, 0.0, atol=1e-9)
    np.testing.assert_allclose(pitch[1:-1], -longitude[1:-1], atol=1e-9)
    np.testing.assert_allclose(pitch, -longitude, atol=1e-7)  # one-sided at the ends
    np.testing.assert_allclose(yaw, np.pi / 2, atol=1e-12)


def test_two_rows_far_apart_are_level_where_the_aircraft_is():
    place = np.array([[0.0, 0.0, 1e4], [0.0, 0.1, 1e4]])
    found = load(geodetic([0.0, 2500.0], place), origin=(0.0, 0.0, 0.0)).aircraft
    np.testing.assert_allclose(found[:, 3:], [[0, 0, np.pi / 2], [0, -0.1, np.pi / 2]], atol=1e-12)


def test_the_bank_of_a_turn_is_relative_to_the_aircrafts_level():
    speed, radius = 200.0, 10e3
    time = np.arange(0.0, 300.0, 0.5)
    centre = np.array([41 * DEG, -102 * DEG, 0.0])
    angle = speed / radius * time
    circle = np.stack([radius * np.cos(angle), radius * np.sin(angle), -3000 + 0 * time], axis=-1)
    place = wgs84.geodetic_from_ned(circle, centre)
    found = load(geodetic(time, place), origin=ORIGIN)
    attitude = wgs84.turned_attitude(
        found.aircraft[:, 3:], np.swapaxes(wgs84.turn_to_origin(place, ORIGIN), -1, -2)
    )
    # The circle is level at its centre; at its rim the level is another by 10 km / 6370 km.
    np.testing.assert_allclose(attitude[:, 0], np.arctan(speed**2 / radius / G), atol=2e-4)
    np.testing.assert_allclose(attitude[:, 1], 0.0, atol=1e-4)


# Refusals.


WITH_STD = ",".join([HEAD, *STD])
WITH_COV = ",".join([HEAD, *COV])
ONES = ",".join(["1"] * 21)
IDENTITY = ",".join("1" if i == j else "0" for i, j in UPPER)

#: A file, and the error behind its name; `...` stands for any letters.
REFUSED = {
    "empty": ("", ": is empty; the first line must name the columns"),
    "no rows": (f"{HEAD}\n# none\n", ": has no rows"),
    "one row": (f"{HEAD}\n0,0,0,0\n", ": has 1 row; attitude from the track needs 2"),
    "not utf-8": (b"time_s,\xff\n", ":1: is not UTF-8 text: byte 0xff"),
    "zero bytes": (bytes(100), ":1: is not text: it has a zero byte"),
    "a long line": (b"x" * 100_000, ":1: is longer than 65536 bytes"),
    "no time": ("north_m,east_m,down_m\n0,0,0\n1,0,0\n",
                ":1: has no times; waypoints without times need a speed, geometry.speed_m_s or"),
    "no down": ("time_s,north_m,east_m\n", ":1: missing column 'down_m'"),
    "two units": (f"{HEAD},north_km\n", ":1: has north_m beside north_km; give only one"),
    "two frames": (f"{HEAD},latitude_deg\n", ":1: has north_m beside latitude_deg; give"),
    "two clocks": (f"{HEAD},speed_m_s\n", ":1: has time_s beside speed_m_s; give only"),
    "half an attitude": (f"{HEAD},roll_deg,yaw_deg\n", ":1: missing column 'pitch_deg', "
                         "required are all of roll_deg, pitch_deg, yaw_deg"),
    "half a covariance": (f"{HEAD},std_north_m\n", ":1: missing column 'std_east_m', "
                          "required are all of std_north_m to std_yaw_deg, or none"),
    "two covariances": (f"{WITH_STD},{','.join(COV)}\n",
                        ":1: has std_north_m beside cov_north_north_m2; give only one of the two"),
    "lower triangle": (f"{HEAD},cov_east_north_m2\n", ":1: ...did you mean 'cov_"),
    "far": (f"{HEAD}\n0,0,0,0\n1,2e8,0,0\n", ":3: north_m: must be a number not less than "
            "-1e+08 and not greater than 1e+08, got 200000000"),
    "time back": (f"{HEAD}\n0,0,0,0\n2,1,1,1\n# c\n1.5,2,2,2\n",
                  ":5: time_s: must be later than the time of the row before, got 0.5 s before it"),
    "time hardly moving": (f"{HEAD}\n0,0,0,0\n5e-10,1,1,1\n", ":3: time_s: must be later than the "
                           "time of the row before, got only 5e-10 s later; allowed is"),
    "latitude 91": (f"{GEO}\n0,0,0,0\n1,91,0,0\n", ":3: latitude_deg: ... than 90, got 91"),
    "pitch": (f"{POSE_HEAD}\n0,0,0,0,0,90.1,0\n", ":2: pitch_deg: ... than 90, got 90.1"),
    "no origin": (f"{GEO}\n0,0,0,0\n", ":1: latitude and longitude need the or"),
    "negative std": (f"{WITH_STD}\n0,0,0,0,1,1,-1,1,1,1\n", ":2: std_down_m: must be"),
    "negative variance": (f"{WITH_COV}\n0,0,0,0,{IDENTITY.replace('1', '-1', 1)}\n",
                          ":2: cov_north_north_m2: must be a number not less than 0"),
    "not semidefinite": (
        f"{WITH_COV}\n0,0,0,0,{IDENTITY}\n1,1,0,0,{ONES.replace('1,1', '1,1.1', 1)}\n",
        ":3: covariance is not positive semidefinite: its correlation matrix has the"),
    "never moves": (f"{HEAD}\n0,0,0,0\n1,0,0,-5\n",
                    ": the aircraft never moves horizontally at 0.1 m/s or more, attitude cannot"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_bad_files_are_refused_with_their_line(name):
    content, says = REFUSED[name]
    with refused(f"route.csv{says}"):
        load(content)


def test_gaps_are_refused_if_asked():
    text = f"{HEAD}\n0,0,0,0\n1,100,0,0\n11.5,200,0,0\n"
    for allowed in (None, 10.5):
        assert len(load(text, max_gap_s=allowed).time_s) == 3
    with refused("route.csv:4: time_s: must be within 10 s ... 10.5"):
        load(text, max_gap_s=10)
    for wrong in (0, -1, math.nan):
        with refused("max_gap_s must be"):
            load(text, max_gap_s=wrong)
    with refused("route.csv:1: has no times; max_gap_s"):
        load("north_m,east_m,down_m\n0,0,0\n100,0,0\n", max_gap_s=10, speed_m_s=1)


def test_a_hover_before_the_first_leg_has_the_course_of_departure():
    route = load(f"{HEAD}\n0,0,0,0\n60,0,0,0\n120,3000,0,0\n180,3000,3000,0\n240,3000,3000,0\n")
    assert np.rad2deg(route.aircraft[:, 5]) == pytest.approx([0, 0, 45, 90, 90])
    assert not route.aircraft[:2, 3:5].any()


def test_an_origin_must_be_a_place_and_have_a_use():
    with refused("route.csv:1: north, east and down"):
        load(SIMPLE, origin=ORIGIN)
    for wrong in ((2.0, 0.0, 0.0), (math.nan, 0.0, 0.0), (0.0, math.inf, 0.0)):
        with pytest.raises(ValueError, match="origin must be"):
            load(f"{GEO}\n0,0,0,0\n1,0,1,0\n", origin=wrong)


def test_too_large_a_file(monkeypatch):
    monkeypatch.setattr(text_file, "MAX_BYTES", 2**20)
    with refused("is larger than 1 MiB"):
        load(SIMPLE + f"#{'x' * 2**15}\n" * 32)
