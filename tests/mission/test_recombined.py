"""Bounds of missions against plain loops that share no code with the package."""

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers import document, mission, with_arrays, yaml_text
from mission.plain import PlainMissions
from scipy.special import ndtr
from studies.bands import cases

import radar_sense as rs
from radar_sense import words
from radar_sense.mission import recombined
from radar_sense.mission.bounds import PARTS, Weighted, pooled, pooled_quantiles, upper_tails
from radar_sense.mission.draws import draw_missions
from radar_sense.mission.looks import Looks
from radar_sense.mission.recombined import combine, recombined_missions
from radar_sense.progress import listening

ROUTE = """time_s,north_m,east_m,down_m,roll_deg,pitch_deg,yaw_deg
0,60e3,-40e3,-6000,0,0,90
60,55e3,0,-6000,0,0,90
120,60e3,40e3,-6000,0,0,90
"""
#: Place, J m²/K, period, and standard deviations of the place and of the constant in decibels.
RADARS = {
    "one": ((0.0, 0.0, -20.0), 0.006, 8, 2000.0, 2.0),
    "two": ((10e3, 20e3, -20.0), 0.002, 8, 3000.0, 1.0),
    "three": ((20e3, -20e3, -20.0), 0.001, 10, 1500.0, 3.0),
}
P_FA = 1e-4
RANKS = ndtr(-3.0) * PARTS
SIGMA = 0.05  # m²
SHEET = {
    **{"peak_power_kw": 1.0, "gain_dbi": 40, "frequency_ghz": 9, "pulse_width_us": 10},
    **{"temperature_k": 290, "loss_db": 8, "noise_figure_db": 5},
}


def mission_document(names, tau, pose=800, *, every=None, weaker=1.0, rcs_db=0, **changes):
    """Return a document, with another period of all radars and weaker ones if wanted."""
    content = document(
        geometry={"type": "path", "file": "route.csv"}, name="flight", analysis={"level": "one"}
    )
    del content["aircraft"]["attitude_deg"], content["radar"]
    content["aircraft"]["rcs"] = {"model": "constant", "rcs_m2": SIGMA}
    content["uncertainty"] = {
        "aircraft": {"position_m": pose, "attitude_deg": 1, "rcs_db": rcs_db},
        "aircraft_correlation_s": tau if math.isfinite(tau) else ".inf",
    }
    content["radars"] = []
    for name in names:
        place, constant, period, std, decibels = RADARS[name]
        power = weaker * constant / cases.sheet_constant(SHEET)
        content["radars"].append({
            "name": name, "position_m": list(place), "tracking": {**SHEET, "peak_power_kw": power},
            "p_fa": P_FA, "detector": "swerling1", "scan_period_s": every or period,
            "uncertainty": {"one": {"position_m": std, "constant": {"loss_db": decibels}}},
        })  # fmt: skip
    return content | changes


def load(folder, *args, **options):
    (folder / "route.csv").write_text(ROUTE)
    (folder / "my.yaml").write_text(yaml_text(mission_document(*args, **options)))
    return rs.load_scenario(folder / "my.yaml")


def drawn_interval(rows, level):
    """Interval of the quantile of rows (K, runs), of three standard errors of the rank."""
    rows, rank = np.sort(rows, axis=1), level * rows.shape[1]
    error = 3 * math.sqrt(rows.shape[1] * level * (1 - level))
    return [rows[:, int(np.clip(r, 0, rows.shape[1] - 1))] for r in (rank - error, rank + error)]


def test_radars_with_tolerances_of_their_own_are_drawn_apart(tmp_path):
    """Their variances are sums of squares, which round differently in a network and alone."""
    s, rng = load(tmp_path, ("one", "two", "three"), 60.0), np.random.default_rng(1)
    for _ in range(10):
        radars = []
        for radar in s.radars:
            std = rng.uniform(0.1, 1.0, size=4)
            parts = [rs.Tolerance(f"part_{i}", 5.0, x, -1, True) for i, x in enumerate(std)]
            level = rs.Level(radar.levels["one"].covariance, tuple(parts))
            radars.append(replace(radar, levels={"one": level}))
        looks = Looks.of(replace(s, radars=tuple(radars)))
        assert len(recombined._Plan.of(looks, None, RANKS).states) == 3


@pytest.mark.parametrize(
    ("of_all", "paths", "draws"), [(256, 256, 1), (370, 185, 2), (991, 123, 8)]
)
def test_many_looks_leave_enough_paths_for_a_tail(tmp_path, monkeypatch, of_all, paths, draws):
    """Time is saved at the draws of a path, and not at the paths."""
    looks = Looks.of(load(tmp_path, ("one", "two", "three"), 60.0))
    monkeypatch.setattr(recombined, "LOOKS", of_all * sum(map(len, looks.times)) + 1)
    plan = recombined._Plan.of(looks, None, RANKS)
    assert (plan.paths, plan.draws) == (paths, draws)


