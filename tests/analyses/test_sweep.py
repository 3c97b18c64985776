"""`sweep`: what `variance` says of each value, in one table."""

import re
import time

import numpy as np
import pytest
from helpers import CONFIGS
from numpy.testing import assert_allclose

import radar_sense as rs
from radar_sense import analyses
from radar_sense.axis import steps
from radar_sense.errors import InputError

pytestmark = pytest.mark.usefixtures("quick")

CONFIG = CONFIGS / "radial.yaml"
VALUES = (100.0, 150.0, 200.0)
SWEPT = {"key": "radar.constant", "start": 100, "stop": 200, "step": 50}


@pytest.mark.parametrize(
    "options",
    [
        {"method": "linear", "threshold": 0.9},
        {"method": "form", "threshold": 0.9, "k": 2},
        {"method": "linear", "k": 2},
        {"method": "linear", "at_least": 0.3},
    ],
)
def test_each_row_is_what_variance_says_of_the_value(options):
    """With `at_least` the smallest P_D and the lower bound take the places of the others."""
    least, k = "at_least" in options, options.get("k", 3)
    extreme, of, end = (np.min, "lowest", "lower") if least else (np.max, "highest", "upper")
    found = analyses.sweep(rs.load_scenario(), **options, **SWEPT).table
    assert found["radar_constant"].tolist() == list(VALUES)
    for row, value in enumerate(VALUES):
        one = analyses.variance(rs.load_scenario(changes={"radar.constant": value}), **options)
        bound = one.table[f"{end}_{k}sigma"]
        pose = one.table["p_d"].tolist().index(extreme(one.table["p_d"]))
        assert found[f"{of}_p_d"][row] == one.table["p_d"][pose]
        for name in ("lower", "upper"):
            if f"{name}_{k}sigma" in one.table:  # with a threshold at another k there is one bound
                assert found[name][row] == one.table[f"{name}_{k}sigma"][pose]
        assert found[f"{of}_{end}"][row] == extreme(bound)
        assert found["largest_three_sigma"][row] == 3 * one.table["sigma_pd"].max()
        if "threshold" in one.summary:
            assert found["margin"][row] == one.summary["threshold"]["worst_margin"]["value"]
            assert found["violated"][row] == one.table["violated"].max()


def test_the_answer_of_a_threshold_is_where_it_holds():
    result = analyses.sweep(rs.load_scenario(), threshold=0.7, **SWEPT)
    heading = "P_D + 3 sigma <= 0.7 by radar.constant:"
    assert list(result.report[:2]) == [heading, "VIOLATED at all 3 values"]
    assert result.report[2].startswith("  100  P_D 0.8010, between ")
    above = result.table["probability_above"][0]
    assert 0.98 < above <= 1.0
    assert result.report[2].endswith("  violated")
    assert f", highest P(P_D > 0.7) {above:.4f} +/- " in result.report[2]
    assert not result.passed
    low = analyses.sweep(
        rs.load_scenario(), key="radar.constant", start=20, stop=200, step=90, threshold=0.9
    )
    assert low.passed
    assert low.table["violated"].tolist() == [0, 1, 1]
    assert low.summary["threshold"]["holds"] == [20.0]
    assert list(low.report[1:3]) == ["holds at 20", "VIOLATED at 110 to 200"]
    least = analyses.sweep(rs.load_scenario(), at_least=0.2, **SWEPT)
    heading = "P_D - 3 sigma >= 0.2 by radar.constant:"
    assert list(least.report[:3]) == [heading, "holds at 200", "VIOLATED at 100 to 150"]
    assert least.summary["threshold"] == {
        "p_min": 0.2, "k": 3.0, "holds": [200.0], "violated": [100.0, 150.0], "not_known": [],
    }  # fmt: skip
    assert least.passed
    asked = {"threshold": 0.9999999, "probability": 0.02}
    nearly = analyses.sweep(rs.load_scenario(), **asked, **SWEPT)
    assert nearly.report[0] == "P(P_D > 0.9999999) <= 0.02 by radar.constant:"
    assert nearly.summary["threshold"]["probability"] == 0.02


def test_a_value_that_is_implausible_is_warned_of_and_not_that_of_the_file():
    under = rs.load_scenario(changes={"geometry.down_km": 5})
    result = analyses.sweep(under, key="geometry.down_km", start=-3, stop=3, step=3)
    (text,) = (text for text in result.warnings if text.endswith("[below-ground]"))
    assert text.startswith("3 km: the aircraft is 3000 m below the origin")


@pytest.mark.parametrize(("key", "acts"), [("low", False), ("medium", True)])
def test_a_key_that_changes_nothing(key, acts):
    key = f"uncertainty.radar.{key}.constant"
    under = rs.load_scenario(None, {"geometry.azimuth_deg.step": 90})
    report = analyses.sweep(under, key=key, start=1, stop=9, step=4, method="linear").report
    assert (f"{key} changes none of these numbers at the level medium" in report) != acts


