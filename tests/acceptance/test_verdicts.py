"""Verdicts of a threshold test (holds, violated, not known), and probabilities."""

import dataclasses
import math
from functools import partial

import numpy as np
import pytest
from helpers import (
    CONFIGS,
    OVERHEAD,
    corridor,
    cov_by_level,
    drawn_p_d,
    known_to,
    required,
    scenario,
    sheet_scenario,
    with_arrays,
    write_path,
)
from reference import reading
from scipy.optimize import minimize_scalar
from scipy.special import ndtr
from scipy.stats import norm

import radar_sense as rs
from radar_sense import analyses, axis
from radar_sense.acceptance import refinement
from radar_sense.acceptance.accuracy import required_accuracies
from radar_sense.acceptance.requirement import Requirement
from radar_sense.acceptance.threshold import decide, path_test
from radar_sense.analyses import verdict as words_of_verdict
from radar_sense.analyses.required import in_words
from radar_sense.flight import Path, Radial
from radar_sense.montecarlo.exceedance import exceedance
from radar_sense.propagation import (
    METHODS,
    Band,
    band_of_scenario,
    distribution,
    propagate_scenario,
)
from radar_sense.propagation.draws import estimate
from radar_sense.propagation.staged import LAST

FEW = {"start": 45, "stop": 60, "step": 15}
#: A straight flight past the radar: two rows far away, where P_D is small.
PAST = "time_s,north_m,east_m,down_m\n0,-400000,120000,-9000\n3600,400000,120000,-9000\n"
CONSTANT = {"model": "constant", "rcs_m2": 0.1}


def past(tmp_path, text=PAST, **changes):
    known = {"medium": {"position_m": 100, "constant": 0.2}}
    changes = {"radar__constant": 4, "uncertainty__radar": known, **changes}
    return rs.load_scenario(write_path(tmp_path, text, **changes))


def spikes(lobes, amplitude, floor):
    return {"model": "spikeball", "lobes": lobes, "amplitude_m2": amplitude, "floor_m2": floor}


def by_form(s):
    return band_of_scenario(s, method="form")


@pytest.mark.usefixtures("few_judge")
@pytest.mark.parametrize("method", METHODS)
def test_a_probability_is_at_most_one(method):
    s = scenario(geometry__azimuth_deg={"start": 0, "stop": 90, "step": 10})
    found = [distribution(s, method).exceedance(p_max) for p_max in (1e-3, 0.1, 0.5, 0.999)]
    assert np.min(found) >= 0
    assert np.max(found) <= 1 + 1e-12
    assert np.all(np.diff(found, axis=0) <= 0)  # the less, the higher the limit


@pytest.mark.parametrize("method", ["linear", "probit", "form"])
def test_the_bound_and_the_probability_agree(method):
    """The upper bound at Φ(k) is P_max exactly where P(P_D > P_max) is Φ(−k)."""
    s = scenario(geometry__azimuth_deg={"start": 0, "stop": 80, "step": 20})
    for k in (0.7, 2.0, 3.0):
        upper = propagate_scenario(s, method=method, beta=k).upper
        of = [distribution(s.at_poses(np.array([i])), method) for i in range(len(upper))]
        found = [one.exceedance(u)[0] for one, u in zip(of, upper, strict=True)]
        np.testing.assert_allclose(found, ndtr(-k), rtol=0.02)


def test_without_uncertainty_the_probability_is_zero_or_one():
    s = scenario(**known_to(), geometry__azimuth_deg=FEW)
    for method in ("linear", "probit", "form", "automatic"):
        assert distribution(s, method).exceedance(0.7).tolist() == [0, 1]
    result = analyses.variance(s.at_poses(slice(1)), threshold=0.7)
    runs = result.summary["threshold"]["runs"]
    assert result.passed
    assert f"P(P_D > 0.7): in none of {runs:,} runs" in result.report
    found = result.summary["threshold"]["highest_probability_above"]
    assert found["standard_error"] == pytest.approx(1 / runs, rel=0.01)  # as of one more run


def test_of_a_certain_p_d_beyond_the_limit_no_better_knowledge_helps():
    s = scenario(**known_to(), geometry__azimuth_deg=FEW)
    asked = {"threshold": 0.5 * float(s.p_d().max()), "probability": 0.05}
    for result in (analyses.variance(s, **asked), analyses.budget(s, **asked)):
        assert any("no better knowledge helps" in line for line in result.report)


