"""Networks: fused P_D and its partials, and targets beyond the limits of a radar."""

import dataclasses

import numpy as np
import oracle
import pytest
from helpers import nonlinear_by_its_own_moments, p_d_each, paper_network, stds_of, with_arrays
from mpmath import mp, mpf
from numpy.testing import assert_allclose, assert_array_equal

from radar_sense import analyses
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.detectors import Marcum, North, Swerling1
from radar_sense.model.fusion import excess_hazard, fuse_probits, linearize_fusion
from radar_sense.model.horizon import EFFECTIVE_RADIUS, Horizon, horizon_range
from radar_sense.model.network import NetworkModel
from radar_sense.model.radar import Radar
from radar_sense.model.rcs import EllipsoidRCS
from radar_sense.montecarlo.montecarlo import monte_carlo
from radar_sense.propagation import METHODS, propagate_scenario, unreliable
from radar_sense.scenario_file.load import load_scenario
from radar_sense.sources import error_budget

PAPER = load_scenario()
RADAR_MODEL = PAPER.model.radars[0].model
RCS = EllipsoidRCS(0.15, 0.13, 0.21)
ELLIPSOID = ("ellipsoid", 0.15, 0.13, 0.21)


def fields_of(found):
    return [getattr(found, f.name) for f in dataclasses.fields(found)]


def test_the_probit_of_one_radar_is_that_of_its_model():
    radar = np.array([3e3, -2e3, -100.0, 160.0])
    one = NetworkModel((Radar(RADAR_MODEL, max_range=1e7),))
    both = (model.linearize_probit(PAPER.aircraft, radar) for model in (one, RADAR_MODEL))
    for mine, theirs in zip(*both, strict=True):
        assert_allclose(mine, theirs, rtol=1e-12)


# The fused P_D and its partials.

DETECTORS = {North: oracle.north_tails, Marcum: oracle.marcum, Swerling1: oracle.swerling1}


def exact_miss(states, models):
    """1 − P_D of all radars at states of 6 + 4m numbers."""
    miss = mpf(1)
    for i, (detector, p_fa) in enumerate(models):
        snr = oracle.snr(states[:6], states[6 + 4 * i : 10 + 4 * i], ELLIPSOID)
        miss *= DETECTORS[detector](snr, p_fa)[1]
    return miss


def exact_partials(states, models):
    """Partials of P_D by all states."""
    orders = np.eye(len(states), dtype=int).tolist()
    return [-mp.diff(lambda *x: exact_miss(x, models), states, tuple(n)) for n in orders]


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
@pytest.mark.parametrize("distance", [6e5, 3e5])
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
        states = [mpf(x) for x in (*aircraft, *radar)]
        miss = exact_miss(states, kinds)
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
    """From P_D of 1e-784, far below the least float, to 1 − P_D below 1e-300."""
    rng = np.random.default_rng(3)
    for m in (2, 3, 5):
        z = rng.uniform(-30, 30, 60) + rng.standard_normal((m, 60)) * rng.uniform(0, 2, 60)
        z[:, :10] = -9 + rng.standard_normal((m, 10)) / 100  # where the formula changes
        z[:, 10:12] = -60 + 20 * rng.random((m, 2))
        fused = fuse_probits(z)
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


def test_second_derivatives_of_the_fusion():
    # against differences in 40 digits of z, by its definition
    rng = np.random.default_rng(8)
    columns = [rng.uniform(-12, 12, m) for m in (2, 3)]
    columns += [np.array(z) for z in ([30.0, 29.9], [-8.9, -9.1, -9.0], [0.0, 9.0], [-6.0, 3.0])]
    with mp.workdps(40):

        def fused(*each):
            miss = mp.fprod(mp.ncdf(-z) for z in each)
            start = mpf(float(fuse_probits(np.array(each, dtype=float))))
            return mp.findroot(lambda z: mp.log(mp.ncdf(-z) / miss), start)

        for z in columns:
            value, weight = linearize_fusion(z)
            second = np.diag(weight * excess_hazard(z))
            second -= np.outer(weight, weight) * excess_hazard(value)
            assert_array_equal(second, second.T)
            point = [mpf(x) for x in z]
            for i, j in zip(*np.triu_indices(len(z)), strict=True):
                orders = np.bincount([i, j], minlength=len(z)).tolist()
                exact = float(mp.diff(fused, point, tuple(orders)))
                scale = max(abs(float(weight[i])), abs(float(weight[j]))) * (1 + abs(value))
                assert abs(second[i, j] - exact) < 1e-11 * scale, (z, i, j)


