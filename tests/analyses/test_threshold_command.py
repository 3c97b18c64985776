"""`variance --threshold`: columns, report, record and refused options."""

import re
from pathlib import Path

import numpy as np
import pytest
from helpers import cov_by_level, lay_out, read_record, read_table, scenario, write_path
from routes import POSE_HEAD, UNCERTAIN
from scipy.special import erfc

import radar_sense as rs

PLACES = ["north_m", "east_m", "down_m"]
ERROR = "error_3sigma"  # the last column, where bounds are by draws


def write(folder, text=UNCERTAIN, **changes):
    return write_path(folder, text, "my.yaml", **{"name": "flight", **changes})


@pytest.mark.parametrize(("method", "k"), [("linear", 2), ("montecarlo", 3), ("automatic", 0.5)])
def test_threshold_columns(tool, method, k):
    args = ["variance", write(Path()), "--method", method, "--no-plot"]
    assert tool(*args).code == 0
    before = read_table("figures/flight_variance.csv")
    assert tool(*args, "--threshold", 0.5, "--k", k).code == 3
    found = read_table("figures/flight_variance.csv")
    bound = f"upper_{k:g}sigma"
    extra = ["margin", "violated", "not_known", "probability_above"]
    names = [name for name in before if name not in (*PLACES, ERROR)]
    last = [*PLACES, ERROR] if ERROR in before else PLACES
    assert list(found) == [*names, *([] if k == 3 else [bound]), *extra, *last]
    for column, values in before.items():
        np.testing.assert_array_equal(found[column], values)
    s = rs.load_scenario("my.yaml")
    given = s.model, s.aircraft, s.radar, s.cov_aircraft, cov_by_level(s)["medium"]
    moments = rs.propagate(*given, method=method, beta=k)
    np.testing.assert_allclose(found[bound], moments.upper, rtol=1e-13)
    if method == "linear":
        assert found[bound] == pytest.approx(found["p_d"] + k * found["sigma_pd"], rel=1e-12)
    np.testing.assert_array_equal(found["margin"], 0.5 - found[bound])
    known = found["not_known"] == 0
    expected = np.where(known, found[bound] > 0.5, found["p_d"] > 0.5)
    np.testing.assert_array_equal(found["violated"], expected)
    tail = 0.5 * erfc(k / np.sqrt(2))
    np.testing.assert_array_equal(found["probability_above"] > tail, found[bound] > 0.5)


def test_threshold_report_and_record(tool):
    filled = {"step_s": 5}  # the table then has all poses of the test but a few
    file = write(Path(), geometry__axis="distance", geometry__interpolate=filled)
    assert tool("variance", file, "--no-plot", "--method", "form").code == 0
    upper = read_table("figures/flight_variance.csv")["upper_3sigma"]
    p_max = 0.5 * (np.sort(upper)[140] + np.sort(upper)[141])
    code, out, _ = tool("variance", file, "--threshold", p_max, "--method", "form", "--no-plot")
    assert code == 3
    found = read_table("figures/flight_variance.csv")
    test = read_record("figures/flight_variance.json")["summary"]["threshold"]
    # time, though the table is laid out along the distance
    dense, times = np.linspace(100, 1500, 200_001), np.arange(100, 1501, 5)
    above = np.interp(dense, times, upper) > p_max
    share = np.mean(above)
    assert test["share_above"] == pytest.approx(share, abs=1e-4)
    assert test["above_s"] == pytest.approx(1400 * share, abs=0.1)
    assert test["total_s"] == 1400
    assert found["violated"].sum() == 140
    assert 140 <= test["poses_violated"] <= 140 + test["poses_between_rows"] < 150
    first = int(np.argmax(found["violated"]))
    assert test["first_violation"] == {"distance_m": found["distance_m"][first]}
    likely = int(np.argmax(found["probability_above"]))
    assert likely > 0
    share_of_runs = found["probability_above"][likely]
    assert share_of_runs * test["runs"] == pytest.approx(round(share_of_runs * test["runs"]))
    highest = test["highest_probability_above"]
    assert 0 < highest.pop("standard_error") < 0.01
    assert highest == {"value": share_of_runs, "distance_m": found["distance_m"][likely]}
    worst = int(np.argmin(found["margin"]))
    assert test["worst_margin"]["value"] == found["margin"][worst]
    assert (test["passed"], test["k"], test["p_max"]) == (False, 3, p_max)
    assert out.startswith("VIOLATED at ")
    assert f"method: form, checked by draws at {test['poses']} poses" in out
    passed = np.interp(dense[np.argmax(above)], times, found["distance_m"])
    assert f"of 1400 s ({share:.1%})\n" in out
    start = float(re.match(r"VIOLATED at (\d+) to ", out)[1])
    assert start == pytest.approx(passed, abs=10)
    clear = min(1, upper.max() + 0.05)
    code, out, _ = tool("variance", file, "--threshold", clear, "--method", "form", "--no-plot")
    assert code == 0
    assert out.startswith("holds at every pose")
    assert "for about" not in out
    test = read_record("figures/flight_variance.json")["summary"]["threshold"]
    assert (test["passed"], test["above_s"], test["first_violation"]) == (True, 0, None)