@pytest.mark.parametrize("at_least", [False, True])
def test_draws_decide(at_least):
    """Compare with the quantiles of a plain loop, and with limits just within and beyond."""
    s = scenario(geometry__azimuth_deg=FEW).with_analysis(level="high")
    p_d, side = drawn_p_d(s, 40_000, seed=5), -1 if at_least else 1
    for pose in range(2):
        one = s.at_poses(np.array([pose]))
        quantile = np.quantile(p_d[:, pose], ndtr(2 * side))
        for room in (-0.02, 0.02):
            limit = quantile + side * room
            decision = decide(one, Requirement(limit, 2.0, at_least))
            share, runs = np.mean(side * (p_d[:, pose] - limit) > 0), decision.runs
            assert decision.bound[0] == pytest.approx(quantile, abs=0.01)
            error = math.sqrt(share * (1 - share) * (1 / runs.runs + 1 / len(p_d)))
            for probability in (decision.probability[0], runs.probability[0]):
                assert probability == pytest.approx(share, abs=4 * error)
            assert (decision.holds[0], decision.violated[0]) == (room > 0, room < 0)
        on_it = decide(one, Requirement(quantile, 2.0, at_least))
        assert not (on_it.holds[0] and on_it.violated[0])


@pytest.mark.parametrize("k", [2.9999, 3.0001])
def test_no_verdict_is_wrong_just_beside_the_limit(k):
    """Only c_r is uncertain, and P(P_D > P_max) is Φ(−k). A stratum of the draws ends at Φ(3)."""
    s = scenario(geometry__azimuth_deg={"start": 45, "stop": 45, "step": 1}, **known_to(constant=5))
    p_max = s.model.p_d(s.aircraft, np.add(s.radar, [0, 0, 0, 5 * k]))[0]
    found = decide(s, Requirement(float(p_max)))
    assert not (found.holds[0] if k < 3 else found.violated[0])
    of_runs = found.runs.error(found.runs.counts[0])
    assert abs(found.probability[0] - ndtr(-k)) < 4 * found.error[0] < of_runs


@pytest.mark.usefixtures("few_judge")
def test_poses_between_rows_have_the_draws_of_the_poses_alone(tmp_path):
    s = past(tmp_path)
    band_of = partial(band_of_scenario, method="automatic", p_max=0.1)
    path = path_test(s.with_analysis(method="automatic"), Requirement(0.1), band_of(s)).path
    assert path.added > 0
    whole = band_of(path.scenario)
    for name, values in vars(whole.drawn).items():
        np.testing.assert_allclose(getattr(path.band.drawn, name), values, rtol=1e-9, atol=1e-12)


@pytest.mark.usefixtures("few_judge")
def test_too_few_runs_for_a_tail_are_not_known():
    """At 4.1 sigma 370,000 runs would be needed. P_D is far below the threshold."""
    s = scenario(geometry__azimuth_deg={"start": 0, "stop": 2, "step": 2})
    decision = decide(s, Requirement(0.99, 4.1))
    assert decision.wanted > decision.runs.runs
    assert not decision.runs.counts.any()
    assert not decision.holds.any()
    assert not decision.violated.any()
    assert (decision.bound < 0.7).all()
    result = analyses.variance(s, method="automatic", threshold=0.99, k=4.1)
    assert (result.passed, result.summary["threshold"]["verdict"]) == (False, "not known")
    assert any(" runs of the path would be needed" in line for line in result.report)


