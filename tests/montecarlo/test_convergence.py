"""Convergence of Monte Carlo: the estimators and the measured errors."""

import numpy as np
import pytest
from helpers import OVERHEAD, dashes, known_to, lay_out, legend_off_data, scenario

from radar_sense.analyses.convergence import convergence
from radar_sense.montecarlo.convergence import (
    REFERENCES,
    REPLICATIONS,
    STATISTICS,
    draw,
    estimate,
    measure,
    rate,
)
from radar_sense.montecarlo.montecarlo import TAIL
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.montecarlo.sequences import SAMPLERS
from radar_sense.progress import listening
from radar_sense.propagation import propagate_scenario
from radar_sense.scenario_file.load import load_scenario
from radar_sense.streams import Stream, random_stream

#: Straight below the aircraft, a radar that is so weak, 13 km away, that P_D is 0.6.
WEAK = {
    **OVERHEAD,
    "radar__constant": 4e-5,
    "uncertainty__radar": {"only": {"position_m": 1, "constant": 2e-6}},
    "analysis": {"level": "only"},
}


def test_estimates_are_numpys():
    p_d = np.random.default_rng(1).random((3000, 4))
    for rows in (p_d, p_d[:2], p_d[:741], p_d[:743]):
        found = estimate(rows)
        quantiles = np.quantile(rows, [TAIL, 1 - TAIL], axis=0)
        expected = [rows.mean(axis=0), rows.std(axis=0, ddof=1), *quantiles]
        np.testing.assert_allclose(found, expected, rtol=1e-13)


@pytest.fixture(scope="module")
def measured():
    """The paper's scenario with fewer runs than by default."""
    return measure(load_scenario(), 2**11, 64)


def test_random_errors_fall_as_the_root_of_runs(measured):
    """RMS values of R repetitions have a relative error of 1/√(2R) at most."""
    runs, repetitions = measured.runs, 64
    error = np.sqrt(2) / np.sqrt(2 * repetitions) / np.log(runs[-1] / runs[0])
    for statistic in ("mean", "std"):
        errors = measured.errors[statistic]["random"]
        slope = np.log(errors[-1] / errors[0]) / np.log(runs[-1] / runs[0])
        assert slope == pytest.approx(-0.5, abs=4 * error), statistic
    # the mean's is σ/√n itself
    np.testing.assert_allclose(
        measured.errors["mean"]["random"] * np.sqrt(runs), 1, atol=4 / np.sqrt(2 * repetitions)
    )


def test_sobol_points_are_better(measured):
    assert rate(measured.runs, measured.errors["mean"]["sobol"]) < -0.9
    assert rate(measured.runs, measured.errors["std"]["sobol"]) < -0.8
    for statistic, factor in (("mean", 50), ("std", 8), ("quantile", 1.3)):
        errors = measured.errors[statistic]
        assert errors["random"][-1] > factor * errors["sobol"][-1]


def test_the_reference_is_four_times_better_than_every_estimate(measured):
    for statistic, errors in measured.errors.items():
        assert measured.reference_error[statistic] < min(e[-1] for e in errors.values()) / 4


def test_the_reference_agrees_with_form(measured):
    """The error of `form` is up to 1.3e-6 in the mean, 0.04 % in σ and 6e-5 in the bounds."""
    s = load_scenario()
    form = propagate_scenario(s, method="form")
    at = np.searchsorted(s.axis.values, measured.axis.values)
    np.testing.assert_array_equal(s.axis.values[at], np.arange(0, 181, 15))
    exact = np.stack([form.mean, form.std, form.lower, form.upper])[:, at]
    known = np.stack([np.full(13, 1.3e-6), 4e-4 * exact[1], *np.full((2, 13), 6e-5)])
    difference = abs(measured.reference - exact)
    # ten standard errors, averaged over poses
    error = {name: 10 * e * exact[1] for name, e in measured.reference_error.items()}
    assert np.all(difference < known + [error[n] for n in ("mean", "std", "quantile", "quantile")])
    assert measured.reference_error["mean"] < 1e-3
    assert measured.reference_error["std"] < 1e-3


def test_the_reference_is_the_mean_of_independent_sequences_with_its_standard_error():
    s = load_scenario().at_poses(slice(0, 5))
    measured = measure(s, 64, 1)
    seeds = random_stream(s.seed, Stream.REPETITIONS).integers(2**63, size=REFERENCES)
    drawn = [draw(Sampler(s.states()), "sobol", int(seed), 2 * 64) for seed in seeds]
    p = [TAIL, 1 - TAIL]
    each = np.array([[d.mean(0), d.std(0, ddof=1), *np.quantile(d, p, axis=0)] for d in drawn])
    np.testing.assert_allclose(measured.reference, sum(each) / 8, rtol=1e-13)
    variance = sum((each - sum(each) / 8) ** 2) / 7
    relative = np.sqrt(variance / 8) / (sum(each) / 8)[1]
    for name, rows in {"mean": [0], "std": [1], "quantile": [2, 3]}.items():
        expected = np.sqrt(np.mean(relative[rows] ** 2))
        assert measured.reference_error[name] == pytest.approx(expected, rel=1e-8)


@pytest.fixture(scope="module")
def small():
    return convergence(load_scenario(), runs=100)


