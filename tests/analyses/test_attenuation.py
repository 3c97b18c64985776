"""The attenuation on the way to the target and back, against plain formulas and loops."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from helpers import (
    cov_by_level,
    document,
    place,
    refusal,
    scenario,
    shares_of,
    target_in_the_north,
    with_arrays,
    yaml_text,
)
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import norm

import radar_sense as rs
from radar_sense import analyses
from radar_sense.model.network import NetworkModel
from radar_sense.model.radar import Radar
from radar_sense.model.rcs import ConstantRCS
from radar_sense.propagation import METHODS, propagate_scenario
from radar_sense.sources import error_budget

pytestmark = pytest.mark.usefixtures("quick")

BOLTZMANN = 1.380649e-23
P_FA, AREA = 1e-4, 0.05
#: Place, c_r, and standard deviations of the place and of c_r, and α and its own [dB/km].
RADARS = {
    "one": ((0.0, 0.0, -20.0), 0.04, 1000.0, 0.003, 0.05, 0.01),
    "two": ((10e3, 20e3, -20.0), 0.02, 500.0, 0.001, 0.1, 0.015),
    "three": ((20e3, -20e3, -20.0), 0.003, 800.0, 0.0003, 0.0, 0.0),
}
POSE = 500.0
RNG = np.random.default_rng(18)


def network(names=tuple(RADARS), rcs_db=0.0, uncertain=True):
    """Document of radars that see an aircraft 60 km north of the origin, with Swerling 1."""
    content = target_in_the_north(AREA, runs=2**13, position_m=POSE, attitude_deg=1, rcs_db=rcs_db)
    content["radars"] = []
    for name in names:
        at, constant, std, std_constant, attenuation, std_attenuation = RADARS[name]
        level = {"position_m": std, "constant": std_constant}
        if uncertain and std_attenuation:
            level["attenuation_db_per_km"] = std_attenuation
        content["radars"].append({
            "name": name, "position_m": list(at), "constant": constant, "p_fa": P_FA,
            "detector": "swerling1", "scan_period_s": 8, "attenuation_db_per_km": attenuation,
            "uncertainty": {"one": level},
        })  # fmt: skip
    return content


def parsed(*args, **kwargs):
    return rs.parse_scenario(yaml_text(network(*args, **kwargs)))


def drawn_p_d(names, runs, seed, poses=((60e3, 0.0, -6e3),), rcs_db=0.0):
    """P_D of the network (runs, poses), radar by radar; errors are the same at all poses."""
    rng = np.random.default_rng(seed)
    factor = 10 ** (rcs_db * rng.standard_normal(runs) / 10)
    error = POSE * rng.standard_normal((3, runs))
    missed = np.ones((runs, len(poses)))
    for name in names:
        at, constant, std, std_constant, attenuation, std_attenuation = RADARS[name]
        where = np.array(at)[:, None] + std * rng.standard_normal((3, runs))
        c_r = np.maximum(constant + std_constant * rng.standard_normal(runs), 0)
        relative = std_attenuation / attenuation if attenuation else 0.0
        alpha = attenuation * np.exp(relative * rng.standard_normal(runs))
        for i, pose in enumerate(poses):
            squared = np.sum((np.array(pose)[:, None] + error - where) ** 2, axis=0)
            there_and_back = 10 ** (-2 * alpha * np.sqrt(squared) / 1000 / 10)
            snr = c_r * factor * AREA * there_and_back / (BOLTZMANN * squared**2)
            missed[:, i] *= 1 - P_FA ** (1 / (1 + snr))
    return 1 - missed


@pytest.mark.parametrize(
    "rcs", [ConstantRCS(0.1), rs.EllipsoidRCS(0.15, 0.13, 0.21)], ids=["constant", "ellipsoid"]
)
def test_signal_and_partials_are_those_of_the_formula(rcs):
    plain = rs.DetectionModel(rcs, 1e-6, rs.Swerling1())
    model = dataclasses.replace(plain, attenuation=2e-5)  # 0.02 dB/km
    count = 60
    whole = np.concatenate(
        [RNG.uniform(-2e5, 2e5, (count, 3)), RNG.uniform(-1, 1, (count, 3)),
         RNG.uniform(-1e4, 1e4, (count, 3)), RNG.uniform(1, 300, (count, 1)),
         RNG.uniform(-2, 2, (count, 3))], axis=1,
    )  # fmt: skip
    distance = np.linalg.norm(whole[:, :3] - whole[:, 6:9], axis=1) / 1e3
    for radar, alpha in ((whole[:, 6:10], 0.02), (whole[:, 6:], 0.02 * np.exp(whole[:, 11]))):
        expected = plain.snr(whole[:, :6], radar) * 10 ** (-2 * alpha * distance / 10)
        assert_allclose(model.snr(whole[:, :6], radar), expected, rtol=1e-12)
        loss = 2 * alpha * distance
        assert np.quantile(loss, 0.1) > 0.5
    lin = model.linearize(whole[:, :6], whole[:, 6:])
    jacobian = np.concatenate([lin.jac_aircraft, lin.jac_radar], axis=1)
    assert jacobian.shape == (count, 13)
    steps = np.array([1.0] * 3 + [1e-5] * 3 + [1.0] * 3 + [1e-4] * 4)
    for i, step in enumerate(steps):
        ends = [whole + sign * step * np.eye(13)[i] for sign in (1, -1)]
        high, low = (model.p_d(end[:, :6], end[:, 6:]) for end in ends)
        difference = (high - low) / (2 * step)
        assert_allclose(jacobian[:, i], difference, atol=2e-6 * np.abs(difference).max())
    for states in (whole[:, 6:10], whole[:, 6:]):
        one = NetworkModel((Radar(model),)).linearize(whole[:, :6], states)
        expected = model.linearize(whole[:, :6], states).jac_radar
        assert_allclose(one.jac_radar, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("names", "rcs_db"), [(("one",), 0.0), (("one",), 1.0), (("three", "one", "two"), 1.0)]
)
def test_the_distribution_is_that_of_plain_draws(names, rcs_db):
    s = parsed(names, rcs_db)
    every = np.concatenate(
        [drawn_p_d(names, 100_000, seed, rcs_db=rcs_db)[:, 0] for seed in range(3)]
    )
    std, ends = every.std(), np.quantile(every, norm.cdf([-3, 3]))
    assert std > 0.03
    form = propagate_scenario(s, method="form")
    assert form.mean[0] == pytest.approx(every.mean(), abs=0.02 * std)
    assert form.std[0] == pytest.approx(std, rel=0.02)
    assert_allclose([form.lower[0], form.upper[0]], ends, atol=0.12 * std)
    mc = rs.monte_carlo(s, runs=60_000)
    assert mc.mean[0] == pytest.approx(every.mean(), abs=0.02 * std)
    assert mc.std[0] == pytest.approx(std, rel=0.025)
    without = propagate_scenario(parsed(names, rcs_db, uncertain=False), method="form")
    assert without.std[0] < 0.96 * std


def test_the_attenuation_of_each_radar_is_a_source_of_the_budget():
    one = scenario(
        radar__attenuation_db_per_km=0.01,
        uncertainty__radar__medium={
            "position_m": 100, "constant": 5, "attenuation_db_per_km": 1e-3,
        },
    ).at_poses(slice(0, 1))  # fmt: skip
    found = analyses.budget(one)
    fixed = [f"three_sigma_{source}" for source in (
        "aircraft_position", "aircraft_orientation", "radar_position", "radar_constant", "total",
        "radar_attenuation",
    )]  # fmt: skip
    assert list(found.table) == ["theta_r_deg", *fixed]
    parts = [found.table[name] for name in (*fixed[:4], fixed[5])]
    assert_allclose(np.sqrt(np.sum(np.square(parts), axis=0)), found.table[fixed[4]], rtol=1e-12)
    # 0.001 dB/km on 500 km is 1 dB there and back, as one of the RCS
    plain = with_arrays(one, attenuation_std={}, rcs_db=1.0)
    alone = error_budget(plain).sources["aircraft_rcs"].std
    assert_allclose(error_budget(one).sources["radar_attenuation"].std, alone, rtol=2e-5)
    for rcs_db in (0.0, 1.0):
        s = parsed(rcs_db=rcs_db)
        for method in METHODS:
            budget = error_budget(s, method)
            names = ["aircraft_position", "aircraft_orientation", *RADARS]
            assert list(budget.sources) == names + ["aircraft_rcs"] * (rcs_db > 0)
            if method == "montecarlo":  # Sobol' indices have no finer sources
                assert not budget.finer
                continue
            for name in RADARS:
                parts = ("position", "constant", "attenuation")
                whole = sum(budget.finer[f"{name}_{part}"].std ** 2 for part in parts)
                if method == "linear":
                    assert_allclose(budget.sources[name].std ** 2, whole, rtol=1e-12)
            assert (
                min(budget.finer[f"{name}_attenuation"].std[0] for name in ("one", "two")) > 0.002
            )
            assert budget.finer["three_attenuation"].std[0] == 0
        result = analyses.budget(s)
        rows = [line.split() for line in result.report if line.startswith("    attenuation")]
        total = result.table["three_sigma_total"][0]
        shown = sorted(
            (f"{three:.4f}" if three > 1e-6 else "0", f"{(three / total) ** 2:.1%}")
            for name in RADARS
            for three in result.table[f"three_sigma_{name}_attenuation"]
        )
        assert sorted((three, share) for _, three, share in rows) == shown


@pytest.mark.parametrize("names", [("one",), ("one", "two")])
def test_indices_are_linear_shares_where_p_d_is_nearly_linear(names):
    for rcs_db in (0.0, 0.2):
        s = parsed(names, rcs_db)
        small = {"one": 0.04 * cov_by_level(s)["one"]}
        std = {"one": tuple(0.2 * r.levels["one"].attenuation_std for r in s.radars)}
        s = with_arrays(s, cov_radar=small, cov_aircraft=0.04 * s.cov_aircraft, attenuation_std=std)
        found, linear = error_budget(s, "montecarlo"), error_budget(s)
        assert list(found.sources) == list(linear.sources)
        for name, share in shares_of(found).items():
            assert share[0] == pytest.approx(shares_of(linear)[name][0], abs=0.03)


def test_a_map_has_the_attenuation():
    certain = parsed(("one",), uncertain=False)
    cells = {"north_km": (20, 90), "east_km": (0, 60), "step_km": 10.0}
    plane = analyses.coverage_map(certain, **cells).table
    north, east = np.meshgrid(plane["north_m"], plane["east_m"], indexing="ij")
    distance = np.sqrt(north**2 + east**2 + (6e3 - 20) ** 2)
    snr = 0.04 * AREA * 10 ** (-2 * 0.05 * distance / 1e4) / (BOLTZMANN * distance**4)
    assert_allclose(plane["p_d"], P_FA ** (1 / (1 + snr)), rtol=1e-6)


def test_the_attenuation_is_read_and_read_back():
    s = parsed(rcs_db=1.5)
    assert_allclose([m.attenuation for m in s.model.models], [5e-5, 1e-4, 0], rtol=1e-15)
    std = [radar.levels["one"].attenuation_std for radar in s.radars]
    assert_allclose(std, [1e-5, 1.5e-5, 0], rtol=1e-15)
    each = s.states().radar.reshape(3, 7)
    assert_array_equal(each[:, :4], s.radar_states)
    assert not each[:, 4:].any()
    cov = s.states().cov_radar[0]
    assert_allclose(cov[4::7, 4::7], np.full((3, 3), 2.25), rtol=1e-12)  # one error of the RCS
    assert_allclose(cov[5::7, 5::7], np.diag([0.04, 0.0225, 0]), rtol=1e-12)
    document = s.resolved()
    assert "attenuation_db_per_km" not in document["radars"][2]
    assert document["radars"][1]["attenuation_db_per_km"] == 0.1
    assert document["radars"][1]["uncertainty"]["one"]["attenuation_db_per_km"] == 0.015
    again = rs.parse_scenario(yaml_text(document))
    assert again.resolved() == document
    assert_array_equal(again.states().cov_radar[0], cov)
    certain = parsed(uncertain=False)
    assert not certain.states().cov_radar[0].reshape(3, 7, 21)[:, 4:].any()
    whole = {"covariance": np.eye(4).tolist(), "attenuation_db_per_km": 0.005}
    one = scenario(radar__attenuation_db_per_km=0.01, uncertainty__radar__low=whole)
    std = {name: level.attenuation_std for name, level in one.radars[0].levels.items()}
    assert std == {"low": 5e-6, "medium": 0, "high": 0}
    assert not one.uncertain_parameters
    assert one.with_analysis(level="low").states().cov_radar[0, -2, -2] == pytest.approx(0.25)


def test_refusals_name_the_key(tool):
    level = "uncertainty.radar.medium.attenuation_db_per_km"
    for attenuation, std, path, message in (
        (0, 0.1, level, "must be at most the attenuation_db_per_km of the radar, 0, got 0.1"),
        (0.1, 0.1001, level, "must be at most the attenuation_db_per_km of the radar, 0.1, got"),
    ):
        medium = {"position_m": 100, "constant": 5, "attenuation_db_per_km": std}
        text = yaml_text(
            document(radar__attenuation_db_per_km=attenuation, uncertainty__radar__medium=medium)
        )
        _, key, complaint = place(refusal(tool, text))
        assert key == path
        assert message in complaint
    with pytest.raises(ValueError, match="attenuation must be"):
        rs.DetectionModel(ConstantRCS(1.0), 1e-6, attenuation=-1)
    with pytest.raises(ValueError, match="attenuation_std"):
        with_arrays(parsed(("one",)), attenuation_std={"one": (1.0,)})
    with pytest.raises(ValueError, match="got inf for the error of the attenuation"):
        rs.DetectionModel(ConstantRCS(1.0), 1e-6).p_d(
            np.ones(6), np.array([0, 0, 0, 1, 0, np.inf, 0])
        )


def test_the_detection_range_has_the_attenuation():
    s = parsed(("one",), rcs_db=1.0)
    table = analyses.detection_range(s, p_d=(0.5,), step_deg=90).table
    needed = np.log(P_FA) / np.log(0.5) - 1
    low, high = 1e3, 1e6
    for _ in range(60):
        middle = 0.5 * (low + high)
        snr = 0.04 * AREA * 10 ** (-2 * 0.05 * middle / 1e4) / (BOLTZMANN * middle**4)
        low, high = (middle, high) if snr > needed else (low, middle)
    assert_allclose(table["range_m_0.5"], low, rtol=1e-9)
    certain = with_arrays(s, rcs_db=0.0, attenuation_std={})
    narrow = analyses.detection_range(certain, p_d=(0.5,), step_deg=90).table
    assert np.all(narrow["sigma_range_m_0.5"] < 0.8 * table["sigma_range_m_0.5"])