@pytest.mark.parametrize("tau", [400, math.inf])
def test_the_probability_anywhere(tmp_path, tau):
    """Compare with draws in the test, with aircraft errors correlated in time."""
    rows = "\n".join(f"{t},{-10000 + 20 * t},150000,-9000" for t in range(0, 1001, 250))
    s = past(
        tmp_path,
        f"time_s,north_m,east_m,down_m\n{rows}\n",
        radar__constant=0.5,
        uncertainty__radar={"medium": {"position_m": 100, "constant": 0.02}},
        uncertainty__aircraft={"position_m": 100, "attitude_deg": 3},
        uncertainty__aircraft_correlation_s=tau,
    )
    moments = propagate_scenario(s)
    p_max = float(moments.p_d.max() + moments.std[np.argmax(moments.p_d)])
    rng = np.random.default_rng(2)
    std = np.sqrt(np.diag(s.cov_aircraft))
    rho = math.exp(-250 / tau)
    runs = 20_000
    radar = s.radar + np.sqrt(np.diag(cov_by_level(s)["medium"])) * rng.standard_normal((runs, 4))
    normals = rng.standard_normal((5, runs, 6))
    for i in range(1, 5):
        normals[i] = rho * normals[i - 1] + math.sqrt(1 - rho**2) * normals[i]
    p_d = s.model.p_d(s.aircraft[:, np.newaxis] + std * normals, radar)
    hits = np.count_nonzero((p_d > p_max).any(axis=0))
    share = hits / runs
    assert 0.1 < share < 0.9
    found = exceedance(s, Requirement(p_max).margin, 50_000)
    error = math.sqrt(share * (1 - share) * (1 / runs + 1 / found.runs))
    assert found.anywhere / found.runs == pytest.approx(share, abs=4 * error)
    each = (p_d > p_max).mean(axis=1)
    np.testing.assert_allclose(
        found.probability, each, atol=4 * 0.5 * math.sqrt(1 / runs + 1 / 5e4)
    )
    # each pose stands for half of the steps beside it
    times = (p_d > p_max).T @ np.array([125, 250, 250, 250, 125])
    error = math.hypot(times.std() / math.sqrt(runs), found.time_error)
    assert found.time == pytest.approx(times.mean(), abs=4 * error)
    assert found.time_error == pytest.approx(times.std() / math.sqrt(5e4), rel=0.05)


@pytest.mark.usefixtures("few_judge")
def test_a_threshold_is_tested_between_waypoints(tmp_path):
    """P_D is below 0.1 at both rows of the route, and near 1 between the rows."""
    s = past(tmp_path)
    assert propagate_scenario(s).upper.max() < 0.1
    result = analyses.variance(s, method="form", threshold=0.1)
    test = result.summary["threshold"]
    assert not result.passed
    assert test["verdict"] == "violated"
    assert test["p_d_itself_above"]
    assert test["poses_between_rows"] > 20
    assert len(result.table["p_d"]) == 2  # the table has the rows
    between = f"{test['poses_between_rows']} of the poses are between the rows of the path"
    assert f"{between}; what follows is of the rows of the path alone" in result.report
    assert any("no better knowledge helps" in line for line in result.report)
    # time above, first violation and least margin against a path of 1 s steps
    dense = refinement.along(s, np.arange(0.0, 3600.5))
    upper = propagate_scenario(dense, method="form").upper
    assert test["above_s"] == pytest.approx(np.count_nonzero(upper > 0.1), abs=10)
    assert test["worst_margin"]["value"] == pytest.approx(0.1 - upper.max(), abs=0.002)
    assert test["first_violation"]["time_s"] == pytest.approx(np.argmax(upper > 0.1), abs=100)
    assert any("add poses between the rows with geometry.interpolate" in w for w in result.warnings)


def test_both_sides_of_each_limit_are_poses(tmp_path):
    """Straight over a blind zone of 5 km the aircraft is seen best at its edges, 1 km high."""
    head = "time_s,north_m,east_m,down_m,roll_deg,pitch_deg,yaw_deg"
    route = f"{head}\n0,-50e3,0,-1e3,0,0,0\n550,60e3,0,-1e3,0,0,0\n"
    s = rs.load_scenario(
        write_path(tmp_path, route, aircraft__rcs={"model": "constant", "rcs_m2": 1})
    )
    radars = tuple(dataclasses.replace(radar, min_range=5e3, max_range=40e3) for radar in s.radars)
    s = dataclasses.replace(s, radars=radars)
    edge = math.sqrt(5e3**2 - 1e3**2) / 200
    places = refinement.places(s)
    inmost = math.sqrt(22.5e3**2 - 1e3**2) / 200  # between the limits
    for time in (250, 250 - edge, 250 + edge, 250 - inmost, 250 + inmost):
        assert np.min(abs(places - time)) <= 2e-6
    p_d = s.model.p_d(refinement.along(s, places).aircraft, s.radar)
    at_edge = s.radars[0].model.p_d([edge * 200, 0, -1e3, 0, 0, 0], s.radar[:4])
    assert p_d.max() == pytest.approx(at_edge, rel=1e-9)


