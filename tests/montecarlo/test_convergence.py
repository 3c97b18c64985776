"""Convergence of Monte Carlo: the control variate, the estimators, and the measured errors."""

import json
from contextlib import contextmanager, nullcontext
from importlib import import_module
from pathlib import Path

import chain_rule
import numpy as np
import pytest
from helpers import OVERHEAD, dashes, lay_out, legend_off_data, scenario, single

from radar_sense.analyses.convergence import (
    ESTIMATORS,
    REFERENCES,
    REPLICATIONS,
    STATISTICS,
    Convergence,
    LinearModel,
    controlled,
    convergence,
    draw,
    measure,
    plain,
    rate,
)
from radar_sense.axis import azimuth
from radar_sense.covariance import draws
from radar_sense.errors import ScenarioError
from radar_sense.montecarlo.montecarlo import TAIL
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.montecarlo.sequences import SAMPLERS, Random
from radar_sense.propagation import propagate_scenario
from radar_sense.reading.parse import load_scenario
from radar_sense.streams import random_stream

THREE = {"start": 15, "stop": 85, "step": 35}
#: An uncertain radar constant that is often cut off at 0.
CUT = {"only": {"position_m": 100, "constant": 100}}
#: Straight below the aircraft, a radar that is so weak, 13 km away, that P_D is 0.6.
WEAK = {
    **OVERHEAD,
    "radar__constant": 4e-5,
    "uncertainty__radar": {"only": {"position_m": 1, "constant": 2e-6}},
    "analysis": {"level": "only"},
}
NOTHING = {
    "uncertainty": {
        "aircraft": {"position_m": 0, "attitude_deg": 0},
        "radar": {"none": {"position_m": 0, "constant": 0}},
    },
    "analysis": {"level": "none"},
}


def measured_with(replications, s, runs):
    """Measure with another number of repetitions."""
    with pytest.MonkeyPatch.context() as patch:
        module = import_module("radar_sense.analyses.convergence")
        patch.setattr(module, "REPLICATIONS", replications)
        return measure(s, runs)


@contextmanager
def small_blocks():
    """Use small blocks, because blocks of 4096 runs take a second."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(import_module("radar_sense.analyses.convergence"), "BLOCK", 64)
        yield


@pytest.fixture
def _small_blocks():
    with small_blocks():
        yield


def sampler_and_linear(s):
    sampler = Sampler.of(s)
    return sampler, LinearModel.of(sampler)


def rms(values, axis=None):
    return np.sqrt(np.mean(np.square(values), axis=axis))


# The linear model.


def test_the_linear_model_is_that_of_the_paper_before_the_cut():
    """L − P̄_D = A_a (a − ā) + A_r (r − r̄), with the gradient by the paper's own chain rule."""
    s = load_scenario("configs/covariance.yaml")
    sampler, linear = sampler_and_linear(s)
    radar_normals, aircraft_normals = Random(1, 50, len(s.aircraft)).block(0)
    found = linear.deviation(radar_normals, aircraft_normals)
    radar = draws(np.zeros(4), sampler.sqrt_cov_radar, radar_normals)
    aircraft = draws(np.zeros((len(s.aircraft), 6)), sampler.sqrt_cov_aircraft, aircraft_normals)
    rcs = s.resolved()["aircraft"]["rcs"]
    assert rcs["model"] == "ellipsoid"
    _, by_aircraft, by_radar = chain_rule.linearize(
        s.aircraft,
        np.tile(s.radar, (len(s.aircraft), 1)),
        ("ellipsoid", rcs["a_m"], rcs["b_m"], rcs["c_m"]),
        single(s).p_fa,
    )
    expected = np.einsum("ri,ni->rn", radar, by_radar)
    expected += np.einsum("rni,ni->rn", aircraft, by_aircraft)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * linear.std.max())
    np.testing.assert_allclose(linear.std, propagate_scenario(s).std, rtol=1e-12)


