"""Route files, allowed and refused, and the routes that are read and interpolated.

A refusal is a `ScenarioError` that names file, line, column, value and the allowed values.
Attitudes from the track are checked on paths whose attitude is known exactly.
"""

import math
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from radar_sense.covariance import problem
from radar_sense.errors import ScenarioError
from radar_sense.model import geodesy as wgs84
from radar_sense.model import track
from radar_sense.model.track import attitude_from_motion, motion_of_samples
from radar_sense.model.trajectory import METHODS, resample
from radar_sense.reading import csv_reader, route_file
from radar_sense.reading.route_file import load_route

G = 9.80665
DEG = np.pi / 180
ORIGIN = (40 * DEG, -105 * DEG, 1600.0)
STATES = ["north", "east", "down", "roll", "pitch", "yaw"]
ATTITUDE = ["roll_deg", "pitch_deg", "yaw_deg"]
STD = [f"std_{s}_{'m' if i < 3 else 'deg'}" for i, s in enumerate(STATES)]
UPPER = [(i, j) for i in range(6) for j in range(i, 6)]
COV = [
    f"cov_{STATES[i]}_{STATES[j]}_{'m2' if j < 3 else 'm_deg' if i < 3 else 'deg2'}"
    for i, j in UPPER
]

SIMPLE = "time_s,north_m,east_m,down_m\n0,0,0,-1000\n1,100,0,-1000\n2,200,0,-1000\n"


@pytest.fixture
def file(tmp_path, monkeypatch):
    """Write a file `route.csv`, of text, bytes, or columns by name."""
    monkeypatch.chdir(tmp_path)

    def write(content):
        if isinstance(content, dict):
            rows = zip(*content.values(), strict=True)
            lines = [",".join(content), *(",".join(repr(float(x)) for x in row) for row in rows)]
            content = "\n".join(lines) + "\n"
        if isinstance(content, str):
            content = content.encode()
        (tmp_path / "route.csv").write_bytes(content)
        return "route.csv"

    return write


@pytest.fixture
def load(file):
    return lambda content, **options: load_route(file(content), **options)


def ned(time, position):
    return dict(zip(["time_s", "north_m", "east_m", "down_m"], [time, *position.T], strict=True))


def geodetic(time, place):
    names = ["time_s", "latitude_deg", "longitude_deg", "altitude_m"]
    return dict(zip(names, [time, place[:, 0] / DEG, place[:, 1] / DEG, place[:, 2]], strict=True))


def random_covariance(rng, count, rank=6):
    mix = rng.standard_normal((count, 6, rank)) * 10.0 ** rng.uniform(-3, 2, (count, 6, 1))
    return mix @ np.swapaxes(mix, -1, -2)


def triangle(covariance):
    return {name: covariance[:, i, j] for name, (i, j) in zip(COV, UPPER, strict=True)}


def same(a, b):
    for x, y in ((a.time_s, b.time_s), (a.aircraft, b.aircraft), (a.distance_m, b.distance_m)):
        np.testing.assert_array_equal(x, y)


# The content of a file.


def test_a_route_has_times_states_and_distance(load):
    found = load(SIMPLE)
    np.testing.assert_array_equal(found.time_s, [0, 1, 2])
    np.testing.assert_array_equal(found.aircraft[:, :3], [[n, 0, -1000] for n in (0, 100, 200)])
    np.testing.assert_array_equal(found.aircraft[:, 3:], 0.0)
    np.testing.assert_array_equal(found.distance_m, [0, 100, 200])
    assert found.covariance is None
    assert not found.attitude_given
    assert found.origin is None
    with pytest.raises(ValueError, match="read-only"):
        found.aircraft[0, 0] = 1.0


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + SIMPLE,
        SIMPLE.replace("\n", "\r\n"),
        SIMPLE.rstrip("\n"),
        SIMPLE.replace("\n", "\n\n"),
        "# größer\n\n  # b\n" + SIMPLE.replace("\n", " # c, d\n"),
        SIMPLE.replace("\n", "\n   \n"),  # which NumPy does not read: the slow way
        SIMPLE.replace(",", " ,  "),
        SIMPLE.replace(",100", ",+.1e3").replace("200", "2.E+02"),
        "down_m,time_s,north_km,east_km\n-1000,0,0,0\n-1000,1,0.1,0\n-1000,2,0.2,0\n",
    ],
)
@pytest.mark.parametrize("piece", [7, 2**22])
def test_the_same_route_written_otherwise(load, text, piece, monkeypatch):
    expected = load(SIMPLE)
    monkeypatch.setattr(csv_reader, "READ_BYTES", piece)
    same(load(text), expected)


def test_attitude_and_standard_deviations(load):
    std = [1, 2, 3, 0.1, 0.2, 0.3]
    header = ",".join(["time_s", "north_m", "east_m", "down_m", *ATTITUDE, *STD])
    found = load(f"{header}\n5,1,2,3,10,-20,300,{','.join(map(str, std))}\n")
    assert found.attitude_given
    np.testing.assert_allclose(
        found.aircraft, [[1, 2, 3, 10 * DEG, -20 * DEG, 300 * DEG]], rtol=1e-15
    )
    np.testing.assert_allclose(
        found.covariance, [np.diag(np.square([1, 2, 3, 0.1 * DEG, 0.2 * DEG, 0.3 * DEG]))]
    )
    np.testing.assert_array_equal(found.distance_m, [0])


