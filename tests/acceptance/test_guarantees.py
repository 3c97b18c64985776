"""What a verdict promises: its probabilities are one set, and nothing hides between rows."""

import math
from pathlib import Path

import numpy as np
import pytest
from helpers import csv_text, known_to, required, scenario, write_path
from reference import reading
from routes import HEAD, POSE_HEAD
from scipy.constants import Boltzmann
from scipy.special import ndtr
from studies.bands import cases, truth

import radar_sense as rs
from radar_sense import analyses
from radar_sense.acceptance.requirement import Requirement
from radar_sense.acceptance.threshold import path_test
from radar_sense.propagation import band_of_scenario, propagate_scenario, unreliable_in_scenario

#: Nearly nothing is uncertain.
CERTAIN = {
    "uncertainty__aircraft": {"position_m": 1, "attitude_deg": 0.01},
    "uncertainty__radar": {"medium": {"position_m": 1, "constant": 1e-7}},
}


@pytest.mark.parametrize("level", ["low", "high"])
@pytest.mark.parametrize("method", ["linear", "probit", "form", "automatic"])
def test_a_band_is_warned_of_where_it_is_off_and_only_there(method, level):
    """Off is a bound by 0.005 or a tenth of it, or σ by 5 %. Draws tell it to a fifth, or half."""
    s = rs.load_scenario().with_analysis(level=level).at_poses(slice(0, None, 10))
    found = propagate_scenario(s, method=method)
    warned = unreliable_in_scenario(s.with_analysis(method=method), found)
    lower, upper, std = (reading.paper(level)[name][::2] for name in ("lower_3", "upper_3", "std"))
    parts = [abs(found.std - std) / (0.05 * std)]
    for bound, true in ((found.lower, lower), (found.upper, upper)):
        parts.append(abs(bound - true) / np.minimum(0.005, 0.1 * true))
    off = np.max(parts, axis=0)
    assert warned[off > 1.2].all()
    assert not warned[off < 0.5].any()
    assert ((off > 1.2).sum() > 20) == ((method, level) == ("linear", "high"))
    if method == "automatic":
        assert off.max() < 0.5


@pytest.mark.usefixtures("few_judge")
@pytest.mark.parametrize("correlation_s", [100, ".inf"])
def test_a_pose_is_at_most_anywhere_and_anywhere_at_most_the_sum_over_poses(
    tmp_path, correlation_s
):
    """Past two radars, the second of which has a limit."""
    known = {"medium": {"position_m": 1000, "constant": 1e-3}}
    one = {"constant": 0.01, "p_fa": 1e-6, "detector": "swerling1", "uncertainty": known}
    radars = [
        {"name": "a", "position_m": [-9e3, 10e3, -20], **one},
        {"name": "b", "position_m": [15e3, 10e3, -20], "max_range_km": 60, **one},
    ]
    rows = [(100 * i, 25e3 * (i - 2), 30e3 + 8e3 * (i % 2), -6000) for i in range(5)]
    file = write_path(
        tmp_path,
        csv_text(HEAD, rows),
        aircraft__rcs={"model": "constant", "rcs_m2": 0.05},
        uncertainty__aircraft={"position_m": 500, "attitude_deg": 1},
        uncertainty__aircraft_correlation_s=correlation_s,
        analysis={"level": "medium"},
        radars=radars,
    )
    s = rs.load_scenario(file)
    p_d = s.p_d()
    for p_max in (0.5 * p_d.max(), np.median(p_d), 0.5 * (1 + p_d.max())):
        band = band_of_scenario(s, method="form", beta=2.0)
        found = path_test(s.with_analysis(method="form"), Requirement(float(p_max), 2.0), band)
        runs, each, rounding = found.decision.runs, found.decision.runs.probability, 1e-12
        anywhere = runs.anywhere / runs.runs
        assert each.max() <= anywhere + rounding
        assert 0 < anywhere <= min(1, each.sum() + rounding)
        time = found.path.scenario.time_s
        assert len(each) == len(time) > 5
        if s.correlation_s < math.inf:  # a pose stands for half of the steps beside it
            mean = 0.5 * np.diff(time) @ (each[1:] + each[:-1])
            assert runs.time == pytest.approx(mean, abs=1e-9)
    # the summary and the table have these numbers
    result = analyses.variance(s, threshold=float(p_max), method="form", k=2)
    summary = result.summary["threshold"]
    of_poses = found.decision.probability
    assert summary["highest_probability_above"]["value"] == of_poses.max()
    assert summary["probability_above_at_any_pose"]["value"] == anywhere
    assert summary["mean_time_above_s"]["value"] == runs.time
    line = next(line for line in result.report if line.startswith("P(P_D >"))
    assert f"at some pose of {len(each)} (" in line
    np.testing.assert_array_equal(result.table["probability_above"], of_poses[found.path.rows])


