"""Methods of propagation against references without their code.

References: the reference set on the paper's scenario (tests/reference), draws on random scenarios,
Gauss-Legendre quadrature over one state, and mpmath. `test_draws` has the draws of the methods
themselves.
"""

import numpy as np
import pytest
from helpers import paper_aircraft
from mpmath import mp, mpf
from numpy.testing import assert_allclose, assert_array_equal
from reference import reading
from scipy.constants import Boltzmann
from scipy.special import ndtr
from scipy.stats import chi2, ncx2, norm
from studies.bands import package, populations, truth

from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.detectors import Marcum, North, Swerling1, Swerling3
from radar_sense.model.network import NetworkModel
from radar_sense.model.radar import Radar
from radar_sense.model.rcs import ConstantRCS, EllipsoidRCS, SpikeballRCS
from radar_sense.model.rcs_table import TableRCS
from radar_sense.propagation import (
    METHODS,
    Moments,
    form,
    propagate,
    propagate_scenario,
    unreliable,
)
from radar_sense.propagation.moments import probit_moments

THETA_DEG = np.arange(361) * 0.5
#: The poses of the paper's scenario in the reference set, and its columns by level.
IN_REFERENCE = slice(None, None, 5)
REFERENCE = {level: reading.paper(level) for level in ("low", "medium", "high")}

MODEL = DetectionModel(rcs=EllipsoidRCS(a=0.15, b=0.13, c=0.21), p_fa=1.7e-4)
RADAR = np.array([0.0, 0.0, 0.0, 167.0])
DEGREE = np.radians(1.0)
VALUES = ("mean", "std", "lower", "upper")
#: The methods without draws.
SMOOTH = ("linear", "probit", "form")


def independent(*std):
    return np.diag(np.square(std))


AIRCRAFT = paper_aircraft(THETA_DEG)
COV_AIRCRAFT = independent(10, 10, 10, DEGREE, DEGREE, DEGREE)
COV_RADAR = {
    "low": independent(10, 10, 10, 1),
    "medium": independent(100, 100, 100, 5),
    "high": independent(1000, 1000, 1000, 10),
}
CERTAIN_AIRCRAFT, CERTAIN_RADAR = np.zeros((6, 6)), np.zeros((4, 4))


def on_paper(method, level, **kwargs):
    return propagate(
        MODEL, AIRCRAFT, RADAR, COV_AIRCRAFT, COV_RADAR[level], method=method, **kwargs
    )


def assert_same(found, expected, rtol=1e-12):
    for name in ("p_d", *VALUES):
        assert_allclose(getattr(found, name), getattr(expected, name), rtol=rtol, err_msg=name)
    assert_allclose(found.error, expected.error, rtol=1e-6, atol=1e-12)


#: Largest errors of bounds at β = 3, of σ (relative) and of the mean. Each is some 10 % above the
#: measured one. The requirements are wider: bounds 0.005 and σ 3 % by `probit`; bounds
#: 0.0005, σ 0.5 % (1.5 % at Low) and mean 0.0002 by `form`; none for `linear`.
ERRORS = {
    ("linear", "low"): (4.3e-3, 0.0159, 4.4e-4),
    ("linear", "medium"): (1.13e-2, 0.0418, 1.3e-3),
    ("linear", "high"): (3.9e-2, 0.145, 4.0e-3),
    ("probit", "low"): (2.3e-3, 0.0146, 2.9e-4),
    ("probit", "medium"): (1.1e-3, 0.0108, 1.1e-4),
    ("probit", "high"): (4.9e-3, 0.0299, 5.0e-4),
    ("form", "low"): (1.1e-5, 4.5e-4, 8e-7),
    ("form", "medium"): (1.7e-5, 3.5e-4, 5e-7),
    ("form", "high"): (6.2e-5, 4.2e-4, 1.5e-6),
}


