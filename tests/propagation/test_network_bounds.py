"""Propagation through networks: shared errors, and constants drawn below zero."""

import chain_rule
import numpy as np
import pytest
from helpers import cov_by_level, p_d_each, paper_network, with_arrays
from numpy.testing import assert_allclose
from scipy.constants import Boltzmann

from radar_sense.covariance import variance_along
from radar_sense.model.rcs import EllipsoidRCS
from radar_sense.montecarlo.montecarlo import monte_carlo
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.propagation import distribution, propagate_scenario
from radar_sense.scenario import single_radar_scenarios
from radar_sense.scenario_file.load import load_scenario
from radar_sense.states import of_radar

PAPER = load_scenario()
RCS = EllipsoidRCS(0.15, 0.13, 0.21)


def north(constant, sigma_over_r4):
    return chain_rule.north(np.maximum(constant, 0) * sigma_over_r4 / Boltzmann, 1.7e-4)


@pytest.mark.parametrize("std", [5.0, 20.0])
def test_two_radars_at_one_place_with_independent_constants_against_quadrature(std):
    scenario = paper_network([(0, 0, 0)] * 2, [80, 80])
    cov = np.zeros((8, 8))
    cov[3, 3] = cov[7, 7] = std**2
    scenario = with_arrays(
        scenario, cov_aircraft=np.zeros((6, 6)), cov_radar={"medium": cov}, runs=100_000
    )
    n, east, down = scenario.aircraft[:, :3].T
    body = np.stack([-east, n, -down], axis=-1)  # level and heading east, seen from the origin
    ratio = RCS.cross_section(body) / (n**2 + east**2 + down**2) ** 2
    x, w = np.polynomial.hermite_e.hermegauss(80)
    w = w / w.sum()
    miss = 1 - north(80 + std * x[:, np.newaxis], ratio)
    # the constants are independent: E (Q₁Q₂)ⁿ = (E Qⁿ)²
    first, second = w @ miss, w @ miss**2
    mean, variance = 1 - first**2, second**2 - first**4
    step = 1e-3
    slope = (north(80 + step, ratio) - north(80 - step, ratio)) / (2 * step)
    nominal = 1 - north(80, ratio)
    lin = propagate_scenario(scenario, method="linear")
    assert_allclose(lin.std, np.sqrt(2) * nominal * slope * std, rtol=1e-7)
    found = propagate_scenario(scenario, method="form")
    assert_allclose(found.mean, mean, rtol=0, atol=2e-5 * (std / 5) ** 3.5)
    assert_allclose(found.std, np.sqrt(variance), rtol=0.003 * (std / 5) ** 2)
    mc = monte_carlo(scenario)
    error = np.sqrt(variance / mc.runs)
    assert np.all(abs(mc.mean - mean) < 4.5 * error)
    assert_allclose(mc.std, np.sqrt(variance), rtol=0.015)
    # the larger noise is where first order fails: a wrong reference would not tell them apart
    if std == 20:
        assert np.max(abs(lin.std / np.sqrt(variance) - 1)) > 0.03


def test_independence_understates_the_variance():
    """Three radars near each other, 3 % uncertain, have the same error of the aspect."""
    scenario = paper_network(
        [(0, 0, 0), (1e4, -1e4, 0), (-1e4, 1e4, 0)],
        [70, 70, 70],
        poses=slice(90, 91),
        attitude_deg=3.0,
    )
    cov = np.diag([10.0**2] * 3 + [2.14**2])
    scenario = with_arrays(scenario, cov_radar={"medium": np.kron(np.eye(3), cov)}, runs=100_000)
    lin = scenario.model.linearize(scenario.aircraft, scenario.radar)
    joint = lin.std(scenario.cov_aircraft, cov_by_level(scenario)["medium"]) ** 2
    # independence: an aircraft of its own for each radar
    each = p_d_each(scenario.model, scenario.aircraft, scenario.radar)
    apart = variance_along(lin.jac_radar, cov_by_level(scenario)["medium"])
    for i, model in enumerate(scenario.model.models):
        single = model.linearize(scenario.aircraft, scenario.radar[4 * i : 4 * i + 4])
        others = np.prod(np.delete(1 - each, i, axis=1), axis=1)
        apart = apart + others**2 * variance_along(single.jac_aircraft, scenario.cov_aircraft)
    # the same by draws: the aircraft drawn once for all radars, and once for each
    mc = monte_carlo(scenario, sampler="sobol")
    rng = np.random.default_rng(1)
    radar = scenario.states().radars_at(rng.standard_normal((scenario.runs, 12)))
    miss = 1.0
    for i, s in enumerate(single_radar_scenarios(scenario).values()):
        normals = rng.standard_normal((scenario.runs, 1, 6))
        drawn = Sampler(s.states()).draw_p_d(normals, radar[:, of_radar(i)])[:, 0]
        miss = miss * (1 - drawn)
    assert_allclose(joint / apart, 2.66, rtol=0.02)
    assert_allclose(mc.std**2 / miss.var(), 2.66, rtol=0.1)
    assert_allclose(mc.std**2, joint, rtol=0.1)


def test_p_d_is_surely_above_a_limit_below_the_floor():
    scenario = paper_network([(0, 0, 0)] * 2, [80, 80], poses=slice(0, 1))
    p_fa = scenario.model.models[0].p_fa
    false_alarm = 1 - (1 - p_fa) ** 2  # the floor of North's approximation is above it
    cov_radar = np.diag([0, 0, 0, 80.0**2] * 2)  # a constant of 0 has no signal
    scenario = with_arrays(scenario, cov_radar={"medium": cov_radar})
    assert distribution(scenario, "form").exceedance(0.99 * false_alarm)[0] == 1