@pytest.mark.parametrize("seed", range(1, 5))
def test_some_pose_is_beyond_at_least_as_often_as_one(seed):
    """With a certain aircraft the first pose beyond stands for all; draws know it best."""
    s = scenario(**known_to(constant=20)).at_poses(slice(0, 361, 60))
    found = analyses.variance(s, threshold=0.85, seed=seed).summary["threshold"]
    somewhere, highest = (
        found[name] for name in ("probability_above_at_any_pose", "highest_probability_above")
    )
    assert somewhere["value"] >= highest["value"] > 0.99
    assert somewhere["standard_error"] <= 1e-3


@pytest.mark.usefixtures("few_judge")
@pytest.mark.parametrize(("error_m", "correlation_s"), [(0, 60), (10, math.inf)])
def test_the_mean_time_above_is_the_integral_of_the_probability(tmp_path, error_m, correlation_s):
    """Hardly more than c_r is uncertain, by a tenth. The threshold is P_D at 73 km.

    At a range R, P_D is above it if c_r is more than (R/73 km)⁴ times its nominal value. The flight
    ends at 75 km from the radar, and has few poses.
    """
    c_r = 20 * Boltzmann * 75e3**4  # of a signal 20 times the noise at the end
    file = write_path(
        tmp_path,
        csv_text(HEAD, [(time, 150e3 - 250 * time, 0, -10) for time in (0, 300)]),
        aircraft__rcs={"model": "constant", "rcs_m2": 1},
        radar={"position_m": [0, 0, 0], "constant": c_r, "p_fa": 1e-6, "detector": "swerling1"},
        uncertainty={
            "aircraft": {"position_m": error_m, "attitude_deg": 0},
            "aircraft_correlation_s": correlation_s,
            "radar": {"medium": {"position_m": 0, "constant": 0.1 * c_r}},
        },
    )
    threshold = 1e-6 ** (1 / (1 + 20 * (75 / 73) ** 4))
    result = analyses.variance(rs.load_scenario(file), threshold=threshold, probability=0.2)
    found = result.summary["threshold"]["mean_time_above_s"]
    time = np.linspace(0, 300, 3001)
    distance = np.hypot(150e3 - 250 * time, 10)
    exact = np.trapezoid(ndtr((1 - (distance / 73e3) ** 4) / 0.1), time)
    assert abs(found["value"] - exact) < 3 * found["standard_error"] < 0.2 * exact


@pytest.mark.parametrize(
    ("correlation_s", "known", "missing"),
    [
        (0, False, "(in Python Scenario.correlation_s) and a path with times"),
        (60, False, "needs a path with times"),
        (60, True, ""),
    ],
)
def test_anywhere_on_an_orbit_is_given_without_errors_of_the_aircraft_only(
    correlation_s, known, missing
):
    """The number would depend on the azimuth step, because an orbit has no times."""
    certain = {"position_m": 0, "attitude_deg": 0}
    s = scenario(
        geometry__azimuth_deg={"start": 40, "stop": 46, "step": 2},
        uncertainty__aircraft_correlation_s=correlation_s,
        **({"uncertainty__aircraft": certain} if known else {}),
    )
    result = analyses.variance(s, threshold=0.6)
    assert ("probability_above_at_any_pose" in result.summary["threshold"]) == known
    assert "mean_time_above_s" not in result.summary["threshold"]
    assert any("no errors of the aircraft)" in line for line in result.report) == known
    needs = [line for line in result.report if line.startswith("P at some pose needs ")]
    assert len(needs) == (not known)
    assert all(line.endswith(missing) for line in needs)


def past_a_limit(folder, beyond, at):
    """A flight of 1000 s, closest to a radar at a time, then beyond its 60 km by some metres."""
    east = math.sqrt((60e3 + beyond) ** 2 - 6e3**2)
    text = csv_text(HEAD, [(time, 200 * (time - at), east, -6000) for time in (0, 1000)])
    return rs.load_scenario(
        write_path(
            folder,
            text,
            aircraft__rcs={"model": "constant", "rcs_m2": 1},
            radar={"position_m": [0, 0, 0], "constant": 10, "p_fa": 1e-6, "max_range_km": 60},
            **CERTAIN,
        )
    )


@pytest.mark.usefixtures("few_judge")
@pytest.mark.parametrize(("within", "at"), [(10, 489.7), (300, 31.4)])
def test_a_path_that_grazes_a_limit_between_rows_is_violated(tmp_path, within, at):
    """The errors are metres, and the path is within the limit for twice √(d² − (d − x)²)/v."""
    s = past_a_limit(tmp_path, -within, at)
    assert not s.model.p_d(s.aircraft, s.radar).any()
    test = analyses.variance(s, threshold=0.3).summary["threshold"]
    assert test["verdict"] == "violated"
    assert test["p_d_itself_above"]
    half = math.sqrt(60e3**2 - (60e3 - within) ** 2) / 200
    assert test["first_violation"]["time_s"] == pytest.approx(max(at - half, 0), abs=2)
    assert test["above_s"] == pytest.approx(min(half, at) + half, abs=4)