@pytest.mark.parametrize(
    ("names", "tau", "pose", "changes"),
    [(["one"], 0.0, 800, {}),
     (["one", "three"], math.inf, 5000, {}),
     (["one", "two", "three"], 60.0, 800, {}),
     # one error of the RCS for all radars and looks
     (["one", "two"], 60.0, 800, {"rcs_db": 1.5}),
     # by each of many looks: the bounds rise within a look or two
     (["one", "three"], 0.0, 800, {"every": 2, "weaker": 0.5})],
)  # fmt: skip
def test_bounds_are_those_of_plain_missions(tmp_path, monkeypatch, names, tau, pose, changes):
    """By all times, for the network and each radar alone, within the printed standard errors."""
    monkeypatch.setattr(recombined, "MAX_DRAWS", 2048)
    runs = 15_000
    looks = Looks.of(load(tmp_path, names, tau, pose, **changes))
    assert looks.scenario.radar[3] == pytest.approx(
        changes.get("weaker", 1.0) * RADARS[names[0]][1], rel=1e-9
    )
    found = recombined_missions(looks, (2, 3))
    assert len(found) == (1 if len(names) == 1 else 1 + len(names))
    sources = [names] + ([[name] for name in names] if len(names) > 1 else [])
    for some, events in zip(sources, found, strict=True):
        content = mission_document(some, tau, pose, **changes)
        plain = PlainMissions(content, ROUTE, runs, 1)
        own = np.searchsorted(looks.schedule.time, plain.times)
        for event, drawn in zip(events, plain.events(2, 3), strict=True):
            mean, std = drawn.mean(axis=1), drawn.std(axis=1)
            error = np.hypot(event.mean_se[own], std / math.sqrt(runs))
            assert np.all(abs(event.mean[own] - mean) <= 5 * error)
            assert np.all(event.mean_se[own] <= 0.03 * std)
            assert event.std[-1] == pytest.approx(std[-1], rel=0.06)
            for values, level, error in (
                (event.lower, 0.00135, event.lower_se), (event.upper, 0.99865, event.upper_se)
            ):  # fmt: skip
                low, high = drawn_interval(drawn, level)
                beyond = np.maximum(low - values[own], values[own] - high)
                assert np.all(beyond <= 3 * error[own] + 1e-12)
                assert error[-1] < 0.02


@pytest.fixture
def _fewer_draws(monkeypatch):
    monkeypatch.setattr(recombined, "MAX_DRAWS", 512)


@pytest.mark.usefixtures("_fewer_draws")
def test_bounds_grow_with_time_and_have_standard_errors(tmp_path):
    seen = []
    with listening(lambda *step: seen.append(step)):
        result = mission(load(tmp_path, list(RADARS), 60.0), m_of_n=(2, 3), runs=20)
    for before in ("", "track_"):
        for end in ("lower", "upper"):
            for radar in ("", *(f"_{name}" for name in RADARS)):
                bound = result.table[f"{before}{end}_3sigma{radar}"]
                assert np.diff(bound).min() >= 0
                assert result.table[f"{before}{end}_3sigma_se{radar}"].min() >= 0
    assert list(result.table)[-1] == "mean_track_se_three"
    report = "\n".join(result.report)
    assert "\nlargest standard error of a bound of all radars together: detection 0." in report
    # replicates and then runs are told
    assert [done for what, done, _ in seen if what == "replicates"] == list(range(1, 9))
    assert seen[-1] == ("runs", 20, 20)


@pytest.mark.usefixtures("_fewer_draws")
def test_imprecise_bounds_are_told_and_shown(tmp_path):
    result = mission(load(tmp_path, list(RADARS), 60.0, 4000))
    largest = {
        radar: max(result.table[f"{end}_3sigma_se{radar}"].max() for end in ("lower", "upper"))
        for radar in ("", *(f"_{name}" for name in RADARS))
    }
    named = [radar[1:] or "the mission" for radar, error in largest.items() if error > 0.01]
    (warned,) = (text for text in result.warnings if text.endswith("[band-imprecise]"))
    assert warned.startswith(f"{words.listed(named)}: a bound has a standard error above 0.01;")
    for radar in RADARS:
        error = result.table[f"upper_3sigma_se_{radar}"][-1]
        (row,) = (line for line in result.report if line.startswith(f"  {radar} "))
        shown = words.probability(result.table[f"upper_3sigma_{radar}"][-1])
        assert f" to {shown}{f' +/- {error:.1g}' if error > 0.01 else ''})" in row


@pytest.mark.usefixtures("_fewer_draws")
def test_without_uncertainty_bounds_are_the_nominal_value(tmp_path):
    certain = {"position_m": 0, "attitude_deg": 0}
    s = load(tmp_path, ["one", "two"], 60.0, uncertainty={"aircraft": certain})
    s = with_arrays(s, cov_radar={"one": np.zeros((8, 8))}, tolerances=None)
    for event in recombined_missions(Looks.of(s), (2, 3))[0]:
        for values in (event.mean, event.lower, event.upper):
            np.testing.assert_array_equal(values, event.p)
        for values in (event.std, event.lower_se, event.upper_se, event.mean_se):
            assert not values.any()


