"""An uncertain RCS, against plain loops that share no code with the package.

One factor holds for all radars and all looks. A network or a mission draws this factor once.
"""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from helpers import document, target_in_the_north, with_arrays, yaml_text
from numpy.testing import assert_allclose
from scipy.stats import norm

import radar_sense as rs
from radar_sense import analyses
from radar_sense.accuracy import required_accuracies
from radar_sense.mission.looks import Looks
from radar_sense.mission.recombined import recombined_missions
from radar_sense.montecarlo.exceedance import exceedance
from radar_sense.propagation import distribution, propagate_scenario
from radar_sense.sources import error_budget

BOLTZMANN = 1.380649e-23
P_FA, AREA, DECIBELS = 1e-4, 0.05, 1.5
TAILS = norm.cdf([-3, 3])
#: Place, c_r, and standard deviations of the place and of c_r.
RADARS = {
    "one": ((0.0, 0.0, -20.0), 0.006, 1000.0, 0.0004),
    "two": ((10e3, 20e3, -20.0), 0.0016, 500.0, 0.0001),
    "three": ((20e3, -20e3, -20.0), 0.001, 800.0, 0.00008),
}
POSE = 500.0


def network(names=tuple(RADARS), decibels=DECIBELS, **changes):
    """Document of radars that see an aircraft 60 km north of the origin, with Swerling 1."""
    content = target_in_the_north(AREA, position_m=POSE, attitude_deg=1)
    if decibels:
        content["uncertainty"]["aircraft"]["rcs_db"] = decibels
    content["radars"] = [
        {
            "name": name, "position_m": list(RADARS[name][0]), "constant": RADARS[name][1],
            "p_fa": P_FA, "detector": "swerling1", "scan_period_s": 8,
            "uncertainty": {"one": {"position_m": RADARS[name][2], "constant": RADARS[name][3]}},
        }
        for name in names
    ]  # fmt: skip
    return {**content, **changes}


def parsed(*args, **kwargs):
    return rs.parse_scenario(yaml_text(network(*args, **kwargs)))


def drawn_p_d(names, runs, seed, poses=((60e3, 0.0, -6e3),), *, shared=True):
    """P_D of the network (runs, poses), radar by radar; pose errors are one error for all poses."""
    rng = np.random.default_rng(seed)
    factor = 10 ** (DECIBELS * rng.standard_normal(runs) / 10)
    error = POSE * rng.standard_normal((3, runs))
    missed = np.ones((runs, len(poses)))
    for name in names:
        place, constant, std, std_constant = RADARS[name]
        at = np.array(place)[:, None] + std * rng.standard_normal((3, runs))
        c_r = np.maximum(constant + std_constant * rng.standard_normal(runs), 0)
        if not shared:
            factor = 10 ** (DECIBELS * rng.standard_normal(runs) / 10)
        for i, pose in enumerate(poses):
            squared = np.sum((np.array(pose)[:, None] + error - at) ** 2, axis=0)
            snr = c_r * factor * AREA / (BOLTZMANN * squared**2)
            missed[:, i] *= 1 - P_FA ** (1 / (1 + snr))
    return 1 - missed


def test_the_distribution_is_that_of_plain_draws():
    names = tuple(RADARS)
    s = parsed(names)
    every = np.concatenate([drawn_p_d(names, 100_000, seed)[:, 0] for seed in range(4)])
    std, ends = every.std(), np.quantile(every, TAILS)
    density = 4 * 0.035 * std / 2  # four standard errors of a 3-sigma quantile of 400,000 draws
    form = propagate_scenario(s, method="form")
    assert form.mean[0] == pytest.approx(every.mean(), abs=0.01 * std)
    assert form.std[0] == pytest.approx(std, rel=0.01)
    assert_allclose([form.lower[0], form.upper[0]], ends, atol=density + 0.002)
    probit = propagate_scenario(s, method="probit")
    assert probit.std[0] == pytest.approx(std, rel=0.1)
    mc = rs.monte_carlo(s, runs=100_000)
    assert mc.mean[0] == pytest.approx(every.mean(), abs=5 * std * np.sqrt(1.25e-5))
    assert mc.std[0] == pytest.approx(std, rel=0.025)
    assert_allclose([mc.lower[0], mc.upper[0]], ends, atol=4 * density)
    quasi = rs.monte_carlo(s, runs=2**14, sampler="sobol")
    assert quasi.std[0] == pytest.approx(std, rel=0.03)
    level = float(np.quantile(every, 0.9))
    assert distribution(s, "form").exceedance(level)[0] == pytest.approx(0.1, abs=0.003)
    # a factor for each radar is another distribution
    apart = drawn_p_d(names, 100_000, 9, shared=False)[:, 0]
    assert apart.std() < 0.85 * std


def test_poses_share_the_factor():
    poses = [(60e3, 0.0, -6e3), (40e3, 45e3, -6e3), (-45e3, 40e3, -6e3)]
    s = parsed()
    aircraft = np.hstack([np.array(poses), np.zeros((3, 3))])
    s = with_arrays(
        s, aircraft=aircraft, rcs_db=DECIBELS, correlation_s=np.inf, time_s=[0, 10, 20], seed=1
    )
    every = drawn_p_d(tuple(RADARS), 200_000, 3, poses)
    p_max = float(np.quantile(every[:, 0], 0.98))
    exceeded = every > p_max
    found = exceedance(s, p_max, 50_000)
    expected = exceeded.any(axis=1).mean()
    error = found.error(found.anywhere)
    assert found.anywhere / found.runs == pytest.approx(expected, abs=5 * error)
    assert error < 0.06 * expected
    mc = rs.monte_carlo(s, runs=4000)
    drawn = mc.sample_paths
    assert np.corrcoef(drawn.T)[0, 2] > 0.5  # pose errors are drawn at each pose, the RCS is not
    assert mc.std[2] == pytest.approx(every[:, 2].std(), rel=0.05)