def test_excess_hazard_of_any_z():
    z = np.concatenate([np.linspace(-1e3, 1e3, 401), [99.99, 100.0, 100.01, -1e6, 1e6, 1e12]])
    with mp.workdps(60):
        for x, value in zip(z, excess_hazard(z), strict=True):
            tail = mp.erfc(mpf(x) / mp.sqrt(2)) / 2
            exact = mp.exp(-(mpf(x) ** 2) / 2) / mp.sqrt(2 * mp.pi) / tail - mpf(x)
            assert abs(value / exact - 1) < 2e-12, x


def test_states_broadcast():
    net = NetworkModel((Radar(RADAR_MODEL, "a"), Radar(RADAR_MODEL, "b")))
    rng = np.random.default_rng(0)
    radar = rng.standard_normal((7, 1, 8)) * 1e4
    radar[..., 3::4] = 160
    lin = net.linearize(PAPER.aircraft[:5], radar)
    assert lin.p_d.shape == net.p_d(PAPER.aircraft[:5], radar).shape == (7, 5)
    assert lin.jac_aircraft.shape == (7, 5, 6)
    assert lin.jac_radar.shape == (7, 5, 8)
    one = net.linearize(PAPER.aircraft[2], radar[3, 0])
    assert_allclose(one.jac_radar, lin.jac_radar[3, 2], rtol=1e-13)
    assert one.p_d.shape == ()


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


def test_errors_in_the_level_plane_lead_upwards_on_the_round_earth():
    horizon, states = Horizon((0.8, 0.1, 0.0)), np.zeros((1, 6))
    error = horizon.height_error(states, np.diag([1e6, 1e6, 0.0])[np.newaxis], 8.0)
    states[0, :2] = 8e3 * np.array([0.6, 0.8])
    assert_allclose(horizon.height(states), error, rtol=0.01)
    assert_array_equal(
        Horizon().height_error(states, np.diag([1e6, 1e6, 4.0])[np.newaxis], 8.0), 16
    )


def test_the_sight_of_a_radar_ends_at_its_limits():
    """Of the slant range, and of the horizon for aircraft at 50 m to 3 km."""
    radar, aircraft = np.array([0, 0, -10.0, 167]), np.zeros((5, 6))
    aircraft[:, 0], aircraft[:, 2] = [5e3, 5e3 - 1e-6, 5e3 + 1e-6, 6e3, 6e3 + 1e-6], -10
    seen = Radar(RADAR_MODEL, min_range=5e3, max_range=6e3).visible(aircraft, radar)
    assert seen.tolist() == [True, False, True, True, False]
    height, aircraft = np.array([50.0, 1e3, 3e3]), np.zeros((3, 6))
    for side in (0.999, 1.001):
        aircraft[:, 0], aircraft[:, 2] = side * horizon_range(np.array(10.0), height), -height
        assert np.all(Radar(RADAR_MODEL, horizon=Horizon()).visible(aircraft, radar) == (side < 1))


def test_a_budget_misses_nothing_of_a_radar_that_does_not_see():
    scenario = paper_network([(0, 0, 0), (1e5, 0, 0)], [60, 100], poses=slice(None, None, 20))
    near = Radar(RADAR_MODEL, "near", max_range=4.5e5)
    far, _ = scenario.model.radars
    scenario = with_arrays(scenario, model=NetworkModel((far, near)))
    seen = scenario.model.visible(scenario.aircraft, scenario.radar)[:, 1]
    assert 3 < seen.sum() < len(seen) - 3
    assert [*analyses.budget(scenario).summary["gradient_vanishes"]] == ["aircraft_orientation"]


