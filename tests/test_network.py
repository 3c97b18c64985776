"""Networks: fused P_D and its partials, what the radars share, and what a radar does not see."""

import dataclasses

import numpy as np
import oracle
import pytest
from mpmath import mp, mpf
from numpy.testing import assert_allclose, assert_array_equal
from scipy.special import ndtr

from radar_sense import analyses
from radar_sense.analyses.error_budget import error_budget, required_accuracies
from radar_sense.covariance import variance_along
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.detectors import Marcum, North, Swerling1, Swerling3
from radar_sense.model.geodesy import ECCENTRICITY_2, SEMI_MAJOR
from radar_sense.model.horizon import EARTH_RADIUS, EFFECTIVE_RADIUS, Horizon, horizon_range
from radar_sense.model.network import NetworkModel, Radar, _fuse
from radar_sense.model.rcs import ConstantRCS, EllipsoidRCS
from radar_sense.montecarlo.adaptive import validate
from radar_sense.montecarlo.montecarlo import monte_carlo
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.propagation import (
    METHODS,
    nonlinear,
    nonlinear_in_scenario,
    propagate,
    propagate_scenario,
)
from radar_sense.propagation.standard_space import StandardNormalSpace, uncertain_states
from radar_sense.reading.parse import load_scenario
from radar_sense.scenario import single_radar_scenarios
from radar_sense.states import CONSTANTS

PAPER = load_scenario()
RADAR_MODEL = PAPER.model.radars[0].model
RCS = EllipsoidRCS(0.15, 0.13, 0.21)
ELLIPSOID = ("ellipsoid", 0.15, 0.13, 0.21)


def network(
    positions, constants, *, poses=slice(None, None, 60), attitude_deg=1.0, models=None, **limits
):
    """The paper's aircraft seen by several radars, each with the paper's uncertainty."""
    m = len(positions)
    models = models or [RADAR_MODEL] * m
    cov_aircraft = PAPER.cov_aircraft.copy()
    cov_aircraft[3:, 3:] = np.eye(3) * np.radians(attitude_deg) ** 2
    return dataclasses.replace(
        PAPER,
        model=NetworkModel(
            tuple(Radar(model, f"r{i}", **limits) for i, model in enumerate(models))
        ),
        axis=PAPER.axis.part(poses),
        aircraft=PAPER.aircraft[poses],
        radar=np.concatenate([[*p, c] for p, c in zip(positions, constants, strict=True)]),
        cov_aircraft=cov_aircraft,
        cov_radar={name: np.kron(np.eye(m), c) for name, c in PAPER.cov_radar.items()},
    )


def p_d_each(network, aircraft, radar):
    """P_D (..., m) of each radar of a network by its own model and limits."""
    states = np.split(np.asarray(radar), len(network.radars), axis=-1)
    return np.stack(
        [
            np.where(r.visible(aircraft, state), r.model.p_d(aircraft, state), 0)
            for r, state in zip(network.radars, states, strict=True)
        ],
        axis=-1,
    )


def moments(scenario, method="linear"):
    return propagate_scenario(scenario, method=method)


def warned(scenario, method):
    return nonlinear_in_scenario(scenario, moments(scenario, method), method=method)


def fields_of(found):
    return [getattr(found, f.name) for f in dataclasses.fields(found)]


# A network of one is the single radar.


@pytest.mark.parametrize("limits", [{}, {"max_range": 1e7}, {"horizon": Horizon()}])
def test_a_network_of_one_is_the_single_radar_bit_for_bit(limits):
    aircraft = PAPER.aircraft - 30e3 * np.eye(6)[2]  # above the horizon
    radar = np.array([3e3, -2e3, -100.0, 160.0])
    one = NetworkModel((Radar(RADAR_MODEL, **limits),))
    assert_array_equal(one.p_d(aircraft, radar), RADAR_MODEL.p_d(aircraft, radar))
    assert_array_equal(one.snr(aircraft, radar)[:, 0], RADAR_MODEL.snr(aircraft, radar))
    for name in ("linearize", "linearize_probit"):
        mine, theirs = (getattr(model, name)(aircraft, radar) for model in (one, RADAR_MODEL))
        if name == "linearize":
            mine, theirs = fields_of(mine), fields_of(theirs)
        for a, b in zip(mine, theirs, strict=True):
            assert_array_equal(a, b)
    cov = (PAPER.cov_aircraft, PAPER.cov_radar["high"])
    for method in METHODS:
        mine, theirs = (
            propagate(model, aircraft[::20], radar, *cov, method=method)
            for model in (one, RADAR_MODEL)
        )
        for a, b in zip(fields_of(mine), fields_of(theirs), strict=True):
            if a.dtype == bool and limits.get("horizon"):
                continue  # a horizon within reach is a doubt of its own
            assert_array_equal(a, b)