def test_the_linear_model_is_normal_where_the_radar_constant_is_cut():
    s = scenario(geometry__azimuth_deg=THREE, uncertainty__radar=CUT, analysis={"level": "only"})
    sampler, linear = sampler_and_linear(s)
    radar_normals, aircraft_normals = Random(2, 20_000, 3).block(0)
    assert sampler.draw_radar(radar_normals)[1].sum() > 500
    unit = linear.deviation(radar_normals, aircraft_normals) / linear.std
    error = 1 / np.sqrt(20_000)
    assert np.max(abs(unit.mean(axis=0))) < 4 * error
    assert np.max(abs(unit.std(axis=0) - 1)) < 4 * error / np.sqrt(2)
    # without the cut the skewness is 0
    assert np.max(abs(np.mean(unit**3, axis=0))) < 4 * np.sqrt(15) * error


def test_the_draws_are_those_of_monte_carlo_whatever_the_runs():
    s = scenario(geometry__azimuth_deg=THREE)
    sampler, linear = sampler_and_linear(s)
    for kind in SAMPLERS:
        many, deviation = draw(sampler, linear, kind, 5, 5000)
        few, _ = draw(sampler, None, kind, 5, 4500)
        np.testing.assert_array_equal(many[:4500], few)
        # On the same draws the residual of P_D is of second order, and small.
        rest = many - sampler.model.p_d(s.aircraft, s.radar) - deviation
        assert np.all(rest.std(axis=0) < 0.2 * many.std(axis=0))


# The estimators.


def test_plain_estimates_are_numpys():
    p_d = np.random.default_rng(1).random((3000, 4))
    for rows in (p_d, p_d[:2], p_d[:741], p_d[:743]):
        found = plain(rows)
        quantiles = np.quantile(rows, [TAIL, 1 - TAIL], axis=0)
        expected = [rows.mean(axis=0), rows.std(axis=0, ddof=1), *quantiles]
        np.testing.assert_allclose(found, expected, rtol=1e-13)


@pytest.mark.parametrize("runs", [2, 30, 3000, 20_000])
def test_controlled_estimates_are_as_defined(runs):
    rng = np.random.default_rng(runs)
    scale = np.array([0.01, 0.02, 0.05])
    deviation = rng.standard_normal((runs, 3)) * scale
    p_d = 0.5 + deviation + rng.standard_normal((runs, 3)) * 0.1 * scale
    found = controlled(p_d, deviation, scale)
    for j, sigma in enumerate(scale):
        p, d = p_d[:, j].tolist(), deviation[:, j].tolist()
        mean_p, mean_d = sum(p) / runs, sum(d) / runs
        variance = sum((x - mean_p) ** 2 for x in p) - sum((x - mean_d) ** 2 for x in d)
        variance = max(variance / (runs - 1) + sigma**2, 0)
        assert found[0, j] == pytest.approx(mean_p - mean_d, rel=1e-12)
        assert found[1, j] == pytest.approx(np.sqrt(variance), rel=1e-9)
        low = np.quantile(p, sum(x < -3 * sigma for x in d) / runs)
        high = np.quantile(p, 1 - sum(x > 3 * sigma for x in d) / runs)
        np.testing.assert_allclose(found[2:, j], [low, high], rtol=1e-10)


def test_a_linear_p_d_is_known_after_a_few_runs():
    """For a linear model the control removes the whole error of mean, σ and ranks of quantiles."""
    sigma = np.array([0.02])
    deviation = np.random.default_rng(3).standard_normal((5000, 1)) * sigma
    found = controlled(0.4 + deviation, deviation, sigma)
    np.testing.assert_allclose(found[:2, 0], [0.4, 0.02], rtol=1e-13)
    # between the draws next to −3σ_L
    below = np.sort(deviation[:, 0])
    rank = np.searchsorted(below, -0.06)
    assert 0.4 + below[rank - 1] <= found[2, 0] <= 0.4 + below[rank]