@pytest.mark.usefixtures("few_judge")
@pytest.mark.parametrize(
    ("sweep", "azimuth_from"), [((45, 225, 90), "east"), ((225, 45, -90), "north")]
)
def test_an_orbit_is_tested_between_its_azimuths(sweep, azimuth_from):
    start, stop, step = sweep
    azimuths = {"start": start, "stop": stop, "step": step}
    few = scenario(geometry__azimuth_deg=azimuths, geometry__azimuth_from=azimuth_from)
    dense = scenario(
        geometry__azimuth_deg={**azimuths, "step": math.copysign(0.1, step)},
        geometry__azimuth_from=azimuth_from,
    )
    limit = 0.5 * sum(s.model.p_d(s.aircraft, s.radar).max() for s in (few, dense))
    tested = analyses.variance(few, method="form", threshold=limit, k=1.0)
    assert not tested.passed
    assert not tested.table["violated"].any()  # the violation is between the azimuths
    assert any("between the azimuths given" in line for line in tested.report)
    own, added = (
        refinement.resolve(s, by_form, Requirement(0.1), by_form(s)) for s in (few, dense)
    )
    assert added.added <= 1  # the peak
    assert np.all(own.scenario.axis.values[own.rows] == few.axis.values)
    np.testing.assert_array_equal(own.scenario.aircraft[own.rows], few.aircraft)
    order = slice(None, None, 1 if step > 0 else -1)
    for name in ("p_d", "upper"):
        linear = np.interp(
            added.scenario.axis.values,
            own.scenario.axis.values[order],
            getattr(own.band, name)[order],
        )
        assert np.abs(linear - getattr(added.band, name)).max() < 0.001


def test_poses_that_do_not_resolve_p_d(tmp_path, monkeypatch):
    """P_D is noise here, and every step between two poses is bent."""
    monkeypatch.setattr(refinement, "MAX_POSES", 40)
    rows = "".join(f"{10 * k},400000,{1000 * k},-9000\n" for k in range(5))
    s = past(tmp_path, "time_s,north_m,east_m,down_m\n" + rows, aircraft__rcs=CONSTANT)
    rng = np.random.default_rng(0)

    def noise(s):
        p_d = rng.random(len(s.axis))
        return Band(p_d=p_d, lower=p_d, upper=p_d, error=np.zeros(len(p_d)))

    found = refinement.resolve(s, noise, Requirement(0.1), noise(s))
    assert not found.resolved
    assert found.added < 40


def true_upper(theta_deg):
    """The 3-sigma bound of the paper's scenario at High."""
    return reading.paper("high")["upper_3"][round(theta_deg / 2.5)]


@pytest.mark.parametrize(("theta_deg", "threshold"), [(20, 0.3822), (60, 0.95)])
def test_a_named_bound_that_draws_contradict_is_not_known(theta_deg, threshold):
    """At High the linear bound is 0.005 below the true one at 20 deg, and 0.029 above at 60 deg."""
    s = scenario(geometry__azimuth_deg={"start": theta_deg, "stop": theta_deg, "step": 1})
    s = s.with_analysis(level="high")
    truth, linear = true_upper(theta_deg), propagate_scenario(s, method="linear").upper[0]
    assert (truth > threshold) != (linear > threshold)
    named = analyses.variance(s, method="linear", threshold=threshold)
    assert (named.passed, named.summary["threshold"]["verdict"]) == (False, "not known")
    assert named.report[0].startswith("NOT KNOWN at ")
    assert any("use --method automatic" in line for line in named.report)
    assert named.table["upper_3sigma"][0] == linear  # the bound stays that of the method
    right = analyses.variance(s, method="automatic", threshold=threshold)
    assert right.summary["threshold"]["verdict"] == ("holds" if truth < threshold else "violated")


def test_a_named_bound_that_draws_confirm_decides():
    s = scenario(geometry__azimuth_deg={"start": 20, "stop": 30, "step": 5})
    s = s.with_analysis(level="high")
    assert true_upper(30) < 0.52
    for method in ("linear", "probit", "form", "automatic"):
        test = analyses.variance(s, method=method, threshold=0.52).summary["threshold"]
        assert (test["verdict"], test["poses_not_known"]) == ("holds", 0)
        test = analyses.variance(s, method=method, threshold=0.4).summary["threshold"]
        assert test["verdict"] == "violated"