@pytest.mark.parametrize("rank", [1, 3, 6])
def test_the_upper_triangle_is_a_covariance(load, rank, monkeypatch):
    monkeypatch.setattr(csv_reader, "READ_BYTES", 5000)  # several pieces
    rng = np.random.default_rng(rank)
    covariance = random_covariance(rng, 50, rank)
    path = ned(np.arange(50.0), rng.uniform(-1e5, 1e5, (50, 3)))
    columns = {**path, **triangle(covariance)}
    shuffled = {name: columns[name] for name in rng.permutation(list(columns))}
    found = load(shuffled).covariance
    units = np.array([1, 1, 1, DEG, DEG, DEG])
    np.testing.assert_allclose(found, covariance * np.outer(units, units), rtol=1e-15)


def test_a_covariance_may_be_nothing(load):
    columns = ned(np.arange(2.0), np.array([[0, 0, 0], [100.0, 0, 0]]))
    found = load({**columns, **triangle(np.zeros((2, 6, 6)))})
    assert not found.covariance.any()
    tiny = np.full((2, 6, 6), 1e-200)
    assert not load({**columns, **triangle(tiny)}).covariance.any()


# Latitude and longitude.


def test_places_become_positions_about_the_origin(load):
    rng = np.random.default_rng(0)
    place = np.array(ORIGIN) + rng.uniform(-1, 1, (40, 3)) * [0.05, 0.05, 1000]
    found = load(geodetic(np.arange(40.0), place), origin=ORIGIN)
    assert found.origin == ORIGIN
    np.testing.assert_allclose(
        found.aircraft[:, :3], wgs84.ned_from_geodetic(place, ORIGIN), rtol=0, atol=1e-8
    )
    east_of_greenwich = place + np.array([0, 2 * np.pi, 0])  # 0 to 360
    again = load(geodetic(np.arange(40.0), east_of_greenwich), origin=ORIGIN)
    np.testing.assert_allclose(again.aircraft, found.aircraft, rtol=0, atol=1e-7)


def test_attitude_and_covariance_of_the_aircrafts_level_are_turned(load):
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
        assert np.max(np.abs(found.covariance[i] - expected) / scale) < 3e-3  # of position: 1e-4 m
        assert problem(found.covariance[i]) is None
    np.testing.assert_array_equal(found.covariance, np.swapaxes(found.covariance, -1, -2))


def test_a_variance_of_zero_does_not_round_below_zero(load):
    # Position is uncertain along one axis of the origin's frame only.
    rng = np.random.default_rng(8)
    place = np.array(ORIGIN) + rng.uniform(-1, 1, (200, 3)) * [0.3, 0.3, 1000]
    axes = wgs84.turn_to_origin(place, ORIGIN)
    covariance = np.zeros((200, 6, 6))
    covariance[:, :3, :3] = 900 * axes[:, 0, :, np.newaxis] * axes[:, 0, np.newaxis, :]
    columns = {**geodetic(np.arange(200.0), place), **triangle(covariance)}
    found = load(columns, origin=ORIGIN).covariance
    np.testing.assert_allclose(found[:, 0, 0], 900, rtol=1e-12)
    variances = np.diagonal(found, axis1=-2, axis2=-1)
    assert np.all(variances >= 0)
    assert not np.any(found[variances == 0])


def test_the_size_of_the_blocks_changes_nothing(load, monkeypatch):
    rng = np.random.default_rng(7)
    time = np.cumsum(rng.uniform(0.5, 1.5, 50))
    place = np.array(ORIGIN) + np.outer(time, [3e-5, -2e-5, 10.0])
    columns = {**geodetic(time, place), **triangle(random_covariance(rng, 50))}
    found = []
    for block in (7, 2**14):
        monkeypatch.setattr(track, "BLOCK", block)
        path = load(columns, origin=ORIGIN)
        found += [path, resample(path, 0.5), resample(path, 0.5, "smooth")]
    for a, b in zip(found[:3], found[3:], strict=True):
        same(a, b)
        np.testing.assert_array_equal(a.covariance, b.covariance)


def test_turned_position_errors_keep_their_ellipsoid(load):
    # 10 m to the north, 3 m up: at 90° of longitude from the origin those are other axes.
    std = dict(zip(STD, [[10.0], [5.0], [3.0], [0.0], [0.0], [0.0]], strict=True))
    attitude = {name: [0.0] for name in ATTITUDE}
    place = np.array([[0.0, np.pi / 2, 0.0]])
    found = load({**geodetic([0.0], place), **attitude, **std}, origin=(0.0, 0.0, 0.0))
    expected = np.zeros((6, 6))
    # East there is down here, and down there is west here.
    expected[:3, :3] = np.diag([100.0, 9.0, 25.0])
    np.testing.assert_allclose(found.covariance[0], expected, atol=1e-13)


def test_a_covariance_of_roll_and_yaw_straight_up_is_refused(load):
    # Level flight a quarter around the earth is straight down for the origin.
    columns = {
        **geodetic([0.0, 7.5], np.array([[0.0, 0.0, 0.0], [0.0, np.pi / 2, 0.0]])),
        **dict(zip(ATTITUDE, ([0, 0], [0, 0], [90, 90]), strict=True)),
    }
    load(columns, origin=(0.0, 0.0, 0.0))
    with pytest.raises(ScenarioError, match=r"route\.csv: at time_s 7\.5 .* straight up or down"):
        load({**columns, **{name: [1, 1] for name in STD}}, origin=(0.0, 0.0, 0.0))