# The fused P_D and its partials.

DETECTORS = {North: None, Marcum: oracle.marcum, Swerling1: oracle.swerling1}


def exact_p_d(states, models):
    """P_D of all radars at states of 6 + 4m numbers, and the product of the complements."""
    miss = mpf(1)
    for i, (detector, p_fa) in enumerate(models):
        snr = oracle.snr(states[:6], states[6 + 4 * i : 10 + 4 * i], ELLIPSOID)
        both = DETECTORS[detector]
        miss *= (
            both(snr, p_fa)[1]
            if both
            else mp.erfc(mp.sqrt(snr + mpf("0.5")) - mp.sqrt(-mp.log(mpf(p_fa)))) / 2
        )
    return miss


def exact_partials(states, models):
    states = [mpf(x) for x in states]
    slopes = []
    for i, state in enumerate(states):
        step = mpf("1e-20") * (max(abs(state), mpf(1)))
        ends = [
            exact_p_d([*states[:i], state + s * step, *states[i + 1 :]], models) for s in (1, -1)
        ]
        slopes.append((ends[1] - ends[0]) / (2 * step))
    return slopes


@pytest.mark.parametrize(
    "kinds",
    [
        [(North, 1.7e-4)] * 2,
        [(North, 1e-6), (North, 1e-3), (North, 1e-9)],
        [(Swerling1, 1e-5), (North, 1e-4)],
        [(Marcum, 1e-3), (Swerling1, 1e-6)],
    ],
)
# from P_D of a few per cent to 1 − P_D far below 1e-16
@pytest.mark.parametrize("distance", [6e5, 4e5, 3e5])
def test_fused_p_d_and_all_partials_against_fifty_digits(kinds, distance):
    rng = np.random.default_rng(int(distance) + len(kinds))
    models = [DetectionModel(RCS, p_fa, kind()) for kind, p_fa in kinds]
    net = NetworkModel(tuple(Radar(model, f"r{i}") for i, model in enumerate(models)))
    direction = rng.standard_normal(3) * [1, 1, 0.1]
    aircraft = np.array(
        [*(distance * direction / np.linalg.norm(direction)), *rng.uniform(-1, 1, 3)]
    )
    radar = np.concatenate(
        [[*(rng.standard_normal(3) * 5e4), rng.uniform(100, 200)] for _ in models]
    )
    lin = net.linearize(aircraft, radar)
    z, z_aircraft, z_radar = net.linearize_probit(aircraft, radar)
    with mp.workdps(50):
        states = [*aircraft, *radar]
        miss = exact_p_d(states, kinds)
        slopes = exact_partials(states, kinds)
        exact = np.array([float(s) for s in slopes])
        found = np.concatenate([lin.jac_aircraft, lin.jac_radar])
        scale = np.abs(exact).max()
        assert scale > 0
        units = np.array([distance] * 3 + [1.0] * 3 + ([distance] * 3 + [150.0]) * len(models))
        assert_allclose(found * units, exact * units, rtol=1e-10, atol=1e-11 * max(exact * units))
        assert_allclose(net.p_d(aircraft, radar), float(1 - miss), rtol=1e-13)
        assert_allclose(lin.p_d, float(1 - miss), rtol=1e-12)
        # z in terms of the lesser tail, and its slope, by φ(z)
        lesser, side = (miss, -1) if miss < 0.5 else (1 - miss, 1)
        tail = mp.ncdf(side * mpf(float(z)))
        assert abs(tail / lesser - 1) < mpf("1e-13") * (1 + mpf(float(z)) ** 2)
        by_z = np.array([float(s / mp.npdf(mpf(float(z)))) for s in slopes])
    found = np.concatenate([z_aircraft, z_radar])
    assert_allclose(found * units, by_z * units, rtol=1e-10, atol=1e-11 * max(by_z * units))


def test_fusion_keeps_both_tails():
    # from P_D of 1e-230 to 1 − P_D below 1e-300
    rng = np.random.default_rng(3)
    for m in (2, 3, 5):
        z = rng.uniform(-30, 30, 60) + rng.standard_normal((m, 60)) * rng.uniform(0, 2, 60)
        z[:, :10] = -9 + rng.standard_normal((m, 10)) / 100  # where the formula changes
        fused = _fuse(z)
        with mp.workdps(40):
            for column, value in zip(z.T, fused, strict=True):
                miss = mp.fprod(mp.ncdf(-mpf(x)) for x in column)
                hit = mpf(0)
                for x in column:
                    hit += (1 - hit) * mp.ncdf(mpf(x))
                lesser, side = (miss, -1) if miss < 0.5 else (hit, 1)
                error = abs(mp.ncdf(side * mpf(float(value))) / lesser - 1)
                # a rounding of z is worth z² of the tail
                assert error < mpf("2e-15") * (2 + float(value) ** 2)