def test_a_bound_for_another_distribution_of_the_constant_is_not_known():
    """`form` takes c_r as log-normal, and a tolerance of the power is Gaussian."""
    s = sheet_scenario(tolerances={"average_power_kw": 3}).at_poses(slice(1))
    rng = np.random.default_rng(6)
    radar = s.radar + [100, 100, 100, 0] * rng.standard_normal((200_000, 4))
    radar[:, 3] *= np.maximum(1 + 0.3 * rng.standard_normal(len(radar)), 0)
    std = np.sqrt(np.diag(s.cov_aircraft))
    p_d = s.model.p_d(s.aircraft + std * rng.standard_normal((len(radar), 6)), radar)
    upper = np.quantile(p_d, ndtr(3))
    found = propagate_scenario(s, method="automatic")
    assert found.upper[0] == pytest.approx(upper, abs=0.01)
    assert propagate_scenario(s, method="form").upper[0] > upper + 0.2
    assert analyses.variance(s, method="form").warnings
    verdicts = {
        method: analyses.variance(s, method=method, threshold=upper + 0.1).summary["threshold"]
        for method in ("form", "automatic")
    }
    assert verdicts["form"]["verdict"] == "not known"
    assert verdicts["automatic"]["verdict"] == "holds"


def test_violated_poses_and_poses_that_are_not_known_are_both_reported():
    """At High the linear bound at 60 deg is above 0.95, and the true bound is below it."""
    s = scenario(geometry__azimuth_deg={"start": 50, "stop": 70, "step": 10})
    assert true_upper(60) < 0.94
    assert true_upper(70) > 0.98
    result = analyses.variance(s.with_analysis(level="high"), method="linear", threshold=0.95)
    assert result.table["violated"].tolist() == [0, 0, 1]
    assert result.table["not_known"].tolist() == [0, 1, 0]
    assert result.report[0].startswith("VIOLATED at ")
    assert result.report[0].endswith(" deg: P_D + 3 sigma <= 0.95")
    assert result.report[1].startswith("not known at ")


@pytest.mark.parametrize("threshold", [0.62, 0.8])
def test_how_small_a_source_must_be_for_the_bound(threshold):
    """With the factor, the bound of the test equals P_max to the accuracy of the search."""
    s = scenario(geometry__azimuth_deg={"start": 44, "stop": 46, "step": 1})
    found = required_accuracies(s, Requirement(threshold), method="form")
    assert found["all"].factor is not None
    for source, accuracy in found.items():
        if accuracy.factor is None:
            assert accuracy.residual > threshold
            assert source != "all"
        elif math.isfinite(accuracy.factor):
            assert accuracy.residual == pytest.approx(threshold, abs=1e-6)
    scaled = [cov * found["all"].factor ** 2 for cov in (s.cov_aircraft, s.cov_radar)]
    band = rs.propagate(s.model, s.aircraft, s.radar, *scaled, method="form")
    assert band.upper.max() == pytest.approx(threshold, abs=1e-6)


def test_a_bound_without_a_value_is_not_known_to_hold():
    """Straight above the radar, where draws alone have a bound: they say that the test holds."""
    level = {"medium": {"position_m": 100, "constant": 1e-7}}
    s = scenario(**OVERHEAD, radar__constant=1e-6, uncertainty__radar=level)
    for method in ("linear", "form"):
        found = analyses.variance(s, threshold=0.5, method=method)
        assert np.isnan(found.table["upper_3sigma"]).all()
        assert found.summary["threshold"]["verdict"] == "not known"
    assert analyses.variance(s, threshold=0.5, method="automatic").passed


@pytest.mark.usefixtures("few_judge")
def test_the_budget_of_a_threshold(tool):
    done = tool("budget", "--threshold", "0.65", "--at", "45", "--no-plot")
    assert done.code == 0
    assert "for P_D + 3 sigma <= 0.65 at 45 deg, sigma of all sources" in done.out
    above = tool("budget", "--threshold", "0.5", "--at", "45", "--no-plot")
    assert "no better knowledge helps: P_D itself is above, most at 45 deg" in above.out
    assert "may grow" in tool("budget", "--threshold", "0.9", "--at", "45", "--no-plot").out


