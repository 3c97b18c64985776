"""Importance sampling of missions against plain loops that share no code with the package."""

from __future__ import annotations

import dataclasses
import math
from contextlib import nullcontext

import numpy as np
import pytest
import yaml
from helpers import document, mission
from scipy.special import ndtr

import radar_sense as rs
from radar_sense.analyses.mission import with_schedule
from radar_sense.mission.importance import plan, replicates
from radar_sense.mission.importance.combinations import combine
from radar_sense.mission.importance.mixtures import Directions, Mixture, sobol_normals
from radar_sense.mission.importance.quantiles import (
    MIDDLE,
    RANKS,
    pooled_quantile,
    weighted_statistics,
)
from radar_sense.mission.importance.sampling import importance_sampling

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
SIGMA = 0.05  # m²


def load(folder, names, tau, pose=800, **changes):
    (folder / "route.csv").write_text(ROUTE)
    content = document(
        geometry={"type": "path", "file": "route.csv"}, name="flight", analysis={"level": "one"}
    )
    del content["aircraft"]["attitude_deg"], content["radar"]
    content["aircraft"]["rcs"] = {"model": "constant", "rcs_m2": SIGMA}
    content["uncertainty"] = {
        "aircraft": {"position_m": pose, "attitude_deg": 1},
        "aircraft_correlation_s": tau if math.isfinite(tau) else ".inf",
    }
    content["radars"] = []
    for name in names:
        place, _, period, std, decibels = RADARS[name]
        data_sheet = {
            "peak_power_kw": 1.0, "gain_dbi": 40, "frequency_ghz": 9, "pulse_width_us": 10,
            "temperature_k": 290, "loss_db": 8, "noise_figure_db": 5,
        }  # fmt: skip
        content["radars"].append({
            "name": name, "position_m": list(place), "tracking": data_sheet, "p_fa": P_FA,
            "detector": "swerling1", "scan_period_s": period,
            "uncertainty": {"one": {"position_m": std, "constant": {"loss_db": decibels}}},
        })  # fmt: skip
    file = folder / "my.yaml"
    for entry in content["radars"]:  # the power of the given c_r
        file.write_text(yaml.safe_dump(content, sort_keys=False))
        made = rs.load_scenario(file).radar.reshape(-1, 4)
        i = content["radars"].index(entry)
        entry["tracking"]["peak_power_kw"] = float(RADARS[entry["name"]][1] / made[i, 3])
    content.update(changes)
    file.write_text(yaml.safe_dump(content, sort_keys=False))
    return rs.load_scenario(file)


def plain_missions(names, tau, m, n, runs, seed, pose=800):
    """P_c and T at the end of each drawn mission, look by look, with no code of the package."""
    rng = np.random.default_rng(seed)
    times = sorted({t for name in names for t in range(0, 121, RADARS[name][2])})
    error = rng.standard_normal((3, runs))
    poses, last = {}, None
    for t in times:
        if last is not None:
            rho = 1.0 if math.isinf(tau) else 0.0 if tau == 0 else math.exp(-(t - last) / tau)
            error = rho * error + math.sqrt(1 - rho * rho) * rng.standard_normal((3, runs))
        nominal = [np.interp(t, [0, 60, 120], v)
                   for v in ([60e3, 55e3, 60e3], [-40e3, 0, 40e3], [-6e3] * 3)]  # fmt: skip
        poses[t] = np.array(nominal)[:, None] + pose * error
        last = t
    p_d = {}
    for name in names:
        place, constant, _, std, decibels = RADARS[name]
        at = np.array(place)[:, None] + std * rng.standard_normal((3, runs))
        c_r = constant * 10 ** (-decibels * rng.standard_normal(runs) / 10)
        for t in times:
            if t % RADARS[name][2] == 0:
                squared = np.sum((poses[t] - at) ** 2, axis=0)
                snr = c_r * SIGMA / (1.38e-23 * squared**2)
                p_d[name, t] = P_FA ** (1 / (1 + snr))
    missed = np.ones(runs)
    for value in p_d.values():
        missed = missed * (1 - value)
    untracked = np.ones(runs)
    for period in {RADARS[name][2] for name in names}:
        group = [name for name in names if RADARS[name][2] == period]
        chance = {(): np.ones(runs)}  # of the outcomes of the last n − 1 looks, with no track yet
        for t in times:
            if t % period:
                continue
            p = 1 - np.prod([1 - p_d[name, t] for name in group], axis=0)
            later = {}
            for history, value in chance.items():
                for hit in (0, 1):
                    window = (*history, hit)[-n:]
                    if sum(window) < m:
                        key = window[-(n - 1) :]
                        later[key] = later.get(key, 0) + value * (p if hit else 1 - p)
            chance = later
        untracked = untracked * sum(chance.values())
    return 1 - missed, 1 - untracked


