"""Missions of one radar: keys, looks, numbers against draws, and the report."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from helpers import few_draws, mission, read_back, read_record, read_table, write_path
from routes import POSE_HEAD, UNCERTAIN

import radar_sense as rs
from radar_sense.errors import InputError
from radar_sense.mission.looks import Looks
from radar_sense.propagation import propagate_scenario
from radar_sense.words import probability

#: Without errors of the poses.
ROUTE = "\n".join(",".join(row.split(",")[:7]) for row in UNCERTAIN.splitlines())


@pytest.fixture(autouse=True)
def _few_draws(monkeypatch):
    few_draws(monkeypatch)


def write(folder, text=ROUTE, **changes):
    usual = {"name": "flight", **({} if "radar" in changes else {"radar__scan_period_s": 400})}
    return write_path(folder, text, "my.yaml", **{**usual, **changes})


def load(folder, text=ROUTE, **changes):
    return rs.load_scenario(write(folder, text, **changes))


@pytest.mark.parametrize(
    ("given", "value"),
    [(0, 0.0), (12.5, 12.5), (math.inf, math.inf), (".inf", math.inf), ("inf", math.inf)],
)
def test_keys_are_read_and_read_back(tmp_path, given, value):
    s = load(tmp_path, UNCERTAIN, uncertainty__aircraft_correlation_s=given, radar__scan_period_s=4)
    assert (s.correlation_s, s.model.radars[0].scan_period) == (value, 4.0)
    read_back(s)
    assert json.dumps(s.resolved(), allow_nan=False)


def test_defaults(tmp_path):
    s = load(tmp_path, radar__scan_period_s=3)
    assert (s.correlation_s, s.model.radars[0].scan_period) == (0.0, 3.0)
    assert "aircraft_correlation_s" not in s.resolved()["uncertainty"]
    np.testing.assert_array_equal(s.time_s, [100, 500, 1000, 1500])
    np.testing.assert_array_equal(s.at_poses(slice(1, 3)).time_s, [500, 1000])
    orbit = rs.load_scenario()
    assert (orbit.correlation_s, orbit.model.radars[0].scan_period) == (0.0, None)
    assert orbit.time_s is orbit.at_poses(slice(3)).time_s is None


def test_without_a_scan_period_a_mission_is_refused(tool):
    """Without a period P_c would depend on the number of rows of the route."""
    file = write_path(Path(), ROUTE, "my.yaml")
    code, out, err = tool("mission", file)
    assert (code, out) == (2, "")
    assert err == (
        "Error: a mission needs a scan_period_s, the time [s] from one look to the next: "
        "add scan_period_s to radar, such as scan_period_s: 10, in Python Radar(scan_period=10)\n"
    )
    assert not Path("figures").exists()


@pytest.mark.parametrize("text", [ROUTE, UNCERTAIN])
def test_looks_of_a_scan(tmp_path, text):
    s = load(tmp_path, text, radar__scan_period_s=150)
    looks = Looks.of(s).scenario
    time = 100 + 150.0 * np.arange(10)
    np.testing.assert_array_equal(looks.axis.values, time)
    np.testing.assert_array_equal(looks.time_s, time)
    assert looks.resolved() == s.resolved()
    for i in range(3):
        expected = np.interp(time, s.time_s, s.aircraft[:, i])
        np.testing.assert_allclose(looks.aircraft[:, i], expected, rtol=1e-13, atol=1e-7)
    # roll and pitch are small, so yaw is nearly linear in time, through 180 degrees
    yaw = np.interp(time, s.time_s, [80, 170, 190, 240])
    off = (np.rad2deg(looks.aircraft[:, 5]) - yaw + 180) % 360 - 180
    assert np.max(abs(off)) < 0.05
    np.testing.assert_allclose(looks.aircraft[[0], 3:], s.aircraft[[0], 3:], atol=1e-12)
    if text is ROUTE:
        np.testing.assert_array_equal(looks.cov_aircraft, s.cov_aircraft)
        return
    for i in range(6):
        expected = np.interp(time, s.time_s, s.cov_aircraft[:, i, i])
        np.testing.assert_allclose(looks.cov_aircraft[:, i, i], expected, rtol=1e-12)


def test_a_scan_longer_than_the_path_is_one_look(tmp_path):
    found = mission(load(tmp_path, radar__scan_period_s=1e5))
    one = propagate_scenario(load(tmp_path), method="form")
    assert found.table["time_s"] == [100]
    assert found.table["cumulative_p_d"] == pytest.approx(one.p_d[:1], rel=1e-12)
    assert found.table["upper_3sigma"] == pytest.approx(one.upper[:1], rel=0.05)
    assert found.table["sigma_cumulative"] == pytest.approx(one.std[:1], rel=0.1)


def test_refusals(tmp_path):
    s = load(tmp_path)
    over = f"{POSE_HEAD}\n0,1000,0,0,0,0,180\n20,-1000,0,0,0,0,180\n"
    for words, of, options in (
        ("m must be a whole number", s, {"m_of_n": (0, 3)}),
        ("n must be a whole number", s, {"m_of_n": (1, 13)}),
        ("'track' and 'm' exclude each other", s, {"m_of_n": (2, 3), "track": (2, 3)}),
        ("track must be 2 values", s, {"track": (2, 3, 4)}),
        ("radar.scan_period_s makes more than", load(tmp_path, radar__scan_period_s=1e-4), {}),
        ("on top of the radar at the look at 10 s",
         load(tmp_path, over, radar__scan_period_s=5), {}),
    ):  # fmt: skip
        with pytest.raises(InputError) as error:
            mission(of, **options)
        assert words in str(error.value)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(("track", "runs"), [(None, None), ((2, 3), 50)])
def test_columns(tmp_path, track, runs):
    s = load(tmp_path, UNCERTAIN)
    found = mission(s, m_of_n=track, runs=runs)
    bounds = ["lower_3sigma", "upper_3sigma"]
    drawn = ["mc_mean", "mc_std", "mc_lower", "mc_upper"] if runs else []
    expected = ["time_s", "p_d", "cumulative_p_d", "sigma_cumulative", *bounds, *drawn]
    expected += ["mean_cumulative"]
    if track:
        of_track = (f"track_{name}" for name in (*bounds, *drawn))
        expected += ["track_p_d", "sigma_track", *of_track, "mean_track"]
    events = ("", "track_") if track else ("",)
    expected += [f"{event}{bound}_se" for event in events for bound in bounds]
    expected += ["mean_cumulative_se", *(["mean_track_se"] if track else [])]
    assert list(found.table) == expected
    if track:  # also as a pair
        pair = rs.analyses.mission(s, track=track, runs=runs).table
        for name, column in found.table.items():
            np.testing.assert_array_equal(pair[name], column)
    cumulated = 1 - np.cumprod(1 - found.table["p_d"])
    assert found.table["cumulative_p_d"] == pytest.approx(cumulated, rel=1e-12)
    assert found.summary["looks"] == len(cumulated) == 4
    assert (found.summary["monte_carlo"] is None) == (runs is None)
    assert ("track" in found.summary) == (track is not None)


def test_report(tmp_path):
    """At the end of the mission: the table, the record and the words have the same numbers."""
    keys = {"radar__scan_period_s": 10, "uncertainty__aircraft_correlation_s": 60}
    # with seed 13 the draws have the larger σ
    s = load(tmp_path, radar__constant=14, **keys).with_analysis(seed=13)
    result = mission(s, m_of_n=(3, 5), runs=100)
    found, summary, out = result.table, result.summary, "\n".join(result.report)
    assert "141 looks, 100 to 1500 s, every 10 s; pose errors correlated over 60 s" in out
    assert out.startswith("detection by 1500 s: ")
    out = re.sub(r" \+/- [\d.]+(?= and | \(3 sigma)", "", out)  # of a bound
    for event, name, before, p, stem in (
        ("detection", "detection", "", "cumulative_p_d", "cumulative"),
        ("track", "track, 3 of 5", "track_", "track_p_d", "track"),
    ):
        bounds = {f"{end}_3sigma": found[f"{before}{end}_3sigma"] for end in ("lower", "upper")}
        columns = {
            **{"p": found[p], "mean": found[f"mean_{stem}"], "mean_se": found[f"mean_{stem}_se"]},
            **{"sigma": found[f"sigma_{stem}"], **bounds},
        }
        at_end = {key: column[-1] for key, column in columns.items()}
        assert summary[event]["at_end"] == at_end
        value, mean, lower, upper = (probability(at_end[key]) for key in ("p", "mean", *bounds))
        error = at_end["mean_se"]
        mean += f" +/- {error:.1g}" if error >= 5e-5 else ""
        assert (
            f"{name} by 1500 s: {value} at the nominal states, {mean} on average, between {lower} "
            f"and {upper} (3 sigma, medium)\n"
        ) in out
        error = summary["largest_standard_error_of_bounds"][event]["value"]
        assert error == max(found[f"{before}{end}_se"].max() for end in bounds)
        assert f"{event} {error:.4f} at" in out[out.index("largest standard error of a bound") :]
        off = [bounds[f"{end}_3sigma"] - found[f"{before}mc_{end}"] for end in ("lower", "upper")]
        largest = summary["monte_carlo"]["largest_difference"][event]
        assert largest["bounds"]["value"] == np.max(np.abs(off))
        assert largest["sigma"]["value"] == max(abs(columns["sigma"] - found[f"{before}mc_std"]))
    for level, times in summary["detection"]["reaches"].items():
        ends = {
            "time_s": "cumulative_p_d",
            "earliest_s": "upper_3sigma",
            "latest_s": "lower_3sigma",
        }
        for key, column in ends.items():
            above = found["time_s"][found[column] >= float(level)]
            assert times[key] == (above.min() if len(above) else None)
    half = summary["detection"]["reaches"]["0.5"]["time_s"]
    assert f"  reaches 0.5 at {half:.13g} s, between " in out
    assert "largest difference from 100 plain runs (seed 13), with their noise:" in out
    for words, changes in (
        ("never reaches 0.5, nor does its upper bound", {"radar__constant": 0.01}),
        ("the same at every look", {"uncertainty__aircraft_correlation_s": math.inf}),
    ):
        assert words in "\n".join(mission(load(tmp_path, **changes)).report)


def test_constants_set_to_zero_are_warned_of(tool):
    levels = {"wild": {"position_m": 1, "constant": 40}}  # of 50: one in ten is below zero
    file = write(Path(), uncertainty__radar=levels, analysis={"level": "wild"})
    code, _, err = tool("mission", file, "--runs", 500, "--no-plot")
    assert code == 0
    drawn = read_record("figures/flight_mission.json")["summary"]["monte_carlo"]
    assert 25 < drawn["radar_constants_set_to_zero"] < 90
    assert "so it counts as 0 in 10.6% of the cases" in err


def test_a_flight_straight_above_a_radar_has_bounds(tool):
    """There the gradient of P_D is undefined, and draws take none."""
    over = f"{POSE_HEAD}\n0,1000,0,-9e4,0,0,0\n10,0,0,-9e4,0,0,0\n20,-1000,0,-9e4,0,0,0\n"
    assert tool("mission", write(Path(), over, radar__scan_period_s=10), "--no-plot").err == ""
    found = read_table("figures/flight_mission.csv")
    assert all(np.isfinite(column).all() for column in found.values())


@pytest.mark.parametrize("step", [300, 1e4])
@pytest.mark.parametrize("method", ["legs", "smooth"])
@pytest.mark.parametrize("columns", [4, 13])
def test_looks_are_on_the_route_of_the_file_at_any_step(columns, method, step, tmp_path):
    """The route turns. Looks every 10 s are at the poses of a step of 10 s, whatever the step."""
    header, *rows = UNCERTAIN.splitlines()
    text = "\n".join(",".join(row.split(",")[:columns]) for row in (header, *rows))
    fine, coarse = (
        load(tmp_path, text, radar__scan_period_s=10,
             geometry__interpolate={"step_s": step_s, "method": method})
        for step_s in (10, step)
    )  # fmt: skip
    looks = Looks.of(coarse).scenario
    assert len(coarse.aircraft) <= 6
    np.testing.assert_allclose(looks.aircraft, fine.aircraft, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(looks.cov_aircraft, fine.cov_aircraft, rtol=1e-12, atol=1e-9)
