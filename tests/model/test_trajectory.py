"""The attitude of a track, on paths whose attitude is known, and routes interpolated in time."""

import math
import re
from itertools import pairwise

import numpy as np
import pytest
from routes import (
    ATTITUDE,
    DEG,
    HEAD,
    ORIGIN,
    geodetic,
    load,
    ned,
    random_covariance,
    same,
    triangle,
)

import radar_sense as rs
from radar_sense.covariance import problem
from radar_sense.errors import InputError
from radar_sense.model import geodesy as wgs84
from radar_sense.model.track import attitude_from_motion, hovering, motion_of_samples
from radar_sense.model.trajectory import distance_flown, interpolate, resample

G = 9.80665
FULL = ",".join([HEAD, *ATTITUDE])


pytestmark = pytest.mark.usefixtures("here")


def of_samples(time, position):
    """The attitude of samples of which none is at the end of a hover."""
    steps = hovering(time, position, None)
    hovers = np.append(steps[0], steps)
    return attitude_from_motion("track", *motion_of_samples(time, position), hovers)


def test_a_straight_climb_has_its_course_and_climb_and_no_bank():
    rng = np.random.default_rng(2)
    time = 1.7e9 + np.cumsum(rng.uniform(0.1, 2.0, 50))  # a clock since 1970
    velocity = np.array([-120.0, 160.0, -50.0])
    position = np.outer(time - time[0], velocity) - np.array([5e5, -3e5, 3e3])
    attitude = of_samples(time, position)
    expected = [0.0, math.atan2(50, 200), math.atan2(160, -120)]
    np.testing.assert_allclose(attitude, np.tile(expected, (50, 1)), atol=1e-8)


def helix(time, *, speed, radius, climb, right=True):
    turn = (speed if right else -speed) / radius
    angle = turn * time
    position = np.stack([np.sin(angle), 1 - np.cos(angle), 0 * time], axis=-1) * radius
    position *= 1 if right else -1
    position[:, 2] = -climb * time
    bank, pitch = math.atan(speed * turn / G), math.atan2(climb, speed)
    return position, np.stack([0 * time + bank, 0 * time + pitch, angle], axis=-1)


