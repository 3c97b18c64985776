"""Cumulative detection and m of n, against sums over all outcomes and all pairs of looks."""

import itertools
import math

import mpmath
import numpy as np
import pytest
from scipy.linalg import sqrtm
from scipy.special import ndtr
from scipy.stats import binom, multivariate_normal

import radar_sense as rs
from radar_sense.covariance import square_root as factor
from radar_sense.covariance import symmetric_square_root as symmetric_factor
from radar_sense.mission import cumulative as cu
from radar_sense.mission import draws, tracks
from radar_sense.mission import looks as lk
from radar_sense.montecarlo.sampler import Sampler

MODEL = rs.DetectionModel(rcs=rs.EllipsoidRCS(a=0.15, b=0.13, c=0.21), p_fa=1.7e-4)
RADAR = np.array([0.0, 0.0, 0.0, 60.0])
COV_AIRCRAFT = np.diag([100.0**2] * 3 + [np.deg2rad(1.0) ** 2] * 3)
#: The standard deviations of the paper's three levels, c_r in proportion to its value.
COV_RADAR = {
    level: np.diag([position**2] * 3 + [(60 / 167 * constant) ** 2])
    for level, position, constant in (("low", 10, 1), ("medium", 100, 5), ("high", 1000, 10))
}


def flight(looks=60, start=-900e3, stop=600e3):
    """A straight flight past the radar: times and aircraft states."""
    aircraft = np.zeros((looks, 6))
    aircraft[:, 0] = np.linspace(start, stop, looks)
    aircraft[:, 1], aircraft[:, 2], aircraft[:, 5] = 300e3, -3e3, 0.5
    return 10.0 * np.arange(looks), aircraft


def random_covariance(rng, std):
    a = rng.normal(size=(len(std), 2 * len(std)))
    c = a @ a.T
    scale = np.asarray(std) / np.sqrt(np.diag(c))
    return c * np.outer(scale, scale)


def m_of_n(p_d, m, n):
    p_d = np.asarray(p_d, dtype=float)
    found, left = tracks.m_of_n(p_d, 1 - p_d, m, n)
    np.testing.assert_allclose(found + left, 1.0, rtol=1e-14)
    return found


def m_of_n_gradient(p_d, m, n):
    p_d = np.asarray(p_d, dtype=float)
    return tracks.m_of_n_gradient(p_d, 1 - p_d, m, n, np.arange(len(p_d)))


def draw_missions(model, time, aircraft, radar, cov_aircraft, cov_radar, **options):
    """Plain draws with a Gaussian radar."""
    one_radar = rs.load_scenario().model  # the sampler needs the number of radars
    sampler = Sampler(
        one_radar,
        np.asarray(aircraft),
        np.asarray(radar, dtype=float),
        np.eye(6),
        factor(cov_radar),
    )
    return draws.mission_monte_carlo(model, time, aircraft, cov_aircraft, sampler, **options)


def enumerated(p_d, event):
    """Probability of an event of outcomes, one after the other, as the sum over all outcomes."""
    total = 0.0
    for outcome in itertools.product((0, 1), repeat=len(p_d)):
        if event(outcome):
            total += math.prod(p if hit else 1 - p for p, hit in zip(p_d, outcome, strict=True))
    return total


def m_within_n(m, n):
    return lambda outcome: any(
        sum(outcome[max(0, end - n) : end]) >= m for end in range(1, len(outcome) + 1)
    )


def dense_std(by_p, lin, time, tau, cov_aircraft, cov_radar):
    """σ to first order from all pairs of looks, with the partials of P_D and not of its probit."""
    looks = len(time)
    apart = abs(time[:, None] - time)
    if tau == 0:
        rho = (apart == 0).astype(float)
    else:
        rho = np.ones_like(apart) if np.isinf(tau) else np.exp(-apart / tau)
    found = []
    d = [np.diag(np.sqrt(np.diag(c))) for c in cov_aircraft]
    roots = [
        s @ np.real(sqrtm(np.linalg.solve(s, np.linalg.solve(s, c).T)))
        for s, c in zip(d, cov_aircraft, strict=True)
    ]
    weights = np.stack([lin.jac_aircraft[j] @ roots[j] for j in range(looks)])
    pairs = rho * (weights @ weights.T)
    for g in by_p:
        along = g @ lin.jac_radar
        found.append(math.sqrt(g @ pairs @ g + along @ cov_radar @ along))
    return np.array(found)