def test_a_radar_that_sees_nothing_adds_nothing():
    aircraft, near, far = PAPER.aircraft, [0, 0, 0, 167.0], [-1e5, 0, 0, 167.0]
    model = NetworkModel((Radar(RADAR_MODEL, "near"), Radar(RADAR_MODEL, "far", max_range=5.5e5)))
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
    unseen = paper_network([(0, 0, 0)] * radars, [100] * radars, max_range=4e5)
    with np.errstate(all="raise", under="ignore"):
        for method in METHODS:
            found = propagate_scenario(unseen, method=method)
            for values in (found.p_d, found.mean, found.std, found.lower, found.upper):
                assert_array_equal(values, 0)
            assert_array_equal(found.error, 0)
            assert not nonlinear_by_its_own_moments(unseen, method).any()
        z, by_aircraft, by_radar = unseen.model.linearize_probit(unseen.aircraft, unseen.radar)
        assert_array_equal(z, -np.inf)
        assert not by_aircraft.any()
        assert not by_radar.any()
        lin = unseen.model.linearize(unseen.aircraft, unseen.radar)
        assert not any(values.any() for values in fields_of(lin))
        mc = monte_carlo(unseen, runs=50)
        assert_array_equal(mc.std, 0)
        assert_array_equal(mc.coverage, 1)
        for std in stds_of(error_budget(unseen).sources).values():
            assert_array_equal(std, 0)


def test_methods_warn_of_a_minimum_range_within_reach():
    """The range is within 1 m of the limit, and known to 10 m; or 2 km away from it."""
    reach, known = float(np.hypot(500e3, 3e3)), np.diag([10.0**2] * 3 + [1e-20] * 3)
    for offset in (-1.0, 1.0, -2000.0):
        edge = paper_network([(0, 0, 0)], [100], min_range=reach + offset)
        edge = with_arrays(edge, cov_aircraft=known)
        states = edge.aircraft, edge.radar, edge.cov_aircraft, edge.cov_radar
        for method in ("linear", "probit", "form"):
            warned = nonlinear_by_its_own_moments(edge, method)
            without = unreliable(RADAR_MODEL, *states, method=method)
            assert_array_equal(warned, without if offset < -1 else True)


def test_refused_networks():
    first = Radar(RADAR_MODEL, "a")
    with pytest.raises(ValueError, match="one radar or more"):
        NetworkModel(())
    with pytest.raises(ValueError, match="every radar of a network needs a name"):
        NetworkModel((first, Radar(RADAR_MODEL)))
    with pytest.raises(ValueError, match="'a' is there twice"):
        NetworkModel((first, first))
    two = paper_network([(0, 0, 0)] * 2, [1, 1])
    for names in (("a", "a_position"), ("a_constant", "a"), ("total", "b"), ("b", "aircraft")):
        network = NetworkModel(tuple(dataclasses.replace(first, name=name) for name in names))
        with pytest.raises(ValueError, match="would mean two things"):
            with_arrays(two, model=network)
    for limit in (0, -1, np.nan):
        with pytest.raises(ValueError, match="max_range"):
            Radar(RADAR_MODEL, max_range=limit)
    for wrong in ({"min_range": -1}, {"min_range": np.nan}, {"min_range": 5, "max_range": 5}):
        with pytest.raises(ValueError, match="min_range must be"):
            Radar(RADAR_MODEL, **wrong)
    net = NetworkModel((first, dataclasses.replace(first, name="b")))
    for method in (net.p_d, net.snr, net.linearize, net.linearize_probit, net.visible):
        with pytest.raises(ValueError, match=r"radar states must have shape \(..., 8\)"):
            method(PAPER.aircraft, np.zeros(4))
    with pytest.raises(ValueError, match="negative"):
        net.p_d(PAPER.aircraft, np.array([0, 0, 0, 1, 0, 0, 0, -1.0]))