def test_fusion_far_below_the_least_probability_there_is():
    # where a constant below zero leads: Φ(−60) is 1e-784
    z = np.array([[-60.0, -38.0], [-60.5, -45.0]])
    with mp.workdps(40):
        for column, value in zip(z.T, _fuse(z), strict=True):
            error = mp.ncdf(mpf(float(value))) / sum(mp.ncdf(mpf(x)) for x in column) - 1
            assert abs(error) < mpf("2e-15") * float(value) ** 2


def test_fused_p_d_rises_with_every_radar_and_never_passes_1():
    rng = np.random.default_rng(4)
    radar = np.concatenate([[*rng.standard_normal(3) * 1e5, 10.0**i] for i in range(6)])
    net = NetworkModel(tuple(Radar(RADAR_MODEL, f"r{i}") for i in range(6)))
    each = p_d_each(net, PAPER.aircraft, radar)
    fused = net.p_d(PAPER.aircraft, radar)
    assert each.shape == (361, 6)
    assert net.snr(PAPER.aircraft, radar).shape == (361, 6)
    assert np.all(fused >= each.max(axis=1))
    assert fused.max() == 1
    assert_allclose(fused, 1 - np.prod(1 - each, axis=1), rtol=0, atol=4e-16)
    last = RADAR_MODEL.p_d(PAPER.aircraft, radar[-4:])
    assert_array_equal(each[:, -1], last)


def test_states_broadcast():
    net = NetworkModel((Radar(RADAR_MODEL, "a"), Radar(RADAR_MODEL, "b")))
    rng = np.random.default_rng(0)
    radar = rng.standard_normal((7, 1, 8)) * 1e4
    radar[..., CONSTANTS] = 160
    lin = net.linearize(PAPER.aircraft[:5], radar)
    assert lin.p_d.shape == net.p_d(PAPER.aircraft[:5], radar).shape == (7, 5)
    assert lin.jac_aircraft.shape == (7, 5, 6)
    assert lin.jac_radar.shape == (7, 5, 8)
    one = net.linearize(PAPER.aircraft[2], radar[3, 0])
    assert_allclose(one.jac_radar, lin.jac_radar[3, 2], rtol=1e-13)
    assert one.p_d.shape == ()


# Two radars at one place, and nothing uncertain but their constants.


def north(constant, sigma_over_r4, p_fa=1.7e-4):
    from scipy.constants import Boltzmann
    from scipy.special import erfc

    snr = np.maximum(constant, 0) * sigma_over_r4 / Boltzmann
    return 0.5 * erfc(np.sqrt(-np.log(p_fa)) - np.sqrt(snr + 0.5))


@pytest.mark.parametrize("std", [5.0, 20.0])
def test_two_radars_at_one_place_with_independent_constants_against_quadrature(std):
    scenario = network([(0, 0, 0)] * 2, [80, 80])
    cov = np.zeros((8, 8))
    cov[3, 3] = cov[7, 7] = std**2
    scenario = dataclasses.replace(
        scenario, cov_aircraft=np.zeros((6, 6)), cov_radar={"medium": cov}, runs=100_000
    )
    where = scenario.aircraft
    body_sigma = RCS.cross_section(_body(where))
    ratio = body_sigma / np.sum(where[:, :3] ** 2, axis=1) ** 2
    x, w = np.polynomial.hermite_e.hermegauss(80)
    w = w / w.sum()
    miss = 1 - north(80 + std * x[:, np.newaxis], ratio)
    # the constants are independent, so that E (Q₁Q₂)ⁿ = (E Qⁿ)²
    first, second = w @ miss, w @ miss**2
    mean, variance = 1 - first**2, second**2 - first**4
    step = 1e-3
    slope = (north(80 + step, ratio) - north(80 - step, ratio)) / (2 * step)
    nominal = 1 - north(80, ratio)
    lin = moments(scenario)
    assert_allclose(lin.std, np.sqrt(2) * nominal * slope * std, rtol=1e-7)
    found = moments(scenario, "form")
    assert_allclose(found.mean, mean, rtol=0, atol=2e-5 * (std / 5) ** 3.5)
    assert_allclose(found.std, np.sqrt(variance), rtol=0.003 * (std / 5) ** 2)
    mc = monte_carlo(scenario)
    error = np.sqrt(variance / mc.runs)
    assert np.all(abs(mc.mean - mean) < 4.5 * error)
    assert_allclose(mc.std, np.sqrt(variance), rtol=0.015)
    # the larger noise is where first order fails: a wrong reference would not tell them apart
    if std == 20:
        assert np.max(abs(lin.std / np.sqrt(variance) - 1)) > 0.03