def by_p_of_detection(p_d):
    """dP_c(k)/dP_j = Π_{i≤k, i≠j} (1 − P_i)."""
    looks = len(p_d)
    return np.array(
        [
            [math.prod(1 - p_d[i] for i in range(k + 1) if i != j) if j <= k else 0.0
             for j in range(looks)]
            for k in range(looks)
        ]
    )  # fmt: skip


# P_c.


def test_cumulative_p_d_in_both_tails():
    rng = np.random.default_rng(1)
    p_d = np.concatenate([10 ** rng.uniform(-300, -1, 40), rng.uniform(0, 1, 20)])
    rng.shuffle(p_d)
    with mpmath.workdps(400):
        miss, exact = mpmath.mpf(1), []
        for p in p_d:
            miss *= 1 - mpmath.mpf(p)
            exact.append(float(1 - miss))
    np.testing.assert_allclose(cu.cumulative_p_d(p_d), exact, rtol=1e-14)
    np.testing.assert_array_equal(cu.cumulative_p_d([[0.5, 1.0, 0.2], [0, 0, 1]])[:, 1:],
                                  [[1, 1], [0, 1]])  # fmt: skip


def test_hazard_in_both_tails():
    z = np.linspace(-36, 36, 73)
    looks = lk.Looks(np.arange(len(z)), z, np.zeros((len(z), 6)), np.zeros((len(z), 4)))
    with mpmath.workdps(400):
        exact = [float(-mpmath.log(mpmath.ncdf(-mpmath.mpf(float(v))))) for v in z]
    np.testing.assert_allclose(looks.hazard, exact, rtol=2e-13)
    with mpmath.workdps(400):
        slope = [
            float(mpmath.npdf(mpmath.mpf(float(v))) / mpmath.ncdf(-mpmath.mpf(float(v)))) for v in z
        ]
    np.testing.assert_allclose(cu.inverse_mills(z), slope, rtol=2e-13)


@pytest.mark.parametrize("tau", [0.0, 1e-300, 3.0, 50.0, 1e308, np.inf])
def test_variance_is_the_sum_over_all_pairs(tau):
    rng = np.random.default_rng(2)
    time, aircraft = flight(13, -700e3, 100e3)
    time = time + rng.uniform(0, 9, len(time))
    time[4:6] = time[3]  # three looks at one time see one pose
    std = [100, 200, 50, 0.02, 0.01, 0.03]
    cov = np.stack([random_covariance(rng, std * rng.uniform(0.5, 2, 6)) for _ in time])
    cov[4:6], aircraft[4:6] = cov[3], aircraft[3]
    cov_radar = random_covariance(rng, [500, 400, 300, 3])
    looks = lk.linearize_looks(MODEL, time, aircraft, RADAR)
    lin = MODEL.linearize(aircraft, RADAR)
    options = {"correlation_time": tau, "method": "linear"}
    found = cu.cumulative_detection(looks, cov, cov_radar, **options)
    by_p = by_p_of_detection(lin.p_d)
    expected = dense_std(by_p, lin, time, tau, cov, cov_radar)
    np.testing.assert_allclose(found.p, cu.cumulative_p_d(lin.p_d), rtol=1e-12)
    np.testing.assert_allclose(found.std, expected, rtol=1e-9)
    lower = np.maximum.accumulate(found.p - 3 * expected)
    upper = np.minimum.accumulate((found.p + 3 * expected)[::-1])[::-1]
    np.testing.assert_allclose(found.lower, lower, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(found.upper, upper, rtol=1e-9, atol=1e-15)
    track = tracks.track_initiation(looks, 2, 4, cov, cov_radar, **options)
    by_p = m_of_n_gradient(lin.p_d, 2, 4)
    expected = dense_std(by_p, lin, time, tau, cov, cov_radar)
    np.testing.assert_allclose(track.std, expected, rtol=1e-9, atol=1e-300)


def test_correlation_time_matters_between_its_ends():
    time, aircraft = flight(20, -700e3, 0)
    looks = lk.linearize_looks(MODEL, time, aircraft, RADAR)
    std = [
        cu.cumulative_detection(looks, COV_AIRCRAFT, np.zeros((4, 4)), correlation_time=tau).std[9]
        for tau in (0, 1e-9, 10, 100, 1e9, np.inf)
    ]
    assert std[0] == std[1] < 0.9 * std[2] < 0.9 * std[3] < 0.9 * std[4]
    assert std[4] == pytest.approx(std[5], rel=1e-6)


@pytest.mark.parametrize("method", ["linear", "probit"])
def test_one_look_is_propagate(method):
    time, aircraft = flight(3, -500e3, -300e3)
    looks = lk.linearize_looks(MODEL, time[:1], aircraft[:1], RADAR)
    for cov_radar in COV_RADAR.values():
        found = cu.cumulative_detection(
            looks, COV_AIRCRAFT, cov_radar, correlation_time=3.0, method=method
        )
        states = aircraft[:1], RADAR, COV_AIRCRAFT, cov_radar
        expected = rs.propagate(MODEL, *states, method=method)
        for name in ("mean", "std", "lower", "upper"):
            np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-9)


