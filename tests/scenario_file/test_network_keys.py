"""`radars:` in a scenario: several radars in place of one, as the command line takes them.

A refusal is one line that names file, line, key path and the allowed values, as in `test_keys`.
"""

import numpy as np
import pytest
import yaml
from helpers import (
    TRACKING,
    cov_by_level,
    network_document,
    parsed_network,
    radar_entry,
    read_back,
    write,
    yaml_text,
)
from numpy.testing import assert_array_equal
from scenario_file.refused import place_of_error

import radar_sense as rs
from radar_sense.scenario_file.load import default_text

NEAR = {**yaml.safe_load(default_text())["geometry"], "range_km": 4}


def refused(*radars: object, **changes: object) -> tuple[str, str, str]:
    """Insist on a refusal; return the key path, the message, and the text of the named line."""
    text = yaml_text(network_document(*radars, **changes))
    line, path, complaint = place_of_error(text)
    return path, complaint, text.splitlines()[line - 1].strip()


# Allowed keys.


def test_every_key_of_a_radar_is_read():
    s = parsed_network(
        radar_entry("east", horizon=True, max_range_km=450.5, scan_period_s=10),
        radar_entry(
            "West-2",
            position_m=[-2e4, 0, 5],
            constant=90,
            p_fa=1e-6,
            detector="swerling1",
            uncertainty={
                "high": {"covariance": np.diag([1.0, 4.0, 9.0, 16.0]).tolist()},
                "low": {"position_m": np.diag([4.0, 5.0, 6.0]).tolist(), "constant": 2},
            },
        ),
    )
    east, west = s.model.radars
    assert s.model.names == (east.name, west.name) == ("east", "West-2")
    assert (east.max_range, east.horizon, east.scan_period) == (450_500.0, rs.Horizon(), 10.0)
    assert (west.max_range, west.horizon, west.scan_period) == (np.inf, None, None)
    assert east.model == rs.DetectionModel(west.model.rcs, 1e-4, rs.North())
    assert west.model == rs.DetectionModel(east.model.rcs, 1e-6, rs.Swerling1())
    assert_array_equal(s.radar, [1e3, 2e3, -30, 160, -2e4, 0, 5, 90])
    assert s.levels == ("low", "high")  # the order of the first
    assert_array_equal(cov_by_level(s)["low"], np.diag([100.0, 100, 100, 1, 4, 5, 6, 4]))
    assert_array_equal(cov_by_level(s)["high"], np.diag([1e4, 4e4, 100, 25, 1, 4, 9, 16]))
    assert not any(radar.state.flags.writeable for radar in s.radars)
    assert not east.levels["low"].covariance.flags.writeable


def test_a_network_is_checked_with_a_comment_for_each_radar(tool):
    # on a mountain, because from the ground the paper's aircraft is below the horizon
    entries = [radar_entry(f"r{i}", position_m=[10.0 * i, 0, -5e3], horizon=True) for i in range(3)]
    found = read_back(parsed_network(*entries))
    out = tool("check", write(yaml_text(found.resolved()))).out
    comments = [line for line in out.splitlines() if line.startswith("#")]
    constants = [f"# r{i}: c_r = 160 J m^2/K" for i in range(3)]
    assert comments[:4] == ["# 5 poses, 3 radars", *constants]
    assert [line.partition(": range ")[0] for line in comments[-3:]] == ["# r0", "# r1", "# r2"]
    assert rs.parse_scenario(out).resolved() == found.resolved()


# Refused keys.


@pytest.mark.parametrize(
    ("changes", "path", "says", "line"),
    [
        ({"name": None}, "radars[2]", "'name'", ""),
        ({"name": "x" * 41}, "radars[2].name", "must be the name of a radar, up to 40 let", ""),
        ({"name": "a"}, "radars[2].name", "must be a name that no other radar has, got 'a'", ""),
        ({"name": "total"}, "radars[2].name", "'total' would mean two things", "- name: total"),
        ({"name": "error_a"}, "radars[2].name", "'error_a' would mean two things", ""),
        ({"max_range_m": 5}, "radars[2]", "did you mean 'max_range_km', in km?", "max_range_m: 5"),
    ],
)  # fmt: skip
def test_a_radar_that_is_refused(changes, path, says, line):
    where, complaint, named = refused(radar_entry("a"), radar_entry("b", **changes))
    assert where == path
    assert says in complaint
    assert named == line or not line