@pytest.mark.parametrize(
    ("kind", "runs", "times", "level"),
    [("random", 64, 2000, "medium"), ("random", 64, 2000, "high"), ("sobol", 64, 200, "high")],
)
def test_the_controlled_mean_and_variance_are_unbiased(kind, runs, times, level):
    """The mean over many repetitions of few runs is within 4.5 standard errors."""
    s = scenario(geometry__azimuth_deg=THREE, analysis__level=level)
    sampler, linear = sampler_and_linear(s)
    true = plain(draw(sampler, None, "sobol", 99, 2**15)[0])  # wrong by 1e-4 σ or so
    if kind == "random":
        drawn = [a.reshape(times, runs, 3) for a in draw(sampler, linear, kind, 1, runs * times)]
        parts = zip(*drawn, strict=True)
    else:
        parts = (draw(sampler, linear, kind, seed, runs) for seed in range(times))
    found = np.stack([controlled(p, d, linear.std)[:2] for p, d in parts])
    found[:, 1] **= 2
    error = found.std(axis=0, ddof=1) / np.sqrt(times)
    z = (found.mean(axis=0) - [true[0], true[1] ** 2]) / error
    assert np.max(abs(z)) < 4.5
    # and that can tell: of σ_pd the mean to 1 %, of its square to 4 %
    assert np.all(error < np.array([[0.01], [0.04]]) * [true[1], true[1] ** 2] / 4.5)


def test_the_control_variate_removes_the_correlated_error():
    """The control reduces the error of the mean by std(P − L)/std(P).

    The factor is √(1 − ρ²) if the slope of P on L is 1.
    """
    runs, times = 64, 4000
    s = scenario(geometry__azimuth_deg=THREE)
    sampler, linear = sampler_and_linear(s)
    p_d, deviation = draw(sampler, linear, "random", 1, runs * times)
    parts = [a.reshape(times, runs, 3) for a in (p_d, deviation)]
    found = np.stack([controlled(p, d, linear.std)[0] for p, d in zip(*parts, strict=True)])
    without = parts[0].mean(axis=1)
    reduction = found.std(axis=0) / without.std(axis=0)
    expected = (p_d - deviation).std(axis=0) / p_d.std(axis=0)
    # a standard deviation of so many has the relative error 1/√(2 times)
    assert np.max(abs(reduction / expected - 1)) < 4.5 / np.sqrt(times)
    rho = [np.corrcoef(p_d[:, i], deviation[:, i])[0, 1] for i in range(3)]
    by_correlation = np.sqrt(1 - np.square(rho))
    assert np.all(by_correlation < 0.2)
    np.testing.assert_allclose(reduction, by_correlation, rtol=0.2)  # the slope is not quite 1


# The errors.


@pytest.fixture(scope="module")
def measured():
    """The paper's scenario with fewer runs than by default."""
    return measured_with(64, load_scenario(), 2**11)


def test_random_errors_fall_as_the_root_of_runs(measured):
    """Errors fall from the first to the last number of runs, within four standard errors.

    RMS values of R repetitions have a relative error of 1/√(2R) at most. The poses increase R.
    """
    runs, repetitions = measured.runs, 64
    error = np.sqrt(2) / np.sqrt(2 * repetitions) / np.log(runs[-1] / runs[0])
    for estimator in ("random", "random_control"):
        for statistic in ("mean", "std"):
            errors = measured.error(estimator, statistic)
            slope = np.log(errors[-1] / errors[0]) / np.log(runs[-1] / runs[0])
            assert slope == pytest.approx(-0.5, abs=4 * error), (estimator, statistic)
    # the mean's is σ/√n itself
    np.testing.assert_allclose(
        measured.error("random", "mean") * np.sqrt(runs), 1, atol=4 / np.sqrt(2 * repetitions)
    )


def test_sobol_points_and_control_are_better(measured):
    last = {(e, s): measured.error(e, s)[-1] for e in ESTIMATORS for s in STATISTICS}
    assert rate(measured.runs, measured.error("sobol", "mean")) < -0.9
    assert rate(measured.runs, measured.error("sobol", "std")) < -0.8
    for statistic, sobol, control, both in (
        ("mean", 50, 8, 100),
        ("std", 8, 3, 15),
        ("quantile", 1.3, 1.2, 1.2),
    ):
        plainly = last["random", statistic]
        assert plainly > sobol * last["sobol", statistic]
        assert plainly > control * last["random_control", statistic]
        assert plainly > both * last["sobol_control", statistic]