def test_deviations_are_known_where_p_d_rounds_to_one():
    """Two looks at P_D = 1 − 2e-33: in double precision 1 − P_D is 0."""
    z, g = np.array([12.0, 11.0]), np.array([[0.3, 0.1], [0.2, 0.4]])
    by_aircraft = np.zeros((2, 6))
    by_aircraft[:, :2] = g
    looks = lk.Looks(np.array([0.0, 5.0]), z, by_aircraft, np.zeros((2, 4)))
    cov = np.diag([1.0, 1, 0, 0, 0, 0])
    options = {"correlation_time": np.inf, "method": "linear"}
    found = cu.cumulative_detection(looks, cov, np.zeros((4, 4)), **options)
    with mpmath.workdps(100):
        miss = [mpmath.ncdf(-v) for v in z]
        by_z = [mpmath.npdf(z[0]) * miss[1], mpmath.npdf(z[1]) * miss[0]]
        exact = mpmath.sqrt(sum((by_z[0] * g[0, i] + by_z[1] * g[1, i]) ** 2 for i in range(2)))
    np.testing.assert_allclose(found.std[1], float(exact), rtol=1e-10)
    assert found.p[1] == 1.0
    far = lk.Looks(looks.time, np.array([500.0, -30.0]), by_aircraft, np.zeros((2, 4)))
    for method in cu.METHODS:
        options["method"] = method
        for found in (
            cu.cumulative_detection(far, cov, np.zeros((4, 4)), **options),
            tracks.track_initiation(far, 1, 2, cov, np.zeros((4, 4)), **options),
            tracks.track_initiation(far, 2, 2, cov, np.zeros((4, 4)), **options),
        ):
            for values in (found.mean, found.std, found.lower, found.upper):
                assert np.isfinite(values).all()


def test_an_undefined_gradient_is_undefined_from_there_on():
    time, aircraft = flight(6, -300e3, -200e3)
    aircraft[3, :3] = 0, 0, -10e3  # straight above the radar
    looks = lk.linearize_looks(MODEL, time, aircraft, RADAR)
    assert np.isnan(looks.by_aircraft[3]).any()
    for method in cu.METHODS:
        options = {"correlation_time": 9.0, "method": method}
        for found in (
            cu.cumulative_detection(looks, COV_AIRCRAFT, COV_RADAR["low"], **options),
            tracks.track_initiation(looks, 2, 3, COV_AIRCRAFT, COV_RADAR["low"], **options),
        ):
            assert np.isfinite(found.p).all()
            assert np.isfinite(found.std[:3]).all()
            assert np.isnan(found.std[3:]).all()
            assert np.isnan(found.upper[3:]).all()
    # likewise with a certain pose and an uncertain radar
    certain = 0 * COV_AIRCRAFT, COV_RADAR["low"]
    for found in (
        cu.cumulative_detection(looks, *certain, correlation_time=9.0),
        tracks.track_initiation(looks, 2, 3, *certain, correlation_time=9.0),
    ):
        assert np.isfinite(found.std[:3]).all()
        assert np.isnan(found.std[3:]).all()


