"""A scenario made in Python, and its record."""

import dataclasses
import json
import math
import pickle
from pathlib import Path

import numpy as np
import pytest
from helpers import CONFIGS, ROOT, assert_same_scenario, corridor, scenario

import radar_sense as rs
from radar_sense import axis as axes
from radar_sense.errors import InputError
from radar_sense.flight import Path as Flight
from radar_sense.scenario import for_radar

SCENARIOS = sorted(CONFIGS.glob("*.yaml"))
MODEL = rs.DetectionModel(rcs=rs.EllipsoidRCS(a=0.15, b=0.13, c=0.21), p_fa=1.7e-4)
AIRCRAFT = np.array([[0, 500e3, -3e3, 0, 0, math.pi / 2], [1e3, 500e3, -3e3, 0, 0, 1.0]])
COV_AIRCRAFT = np.diag([100.0, 100, 100, 3e-4, 3e-4, 3e-4])
COV_RADAR = np.diag([1e4, 1e4, 1e4, 25])


def radar(state=(0, 0, 0, 167), levels=None, **changes):
    levels = {"medium": rs.Level(COV_RADAR)} if levels is None else levels
    return rs.Radar(**{"model": MODEL, "state": state, "levels": levels} | changes)


def timed(time_s, **changes):
    along = axes.time(np.array([0.0, 5.0]))
    return Flight(along, AIRCRAFT, COV_AIRCRAFT, time_s=time_s, **changes)


def arguments(aircraft=AIRCRAFT, covariance=COV_AIRCRAFT, **changes):
    return {"radars": [radar()], "geometry": rs.States.of(aircraft, covariance)} | changes


@pytest.mark.parametrize("config", SCENARIOS, ids=lambda path: path.stem)
def test_a_scenario_is_the_same_again_from_its_record_and_from_a_pickle(config, monkeypatch):
    """Scenarios are sent to worker processes, with all poses or some."""
    monkeypatch.chdir(ROOT)
    s = rs.load_scenario(config.relative_to(ROOT))
    some = s.at_poses(slice(0, None, 7)).with_analysis(runs=5)
    pickled = [(pickle.loads(pickle.dumps(one)), one) for one in (s, some)]
    for again, one in ((rs.parse_scenario(json.dumps(s.resolved())), s), *pickled):
        assert_same_scenario(again, one)
        assert again.resolved() == one.resolved()
        assert_read_only(again)


def assert_read_only(s):
    """All arrays are read-only, and so are the mappings of levels."""
    (own, *_) = s.radars
    arrays = s.aircraft, s.cov_aircraft, s.radar, own.state, own.levels[s.level].covariance
    for array in (*arrays, *([] if s.time_s is None else [s.time_s])):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(TypeError):
        own.levels["new"] = own.levels[s.level]


def test_check_prints_numbers_as_typed(tool):
    text = (CONFIGS / "paper.yaml").read_text()
    Path("my.yaml").write_text(text.replace("500  ", "5.00e2").replace("10,", "10.,"))
    out = tool("check", "my.yaml").out
    assert "p_fa: 1.7e-4\n" in out
    assert "range_km: 5.00e2\n" in out
    assert "position_m: [0, 0, 0]\n" in out
    assert "low: {position_m: 10., constant: 1}" in out
    record = rs.load_scenario("my.yaml").resolved()
    assert json.loads(json.dumps(record))["radar"]["p_fa"] == 1.7e-4
    assert repr(record["radar"]["constant"]) == "167"


