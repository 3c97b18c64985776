"""Streaming statistics against their definitions over all the draws at once."""

import numpy as np
import pytest
from scipy import stats

from radar_sense.statistics import RunningMoments, Tails, binomial_interval


def in_blocks(rows, size):
    return (rows[start : start + size] for start in range(0, len(rows), size))


@pytest.mark.parametrize("size", [1, 7, 32, 1000])
def test_moments_equal_those_of_all_rows_together(size):
    rows = np.random.default_rng(1).normal(0.5, 0.03, (503, 5))
    moments = RunningMoments(5)
    for block in in_blocks(rows, size):
        moments.add(block)
    np.testing.assert_allclose(moments.mean, rows.mean(axis=0), rtol=1e-14)
    np.testing.assert_allclose(moments.std(), rows.std(axis=0, ddof=1), rtol=1e-13)


def test_moments_survive_where_the_naive_sum_of_squares_fails():
    # Deviations of 1e-3 around 1e6: their squares, 1e-6, are below the rounding of 1e12.
    rows = 1e6 + 1e-3 * np.random.default_rng(2).standard_normal((4000, 3))
    moments = RunningMoments(3)
    for block in in_blocks(rows, 32):
        moments.add(block)
    exact = np.std((rows - 1e6).astype(np.longdouble), axis=0, ddof=1)
    np.testing.assert_allclose(moments.std(), exact.astype(float), rtol=1e-7)
    naive = np.sqrt(np.maximum((rows**2).mean(axis=0) - rows.mean(axis=0) ** 2, 0))
    assert np.all(abs(naive / exact - 1) > 0.05)


@pytest.mark.parametrize("count", [2, 3, 31, 500, 2501, 20000])
@pytest.mark.parametrize("probability", [0.00135, 0.01, 0.25])
def test_tails_are_the_quantiles_of_all_rows(count, probability):
    rows = np.random.default_rng(count).uniform(size=(count, 3)).round(3)  # rounded: with ties
    tails = Tails(3, count, probability)
    for block in in_blocks(rows, 32):
        tails.add(block)
    low, high = tails.quantiles()
    np.testing.assert_allclose(low, np.quantile(rows, probability, axis=0), atol=1e-15)
    np.testing.assert_allclose(high, np.quantile(rows, 1 - probability, axis=0), atol=1e-15)


def test_tails_keep_a_small_part_of_the_rows():
    tails = Tails(1, 100_000, 0.00135)
    kept = 0
    for block in in_blocks(np.random.default_rng(3).uniform(size=(100_000, 1)), 32):
        tails.add(block)
        kept = max(kept, len(tails._low) + len(tails._high) + tails._waiting_rows)
    assert kept <= 4 * (0.00135 * 100_000 + 3)


@pytest.mark.parametrize("count", [1, 10, 500])
@pytest.mark.parametrize("confidence", [0.9, 0.95, 0.9999])
def test_binomial_interval_is_the_one_it_is_defined_to_be(count, confidence):
    successes = np.arange(count + 1)
    low, high = binomial_interval(successes.astype(float), count, confidence)
    miss = (1 - confidence) / 2
    # at either end so many successes, or more extreme, have just the probability of a miss
    np.testing.assert_allclose(stats.binom.sf(successes - 1, count, low)[1:], miss, rtol=1e-9)
    np.testing.assert_allclose(stats.binom.cdf(successes, count, high)[:-1], miss, rtol=1e-9)
    assert low[0] == 0
    assert high[-1] == 1