def test_without_uncertainty_bounds_are_nominal_without_rounding():
    time, aircraft = flight(60)
    looks = lk.linearize_looks(MODEL, time, aircraft, RADAR)
    nothing = cu.cumulative_detection(looks, 0 * COV_AIRCRAFT, np.zeros((4, 4)), correlation_time=0)
    for values in (nothing.mean, nothing.lower, nothing.upper):
        np.testing.assert_array_equal(values, nothing.p)
    assert not nothing.std.any()


@pytest.mark.parametrize("method", cu.METHODS)
@pytest.mark.parametrize("seed", range(20))
def test_cumulative_probabilities_never_decrease(method, seed):
    rng = np.random.default_rng(seed)
    looks = 60
    time = np.cumsum(rng.exponential(10, looks))
    wave = np.cumsum(rng.normal(0, 0.6, looks)) - rng.uniform(0, 4)
    looks = lk.Looks(time, wave, rng.normal(0, 1, (looks, 6)), rng.normal(0, 1, (looks, 4)))
    cov = np.diag(rng.uniform(0, 0.6, 6) ** 2)
    cov_radar = np.diag(rng.uniform(0, 0.8, 4) ** 2)
    options = {"correlation_time": [0, 30, np.inf][seed % 3], "method": method}
    groups = [None, rng.integers(0, 3, len(time))][seed % 2]
    for found in (
        cu.cumulative_detection(looks, cov, cov_radar, **options),
        tracks.track_initiation(looks, 2, 4, cov, cov_radar, scan_group=groups, **options),
    ):
        for values in (found.p, found.mean, found.lower, found.upper):
            assert np.diff(values).min() >= 0
        assert np.all(found.lower <= found.upper)


# m of n.


@pytest.mark.parametrize(
    ("m", "n"), [(1, 1), (1, 3), (2, 2), (2, 3), (3, 5), (4, 4), (2, 9), (5, 12)]
)
def test_m_of_n_is_the_sum_over_all_outcomes(m, n):
    rng = np.random.default_rng(10 * n + m)
    p_d = rng.uniform(0, 1, 9)
    found = m_of_n(p_d, m, n)
    expected = [enumerated(p_d[: k + 1], m_within_n(m, n)) for k in range(len(p_d))]
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-300)
    gradient = m_of_n_gradient(p_d, m, n)
    # The probability is linear in every P_D: a partial is a difference.
    for j in range(len(p_d)):
        sure, never = p_d.copy(), p_d.copy()
        sure[j], never[j] = 1, 0
        expected = m_of_n(sure, m, n) - m_of_n(never, m, n)
        np.testing.assert_allclose(gradient[:, j], expected, rtol=1e-9, atol=1e-14)
    rows = rng.uniform(0, 1, (2, 3, 9))
    rows[1, 2] = p_d
    np.testing.assert_allclose(m_of_n(rows, m, n)[1, 2], found, rtol=1e-14)


@pytest.mark.parametrize("p", [1e-60, 1e-9, 0.3, 1 - 1e-9])
def test_one_window_is_binomial(p):
    for n in range(1, tracks.MAX_WINDOW + 1):
        for m in range(1, n + 1):
            found = m_of_n(np.full(n, p), m, n)[-1]
            assert found == pytest.approx(binom.sf(m - 1, n, p), rel=1e-11, abs=0)