@pytest.mark.parametrize(("method", "level"), ERRORS)
def test_error_on_the_paper_s_scenario(method, level):
    found, exact = on_paper(method, level), REFERENCE[level]
    of_poses = found.at(IN_REFERENCE)
    bounds = [of_poses.lower - exact["lower_3"], of_poses.upper - exact["upper_3"]]
    errors = [
        np.max(np.abs(bounds)),
        np.max(abs(of_poses.std / exact["std"] - 1)),
        np.max(abs(of_poses.mean - exact["mean"])),
    ]
    assert np.all(np.array(errors) < ERRORS[method, level])
    # The claims are tight: a method that has become better or another one shows as well.
    assert np.all(np.array(errors) > 0.5 * np.array(ERRORS[method, level]))
    assert_array_equal(found.error, 0.0)
    assert_array_equal(found.p_d, MODEL.p_d(AIRCRAFT, RADAR))
    for beta in (1, 2) if method == "form" else ():
        other = on_paper(method, level, beta=beta).at(IN_REFERENCE)
        assert_allclose(other.lower, exact[f"lower_{beta}"], rtol=0, atol=4.5e-5)
        assert_allclose(other.upper, exact[f"upper_{beta}"], rtol=0, atol=4.5e-5)


def parts_of_what_is_allowed(found, lower, upper, std):
    """Return errors of the bounds in units of 0.005; and of a tenth of a bound or 5 % of σ."""
    errors = [abs(found.lower - lower), abs(found.upper - upper), abs(found.std - std)]
    allowed = 0.1 * lower, 0.1 * upper, 0.05 * std
    relative = [e / np.maximum(a, 1e-6) for e, a in zip(errors, allowed, strict=True)]
    return np.max(errors[:2], axis=0) / 0.005, np.max(relative, axis=0)


def test_linear_is_the_linearization():
    rng, lin = np.random.default_rng(1), MODEL.linearize(AIRCRAFT, RADAR)
    full = correlated(rng, [10, 20, 30, 0.01, 0.02, 0.03]), correlated(rng, [100, 200, 300, 10])
    for covariances in ((COV_AIRCRAFT, COV_RADAR["medium"]), full):
        found = propagate(MODEL, AIRCRAFT, RADAR, *covariances, method="linear", beta=2.0)
        std = lin.std(*covariances)
        assert_allclose(found.std, std, rtol=1e-14)
        assert_array_equal([found.p_d, found.mean], [lin.p_d] * 2)
        assert_allclose(found.lower, lin.p_d - 2 * std, atol=1e-15)
        assert_allclose(found.upper, lin.p_d + 2 * std, atol=1e-15)


def test_moments_of_a_probit_agree_with_thirty_digits():
    """The reference is the defining integral over the normal density."""
    for m in (0.0, 0.3, -1.0, 9.0):
        for s in (1e-7, 0.03, 0.5, 3.0, 30.0):
            mean, std = probit_moments(np.array([m]), np.array([s]))
            with mp.workdps(40):
                h = mpf(m) / mp.sqrt(1 + mpf(s) ** 2)
                a = 1 / mp.sqrt(1 + 2 * mpf(s) ** 2)
                exact_mean = mp.ncdf(h)

                def owen(t, h=h):
                    return mp.exp(-h * h * (1 + t * t) / 2) / (1 + t * t) / mp.pi

                exact_variance = mp.quad(owen, mp.linspace(a, 1, 6))
            assert mean[0] == pytest.approx(float(exact_mean), rel=3e-14)
            assert std[0] == pytest.approx(float(mp.sqrt(exact_variance)), rel=3e-14)
            if (m, s) in ((0.3, 0.5), (-1.0, 3.0)):  # the definition itself

                def square(u, m=m, s=s, e=exact_mean):
                    return (mp.ncdf(m + s * u) - e) ** 2 * mp.npdf(u)

                with mp.workdps(20):
                    defined = mp.quad(square, [-14, -8, -6, -4, -2, 0, 2, 4, 6, 8, 14])
                assert float(defined / exact_variance) == pytest.approx(1, rel=1e-8)