@pytest.mark.parametrize(("p_max", "share"), [(0.1, 1.0), (0.99, 0.0)])
def test_a_single_pose_is_above_as_a_whole_or_not_at_all(p_max, share):
    one = scenario(geometry__azimuth_deg={"start": 45, "stop": 45, "step": 1})
    found = rs.analyses.variance(one, threshold=p_max).summary["threshold"]
    assert (found["share_above"], found["total_poses"]) == (share, 1)


def test_a_path_with_times_needs_a_correlation(tmp_path):
    s = rs.load_scenario(write(tmp_path))
    report = rs.analyses.variance(s, threshold=0.5, method="form").report
    key = "uncertainty.aircraft_correlation_s (in Python Scenario.correlation_s)"
    assert f"P at some pose needs {key}" in report


def test_no_bound_is_not_known(tool):
    over = f"{POSE_HEAD}\n0,1000,0,-3e5,0,0,0\n10,0,0,-3e5,0,0,0\n20,-1000,0,-3e5,0,0,0\n"
    code, out, err = tool("variance", write(Path(), over), "--threshold", 1, "--method", "probit")
    assert code == 3
    assert out.startswith("NOT KNOWN at 10 s: ")
    assert "probit has no value" in err
    test = read_record("figures/flight_variance.json")["summary"]["threshold"]
    assert (test["poses_without_bound"], test["poses_not_known"] >= 1) == (1, True)
    assert test["verdict"] == "not known"
    assert test["worst_margin"] == {"value": None, "time_s": 10}
    assert (test["above_s"], test["share_above"], test["first_violation"]) == (None, None, None)


def test_a_probability_in_place_of_k():
    """The verdict of a bound at Φ⁻¹(1 − P); draws confirm it in `tests/acceptance`."""
    s = scenario(geometry__azimuth_deg={"start": 0, "stop": 60, "step": 20})
    result = rs.analyses.variance(s, threshold=0.6, probability=0.05, method="automatic")
    assert result.report[0].endswith(": P(P_D > 0.6) <= 0.05")
    assert result.summary["threshold"]["probability"] == 0.05
    by_k = rs.analyses.variance(s, threshold=0.6, k=1.6448536269514722, method="automatic")
    assert by_k.summary["threshold"]["verdict"] == result.summary["threshold"]["verdict"]
    for column in ("margin", "violated"):
        np.testing.assert_allclose(by_k.table[column], result.table[column], atol=1e-12)


def test_the_threshold_is_drawn():
    some = rs.load_scenario().at_poses(slice(0, None, 20))
    result = rs.analyses.variance(some, threshold=0.5, k=2, method="linear")
    (axes,) = lay_out(result.plot()).axes
    labels = axes.get_legend_handles_labels()[1]
    assert labels.count("violated") == 1
    assert "threshold 0.5" in labels
    assert len(labels) == 4  # the band is that of k
    (shade,) = (part for part in axes.collections if part.get_label() == "violated")
    azimuth, violated = result.table["theta_r_deg"], result.table["violated"] > 0
    shaded = np.zeros(len(azimuth), dtype=bool)
    for left, right in (path.get_extents().intervalx for path in shade.get_paths()):
        shaded |= (azimuth >= left) & (azimuth <= right)
        assert all(end in (0, 180) or end % 10 == 5 for end in (left, right))  # half way
    np.testing.assert_array_equal(shaded, violated)
    assert 0 < violated.sum() < len(violated)


def test_states_given_in_python_are_counted():
    """There is nothing between poses without a flight, in any order."""
    s = scenario(analysis__method="linear")
    s = s.at_states(s.aircraft[[0, 180, 10, 170]])
    found = rs.analyses.variance(s, threshold=0.5)
    np.testing.assert_array_equal(found.table["violated"], [0, 1, 0, 1])
    assert found.report[0].startswith("VIOLATED at pose 1, 3: ")
    assert "the bound is above 0.5 at 2 of 4 poses (50.0%)" in found.report
    assert any(x.startswith("P_D itself is above 0.5 at pose 1, 3: ") for x in found.report)
    threshold = found.summary["threshold"]
    numbers = {"above_poses": 2.0, "total_poses": 4.0, "share_above": 0.5}
    assert {name: threshold[name] for name in numbers} == numbers
    assert "at_pose" in rs.analyses.budget(s, target=0.05, at=1).summary["target"]