def test_the_reference_is_four_times_better_than_every_estimate(measured):
    for statistic in STATISTICS:
        least = min(measured.error(e, statistic)[-1] for e in ESTIMATORS)
        assert measured.reference_rms(statistic) < least / 4


def test_the_reference_agrees_with_form(measured):
    """The reference is `form`, with an error of up to 1.3e-6 in the mean, 0.04 % in σ and 6e-5 in
    the bounds.
    """
    s = load_scenario()
    form = propagate_scenario(s, method="form")
    at = np.searchsorted(s.theta_r_deg, measured.axis.values)
    np.testing.assert_array_equal(s.theta_r_deg[at], np.arange(0, 181, 10))
    exact = np.stack([form.mean, form.std, form.lower, form.upper])[:, at]
    known = np.stack([np.full(19, 1.3e-6), 4e-4 * exact[1], *np.full((2, 19), 6e-5)])
    difference = abs(measured.reference - exact)
    # a standard error from 8 values: Student's t with 7 degrees, 1e-5 beyond 10
    assert np.all(difference < known + 10 * measured.reference_error)
    assert np.all(measured.reference_error[:2] < 1e-3 * exact[1])


def test_errors_are_root_mean_squares_in_units_of_sigma():
    reference = np.array([[0.5, 0.6], [0.1, 0.2], [0.2, 0.1], [0.8, 0.9]])
    off = np.zeros((3, 1, 4, 2))
    off[0, 0] = [[0.03, 0.0], [0.0, 0.08], [0.03, 0.0], [0.0, 0.12]]
    found = Convergence(
        runs=np.array([8]),
        axis=azimuth(np.zeros(2)),
        reference=reference,
        reference_error=off[0, 0],
        estimates={"random": reference + off},
    )
    # 0.3 σ, 0.4 σ, and 0.3 σ and 0.6 σ, at one of three repetitions and one of two poses
    square = {"mean": 0.3**2 / 2, "std": 0.4**2 / 2, "quantile": (0.3**2 + 0.6**2) / 4}
    for statistic in STATISTICS:
        assert found.error("random", statistic) ** 2 == pytest.approx([square[statistic] / 3])
        assert found.reference_rms(statistic) ** 2 == pytest.approx(square[statistic])


def test_the_reference_is_the_mean_of_independent_sequences_with_its_standard_error():
    s = load_scenario().at_poses(slice(0, 5))
    measured = measured_with(1, s, 64)
    seeds = random_stream(s.seed, 2**32 - 3).integers(2**63, size=REFERENCES)
    drawn = [draw(Sampler.of(s), None, "sobol", int(seed), 8 * 64)[0] for seed in seeds]
    p = [TAIL, 1 - TAIL]
    each = np.array([[d.mean(0), d.std(0, ddof=1), *np.quantile(d, p, axis=0)] for d in drawn])
    np.testing.assert_allclose(measured.reference, sum(each) / 8, rtol=1e-13)
    variance = sum((each - sum(each) / 8) ** 2) / 7
    np.testing.assert_allclose(measured.reference_error, np.sqrt(variance / 8), rtol=1e-8)


def test_rate_of_what_falls_as_a_power():
    runs = np.array([8, 16, 32, 64, 128])
    assert rate(runs, 3.0 * runs**-0.75) == pytest.approx(-0.75)
    more = np.concatenate([[1, 2, 4], runs])  # the rate is of the last five numbers of runs
    assert rate(more, np.concatenate([[9, 9, 1], 3.0 * runs**-0.75])) == pytest.approx(-0.75)
    assert np.isnan(rate(runs[:1], np.ones(1)))
    assert np.isnan(rate(runs, np.zeros(5)))


# The analysis.