def test_the_track_along_the_equator_is_level_where_the_aircraft_is(load):
    time = np.arange(0.0, 2000.0, 10.0)
    longitude = 250.0 / (wgs84.SEMI_MAJOR + 1e4) * time
    place = np.stack([0 * time, longitude, np.full_like(time, 1e4)], axis=-1)
    roll, pitch, yaw = load(geodetic(time, place), origin=(0.0, 0.0, 0.0)).aircraft[:, 3:].T
    np.testing.assert_allclose(roll, 0.0, atol=1e-9)
    np.testing.assert_allclose(pitch[1:-1], -longitude[1:-1], atol=1e-9)
    np.testing.assert_allclose(pitch, -longitude, atol=1e-7)  # one-sided at the ends
    np.testing.assert_allclose(yaw, np.pi / 2, atol=1e-12)


def test_the_bank_of_a_turn_is_relative_to_the_aircrafts_level(load):
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


# Attitude from the track.


def test_a_straight_climb_has_its_course_and_climb_and_no_bank():
    rng = np.random.default_rng(2)
    time = 1.7e9 + np.cumsum(rng.uniform(0.1, 2.0, 50))  # a clock since 1970
    velocity = np.array([-120.0, 160.0, -50.0])
    position = np.outer(time - time[0], velocity) - np.array([5e5, -3e5, 3e3])
    attitude = attitude_from_motion(*motion_of_samples(time, position))
    expected = [0.0, math.atan2(50, 200), math.atan2(160, -120)]
    np.testing.assert_allclose(attitude, np.tile(expected, (50, 1)), atol=1e-8)


def helix(time, *, speed, radius, climb, right=True):
    turn = (speed if right else -speed) / radius
    angle = turn * time
    position = np.stack([np.sin(angle), 1 - np.cos(angle), 0 * time], axis=-1) * radius
    if not right:
        position = -position
    position[:, 2] = -climb * time
    course = angle
    bank = math.atan(speed * turn / G)
    pitch = math.atan2(climb, speed)
    return position, np.stack([0 * time + bank, 0 * time + pitch, course], axis=-1)