def test_the_record_has_what_is_not_of_the_file():
    s = rs.load_scenario(CONFIGS / "paper.yaml")
    plain = s.resolved()

    def changed(**changes):
        return json.loads(json.dumps(dataclasses.replace(s, **changes).resolved()))

    def with_radar(**changes):
        return {"radars": [dataclasses.replace(s.radars[0], **changes)]}

    assert dataclasses.replace(s).resolved() == plain
    doubled = changed(**with_radar(state=s.radar * [1, 1, 1, 2]))
    assert doubled["radars"]["type"] == doubled["geometry"]["type"] == "states"
    assert doubled["radars"]["states"] == [0, 0, 0, 334]
    larger = rs.Level(4 * s.radars[0].levels["high"].covariance)
    moved = changed(**with_radar(levels={"new": larger}), level="new")
    assert moved["radars"]["levels"]["radar"]["new"]["covariance"][0][0] == 2000.0**2
    assert moved["uncertainty"]["cov_aircraft"] == s.cov_aircraft.tolist()
    assert moved["analysis"]["level"] == "new"
    other = rs.DetectionModel(rs.ConstantRCS(0.5), 1e-6, rs.Swerling1())
    record = changed(**with_radar(model=other))
    assert "p_fa=1e-06, detector=Swerling1" in record["radars"]["radars"][0]
    assert record["aircraft"]["rcs"] == ["ConstantRCS(rcs=0.5)"]
    higher = changed(geometry=rs.States.of(s.aircraft - [0, 0, 1, 0, 0, 0], s.cov_aircraft))
    assert higher["geometry"]["aircraft"]["shape"] == [361, 6]
    assert changed(rcs_db=0.5)["uncertainty"]["rcs_db"] == 0.5
    with pytest.raises(InputError, match="radars: must be a list"):  # no file can say this
        rs.parse_scenario(json.dumps(higher))


def test_the_record_of_classes_of_ones_own_has_no_address():
    """The same scenario has the same record in another process."""

    class Sphere(rs.ConstantRCS):
        __repr__ = object.__repr__

    own = dataclasses.replace(MODEL, rcs=Sphere(1.0))
    record = str(dataclasses.replace(scenario(), radars=[radar(model=own)]).resolved())
    assert "Sphere object>" in record
    assert "0x" not in record


def test_a_network_whose_radars_moved_has_its_states_in_the_record(monkeypatch):
    monkeypatch.chdir(ROOT)
    s = corridor()
    first, second, *others = s.radars
    moved = dataclasses.replace(second, state=second.state + np.eye(4)[0])
    record = dataclasses.replace(s, radars=[first, moved, *others]).resolved()
    assert record["radars"]["states"][4] == s.radar[4] + 1
    assert list(record["radars"]["levels"]) == list(s.model.names)
    assert list(record["radars"]["levels"]["west"]) == list(s.levels)
    (entry,) = for_radar(s, "west").resolved()["radars"]
    assert entry == s.resolved()["radars"][2]


def test_a_scenario_made_in_python():
    s = rs.Scenario(**arguments())
    assert (s.name, s.level, s.runs, s.seed) == ("scenario", "medium", 500, 1)
    assert s.axis.at(1) == "pose 1"
    result = rs.analyses.variance(s, method="linear")
    assert result.table["pose"].tolist() == [0, 1]
    std = MODEL.linearize(s.aircraft, s.radar).std(s.cov_aircraft, s.cov_radar)
    np.testing.assert_allclose(result.table["sigma_pd"], std, rtol=1e-12)
    record = json.loads(json.dumps(s.resolved()))
    assert record["radars"]["states"][3] == 167
    assert record["uncertainty"]["cov_aircraft"][0][0] == 100
    assert rs.Scenario(**arguments(geometry=timed([0.0, 5.0]))).axis.key == "time_s"
    assert rs.Scenario(**arguments(AIRCRAFT[0])).axis.at(0) == "pose 0"


def test_the_embedded_scenario_is_the_one_in_configs():
    file = CONFIGS / "paper.yaml"
    assert not file.is_symlink()
    assert file.read_bytes() == (ROOT / "radar_sense/paper.yaml").read_bytes()


@pytest.mark.parametrize("config", ["x_band_tracking", "gap_fillers"])
def test_a_scenario_with_tolerances_may_have_no_poses(config):
    s = rs.load_scenario(f"configs/{config}.yaml").at_states(np.empty((0, 6)))
    assert rs.propagate_scenario(s, method="linear").std.shape == (0,)


def test_c_rr_of_a_scenario_has_what_radars_of_a_type_share():
    """First order by hand is then that of the scenario."""
    s = rs.load_scenario("configs/gap_fillers.yaml", {"uncertainty.aircraft.rcs_db": 0})
    by_hand = s.model.linearize(s.aircraft, s.radar).std(s.cov_aircraft, s.cov_radar)
    expected = rs.propagate_scenario(s, method="linear").std
    np.testing.assert_allclose(by_hand, expected, rtol=1e-12)
    alone = np.diag(np.diag(s.cov_radar))
    assert not np.allclose(
        s.model.linearize(s.aircraft, s.radar).std(s.cov_aircraft, alone), expected
    )