def _body(aircraft):
    """Level and heading east, seen from the origin: forward is east, right is south."""
    north_, east, down = aircraft[:, :3].T
    return np.stack([-east, north_, -down], axis=-1)


# What all radars share.


@pytest.mark.parametrize(("attitude_deg", "factor"), [(1.0, 1.7), (3.0, 2.66)])
def test_independence_understates_the_variance(attitude_deg, factor):
    """Three radars near each other, 3 % uncertain: every one sees the same wrong aspect."""
    scenario = network(
        [(0, 0, 0), (1e4, -1e4, 0), (-1e4, 1e4, 0)],
        [70, 70, 70],
        poses=slice(90, 91),
        attitude_deg=attitude_deg,
    )
    cov = np.diag([10.0**2] * 3 + [2.14**2])
    scenario = dataclasses.replace(
        scenario, cov_radar={"medium": np.kron(np.eye(3), cov)}, runs=200_000
    )
    lin = scenario.model.linearize(scenario.aircraft, scenario.radar)
    joint = lin.std(scenario.cov_aircraft, scenario.cov_radar["medium"]) ** 2
    # independence: an aircraft of its own for each radar
    each = p_d_each(scenario.model, scenario.aircraft, scenario.radar)
    apart = variance_along(lin.jac_radar, scenario.cov_radar["medium"])
    for i, model in enumerate(scenario.model.models):
        single = model.linearize(scenario.aircraft, scenario.radar[4 * i : 4 * i + 4])
        others = np.prod(np.delete(1 - each, i, axis=1), axis=1)
        apart = apart + others**2 * variance_along(single.jac_aircraft, scenario.cov_aircraft)
    # the same by draws: the aircraft drawn once for all radars, and once for each
    mc = monte_carlo(scenario, sampler="sobol")
    sampler = Sampler.of(scenario)
    rng = np.random.default_rng(1)
    radar, _ = sampler.draw_radar(rng.standard_normal((scenario.runs, 12)))
    miss = 1.0
    for i, s in enumerate(single_radar_scenarios(scenario).values()):
        white = rng.standard_normal((scenario.runs, 1, 6))
        drawn = Sampler.of(s).draw_p_d(white, radar[:, 4 * i : 4 * i + 4])[:, 0]
        miss = miss * (1 - drawn)
    assert_allclose(joint / apart, factor, rtol=0.02)
    assert_allclose(mc.std**2 / miss.var(), factor, rtol=0.1)
    assert_allclose(mc.std**2, joint, rtol=0.1)


def test_monte_carlo_agrees_with_form_and_probit_at_a_size_that_can_tell():
    scenario = network(
        [(0, 0, 0), (1e5, 0, 0), (0, -2e5, 0)], [60, 100, 30], poses=slice(0, None, 40)
    )
    scenario = dataclasses.replace(scenario, runs=1 << 17)
    mc = monte_carlo(scenario, sampler="sobol")
    found = moments(scenario, "form")
    # against the spread, which runs over four orders of magnitude along the orbit
    assert np.all(abs(found.mean - mc.mean) < 0.01 * mc.std)
    assert_allclose(found.std, mc.std, rtol=0.01)
    assert np.all(abs(found.lower - mc.lower) < 0.1 * mc.std)
    assert np.all(abs(found.upper - mc.upper) < 0.1 * mc.std)
    better = moments(scenario, "probit")
    trusted = ~warned(scenario, "probit")
    assert trusted.sum() >= 5
    assert_allclose(better.std[trusted], mc.std[trusted], rtol=0.03)


def test_a_network_is_validated_and_no_method_but_linear_leaves_0_to_1():
    scenario = network([(0, 0, 0), (1e5, 0, 0)], [60, 100], poses=slice(0, None, 180))
    verdict = validate(scenario, method="form", digits=1)
    assert verdict.verdict == "validated"
    steep = network([(0, 0, 0), (1e5, 0, 0)], [100, 100], attitude_deg=4)
    assert moments(steep).upper.max() > 1
    for method in ("probit", "form"):
        found = moments(steep, method)
        assert found.lower.min() >= 0
        assert found.upper.max() <= 1


# Radar constants drawn below zero.


def test_every_constant_below_zero_is_set_to_zero_and_runs_are_counted():
    scenario = network([(0, 0, 0)] * 2, [100, 1])
    cov = np.diag([0.0, 0, 0, 1, 0, 0, 0, 4])
    sampler = Sampler.of(dataclasses.replace(scenario, cov_radar={"medium": cov}))
    white = np.zeros((3, 8))
    white[:, 7] = 0, -0.25, -1
    white[2, 3] = -200
    radar, negative = sampler.draw_radar(white)
    assert_array_equal(negative, [False, False, True])
    assert_array_equal(radar[:, 7], [1, 0.5, 0])
    assert_array_equal(radar[:, 3], [100, 100, 0])


