"""Values by path of keys in place of those of the file."""

import json

import numpy as np
import pytest
import yaml
from helpers import CONFIGS, TRACKING, assert_same_scenario, document, yaml_text
from scenario_file.refused import refused

import radar_sense as rs
from radar_sense.scenario import for_radar
from radar_sense.scenario_file.load import parse_scenario

NETWORK = CONFIGS / "network.yaml"


def assert_same(found, expected):
    assert found.resolved() == expected.resolved()
    assert_same_scenario(found, expected)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("name", "other"),
        ("radar.constant", 200),
        ("radar.position_m", [1000, 0, -30]),
        ("radar.horizon", True),
        ("radar.detector", {"model": "swerling3", "pulses": 10}),
        ("geometry.azimuth_deg.step", 30),
        ("uncertainty.radar.medium.constant", 3),
        ("uncertainty.aircraft.attitude_deg", [1, 2, 3]),
        ("analysis.level", "high"),
        ("analysis.seed", 7),
    ],
)
def test_a_change_is_the_file_with_another_value(key, value):
    expected = parse_scenario(yaml_text(document(**{key.replace(".", "__"): value})), "paper.yaml")
    assert_same(rs.load_scenario(changes={key: value}), expected)
    assert_same(rs.load_scenario(changes={key: json.dumps(value)}), expected)
    assert_same(rs.load_scenario().with_keys({key: value}), expected)
    if not isinstance(value, str):  # a number or numbers of NumPy
        assert_same(rs.load_scenario(changes={key: np.array(value)}), expected)


def test_a_key_that_is_changed_again_has_its_last_value():
    """Also where another change has replaced the section in between."""
    section = {**document()["radar"], "constant": 1}
    before = rs.load_scenario(changes={"radar.constant": 2, "radar": section})
    assert before.radar[3] == 1
    assert before.with_keys({"radar.constant": 3}).radar[3] == 3


def test_places_of_lists_and_radars_by_name():
    text = yaml.load(NETWORK.read_text(), yaml.BaseLoader)
    names = [radar["name"] for radar in text["radars"]]
    changes = {f"radars.{names[1]}.p_fa": 1e-5, "radars[3].position_m[2]": 123}
    s = rs.load_scenario(NETWORK, changes)
    before = rs.load_scenario(NETWORK)
    assert s.model.models[1].p_fa == 1e-5
    assert s.model.models[0].p_fa == before.model.models[0].p_fa
    assert np.flatnonzero(s.radar != before.radar).tolist() == [9]
    assert s.radar[9] == 123


def test_an_alias_of_what_is_changed_stays():
    text = NETWORK.read_text()
    own = "uncertainty:\n      low:  {position_m: [20, 20, 10]"
    text = text.replace(own, own.replace("{", "&low {"), 1)
    text = text.replace("low:  {position_m: [200, 200, 10],    constant: 0.01}", "low:  *low")
    before = parse_scenario(text)
    s = parse_scenario(text, changes={"radars.ridge.uncertainty.low.constant": 3})
    ridge, mobile = (radar.levels["low"].covariance[3, 3] for radar in s.radars[1:])
    assert (ridge, mobile) == (9, before.radars[2].levels["low"].covariance[3, 3])


def test_no_text_takes_a_key_away():
    changes = {"radar.constant": "", "radar.tracking": json.dumps(TRACKING)}
    assert rs.load_scenario(changes=changes).radar[3] > 0
    with refused("paper.yaml:...: radar: missing key 'p_fa'"):
        rs.load_scenario(changes={"radar.p_fa": ""})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"radar.constant": -1}, "radar.constant=-1: radar.constant: must be a number "),
        ({"radar.constnt": 3}, "radar.constnt=3: radar: unknown key 'constnt', allowed: ..., "
         "tilt_deg, band, type; did you mean 'constant'?"),
        ({"rader.p_fa": 1}, "rader.p_fa=1: unknown key 'rader', allowed: ...mean 'radar'?"),
        ({"radar.p_fa": "[1"}, "radar.p_fa=[1: is not valid YAML"),
        ({"radar.p_fa.x": 1}, "radar.p_fa.x=1: '1.7e-4' has no key 'x'"),
        ({"radar.position_m[0]": 1}, "the list has no entry [0], it has [1], [2], [3]"),
        ({"radars": [{"name": [1]}], "radars[2].p_fa": 1}, "the list has no entry [2], it has [1]"),
        ({"radar.horizon": ""}, "radar.horizon=: there is no radar.horizon to take away"),
        *(({key: 1}, "write a key before the =")
          for key in ("", ".radar.p_fa", "radar.", "radar..p_fa", "radar.position_m[3")),
        ({"radar.tracking": {}}, "radar.tracking={}: radar.tracking: "),
    ],
)  # fmt: skip
def test_a_wrong_change_is_refused_in_one_line(changes, message):
    with refused(message):
        rs.load_scenario(changes=changes)


def test_keys_of_a_scenario_that_is_not_of_its_file_cannot_be_changed():
    paper = rs.load_scenario()
    for s in (paper.at_poses(slice(3)), paper.at_states(paper.aircraft[0])):
        with refused("keys can be changed only of a scenario of a file, and before at_poses"):
            s.with_keys({"radar.constant": 3})


def test_choices_and_the_radar_stay():
    s = rs.load_scenario(NETWORK).with_analysis(level="low", seed=5, runs=7, method="linear")
    changed = s.with_keys({"radars.ridge.p_fa": 1e-5})
    assert (changed.level, changed.seed, changed.runs, changed.method) == ("low", 5, 7, "linear")
    assert s.with_keys({"analysis.seed": 6}).seed == 6
    alone = for_radar(s, "ridge").with_keys({"radars.ridge.p_fa": 1e-5})
    assert alone.model.names == ("ridge",)
    assert alone.model.models[0].p_fa == 1e-5
