"""The summary lines of `check`, against plain loops over the poses."""

import math

import numpy as np
import pytest
import yaml
from helpers import CONFIGS, csv_text, scenario, write_path
from routes import GEO, HEAD

import radar_sense as rs
from radar_sense.analyses.check import overview
from radar_sense.model.geodesy import geodetic_from_ned

#: A quarter of a circle of 20 km to the right at 200 m/s, climbing at 5 m/s.
SPEED, RADIUS = 200.0, 20e3
TIMES = np.arange(0.0, 158.0, 2.0)


def test_a_turn_on_a_flat_earth(tmp_path, tool, monkeypatch):
    monkeypatch.chdir(tmp_path)
    angle = SPEED / RADIUS * TIMES
    north, east = RADIUS * np.sin(angle), RADIUS * (1 - np.cos(angle)) + 4e4
    rows = zip(TIMES, north, east, -1000 - 5 * TIMES, strict=True)
    file = write_path(tmp_path, csv_text(HEAD, rows))
    scenario = rs.load_scenario(file)
    constant, path, height, radar = overview(scenario)
    assert path == "path: 156 s (0:02:36), 31.21 km, speed 200.1 m/s"
    bank = math.degrees(math.atan(SPEED**2 / RADIUS / 9.80665))
    assert height.startswith("height 1000 to 1780 m above the origin, bank ")
    banks = [float(x) for x in height.split("bank ")[1].removesuffix(" deg").split(" to ")]
    assert banks == pytest.approx([bank] * len(banks), rel=0.01)
    distances = [math.dist(pose[:3], scenario.radar[:3]) / 1e3 for pose in scenario.aircraft]
    snr = 10 * np.log10(scenario.model.snr(scenario.aircraft, scenario.radar))
    assert radar == (
        f"radar: range {min(distances):.4g} to {max(distances):.4g} km, "
        f"SNR {np.min(snr):.4g} to {np.max(snr):.4g} dB"
    )
    code, out, _ = tool("check", file.name)
    assert code == 0
    assert [line for line in out.splitlines() if line.startswith("#")] == [
        f"# {line}" for line in (constant, path, height, radar)
    ]
    assert rs.parse_scenario(out).resolved() == scenario.resolved()


def test_level_flight_on_the_round_earth(tmp_path):
    """300 km from the origin its level is tilted by 2.7 deg, and its height is 7 km off."""
    rows = [(60 * i, 47, 8 + 0.1 * i, 9000) for i in range(41)]
    origin = {"latitude_deg": 47, "longitude_deg": 8, "altitude_m": 400}
    file = write_path(
        tmp_path,
        csv_text(GEO, rows),
        geometry={"type": "path", "file": "route.csv", "origin": origin},
    )
    scenario = rs.load_scenario(file)
    assert geodetic_from_ned(scenario.aircraft[-1, :3], scenario.origin)[2] == pytest.approx(9000)
    _, path, height, _ = overview(scenario)
    latitude, e2 = math.radians(47), 0.0066943799901413165
    radius = (6378137 / math.sqrt(1 - e2 * math.sin(latitude) ** 2) + 9000) * math.cos(latitude)
    length = radius * math.radians(4)
    assert path == f"path: 2400 s (0:40:00), {length / 1e3:.4g} km, speed {length / 2400:.4g} m/s"
    assert height.startswith("height 9000 m above the ellipsoid, bank ")
    banks = [float(x) for x in height.split("bank ")[1].removesuffix(" deg").split(" to ")]
    assert np.max(np.abs(banks)) < 0.05  # the circle of latitude is turned by a little
    assert np.ptp(scenario.aircraft[:, 2]) > 5e3


def test_a_flight_of_hours(tmp_path):
    file = write_path(tmp_path, "time_s,north_m,east_m,down_m\n0,0,0,-9e3\n7443,1e5,0,-9e3")
    assert overview(rs.load_scenario(file))[1].startswith("path: 7443 s (2:04:03), 100 km, ")


def test_rows_between_the_poses_are_counted(tmp_path):
    """Every two minutes is a pose, and the row at 60 s is between two of them."""
    rows = "0,0,0,-9e3\n60,1e4,0,-9e3\n240,4e4,0,-9e3"
    file = write_path(
        tmp_path,
        f"time_s,north_m,east_m,down_m\n{rows}",
        geometry={"type": "path", "file": "route.csv", "interpolate": {"step_s": 120}},
        radar__max_range_km=1,
    )
    first, *_, last = overview(rs.load_scenario(file))
    assert first.startswith("3 poses (4 with the rows of the path between them), c_r")
    assert last == "radar: out of sight at all 4 poses, by maximum range"


def test_an_orbit_has_no_times(tool):
    assert overview(rs.load_scenario())[1] == "height 3000 m above the origin, bank 0 deg"
    text = yaml.safe_load(tool("check").out)
    assert text["geometry"]["down_km"] == -3


def test_an_aircraft_beyond_the_horizon(tool):
    """The paper's radar sees 500 km far at 3 km height: √(2 · 4/3 · 6371 km · 3 km) = 225.8 km."""
    line = (
        "radar: beyond the horizon, 225.8 km, at all 361 poses; horizon: true hides the aircraft "
        "there"
    )
    assert pytest.approx(math.sqrt(2 * 4 / 3 * 6371 * 3), abs=0.05) == 225.8
    assert overview(rs.load_scenario())[-1] == line
    code, out, err = tool("check")
    assert (code, err, out.count("horizon")) == (0, "", 2)
    assert f"# {line}" in out.splitlines()
    near, raised, limited = (
        scenario(**{"geometry__azimuth_deg": {"start": 0, "stop": 1, "step": 1}, **changes})
        for changes in (
            {"geometry__range_km": 225},
            {"radar__position_m": [0, 0, -4500]},  # 276 km more
            {"radar__max_range_km": 225},
        )
    )
    for seen in (near, raised, limited, scenario(geometry__down_km=0)):
        assert "horizon" not in " ".join(overview(seen))
    hidden = scenario(radar__horizon=True, radar__min_range_km=501)
    line = "radar: out of sight at all 361 poses, by minimum range and horizon"
    assert overview(hidden)[-1] == line
    assert overview(limited)[-1] == "radar: out of sight at all 2 poses, by maximum range"


def test_poses_beyond_the_horizon_of_a_path():
    s = rs.load_scenario(CONFIGS / "mission.yaml")
    height, distance = -s.aircraft[:, 2], np.linalg.norm(s.aircraft[:, :3] - s.radar[:3], axis=1)
    beyond = distance > np.sqrt(2 * 4 / 3 * 6371e3 * height)
    first, last = s.time_s[np.flatnonzero(beyond)[[0, -1]]]
    assert f"at {first:g} to {last:g} s; horizon: true" in overview(s)[-1]