def test_one_of_n_is_cumulative_detection():
    time, aircraft = flight(30, -900e3, 300e3)
    looks = lk.linearize_looks(MODEL, time, aircraft, RADAR)
    options = {"cov_aircraft": COV_AIRCRAFT, "cov_radar": COV_RADAR["high"], "correlation_time": 60}
    for method in cu.METHODS:
        one = cu.cumulative_detection(looks, **options, method=method)
        for n in (1, 4):
            other = tracks.track_initiation(looks, 1, n, **options, method=method)
            for name in ("p", "mean", "std", "lower", "upper"):
                np.testing.assert_allclose(getattr(other, name), getattr(one, name), rtol=1e-7)


# Draws.


class Linear:
    """A model whose probit is north of the aircraft plus north of the radar, in units of 1."""

    def p_d(self, aircraft, radar):
        return ndtr(aircraft[..., 0] + radar[..., 0])

    def linearize_probit(self, aircraft, radar):
        by_aircraft, by_radar = np.zeros((len(aircraft), 6)), np.zeros((len(aircraft), 4))
        by_aircraft[:, 0] = by_radar[:, 0] = 1.0
        return aircraft[:, 0] + radar[0], by_aircraft, by_radar


@pytest.mark.parametrize("tau", [0.0, 4.0, np.inf])
def test_mean_of_draws_is_that_of_correlated_normals(tau):
    """The mean of Π Φ(−x_j) over correlated x is the distribution function of a normal vector."""
    time = np.array([0.0, 1.0, 1.0, 6.0])
    aircraft = np.zeros((4, 6))
    aircraft[:, 0] = -0.5, -0.2, -0.2, 0.1
    sigma, s, runs = 0.8, 0.5, 20_000
    cov, cov_radar = np.diag([sigma**2, 0, 0, 0, 0, 0]), np.diag([s**2, 0, 0, 0])
    options = {"correlation_time": tau, "runs": runs, "seed": 3}
    found = draw_missions(
        Linear(), time, aircraft, np.zeros(4), cov, cov_radar, m_of_n=(2, 2), **options
    )
    apart = abs(time[:, None] - time)
    rho = np.where(apart == 0, 1.0, 0.0) if tau == 0 else np.exp(-apart / tau)
    both = np.eye(4) + sigma**2 * rho + s**2
    for k in range(1, 4):
        parts = slice(0, k + 1)
        exact = 1 - multivariate_normal.cdf(
            np.zeros(k + 1), aircraft[parts, 0], both[parts, parts], abseps=1e-7, releps=1e-7
        )
        error = found.events["detection"].std[k] / math.sqrt(runs)
        assert abs(found.events["detection"].mean[k] - exact) < 4.5 * error
    # two in a row of the first two looks: both detect
    exact = multivariate_normal.cdf(np.zeros(2), -aircraft[:2, 0], both[:2, :2])
    error = found.events["track"].std[1] / math.sqrt(runs)
    assert abs(found.events["track"].mean[1] - exact) < 4.5 * error
    assert found.events["track"].mean[0] == 0
    assert found.clipped == 0


def test_draws_of_poses_have_the_covariance_that_was_asked_for():
    rng = np.random.default_rng(5)
    time = np.array([0.0, 2.0, 7.0])
    cov = np.stack([random_covariance(rng, [3, 2, 1, 0.1, 0.2, 0.3]) for _ in time])
    runs = 20_000
    process = draws.PoseProcess.of(time, np.zeros((3, 6)), cov, 4.0)
    np.testing.assert_array_equal(process.sqrt_cov, symmetric_factor(cov))
    states = process.poses(rng.standard_normal((3, 6, runs)))
    root = [np.diag(s) @ np.real(sqrtm(c / np.outer(s, s)))
            for c, s in ((c, np.sqrt(np.diag(c))) for c in cov)]  # fmt: skip
    for i, j in itertools.product(range(3), repeat=2):
        expected = math.exp(-abs(time[i] - time[j]) / 4.0) * root[i] @ root[j].T
        found = states[i].T @ states[j] / runs
        scale = np.sqrt(np.outer(np.diag(cov[i]), np.diag(cov[j])))
        assert np.max(abs(found - expected) / scale) < 6 * math.sqrt(2 / runs)


class Constant:
    """A model whose P_D is 1 where the radar constant is 0; a constant below 0 is an error."""

    def p_d(self, aircraft, radar):
        assert radar[..., 3].min() >= 0
        return np.broadcast_to(radar[..., 3] == 0, (len(aircraft), len(radar))) + 0.0

    linearize_probit = Linear.linearize_probit