@pytest.fixture
def _fewer_draws(monkeypatch):
    monkeypatch.setattr(plan, "MAX_TRACK_DRAWS", 1024)
    monkeypatch.setattr(replicates, "COMBINATIONS", 4096)


@pytest.mark.usefixtures("_fewer_draws")
@pytest.mark.parametrize(
    ("names", "tau", "pose"),
    [(["one"], 0.0, 800), (["one", "two"], 60.0, 800), (["one", "three"], math.inf, 5000),
     (["two"], 60.0, 8000), (["one", "two", "three"], 60.0, 800)],
)  # fmt: skip
def test_bounds_are_those_of_plain_missions(tmp_path, names, tau, pose):
    scenario, schedule = with_schedule(load(tmp_path, names, tau, pose))
    assert scenario.radar[3] == pytest.approx(RADARS[names[0]][1], rel=1e-9)
    found = importance_sampling(scenario, schedule, (2, 3))
    assert len(found) == (1 if len(names) == 1 else 1 + len(names))
    sources = [names] + ([[name] for name in names] if len(names) > 1 else [])
    for some, (detection, track) in zip(sources, found, strict=True):
        batches = [plain_missions(some, tau, 2, 3, 8_000, seed, pose) for seed in range(4)]
        for event, drawn in zip((detection, track), zip(*batches, strict=True), strict=True):
            every = np.concatenate(drawn)
            assert event.mean[-1] == pytest.approx(every.mean(), abs=0.06 * every.std())
            assert event.std[-1] == pytest.approx(every.std(), rel=0.06)
            for values, level, error in (
                (event.lower, 0.00135, event.lower_se), (event.upper, 0.99865, event.upper_se)
            ):  # fmt: skip
                quantiles = [np.quantile(one, level) for one in drawn]
                scatter = np.std(quantiles, ddof=1) / 2
                allowed = 5 * math.hypot(error[-1], scatter) + 0.003
                assert values[-1] == pytest.approx(np.quantile(every, level), abs=allowed)
                assert error[-1] < 0.02


@pytest.mark.usefixtures("_fewer_draws")
def test_bounds_grow_with_time_and_have_standard_errors(tmp_path):
    result = mission(load(tmp_path, list(RADARS), 60.0), m_of_n=(2, 3))
    for before in ("", "track_"):
        for end in ("lower", "upper"):
            for radar in ("", *(f"_{name}" for name in RADARS)):
                bound = result.table[f"{before}{end}_3sigma{radar}"]
                assert np.diff(bound).min() >= 0
                assert result.table[f"{before}{end}_3sigma_se{radar}"].min() >= 0
    assert list(result.table)[-1] == "track_upper_3sigma_se_three"
    assert any("standard error of the 3-sigma bounds at most" in line for line in result.report)


@pytest.mark.usefixtures("_fewer_draws")
def test_nodes_between_which_bounds_are_interpolated_change_little(tmp_path, monkeypatch):
    scenario, schedule = with_schedule(load(tmp_path, ["one", "three"], 60.0))
    every = importance_sampling(scenario, schedule, (2, 3))[0]
    monkeypatch.setattr(plan, "NODES", 14)
    monkeypatch.setattr(plan, "ALL_TIMES", 14)
    some = importance_sampling(scenario, schedule, (2, 3))[0]
    assert len(schedule.time) > 20
    for a, b in zip(every, some, strict=True):
        np.testing.assert_array_equal(a.p, b.p)
        assert np.max(abs(a.upper - b.upper)) < 0.12  # one look raises the bound by 0.2
        assert a.upper[-1] == pytest.approx(b.upper[-1], abs=0.02)


@pytest.mark.usefixtures("_fewer_draws")
def test_the_same_bytes_for_any_number_of_workers(tmp_path):
    scenario, schedule = with_schedule(load(tmp_path, ["one", "two", "three"], 60.0))
    one, two = (importance_sampling(scenario, schedule, (2, 3), workers=w) for w in (1, 3))
    for a, b in zip(one, two, strict=True):
        for x, y in zip(a, b, strict=True):
            assert x.upper.tobytes() == y.upper.tobytes()
            assert x.lower_se.tobytes() == y.lower_se.tobytes()
            assert x.std.tobytes() == y.std.tobytes()