def test_below_zero_fused_p_d_goes_on_within_what_noise_can_add():
    models = [DetectionModel(RCS, p_fa) for p_fa in (1e-2, 1e-4, 1e-3)]
    net = NetworkModel(tuple(Radar(model, f"r{i}") for i, model in enumerate(models)))
    radar = np.tile([0.0, 0, 0, 0, 0, 0, 0, 70, 0, 0, 0, 20], (7, 1))
    radar[:, 3] = 10.0, 1.0, 0.0, -1.0, -30.0, -100.0, -1e6
    aircraft = np.repeat(PAPER.aircraft[90:91], len(radar), axis=0)
    seen = np.ones((len(radar), 3), dtype=bool)
    z, by_aircraft, by_radar = net.extrapolated_probit(aircraft, radar, seen)
    exact = net.p_d(aircraft, np.maximum(radar, 0))
    # as it is down to zero, smooth there, and falling by less than the first radar's noise alone
    noise = models[0].p_d(aircraft[0], np.zeros(4))
    assert_allclose(ndtr(z[:3]), exact[:3], rtol=1e-13)
    assert np.all(np.diff(z) <= 0)
    assert np.all(ndtr(z[2]) - ndtr(z[3:]) < noise)
    assert ndtr(z[2]) - ndtr(z[-1]) > 0.5 * noise
    ahead, behind = (
        net.extrapolated_probit(aircraft[:1], radar[2:3] + sign * 1e-4 * np.eye(12)[3], seen[:1])[
            0
        ][0]
        for sign in (1, -1)
    )
    assert_allclose((ahead - behind) / 2e-4, by_radar[2, 3], rtol=1e-4)
    assert np.all(np.isfinite(by_aircraft))


def test_draws_and_bounds_where_a_constant_may_be_zero():
    scenario = network([(0, 0, 0)] * 2, [60, 60], poses=slice(60, 121, 30))
    cov = np.diag([0.0, 0, 0, 1, 0, 0, 0, 25**2])
    scenario = dataclasses.replace(
        scenario, cov_aircraft=np.zeros((6, 6)), cov_radar={"medium": cov}, runs=1 << 16
    )
    mc = monte_carlo(scenario, sampler="sobol")
    assert 0.006 * mc.runs < mc.clipped < 0.01 * mc.runs  # Φ(−2.4)
    # no draw is below the first radar by itself by more than its own noise makes it
    first = moments(single_radar_scenarios(scenario)["r0"])
    assert np.all(mc.lower > first.p_d - 5 * first.std)
    assert np.all(mc.lower < moments(scenario).p_d)


@pytest.mark.parametrize("detector", [North, Marcum, Swerling1, Swerling3])
def test_no_signal_anywhere_is_the_floor(detector):
    models = [DetectionModel(ConstantRCS(1.0), p_fa, detector()) for p_fa in (1e-3, 1e-5)]
    net = NetworkModel(tuple(Radar(m, f"r{i}") for i, m in enumerate(models)))
    radar = np.zeros(8)
    z, _, _ = net.linearize_probit(PAPER.aircraft[:2], radar)
    assert_allclose(net.floor(np.ones((2, 2), dtype=bool)), z, rtol=1e-14)
    noise = [m.p_d(PAPER.aircraft[0], np.zeros(4)) for m in models]
    by_itself = net.floor(np.array([[True, False], [False, True]]))
    assert_allclose(ndtr(by_itself), noise, rtol=1e-13)


# What a radar sees.


def test_the_horizon_is_412_kilometres_for_ten_kilometres_of_height():
    # the rule of thumb 4.12 km √(h/m), of every book on radar
    assert_allclose(
        horizon_range(np.array(0.0), np.array([100.0, 1e4])), [41.2e3, 412e3], rtol=5e-4
    )
    assert_allclose(horizon_range(np.array(25.0), np.array(100.0)), 61.8e3, rtol=5e-4)
    assert_array_equal(horizon_range(np.array(-5.0), np.array(-1.0)), 0)
    # the exact line of sight over a sphere of 4/3 the radius
    for height in (100.0, 3e3, 20e3):
        exact = np.sqrt(2 * EFFECTIVE_RADIUS * height + height**2)
        assert_allclose(horizon_range(np.array(0.0), np.array(height)), exact, rtol=1e-3)