def test_places_on_the_earth_are_in_the_table_of_a_path():
    table = analyses.variance(corridor().at_poses(slice(0, 3)), method="linear").table
    places = ["north_m", "east_m", "down_m", "latitude_deg", "longitude_deg", "altitude_m"]
    assert list(table)[-6:] == places
    first = [table[name][0] for name in places[3:]]
    assert first == pytest.approx([33, -154, 9000], abs=1e-6)  # of the first row of the route
    assert "north_m" not in analyses.variance(scenario(geometry__azimuth_deg=FEW)).table


def test_p_d_above_the_threshold_is_violated_though_draws_are_below():
    """On top of a lobe all errors lower P_D: draws alone would say that the bound holds."""
    s = scenario(geometry__azimuth_deg={"start": 45, "stop": 45, "step": 1})

    def p_d(yaw):
        return float(s.model.p_d([*s.aircraft[0, :5], yaw], s.radar))

    top = minimize_scalar(lambda yaw: -p_d(yaw), bounds=(2.0, 2.7), options={"xatol": 1e-10}).x
    only_yaw, certain = np.diag([0, 0, 0, 0, 0, 0.1**2]), {"low": np.zeros((4, 4))}
    aircraft = np.array([[*s.aircraft[0, :5], top]])
    s = with_arrays(s, aircraft=aircraft, cov_aircraft=only_yaw, cov_radar=certain)
    p_max = p_d(top) * (1 - 1e-10)
    found = path_test(
        s.with_analysis(method="automatic"), Requirement(p_max), propagate_scenario(s, p_max=p_max)
    )
    assert found.decision.holds.all()
    assert found.verdict == "violated"


@pytest.mark.parametrize(
    ("at", "errors", "holds"), [(1, 0, False), (3.3, 0, False), (3.3, 0.1, True)]
)
def test_runs_of_the_path_contradict_draws_that_missed_a_tail(at, errors, holds):
    """The draws are made up: they have no P_D above the threshold, with an error."""
    s = scenario(geometry__azimuth_deg=FEW).at_poses(slice(1))
    p_max = float(distribution(s, "form").quantile(at)[0])
    missed = dataclasses.replace(estimate(s.states(), 1024, 3.0, p_max), draws=np.full(1, LAST))
    missed.values[4], missed.errors[4] = 0.0, errors * ndtr(-3)
    found = decide(s, Requirement(p_max), missed)
    assert found.runs.counts[0] > 0
    assert found.holds[0] == holds


def test_the_chance_of_a_false_decision_is_of_all_stages_and_poses():
    """It is 0.0005 in five stages of draws: for "holds" of a pose, for "violated" of a path."""
    s, tail = scenario(geometry__azimuth_deg=FEW), ndtr(-3)
    drawn = dataclasses.replace(estimate(s.states(), 1024, 3.0, 0.9999), draws=np.full(2, LAST))
    drawn.errors[4] = tail / 10
    for side, errors in ((-1, norm.isf(0.0005 / 5)), (1, norm.isf(0.0005 / 5 / 2))):
        for part in (0.99, 1.01):
            drawn.values[4] = tail * (1 + side * part * errors / 10)
            found = decide(s, Requirement(0.9999), drawn)
            assert np.all((found.holds if side < 0 else found.violated) == (part > 1))


def test_a_probability_is_tested_alone():
    """At the top of a lobe P_D itself is above a limit that errors of yaw rarely exceed."""
    s = scenario(
        geometry__azimuth_deg={"start": 22.5, "stop": 22.5, "step": 1},
        aircraft__rcs=spikes(8, 0.03, 0.01),
        **known_to(0, [0, 0, 5]),
    )
    p_max = 0.99 * float(s.p_d()[0])
    share = np.mean(drawn_p_d(s, 100_000) > p_max)
    assert 0.2 < share < 0.35
    for probability, verdict in ((1.3 * share, "holds"), (0.7 * share, "violated")):
        result = analyses.variance(s, threshold=p_max, probability=probability, method="automatic")
        assert result.summary["threshold"]["verdict"] == verdict
        assert ("P_D itself is above" in "".join(result.report)) == (verdict == "violated")
    of_both = analyses.variance(s, threshold=p_max, k=0.6, method="automatic")
    assert of_both.summary["threshold"]["verdict"] == "violated"