#: A radar with a pulse of 11 us, in which the target may be hidden.
PULSE = {"constant": None, "tracking": {**TRACKING, "pulse_width_us": 11}}


@pytest.mark.parametrize(
    ("limits", "least"),
    [
        ({}, 0.0),  # a pulse width alone hides nothing
        ({"eclipsing": False}, 0.0),
        ({"eclipsing": True}, 299_792_458 * 11e-6 / 2),
        ({"eclipsing": True, "min_range_km": 1.5}, 299_792_458 * 11e-6 / 2),
        ({"eclipsing": True, "min_range_km": 2.5}, 2500.0),
        ({"min_range_km": 2.5, "max_range_km": 3}, 2500.0),
    ],
)
def test_the_minimum_range_is_the_farther_of_two(limits, least):
    s = parsed_network(radar_entry("near", **PULSE, **limits), geometry=NEAR)
    assert s.model.radars[0].min_range == pytest.approx(least, rel=1e-15)
    read_back(s)
    entry = s.resolved()["radars"][0]
    assert {key: entry.get(key, False) for key in limits} == limits


@pytest.mark.parametrize(
    ("limits", "key", "says"),
    [
        ({"min_range_km": 5, "max_range_km": 5}, "min_range_km", "must be less than max_range_km"),
        ({"eclipsing": True, "max_range_km": 1}, "eclipsing", "within 1.64886 km, must be less"),
        ({"eclipsing": True, "tracking": None, "constant": 1}, "eclipsing", "pulse_width_us"),
    ],
)
def test_a_minimum_range_that_is_refused(limits, key, says):
    where, complaint, _ = refused(radar_entry("near", **{**PULSE, **limits}))
    assert where == f"radars[1].{key}"
    assert says in complaint


def test_levels_that_differ():
    levels = radar_entry("b")["uncertainty"]
    other = {"low": levels["low"], "hihg": levels["high"]}
    path, complaint, _ = refused(radar_entry("a"), radar_entry("b", uncertainty=other))
    assert path == "radars[2].uncertainty.hihg"
    assert complaint == ("must be a level that radar 'a' has too: low, high; did you mean 'high'?")
    fewer = {"low": levels["low"]}
    path, complaint, _ = refused(
        radar_entry("a"), radar_entry("b"), radar_entry("c", uncertainty=fewer)
    )
    assert path == "radars[3].uncertainty"
    assert complaint == (
        "missing level 'high'; radar 'c' must have the levels that radar 'a' has: low, high"
    )


def test_uncertainty_of_a_single_radar_beside_radars():
    uncertainty = yaml.safe_load(default_text())["uncertainty"]
    path, complaint, _ = refused(radar_entry("a"), uncertainty=uncertainty)
    assert path == "uncertainty.radar"
    assert complaint == "must be left out here: give 'uncertainty' of each radar in 'radars'"


def test_every_radar_is_clear_of_the_aircraft_and_within_an_rcs_table(tool):
    below = radar_entry("b", position_m=[0, 500e3, -3000.5])
    path, complaint, _ = refused(radar_entry("a"), below)
    assert path == "geometry"
    assert complaint.startswith("the aircraft is on top of radar 'b' at azimuth 0 deg, slant range")
    rows = [f"{a},{e},0.1" for e in (-10, 10) for a in (-180, -90, 0, 90)]
    write("azimuth_deg,elevation_deg,rcs_m2\n" + "\n".join(rows) + "\n", "rcs.csv")
    aircraft = {"rcs": {"model": "table", "file": "rcs.csv"}, "attitude_deg": [0, 0, 90]}
    above = radar_entry("b", position_m=[0, 480e3, -50e3])
    path, complaint, _ = refused(radar_entry("a"), above, aircraft=aircraft)
    assert path == "geometry"
    assert complaint.startswith("at azimuth 0 deg the aircraft sees radar 'b' at elevation 66.9")