def test_the_budget_has_a_source_of_its_own_after_the_fixed_columns():
    one = rs.parse_scenario(
        yaml_text(
            document(uncertainty__aircraft={"position_m": 10, "attitude_deg": 1, "rcs_db": 1})
        )
    ).at_poses(slice(None, None, 60))
    found = analyses.budget(one)
    fixed = [
        "theta_r_deg", "three_sigma_aircraft_position", "three_sigma_aircraft_orientation",
        "three_sigma_radar_position", "three_sigma_radar_constant", "three_sigma_total",
        "three_sigma_aircraft_rcs",
    ]  # fmt: skip
    assert list(found.table) == fixed
    parts = [found.table[name] for name in fixed[1:5] + fixed[6:]]
    assert_allclose(np.sqrt(np.sum(np.square(parts), axis=0)), found.table[fixed[5]], rtol=1e-12)
    only = with_arrays(
        one, cov_aircraft=np.zeros((6, 6)), cov_radar={"medium": np.zeros((4, 4))}, level="medium"
    )
    for method in ("linear", "probit", "form"):
        alone = error_budget(one, method).sources["aircraft_rcs"].std
        assert_allclose(alone, propagate_scenario(only, method=method).std, rtol=1e-3)
    assert any("aircraft_rcs" in line for line in found.report)
    several = analyses.budget(parsed())
    assert list(several.table)[1:8] == [
        *(f"three_sigma_{x}" for x in ("aircraft_position", "aircraft_orientation", *RADARS)),
        "three_sigma_total", "three_sigma_aircraft_rcs",
    ]  # fmt: skip
    assert several.summary["dominant"] == "aircraft_rcs"


def test_how_well_the_rcs_must_be_known():
    half = propagate_scenario(parsed(decibels=DECIBELS / 2), method="form")
    found = required_accuracies(parsed(), 3 * half.std[0], method="form")
    assert found["aircraft_rcs"].factor == pytest.approx(0.5, rel=1e-4)
    assert set(found) == {
        "aircraft_position",
        "aircraft_orientation",
        "all",
        "aircraft_rcs",
        *RADARS,
    }


def flight(folder, names, tau, periods=(8,), decibels=DECIBELS):
    """Scenario of a flight past radars with one period, or with several periods in turn."""
    rows = ["0,60e3,-40e3", "60,55e3,0", "120,60e3,40e3"]
    header = "time_s,north_m,east_m,down_m,roll_deg,pitch_deg,yaw_deg"
    (folder / "route.csv").write_text("\n".join([header, *(f"{r},-6e3,0,0,90" for r in rows)]))
    content = network(names, decibels, geometry={"type": "path", "file": "route.csv"})
    del content["aircraft"]["attitude_deg"]
    content["uncertainty"]["aircraft_correlation_s"] = tau
    for radar, period in zip(content["radars"], periods * len(names), strict=False):
        radar["scan_period_s"] = period
    (folder / "s.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    return rs.load_scenario(folder / "s.yaml")


@pytest.mark.parametrize(("names", "periods"), [(("one",), (8,)), (tuple(RADARS), (8, 12))])
def test_a_mission_draws_one_factor_for_all_radars_and_looks(tmp_path, names, periods):
    s = flight(tmp_path, names, ".inf", periods)
    time = {
        name: list(range(0, 121, period))
        for name, period in zip(names, periods * len(names), strict=False)
    }
    runs, batches = 20_000, []
    for seed in range(3):
        # every radar by itself has the same draws of the factor and of the pose error
        rng = np.random.default_rng(seed)
        factor = 10 ** (DECIBELS * rng.standard_normal(runs) / 10)
        error = POSE * rng.standard_normal((3, runs))
        missed = np.ones(runs)
        for name in names:
            place, constant, std, std_constant = RADARS[name]
            at = np.array(place)[:, None] + std * rng.standard_normal((3, runs))
            c_r = np.maximum(constant + std_constant * rng.standard_normal(runs), 0)
            for t in time[name]:
                pose = [np.interp(t, [0, 60, 120], v)
                        for v in ([60e3, 55e3, 60e3], [-40e3, 0, 40e3], [-6e3] * 3)]  # fmt: skip
                squared = np.sum((np.array(pose)[:, None] + error - at) ** 2, axis=0)
                snr = c_r * factor * AREA / (BOLTZMANN * squared**2)
                missed = missed * (1 - P_FA ** (1 / (1 + snr)))
        batches.append(1 - missed)
    every = np.concatenate(batches)
    ends = np.quantile(every, TAILS)
    found = recombined_missions(Looks.of(s), (2, 3))
    assert len(found) == (1 if len(names) == 1 else 4)
    bounds = found[0][0]
    assert bounds.mean[-1] == pytest.approx(every.mean(), abs=0.03 * every.std())
    assert bounds.std[-1] == pytest.approx(every.std(), rel=0.04)
    for value, error, end in (
        (bounds.lower[-1], bounds.lower_se[-1], ends[0]),
        (bounds.upper[-1], bounds.upper_se[-1], ends[1]),
    ):
        assert error < 0.03 * every.std() + 0.002
        assert value == pytest.approx(end, abs=4 * error + 0.15 * every.std())
    plain = analyses.mission(s, runs=10_000).table
    assert plain["mc_std"][-1] == pytest.approx(every.std(), rel=0.04)
    assert_allclose([plain["mc_lower"][-1], plain["mc_upper"][-1]], ends, atol=0.3 * every.std())