def test_draws_look_on_where_form_has_no_value():
    """Errors of the position of 5 km take the aircraft out of range, and 1.45 is met at all."""
    s = scenario(
        geometry={
            "type": "radial",
            "range_km": {"start": 20, "stop": 40, "step": 5},
            "azimuth_deg": 0,
            "down_km": -2,
        },
        aircraft={"rcs": {"model": "constant", "rcs_m2": 0.5}, "attitude_deg": [0, 0, 0]},
        radar__constant=0.001,
        radar__detector="swerling1",
        radar__max_range_km=30,
        **known_to(300, 1, position_m=50, constant=1e-4),
    )
    (found,) = required(s, 1.45, "aircraft_position", method="form").values()
    assert found.factor == np.inf


def test_better_knowledge_helps_where_p_d_itself_is_beyond_the_limit_of_a_probability():
    """At the top of a lobe errors of yaw lower P_D, and one of c_r may raise it."""
    s = scenario(
        geometry__azimuth_deg={"start": 22.5, "stop": 22.5, "step": 1},
        aircraft__rcs=spikes(8, 0.03, 0.01),
        **known_to(0, [0, 0, 20], constant=50),
    )
    p_max = 0.98 * float(s.p_d()[0])

    def share(factor):
        """P(P_D > p_max) by plain draws, with a factor on σ of c_r; its standard error is 0.0007"""
        known = s.with_keys({"uncertainty.radar.medium.constant": 50 * float(factor)})
        return np.mean(drawn_p_d(known, 400_000) > p_max)

    least, most = share(0), share(1)
    assert most > least + 0.03
    probability = 0.5 * (least + most)
    asked = Requirement(p_max, norm.isf(probability), probability=probability)
    found = required(s, asked, "radar_constant", "all")
    factor = found["radar_constant"].factor
    assert share(factor) < probability + 0.002
    assert share(min(1.3 * factor, 1)) > probability - 0.002
    # errors of nothing are beyond the limit, so no factor on all is known
    assert (found["all"].factor, found["all"].known) == (None, False)
    assert in_words(found["all"], s.axis, "automatic") == "not known"
    tested = analyses.variance(s, threshold=p_max, probability=probability)
    assert "no better knowledge" not in "".join(tested.report)
    # what holds already is said to hold, and not impossible
    met = Requirement(p_max, norm.isf(most + 0.02), probability=most + 0.02)
    assert required(s, met, "radar_constant")["radar_constant"].factor >= 1


def with_lobes(rcs, yaw, **changes):
    """A fading aircraft with lobes at a yaw, on an orbit from the north."""
    return scenario(
        geometry__azimuth_from="north",
        radar__p_fa=1e-6,
        radar__detector="swerling1",
        aircraft__rcs=rcs,
        aircraft__attitude_deg=[0, 0, yaw],
        **changes,
    )


def at_a_lobe(floor, yaw):
    return with_lobes(
        spikes(24, 1.0, floor),
        yaw,
        geometry__range_km=300,
        geometry__azimuth_deg={"start": 0, "stop": 0, "step": 1},
        radar__constant=2.1,
        **known_to(10, [0.1, 0.1, 4], position_m=100, constant=0.35),
    )


@pytest.mark.all_draws
def test_the_worst_of_poses_that_draws_do_not_tell_apart_is_that_of_the_lowest_p_d():
    """About the bottom of a gap, at 10 deg, the lower bound is nearly 0."""
    s = with_lobes(
        spikes(8, 1.0, 0.001),
        10,
        geometry__range_km=50,
        geometry__azimuth_deg={"start": 8.5, "stop": 11, "step": 2.5},
        radar__constant=0.03,
        **known_to(10, 2, position_m=10, constant=0.001),
    )
    tested = analyses.variance(s, at_least=0.05).summary["threshold"]
    assert tested["worst_margin"]["theta_r_deg"] == pytest.approx(10, abs=0.1)