def test_a_path_that_stays_beyond_a_limit_holds(tmp_path):
    assert analyses.variance(past_a_limit(tmp_path, 40, 489.7), threshold=0.3).passed


@pytest.mark.usefixtures("few_judge")
@pytest.mark.parametrize(("kind", "centre"), [("orbit", -113), ("path", 98.37)])
def test_a_lobe_of_a_third_of_a_degree_between_rows_is_found(tmp_path, kind, centre):
    """P_D at the top of the lobe is P_fa^(1/(1 + S)), with S by hand."""
    azimuth = np.arange(-1800, 1800) * 0.1
    off = (azimuth - centre + 180) % 360 - 180
    decibels = -30 + 30 * np.exp(-4 * math.log(2) * (off / 0.3) ** 2)
    rows = np.column_stack([azimuth, decibels])
    np.savetxt(tmp_path / "lobe.csv", rows, "%.4f", ",", header="azimuth_deg,rcs_dbsm", comments="")
    common = {
        "aircraft__rcs": {"model": "table", "file": str(tmp_path / "lobe.csv")},
        "radar": {"position_m": [0, 0, 0], "constant": 2e-4, "p_fa": 1e-6, "detector": "swerling1"},
        **CERTAIN,
    }
    # heading north, seen under an azimuth of `centre`, half of the way to the next row
    towards = np.deg2rad(centre + 180)
    if kind == "orbit":
        middle = math.degrees(towards)
        steps = {"start": middle - 7, "stop": middle + 6.5, "step": 4.5}
        orbit = {"type": "orbit", "range_km": 20, "down_km": -0.01, "azimuth_from": "north"}
        level = {"aircraft__attitude_deg": [0, 0, 0], **common}
        s = scenario(geometry={**orbit, "azimuth_deg": steps}, **level)
    else:
        place = 20e3 * np.array([math.cos(towards), math.sin(towards)])
        across = np.array([-math.sin(towards), math.cos(towards)])
        rows = [(t, *(place + 200 * (t - 8.1) * across), -10, 0, 0, 0) for t in (0, 20)]
        s = rs.load_scenario(write_path(tmp_path, csv_text(POSE_HEAD, rows), **common))
    snr = 2e-4 * 1.0 / (Boltzmann * 20e3**4)
    top = 1e-6 ** (1 / (1 + snr))
    assert top > 0.5
    assert s.model.p_d(s.aircraft, s.radar).max() < 0.1
    result = analyses.variance(s, threshold=0.97 * top)
    test = result.summary["threshold"]
    assert test["verdict"] == "violated"
    assert test["p_d_itself_above"]
    assert test["worst_margin"]["value"] <= -0.03 * top
    low = analyses.variance(s, threshold=0.1, method="form").summary["threshold"]
    assert low["verdict"] == "violated"
    # P_D is above 0.1 where the decibels are above what 0.1 needs, and the bound within 3 sigma
    # of the yaw of this, 0.01 deg. Steps are no shorter than 0.01 deg and 0.2 s.
    needed = 10 * math.log10((math.log(1e-6) / math.log(0.1) - 1) / snr)
    half = 0.15 * math.sqrt(math.log2(30 / (30 + needed))) + 0.03
    if kind == "orbit":
        assert low["above_deg"] == pytest.approx(2 * half, abs=0.04)
    else:
        assert low["above_s"] == pytest.approx(2 * np.deg2rad(half) * 20e3 / 200, abs=0.4)


@pytest.mark.usefixtures("few_judge")
def test_a_factor_of_a_budget_is_confirmed_by_plain_draws_of_another_program():
    """Where 3 sigma is largest it is 0.5 with all deviations some 3.58 times as large."""
    folder = Path(__file__).parents[1] / "studies/cases"
    s = rs.load_scenario(folder / "bud_b.yaml")
    s = s.at_poses(np.flatnonzero(s.axis.values == 30))
    factor = required(s, 0.5, "all")["all"].factor
    assert 3.3 < factor <= 3.62
    azimuth, rows, problem = cases.read("bud_b")
    (row,) = rows[azimuth == 30]
    draws = 400_000
    grown = cases.at_row(cases.grown(problem, factor), row)
    p_d = truth.drawn(grown, np.random.default_rng(1), draws)
    off = np.square(p_d - p_d.mean()) - p_d.var()
    error = 3 * 0.5 * math.sqrt(np.mean(off**2) / draws) / p_d.std()
    assert 3 * p_d.std() <= 1.005 * 0.5 + 3 * error  # the draws of the budget have noise
