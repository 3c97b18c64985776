"""The analyses: agreement of their tables, and their warnings."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers import OVERHEAD, SOURCES, csv_text, known_to, scenario, shares_of, small_batches

import radar_sense as rs
from radar_sense import analyses
from radar_sense.axis import azimuth
from radar_sense.montecarlo.adaptive import Verdict
from radar_sense.montecarlo.statistics import DrawStatistics
from radar_sense.propagation import METHODS, propagate_scenario
from radar_sense.propagation.draws import estimate
from radar_sense.propagation.linear import Linear
from radar_sense.scenario_file.load import load_scenario
from radar_sense.sources import error_budget
from radar_sense.words import describe_extreme, describe_span, gathered, peak, probability
from radar_sense.words import describe_poses as where

ALL = (analyses.variance, analyses.sensitivity, analyses.budget, analyses.montecarlo)


def test_the_analyses_agree_with_each_other():
    s = load_scenario().at_poses(slice(None, None, 12))
    total = analyses.budget(s).table["three_sigma_total"]
    np.testing.assert_array_equal(total, analyses.sensitivity(s).table["three_sigma_medium"])
    np.testing.assert_array_equal(total, 3 * analyses.variance(s).table["sigma_pd"])
    np.testing.assert_array_equal(total, 3 * analyses.montecarlo(s).table["sigma_pd"])


def test_the_numbers_of_the_paper():
    s = load_scenario()
    at_45 = {name: column[90] for name, column in analyses.budget(s).table.items()}
    assert at_45["theta_r_deg"] == 45
    printed = dict(zip((*SOURCES, "total"), (0.0002, 0.0550, 0.0020, 0.0728, 0.0912), strict=True))
    for source, value in printed.items():
        assert at_45[f"three_sigma_{source}"] == pytest.approx(value, abs=5e-5)
    peaks = analyses.sensitivity(s).summary["largest_three_sigma"]
    for level, value in {"low": 0.0579, "medium": 0.0916, "high": 0.1570}.items():
        assert peaks[level]["value"] == pytest.approx(value, abs=5e-5)
    assert peaks["medium"]["theta_r_deg"] == [46.5, 133.5]


def test_correlated_sources_are_warned_of():
    result = analyses.budget(load_scenario("configs/covariance.yaml"), method="linear")
    gap = result.table["three_sigma_total"] ** 2 - sum(
        result.table[f"three_sigma_{source}"] ** 2 for source in SOURCES
    )
    assert np.max(abs(gap)) > 1e-3
    total = result.table["three_sigma_total"]
    by = np.max(abs(total - np.sqrt(total**2 - gap)))
    (warning,) = [warning for warning in result.warnings if "correlated" in warning]
    assert warning.endswith(f"root sum of squares by up to {by:.2g} [sources-correlated]")
    independent = analyses.budget(load_scenario(), method="linear")
    assert not any("correlated" in warning for warning in independent.warnings)


@pytest.mark.all_draws
@pytest.mark.parametrize("command", ["variance", "sweep"])
def test_the_band_that_is_printed_is_the_one_judged(command):
    """At 0 deg the linear band is right at 2 sigma. At 6 sigma it is off by far more than 0.005."""
    s = load_scenario().with_keys({"geometry.azimuth_deg": "{start: 0, stop: 0, step: 1}"})
    swept = {"key": "radar.constant", "start": 167, "stop": 167, "step": 1}
    run, options = getattr(analyses, command), swept if command == "sweep" else {}
    assert run(s, k=2.0, **options).warnings == ()
    (warning,) = run(s, k=6.0, **options).warnings
    assert "the linear band is off at" in warning


@pytest.mark.all_draws
def test_a_band_that_is_off_is_warned_of_once():
    s = load_scenario().at_poses(slice(None, None, 5))
    assert analyses.variance(s.with_analysis(level="low")).warnings == ()
    (unreliable,) = analyses.variance(s.with_analysis(level="high")).warnings
    assert unreliable.startswith("the linear band is off at 0 to 3")
    assert unreliable.endswith("; use --method automatic [band-off]")
    # probit is off by 0.0044 at most, by the reference of `tests/reference`
    for method in ("probit", "form", "automatic"):
        assert analyses.variance(s.with_analysis(level="high"), method=method).warnings == ()
    table = analyses.variance(s.with_analysis(level="high")).table
    over = table["theta_r_deg"][table["upper_3sigma"] > 1]
    assert (over.min(), over.max()) == (67.5, 112.5)


def test_a_vanishing_gradient_is_warned_of():
    """Nose on, the RCS is flat: an attitude known to 15 deg has no partial, and much variance."""
    s = scenario(**known_to(1, 15, position_m=1, constant=0.5))
    off, warning = analyses.budget(s.at_poses(slice(None, None, 12)), method="linear").warnings
    assert off.endswith("[sigma-off]")
    assert "misses aircraft_orientation at 0, 180 deg, where the gradient vanishes" in warning


def test_negative_constants_are_counted():
    s = scenario(
        uncertainty__radar={"huge": {"position_m": 0, "constant": 100}}, analysis__level="huge"
    )
    assert analyses.montecarlo(s).summary["radar_constants_set_to_zero"] > 0


def test_a_coverage_below_the_nominal_one_is_reported_with_its_interval():
    s = load_scenario().with_analysis(level="high", runs=5000)
    result = analyses.montecarlo(s)
    assert any("fewer than 99.73 % of the draws" in line for line in result.report)
    (warning,) = result.warnings
    assert warning.endswith("[band-off]")
    lowest = result.summary["coverage_lowest"]
    low, high = lowest["confidence_95"]
    assert low < lowest["value"] < high < 0.9973
    assert result.report[1].endswith(f" (95 % confidence {low:.2%} to {high:.2%})")
    assert len(result.summary["coverage_confidence_95"]["lower"]) == 361
    assert result.summary["poses_inconsistent"] > 50
    table = result.table
    shift = np.max(abs(table["mc_mean"] - table["p_d"]))
    assert result.summary["largest_mean_shift"]["value"] == shift > 0
    assert shift != np.max(table["mc_mean"] - table["p_d"])


def test_a_coverage_above_the_nominal_one_is_warned_of(monkeypatch):
    class Wide(Linear):
        def quantile(self, beta):
            return super().quantile(beta) + np.sign(beta) * self.std

    monkeypatch.setitem(METHODS, "linear", Wide)
    s = scenario(geometry__azimuth_deg={"start": 40, "stop": 50, "step": 10})
    result = analyses.montecarlo(s.with_analysis(runs=5000), method="linear")
    words = "the linear band holds more than 99.73 % of the draws at all 2 poses"
    assert any(line.startswith(words) for line in result.report)
    monkeypatch.setattr(
        "radar_sense.words.unreliable_in_scenario", lambda *_, **__: np.zeros(2, bool)
    )
    (warning,) = analyses.montecarlo(s.with_analysis(runs=5000), method="linear").warnings
    assert warning.startswith(words)
    assert warning.endswith("[coverage-off]")


def test_draws_on_the_end_of_a_band_do_not_make_it_too_wide():
    """P_D is 0 in a share of the draws, so that none lies below the lower bound of 0."""
    s = scenario(
        radar__max_range_km=400,
        geometry__range_km=400,
        geometry__azimuth_deg={"start": 0, "stop": 180, "step": 90},
        uncertainty__aircraft={"position_m": 100, "attitude_deg": 1},
    )
    result = analyses.montecarlo(s.with_analysis(runs=100_000), method="automatic")
    assert (result.table["lower_3sigma"] == 0).all()
    assert result.summary["coverage_lowest"]["value"] > 0.9978
    assert not any("coverage-off" in text for text in result.warnings)
    assert not any("more than 99.73 %" in line for line in result.report)


def compared(**analysis):
    s = load_scenario().at_poses(slice(0, None, 30)).with_analysis(**analysis)
    return s, lambda **options: analyses.compare(s, **options)


def test_compare_lays_all_methods_beside_plain_runs():
    s, compare = compared(level="high", runs=40_000)
    result = compare(runs=40_000)
    mc = analyses.montecarlo(s).table
    np.testing.assert_array_equal(result.table["mc_upper"], mc["mc_upper"])
    for method in METHODS:
        table = analyses.variance(s, method=method).table
        for column in ("sigma_pd", "lower_3sigma", "upper_3sigma", "mean_pd"):
            expected = table["p_d" if (column, method) == ("mean_pd", "linear") else column]
            np.testing.assert_array_equal(result.table[f"{column}_{method}"], expected)
        found = result.summary["largest_difference"][method]
        for name, pairs in (
            ("mean", {"mean_pd": "mc_mean"}),
            ("sigma", {"sigma_pd": "mc_std"}),
            ("bounds", {"lower_3sigma": "mc_lower", "upper_3sigma": "mc_upper"}),
        ):
            off = [result.table[f"{c}_{method}"] - result.table[d] for c, d in pairs.items()]
            assert found[name]["value"] == np.max(np.abs(off))
    worst = {m: w["bounds"]["value"] for m, w in result.summary["largest_difference"].items()}
    # 0.035, 0.0044 and 0.00006 without the noise of the draws, some 0.01 at the worst pose
    assert worst["linear"] > 0.03
    assert max(worst["form"], worst["probit"]) < 0.0125
    assert "noise" in result.report[-1]
    assert result.summary["methods_told"] == []


def test_compare_tells_the_methods_apart_or_says_that_it_cannot():
    """The reference of `tests/reference` knows linear to be off by up to 0.035, probit by 0.0044,
    and form by less than four digits show.
    """
    _, compare = compared(level="high", seed=3)
    result = compare()
    first, *rows = result.report
    *table, runs, noise = rows[2:]
    found = dict(zip(METHODS, table, strict=True))
    for method, most in (("linear", 0.035), ("probit", 0.0044)):
        told = re.match(rf"  {method} +(\d\.\d+) at", found[method])
        assert told or method == "probit"
        error = 4 * max(result.table[f"mc_{end}_error"].max() for end in ("lower", "upper"))
        assert not told or float(told[1]) < most + error
    assert re.match(r"  form +(0\.000\d|\de-05) at [^(]+ \(noise\)", found["form"])
    assert runs == "the method montecarlo has 500 runs"
    assert re.match(r"noise of the draws: up to 0\.00\d+ at .+ in a bound", noise)
    assert {"linear", "montecarlo"} <= set(result.summary["methods_told"])
    assert "cannot tell" in first
    assert "form" in first


@pytest.mark.parametrize("stop", [0, 40])
def test_compare_names_no_method_that_has_no_value(stop, monkeypatch):
    """FORM has no value straight above the radar, and the least difference beside it."""
    monkeypatch.setattr(sys.modules["radar_sense.analyses.compare"], "TOGETHER", 2e5)
    along = {"start": 0, "stop": stop, "step": 40}
    line = {"type": "radial", "azimuth_deg": 0, "down_km": -300, "range_km": along}
    s = scenario(geometry=line, radar__constant=20, radar__detector="swerling1")
    result = analyses.compare(s)
    assert any("form has no value at 0 km" in text for text in result.warnings)
    first, told = result.report[0], result.summary["methods_told"]
    assert "form" not in first
    assert "probit" not in first
    assert "automatic" in first
    assert ("--method automatic makes more" in first) == ("automatic" not in told)
    nearest = re.search(r"automatic, bounds within (\S+)", first)
    row = next(line for line in result.report if line.startswith("  automatic"))
    assert not nearest or f" {nearest[1]} at " in row[:38]


def test_compare_at_another_k(monkeypatch):
    small_batches(monkeypatch)
    s, compare = compared(level="high")
    table = compare(k=2).table
    for method in METHODS:
        known = analyses.variance(s, method=method, k=2).table
        np.testing.assert_array_equal(table[f"upper_2sigma_{method}"], known["upper_2sigma"])
    assert np.all(abs(table["upper_2sigma_form"] - table["mc_upper"]) < 4 * table["mc_upper_error"])


def test_validate_at_another_k():
    s = load_scenario().at_poses(slice(40, 140, 25)).with_analysis(method="form")
    result = analyses.validate(s, digits=1, k=2)
    known = analyses.variance(s, k=2).table
    np.testing.assert_array_equal(result.table["upper_2sigma"], known["upper_2sigma"])
    assert result.summary["verdict"] == "agrees"
    assert np.all(abs(result.table["mc_upper"] - known["upper_2sigma"]) < result.table["delta"])
    assert np.all(abs(result.table["coverage_2sigma"] - 0.9545) < 0.01)


def test_the_draws_of_compare_are_not_those_of_automatic(monkeypatch):
    """A part of the draws of `compare` may be as large as the draws that judge `automatic`."""
    s = load_scenario().at_poses(slice(180, 181)).with_analysis(level="high")
    for draws in (1024, 4096, 16_384):
        monkeypatch.setattr(sys.modules["radar_sense.analyses.compare"], "TOGETHER", 4 * draws)
        table = analyses.compare(s).table
        assert table["mc_upper"] != estimate(s.states(), draws, 3.0).bounds[0][1]


@pytest.mark.parametrize(
    ("right", "other", "errors", "told"),
    [("linear", "probit", 3.9, False), ("linear", "probit", 4.1, True),
     ("montecarlo", "form", 100, True)],
)  # fmt: skip
def test_compare_tells_a_difference_of_four_standard_errors(
    monkeypatch, right, other, errors, told
):
    """The draws are made up: one method has their values, and another is off by some errors."""
    s = scenario(geometry__azimuth_deg={"start": 45, "stop": 45, "step": 1})
    found = [propagate_scenario(s, method=method) for method in (right, other)]
    drawn, off = np.array([[m.mean, m.std, m.lower, m.upper] for m in found])
    error = DrawStatistics(*(abs(off - drawn) / errors))
    made_up = 1024, DrawStatistics(*drawn), error
    module = sys.modules["radar_sense.analyses.compare"]
    monkeypatch.setattr(module, "_draw_tails", lambda *_: made_up)
    result = analyses.compare(s)
    assert (other in result.summary["methods_told"]) == told
    noise = probability(4 * max(error.lower[0], error.upper[0]))
    assert result.report[-1] == f"noise of the draws: up to {noise} at 45 deg in a bound"
    # which is a method that draws cannot be compared with
    assert right in result.report[0]
    assert "--method montecarlo" not in result.report[0]


def test_compare_judges_the_largest_difference_by_the_noise_at_its_pose(monkeypatch):
    """The draws are made up, and tell a small difference at one pose but not a large at another."""
    s = scenario(geometry__azimuth_deg={"start": 45, "stop": 60, "step": 15})
    linear = propagate_scenario(s, method="linear")
    nothing = np.zeros(2)
    drawn = DrawStatistics(
        linear.mean, linear.std, np.add(linear.lower, [0.02, 1e-3]), linear.upper
    )
    made_up = 1024, drawn, DrawStatistics(nothing, nothing, np.array([0.01, 1e-4]), nothing)
    module = sys.modules["radar_sense.analyses.compare"]
    monkeypatch.setattr(module, "_draw_tails", lambda *_: made_up)
    result = analyses.compare(s)
    row = next(line for line in result.report if line.startswith("  linear"))
    assert row.count("(noise)") == row.count("0.0200 at 45 deg (noise)") == 1
    assert "linear" in result.summary["methods_told"]


def test_compare_takes_draws_as_the_poses_allow():
    few = load_scenario().at_poses(slice(0, 2))
    assert analyses.compare(few).summary["runs"] == 2**17
    assert analyses.compare(few, runs=100).summary["runs"] == 100
    assert analyses.compare(few, sampler="sobol").summary["runs"] == few.runs


def test_validate_answers_where_a_method_may_be_trusted():
    s = scenario(geometry__azimuth_deg={"start": 0, "stop": 90, "step": 45})
    linear = analyses.validate(s, digits=1)
    assert not linear.passed
    assert linear.summary["verdict"] == "differs"
    assert linear.table["validated"].tolist() == [1, 1, 0]
    (top, _), table = linear.plot().axes, linear.table
    lines = [line for line in top.lines if len(line.get_xdata()) == 3]
    for line, name in zip(lines, ("mean", "sigma", "lower", "upper"), strict=True):
        np.testing.assert_array_equal(line.get_ydata(), table[f"distance_{name}"] / table["delta"])
    assert "linear DIFFERS from draws at" in linear.report[0]
    assert "at 90 deg" in linear.report[0]
    form = analyses.validate(s, method="form", digits=1)
    assert form.passed
    assert form.table["validated"].tolist() == [1, 1, 1]
    error = np.sqrt(0.9973 * 0.0027 / form.summary["plain_runs"])
    assert np.all(abs(form.table["coverage_3sigma"] - 0.9973) < 4 * error)
    assert np.all(form.table["coverage_low"] < form.table["coverage_3sigma"])
    assert np.all(form.table["coverage_high"] > form.table["coverage_3sigma"])


@pytest.mark.parametrize(
    ("mask", "says"),
    [
        ([0, 0, 0], ""),
        ([1, 1, 1], "at all 3 poses"),
        ([1, 0, 1], "at 0, 20 deg"),
        ([0, 1, 1], "at 10 to 20 deg"),
        ([1, 0] * 4, "at 0, 20, 40, 60 deg"),
        ([1, 0] * 5, "at 5 of 10 poses in 5 parts between 0 and 80 deg"),
    ],
)
def test_poses_in_words(mask, says):
    assert where(np.array(mask, dtype=bool), azimuth(10.0 * np.arange(len(mask)))) == says


@pytest.mark.parametrize(("count", "places"), [(3, "0, 10 and 20 deg"), (4, "4 poses")])
def test_the_places_of_an_extreme_in_words(count, places):
    along = azimuth(10.0 * np.arange(5))
    top = peak(np.where(np.arange(5) < count, 0.25, 0.0), along)
    assert describe_extreme(top, along) == f"0.2500 at {places}"


def test_what_several_warn_of_is_one_line():
    found = gathered((f"r{i}", "off [band-off]") for i in range(6))
    assert found == ("r0, r1, r2 and 3 more: off [band-off]",)


def test_a_bound_by_too_few_draws_is_not_precise():
    """A thousand judge here, at the most."""
    s = load_scenario("configs/gap_fillers.yaml").at_poses(slice(30, 31))
    result = analyses.variance(s, method="automatic")
    assert result.table["error_3sigma"][0] > 0.005
    assert "the automatic band is not precise at 60 deg" in "".join(result.warnings)


@pytest.mark.parametrize(
    ("p_d", "says"),
    [
        ([0.25, 0.5, 0.25], "P_D runs from 0.2500 at 0 and 20 deg to 0.5000 at 10 deg"),
        (
            [0.25, np.nan, 0.5],
            "P_D runs from 0.2500 at 0 deg to 0.5000 at 20 deg (1 pose without a value)",
        ),
        ([0.25, 0.25, 0.25], "P_D is 0.2500 at every pose"),
        ([0.98801, 0.98804, 0.98798], "P_D is 0.9880 at every pose"),
        ([0.98801, np.nan, 0.98798], "P_D is 0.9880 wherever it has a value"),
        ([0.25, 0.25, np.nan], "P_D is 0.2500 wherever it has a value"),
        ([0.25], "P_D is 0.2500 at 0 deg"),
        ([np.nan, np.nan], "P_D runs from undefined to undefined"),
    ],
)
def test_the_span_of_p_d_in_words(p_d, says):
    p_d, along = np.array(p_d), azimuth(10.0 * np.arange(len(p_d)))
    assert describe_span(p_d, along) == says


def test_no_uncertainty_at_all():
    """Nothing is uncertain: P_D has a value, a budget no shares, and no report a nan."""
    s = scenario(**known_to(), analysis__runs=64).at_poses(slice(None, None, 60))
    for analysis in ALL:
        assert not any("nan" in line for line in analysis(s).report)
    for method in ("linear", "montecarlo"):
        budget = analyses.budget(s, method=method)
        assert not budget.table["three_sigma_total"].any()
        assert np.isnan(list(shares_of(error_budget(s, method)).values())).all()
        assert "  total                0" in budget.report
        assert not any("%" in line for line in budget.report)


def test_where_p_d_is_certain_a_method_may_still_have_no_value():
    """Straight above the radar the aspect has no gradient; c_r is far more than P_D of 1 needs."""
    strong = scenario(**OVERHEAD, **known_to(10), radar__constant=1e9).at_poses(slice(1))
    answer, *_ = analyses.compare(strong).report
    assert answer == "P_D is certain: every method that has a value has the same"


def test_validate_without_any_result(monkeypatch):
    small_batches(monkeypatch)
    result = analyses.validate(scenario(**OVERHEAD), digits=1)
    assert not result.passed
    assert any("no result at 0 deg" in line for line in result.report)
    assert not any("nan" in line for line in result.report)


def judged(monkeypatch, distance, error, delta, **options):
    """Return what `validate` says where a mean is off by distances with errors."""
    n = len(distance)
    values = np.stack([np.array(distance), *np.zeros((3, n))])
    of = {"drawn": np.zeros((4, n)), "error": np.stack([np.array(error)] * 4)}
    verdict = Verdict(values=values, delta=np.array(delta), draws=np.full(n, 16_384), **of)
    monkeypatch.setattr(sys.modules["radar_sense.analyses.validate"], "judge", lambda *_: verdict)
    s = scenario(geometry__azimuth_deg={"start": 0, "stop": 10 * n - 10, "step": 10})
    return analyses.validate(s, **{"digits": 1, **options})


def test_different_unknown_and_poses_without_a_result_are_told_apart(monkeypatch):
    """The poses agree, differ, are not known, without a result, and wrong where δ is least."""
    distance, error = [0.1, 0.4, 0.2, np.nan, 0.01], [0.01, 0.01, 0.06, 0.01, 0.0]
    poses = monkeypatch, distance, error, [0.1, 0.1, 0.1, 0.1, 5e-8]
    result = judged(*poses)
    assert result.report[:6] == (
        "linear DIFFERS from draws at 10, 40 deg, to 1 significant digit of sigma (medium)",
        "linear has no result at 30 deg",
        "NOT KNOWN whether linear agrees with draws at 20 deg",
        "  2,097,152 draws a pose, the most allowed, are too few",
        "  agrees at 1 of 5 poses",
        "  worst: mean off by 0.01 +/- 0 at 40 deg (tolerance 5e-08)",
    )
    summary = result.summary
    assert (summary["poses_agree"], summary["poses_differ"]) == (1, 3)
    assert summary["poses_undecided"] == 1
    assert summary["largest_distance_by_delta"]["mean"]["value"] == pytest.approx(2e5)
    two = judged(*poses, digits=2).report
    assert two[0].endswith("2 significant digits of sigma (medium)")
    assert two[3].endswith("are too few; fewer --digits need fewer")
    own = judged(*poses, method="automatic").report  # here the mean is off, and no bound
    assert "  a bound is off by 0 at most; automatic asks for 0.005, or a tenth if small" in own


@pytest.mark.parametrize(
    ("error", "answer"), [(0.01, "linear agrees with draws at all"), (0.06, "NOT KNOWN whether")]
)
def test_too_few_draws_are_not_agreement(monkeypatch, error, answer):
    """The draws agree with the method where they are stable, and may be too few at one pose."""
    result = judged(monkeypatch, [0.0, 0.0], [0.01, error], [0.1, 0.1])
    assert result.passed == (error == 0.01)
    assert result.report[0].startswith(answer)


def test_poses_without_a_band_have_no_coverage():
    s = rs.load_scenario("configs/spikeball.yaml")
    s = s.at_poses(np.arange(0, len(s.aircraft), 4))
    found = analyses.montecarlo(s, method="form")
    has_none = np.isnan(found.table["lower_3sigma"])
    coverage = found.table["coverage_3sigma"]
    assert has_none.any()
    np.testing.assert_array_equal(np.isnan(coverage), has_none)
    overall = coverage[~has_none].mean()
    assert overall > 0.99
    assert found.summary["coverage_overall"] == overall
    assert found.summary["coverage_lowest"]["value"] == np.nanmin(coverage)
    assert found.summary["poses_without_band"] == has_none.sum()
    assert any(f"{has_none.sum()} of {len(coverage)} poses have no" in x for x in found.report)
    assert f"{overall:.2%} of the draws" in found.report[0]
    nowhere = analyses.montecarlo(s.at_poses(np.flatnonzero(has_none)[:2]), method="form")
    assert "no coverage" in nowhere.report[0]
    assert np.isnan(nowhere.summary["coverage_overall"])


def rcs_of(rows, head="azimuth_deg,elevation_deg,rcs_dbsm", **changes):
    """Return what `rcs` says of a table, which is written to the current folder."""
    Path("rcs.csv").write_text(csv_text(head, rows))
    rcs = {"model": "table", "file": "rcs.csv"}
    return analyses.rcs(scenario(aircraft__rcs=rcs, **changes)).report


@pytest.mark.parametrize("elevations", [(), (-30, 30)])
def test_a_table_by_azimuth_only_is_the_same_at_any_elevation(here, elevations):
    rows = [
        (a, *e, 1 + min(a, 360 - a) / 90)
        for a in range(0, 360, 45)
        for e in ([(e,) for e in elevations] or [()])
    ]
    head = "azimuth_deg,elevation_deg,rcs_m2" if elevations else "azimuth_deg,rcs_m2"
    # a table says nothing beyond its elevations
    end = "any elevation of the table" if elevations else "any elevation"
    largest, *_ = rcs_of(rows, head, radar__position_m=[0, 0, -3e3])
    assert largest == f"largest RCS 4.8 dBsm at azimuth -180 deg, {end}"


def test_the_extremes_of_an_rcs_are_found_between_the_steps_of_its_table(here):
    rows = [(a + 0.125, 20 if a == 35 else -10) for a in range(-180, 180)]
    found, *_ = rcs_of(rows, "azimuth_deg,rcs_dbsm")
    assert found == "largest RCS 20.0 dBsm at azimuth 35.125 deg, any elevation"
    lobes = {"model": "spikeball", "lobes": 7, "amplitude_m2": 0.18, "floor_m2": 0.1}
    largest, smallest, *_ = analyses.rcs(scenario(aircraft__rcs=lobes)).report
    assert largest.startswith("largest RCS -5.5 dBsm at 7 of ")
    assert smallest.startswith("smallest RCS -10.0 dBsm at 7 of ")


def test_the_extremes_of_an_rcs_are_found_between_the_elevations_of_its_table(here):
    """The natural and clamped curves through the nodes swing beyond both."""
    levels = {e: 10 if e in (0, 5) else 0 for e in range(-20, 21, 5)}
    rows = [(a, e, level) for a in range(-180, 180, 10) for e, level in levels.items()]
    largest, smallest, *_ = rcs_of(rows)
    assert largest == "largest RCS 12.0 dBsm at any azimuth, elevation 2.5 deg"
    assert smallest.startswith("smallest RCS -1.0 dBsm at any azimuth, elevation -")


@pytest.mark.all_draws
def test_compare_tells_methods_apart_where_p_d_is_small():
    """A bound of 1e-5 that is off by a factor of ten is off, though four digits show 0."""
    s = scenario(
        radar__p_fa=1e-8,
        radar__detector="swerling1",
        aircraft__rcs={"model": "constant", "rcs_m2": 0.1},
        geometry__range_km=1300,
        geometry__azimuth_deg={"start": 90, "stop": 90, "step": 1},
        uncertainty__radar={"medium": {"position_m": 10, "constant": 50}},
    )
    result = analyses.compare(s)
    assert result.table["mc_upper"][0] < 5e-5
    assert "linear" in result.summary["methods_told"]


def test_an_extreme_on_a_cross_is_not_said_to_be_everywhere():
    """An oblate body is smallest at elevation 0, and at any elevation from ahead and behind."""
    disc = {"model": "ellipsoid", "a_m": 1.0, "b_m": 0.1, "c_m": 1.0}
    result = analyses.rcs(scenario(aircraft__rcs=disc))
    smallest = result.report[1]
    sigma = result.table["rcs_m2"]
    count = np.count_nonzero(np.isclose(sigma, sigma.min(), rtol=1e-9, atol=0))
    assert smallest.startswith(f"smallest RCS -15.0 dBsm in {count} directions, the first at ")
