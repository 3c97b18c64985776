"""Radars that integrate: commands, and `detectors` of two radars."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers import yaml_text
from numpy.testing import assert_allclose

import radar_sense as rs

pytestmark = pytest.mark.usefixtures("quick")

ROOT = Path(__file__).parents[2]
CELLS = {"type": "cell_averaging", "cells": 24}
DETECTOR = {"model": "swerling2", "pulses": 10, "cfar": CELLS}


@pytest.mark.parametrize("detector", ["north", "swerling1", DETECTOR])
def test_a_detector_that_radars_share_is_compared_once(detector):
    content = yaml.safe_load((ROOT / "configs/network.yaml").read_text(encoding="utf-8"))
    for radar in content["radars"]:
        radar |= {"p_fa": 1e-6, "detector": detector}
    s = rs.parse_scenario(yaml_text(content)).at_poses(slice(0, 1))
    rows = rs.analyses.detectors(s).summary["required_snr"]
    compared = [(row["detector"], row["p_d"]) for row in rows]
    assert len(compared) == len(set(compared))


def test_detectors_of_two_radars():
    """The first radar integrates. The second has a P_fa at which North's approximation is low."""
    content = yaml.safe_load((ROOT / "configs/network.yaml").read_text(encoding="utf-8"))
    content["radars"] = content["radars"][:2]
    content["radars"][0] |= {"p_fa": 1e-6, "detector": DETECTOR}
    content["radars"][1] |= {"p_fa": 0.2, "detector": "north"}
    s = rs.parse_scenario(yaml_text(content)).at_poses(slice(0, None, 40))
    result = rs.analyses.detectors(s)
    table, summary = result.table, result.summary
    # the error of North's approximation is the largest over the radars
    snr = s.model.snr(s.aircraft, s.radar).T
    errors = [
        abs(rs.North().p_d(of_radar, p_fa) - rs.Marcum().p_d(of_radar, p_fa))
        for of_radar, p_fa in zip(snr, (1e-6, 0.2), strict=True)
    ]
    assert summary["error_of_north_at_poses"]["value"] == np.max(errors)
    assert np.max(errors[0]) != np.max(errors[1])
    for worst in summary["largest_error_of_north"]:
        error = table["north_less_marcum"][table["p_fa"] == worst["p_fa"]]
        assert worst["error"] == error[np.argmax(abs(error))]
        assert (worst["error"] < 0) == (worst["p_fa"] == 0.2)
    steady = [row for row in summary["required_snr"] if row["detector"] == "swerling1"]
    p_fas = {row["p_fa"] for row in steady}
    closed = {(f, p): math.log(f) / math.log(p) - 1 for f in p_fas for p in (0.5, 0.9)}
    found = {(row["p_fa"], row["p_d"]): 10 ** (row["snr_db"] / 10) for row in steady}
    assert found == pytest.approx(closed, rel=1e-9)
    # a detector of a radar is shown for the P_fa of the radar
    rows = [row for row in summary["required_snr"] if "cell_averaging" in row["detector"]]
    assert [row["p_fa"] for row in rows] == [1e-6, 1e-6]
    assert any("swerling2, 10 pulses, cell_averaging 24 " in line for line in result.report)
    detector = s.model.models[0].detector
    for row in rows:
        ends = [detector.p_d(10 ** ((row["snr_db"] + db) / 10), 1e-6) for db in (-1e-4, 0, 1e-4)]
        assert ends[1] == pytest.approx(row["p_d"], abs=1e-9)
        assert row["dp_d_per_db"] == pytest.approx((ends[2] - ends[0]) / 2e-4, rel=1e-5)
    for p_fa in (1e-6, 0.2):
        at = table["p_fa"] == p_fa
        for pulses in (1, 10, 100):
            slope = np.gradient(table[f"p_d_swerling2_{pulses}"][at], table["snr_db"][at])
            found = table[f"dp_d_per_db_swerling2_{pulses}"][at]
            assert_allclose(found[1:-1], slope[1:-1], rtol=0, atol=3e-3 * slope.max())