@pytest.mark.parametrize("curved", [False, True])
def test_a_target_below_the_horizon_is_not_seen(curved):
    # where the ellipsoid's radius of curvature to the north is the mean radius of the earth
    sine = np.sqrt((1 - (SEMI_MAJOR * (1 - ECCENTRICITY_2) / EARTH_RADIUS) ** (2 / 3)))
    place = (float(np.arcsin(sine / np.sqrt(ECCENTRICITY_2))), 0.0, 0.0)
    station = Radar(RADAR_MODEL, horizon=Horizon(place if curved else None))
    radar = np.array([0, 0, -10.0, 167])
    height = np.array([50.0, 1e3, 3e3])
    farthest = horizon_range(np.array(10.0), height)
    for side, seen in ((0.999, True), (1.001, False)):
        aircraft = np.zeros((3, 6))
        aircraft[:, 0] = side * farthest
        aircraft[:, 2] = -height
        if curved:  # the same heights above a surface that falls away
            aircraft[:, 2] += farthest**2 / 2 / EARTH_RADIUS * side**2
        assert_array_equal(station.visible(aircraft, radar), seen)
        assert np.all((NetworkModel((station,)).p_d(aircraft, radar) > 0) == seen)
    # the paper's orbit, 500 km out and 3 km high, is far below it
    seen = station.visible(PAPER.aircraft, np.array([0, 0, 0, 167.0]))
    assert np.all(seen == curved)  # where 3 km above the plane are 22 above the surface


def test_a_radar_sees_as_far_as_its_maximum_range_and_no_farther():
    station = Radar(RADAR_MODEL, max_range=5e3)
    aircraft = np.zeros((3, 6))
    aircraft[:, 0], aircraft[:, 2] = 3e3, [-4e3, -4e3 - 1e-6, -3.9e3]  # slant: 3, 4, 5
    assert_array_equal(station.visible(aircraft, np.array([0, 0, 0, 1.0])), [True, False, True])


def test_a_budget_does_not_warn_of_a_radar_that_does_not_see():
    scenario = network([(0, 0, 0), (1e5, 0, 0)], [60, 100], poses=slice(None, None, 20))
    near = Radar(RADAR_MODEL, "near", max_range=4.5e5)
    far, _ = scenario.model.radars
    scenario = dataclasses.replace(scenario, model=NetworkModel((far, near)))
    seen = scenario.model.visible(scenario.aircraft, scenario.radar)[:, 1]
    assert 3 < seen.sum() < len(seen) - 3
    assert not [w for w in analyses.budget(scenario).warnings if "near vanishes" in w]


def test_a_radar_that_sees_nothing_adds_nothing():
    aircraft, near, far = PAPER.aircraft, [0, 0, 0, 167.0], [-1e5, 0, 0, 167.0]
    model = NetworkModel((Radar(RADAR_MODEL, "near"), Radar(RADAR_MODEL, "far", 5.5e5)))
    radar = np.array([*near, *far])
    hidden = ~model.visible(aircraft, radar)[:, 1]
    assert 50 < hidden.sum() < 300
    both, alone_ = model.linearize(aircraft, radar), RADAR_MODEL.linearize(aircraft, np.array(near))
    assert_array_equal(model.p_d(aircraft, radar)[hidden], alone_.p_d[hidden])
    assert_allclose(both.p_d[hidden], alone_.p_d[hidden], rtol=1e-12)
    assert_allclose(both.jac_aircraft[hidden], alone_.jac_aircraft[hidden], rtol=1e-11, atol=1e-25)
    assert_array_equal(both.jac_radar[hidden, 4:], 0)
    assert np.all(both.jac_radar[~hidden, 7] > 0)
    z, z_aircraft, z_radar = model.linearize_probit(aircraft, radar)
    exact, by_aircraft, _ = RADAR_MODEL.linearize_probit(aircraft, np.array(near))
    assert_allclose(z[hidden], exact[hidden], rtol=0, atol=1e-13)
    assert_allclose(z_aircraft[hidden], by_aircraft[hidden], rtol=1e-11, atol=1e-25)
    assert_array_equal(z_radar[hidden, 4:], 0)
    assert_array_equal(p_d_each(model, aircraft, radar)[hidden, 1], 0)


@pytest.mark.parametrize("radars", [1, 2])
def test_a_pose_that_no_radar_sees_has_nothing_uncertain(radars):
    unseen = network([(0, 0, 0)] * radars, [100] * radars, max_range=4e5)
    with np.errstate(all="raise", under="ignore"):
        for method in METHODS:
            found = moments(unseen, method)
            for values in (found.p_d, found.mean, found.std, found.lower, found.upper):
                assert_array_equal(values, 0)
            assert not warned(unseen, method).any()
            assert found.converged.all()
        z, by_aircraft, by_radar = unseen.model.linearize_probit(unseen.aircraft, unseen.radar)
        assert_array_equal(z, -np.inf)
        assert not by_aircraft.any()
        assert not by_radar.any()
        lin = unseen.model.linearize(unseen.aircraft, unseen.radar)
        assert not any(values.any() for values in fields_of(lin))
        mc = monte_carlo(unseen, runs=50)
        assert_array_equal(mc.std, 0)
        assert_array_equal(mc.coverage, 1)
        for std in error_budget(unseen).alone.values():
            assert_array_equal(std, 0)


