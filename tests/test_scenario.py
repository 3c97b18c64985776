"""A scenario made in Python, and its record."""

import json
import math
import pickle
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers import (
    cov_by_level,
    scenario,
    with_arrays,
)
from hypothesis import given, settings
from hypothesis import strategies as st

import radar_sense as rs
from radar_sense.errors import InputError
from radar_sense.scenario import for_radar
from radar_sense.scenario_file.declare import keys_of, sections
from radar_sense.scenario_file.sections import File

ROOT = Path(__file__).parent.parent
CONFIGS = sorted((ROOT / "configs").glob("*.yaml"))
MODEL = rs.DetectionModel(rcs=rs.EllipsoidRCS(a=0.15, b=0.13, c=0.21), p_fa=1.7e-4)
ARGUMENTS = {
    "model": MODEL,
    "aircraft": [[0, 500e3, -3e3, 0, 0, math.pi / 2], [1e3, 500e3, -3e3, 0, 0, 1.0]],
    "radar": [0, 0, 0, 167],
    "cov_aircraft": np.diag([100.0, 100, 100, 3e-4, 3e-4, 3e-4]),
    "cov_radar": {"medium": np.diag([1e4, 1e4, 1e4, 25])},
}


def assert_same(a, b):
    for name in ("aircraft", "radar", "cov_aircraft"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert list(a.cov_radar) == list(b.cov_radar)
    for level, matrix in a.cov_radar.items():
        np.testing.assert_array_equal(matrix, b.cov_radar[level])
    assert a.tolerances == b.tolerances
    assert (a.level, a.runs, a.seed, a.correlation_s) == (b.level, b.runs, b.seed, b.correlation_s)


@pytest.mark.parametrize("config", CONFIGS, ids=lambda path: path.stem)
def test_a_resolved_scenario_reads_back(config, monkeypatch):
    monkeypatch.chdir(ROOT)
    s = rs.load_scenario(config.relative_to(ROOT))
    again = rs.parse_scenario(json.dumps(s.resolved()))
    assert_same(again, s)
    assert again.resolved() == s.resolved()


@pytest.mark.parametrize("config", CONFIGS, ids=lambda path: path.stem)
def test_a_pickled_scenario_is_the_same_scenario(config):
    """Scenarios are sent to worker processes."""
    s = rs.load_scenario(config)
    some = s.at_poses(slice(0, None, 7)).with_analysis(runs=5)
    for one in (s, some):
        again = pickle.loads(pickle.dumps(one))
        assert_same(again, one)
        assert again.resolved() == one.resolved()
        assert not again.aircraft.flags.writeable
        with pytest.raises(TypeError):
            again.cov_radar["new"] = np.eye(4)
        np.testing.assert_array_equal(
            again.model.p_d(again.aircraft, again.radar), one.model.p_d(one.aircraft, one.radar)
        )


@settings(max_examples=60, deadline=None)
@given(
    sizes=st.lists(st.floats(1e-6, 1e6), min_size=12, max_size=12),
    angles=st.lists(st.floats(-360, 360).map(lambda x: round(x, 7)), min_size=3, max_size=3),
    km=st.floats(2, 1e5),
)
def test_any_numbers_read_back_exactly(sizes, angles, km):
    s = scenario(
        uncertainty__aircraft={"position_m": sizes[:3], "attitude_deg": sizes[3:6]},
        uncertainty__radar={
            f"level_{i}": {"position_m": sizes[i], "constant": sizes[i + 1]}
            for i in range(6, 12, 2)
        },
        analysis__level="level_6",
        aircraft__attitude_deg=angles,
        geometry__range_km=km,
        geometry__azimuth_deg={"start": 0, "stop": 0, "step": 1},
    )
    record = s.resolved()
    again = rs.parse_scenario(json.dumps(record))
    assert_same(again, s)
    assert record["geometry"]["range_km"] == km
    assert record["aircraft"]["attitude_deg"] == angles


def test_check_prints_numbers_as_typed(tool):
    text = (ROOT / "configs/paper.yaml").read_text()
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
    s = rs.load_scenario(ROOT / "configs/paper.yaml")
    plain = s.resolved()

    def changed(**changes):
        record = json.loads(json.dumps(with_arrays(s, **changes).resolved()))
        return {key: value for key, value in record.items() if value != plain[key]}

    assert changed() == {}
    assert changed(aircraft=s.aircraft.copy(), cov_radar=dict(s.cov_radar)) == {}
    doubled = changed(radar=s.radar * [1, 1, 1, 2])
    assert doubled["radar"]["type"] == "states"
    assert doubled["radar"]["radar"] == [0, 0, 0, 334]
    moved = changed(cov_radar={"new": 4 * cov_by_level(s)["high"]}, level="new")["uncertainty"]
    assert moved["cov_radar"]["new"][0][0] == 2000.0**2
    assert moved["cov_aircraft"] == s.cov_aircraft.tolist()
    other = rs.DetectionModel(rs.ConstantRCS(0.5), 1e-6, rs.Swerling1())
    record = changed(model=other)
    assert "p_fa=1e-06, detector=Swerling1" in record["radar"]["model"][0]
    assert record["aircraft"]["rcs"] == "ConstantRCS(rcs=0.5)"
    higher = changed(aircraft=s.aircraft - [0, 0, 1, 0, 0, 0])
    assert higher["geometry"]["type"] == "states"
    assert higher["geometry"]["aircraft"]["shape"] == [361, 6]
    assert "attitude_deg" not in higher["aircraft"]
    with pytest.raises(InputError, match="geometry"):  # no file can say this
        rs.parse_scenario(json.dumps({**plain, **higher}))


def test_a_network_whose_radars_moved_has_its_states_in_the_record(monkeypatch):
    monkeypatch.chdir(ROOT)
    s = rs.load_scenario("configs/corridor.yaml")
    moved = s.radar.copy()
    moved[4] += 1.0  # the second radar, northwards
    record = with_arrays(s, radar=moved).resolved()
    assert record["radars"]["radar"] == moved.tolist()
    assert list(record["radars"]["cov_radar"]) == list(s.cov_radar)
    (entry,) = for_radar(s, "west").resolved()["radars"]
    assert entry == s.resolved()["radars"][2]


def test_a_scenario_made_in_python():
    s = rs.Scenario(**ARGUMENTS)
    assert (s.name, s.level, s.runs, s.seed) == ("scenario", "medium", 500, 1)
    assert s.axis.at(1) == "1"
    result = rs.variance(s, method="linear")
    assert result.table["pose"].tolist() == [0, 1]
    std = MODEL.linearize(s.aircraft, s.radar).std(s.cov_aircraft, cov_by_level(s)["medium"])
    np.testing.assert_allclose(result.table["sigma_pd"], std, rtol=1e-12)
    record = json.loads(json.dumps(s.resolved()))
    assert record["radar"]["radar"][3] == 167
    assert record["uncertainty"]["cov_aircraft"][0][0] == 100
    timed = rs.Scenario(**ARGUMENTS, time_s=[0.0, 5.0])
    assert timed.axis.key == "time_s"
    assert rs.Scenario(**{**ARGUMENTS, "aircraft": ARGUMENTS["aircraft"][0]}).axis.at(0) == "0"


def test_arrays_are_copies_that_nobody_can_change():
    aircraft = np.array(ARGUMENTS["aircraft"])
    s = rs.Scenario(**{**ARGUMENTS, "aircraft": aircraft})
    aircraft[:] = 0
    assert s.aircraft[0, 1] == 500e3
    for array in (s.aircraft, s.radar, s.cov_aircraft, cov_by_level(s)["medium"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(TypeError):
        cov_by_level(s)["new"] = np.eye(4)


PER_POSE = np.stack([np.eye(6), np.eye(6)])
WRONG = {
    "columns": ({"aircraft": np.zeros((2, 5))}, r"aircraft must have shape \(n, 6\) .* \(2, 5\)"),
    "no poses": ({"aircraft": np.zeros((0, 6))}, "aircraft must have shape"),
    "text": ({"aircraft": [["a"] * 6]}, "aircraft must be an array of real numbers, got <U1"),
    "ragged": ({"aircraft": [[0] * 6, [0]]}, "aircraft must be an array of numbers: "),
    "complex": ({"radar": np.array([0, 0, 0, 167 + 0j])}, "real numbers, got complex128"),
    "booleans": ({"radar": [True, True, True, True]}, "radar must be .* real numbers, got bool"),
    "dates": ({"time_s": np.array(["2026-01-01", "2026-01-02"], "M8[s]")}, "got datetime64"),
    "masked": ({"radar": np.ma.masked_less([0.0, 0, 0, 167], 1)}, "radar must not be a masked"),
    "NaN": ({"aircraft": [[0, 0, math.nan, 0, 0, 0]]}, "aircraft must be finite, got nan"),
    "radar": ({"radar": [0, 0, 0]}, r"radar must have shape \(4,\) for north, .* got \(3,\)"),
    "infinite": ({"radar": [0, 0, math.inf, 1]}, "radar must be finite, got inf"),
    "constant": ({"radar": [0, 0, 0, -1]}, "radar constants must be greater than 0, got -1"),
    "matrix": ({"cov_aircraft": np.eye(5)}, r"cov_aircraft must have shape \(6, 6\) or \(2, 6, 6"),
    "poses": ({"cov_aircraft": np.ones((3, 6, 6))}, "cov_aircraft must have shape"),
    "not PSD": ({"cov_aircraft": np.eye(6) - 0.5}, "cov_aircraft is not positive semidefinite"),
    "one not PSD": (
        {"cov_aircraft": PER_POSE - np.array([0, 0.5])[:, None, None]},
        r"cov_aircraft\[1\] is not positive semidefinite",
    ),
    "one not symmetric": (
        {"cov_aircraft": PER_POSE + np.triu(np.full((6, 6), 0.1), 1)},
        r"cov_aircraft\[0\] is not symmetric",
    ),
    "NaN in C": ({"cov_aircraft": np.full((6, 6), math.nan)}, "cov_aircraft must be finite"),
    "no level": ({"cov_radar": {}}, "cov_radar needs at least one level"),
    "a level": ({"cov_radar": {"x": -np.eye(4)}}, r"cov_radar\['x'\] has a negative variance"),
    "level": ({"level": "medum"}, "level must be one of medium, got 'medum'; did you mean"),
    "runs": ({"runs": 1}, "runs must be a whole number not less than 2"),
    "seed": ({"seed": -1}, "seed must be"),
    "name": ({"name": "../x"}, "name must be a name of up to 100 letters"),
    "times": ({"time_s": [0.0]}, r"must have one value for each of 2 poses, got \(1,\)"),
    "correlation": ({"correlation_s": math.nan}, "correlation_s must be a number not less than 0"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_arguments_fail_where_they_are_made(case):
    changes, words = WRONG[case]
    with pytest.raises(InputError, match=words) as refused:
        rs.Scenario(**{**ARGUMENTS, **changes})
    assert "\n" not in str(refused.value)
    with pytest.raises(InputError, match=words):
        with_arrays(rs.Scenario(**ARGUMENTS), **changes)


def test_a_scenario_in_a_notebook():
    s = rs.Scenario(**ARGUMENTS)
    assert repr(s) == (
        "<Scenario 'scenario': 2 poses by pose, 1 radar, level medium of medium, 500 runs, seed 1>"
    )
    network = rs.load_scenario(ROOT / "configs/network.yaml")
    assert len(repr(network)) < 200
    assert "3 radars (search, ridge, mobile)" in repr(network)


def test_the_old_name_of_the_error():
    assert InputError is InputError is rs.InputError
    assert issubclass(InputError, ValueError)


def test_every_key_is_declared_with_its_meaning():
    names = {"model", "type"}
    for name, section in sections(File):
        for key in keys_of(section):
            assert key.meaning.endswith("."), (name, key.name)
            names.add(key.name)
    # and every key of every example is a declared one
    assert len(names) > 80
    for config in CONFIGS:
        waiting = [yaml.safe_load(config.read_text())]
        while waiting:
            block = waiting.pop()
            if isinstance(block, list):
                waiting += block
            elif isinstance(block, dict):
                block.pop("losses_db", None)  # whose keys are the names of losses
                for key in set(block) - names:  # the names of levels
                    assert "position_m" in block[key] or "covariance" in block[key], (config, key)
                waiting += block.values()


def test_the_embedded_scenario_is_the_one_in_configs():
    file = ROOT / "configs/paper.yaml"
    assert not file.is_symlink()
    assert file.read_bytes() == (ROOT / "radar_sense/paper.yaml").read_bytes()