@pytest.mark.parametrize("radars", [2, 3, 30])
def test_combinations_have_the_distribution_of_independent_radars(radars):
    rng = np.random.default_rng(2)
    paths, draws = 2000, 8
    values = [1.6 * rng.standard_normal(paths * draws) for _ in range(radars)]
    for v in values:
        v[::2] /= 1.6  # half of them are not widened
    weights = [1 / (0.5 + 0.5 * np.exp(0.5 * (1 - 1.6**-2) * v * v) / 1.6) for v in values]
    picks, weight = combine(rng, weights, (paths, draws), 16)
    for pick in picks:  # of the same path
        np.testing.assert_array_equal(pick // draws, np.repeat(np.arange(paths), 16))
    picked = np.array([v[pick] for v, pick in zip(values, picks, strict=True)])
    share = weight / weight.sum()
    total = picked.sum(axis=0) / math.sqrt(radars)
    assert weight.mean() == pytest.approx(1.0, abs=0.05)
    assert np.sum(share * total) == pytest.approx(0.0, abs=0.05)
    assert np.sum(share * total**2) == pytest.approx(1.0, rel=0.06)
    np.testing.assert_allclose(share @ picked[0], 0.0, atol=0.05)
    assert 1 / np.sum(share**2) > len(share) / 20  # effective number, also of many radars
    if radars < 4:
        for tail in (total > 3, total < -3):
            assert np.sum(share[tail]) == pytest.approx(ndtr(-3.0), rel=0.3)
            assert tail.mean() > 4 * ndtr(-3.0)


def tails_of(values):
    share = np.full(values.shape[-1], 1 / values.shape[-1])
    return np.array([[upper_tails(row[np.newaxis], share, RANKS)[0] for row in v] for v in values])


def test_a_pooled_quantile_is_the_one_of_all_draws():
    """Few draws of an exponential tail: the mean of the replicates' quantiles is biased."""
    rng = np.random.default_rng(5)
    values = rng.exponential(size=(8, 40, 4000))
    tails = tails_of(values)
    exact = np.quantile(np.concatenate(values, axis=1), ndtr(3.0), axis=1, method="hazen")
    found = -pooled_quantiles(-tails, RANKS)
    np.testing.assert_allclose(found, exact, atol=0.2)
    assert np.mean(found - exact) == pytest.approx(0.0, abs=0.03)
    constant = pooled_quantiles(np.full((8, 3, len(RANKS)), 0.25), RANKS)
    np.testing.assert_allclose(constant, 0.25, rtol=1e-15)


def test_a_tail_that_is_followed_in_time_is_that_of_each_time():
    rng = np.random.default_rng(7)
    share = rng.dirichlet(np.ones(3000))
    steps = rng.exponential(size=(40, 3000)) * (rng.random((40, 3000)) < 0.01)  # few change
    values = np.cumsum(np.vstack([rng.exponential(size=3000), steps]), axis=0)
    alone = [upper_tails(row[np.newaxis], share, RANKS)[0] for row in values]
    np.testing.assert_array_equal(upper_tails(values, share, RANKS), alone)


@pytest.mark.parametrize("probability", [2e-4, 1e-3, 1.8e-3, 3e-3])
def test_a_pooled_quantile_does_not_cross_a_jump(probability):
    """Most draws are 0, as where a radar rarely sees the aircraft: the quantile is a draw."""
    rng = np.random.default_rng(6)
    seen = rng.random((8, 20, 8192)) < probability
    values = np.where(seen, rng.uniform(0.5, 0.6, seen.shape), 0.0)
    tails = tails_of(values)
    # within the step from one rank of a replicate to the next
    near = 1 - ndtr(-3.0) * np.array([1.1, 0.9])
    low, high = np.quantile(np.concatenate(values, axis=1), near, axis=1)
    found = -pooled_quantiles(-tails, RANKS)
    assert np.all((low - 0.01 < found) & (found < high + 0.01))


def test_two_replicates_differ_by_twice_the_standard_error():
    """And by twice what the difference adds to the deviation of all draws."""
    both = (Weighted(*np.array([[m], [0.09]]), *np.full((2, 1, len(RANKS)), m)) for m in (0.4, 0.6))
    found = pooled(RANKS, np.array([[0.5]]), *both)
    for error in (found.mean_se, found.lower_se, found.upper_se):
        assert error[0] == pytest.approx(0.1, rel=1e-12)
    assert found.std[0] == pytest.approx(math.hypot(0.3, 0.1), rel=1e-12)


def test_bounds_at_another_k_are_those_of_plain_draws(tmp_path, monkeypatch):
    monkeypatch.setattr(recombined, "MAX_DRAWS", 2048)
    looks = Looks.of(load(tmp_path, ("one", "two"), 30.0).with_analysis(runs=20_000))
    (network, *_) = recombined_missions(looks, k=0.5)
    (plain,), _ = draw_missions(looks, k=0.5)
    np.testing.assert_allclose(network[0].lower, plain.lower, atol=0.015)
    np.testing.assert_allclose(network[0].upper, plain.upper, atol=0.015)