def test_draws_see_an_edge_that_a_gradient_cannot():
    # at a range within 1 m of the limit, with 100 m of uncertainty: seen in half of the draws
    reach = float(np.hypot(500e3, 3e3))
    nowhere = {"cov_aircraft": np.diag([10.0**2] * 3 + [1e-20] * 3), "runs": 4000}
    for offset in (1.0, -1.0):
        edge = dataclasses.replace(network([(0, 0, 0)], [100], max_range=reach + offset), **nowhere)
        seen = offset > 0
        mc = monte_carlo(edge)
        full = RADAR_MODEL.p_d(edge.aircraft, edge.radar)
        assert_allclose(mc.mean / full, 0.5, atol=0.05)
        for method in METHODS:
            found = moments(edge, method)
            assert np.all((found.p_d > 0) == seen)
            assert warned(edge, method).all()
    far = dataclasses.replace(network([(0, 0, 0)], [100], max_range=reach + 2000), **nowhere)
    assert_array_equal(
        warned(far, "form"),
        nonlinear(
            RADAR_MODEL,
            far.aircraft,
            far.radar,
            far.cov_aircraft,
            far.cov_radar["medium"],
            method="form",
        ),
    )


# Budgets and analyses.


def test_budget_has_rows_for_the_aircraft_and_each_radar():
    scenario = network([(0, 0, 0), (1e5, 0, 0), (0, -2e5, 0)], [60, 100, 30])
    found = error_budget(scenario)
    assert list(found.alone) == ["aircraft_position", "aircraft_orientation", "r0", "r1", "r2"]
    assert list(found.finer) == [
        "aircraft",
        *(f"r{i}_{part}" for i in range(3) for part in ("position", "constant")),
    ]
    squares = {name: std**2 for name, std in {**found.alone, **found.finer}.items()}
    assert_allclose(sum(squares[s] for s in found.alone), found.std**2, rtol=1e-12)
    assert_allclose(
        squares["aircraft"], squares["aircraft_position"] + squares["aircraft_orientation"]
    )
    lin = scenario.model.linearize(scenario.aircraft, scenario.radar)
    assert_allclose(
        found.alone["r1"] ** 2,
        np.sum(lin.jac_radar[:, 4:8] ** 2 * np.diag(PAPER.cov_radar["medium"]), axis=1),
    )
    for i in range(3):
        parts = squares[f"r{i}_position"] + squares[f"r{i}_constant"]
        assert_allclose(squares[f"r{i}"], parts, rtol=1e-12)
        assert_allclose(found.finer[f"r{i}_constant"], 5 * lin.jac_radar[:, 4 * i + 3])
    allowed = required_accuracies(
        network([(0, 0, 0), (1e5, 0, 0)], [60, 100], poses=slice(90, 91)), 0.05
    )
    assert list(allowed) == ["aircraft_position", "aircraft_orientation", "r0", "r1", "all"]


def test_budget_by_sobol_indices_of_a_network():
    scenario = network([(0, 0, 0), (1e5, 0, 0)], [60, 100], poses=slice(90, 271, 90))
    linear = error_budget(scenario)
    found = error_budget(dataclasses.replace(scenario, runs=8192), "montecarlo")
    assert list(found.alone) == list(linear.alone)
    form = moments(scenario, "form")
    assert_allclose(found.std, form.std, rtol=0.03)
    shares, first = found.shares(), linear.shares()
    near = ~warned(scenario, "probit")
    for source, share in shares.items():
        assert np.all(abs(share - first[source])[near] < 0.1)


def test_each_radar_by_itself():
    scenario = network([(0, 0, 0), (1e5, 0, 0)], [60, 100])
    # the second is twice as uncertain as the first
    worse = {level: np.kron(np.diag([1, 4]), c) for level, c in PAPER.cov_radar.items()}
    scenario = dataclasses.replace(scenario, cov_radar=worse)
    parts = single_radar_scenarios(scenario)
    assert list(parts) == ["r0", "r1"]
    assert_array_equal(parts["r1"].radar, [1e5, 0, 0, 100])
    assert_array_equal(parts["r0"].cov_radar["high"], PAPER.cov_radar["high"])
    assert_array_equal(parts["r1"].cov_radar["high"], 4 * PAPER.cov_radar["high"])
    expected = propagate(
        RADAR_MODEL,
        scenario.aircraft,
        parts["r1"].radar,
        scenario.cov_aircraft,
        4 * PAPER.cov_radar["medium"],
    )
    assert_array_equal(moments(parts["r1"]).std, expected.std)