@pytest.mark.usefixtures("_fewer_draws")
def test_without_uncertainty_bounds_are_the_nominal_value(tmp_path):
    certain = {"position_m": 0, "attitude_deg": 0}
    s = load(tmp_path, ["one", "two"], 60.0, uncertainty={"aircraft": certain})
    cov = {level: 0.0 * c for level, c in s.cov_radar.items()}
    parts = dict.fromkeys(cov, ((),) * 2)
    s = dataclasses.replace(s, cov_radar=cov, tolerances=parts)
    for event in importance_sampling(*with_schedule(s), (2, 3))[0]:
        for values in (event.mean, event.lower, event.upper):
            np.testing.assert_array_equal(values, event.p)
        for values in (event.std, event.lower_se, event.upper_se):
            assert not values.any()


def test_correlated_radars_are_drawn_together(tmp_path, monkeypatch):
    """Two radars whose errors are one error act as one radar that looks twice."""
    monkeypatch.setattr(plan, "MAX_TRACK_DRAWS", 2048)
    s = load(tmp_path, ["one", "two"], 60.0)
    parts = dict.fromkeys(s.cov_radar, ((),) * 2)
    std = np.array([2000.0, 2000.0, 2000.0, 0.001, 3000.0, 3000.0, 3000.0, 0.0004])
    same = np.kron(np.ones((2, 2)), np.eye(4)) * np.outer(std, std)
    apart = np.diag(std**2)
    together, independent = (
        importance_sampling(
            *with_schedule(dataclasses.replace(s, cov_radar={"one": cov}, tolerances=parts)),
            (2, 3),
        )[0][0]
        for cov in (same, apart)
    )
    rng = np.random.default_rng(3)
    runs = 40_000
    normals = rng.standard_normal((4, runs))
    drawn = []
    for u in (normals, rng.standard_normal((4, runs))):
        missed = np.ones(runs)
        for i, (name, v) in enumerate((("one", normals), ("two", u))):
            place = np.array(RADARS[name][0])[:, None] + std[4 * i : 4 * i + 3, None] * v[:3]
            c_r = np.maximum(RADARS[name][1] + std[4 * i + 3] * v[3], 0)
            for t in range(0, 121, 8):
                nominal = [np.interp(t, [0, 60, 120], w)
                           for w in ([60e3, 55e3, 60e3], [-40e3, 0, 40e3], [-6e3] * 3)]  # fmt: skip
                squared = np.sum((np.array(nominal)[:, None] - place) ** 2, axis=0)
                missed *= 1 - P_FA ** (1 / (1 + c_r * SIGMA / (1.38e-23 * squared**2)))
        drawn.append(1 - missed)
    for found, values in zip((together, independent), drawn, strict=True):
        assert found.std[-1] == pytest.approx(values.std(), rel=0.08)  # the poses add a little
    assert drawn[0].std() > 1.15 * drawn[1].std()


def test_weights_are_the_ratio_of_the_densities():
    """The weighted mean of any function equals the mean of unit normals."""
    rng = np.random.default_rng(1)
    slopes = np.array([[3.0, 1.0, 0.0], [2.0, -1.0, 0.5]])
    slopes /= np.linalg.norm(slopes, axis=1, keepdims=True)
    directions = Directions.of(slopes, np.array([1.0, 0.5]), 0.3, 0.1)
    np.testing.assert_allclose(directions.vectors.T @ directions.vectors, np.eye(2), atol=1e-12)
    runs = 200_000
    normals = rng.standard_normal((3, runs))
    weight = directions.draw(normals, rng.standard_normal((runs, 3)))
    assert weight.max() <= 1 / 0.3
    assert weight.mean() == pytest.approx(1.0, abs=0.01)
    np.testing.assert_allclose((weight * normals) @ normals.T / runs, np.eye(3), atol=0.02)
    for slope in (*slopes, *-slopes):
        tail = slope @ normals > 3
        assert weight[tail].sum() / runs == pytest.approx(0.00135, rel=0.05)
        assert tail.mean() > 50 * 0.00135


def test_a_mixture_without_far_events_is_the_unit_normals():
    normals = np.random.default_rng(2).standard_normal((100, 4))
    for targets, spread in ((0.5, 1.0), (3.0, 0.0)):
        mixture = Mixture.of(np.full((2, 3), targets / math.sqrt(3)), np.full(2, spread), 0.3, 0.1)
        draws, weight = mixture.draw(normals)
        np.testing.assert_array_equal(draws, normals[:, 1:])
        np.testing.assert_array_equal(weight, 1.0)