def wrapped(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def even(count, rng):
    return np.linspace(0.0, 100.0, count)


def uneven(count, rng):
    time = np.arange(count) + rng.uniform(-0.45, 0.45, count)  # steps of 0.1 beside 1.9
    return (time - time[0]) * (100.0 / (time[-1] - time[0]))


@pytest.mark.parametrize("right", [True, False])
@pytest.mark.parametrize("climb", [0.0, 30.0])
@pytest.mark.parametrize("times", [even, uneven])
def test_turns_converge_with_the_square_of_the_step(right, climb, times):
    rng = np.random.default_rng(3)
    errors = []
    for count in (201, 801, 3201):
        time = times(count, rng)
        position, expected = helix(time, speed=200.0, radius=4e3, climb=climb, right=right)
        off = np.abs(wrapped(attitude_from_motion(*motion_of_samples(time, position)) - expected))
        # The whole path, ends included.
        errors.append(np.max(off, axis=0))
    assert np.all(errors[0] < 3e-3)
    assert np.all(errors[-1] < 1e-5)
    for coarse, fine in pairwise(errors):
        order = np.log(np.maximum(coarse, 1e-9) / np.maximum(fine, 1e-9)) / np.log(4)
        exact = coarse < 1e-8
        assert np.all((order > 1.7) | exact), (errors, order)


def test_a_parabola_and_a_cubic_are_exact():
    rng = np.random.default_rng(4)
    time = np.cumsum(rng.uniform(0.1, 3.0, 30))
    north, east = 100.0 * time, 0.02 * time**3 - time**2
    roll, _, _ = attitude_from_motion(
        *motion_of_samples(time, np.stack([north, east, 0 * time], -1))
    ).T
    # Acceleration of a cubic is found exactly, velocity not, so the bank is compared as a_e alone.
    _, acceleration = motion_of_samples(time, np.stack([north, east, 0 * time], -1))
    np.testing.assert_allclose(acceleration[:, 1], 0.12 * time - 2, atol=1e-10)
    velocity, _ = motion_of_samples(time, np.stack([north, time**2, 0 * time], -1))
    np.testing.assert_allclose(velocity[:, 1], 2 * time, atol=1e-10)
    assert np.sign(roll[0]) == -1


def test_acceleration_is_between_those_measured_around_it():
    rng = np.random.default_rng(9)
    time = np.cumsum(rng.uniform(0.1, 3.0, 200))
    position = rng.standard_normal((200, 3))
    slope = np.diff(position, axis=0) / np.diff(time)[:, np.newaxis]
    measured = 2 * np.diff(slope, axis=0) / (time[2:] - time[:-2])[:, np.newaxis]
    _, acceleration = motion_of_samples(time, position)
    # Row i + 2 has second differences centred near it, before it and after it.
    around = np.stack([measured[:-2], measured[1:-1], measured[2:]])
    inner = acceleration[2:-2]
    assert np.all((inner >= around.min(axis=0)) & (inner <= around.max(axis=0)))


def test_drifting_is_hovering():
    velocity = np.array([[10.0, 0, -1], [0, 0.05, -0.05], [0, 0.05, 5]])
    acceleration = np.array([[2.0, 2, 0]] * 3)
    roll, pitch, yaw = attitude_from_motion(velocity, acceleration).T
    np.testing.assert_allclose(roll, [math.atan(2 / G), 0, 0], rtol=1e-14)
    np.testing.assert_allclose(pitch, [math.atan(0.1), 0, math.atan2(-5, 0.05)], rtol=1e-14)
    np.testing.assert_array_equal(yaw, 0.0)


def test_three_rows_and_two():
    position = np.array([[0.0, 0, 0], [100, 0, 0], [200, 10, 0]])
    three = attitude_from_motion(*motion_of_samples(np.array([0.0, 1, 2]), position))
    # At the middle: velocity (100, 5), acceleration (0, 10).
    to_the_right = 100 * 10 / math.hypot(100, 5)
    np.testing.assert_allclose(
        three[1], [math.atan(to_the_right / G), 0, math.atan2(5, 100)], rtol=1e-14
    )
    two = attitude_from_motion(*motion_of_samples(np.array([0.0, 1]), position[1:]))
    np.testing.assert_allclose(two, [[0, 0, math.atan2(10, 100)]] * 2, rtol=1e-14)


def test_a_hovering_aircraft_keeps_the_last_course_and_is_level():
    north = np.array([0.0, 0, 0, 0, 50, 100, 100, 100, 100, 100])
    up = np.array([0.0, 0, 0, 0, 0, 0, 0, 0, 10, 20])
    position = np.stack([-north, north, -up], axis=-1)
    attitude = attitude_from_motion(*motion_of_samples(np.arange(10.0), position))
    np.testing.assert_allclose(attitude[:, 2], 0.75 * np.pi)  # before the first course: the first
    np.testing.assert_array_equal(attitude[[0, 1, 2, 7, 8, 9], 0], 0.0)
    np.testing.assert_array_equal(attitude[[0, 1, 2], 1], 0.0)
    np.testing.assert_allclose(attitude[[8, 9], 1], np.pi / 2)  # straight up
    upwards = motion_of_samples(np.arange(3.0), np.array([[0.0, 0, 0], [0, 0, -9], [0, 0, -30]]))
    with pytest.raises(ValueError, match="never moves"):
        attitude_from_motion(*upwards)


# Interpolation.


def corner(load):
    return load("time_s,north_m,east_m,down_m\n0,0,0,0\n10,1000,0,-100\n20,1000,2000,-100\n")


def test_legs_are_flown_straight_and_level(load):
    found = resample(corner(load), 2.5)
    np.testing.assert_array_equal(found.time_s, np.arange(9) * 2.5)
    north = [0, 250, 500, 750, 1000, 1000, 1000, 1000, 1000]
    east = [0, 0, 0, 0, 0, 500, 1000, 1500, 2000]
    down = [0, -25, -50, -75, -100, -100, -100, -100, -100]
    np.testing.assert_allclose(found.aircraft[:, :3], np.array([north, east, down]).T, atol=1e-12)
    climbs, turned = math.atan2(10, 100), np.pi / 2
    expected = [[0, climbs, 0]] * 4 + [[0, 0, turned]] * 5
    np.testing.assert_allclose(found.aircraft[:, 3:], expected, atol=1e-15)
    np.testing.assert_allclose(found.distance_m[-1], math.hypot(1000, 100) + 2000)
    assert not found.attitude_given


@pytest.mark.parametrize("method", ["legs", "smooth"])
def test_the_last_pose_is_always_there(load, method):
    path = corner(load)
    for step, count in ((0.1, 201), (20, 2), (20.1, 2), (7, 4), (19.9999, 3), (1e9, 2)):
        found = resample(path, step, method)
        assert len(found.time_s) == count
        assert found.time_s[-1] == 20
        assert np.all(np.diff(found.time_s) > 0)
        np.testing.assert_allclose(found.aircraft[-1, :3], [1000, 2000, -100], atol=1e-9)
    # the cases that were reported: 1807 s by 1000 s and by 5 s
    path = load("time_s,north_m,east_m,down_m\n0,0,0,0\n900,1e5,0,0\n1807,2e5,0,0\n")
    assert resample(path, 1000, method).time_s.tolist() == [0, 1000, 1807]
    assert resample(path, 5, method).time_s.tolist() == [*range(0, 1806, 5), 1807]
    # no second last row by rounding, late on a clock
    path = load("time_s,north_m,east_m,down_m\n1e9,0,0,0\n1000000000.3,90,0,0\n")
    found = resample(path, 0.1, method).time_s - 1e9
    np.testing.assert_allclose(found, [0, 0.1, 0.2, 0.3], atol=1e-6)
    header = ",".join(["time_s", "north_m", "east_m", "down_m", *ATTITUDE])
    path = load(f"{header}\n0,0,0,0,0,0,0\n0.3,9,0,0,0,0,0\n")
    assert resample(path, 0.1).time_s[-1] == 0.3  # and not 3 · 0.1 = 0.30000000000000004


def test_a_step_must_move_the_clock(load):
    path = load(f"{HEAD}\n999999999999,0,0,0\n1e12,100,0,0\n")
    assert np.all(np.diff(resample(path, 2e-3).time_s) > 0)
    with pytest.raises(ScenarioError, match=r"step_s must be a number not less than 0\.001"):
        resample(path, 1e-4)


def test_a_smooth_path_goes_through_its_samples_and_banks(load):
    time = np.arange(0.0, 60.0, 2.0)
    position, _ = helix(time, speed=200.0, radius=4e3, climb=20.0)
    path = load(ned(time, position))
    found = resample(path, 0.5, "smooth")
    np.testing.assert_allclose(found.aircraft[::4, :3], path.aircraft[:, :3], atol=1e-9)
    exact, attitude = helix(found.time_s, speed=200.0, radius=4e3, climb=20.0)
    inner = slice(12, -12)
    assert np.max(np.abs(found.aircraft[:, :3] - exact)[inner]) < 2e-3
    assert np.max(np.abs(wrapped(found.aircraft[:, 3:] - attitude))[inner]) < 1e-3
    # Legs have level wings, and chords of a circle lie inside the circle.
    legs = resample(path, 0.5)
    assert not legs.aircraft[:, 3].any()
    assert np.max(np.abs(legs.aircraft[:, :3] - exact)) == pytest.approx(400**2 / 8 / 4e3, rel=0.03)


def test_given_attitudes_turn_the_short_way_at_a_constant_rate(load):
    header = ",".join(["time_s", "north_m", "east_m", "down_m", *ATTITUDE])
    path = load(f"{header}\n0,0,0,0,0,0,170\n4,9,0,0,0,0,-170\n8,9,0,0,0,0,-170\n")
    for method in ("legs", "smooth"):
        found = resample(path, 1.0, method)
        assert found.attitude_given
        yaw = np.array([170, 175, 180, -175, -170, -170, -170, -170, -170]) * DEG
        np.testing.assert_allclose(wrapped(found.aircraft[:, 5] - yaw), 0.0, atol=1e-12)
        np.testing.assert_allclose(found.aircraft[:, 3:5], 0.0, atol=1e-15)
    # Over the top: half a looping ends on its back, heading the other way.
    path = load(f"{header}\n0,0,0,0,0,60,0\n2,9,0,0,180,60,180\n")
    middle = resample(path, 1.0).aircraft[1, 3:]
    nose = wgs84.body_axes(middle)[0]
    np.testing.assert_allclose(nose, [0, 0, -1], atol=1e-15)


@pytest.mark.parametrize("origin", [None, ORIGIN])
def test_covariances_are_mixed(load, origin):
    rng = np.random.default_rng(5)
    time = np.array([0.0, 1.0, 4.0])
    covariance = random_covariance(rng, 3, rank=2)
    if origin:
        place = np.array(ORIGIN) + np.outer(time, [1e-3, 1e-3, 100])
        columns = geodetic(time, place)
    else:
        columns = ned(time, np.outer(time, [200.0, 0, 0]))
    path = load({**columns, **triangle(covariance)}, origin=origin)
    for method in ("legs", "smooth"):
        found = resample(path, 0.5, method)
        expected = 0.5 * (path.covariance[1] + path.covariance[2])
        np.testing.assert_allclose(found.covariance[5], expected, rtol=1e-12)
        np.testing.assert_array_equal(found.covariance[0], path.covariance[0])
        np.testing.assert_array_equal(found.covariance[-1], path.covariance[-1])
        assert all(problem(c) is None for c in found.covariance)


def test_legs_follow_the_curve_of_the_earth(load):
    # 10° along the equator in one leg: the straight line would be 24 km under the ground.
    place = np.array([[0.0, 0.0, 5e3], [0.0, 10 * DEG, 6e3]])
    path = load(geodetic([0.0, 4000.0], place), origin=(0.0, 0.0, 0.0))
    found = resample(path, 400.0)
    back = wgs84.geodetic_from_ned(found.aircraft[:, :3], (0.0, 0.0, 0.0))
    np.testing.assert_allclose(back[:, 0], 0.0, atol=1e-15)
    np.testing.assert_allclose(back[:, 2], np.linspace(5e3, 6e3, 11), atol=1e-7)
    np.testing.assert_allclose(back[:, 1], np.linspace(0, 10, 11) * DEG, atol=1e-4)
    turns = np.swapaxes(wgs84.turn_to_origin(back, (0.0, 0.0, 0.0)), -1, -2)
    roll, pitch, yaw = wgs84.turned_attitude(found.aircraft[:, 3:], turns).T
    np.testing.assert_allclose(roll, 0.0, atol=1e-14)
    np.testing.assert_allclose(yaw, np.pi / 2, atol=1e-12)
    speed = 10 * DEG * 6.3836e6 / 4000
    np.testing.assert_allclose(pitch, math.atan2(0.25, speed), rtol=0.01)


@pytest.mark.parametrize("method", ["legs", "smooth"])
def test_a_flight_in_latitude_and_longitude_can_be_smooth(load, method):
    time = np.arange(0.0, 400.0, 20.0)
    place = np.stack([40 * DEG + 3e-5 * time, -104 * DEG + 0 * time, 5000 + 0 * time], axis=-1)
    path = load(geodetic(time, place), origin=ORIGIN)
    found = resample(path, 5.0, method)
    back = wgs84.geodetic_from_ned(found.aircraft[:, :3], ORIGIN)
    np.testing.assert_allclose(back[:, 0], 40 * DEG + 3e-5 * found.time_s, atol=1e-9)
    np.testing.assert_allclose(back[:, 2], 5000.0, atol=1e-2 if method == "smooth" else 1e-7)
    turns = np.swapaxes(wgs84.turn_to_origin(back, ORIGIN), -1, -2)
    local = wgs84.turned_attitude(found.aircraft[:, 3:], turns)
    np.testing.assert_allclose(local, 0.0, atol=1e-4)


def test_one_pose_stays_one_pose(load):
    header = ",".join(["time_s", "north_m", "east_m", "down_m", *ATTITUDE])
    path = load(f"{header}\n3,1,2,3,4,5,6\n")
    same(resample(path, 1.0), path)


@pytest.mark.parametrize(
    ("step", "method", "says"),
    [
        (0.0, "legs", "step_s must be a number not less than 1e-09, got 0"),
        (-1.0, "legs", "not less than"),
        (math.nan, "legs", "not less than"),
        (math.inf, "legs", "not less than"),
        (1e-6, "legs", "more than 1,000,000 poses"),
        (1.0, "leg", "must be one of legs, smooth, got 'leg'; did you mean 'legs'"),
    ],
)
def test_refused_interpolations(load, step, method, says):
    with pytest.raises(ScenarioError, match=re.escape(says)):
        resample(corner(load), step, method)


# Refusals.


HEAD = "time_s,north_m,east_m,down_m"
GEO = "time_s,latitude_deg,longitude_deg,altitude_m"
WITH_STD = ",".join([HEAD, *STD])
WITH_COV = ",".join([HEAD, *COV])
ONES = ",".join(["1"] * 21)
IDENTITY = ",".join("1" if i == j else "0" for i, j in UPPER)

REFUSED = {
    "empty": ("", "route.csv: is empty; the first line must name the columns"),
    "comments only": ("# a\n#b\n\n", "route.csv: is empty"),
    "no rows": (f"{HEAD}\n# none\n", "route.csv: has no rows"),
    "header without newline": (HEAD, "route.csv: has no rows"),
    "one row": (f"{HEAD}\n0,0,0,0\n", "route.csv: has 1 row; attitude from the track needs 2"),
    "not utf-8": (b"time_s,\xff\n", "route.csv:1: is not UTF-8 text: byte 0xff"),
    "not utf-8 below": (
        SIMPLE.encode() + b"# \xe9\n",
        "route.csv:5: is not UTF-8 text: byte 0xe9",
    ),
    "zero bytes": (bytes(100), "route.csv:1: names none of the columns, allowed: time_s"),
    "a long line": (b"x" * 100_000, "route.csv:1: is longer than 65536 bytes"),
    "no header": ("1,2,3,4\n", "names none of the columns"),
    "tabs": (SIMPLE.replace(",", "\t"), "columns are separated by commas or semicolons"),
    "unknown": (
        SIMPLE.replace("north", "nort"),
        "route.csv:1: unknown column 'nort_m', allowed: time_s or speed_m_s; ",
    ),
    "did you mean": (SIMPLE.replace("north", "nort"), "did you mean 'north_m'?"),
    "duplicate": (f"# a\n{HEAD},time_s\n", "route.csv:2: duplicate column 'time_s'"),
    "no time": ("north_m,east_m,down_m\n", "route.csv:1: missing column 'time_s'"),
    "no down": ("time_s,north_m,east_m\n", "route.csv:1: missing column 'down_m'"),
    "no place": ("time_s\n", "route.csv:1: missing column 'north_m', required are latitude_deg"),
    "no altitude": (
        "time_s,latitude_deg,longitude_deg\n",
        "route.csv:1: missing column 'altitude_m'",
    ),
    "two units": (f"{HEAD},north_km\n", "route.csv:1: has north_m and north_km; give only one"),
    "two frames": (f"{HEAD},latitude_deg\n", "route.csv:1: has north, east, down beside latitude"),
    "half an attitude": (
        f"{HEAD},roll_deg,yaw_deg\n",
        "route.csv:1: missing column 'pitch_deg', required are all of roll_deg, pitch_deg, yaw_deg",
    ),
    "half a covariance": (
        f"{HEAD},std_north_m\n",
        "missing column 'std_east_m', required are all of std_north_m to std_yaw_deg, or none",
    ),
    "two covariances": (
        f"{WITH_STD},{','.join(COV)}\n",
        "route.csv:1: has std_north_m beside cov_north_north_m2; give only one of the two",
    ),
    "lower triangle": (f"{HEAD},cov_east_north_m2\n", "did you mean 'cov_"),
    "text": (f"{HEAD}\n0,0,0,0\n1,x,0,0\n", "route.csv:3: north_m: must be a number"),
    "nothing": (f"{HEAD}\n0,,0,0\n", "route.csv:2: north_m: must be a number not less than"),
    "nothing said": (f"{HEAD}\n0,,0,0\n", "got nothing"),
    "nan": (f"{HEAD}\n0,0,0,0\n\n1,0,NaN,0\n", "route.csv:4: east_m: must be finite, got NaN"),
    "inf": (f"{HEAD}\n0,0,-inf,0\n", "route.csv:2: east_m: must be finite, got -inf"),
    "overflow": (f"{HEAD}\n0,0,0,0\n1,0,0,1e999\n", "route.csv:3: down_m: must be a number"),
    "hexadecimal": (f"{HEAD}\n0,0x10,0,0\n", "route.csv:2: north_m: must be a number"),
    "underscores": (f"{HEAD}\n0,1_0,0,0\n", "got '1_0'"),
    "other digits": (f"{HEAD}\n0,١,0,0\n", "route.csv:2: north_m: must be a number"),
    "open quote": (f'{HEAD}\n0,"1,0,0\n', "route.csv:2: is not valid CSV: "),
    "too few": (
        f"{HEAD}\n0,0,0,0\n1,0,0\n",
        "route.csv:3: must have 4 values, one for each column, got 3",
    ),
    "too few all along": (f"{HEAD}\n0,0,0\n1,0,0\n", "route.csv:2: must have 4 values"),
    "too many": (
        f"{HEAD}\n0,0,0,0,5\n",
        "route.csv:2: must have 4 values, one for each column, got 5",
    ),
    "far": (
        f"{HEAD}\n0,0,0,0\n1,2e8,0,0\n",
        "route.csv:3: north_m: must be a number not less than -1e+08 and not greater than 1e+08, "
        "got 2e8",
    ),
    "time back": (
        f"{HEAD}\n0,0,0,0\n2,1,1,1\n# c\n1.5,2,2,2\n",
        "route.csv:5: time_s: must be later than 2.0, the time of the row before, got 1.5",
    ),
    "time hardly moving": (
        f"{HEAD}\n0,0,0,0\n5e-10,1,1,1\n",
        "must be later than 0.0, the time of the row before, by 1e-09 s or more, got 5e-10",
    ),
    "time still": (f"{HEAD}\n0,0,0,0\n0,1,1,1\n", "route.csv:3: time_s: must be later than 0.0"),
    "latitude 91": (
        f"{GEO}\n0,0,0,0\n1,91,0,0\n",
        "route.csv:3: latitude_deg: must be a number not less than -90 and not greater than 90, "
        "got 91",
    ),
    "longitude": (f"{GEO}\n0,0,-180.5,0\n", "route.csv:2: longitude_deg: must be"),
    "underground": (f"{GEO}\n0,0,0,-20000\n", "route.csv:2: altitude_m: must be"),
    "no origin": (f"{GEO}\n0,0,0,0\n", "route.csv:1: latitude_deg: needs the origin"),
    "pitch": (
        f"{HEAD},roll_deg,pitch_deg,yaw_deg\n0,0,0,0,0,90.1,0\n",
        "route.csv:2: pitch_deg: must be a number not less than -90 and not greater than 90",
    ),
    "negative std": (f"{WITH_STD}\n0,0,0,0,1,1,-1,1,1,1\n", "route.csv:2: std_down_m: must be"),
    "negative variance": (
        f"{WITH_COV}\n0,0,0,0,{IDENTITY.replace('1', '-1', 1)}\n",
        "route.csv:2: cov_north_north_m2: must be a number not less than 0",
    ),
    "not semidefinite": (
        f"{WITH_COV}\n0,0,0,0,{IDENTITY}\n1,1,0,0,{ONES.replace('1,1', '1,1.1', 1)}\n",
        "route.csv:3: covariance is not positive semidefinite: its correlation matrix has the",
    ),
    "covariance of what is certain": (
        f"{WITH_COV}\n0,0,0,0,0,1,{','.join(['0'] * 19)}\n",
        "route.csv:2: covariance is not positive semidefinite: a component without variance",
    ),
    "never moves": (
        f"{HEAD}\n0,0,0,0\n1,0,0,-5\n",
        "route.csv: the aircraft never moves horizontally at 0.1 m/s or more, attitude cannot",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_bad_files_are_refused_with_their_line(load, name):
    content, says = REFUSED[name]
    with pytest.raises(ScenarioError) as refused:
        load(content)
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


def test_lines_are_counted_across_pieces(load, monkeypatch):
    monkeypatch.setattr(csv_reader, "READ_BYTES", 50)
    lines = [f"{i},{i * 100},0,0" for i in range(100)]
    assert len(load("\n".join([HEAD, *lines])).time_s) == 100
    for bad, says in (("x", "north_m"), ("7,0,0,0", "time_s"), ("80,1e9,0,0", "north_m")):
        for row in range(80, 88):  # first, inside, and last of a piece
            changed = [*lines]
            changed[row] = bad.replace("80", str(row)) if "," in bad else f"{row},x,0,0"
            with pytest.raises(ScenarioError, match=rf"^route\.csv:{row + 3}: {says}"):
                load("\n".join(["# comment", HEAD, *changed]))


def test_gaps_are_refused_if_asked(load):
    text = f"{HEAD}\n0,0,0,0\n1,100,0,0\n11.5,200,0,0\n"
    assert len(load(text).time_s) == 3
    assert len(load(text, max_gap_s=10.5).time_s) == 3
    with pytest.raises(ScenarioError, match=r"^route\.csv:4: time_s: must be within 10 s .* 10\.5"):
        load(text, max_gap_s=10)
    for wrong in (0, -1, math.nan):
        with pytest.raises(ScenarioError, match="max_gap_s must be"):
            load(text, max_gap_s=wrong)


def test_an_origin_must_be_a_place_and_have_a_use(load):
    with pytest.raises(ScenarioError, match=r"^route\.csv:1: north, east and down"):
        load(SIMPLE, origin=ORIGIN)
    for wrong in ((2.0, 0.0, 0.0), (math.nan, 0.0, 0.0), (0.0, math.inf, 0.0)):
        with pytest.raises(ValueError, match="origin must be"):
            load(f"{GEO}\n0,0,0,0\n1,0,1,0\n", origin=wrong)


def test_too_many_rows_and_too_large_a_file(load, monkeypatch):
    monkeypatch.setattr(route_file, "FORMAT", replace(route_file.FORMAT, max_rows=3))
    assert len(load(SIMPLE).time_s) == 3
    with pytest.raises(ScenarioError, match=r"^route\.csv:6: has more than 3 rows"):
        load("\n" + SIMPLE + "3,300,0,0\n")
    monkeypatch.setattr(route_file, "FORMAT", replace(route_file.FORMAT, max_bytes=2**20))
    with pytest.raises(ScenarioError, match="is larger than 1 MiB"):
        load(SIMPLE + "#\n" * 2**19)


def test_files_that_cannot_be_read(tmp_path):
    for name, says in ((tmp_path / "no.csv", "cannot be read"), (tmp_path, "is a directory")):
        with pytest.raises(ScenarioError, match=says):
            load_route(name)
    with pytest.raises(ScenarioError, match="cannot be read"):
        load_route("a\0b")


def test_the_first_bad_covariance_is_named_among_good_ones(load):
    rng = np.random.default_rng(6)
    covariance = random_covariance(rng, 40, rank=4)  # singular, so that none is definite
    columns = ned(np.arange(40.0), np.outer(np.arange(40.0), [100, 0, 0]))
    load({**columns, **triangle(covariance)})
    for bad in (33, 21):
        i, j = 1, 4
        std = np.sqrt(covariance[bad, i, i] * covariance[bad, j, j])
        covariance[bad, i, j] = covariance[bad, j, i] = 1.01 * std
        with pytest.raises(ScenarioError, match=rf"^route\.csv:{bad + 2}: covariance is not"):
            load({**columns, **triangle(covariance)})


# Random texts.


def outcome(path, **options):
    """Return a finite route, or None for a refusal in one line."""
    try:
        found = load_route(path, **options)
    except ScenarioError as error:
        assert "\n" not in str(error)  # noqa: PT017 - what else is raised must be seen
        return None
    assert np.all(np.isfinite(found.aircraft))
    assert np.all(np.isfinite(found.distance_m))
    assert np.all(np.diff(found.time_s) > 0)
    if found.covariance is not None:
        assert np.all(np.isfinite(found.covariance))
    return found


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz") / "route.csv"


@given(content=st.binary(max_size=200))
@settings(max_examples=150, deadline=None)
def test_any_bytes(path, content):
    path.write_bytes(content)
    outcome(path)
    path.write_bytes(f"{HEAD}\n0,0,0,0\n1,9,9,9\n".encode() + content)
    outcome(path)


CELLS = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True).map(repr),
    st.floats(-100, 100).map(repr),
    st.integers(-3, 3).map(str),
    st.sampled_from(["", " ", "nan", "1e999", "-0", "1e-320", "90", "-90", "180", "x", "1 2", "#"]),
)
NUMBERS = st.one_of(
    st.integers(-90, 90).map(str), st.sampled_from(["0", "-0", "1e-320", "89.99999", "1e-9", "1"])
)


@st.composite
def tables(draw):
    """Tables with good headers and rows that are mostly of the right shape and at times good."""
    columns = (draw(st.sampled_from([HEAD, GEO]))).split(",")
    for more in (ATTITUDE, draw(st.sampled_from([STD, COV]))):
        if draw(st.booleans()):
            columns += more
    cell = draw(st.sampled_from([NUMBERS, NUMBERS, CELLS]))
    rows = draw(st.integers(0, 6))
    table = [
        [str(i + draw(st.integers(0, 1))), *(draw(cell) for _ in columns[1:])] for i in range(rows)
    ]
    for row in table:
        for i, name in enumerate(columns):
            if name in COV and draw(st.integers(0, 9)) and cell is NUMBERS:
                a, b = UPPER[COV.index(name)]
                row[i] = "1" if a == b else "0.1"
            elif name in STD and cell is NUMBERS:
                row[i] = row[i].lstrip("-")
    return columns, "\n".join(",".join(row) for row in [columns, *table])


@given(table=tables(), step=st.sampled_from([0.1, 0.7, 1.0, 5.0]))
@settings(max_examples=100, deadline=None)
def test_any_table(path, table, step):
    columns, text = table
    path.write_text(text)
    options = {"origin": (0.1, 0.2, 0.0)} if "latitude_deg" in columns else {}
    found = outcome(path, **options)
    for method in METHODS if found else ():
        try:
            again = resample(found, step, method)
        except ScenarioError as error:
            assert "never moves" in str(error)  # noqa: PT017 - what else is raised must be seen
        else:
            assert np.all(np.isfinite(again.aircraft))