def test_quantiles_of_a_quadratic_that_are_known():
    """r* is exact without λ, off by 4 % of a deviation where λ is g, by 1.2 % for chi-square."""
    beta = np.array([-4.0, -3.0, -1.0, 0.0, 1.0, 3.0, 4.0])
    level = ndtr(beta)
    cases = [  # g, λ, quantiles; relative tolerance, tolerance in standard deviations
        ([2.0, 0.0, -1.0], [0.0, 0.0, 0.0], np.sqrt(5) * beta, 0.0, 1e-9),
        # g u + λu²/2 = λ/2 (u + g/λ)² − g²/(2λ)
        ([1.0], [0.04], 0.02 * ncx2.ppf(level, 1, 625.0) - 12.5, 0.0, 1e-5),
        ([1.0], [0.2], 0.1 * ncx2.ppf(level, 1, 25.0) - 2.5, 0.0, 1.1e-3),
        ([0.6, 0.8], [0.3, 0.3], 0.15 * ncx2.ppf(level, 2, 1 / 0.09) - 1 / 0.6, 0.0, 2.5e-3),
        ([1.0], [1.0], 0.5 * ncx2.ppf(level, 1, 1.0) - 0.5, 0.0, 0.045),
        ([0.0], [2.0], chi2.ppf(level, 1), 0.012, 0.003),
        ([0.0] * 3, [-2.0] * 3, -chi2.ppf(ndtr(-beta), 3), 0.012, 0.003),
    ]
    for g, lam, exact, relative, tolerance in cases:
        found = form.quadratic_quantile(np.array([g]).T, np.array([lam]).T, beta)[:, 0]
        spread = np.sqrt(np.sum(np.square(g)) + 0.5 * np.sum(np.square(lam)))
        assert_allclose(found, exact, rtol=relative, atol=tolerance * spread)
    assert_array_equal(form.quadratic_quantile(np.zeros((2, 1)), np.zeros((2, 1)), beta), 0.0)


# One uncertain state: quantiles of a function of one variable, and moments by integrals.


def one_state(which, std):
    """Covariances in which that component of the ten states alone is uncertain."""
    variances = np.zeros(10)
    variances[which] = std**2
    return np.diag(variances[:6]), np.diag(variances[6:])


NODES, WEIGHTS = np.polynomial.legendre.leggauss(400)


def exact_moments(p_d_at, breaks=()):
    """Mean and standard deviation of a function of one standard normal variable."""
    ends = np.unique([-9.0, -3.0, 0.0, 3.0, 9.0, *breaks])
    half = 0.5 * np.diff(ends)[:, np.newaxis]
    u = ends[:-1, np.newaxis] + half * (1 + NODES)
    weight = half * WEIGHTS * norm.pdf(u)
    off = p_d_at(u) - p_d_at(0.0)
    drift = np.sum(weight * off)
    return p_d_at(0.0) + drift, np.sqrt(np.sum(weight * (off - drift) ** 2))


def along_state(which, pose, radar, std):
    """Return P_D as a function of the unit normal of one of the ten states; c_r is at least 0."""

    def p_d_at(u):
        states = np.tile(np.concatenate((pose, radar)), (*np.shape(u), 1))
        states[..., which] += std * np.asarray(u)
        states[..., 9] = np.maximum(states[..., 9], 0)
        return MODEL.p_d(states[..., :6], states[..., 6:])

    return p_d_at


def check_alone(which, pose, radar, std, *, bound=None, of_mean=None, of_std=1e-3, breaks=()):
    """Check FORM for one uncertain state in which P_D is monotone, and return it and the exact σ.

    Bounds and mean are given to so much, or to a thousandth of the exact σ.
    """
    found = propagate(MODEL, pose, radar, *one_state(which, std), method="form")
    p_d_at = along_state(which, pose, radar, std)
    mean, exact = exact_moments(p_d_at, breaks)
    assert found.std == pytest.approx(exact, rel=of_std)
    assert found.mean == pytest.approx(mean, abs=of_mean or 1e-3 * exact)
    ends = sorted((p_d_at(-3.0), p_d_at(3.0)))
    assert_allclose([found.lower, found.upper], ends, rtol=0, atol=bound or 1e-3 * exact)
    return found, exact


