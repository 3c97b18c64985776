"""Radars that integrate work in every analysis, by every method, in networks and missions."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers import (
    document,
    scenario,
    with_arrays,
    yaml_text,
)
from numpy.testing import assert_allclose, assert_array_equal

import radar_sense as rs
from radar_sense.montecarlo.montecarlo import TAIL, monte_carlo

pytestmark = pytest.mark.usefixtures("quick")

ROOT = Path(__file__).parents[2]
#: Detectors and the c_r with which P_D is neither 0 nor 1 on the paper's orbit.
CASES = [
    ({"model": "marcum", "pulses": 10}, 30.0),
    ({"model": "swerling2", "pulses": 10, "cfar": {"type": "cell_averaging", "cells": 24}}, 40.0),
    ({"model": "swerling1", "cfar": {"type": "ordered_statistics", "cells": 24, "rank": 18}}, 2e2),
    ({"model": "swerling4", "pulses": 3, "binary": {"m": 2, "n": 4}}, 40.0),
]  # fmt: skip


def integrating(detector, constant, **changes):
    level = {"wide": {"position_m": 1000, "constant": constant / 16}}
    return scenario(
        radar__detector=detector,
        radar__constant=constant,
        uncertainty__radar=level,
        analysis__level="wide",
        **changes,
    )


@pytest.mark.parametrize(("detector", "constant"), CASES)
def test_band_by_form_holds_the_draws(detector, constant):
    s = integrating(detector, constant, geometry__azimuth_deg={"start": 0, "stop": 90, "step": 15})
    mc = monte_carlo(s, runs=20_000, method="form")
    assert 0.02 < mc.mean.min() < mc.mean.max() < 0.999
    assert (abs(mc.mean - mc.band.mean) < 4.5 * mc.std / np.sqrt(mc.runs)).all()
    assert_allclose(mc.std, mc.band.std, rtol=0.035)
    low, high = mc.coverage_interval(1 - 1e-4)
    assert (low < 1 - 2 * TAIL).all()
    assert (high > 1 - 2 * TAIL).all()


@pytest.mark.parametrize(("detector", "constant"), CASES[:2])
def test_gradient_of_the_model(detector, constant):
    """Against a central difference of P_D itself."""
    s = integrating(detector, constant, geometry__azimuth_deg={"start": 30, "stop": 60, "step": 15})
    lin = s.model.linearize(s.aircraft, s.radar)
    for i, step in enumerate((1.0, 1.0, 1.0, 1e-5, 1e-5, 1e-5)):
        ahead, behind = (s.model.p_d(s.aircraft + h * np.eye(6)[i], s.radar) for h in (step, -step))
        slope = (ahead - behind) / (2 * step)
        assert_allclose(lin.jac_aircraft[:, i], slope, rtol=1e-4, atol=1e-9 * abs(slope).max())
    stronger = np.array([0, 0, 0, 1e-4])
    ahead, behind = (s.model.p_d(s.aircraft, s.radar + h) for h in (stronger, -stronger))
    assert_allclose(lin.jac_radar[:, 3], (ahead - behind) / 2e-4, rtol=1e-7)


@pytest.mark.parametrize(
    "command",
    ["budget --method form", "compare --runs 64", "map --step-km 200 --upper --method form"],
)  # fmt: skip
def test_every_command(tool, command):
    text = yaml_text(
        document(
            radar__detector=CASES[1][0],
            radar__constant=40,
            geometry__azimuth_deg={"start": 40, "stop": 60, "step": 20},
        )
    )
    Path("my.yaml").write_text(text, encoding="utf-8")
    code, _, err = tool(*command.split(), "my.yaml", "--no-plot", "--out", "out")
    assert code == 0, err


def test_detectors_of_two_radars():
    """The first radar integrates. The second has a P_fa at which North's approximation is low."""
    content = yaml.safe_load((ROOT / "configs/network.yaml").read_text(encoding="utf-8"))
    content["radars"] = content["radars"][:2]
    content["radars"][0] |= {"p_fa": 1e-6, "detector": CASES[1][0]}
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


def test_a_network():
    """If one radar of a network integrates, only its P_D changes."""
    plain = rs.load_scenario(ROOT / "configs/network.yaml").at_poses(slice(0, None, 40))
    radars = list(plain.model.radars)
    model = radars[0].model
    ten = rs.DetectionModel(model.rcs, model.p_fa, rs.Swerling2(pulses=10))
    radars[0] = dataclasses.replace(radars[0], model=ten)
    other = with_arrays(plain, model=rs.NetworkModel(tuple(radars)))
    before, after = (rs.analyses.variance(s, method="form").table for s in (plain, other))
    names = plain.model.names
    for name in names[1:]:
        assert_array_equal(after[f"p_d_{name}"], before[f"p_d_{name}"])
    snr = plain.model.snr(plain.aircraft, plain.radar)[:, 0]
    seen = radars[0].visible(plain.aircraft, plain.radar[:4])
    expected = np.where(seen, rs.Swerling2(pulses=10).p_d(snr, model.p_fa), 0.0)
    assert_allclose(after[f"p_d_{names[0]}"], expected, rtol=1e-12)
    missed = 1 - expected
    for name in names[1:]:
        missed = missed * (1 - after[f"p_d_{name}"])
    assert_allclose(after["p_d"], 1 - missed, rtol=1e-9, atol=1e-12)