@pytest.fixture(scope="module")
def small():
    with small_blocks():
        return convergence(load_scenario(), runs=100)


def test_columns_and_sizes(small):
    assert list(small.table) == [
        "runs",
        *(f"error_{statistic}_{name}" for statistic in STATISTICS for name in ESTIMATORS),
    ]
    np.testing.assert_array_equal(small.table["runs"], [2, 4, 8, 16, 32, 64])
    assert small.scenario.runs == 64
    nine = measured_with(2, load_scenario(), 1024).runs
    np.testing.assert_array_equal(nine, 2 ** np.arange(2, 11))
    assert np.all([np.isfinite(column).all() for column in small.table.values()])
    assert small.warnings == ()
    last = small.summary["at_largest_runs"]["mean"]
    assert last["random"]["random_runs_for_the_same"] == pytest.approx(64)
    ratio = last["random"]["error"] / last["sobol"]["error"]
    assert last["sobol"]["random_runs_for_the_same"] == pytest.approx(64 * ratio**2)


@pytest.mark.usefixtures("_small_blocks")
def test_workers_do_not_change_a_bit_and_seeds_do(small):
    shown = []

    def progress(total, what):
        shown.append([total])
        return nullcontext(shown[-1].append)

    again = convergence(load_scenario(), runs=64, workers=3, progress=progress)
    ((total, *steps),) = shown
    assert total == sum(steps) == REPLICATIONS + REFERENCES
    other = convergence(load_scenario().with_analysis(seed=2), runs=64)
    for name, column in small.table.items():
        assert column.tobytes() == again.table[name].tobytes()
        assert (name == "runs") != np.all(column != other.table[name])


@pytest.mark.usefixtures("_small_blocks")
def test_too_few_runs_show_no_rate():
    few = convergence(scenario(**WEAK), runs=2)
    assert any("1 number of runs can hardly show a rate; take 32" in w for w in few.warnings)
    assert "nan" not in "".join(few.report)
    assert "no rate" in few.report[2]
    assert np.isnan(few.summary["at_largest_runs"]["mean"]["random"]["rate"])
    assert not any("rate" in w for w in convergence(scenario(**WEAK), runs=32).warnings)


@pytest.mark.parametrize("runs", [1, 0, 2**17 + 1, 10**9])
def test_runs_beyond_the_limit(runs):
    with pytest.raises(ScenarioError, match="runs must be a whole number not less than 2 and not"):
        convergence(load_scenario(), runs=runs)


@pytest.mark.usefixtures("_small_blocks")
def test_without_a_gradient_the_control_columns_are_nan():
    result = convergence(scenario(**WEAK), runs=64)
    for name, column in result.table.items():
        assert np.isnan(column).all() == name.endswith("control")
    (warning,) = result.warnings
    assert warning == "there is no control variate, as the gradient is undefined at 0 deg"
    assert "undefined" in result.report[-1]
    assert "undefined" not in result.report[-3]


@pytest.mark.usefixtures("_small_blocks")
def test_without_uncertainty_all_errors_are_nan():
    result = convergence(scenario(**NOTHING), runs=64)
    assert all(np.isnan(v).all() for name, v in result.table.items() if name != "runs")
    (warning,) = result.warnings
    assert warning == "sigma of P_D, the unit of the errors, is zero at all 19 poses"


@pytest.mark.usefixtures("_small_blocks")
def test_poses_without_a_gradient_are_left_out():
    """The radar is straight below one of three poses; the gradient is undefined there."""
    sweep = {"start": -1e-3, "stop": 1e-3, "step": 1e-3}
    result = convergence(scenario(**WEAK | {"geometry__azimuth_deg": sweep}), runs=64)
    assert result.warnings == (
        "there is no control variate, as the gradient is undefined at 0 deg; "
        "the errors are of the other poses",
    )
    assert all(np.isfinite(column).all() for column in result.table.values())