@pytest.mark.parametrize(
    ("percent", "bound_error", "std_error"),
    [(0.01, 1e-12, 1e-7), (10, 2e-5, 1e-5), (50, 5e-4, 0.011)],
)
def test_radar_constant_alone(percent, bound_error, std_error):
    """Monotone, so the bounds are P_D at c_r (1 ± 3 percent); at 50 % c_r is below zero at −2."""
    std = percent / 100 * RADAR[3]
    errors = {"bound": bound_error, "of_mean": 2 * bound_error, "of_std": std_error}
    aircraft = paper_aircraft(np.array([0.0, 30.0, 60.0, 90.0]))
    for pose in aircraft:
        check_alone(9, pose, RADAR, std, **errors, breaks=[max(-100 / percent, -9.0)])
    warned = unreliable(MODEL, aircraft, RADAR, *one_state(9, std), method="form")
    assert not warned.any()  # bounds and σ are good at every pose


def test_a_radar_constant_that_is_half_the_time_zero():
    """Then P_D has a floor that half of the draws are at, which is where the lower bound is."""
    pose, none = paper_aircraft(90.0), RADAR * 0.0
    p_d_at = along_state(9, pose, none, 5.0)
    _, exact = exact_moments(p_d_at)
    errors = {"bound": 0.02 * p_d_at(3.0), "of_mean": 0.01 * exact, "of_std": 0.01}
    found, _ = check_alone(9, pose, none, 5.0, **errors)
    assert found.lower == pytest.approx(p_d_at(-3.0), rel=1e-12)


@pytest.mark.parametrize("percent", [50, 100, 200])
def test_form_has_a_value_where_a_radar_constant_may_be_zero(percent):
    """Then the least P_D within 3 sigma is that without a signal, whatever else is uncertain."""
    cov_radar = independent(1e3, 1e3, 1e3, percent / 100 * RADAR[3])
    poses = AIRCRAFT[::30]
    found = propagate(MODEL, poses, RADAR, COV_AIRCRAFT, cov_radar, method="form")
    assert np.isfinite(found.std).all()
    assert_allclose(found.lower, MODEL.p_d(poses, RADAR * [1, 1, 1, 0]), rtol=1e-12)


@pytest.mark.parametrize("which", [0, 1, 3, 5, 6])
def test_another_state_alone(which):
    """At 45° every one of these is monotone within four deviations."""
    pose = paper_aircraft(45.0)
    pose[3] = 0.2  # else rolling changes next to nothing
    std = 2000.0 if which in (0, 1, 6) else 1.5 * DEGREE
    assert check_alone(which, pose, RADAR, std, of_std=2e-5)[1] > 1e-4


@pytest.mark.parametrize("constant", [40.0, 300.0, 450.0])
def test_far_in_the_tails(constant):
    """P_D near the false alarms or near 1: σ to a few digits down to 1e-10, and no less than 0."""
    radar = np.array([0.0, 0.0, 0.0, constant])
    std = 0.04 * constant
    aircraft = paper_aircraft(np.array([0.0, 45.0, 70.0]))
    found = propagate(MODEL, aircraft, radar, *one_state(9, std), method="form")
    by_probit = propagate(MODEL, aircraft, radar, *one_state(9, std), method="probit")
    for i, pose in enumerate(aircraft):
        _, exact = exact_moments(along_state(9, pose, radar, std))
        if exact > 1e-10:
            assert found.std[i] == pytest.approx(exact, rel=1e-3)
            assert by_probit.std[i] == pytest.approx(exact, rel=0.35)
        assert found.std[i] > 0


