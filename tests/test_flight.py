"""The geometry of a scenario: its poses, and the poses between them."""

import dataclasses
import math
import pickle

import numpy as np
import pytest
from helpers import few_draws, scenario, write_path

import radar_sense as rs
from radar_sense.flight import Orbit, Path, States

STD = ",".join(f"std_{name}" for name in ("north_m", "east_m", "down_m"))
STD += ",std_roll_deg,std_pitch_deg,std_yaw_deg"
ROUTE = f"""time_s,north_m,east_m,down_m,{STD}
0,0,0,-1000,10,10,10,1,1,1
10,1000,0,-1000,10,10,10,1,1,1
30,1000,4000,-2000,30,30,30,3,3,3
"""


def test_an_orbit_at_other_azimuths():
    """North and east of a circle by plain trigonometry, at the attitude of the file."""
    s = scenario(geometry__azimuth_deg={"start": 0, "stop": 90, "step": 45})
    assert isinstance(s.geometry, Orbit)
    assert s.geometry.continuous
    found = s.geometry.at(np.array([10.0, 77.5]))
    for azimuth, pose in zip((10.0, 77.5), found.aircraft, strict=True):
        angle = math.radians(azimuth)
        expected = [500e3 * math.sin(angle), 500e3 * math.cos(angle), -3e3, 0, 0, math.pi / 2]
        np.testing.assert_allclose(pose, expected, rtol=1e-14, atol=1e-12)
    np.testing.assert_array_equal(s.geometry.at(s.geometry.coordinate).aircraft, s.aircraft)


def test_a_path_at_other_times(tmp_path):
    """Position and covariance are linear in time between the rows."""
    s = rs.load_scenario(write_path(tmp_path, ROUTE, geometry__axis="distance"))
    assert isinstance(s.geometry, Path)
    assert s.geometry.continuous
    np.testing.assert_array_equal(s.geometry.coordinate, [0, 10, 30])
    found = s.geometry.at(np.array([5.0, 20.0]))
    np.testing.assert_allclose(found.aircraft[:, :3], [[500, 0, -1000], [1000, 2000, -1500]])
    np.testing.assert_allclose(found.covariance[:, 0, 0], [100, 500])
    assert found.axis.key == "distance_m"
    np.testing.assert_allclose(found.axis.values, [500, 1000 + math.hypot(4000, 1000) / 2])


def test_a_path_of_arrays_is_that_of_a_file(tmp_path, monkeypatch):
    few_draws(monkeypatch)
    s = rs.load_scenario(write_path(tmp_path, ROUTE, radar__scan_period_s=7))
    path = rs.Path.of([0, 10, 30], s.aircraft, s.cov_aircraft)
    made = rs.Scenario(radars=s.radars, geometry=path, level=s.level, method=s.method)
    for command, options in (("variance", {"threshold": 0.5}), ("mission", {}), ("budget", {})):
        here, there = (getattr(rs.analyses, command)(one, **options) for one in (made, s))
        assert here.report == there.report
        for name, column in there.table.items():
            np.testing.assert_array_equal(here.table[name], column)


def test_the_record_of_a_path_of_arrays_has_its_times():
    s = scenario().at_poses(slice(3))
    made = [
        rs.Scenario(radars=s.radars, geometry=rs.Path.of(time, s.aircraft)).resolved()["geometry"]
        for time in ([0, 1, 2], [0, 2, 4], [0, 1, 2])
    ]
    assert made[0] == made[2] != made[1]
    assert {"time_s", "aircraft", "origin", "method"} <= made[0].keys()


def test_there_is_no_flight_between_states():
    s = scenario().at_poses(slice(0, 9))
    assert isinstance(s.geometry, States)
    assert not s.geometry.continuous
    with pytest.raises(rs.InputError, match="no flight from pose to pose"):
        s.geometry.at(np.array([1.0]))


def test_other_poses_of_the_flight_keep_the_record_of_the_file(tmp_path):
    paths = rs.load_scenario(write_path(tmp_path, ROUTE)), scenario()
    for s, coordinate in zip(paths, (np.array([1.0, 2, 3]), np.array([7.0])), strict=True):
        other = s.along(s.geometry.at(coordinate))
        assert len(other.aircraft) == len(other.axis) == len(coordinate)
        assert other.resolved() == s.resolved()
        assert pickle.loads(pickle.dumps(other)).resolved() == s.resolved()
        assert other.along(s.geometry).geometry is s.geometry


def test_one_covariance_of_all_poses_is_that_of_the_poses_between_them(tmp_path):
    """Also of a route that has its own in the file."""
    path = write_path(tmp_path, ROUTE, geometry__interpolate={"step_s": 15})
    flown = dataclasses.replace(rs.load_scenario(path).geometry, covariance=np.eye(6))
    np.testing.assert_array_equal(flown.at(np.array([5.0, 7.0])).covariance, np.eye(6))
