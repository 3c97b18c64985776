"""A radar that detects nothing within a minimum range, by every method, in missions and on maps."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import (
    TRACKING,
    assert_same_scenario,
    network_document,
    place,
    radar_entry,
    refusal,
    yaml_text,
)
from numpy.testing import assert_allclose, assert_array_equal

import radar_sense as rs
from radar_sense.model.network import NetworkModel
from radar_sense.model.radar import Radar
from radar_sense.model.rcs import ConstantRCS

MODEL = rs.DetectionModel(ConstantRCS(0.1), 1e-6, rs.Marcum())
#: c · 11 µs / 2.
BLIND = 299_792_458 * 11e-6 / 2


def several(**changes):
    """Document of the paper's aircraft, 4 km from a radar with a pulse, in a list of one."""
    entry = {
        "position_m": [0, 0, 0],
        "constant": None,
        "tracking": {**TRACKING, "pulse_width_us": 11},
        "p_fa": 1e-6,
        "uncertainty": {"low": {"position_m": 10, "constant": 1e-7}},
        **changes,
    }
    content = network_document(radar_entry("near", **entry))
    content["geometry"] |= {"range_km": 4, "azimuth_deg": {"start": 0, "stop": 90, "step": 45}}
    return content


def test_nothing_is_seen_within_the_minimum_range():
    radar = Radar(MODEL, min_range=5e3, max_range=6e3)
    aircraft = np.zeros((5, 6))
    aircraft[:, 0] = 3e3  # slant ranges 5 km, less, more, 6 km and more
    aircraft[:, 2] = [-4e3, -4e3 + 1e-6, -4e3 - 1e-6, -np.sqrt(27e6) + 1e-6, -np.sqrt(27e6) - 1e-6]
    state = np.array([0.0, 0, 0, 1.3e-6])
    seen = [True, False, True, True, False]
    assert_array_equal(radar.visible(aircraft, state), seen)
    network = NetworkModel((radar,))
    assert_array_equal(network.p_d(aircraft, state), MODEL.p_d(aircraft, state) * seen)
    for part in (network.linearize(aircraft, state).jac_radar, network.snr(aircraft, state)):
        assert_array_equal(np.any(part != 0, axis=-1), seen)


def test_the_keys_are_read_and_read_back():
    for changes, expected in (
        ({}, 0.0),  # a pulse width alone hides nothing
        ({"eclipsing": False}, 0.0),
        ({"eclipsing": True}, BLIND),
        ({"eclipsing": True, "min_range_km": 1.5}, BLIND),
        ({"eclipsing": True, "min_range_km": 2.5}, 2500.0),
        ({"min_range_km": 2.5, "max_range_km": 3}, 2500.0),
    ):
        scenario = rs.parse_scenario(yaml_text(several(**changes)))
        (radar,) = scenario.model.radars
        assert_allclose(radar.min_range, expected, rtol=1e-15)
        again = rs.parse_scenario(yaml_text(scenario.resolved()))
        assert_same_scenario(again, scenario)
        entry = scenario.resolved()["radars"][0]
        assert {key: entry.get(key, False) for key in changes} == changes


@pytest.mark.parametrize(
    ("changes", "path", "complaint"),
    [
        ({"min_range_km": 5, "max_range_km": 5}, "min_range_km", "must be less than max_range_km"),
        ({"eclipsing": True, "max_range_km": 1}, "eclipsing", "within 1.64886 km, must be less"),
        ({"eclipsing": True, "tracking": None, "constant": 1}, "eclipsing", "pulse_width_us"),
    ],
)
def test_refusals_name_the_key(tool, changes, path, complaint):
    line, key, message = place(refusal(tool, yaml_text(several(**changes))))
    assert line
    assert key == f"radars[1].{path}"
    assert complaint in message


def test_the_class_refuses_what_the_reader_refuses():
    for wrong in ({"min_range": -1}, {"min_range": np.nan}, {"min_range": 5, "max_range": 5}):
        with pytest.raises(ValueError, match="min_range must be"):
            Radar(MODEL, **wrong)