@pytest.mark.usefixtures("_small_blocks")
def test_an_undefined_gradient_matters_only_if_uncertain():
    certain = {"position_m": 0, "attitude_deg": 0}
    level = {"only": {"position_m": 0, "constant": 2e-6}}
    s = scenario(**WEAK | {"uncertainty": {"aircraft": certain, "radar": level}})
    result = convergence(s, runs=64)
    assert not result.warnings
    assert np.all(result.table["error_mean_random_control"] > 0)


# The figure and the command.


@pytest.mark.usefixtures("_small_blocks")
@pytest.mark.parametrize(
    ("changes", "runs"),
    [({}, 2), ({}, 16), (WEAK, 16), (NOTHING, 16)],
    ids=["few", "paper", "overhead", "nothing"],
)
def test_layout(changes, runs):
    figure = lay_out(convergence(scenario(**changes), runs=runs).plot())
    assert len(figure.axes) == 3
    legend_off_data(figure)
    for axes in figure.axes:
        assert axes.get_xscale() == "log"
        assert axes.get_yscale() == ("linear" if changes is NOTHING else "log")
        lines = axes.lines[: len(ESTIMATORS)]
        assert len({line.get_marker() for line in lines}) == len(ESTIMATORS)  # tells them in grey
        assert len({dashes(line) for line in lines}) == len(ESTIMATORS)
        for text in axes.texts:
            assert axes.get_window_extent().contains(*text.get_window_extent().min)
            assert axes.get_window_extent().contains(*text.get_window_extent().max)


def test_the_guide_lines_have_their_slopes(small):
    figure = small.plot()
    for axes, powers in zip(figure.axes, ([-0.5, -1], [-0.5, -1], [-0.5]), strict=True):
        guides = axes.lines[len(ESTIMATORS) :]
        for line, power in zip(guides, powers, strict=True):
            x, y = line.get_data()
            assert np.log(y[-1] / y[0]) / np.log(x[-1] / x[0]) == pytest.approx(power)


@pytest.mark.usefixtures("_small_blocks")
def test_the_command(tool):
    code, out, err = tool("convergence", "--runs", 32, "--seed", 4, "--level", "high", "--no-plot")
    assert (code, err) == (0, "")
    assert out.splitlines()[0].startswith("RMS error with 32 runs (high)")
    assert [line.split("  ")[1] for line in out.splitlines()[2:6]] == [
        "random",
        "sobol",
        "random, control",
        "sobol, control",
    ]
    record = json.loads(Path("figures/paper_convergence.json").read_text())
    assert (record["seed"], record["summary"]["repetitions"]) == (4, REPLICATIONS)
    assert record["scenario"]["analysis"] == {"level": "high", "runs": 32, "seed": 4}
    assert len(Path("figures/paper_convergence.csv").read_text().splitlines()) == 6


def test_the_command_refuses(tool):
    for args in (("--runs", "1e6"), ("--runs", "1"), ("--sampler", "sobol")):
        code, out, err = tool("convergence", *args, "--out", "new")
        assert (code, out, len(err.splitlines())) == (2, "", 1)
        assert not Path("new").exists()


@pytest.mark.parametrize("name", ["s_band_surveillance", "path"])
def test_the_control_is_unbiased_with_parts_of_the_constant_and_a_covariance_per_pose(name):
    s = load_scenario(f"configs/{name}.yaml")
    some = s.at_poses(np.linspace(0, len(s.aircraft) - 1, 4).astype(int))
    sampler = Sampler.of(some)
    linear = LinearModel.of(sampler)
    p_d, deviation = draw(sampler, linear, "random", 3, 40_000)
    np.testing.assert_allclose(linear.std, propagate_scenario(some).std, rtol=1e-12)
    error = linear.std / np.sqrt(len(p_d))
    assert np.all(abs(deviation.mean(axis=0)) < 4.5 * error)
    assert np.all(abs(deviation.std(axis=0) / linear.std - 1) < 4.5 / np.sqrt(2 * len(p_d)))
    correlation = [np.corrcoef(p_d[:, i], deviation[:, i])[0, 1] for i in range(4)]
    assert min(correlation) > 0.6