def test_constants_below_zero_are_set_to_zero_and_counted():
    drawn = draw_missions(
        Constant(), [0.0, 1.0], np.zeros((2, 6)), np.array([0, 0, 0, 1.0]), np.eye(6), np.eye(4),
        correlation_time=1.0, runs=3000, seed=1,
    )  # fmt: skip
    assert drawn.events["detection"].mean == pytest.approx([drawn.clipped / 3000] * 2, rel=1e-12)
    assert drawn.clipped == pytest.approx(3000 * ndtr(-1.0), abs=5 * math.sqrt(3000 * 0.16))


@pytest.mark.parametrize("workers", [1, 3])
def test_draws_are_the_same_for_any_number_of_workers(workers):
    time, aircraft = flight(40)
    runs, steps = 7000, []
    options = {"correlation_time": 30.0, "seed": 9, "m_of_n": (2, 3)}
    arguments = (MODEL, time, aircraft, RADAR, COV_AIRCRAFT, COV_RADAR["high"] * 60)
    one = draw_missions(*arguments, runs=runs, **options)
    other = draw_missions(*arguments, runs=runs, workers=workers, progress=steps.append, **options)
    assert sum(steps) == runs
    assert len(steps) > 1
    assert one.clipped == other.clipped > 0
    assert list(one.events) == ["detection", "track"]
    for event, statistics in one.events.items():
        for name, values in vars(statistics).items():
            np.testing.assert_array_equal(values, getattr(other.events[event], name))


@pytest.mark.parametrize(
    ("level", "of_detection", "of_track"),
    [("low", (0.012, 0.003), (0.015, 0.005)), ("medium", (0.012, 0.006), (0.02, 0.007)),
     ("high", (0.015, 0.007), (0.06, 0.018))],
)  # fmt: skip
def test_the_probit_is_near_the_draws(level, of_detection, of_track):
    """Errors of bounds, and relative errors of σ where σ is above 0.001; `linear` is worse."""
    time, aircraft = flight()
    looks = lk.linearize_looks(MODEL, time, aircraft, RADAR)
    cov_radar = COV_RADAR[level]
    drawn = draw_missions(
        MODEL, time, aircraft, RADAR, COV_AIRCRAFT, cov_radar,
        correlation_time=100.0, runs=20_000, seed=1, m_of_n=(3, 5),
    )  # fmt: skip
    options = {"correlation_time": 100.0}
    for mc, find, (part, bound) in (
        (drawn.events["detection"], cu.cumulative_detection, of_detection),
        (
            drawn.events["track"],
            lambda *a, **o: tracks.track_initiation(a[0], 3, 5, *a[1:], **o),
            of_track,
        ),
    ):
        found = find(looks, COV_AIRCRAFT, cov_radar, **options)
        shown = mc.std > 1e-3
        noise = 4.5 / math.sqrt(2 * drawn.runs)
        assert np.max(abs(found.std[shown] / mc.std[shown] - 1)) < part + noise
        assert np.max(abs(found.lower - mc.lower)) < bound + 0.15 * mc.std.max()
        assert np.max(abs(found.upper - mc.upper)) < bound + 0.15 * mc.std.max()
        assert np.max(abs(found.mean - mc.mean)) < 0.002
        assert np.all((found.lower >= 0) & (found.upper <= 1))
    plain = cu.cumulative_detection(looks, COV_AIRCRAFT, cov_radar, method="linear", **options)
    if level == "high":
        assert np.max(abs(plain.upper - drawn.events["detection"].upper)) > 0.03