@pytest.mark.parametrize(
    ("azimuth", "exactly"), [(0.0, False), (90.0, False), (90.0, True), (180.0, True)]
)
def test_where_the_gradient_vanishes_first_order_is_zero_and_warned_of(azimuth, exactly):
    """Tail-on, broadside and nose-on yaw has no effect to first order; second order is right."""
    pose = paper_aircraft(azimuth)
    if exactly:
        pose[2] = 0.0
        pose[:2] = np.round(pose[:2], 3)
    covariances, p_d_at = one_state(5, DEGREE), along_state(5, pose, RADAR, DEGREE)
    mean, std = exact_moments(p_d_at)
    farthest = p_d_at(norm.ppf((1 + ndtr(3.0)) / 2))  # |u| is no more with probability Φ(3)
    assert std > 2e-5
    for method in (*SMOOTH, "automatic"):  # plain draws have no bounds at Φ(3)
        states = MODEL, pose, RADAR, *covariances
        found = propagate(*states, method=method)
        warned = is_unreliable(states, found, method)
        second_order = method in ("form", "automatic")
        assert warned == (not second_order)
        if second_order:
            assert found.std == pytest.approx(std, rel=0.02)
            assert found.mean == pytest.approx(mean, abs=0.01 * std)
            # P_D is on one side of the nominal value.
            ends = sorted((farthest, p_d_at(0.0)))
            assert ends[1] - ends[0] > 7 * std
            assert_allclose([found.lower, found.upper], ends, rtol=0, atol=0.1 * std)
        else:
            assert found.std < 1e-9 * std


@pytest.mark.parametrize("method", ["montecarlo", "automatic"])
def test_500_plain_draws_are_unreliable(method):
    """The bound at 3 sigma is beyond the greatest of 500 draws."""
    states = MODEL, AIRCRAFT[::40], RADAR, COV_AIRCRAFT, COV_RADAR["high"]
    assert unreliable(*states, method=method).any() == (method == "montecarlo")


@pytest.mark.usefixtures("few_judge")
@pytest.mark.parametrize("method", METHODS)
def test_without_uncertainty_every_deviation_is_zero(method):
    """Also where attitude alone is uncertain, and the cross section the same from everywhere."""
    sphere = DetectionModel(ConstantRCS(0.2), p_fa=1e-4)
    turned = independent(0, 0, 0, 0.3, 0.3, 0.3)
    for model, cov_aircraft in ((MODEL, CERTAIN_AIRCRAFT), (sphere, turned)):
        states = model, AIRCRAFT[::20], RADAR, cov_aircraft, CERTAIN_RADAR
        found = propagate(*states, method=method)
        assert_array_equal(found.std, 0.0)
        assert_array_equal(found.upper, found.p_d)
        if model is MODEL:
            assert_array_equal([found.mean, found.lower], [found.p_d] * 2)
            assert_array_equal(found.error, 0.0)
            assert not unreliable(*states, method=method).any()


def correlated(rng, std):
    root = rng.normal(size=(len(std), len(std)))
    root /= np.linalg.norm(root, axis=1, keepdims=True)
    return np.outer(std, std) * (root @ root.T)


def is_unreliable(states, found, method):
    """Return what `unreliable` says, without a second computation of draws."""
    if method == "automatic":
        return found.error > 0.005
    return unreliable(*states, method=method)


@pytest.mark.usefixtures("few_judge")
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("beta", [0.1, 3.0, 10.0])
def test_bounds_stay_within_0_and_1(method, beta):
    """At any β, and at deviations with which the linear band exceeds 1."""
    cov_aircraft = independent(1e4, 1e4, 1e4, 0.1, 0.1, 0.1)
    cov_radar = independent(1e4, 1e4, 1e4, 50.0)
    states = MODEL, AIRCRAFT[60::200], RADAR, cov_aircraft, cov_radar
    found = propagate(*states, method=method, beta=beta)
    if method == "linear":
        assert beta < 3 or found.upper.max() > 1
        return
    known = np.isfinite(found.std + found.lower + found.upper)
    assert known.any()
    assert known.all() or method == "form"
    assert np.all(found.lower[known] >= 0)
    assert np.all(found.upper[known] <= 1)
    assert np.all(found.lower[known] <= found.upper[known])
    assert np.all(found.std[known] <= 0.5)
    assert np.all((found.mean[known] > 0) & (found.mean[known] < 1))