def wrapped(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


@pytest.mark.parametrize("right", [True, False])
@pytest.mark.parametrize("climb", [0.0, 30.0])
@pytest.mark.parametrize("uneven", [0, 0.45])  # steps of 0.1 beside 1.9
def test_turns_converge_with_the_square_of_the_step(right, climb, uneven):
    rng = np.random.default_rng(3)
    errors = []
    for count in (201, 801, 3201):
        time = np.arange(count) + rng.uniform(-uneven, uneven, count)
        time = (time - time[0]) * (100.0 / (time[-1] - time[0]))
        position, expected = helix(time, speed=200.0, radius=4e3, climb=climb, right=right)
        off = np.abs(wrapped(of_samples(time, position) - expected))
        # The whole path, ends included.
        errors.append(np.max(off, axis=0))
    assert np.all(errors[0] < 3e-3)
    assert np.all(errors[-1] < 1e-5)
    for coarse, fine in pairwise(errors):
        order = np.log(np.maximum(coarse, 1e-9) / np.maximum(fine, 1e-9)) / np.log(4)
        exact = coarse < 1e-8
        assert np.all((order > 1.7) | exact), (errors, order)


def test_motion_is_exact_for_a_cubic_and_between_what_is_measured_of_noise():
    """The acceleration of a cubic is found exactly, and the velocity of a parabola."""
    rng = np.random.default_rng(9)
    time = np.cumsum(rng.uniform(0.1, 3.0, 200))
    some = time[:30]
    of_cubic, of_parabola = (
        motion_of_samples(some, np.outer(east, [0, 1, 0]))
        for east in (0.02 * some**3 - some**2, some**2)
    )
    np.testing.assert_allclose(of_cubic[1][:, 1], 0.12 * some - 2, atol=1e-10)
    np.testing.assert_allclose(of_parabola[0][:, 1], 2 * some, atol=1e-10)
    position = rng.standard_normal((200, 3))
    slope = np.diff(position, axis=0) / np.diff(time)[:, np.newaxis]
    measured = 2 * np.diff(slope, axis=0) / (time[2:] - time[:-2])[:, np.newaxis]
    # Row i + 2 has second differences centred near it, before it and after it.
    around = np.stack([measured[:-2], measured[1:-1], measured[2:]])
    inner = motion_of_samples(time, position)[1][2:-2]
    assert np.all((inner >= around.min(axis=0)) & (inner <= around.max(axis=0)))


def test_a_hovering_aircraft_keeps_the_last_course_and_is_level():
    north = np.array([0.0, 0, 0, 0, 50, 100, 100, 100, 100, 100])
    up = np.array([0.0, 0, 0, 0, 0, 0, 0, 0, 10, 20])
    position = np.stack([-north, north, -up], axis=-1)
    attitude = of_samples(np.arange(10.0), position)
    np.testing.assert_allclose(attitude[:, 2], 0.75 * np.pi)  # before the first course: the first
    np.testing.assert_array_equal(attitude[[0, 1, 2, 7, 8, 9], 0], 0.0)
    np.testing.assert_array_equal(attitude[[0, 1, 2, 7, 8, 9], 1], 0.0)
    with pytest.raises(ValueError, match="never moves"):
        of_samples(np.arange(3.0), np.array([[0.0, 0, 0], [0, 0, -9], [0, 0, -30]]))


def corner():
    return load("time_s,north_m,east_m,down_m\n0,0,0,0\n10,1000,0,-100\n20,1000,2000,-100\n")


def test_legs_are_flown_straight_and_level():
    found = resample(corner(), 2.5)
    np.testing.assert_array_equal(found.time_s, np.arange(9) * 2.5)
    north = [0, 250, 500, 750, 1000, 1000, 1000, 1000, 1000]
    east = [0, 0, 0, 0, 0, 500, 1000, 1500, 2000]
    down = [0, -25, -50, -75, -100, -100, -100, -100, -100]
    np.testing.assert_allclose(found.aircraft[:, :3], np.array([north, east, down]).T, atol=1e-12)
    climbs, turned = math.atan2(10, 100), np.pi / 2
    expected = [[0, climbs, 0]] * 4 + [[0, 0, turned]] * 5
    np.testing.assert_allclose(found.aircraft[:, 3:], expected, atol=1e-15)
    distance = distance_flown(corner(), found.time_s)
    first, rest = np.linspace(0, math.hypot(1000, 100), 5), np.linspace(500, 2000, 4)
    np.testing.assert_allclose(distance, [*first, *(first[-1] + rest)], rtol=1e-14)
    assert not found.attitude_given


@pytest.mark.parametrize("method", ["legs", "smooth"])
def test_the_last_pose_is_always_there(method):
    path = corner()
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
    path = load(f"{FULL}\n0,0,0,0,0,0,0\n0.3,9,0,0,0,0,0\n")
    assert resample(path, 0.1).time_s[-1] == 0.3  # and not 3 · 0.1 = 0.30000000000000004


def test_a_step_must_move_the_clock():
    path = load(f"{HEAD}\n999999999999,0,0,0\n1e12,100,0,0\n")
    assert np.all(np.diff(resample(path, 2e-3).time_s) > 0)
    with pytest.raises(InputError, match=r"step_s must be a number not less than 0\.001"):
        resample(path, 1e-4)


def test_a_smooth_path_goes_through_its_samples_and_banks():
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


def test_given_attitudes_turn_the_short_way_at_a_constant_rate():
    path = load(f"{FULL}\n0,0,0,0,0,0,170\n4,9,0,0,0,0,-170\n8,9,0,0,0,0,-170\n")
    for method in ("legs", "smooth"):
        found = resample(path, 1.0, method)
        assert found.attitude_given
        yaw = np.array([170, 175, 180, -175, -170, -170, -170, -170, -170]) * DEG
        np.testing.assert_allclose(wrapped(found.aircraft[:, 5] - yaw), 0.0, atol=1e-12)
        np.testing.assert_allclose(found.aircraft[:, 3:5], 0.0, atol=1e-15)
    # Over the top: half a looping ends on its back, heading the other way.
    path = load(f"{FULL}\n0,0,0,0,0,60,0\n2,9,0,0,180,60,180\n")
    middle = resample(path, 1.0).aircraft[1, 3:]
    nose = wgs84.body_axes(middle)[0]
    np.testing.assert_allclose(nose, [0, 0, -1], atol=1e-15)


@pytest.mark.parametrize("method", ["legs", "smooth"])
def test_covariances_are_mixed(method):
    """`tests/scenario_file/test_origin.py` has the mixture about an origin."""
    covariance = random_covariance(np.random.default_rng(5), 3, rank=2)
    time = np.array([0.0, 1.0, 4.0])
    path = load({**ned(time, np.outer(time, [200.0, 0, 0])), **triangle(covariance)})
    found = resample(path, 0.5, method).covariance
    assert all(problem(c) is None for c in found)
    expected = 0.5 * (path.covariance[1] + path.covariance[2])
    np.testing.assert_allclose(found[5], expected, rtol=1e-12)
    np.testing.assert_array_equal(found[[0, -1]], path.covariance[[0, -1]])


def test_legs_follow_the_curve_of_the_earth():
    # 10° along the equator in one leg: the straight line would be 24 km under the ground.
    place = np.array([[0.0, 0.0, 5e3], [0.0, 10 * DEG, 6e3]])
    path = load(geodetic([0.0, 4000.0], place), origin=(0.0, 0.0, 0.0))
    found = resample(path, 400.0)
    back = wgs84.geodetic_from_ned(found.aircraft[:, :3], (0.0, 0.0, 0.0))
    np.testing.assert_allclose(back[:, 0], 0.0, atol=1e-15)
    np.testing.assert_allclose(back[:, 2], np.linspace(5e3, 6e3, 11), atol=1e-7)
    np.testing.assert_allclose(back[:, 1], np.linspace(0, 10, 11) * DEG, atol=1e-12)
    turns = np.swapaxes(wgs84.turn_to_origin(back, (0.0, 0.0, 0.0)), -1, -2)
    roll, pitch, yaw = wgs84.turned_attitude(found.aircraft[:, 3:], turns).T
    np.testing.assert_allclose(roll, 0.0, atol=1e-14)
    np.testing.assert_allclose(yaw, np.pi / 2, atol=1e-12)
    speed = 10 * DEG * 6.3836e6 / 4000
    np.testing.assert_allclose(pitch, math.atan2(0.25, speed), rtol=0.01)


@pytest.mark.parametrize("step", [7.0, 60.0, 360.0])
def test_the_distance_on_a_smooth_path_is_the_length_of_the_curve(step):
    """A circle of 3 km flown through six samples a turn. Straight lines are 5 % shorter."""
    turn = np.deg2rad(np.arange(0, 721, 60.0))
    circle = 3e3 * np.stack([np.sin(turn), np.cos(turn), 0 * turn], axis=1)
    route = load(ned(np.rad2deg(turn), circle))
    found = resample(route, step, "smooth")
    dense = resample(route, 0.01, "smooth")
    lengths = np.linalg.norm(np.diff(dense.aircraft[:, :3], axis=0), axis=-1)
    expected = np.interp(found.time_s, dense.time_s[1:], np.cumsum(lengths), left=0.0)
    np.testing.assert_allclose(
        distance_flown(route, found.time_s, "smooth"), expected, rtol=2e-6, atol=1e-9
    )
    assert expected[-1] == pytest.approx(4 * np.pi * 3e3, rel=0.02)


@pytest.mark.parametrize("step", [100.0, 4000.0])
def test_the_distance_on_a_leg_has_the_curve_of_the_earth(step):
    """Along the equator, a circle of 6378137 m, 10 km above it."""
    place = np.array([[0.0, -0.2, 10e3], [0.0, 0.1, 10e3]])
    route = load(geodetic([0.0, 4000.0], place), origin=(0.0, 0.0, 0.0))
    found = distance_flown(route, np.arange(0, 4001, step))
    assert found[-1] == pytest.approx(0.3 * (6378137 + 10e3), rel=1e-6)


@pytest.mark.parametrize("asked", [[4700.0], [2000.0, 4700.0], [4404.9, 4700.0, 5304.0]])
def test_the_course_of_a_hover_is_that_of_arrival_on_the_earth(asked):
    """A leg from 0 to 20 deg east at 60 deg north is at most 10 deg from its northernmost point."""
    places = np.radians([[60, 0, 0], [60, 20, 0], [60, 20, 0], [60.6, 20, 0]])
    columns = geodetic(np.array([0, 4405, 5005, 5305]), places)
    route = load(columns, origin=(60 * DEG, 20 * DEG, 0.0))
    found = interpolate(route, np.array(asked)).aircraft[asked.index(4700.0)]
    course = np.pi / 2 + np.arctan(np.tan(10 * DEG) * np.sin(60 * DEG))  # of a great circle
    np.testing.assert_allclose(found[3:], [0, 0, course], atol=1e-3)


def test_a_smooth_flight_keeps_place_and_course_where_it_hovers():
    """East at 20 m/s, 100 s on the spot with a drift and a climb, then north."""
    time = np.arange(0, 305, 5.0)
    east = 20 * np.minimum(time, 100) + 0.3 * (time > 100)
    north, down = 20 * np.maximum(0, time - 200), -300 - 0.2 * np.clip(time - 100, 0, 100)
    flight = load(ned(time, np.stack([north, east, down], axis=1)))
    found = interpolate(flight, np.arange(100.0, 200.0, 0.7), "smooth").aircraft
    np.testing.assert_allclose(found[:, :2], [[0, 2000]] * len(found), atol=0.31)
    np.testing.assert_allclose(found[:, 3:], [[0, 0, np.pi / 2]] * len(found), atol=1e-12)
    between = interpolate(flight, np.array([102.5, 197.5]), "smooth").aircraft
    np.testing.assert_allclose(between[:, 2], [-300.5, -319.5], atol=0.3)


@pytest.mark.parametrize("method", ["rows", "smooth"])
@pytest.mark.parametrize(
    ("north", "steepest"),
    [
        ([0, 200, 400, 600, 700, 700, 700, 700, 800, 1000, 1200], 0.2),  # stops and starts
        ([0, 500, 1000, 1500, 1000, 500, 0], 0.04),  # turns back
        ([0, 500, 1000, 1500, 1010, 510, 0], 2 / 49),  # turns back, and is a little late
    ],
)
def test_the_nose_of_a_climbing_flight_stays_down_where_it_stops_or_turns_back(
    method, north, steepest
):
    """2 m/s of climb throughout; the steepest leg over ground is 11 deg."""
    time = 10.0 * np.arange(len(north))
    flight = load(ned(time, np.stack([north, 0 * time, -300 - 2 * time], axis=1)))
    if method == "smooth":
        flight = interpolate(flight, np.arange(0.0, time[-1], 0.01), method)
    assert 0 < abs(np.tan(flight.aircraft[:, 4])).max() < 3.5 * steepest


def test_a_climb_that_begins_on_the_first_leg_has_its_slope():
    """Rows of h = 50 m/s² t²/20, and the parabola through them is exact at both ends."""
    time = 10.0 * np.arange(5)
    for turned, at in ((1, time), (-1, time - 5.0)):
        path = np.stack([50 * time, 0 * time, -turned * 0.1 * at**2], axis=1)
        pitch = load(ned(time, path)).aircraft[:, 4]
        np.testing.assert_allclose(np.tan(pitch), turned * 0.2 * at / 50, atol=1e-12)


@pytest.mark.parametrize("origin", [None, ORIGIN])
@pytest.mark.parametrize("method", ["legs", "smooth"])
def test_the_attitude_at_a_time_is_the_same_whatever_other_times_are_asked(method, origin):
    """Drones that hover, drift and turn sharply."""
    rng = np.random.default_rng(11)
    for _ in range(25):
        n = rng.integers(4, 12)
        step = rng.choice([0.5, 1, 5, 60], n - 1)
        way = step * rng.choice([0, 0, 0.05, 0.099, 0.15, 3, 20], n - 1)
        way[1] = 5 * step[1]
        course = np.cumsum(rng.normal(0, 0.6, n - 1))
        aircraft = np.zeros((n, 6))
        aircraft[1:, :2] = np.cumsum(way * [np.cos(course), np.sin(course)], axis=1).T
        aircraft[:, 2] = np.cumsum(rng.choice([0, 0, -5], n))
        route = rs.Route(np.append(0, np.cumsum(step)), aircraft, None, False, origin)
        asked = np.union1d(rng.uniform(0, route.time_s[-1], 20), route.time_s)
        more = np.union1d(asked, rng.uniform(0, route.time_s[-1], 300))
        found, among = (interpolate(route, time, method).aircraft for time in (asked, more))
        among = among[np.searchsorted(more, asked)]
        np.testing.assert_allclose(found[:, :3], among[:, :3], atol=1e-9)
        np.testing.assert_allclose(wrapped(found[:, 3:] - among[:, 3:]), 0, atol=1e-4)


@pytest.mark.parametrize(
    "north",
    [(0, 100, 200, 300, 310, 310), (0, 0, 100, 200, 300), (0, 100, 200, 230), (0, 9, 9, 9, 10)],
)
def test_an_aircraft_that_only_flies_north_never_looks_south(north):
    """Not where it stops, starts or slows down, at the rows or between them, nor where it sinks."""
    time = 10.0 * np.arange(len(north))
    path = np.stack([np.array(north, dtype=float), 0 * time, 0 * time - 100], axis=-1)
    route = load(ned(time, path))
    fine = interpolate(route, np.linspace(0, time[-1], 997), "smooth").aircraft
    path[:, 2] += 5 * time
    for aircraft in (route.aircraft, fine, load(ned(time, path)).aircraft):
        np.testing.assert_allclose(aircraft[:, [3, 5]], 0, atol=1e-9)
    assert np.all(np.diff(fine[:, 0]) > -1e-9)


@pytest.mark.parametrize("drift", [0.0, 0.09])
def test_the_course_of_a_hover_is_that_of_a_flight_that_stops_between_two_rows(drift):
    """The flights turn by up to 5 deg a row, and drift in any direction; positions are to 1 cm."""
    rng = np.random.default_rng(5)
    for _ in range(60):
        step, speed = rng.choice([1.0, 2, 5, 10]), rng.uniform(3, 25)
        turn, count = np.radians(rng.uniform(-5, 5)) / step, int(rng.integers(4, 9))
        stop = (count - 1 + rng.uniform(0.1, 0.98)) * step
        time = step * np.arange(count + 6)
        angle = turn * np.minimum(time, stop)
        aircraft = np.zeros((len(time), 6))
        aircraft[:, 0], aircraft[:, 1] = np.sin(angle), 1 - np.cos(angle)
        away = drift * np.maximum(time - step * count, 0)[:, np.newaxis]
        downwind = rng.uniform(0, 7)
        aircraft[:, :2] = aircraft[:, :2] * speed / turn
        aircraft[:, :2] += away * [np.cos(downwind), np.sin(downwind)]
        aircraft = aircraft.round(2)
        route = rs.Route(time, aircraft, None, False)
        found = interpolate(route, time[-2:], "smooth").aircraft[:, 5]
        np.testing.assert_allclose(wrapped(found - turn * stop), 0, atol=np.radians(10))


def test_one_pose_stays_one_pose():
    path = load(f"{FULL}\n3,1,2,3,4,5,6\n")
    same(resample(path, 1.0), path)


@pytest.mark.parametrize(
    ("step", "method", "says"),
    [
        (0.0, "legs", "step_s must be a number not less than 1e-09, got 0"),
        (1e-6, "legs", "more than 1,000,000 poses"),
        (1.0, "leg", "must be one of legs, smooth, got 'leg'; did you mean 'legs'"),
    ],
)
def test_refused_interpolations(step, method, says):
    with pytest.raises(InputError, match=re.escape(says)):
        resample(corner(), step, method)
