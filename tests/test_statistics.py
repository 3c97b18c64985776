"""Streaming statistics against their definitions over all the draws at once."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import ndtri

from radar_sense.montecarlo.statistics import RunningMoments, Tails, binomial_interval


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
    tails = Tails(3, count, probability, capacity=5002)
    for block in in_blocks(rows, 32):
        tails.add(block)
    low, high = tails.quantiles()
    np.testing.assert_allclose(low, np.quantile(rows, probability, axis=0), atol=1e-15)
    np.testing.assert_allclose(high, np.quantile(rows, 1 - probability, axis=0), atol=1e-15)


P = 0.00135

#: Rows that are hard on a quantile: a bell, ties, nearly all the same, and a gap in the tail.
HARD = {
    "normal": lambda u: ndtri(u),
    "ties": lambda u: np.round(ndtri(u), 2),
    "atom": lambda u: np.maximum(ndtri(u), ndtri(1.5 * P)),
    "gap": lambda u: np.where(u < P, u, 1 + u),
}


@pytest.mark.parametrize("kind", HARD)
@pytest.mark.parametrize(("count", "capacity"), [(300_000, 64), (300_000, 300), (700_000, 64)])
def test_tails_in_bounded_memory_are_off_by_no_more_ranks_than_they_say(kind, count, capacity):
    rows = HARD[kind](np.random.default_rng(count + capacity).uniform(size=(count, 4)))
    tails = Tails(4, count, P, capacity)
    for block in in_blocks(rows, 256):
        part = Tails(4, count, P, capacity)
        part.add(block)
        tails.merge(part)
    position = (count - 1) * P
    assert 0 < tails.rank_error < position / 2
    for quantile, sign in zip(tails.quantiles(), (1, -1), strict=True):
        ordered = np.sort(sign * rows, axis=0)
        low = ordered[int(position) - tails.rank_error]
        high = ordered[int(position) + 1 + tails.rank_error]
        assert np.all((low <= sign * quantile) & (sign * quantile <= high))


def test_errors_of_collapsed_tails_make_up_for_each_other():
    # chance moves the rank by its square root; a rank too low or too high each time would add up
    count, capacity, columns = 600_000, 64, 40
    rows = np.random.default_rng(8).uniform(size=(count, columns))
    tails = Tails(columns, count, P, capacity)
    for block in in_blocks(rows, 1000):
        tails.add(block)
    low, _ = tails.quantiles()
    ranks = np.sum(rows < low, axis=0) - (count - 1) * P
    assert np.max(abs(ranks)) < np.sqrt(count * P)
    assert abs(ranks.mean()) < 0.5 * np.sqrt(count * P)


def test_tails_do_not_grow_with_the_rows():
    def kept(count):
        tails = Tails(2, count, P, 64)
        most = 0
        for block in in_blocks(np.random.default_rng(3).uniform(size=(count, 2)), 500):
            tails.add(block)
            tail = tails._low
            arrays = [tail._rows, *tail._waiting, *tail._collapsed.values()]
            most = max(most, sum(len(a) if a.base is None else len(a.base) for a in arrays))
        return most

    few, many = kept(100_000), kept(1_600_000)
    assert few <= 64 * 6
    assert many <= few + 64 * 4  # a level more each time the rows double


@pytest.mark.parametrize("size", [100_000, 140_000, 200_000, 250_000])
@pytest.mark.parametrize("merged", [False, True])
def test_no_rows_are_lost_when_they_come_many_at_a_time(size, merged):
    """An end of 512 rows is that of 262 000 with 8 sigma to spare, and not that of 400 000."""
    rows = np.random.default_rng(5).uniform(size=(3_000_000, 1))
    tails = Tails(1, len(rows), P, 512)
    for block in in_blocks(rows, size):
        if merged:
            part = Tails(1, len(rows), P, 512)
            part.add(block)
            tails.merge(part)
        else:
            tails.add(block)
    for found, ends in zip(tails.quantiles(), (rows, -rows), strict=True):
        rank = np.sum(ends < (found if ends is rows else -found), axis=0)
        assert abs(rank - (len(rows) - 1) * P) <= tails.rank_error < 0.02 * len(rows) * P


def test_tails_that_lost_rows_say_so():
    # The rows come sorted: the first groups hold the whole tail, far more than their share.
    rows = np.sort(np.random.default_rng(4).uniform(size=(200_000, 1)), axis=0)
    tails = Tails(1, len(rows), P, 64)
    for block in in_blocks(rows, 1000):
        tails.add(block)
    assert np.isnan(tails.quantiles()[0])


def test_tails_merged_are_tails_added():
    rows = np.random.default_rng(6).uniform(size=(120_000, 3))
    one, whole = Tails(3, len(rows), P, 64), Tails(3, len(rows), P, 64)
    for half in in_blocks(rows, 60_000):
        part = Tails(3, len(rows), P, 64)
        for block in in_blocks(half, 500):
            part.add(block)
        one.merge(part)
    for block in in_blocks(rows, 500):
        whole.add(block)
    for quantile, exact in zip(one.quantiles(), np.quantile(rows, [P, 1 - P], axis=0), strict=True):
        np.testing.assert_allclose(quantile, exact, atol=0.2 * P)
    assert one.rank_error == pytest.approx(whole.rank_error, rel=0.5)


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