def test_a_pose_that_has_not_converged_does_not_change_its_neighbours():
    """A spikeball has kinks. Poses with an extreme at a kink do not converge."""
    model = DetectionModel(SpikeballRCS(4, 0.18, 0.1), p_fa=1.7e-4)
    radar = np.array([0.0, 0.0, 0.0, 60.0])
    aircraft = AIRCRAFT[::30]

    def by_form(aircraft):
        return propagate(model, aircraft, radar, COV_AIRCRAFT, COV_RADAR["medium"], method="form")

    found = by_form(aircraft)
    known = np.isfinite(found.std)
    assert 0 < known.sum() < len(aircraft)
    assert_array_equal(np.isfinite(found.mean), known)
    states = model, aircraft, radar, COV_AIRCRAFT, COV_RADAR["medium"]
    assert np.all(unreliable(*states, method="form")[~known])
    for i, pose in enumerate(aircraft):
        assert_same(found.at(i), by_form(pose))


def test_aircraft_and_radar_at_one_place_are_detected():
    # P_D has no value there, and is 1 beside it
    covariances = COV_AIRCRAFT, COV_RADAR["medium"]
    found = propagate(MODEL, np.zeros(6), [0.0, 0.0, 0.0, 167.0], *covariances, method="automatic")
    assert np.isnan(found.p_d)
    assert (found.mean, found.std, found.lower, found.upper) == (1, 0, 1, 1)


@pytest.mark.parametrize("rcs", [MODEL.rcs, SpikeballRCS(4, 0.18, 0.1)])
@pytest.mark.parametrize("method", METHODS)
def test_straight_above_the_radar_nothing_is_known_but_by_draws(method, rcs):
    model = DetectionModel(rcs, MODEL.p_fa)
    above = np.array([0.0, 0.0, -3e3, 0.0, 0.0, 1.0])
    poses = np.stack([paper_aircraft(30.0), above])
    radar = np.array([0.0, 0.0, 0.0, 1e-8])
    cov_radar = independent(100, 100, 100, 1e-9)
    states = model, poses, radar, COV_AIRCRAFT, cov_radar
    found = propagate(*states, method=method)
    unknown = [False, method in SMOOTH]
    assert_array_equal(np.isnan(found.std), unknown)
    assert_array_equal(np.isnan(found.upper), unknown)
    if method != "montecarlo":  # 500 draws are too few for a precise bound
        assert is_unreliable(states, found, method)[1] == (method in SMOOTH)
    assert np.isfinite(found.p_d).all()
    if method in SMOOTH:
        alone = propagate(model, poses[0], radar, COV_AIRCRAFT, cov_radar, method=method)
        # σ is 1e-13, the rounding of P_D near 1
        assert_same(found.at(0), alone, rtol=1e-5)


@pytest.mark.parametrize("method", SMOOTH)
def test_more_poses_than_are_computed_at_a_time(method):
    states = RADAR, COV_AIRCRAFT, COV_RADAR["medium"]
    some = propagate(MODEL, AIRCRAFT[::20], *states, method=method)
    many = propagate(MODEL, np.resize(AIRCRAFT[::20], (2500, 6)), *states, method=method)
    assert_same(many, Moments(**{n: np.resize(v, 2500) for n, v in some.arrays.items()}))


@pytest.mark.usefixtures("few_judge")
@pytest.mark.parametrize("method", METHODS)
def test_states_and_covariances_broadcast(method):
    rng = np.random.default_rng(5)
    aircraft = AIRCRAFT[::31].reshape(3, 4, 6)
    radar = RADAR + rng.normal(size=(4, 4)) * [1e3, 1e3, 1e3, 10]
    cov_aircraft = np.array([correlated(rng, [30, 20, 10, 0.01, 0.02, 0.01]) for _ in range(3)])
    cov_radar = np.stack([COV_RADAR["low"], *(correlated(rng, [90, 9, 9, 5]) for _ in range(3))])
    found = propagate(MODEL, aircraft, radar, cov_aircraft[:, np.newaxis], cov_radar, method=method)
    for value in found.arrays.values():
        assert value.shape == (3, 4)
    for i, j in np.ndindex(3, 4):
        alone = propagate(
            MODEL, aircraft[i, j], radar[j], cov_aircraft[i], cov_radar[j], method=method
        )
        assert np.shape(alone.mean) == ()
        assert_same(alone, found.at((i, j)), rtol=1e-11)
    # One pose with many covariances.
    many = propagate(MODEL, aircraft[0, 0], radar[0], COV_AIRCRAFT, cov_radar, method=method)
    assert many.p_d.shape == many.std.shape == (4,)


