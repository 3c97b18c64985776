"""Statistics of blocks against their definitions over all draws."""

import re
import tracemalloc

import numpy as np
import pytest
from scipy import stats
from scipy.special import ndtri

from radar_sense.errors import InputError
from radar_sense.montecarlo.statistics import Statistics, binomial_interval

P = 0.00135


def statistics_of(rows, probability, size, merged):
    """Statistics of rows added block by block, or merged from statistics of each block."""
    total = Statistics(rows.shape[1], len(rows), probability)
    for start in range(0, len(rows), size):
        part = Statistics(rows.shape[1], len(rows), probability) if merged else total
        part.add(rows[start : start + size])
        if merged:
            total.merge(part)
    return total


@pytest.mark.parametrize("merged", [False, True])
@pytest.mark.parametrize(("count", "size"), [(2, 32), (3, 1), (31, 32), (503, 1000), (2501, 7)])
@pytest.mark.parametrize("probability", [0.00135, 0.01, 0.25])
def test_statistics_are_those_of_all_rows_together(count, size, probability, merged):
    rows = np.random.default_rng(count).uniform(size=(count, 3)).round(3)  # rounded: with ties
    found = statistics_of(rows, probability, size, merged).result()
    np.testing.assert_allclose(found.mean, rows.mean(axis=0), rtol=1e-14)
    np.testing.assert_allclose(found.std, rows.std(axis=0, ddof=1), rtol=1e-13)
    np.testing.assert_allclose(found.lower, np.quantile(rows, probability, axis=0), atol=1e-15)
    np.testing.assert_allclose(found.upper, np.quantile(rows, 1 - probability, axis=0), atol=1e-15)


def test_moments_survive_where_the_naive_sum_of_squares_fails():
    # Deviations of 1e-3 around 1e6: their squares, 1e-6, are below the rounding of 1e12.
    rows = 1e6 + 1e-3 * np.random.default_rng(2).standard_normal((4000, 3))
    found = statistics_of(rows, P, 32, merged=True).result()
    exact = np.std((rows - 1e6).astype(np.longdouble), axis=0, ddof=1)
    np.testing.assert_allclose(found.std, exact.astype(float), rtol=1e-7)
    naive = np.sqrt(np.maximum((rows**2).mean(axis=0) - rows.mean(axis=0) ** 2, 0))
    assert np.all(abs(naive / exact - 1) > 0.05)


#: Rows that are hard on a quantile: a bell, ties, nearly all the same, and a gap in the tail.
HARD = {
    "normal": lambda u: ndtri(u),
    "ties": lambda u: np.round(ndtri(u), 2),
    "atom": lambda u: np.maximum(ndtri(u), ndtri(1.5 * P)),
    "gap": lambda u: np.where(u < P, u, 1 + u),
    "sorted": lambda u: np.sort(u, axis=0),  # a block may hold a whole tail
}


@pytest.mark.parametrize("size", [256, 140_000])
@pytest.mark.parametrize("kind", HARD)
def test_tails_of_very_many_rows_are_exact_too(kind, size):
    count = 200_000
    rows = HARD[kind](np.random.default_rng(count + size).uniform(size=(count, 2)))
    found = statistics_of(rows, P, size, merged=True).result()
    expected = np.quantile(rows, [P, 1 - P], axis=0)
    np.testing.assert_allclose([found.lower, found.upper], expected, rtol=1e-13)


def test_a_million_runs_of_the_paper_take_12_megabytes():
    """The documented memory: 3 (p n + 2) rows of 361 poses."""
    statistics = Statistics(10, 10**6, P)
    generator = np.random.default_rng(6)
    tracemalloc.start()
    for _ in range(100):
        statistics.add(generator.uniform(size=(100, 10)))
        kept, _ = tracemalloc.get_traced_memory()
        assert 361 / 10 * kept < 1.05 * 11.7e6
    tracemalloc.stop()


@pytest.mark.parametrize("columns", [1, 361, 100_000])
def test_more_than_4_gb_is_refused_with_the_number_of_runs_that_fit(columns):
    with pytest.raises(InputError, match=r"more than 4 GB; at most [\d,]+ runs fit") as error:
        Statistics(columns, 10**12, P)
    fit = int(re.search(r"most ([\d,]+) runs", str(error.value))[1].replace(",", ""))
    Statistics(columns, fit, P)
    with pytest.raises(InputError):
        Statistics(columns, int(1.02 * fit) + 1000, P)


def test_more_poses_than_fit_are_refused():
    with pytest.raises(InputError, match=r"2 runs of 100,000,000 poses .* use fewer poses$"):
        Statistics(10**8, 2, P)


@pytest.mark.parametrize("count", [1, 10, 500])
@pytest.mark.parametrize("confidence", [0.9, 0.95, 0.9999])
def test_the_binomial_interval_has_the_defined_tails(count, confidence):
    successes = np.arange(count + 1)
    low, high = binomial_interval(successes.astype(float), count, confidence)
    miss = (1 - confidence) / 2
    # at either end so many successes, or more extreme, have just the probability of a miss
    np.testing.assert_allclose(stats.binom.sf(successes - 1, count, low)[1:], miss, rtol=1e-9)
    np.testing.assert_allclose(stats.binom.cdf(successes, count, high)[:-1], miss, rtol=1e-9)
    assert low[0] == 0
    assert high[-1] == 1
