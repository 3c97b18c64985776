"""Detection and m of n, against sums over all outcomes; drawn poses, against their covariance."""

import itertools
import math

import mpmath
import numpy as np
import pytest
from routes import random_covariance
from scipy.linalg import sqrtm
from scipy.stats import binom

from radar_sense import limits
from radar_sense.covariance import draws, symmetric_square_root
from radar_sense.mission import tracks
from radar_sense.mission.schedule import Schedule
from radar_sense.montecarlo.gauss_markov import correlate


def m_of_n(p_d, m, n):
    return tracks.m_of_n_track(np.asarray(p_d, dtype=float)[:, np.newaxis], m, n)[:, 0]


def events(p_d, m, n, looks=None):
    """Detection and track by each time, of radars with P_D (L, n) that look one by one."""
    looks = np.ones((len(p_d[0]), 1), dtype=bool) if looks is None else looks
    radars = tuple((i,) for i in range(len(p_d)))
    schedule = Schedule(np.arange(float(len(looks))), radars, looks)
    return tracks.event_probabilities(schedule, p_d, (m, n))


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


def test_the_probability_of_a_detection_in_both_tails():
    rng = np.random.default_rng(1)
    p_d = np.concatenate([10 ** rng.uniform(-300, -1, 40), rng.uniform(0, 1, 20)])
    rng.shuffle(p_d)
    with mpmath.workdps(400):
        miss, exact = mpmath.mpf(1), []
        for p in p_d:
            miss *= 1 - mpmath.mpf(p)
            exact.append(float(1 - miss))
    found, _ = events([p_d[:, np.newaxis]], 1, 1)
    np.testing.assert_allclose(found[:, 0], exact, rtol=1e-14)
    rows = np.array([[0.5, 1.0, 0.2], [0, 0, 1]]).T
    found, _ = events([rows], 1, 1)
    np.testing.assert_array_equal(found[1:], [[1, 0], [1, 1]])


@pytest.mark.parametrize(
    ("m", "n"), [(1, 1), (1, 3), (2, 2), (2, 3), (3, 5), (4, 4), (2, 9), (5, 12)]
)
def test_m_of_n_is_the_sum_over_all_outcomes(m, n):
    rng = np.random.default_rng(10 * n + m)
    p_d = rng.uniform(0, 1, 9)
    found = m_of_n(p_d, m, n)
    expected = [enumerated(p_d[: k + 1], m_within_n(m, n)) for k in range(len(p_d))]
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-300)
    rows = rng.uniform(0, 1, (9, 6))
    rows[:, 5] = p_d
    np.testing.assert_allclose(tracks.m_of_n_track(rows, m, n)[:, 5], found, rtol=1e-14)


@pytest.mark.parametrize("p", [1e-60, 1e-9, 0.3, 1 - 1e-9])
def test_one_window_is_binomial(p):
    for n in range(1, int(limits.WINDOW.at_most) + 1):
        for m in range(1, n + 1):
            found = m_of_n(np.full(n, p), m, n)[-1]
            assert found == pytest.approx(binom.sf(m - 1, n, p), rel=1e-11, abs=0)


def test_a_track_of_any_scan_group_is_the_sum_over_all_outcomes():
    """Three groups: one looks at all times, one at every other, and one at the first only."""
    looks = np.array([[1, 1, 1], [1, 0, 0], [1, 1, 0], [1, 0, 0], [1, 1, 0]], dtype=bool)
    rng = np.random.default_rng(3)
    p_d = [rng.uniform(0, 1, (count, 1)) for count in looks.sum(axis=0)]
    detection, track = events(p_d, 2, 3, looks)
    for k in range(len(looks)):
        seen = [p[: np.count_nonzero(looks[: k + 1, g]), 0] for g, p in enumerate(p_d)]
        missed = math.prod(1 - enumerated(p, m_within_n(1, 1)) for p in seen)
        untracked = math.prod(1 - enumerated(p, m_within_n(2, 3)) for p in seen)
        assert detection[k, 0] == pytest.approx(1 - missed, rel=1e-13)
        assert track[k, 0] == pytest.approx(1 - untracked, rel=1e-13)


def test_no_probability_of_a_track_exceeds_one():
    """P_D and 1 − P_D are rounded separately, as is the sum over all ways to a track."""
    p_d = np.random.default_rng(5).uniform(0.5, 1, (12, 20_000))
    for groups in ([p_d], [p_d[:4], p_d[4:8], p_d[8:]]):
        for found in events(groups, 2, 4, np.ones((len(groups[0]), len(groups)), dtype=bool)):
            assert found.max() <= 1
            assert np.diff(found, axis=0).min() >= -1e-15


@pytest.mark.parametrize("tau", [0.0, 4.0, np.inf])
def test_draws_of_poses_have_the_covariance_that_was_asked_for(tau):
    rng = np.random.default_rng(5)
    time = np.array([0.0, 2.0, 7.0])
    cov = random_covariance(rng, 3)
    runs = 20_000
    normals = rng.standard_normal((3, 6, runs))
    correlate(normals, time, tau)
    of_each = symmetric_square_root(cov)[:, np.newaxis]
    states = draws(np.zeros((3, 1, 6)), of_each, np.moveaxis(normals, 1, -1))
    root = [np.diag(s) @ np.real(sqrtm(c / np.outer(s, s)))
            for c, s in ((c, np.sqrt(np.diag(c))) for c in cov)]  # fmt: skip
    for i, j in itertools.product(range(3), repeat=2):
        rho = 1.0 if i == j else math.exp(-abs(time[i] - time[j]) / tau) if tau else 0.0
        expected = rho * root[i] @ root[j].T
        found = states[i].T @ states[j] / runs
        scale = np.sqrt(np.outer(np.diag(cov[i]), np.diag(cov[j])))
        assert np.max(abs(found - expected) / scale) < 6 * math.sqrt(2 / runs)