@pytest.mark.parametrize("method", METHODS)
def test_no_poses(method):
    for shape in ((0,), (3, 0)):
        states = MODEL, np.zeros((*shape, 6)), RADAR, COV_AIRCRAFT, COV_RADAR["low"]
        found = propagate(*states, method=method)
        assert {value.shape for value in found.arrays.values()} == {shape}
        assert unreliable(*states, method=method).shape == shape


@pytest.mark.parametrize(
    ("detector", "percent"),
    [
        (North(), 5),
        (North(), 20),
        (Marcum(), 20),
        (Swerling1(), 10),
        (Swerling3(), 2),
    ],
)
def test_no_bound_is_wrong_without_a_warning(detector, percent):
    """Only c_r is uncertain. P_D grows with c_r, so its bounds are P_D at the bounds of c_r."""
    model = DetectionModel(rcs=ConstantRCS(0.2), p_fa=1e-6, detector=detector)
    aircraft = np.array([0.0, 5e4, 0.0, 0.0, 0.0, 0.0])
    snr = np.geomspace(1, 300, 6)
    radar = np.zeros((6, 4))
    radar[:, 3] = snr * 1.380649e-23 * 5e4**4 / 0.2
    spread = percent / 100
    cov_radar = np.zeros((6, 4, 4))
    cov_radar[:, 3, 3] = (spread * radar[:, 3]) ** 2
    lower, upper = (model.p_d(aircraft, radar * (1 + 3 * sign * spread)) for sign in (-1, 1))
    u = np.linspace(-9, 9, 4001)
    weight = norm.pdf(u) / norm.pdf(u).sum()
    drawn = radar[:, np.newaxis] * np.maximum(1 + spread * u, 0)[:, np.newaxis]
    p_d = model.p_d(aircraft, drawn)
    std = np.sqrt((p_d - (p_d @ weight)[:, np.newaxis]) ** 2 @ weight)
    for method in (*SMOOTH, "automatic"):
        states = model, aircraft, radar, np.zeros((6, 6)), cov_radar
        found = propagate(*states, method=method)
        warned = is_unreliable(states, found, method)
        bound, relative = parts_of_what_is_allowed(found, lower, upper, std)
        assert bound[~warned].max(initial=0.0) < 1.1
        if percent == 5 and method == "form":  # bounds in units of 0.005
            assert bound.max() < 1e-4
            assert_allclose(found.mean, p_d @ weight, rtol=0, atol=4e-7)
            assert_allclose(found.std, std, rtol=2e-5, atol=1e-14)
        if percent < 20:  # else errors of five deviations make σ, which no draws find
            most = 1.1 if method == "automatic" else 2.0
            assert relative[~warned].max(initial=0.0) < most
        assert np.maximum(bound, relative)[warned].min(initial=1.0) > 0.8, method
        assert method != "automatic" or not warned.any()


def lobed(near_deg, far_deg, far_db):
    """A table with a low lobe and a far, high one, on a flat floor."""
    azimuth = np.arange(-180.0, 180.0)
    decibels = 4 * np.exp(-0.5 * ((azimuth - near_deg) / 2) ** 2)
    decibels += far_db * np.exp(-0.5 * ((azimuth - far_deg) / 1.5) ** 2)
    return TableRCS(np.radians(azimuth), 10 ** (decibels / 10 - 1.2))