def test_radars_that_take_turns():
    rng = np.random.default_rng(6)
    other = rs.DetectionModel(rcs=rs.ConstantRCS(0.3), p_fa=1e-6, detector=rs.Swerling1())
    time, aircraft = flight(12, -600e3, 200e3)
    which = rng.integers(0, 2, len(time))
    model = lk.Interleaved((MODEL, other), which, ((0,), (1,)))
    radars = np.array([*RADAR, 1e5, 5e4, -20.0, 70.0])
    cov_radar = random_covariance(rng, [300, 300, 100, 3, 300, 300, 100, 3])
    looks = lk.linearize_looks(model, time, aircraft, radars)
    parts = [m.linearize(aircraft, radars[4 * i : 4 * i + 4]) for i, m in enumerate((MODEL, other))]
    take = which == 0
    lin = rs.Linearization(
        np.where(take, parts[0].p_d, parts[1].p_d),
        np.where(take[:, None], parts[0].jac_aircraft, parts[1].jac_aircraft),
        np.hstack([take[:, None] * parts[0].jac_radar, ~take[:, None] * parts[1].jac_radar]),
    )
    np.testing.assert_allclose(looks.p_d, lin.p_d, rtol=1e-12)
    cov = np.broadcast_to(COV_AIRCRAFT, (12, 6, 6))
    found = cu.cumulative_detection(
        looks, COV_AIRCRAFT, cov_radar, correlation_time=20.0, method="linear"
    )
    expected = dense_std(by_p_of_detection(lin.p_d), lin, time, 20.0, cov, cov_radar)
    np.testing.assert_allclose(found.std, expected, rtol=1e-9)
    drawn = draw_missions(
        model, time, aircraft, radars, COV_AIRCRAFT, cov_radar,
        correlation_time=20.0, runs=4000, seed=1,
    )  # fmt: skip
    better = cu.cumulative_detection(looks, COV_AIRCRAFT, cov_radar, correlation_time=20.0)
    assert np.max(abs(drawn.events["detection"].std - better.std)) < 0.06 * better.std.max()


# Refused arguments.


def test_refusals():
    time, aircraft = flight(5)
    looks = lk.linearize_looks(MODEL, time, aircraft, RADAR)
    cov, radar = COV_AIRCRAFT, COV_RADAR["low"]

    def detection(cov=cov, radar=radar, tau=1.0, **options):
        return cu.cumulative_detection(looks, cov, radar, correlation_time=tau, **options)

    def draw(time=time, aircraft=aircraft, runs=9, **options):
        return draw_missions(
            MODEL, time, aircraft, RADAR, cov, radar,
            correlation_time=1.0, runs=runs, seed=1, **options,
        )  # fmt: skip

    refused = [
        (lambda: lk.linearize_looks(MODEL, time[::-1], aircraft, RADAR), "do not decrease"),
        (lambda: lk.linearize_looks(MODEL, [0, np.nan, 1, 2, 3], aircraft, RADAR), "finite"),
        (lambda: lk.linearize_looks(MODEL, time, aircraft[:4], RADAR), r"shape \(5, 6\)"),
        (lambda: detection(tau=-1.0), "correlation time"),
        (lambda: detection(tau=np.nan), "correlation time"),
        (lambda: detection(cov=cov[:5, :5]), "aircraft covariance"),
        (lambda: detection(radar=radar[:3, :3]), r"\(..., 4, 4\)"),
        (lambda: detection(method="form"), "linear, probit"),
        (lambda: m_of_n([0.1], 0, 3), "m of n"),
        (lambda: m_of_n([0.1], 4, 3), "m of n"),
        (lambda: m_of_n_gradient([0.1], 1, 13), "m of n"),
        (lambda: draw(runs=1), "runs"),
        (lambda: draw(m_of_n=(3, 2)), "m of n"),
        (lambda: draw(aircraft=aircraft[:2]), "shape"),
        (lambda: draw(time=-time), "do not decrease"),
    ]
    for call, words in refused:
        with pytest.raises(ValueError, match=words):
            call()


def test_no_probability_of_a_track_exceeds_one():
    """P_D and 1 − P_D are rounded separately, as is the sum over all ways to a track."""
    rng = np.random.default_rng(5)
    p_d = rng.uniform(0.5, 1, (20_000, 12))
    groups = np.arange(12) % 3
    for group in (None, groups):
        for found in tracks.any_group(p_d, 1 - p_d, 2, 4, group):
            assert found.max() <= 1