@pytest.mark.parametrize(
    "analysis",
    [
        analyses.variance,
        analyses.sensitivity,
        analyses.budget,
        analyses.montecarlo,
        analyses.compare,
        analyses.detectors,
    ],
)
def test_analyses_and_figures_take_a_network(analysis):

    from radar_sense import plotting

    scenario = network([(0, 0, 0), (1e5, 0, 0)], [60, 100], poses=slice(0, None, 60))
    result = analysis(dataclasses.replace(scenario, runs=64))
    assert all(np.all(np.isfinite(column)) for column in result.table.values())
    assert len({len(column) for column in result.table.values()}) == 1
    assert plotting.render(result.plot(), "svg")


def test_variance_table_has_each_radar_and_the_network():
    scenario = network([(0, 0, 0), (1e5, 0, 0)], [60, 100], max_range=5.005e5)
    table = analyses.variance(scenario, method="probit").table
    for i in range(2):
        part = single_radar_scenarios(scenario)[f"r{i}"]
        single = propagate(
            part.model,
            part.aircraft,
            part.radar,
            part.cov_aircraft,
            part.cov_radar["medium"],
            method="probit",
        )
        assert_array_equal(table[f"p_d_r{i}"], single.p_d)
        assert_array_equal(table[f"sigma_pd_r{i}"], single.std)
        away = np.linalg.norm(scenario.aircraft[:, :3] - part.radar[:3], axis=1)
        assert_allclose(table[f"range_m_r{i}"], away, rtol=1e-14)
        assert_array_equal(table[f"snr_db_r{i}"] == -np.inf, away > 5.005e5)
        assert_array_equal(single.p_d == 0, away > 5.005e5)
    hidden = table["snr_db_r1"] == -np.inf
    assert 0 < hidden.sum() < len(hidden)
    miss = (1 - table["p_d_r0"]) * (1 - table["p_d_r1"])
    assert_allclose(table["p_d"], 1 - miss, rtol=0, atol=1e-15)


# What is refused.


def test_networks_that_cannot_be():
    station = Radar(RADAR_MODEL, "a")
    with pytest.raises(ValueError, match="at least one radar"):
        NetworkModel(())
    for names in (
        "aa",
        ("a", "a_position"),
        ("a_constant", "a"),
        ("total", "b"),
        ("b", "aircraft"),
    ):
        with pytest.raises(ValueError, match="would mean two things"):
            NetworkModel(tuple(dataclasses.replace(station, name=name) for name in names))
    other = Radar(DetectionModel(ConstantRCS(1.0), 1e-4), "b")
    with pytest.raises(ValueError, match="RCS"):
        NetworkModel((station, other))
    for limit in (0, -1, np.nan):
        with pytest.raises(ValueError, match="max_range"):
            Radar(RADAR_MODEL, max_range=limit)
    net = NetworkModel((station, dataclasses.replace(station, name="b")))
    for method in (net.p_d, net.snr, net.linearize, net.linearize_probit, net.visible):
        with pytest.raises(ValueError, match=r"radar states must have shape \(..., 8\)"):
            method(PAPER.aircraft, np.zeros(4))
    with pytest.raises(ValueError, match="negative"):
        net.p_d(PAPER.aircraft, np.array([0, 0, 0, 1, 0, 0, 0, -1.0]))


# Constants whose logarithm is Gaussian.


@pytest.mark.parametrize("models", [None, [DetectionModel(RCS, 1e-4), RADAR_MODEL]])
def test_log_normal_constants_of_a_network_are_in_z_and_in_its_gradient(models):
    net = network([(0, 0, 0), (1e5, -2e5, 0)], (160.0, 90.0), models=models)
    cov = 400.0 * net.cov_radar["high"]  # constants to 200: a normal one would be below zero
    states = net.model, net.aircraft, net.radar, net.cov_aircraft, cov
    z = StandardNormalSpace.of(uncertain_states(*states, log_constant=True)[1])
    pose = np.arange(len(net.aircraft))
    u = np.random.default_rng(3).uniform(-0.7, 0.7, z.gradient.shape)
    shift = np.einsum("kij,jk->ki", z.sqrt_cov, u)
    aircraft, radar = net.aircraft.copy(), net.radar + shift[:, 3:]
    aircraft[:, 3:] += shift[:, :3]
    radar[:, CONSTANTS] = net.radar[CONSTANTS] * np.exp(shift[:, 3:][:, CONSTANTS] / (160.0, 90.0))
    value, gradient = z(u, pose)
    assert_allclose(ndtr(value), net.model.p_d(aircraft, radar), rtol=1e-12)
    for i in range(len(u)):
        step = 1e-5 * np.eye(len(u))[:, i, np.newaxis]
        slope = (z(u + step, pose)[0] - z(u - step, pose)[0]) / 2e-5
        assert_allclose(gradient[i], slope, rtol=1e-6, atol=1e-7)