@pytest.mark.parametrize("far_deg", [-5.5, -7.5])
def test_a_far_lobe_is_warned_of_and_in_the_draws(far_deg):
    """Only yaw is uncertain, by 3 deg. Exact quantiles come from a fine grid of yaw."""
    model = DetectionModel(lobed(2.0, far_deg, 12.0), p_fa=1e-6)
    pose, std = np.array([4e5, 0.0, -1e3, 0.0, 0.0, np.pi]), 3 * DEGREE
    radar = np.array([0.0, 0.0, 0.0, 1.0])
    radar[3] = 6.0 / model.snr(pose, radar)
    u = np.linspace(-6, 6, 100_001)
    states = np.tile(pose, (len(u), 1))
    states[:, 5] += std * u
    order = np.argsort(p_d := model.p_d(states, radar))
    weights = np.cumsum(norm.pdf(u)[order])
    exact = p_d[order][np.searchsorted(weights, ndtr(3.0) * weights[-1])]
    case = model, pose, radar, *one_state(5, std)
    for method in SMOOTH:
        assert not abs(propagate(*case, method=method).upper - exact) <= 0.005
        assert unreliable(*case, method=method)
    found = propagate(*case)
    assert 0 < found.error <= 0.005
    assert abs(found.upper - exact) < 0.005 + 4 * found.error


@pytest.mark.parametrize(
    ("population", "number"),
    [("general", 245), ("short range", 3), ("short range", 61), ("limits", 227), ("limits", 339)],
)
def test_mean_and_sigma_of_automatic_are_within_their_tolerances(population, number):
    """FORM is off at these poses, by 5 to 10 % of σ or 0.007 to 0.01 of the mean."""
    case = populations.problem(population, 6105, number)
    exact, scenario = truth.truth(case, 1, most=200_000, enough=0.0), package.scenario(case)
    off = []
    for method in ("form", "automatic"):
        found = propagate_scenario(scenario, method=method, beta=case.k)
        of_mean = abs(found.mean[0] - exact.mean) - 3 * exact.mean_se > 0.005
        of_std = abs(found.std[0] - exact.std) - 3 * exact.std_se > 0.05 * exact.std
        off.append(bool(of_mean or of_std))
    assert off == [True, False]


@pytest.mark.parametrize(("constant", "matters"), [(5.0, False), (167.0, True)])
def test_a_limit_within_reach_is_warned_of_where_the_radar_matters(constant, matters):
    """The second radar is at the limit of its range everywhere."""
    limited = Radar(DetectionModel(MODEL.rcs, p_fa=1e-8), name="limited", max_range=500e3)
    model = NetworkModel((Radar(MODEL, name="other"), limited))
    radar = np.concatenate([RADAR, RADAR])
    radar[7] = constant
    cov_radar = np.kron(np.eye(2), COV_RADAR["low"])
    cov_radar[7, 7] *= constant / RADAR[3]
    states = model, AIRCRAFT[80:121:10], radar, COV_AIRCRAFT, cov_radar
    assert np.all(unreliable(*states, method="form") == matters)


@pytest.mark.all_draws
def test_a_bound_beyond_a_limit_where_the_nominal_states_are_certain_to_be_unseen():
    """3 sigma of the range reach within the limit, where P_D is 1.5e-4, and sigma by FORM is 0."""
    model = DetectionModel(ConstantRCS(1e-5), 1e-8, Swerling1())
    network = NetworkModel((Radar(model, max_range=99_945.0),))
    radar, aircraft = np.array([0, 0, 0, 150.0]), np.array([1e5, 0, 0, 0, 0, 0])
    errors = np.diag([20, 20, 20, 0, 0, 0.0]) ** 2
    found = propagate(network, aircraft, radar, errors, np.zeros((4, 4)))
    distance = 1e5 + 20 * np.random.default_rng(2).standard_normal(2_000_000)
    snr = 150 * 1e-5 / (Boltzmann * distance**4)
    p_d = np.where(distance <= 99_945.0, 1e-8 ** (1 / (1 + snr)), 0.0)
    assert found.upper == pytest.approx(np.quantile(p_d, ndtr(3.0)), rel=0.1, abs=4 * found.error)
    assert found.upper > 1e-4