@pytest.mark.parametrize(
    ("floor", "yaw", "requirement"),
    [(0.02, 82.5, Requirement(0.53, 1.0)), (1.0, 90.0, Requirement(0.33, at_least=True))],
)
def test_errors_that_take_p_d_away_from_a_limit_are_not_to_shrink(floor, yaw, requirement):
    """At the top of a lobe errors of yaw lower P_D, at the bottom they raise P_D."""
    s, tail = at_a_lobe(floor, yaw), requirement.tail
    limit, k, at_least = requirement.limit, requirement.k, requirement.at_least

    def beyond(factor):
        """P(P_D beyond the limit) by plain draws, with a factor on σ of the attitude."""
        std = [0.1 * factor, 0.1 * factor, 4 * factor]
        known = s.with_keys({"uncertainty.aircraft.attitude_deg": std})
        return np.mean(requirement.margin(drawn_p_d(known, 100_000)) < 0)

    assert beyond(0) > 1.3 * tail
    assert max(beyond(1), beyond(3)) < tail
    (found,) = required(s, requirement, "aircraft_orientation").values()
    assert (found.factor, found.exceeded_at_0) == (math.inf, True)
    assert in_words(found, s.axis, "automatic") == "no smaller; may grow without end"
    asked = {"at_least": limit} if at_least else {"threshold": limit}
    assert analyses.variance(s, **asked, k=k).passed


def test_a_smaller_error_may_be_too_small_where_p_d_itself_is_beyond():
    s, asked = at_a_lobe(0.02, 82.5), Requirement(0.49, norm.isf(0.25), probability=0.25)
    found = required(s, asked, "radar_constant", "aircraft_orientation", "all")
    constant, *others = (in_words(one, s.axis, "automatic") for one in found.values())
    assert constant == "at least 62.1 %, but not 0"
    assert others == ["not known"] * 2


@pytest.mark.parametrize(
    ("pose", "p_max", "verdict"), [(99, 0.2116, "holds"), (234, 0.239, "violated")]
)
def test_a_bound_is_on_the_side_of_its_verdict(pose, p_max, verdict):
    """FORM is within its tolerance there, and on the other side of the limit than draws."""
    s = rs.load_scenario(CONFIGS / "table.yaml", changes={"analysis.method": "automatic"})
    one = s.at_poses(np.array([pose]))
    band = propagate_scenario(one, p_max=p_max)
    found = path_test(one, Requirement(p_max), band)
    assert band.error == 0
    assert (band.upper > p_max) == (verdict == "holds")
    assert found.verdict == verdict
    assert (found.margin >= 0) == (verdict == "holds")
    assert found.by_draws


def test_a_span_ends_where_the_margin_is_zero_and_at_a_jump():
    values = np.array([0.0, 100, 200, 200.0001, 300, 400])
    margin = np.array([1.0, -3, -1, 1, 1, -1])
    mask = np.array([False, True, True, False, False, False])
    path, beyond = Path.of(values, np.zeros((6, 6))), words_of_verdict._beyond
    assert beyond(mask, margin, path) == "at 24.9 to 200 s"
    assert beyond(margin < 0, margin, path) == "at 24.9 to 200, 349.9 to 400 s"
    down = Radial.of(axis.ground_range(values[::-1]), np.zeros(3))
    assert beyond(mask[::-1], margin[::-1], down) == "at 200.0001 to 24.9 km"


def test_p_d_itself_is_that_of_the_whole_path():
    """The bound is beyond the limit where P_D is small, beside a poorly known radar."""
    radars = [
        {"name": name, "position_m": [0, east, -20], "p_fa": 1e-6, "constant": constant,
         "uncertainty": {"n": {"position_m": std, "constant": 1e-8}}}
        for name, east, constant, std in (("known", 8e3, 1.2e-5, 1), ("mobile", -3e4, 2e-6, 3000))
    ]  # fmt: skip
    s = scenario(
        radars=radars,
        aircraft={"rcs": {"model": "constant", "rcs_m2": 0.5}, "attitude_deg": [0, 0, 0]},
        geometry__range_km=20,
        geometry__azimuth_from="north",
        geometry__azimuth_deg={"start": 0, "stop": 360, "step": 10},
        uncertainty={"aircraft": {"position_m": 1, "attitude_deg": 0.1}},
        analysis={"level": "n"},
    )
    s = s.at_states(s.aircraft[[9, 27]])
    report = "\n".join(rs.analyses.variance(s, threshold=0.85).report)
    assert "VIOLATED at pose " in report
    assert f"P_D itself stays below: {s.p_d().max():.4f} at most" in report