def test_points_of_different_streams_are_independent():
    """Two scrambled Sobol' sequences in their own order have all pairs in a few cells."""
    for stream in range(4):
        a, b = (sobol_normals(4096, 2, 1, 7, branch, stream)[:, 0] for branch in (1, 2))
        counts, _, _ = np.histogram2d(ndtr(a), ndtr(b), bins=4, range=[[0, 1], [0, 1]])
        # 9 degrees of freedom; chi-square is beyond 40 once in 130 000
        assert np.sum((counts - 256) ** 2 / 256) < 40


def test_combinations_have_the_distribution_of_independent_sources():
    rng = np.random.default_rng(2)
    paths, draws = 400, 16
    values = [2.0 * rng.standard_normal((paths, draws)) for _ in range(3)]
    weights = [2.0 * np.exp(-0.5 * v * v * (1 - 0.25)) for v in values]
    picks, weight = combine(rng, weights, values, np.array([1.0, 0.2, 0.5]), 64)
    total = sum(np.take_along_axis(v, pick, axis=1) for v, pick in zip(values, picks, strict=True))
    share = weight / weight.sum()
    assert weight.mean() == pytest.approx(1.0, abs=0.05)
    assert np.sum(share * total) == pytest.approx(0.0, abs=0.12)
    assert np.sum(share * total**2) == pytest.approx(3.0, rel=0.08)
    limit = 3.0 * math.sqrt(3.0)
    assert np.sum(share * (total > limit)) == pytest.approx(0.00135, rel=0.4)
    assert np.sum(share * (total < -limit)) == pytest.approx(0.00135, rel=0.25)
    assert np.mean(total < -limit) > 30 * 0.00135  # low values of all sources are drawn often


def test_combinations_of_certain_detections_have_finite_weights():
    rng = np.random.default_rng(3)
    values = [np.full((5, 4), math.inf), rng.exponential(30.0, (5, 4))]
    _, weight = combine(rng, [np.ones((5, 4))] * 2, values, np.ones(2), 32)
    assert np.isfinite(weight).all()
    assert weight.mean() == pytest.approx(1.0, abs=0.2)


def test_quantiles_are_those_of_repeated_values():
    rng = np.random.default_rng(4)
    values, counts = rng.normal(size=(5000, 2)), rng.integers(0, 5, 5000)
    found = weighted_statistics(values, counts.astype(float))
    repeated = np.repeat(values, counts, axis=0)
    # the smallest ranks are of a few draws, where the definitions of a quantile differ
    for rows, ranks in ((found.lower, RANKS), (found.upper, 1 - RANKS)):
        exact = np.quantile(repeated, ranks[MIDDLE:], axis=0, method="hazen")
        np.testing.assert_allclose(rows[MIDDLE:], exact, atol=0.05)
    assert RANKS[MIDDLE] == pytest.approx(ndtr(-3.0))


def test_a_pooled_quantile_is_the_one_of_all_draws():
    """Few draws of an exponential tail: the mean of the replicates' quantiles is biased."""
    rng = np.random.default_rng(5)
    values, weights = rng.exponential(size=(8, 4000, 40)), np.ones(4000)
    tails = np.array([weighted_statistics(-v, weights).lower for v in values])
    exact = np.quantile(-np.concatenate(values), ndtr(-3.0), axis=0, method="hazen")
    pooled = pooled_quantile(tails)
    np.testing.assert_allclose(pooled, exact, atol=0.2)
    assert np.mean(pooled - exact) == pytest.approx(0.0, abs=0.02)
    constant = pooled_quantile(np.full((8, len(RANKS), 3), 0.25))
    np.testing.assert_allclose(constant, 0.25, rtol=1e-15)


@pytest.mark.usefixtures("_fewer_draws")
def test_progress_adds_up_to_the_replicates_and_then_to_the_runs(tmp_path):
    shown = []

    def progress(total, what):
        shown.append((total, what, []))
        return nullcontext(shown[-1][2].append)

    mission(load(tmp_path, ["two"], 60.0), runs=20, progress=progress)
    assert [(total, what) for total, what, _ in shown] == [(8, "replicates"), (20, "runs")]
    assert all(sum(steps) == total for total, _, steps in shown)