def test_a_key_that_changes_a_test_between_the_rows_alone(tmp_path):
    """At both rows of the flight the aircraft is out of range."""
    text = (CONFIGS / "path.yaml").read_text(encoding="utf-8")
    (tmp_path / "path_route.csv").write_text(
        "time_s,north_m,east_m,down_m\n0,-100000,10000,-3000\n1000,100000,10000,-3000\n"
    )
    errors = {"position_m": 10, "attitude_deg": 1}
    geometry = {"type": "path", "file": "path_route.csv"}
    changes = {"geometry": geometry, "uncertainty.aircraft": errors, "radar.max_range_km": 30}
    s = rs.parse_scenario(text, str(tmp_path / "s.yaml"), changes)
    result = analyses.sweep(
        s, key="radar.max_range_km", start=8, stop=16, step=8, threshold=0.6, method="form"
    )
    assert result.table["highest_p_d"].tolist() == [0, 0]
    assert list(result.report[1:3]) == ["holds at 8 km", "VIOLATED at 16 km"]
    assert not any("none of these numbers" in line for line in result.report)


def test_values_of_any_size_keep_their_digits():
    """Rounded to twelve places, 1.5e-14 would be 0."""
    for step in (1.5e-14, 0.1, 1.25e9):
        assert_allclose(steps(step, 3 * step, step, 3), [step, 2 * step, 3 * step], rtol=1e-15)
    assert steps(0.1, 0.4, 0.1, 4).tolist() == [0.1, 0.2, 0.3, 0.4]
    for tenths in range(1, 300):  # 0.3 − 0.2 is less than 0.1
        start = tenths / 10
        assert steps(start, (tenths + 1) / 10, 0.1, 2).tolist() == [start, (tenths + 1) / 10]
    for wrong in ((0, 1, 2), (0, 1, -0.1), (0, 1, 0), (1, 1, 0)):
        with pytest.raises(InputError, match="must be a step other than 0 that leads from"):
            steps(*wrong, 9)
    with pytest.raises(InputError, match="makes inf values, allowed are 10"):
        steps(0.0, 1e20, 1e-300, 10)


@pytest.mark.parametrize(
    ("key", "value", "unit", "label"),
    [
        ("radar.tracking.pulse_width_us", "0.6", "us", "radar.tracking.pulse_width [us]"),
        ("geometry.down_km", "-0.3", "km", "geometry.down [km]"),
        ("aircraft.rcs.rcs_m2", "0.01", "m^2", "aircraft.rcs.rcs [m^2]"),
        ("radar.attenuation_db_per_km", "0.01", "dB/km", "radar.attenuation [dB/km]"),
        ("radar.p_fa", "1e-6", "", "radar.p_fa"),
        ("radar.position_m[2]", "1000", "m", "radar.position[2] [m]"),
    ],
)
def test_units_are_plain_on_the_terminal_and_in_the_figure(tool, key, value, unit, label):
    few = ["--set", "geometry.range_km.step=20", "--no-plot"]
    code, out, _ = tool("sweep", CONFIG, key, value, value, "1", *few)
    assert code == 0
    assert out.isascii()
    assert f"{float(value):g} {unit}".strip() in out
    assert f"by {key} the largest P_D" in out
    s = rs.load_scenario(CONFIG, {"geometry.range_km.step": 20})
    end = float(value)
    result = analyses.sweep(s, key=key, start=end, stop=end, step=1, method="linear")
    assert result.plot().axes[0].get_xlabel() == label
    name, column = next(iter(result.columns.items()))
    assert name == re.sub(r"\W", "_", key).strip("_")
    assert column.unit == unit.replace("^2", "²").replace("us", "µs")


def test_the_figure_has_the_band_of_the_table():
    s = rs.load_scenario(changes={"geometry.azimuth_deg.step": 60})
    result = analyses.sweep(s, key="radar.constant", start=10, stop=40, step=10)
    assert np.all(result.table["lower"] < result.table["highest_p_d"] - 1e-3)
    (axes,) = result.plot().axes
    drawn = [line.get_ydata() for line in axes.lines]
    for name in ("highest_p_d", "lower", "upper"):
        column = result.table[name]
        assert any(len(y) == len(column) and np.allclose(y, column) for y in drawn), name
    assert "its band of $3\\,\\sigma$" in axes.get_legend_handles_labels()[1]


def test_a_long_sweep_says_so_after_its_first_value(monkeypatch, caplog):
    caplog.set_level("WARNING", "radar_sense")
    clock = iter([0.0, 6.0])
    monkeypatch.setattr(time, "process_time", lambda: next(clock))
    analyses.sweep(rs.load_scenario(), **SWEPT)
    assert caplog.messages == [
        "the values after the first, if they are like it, take some 12 seconds; "
        "fewer values take less"
    ]


def test_of_poses_with_the_same_p_d_the_widest_band_counts():
    """A sphere on a circle around the radar, whose place is known better in one direction."""
    sphere = {"model": "constant", "rcs_m2": 0.1}
    known = {"position_m": [8000, 10, 10], "constant": 0}
    changes = {"aircraft.rcs": sphere, "uncertainty.radar": {"medium": known}}
    s = rs.load_scenario(
        changes={**changes, "geometry.azimuth_deg": "{start: 0, stop: 90, step: 30}"}
    )
    table = analyses.variance(s).table
    width = table["upper_3sigma"] - table["lower_3sigma"]
    assert np.ptp(table["p_d"]) < 1e-12
    assert np.ptp(width) > 0.04
    found = analyses.sweep(s, key="radar.constant", start=167, stop=200, step=33).table
    assert found["upper"][0] - found["lower"][0] == width.max()