def test_columns_and_sizes(small):
    assert list(small.table) == [
        "runs",
        *(f"error_{statistic}_{name}" for statistic in STATISTICS for name in SAMPLERS),
    ]
    np.testing.assert_array_equal(small.table["runs"], [2, 4, 8, 16, 32, 64])
    assert small.scenario.runs == 64
    nine = measure(load_scenario(), 1024, 2).runs
    np.testing.assert_array_equal(nine, 2 ** np.arange(2, 11))
    assert np.all([np.isfinite(column).all() for column in small.table.values()])
    assert small.warnings == ()
    assert small.report[0].startswith("RMS error with 64 runs (medium)")
    assert [line.split()[0] for line in small.report[2:4]] == ["random", "sobol"]
    last = small.summary["at_largest_runs"]["mean"]
    assert last["random"]["random_runs_for_the_same"] == pytest.approx(64)
    ratio = last["random"]["error"] / last["sobol"]["error"]
    assert last["sobol"]["random_runs_for_the_same"] == pytest.approx(64 * ratio**2)


def test_workers_do_not_change_a_bit_and_seeds_do(small):
    shown = []

    with listening(lambda *args: shown.append(args)):
        again = convergence(load_scenario(), runs=64, workers=3)
    steps = REPLICATIONS + REFERENCES
    assert shown == [("repetitions", i, steps) for i in range(1, steps + 1)]
    other = convergence(load_scenario().with_analysis(seed=2), runs=64)
    for name, column in small.table.items():
        assert column.tobytes() == again.table[name].tobytes()
        assert (name == "runs") != np.all(column != other.table[name])


def test_too_few_runs_show_no_rate():
    few = convergence(scenario(**WEAK), runs=2)
    assert any("too few numbers of runs for a rate: 1; take 32" in w for w in few.warnings)
    assert "nan" not in "".join(few.report)
    assert "no rate" in few.report[2]
    assert np.isnan(few.summary["at_largest_runs"]["mean"]["random"]["rate"])
    assert not any("rate" in w for w in convergence(scenario(**WEAK), runs=32).warnings)


def test_without_uncertainty_all_errors_are_nan():
    """The figure then has no logarithmic errors, which cannot show 0."""
    result = convergence(scenario(**known_to()), runs=64)
    assert all(np.isnan(v).all() for name, v in result.table.items() if name != "runs")
    text = "sigma of P_D, the unit of the errors, is zero in the draws at all 13 poses [sigma-zero]"
    assert result.warnings == (text,)
    figure = lay_out(result.plot())
    legend_off_data(figure)
    assert [(axes.get_xscale(), axes.get_yscale()) for axes in figure.axes] == [
        ("log", "linear")
    ] * 3


def test_a_pose_whose_sigma_few_draws_know_is_no_unit():
    """Beside a limit of range P_D is 0 in nearly all draws: only the poses within it are compared.

    The radar and its place are certain; the aircraft is 3 sigma beyond the limit.
    """
    s = scenario(
        geometry={
            "type": "radial", "azimuth_deg": 0, "down_km": -3, "azimuth_from": "north",
            "range_km": {"start": 99, "stop": 100.4, "step": 0.7},
        },
        radar__constant=1.0,
        radar__max_range_km=100,
        **known_to(130, 1),
    )  # fmt: skip
    result = convergence(s, runs=512)
    (warned,) = (text for text in result.warnings if text.endswith("[reference-imprecise]"))
    assert "no better than 10% at 100.4 km; the errors are of the other poses" in warned
    errors = result.table["error_std_random"]
    assert errors[-1] < 0.2


def test_a_tail_that_the_reference_has_missed_is_no_unit(monkeypatch):
    """One random draw of one repetition has hit it."""

    hits = []

    def drawn(sampler, kind, seed, runs):
        p_d = 0.5 + 1e-6 * np.random.default_rng(seed).standard_normal((runs, 13))
        if kind == "random" and not hits:
            p_d[-1, 3] = 1.0
            hits.append(seed)
        return p_d

    monkeypatch.setattr("radar_sense.montecarlo.convergence.draw", drawn)
    found = measure(scenario(), 2**9)
    assert np.flatnonzero(found.unknown).tolist() == [3]
    assert found.errors["mean"]["random"][-1] == pytest.approx(2**-4.5, rel=0.3)


def test_lines_of_the_figure(small):
    """Markers and dashes tell samplers in grey, guide lines have their slopes, and names fit."""
    figure = lay_out(small.plot())
    for axes, powers in zip(figure.axes, ([-0.5, -1], [-0.5, -1], [-0.5]), strict=True):
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
        lines, guides = axes.lines[: len(SAMPLERS)], axes.lines[len(SAMPLERS) :]
        for of in (lambda line: line.get_marker(), dashes):
            assert len({of(line) for line in lines}) == len(SAMPLERS)
        for line, power in zip(guides, powers, strict=True):
            assert rate(*line.get_data()) == pytest.approx(power)
        for text in axes.texts:
            box = text.get_window_extent()
            assert axes.get_window_extent().contains(*box.min)
            assert axes.get_window_extent().contains(*box.max)


def test_rate_of_what_falls_as_a_power():
    runs = np.array([1, 2, 4, 8, 16, 32, 64, 128])  # the rate is of the last five
    errors = np.concatenate([[9, 9, 1], 3.0 * runs[3:] ** -0.75])
    assert rate(runs, errors) == pytest.approx(-0.75)
    assert np.isnan([rate(runs[:1], np.ones(1)), rate(runs, np.zeros(8))]).all()
