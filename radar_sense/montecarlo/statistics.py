"""Statistics of many draws per pose, gathered block by block without keeping the draws."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv

from radar_sense.states import FloatArray

#: So many rows are sorted faster than they are partitioned twice.
MAX_SORTED = 512


class RunningMoments:
    """Mean and standard deviation per column of many rows.

    Parts are merged by the update of Chan, Golub and LeVeque ("Updating formulae and a pairwise
    algorithm for computing sample variances", 1979), which does not lose digits as a sum of squares
    does when the deviation is small beside the mean.
    """

    def __init__(self, columns: int) -> None:
        self.count = 0
        self.mean = np.zeros(columns)
        self._squares = np.zeros(columns)  # sum of squared deviations from the mean

    def add(self, rows: FloatArray) -> None:
        """Take in rows (m, columns)."""
        mean = rows.sum(axis=0) / len(rows)
        deviation = rows - mean
        # The deviations sum to what rounding has made wrong with the mean (the corrected two-pass
        # algorithm of Chan, Golub and LeVeque, The American Statistician 37(3), 1983).
        rounding = deviation.sum(axis=0) / len(rows)
        squares = np.square(deviation, out=deviation).sum(axis=0)
        squares -= len(rows) * rounding * rounding
        self._merge(len(rows), mean + rounding, np.maximum(squares, 0.0))

    def merge(self, other: RunningMoments) -> None:
        """Take in all that another one has taken in."""
        self._merge(other.count, other.mean, other._squares)

    def _merge(self, count: int, mean: FloatArray, squares: FloatArray) -> None:
        total = self.count + count
        step = mean - self.mean
        self._squares += squares
        self._squares += step * step * (self.count * count / total)
        self.mean += step * (count / total)
        self.count = total

    def std(self) -> FloatArray:
        """Sample standard deviation (columns,), with n − 1 in the denominator."""
        return np.sqrt(self._squares / (self.count - 1))


class Tails:
    """Quantiles near both ends of each column of many rows, in memory that has a bound.

    The quantile at probability p of n rows lies between two order statistics, found from the end
    by counting about p n of them. Up to `capacity` rows are kept of either end; as long as that is
    enough, the quantiles are exact.

    Where p n is more, the rows are taken in groups whose ends fit, and the ends of two groups are
    collapsed into one: sorted together, every second row is kept and counts twice; likewise for two
    that count twice, and so on. (J. I. Munro and M. S. Paterson, "Selection and sorting with
    limited storage", Theoretical Computer Science 12, 1980; here for the ends alone.) A collapse of
    rows that count w each moves a rank by w at most; `rank_error` adds that up.

    Args:
        columns: Number of columns.
        count: How many rows there will be in total.
        probability: p of the lower quantile; the upper one is at 1 − p.
        capacity: Rows to keep; by default 2048, or as many as take 32 MB, but not below 64.
    """

    def __init__(
        self, columns: int, count: int, probability: float, capacity: int | None = None
    ) -> None:
        if capacity is None:
            capacity = min(max(2**21 // columns, 64), 2048)
        self._low = _Tail(columns, count, probability, capacity)
        # The largest are the smallest of the negated rows, so that one rule serves both ends.
        self._high = _Tail(columns, count, probability, capacity)

    @property
    def rank_error(self) -> int:
        """By how many ranks of `count` the quantiles are off at most; 0 where they are exact."""
        return self._low.rank_error()

    def add(self, rows: FloatArray) -> None:
        """Take in rows (m, columns)."""
        lowest, highest = _ends(rows, self._low.enough(len(rows)))
        self._low.add(lowest, len(rows))
        self._high.add(-highest, len(rows))

    def merge(self, other: Tails) -> None:
        """Take in all that another one, made for the same columns and count, has taken in."""
        self._low.merge(other._low)
        self._high.merge(other._high)

    def quantiles(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper quantile (columns,) of all rows taken in.

        NaN where a group had so much more than its share in an end that a part of that was lost;
        for independent rows the probability of it is below 1e-13.
        """
        return self._low.quantile(), -self._high.quantile()


class _Tail:
    """The lower of the two `Tails`."""

    def __init__(self, columns: int, count: int, probability: float, capacity: int) -> None:
        # The definition of numpy.quantile's default: linear between the order statistics around
        # (n − 1) p. (Hyndman and Fan, The American Statistician 50(4), 1996, number 7.)
        self._position = (count - 1) * probability
        self._probability = probability
        self._keep = math.floor(self._position) + 2
        self._group = math.inf
        if self._keep > capacity:
            # at most so many rows that their end is expected to fit, see `enough`
            self._keep, self._group = capacity, (math.sqrt(capacity + 8) - 4) ** 2 / probability
        self._rows = np.empty((0, columns))
        self._waiting: list[FloatArray] = []
        self._taken = 0  # rows of the group taken in, kept or not
        self._collapsed: dict[int, FloatArray] = {}  # by the logarithm to base 2 of what they count
        self._lost = np.full(columns, np.inf)  # no row dropped was smaller than this
        self._moved = 0
        self._second: dict[int, bool] = {}

    def add(self, smallest: FloatArray, taken: int) -> None:
        if len(smallest) < taken:
            self._lost = np.minimum(self._lost, smallest.max(axis=0))
        self._take([smallest], taken)

    def merge(self, other: _Tail) -> None:
        self._lost = np.minimum(self._lost, other._lost)
        self._moved += other._moved
        for level, rows in other._collapsed.items():
            self._collapse(rows, level)
        self._take([other._rows, *other._waiting], other._taken)

    def rank_error(self) -> int:
        return self._moved + (2 ** max(self._collapsed) if self._collapsed else 0)

    def quantile(self) -> FloatArray:
        self._settle()
        parts = [(self._rows, 1), *((rows, 2**level) for level, rows in self._collapsed.items())]
        rows = np.vstack([rows for rows, _ in parts])
        counts = np.concatenate([np.full(len(rows), count) for rows, count in parts])
        order = np.argsort(rows, axis=0, kind="stable")
        rows = np.take_along_axis(rows, order, axis=0)
        # A row that counts w stands for w ranks; it is put in the middle of them.
        rank = np.cumsum(counts[order], axis=0) - (counts[order] + 1) / 2
        last = len(rows) - 1
        below = np.clip(np.sum(rank <= self._position, axis=0) - 1, 0, last)
        above = np.minimum(below + 1, last)
        column = np.arange(rows.shape[1])
        step = np.maximum(rank[above, column] - rank[below, column], 1)
        part = np.clip((self._position - rank[below, column]) / step, 0, 1)
        low, high = rows[below, column], rows[above, column]
        quantile = low + part * (high - low)
        return np.where(quantile > self._lost, np.nan, quantile)

    def enough(self, rows: int) -> int:
        """How many of so many rows to keep for their end: what is expected, and 8σ to spare."""
        expected = rows * self._probability
        return min(math.ceil(expected + 8 * math.sqrt(expected) + 8), self._keep, rows)

    def _take(self, parts: list[FloatArray], taken: int) -> None:
        """Take in the smallest of so many rows; they are dealt with when enough of them wait."""
        if self._taken and self._taken + taken > self._group:  # its end would not fit
            self._settle()
            self._collapse(np.sort(self._rows, axis=0), 0)
            self._rows, self._taken = self._rows[:0], 0
        self._waiting += parts
        self._taken += taken
        if sum(map(len, self._waiting)) >= self._keep:
            self._settle()

    def _settle(self) -> None:
        self._rows = self._smallest(np.vstack([self._rows, *self._waiting]), self._keep)
        self._waiting = []

    def _smallest(self, rows: FloatArray, keep: int) -> FloatArray:
        if len(rows) <= keep:
            return rows
        smallest = np.partition(rows, keep - 1, axis=0)[:keep]
        self._lost = np.minimum(self._lost, smallest[-1])
        return smallest.copy()  # a view would keep all of them in memory

    def _collapse(self, rows: FloatArray, level: int) -> None:
        """Put away sorted rows that count 2^level, with those that are there already."""
        while level in self._collapsed:
            both = np.sort(np.vstack([self._collapsed.pop(level), rows]), axis=0)
            # Now the first of each pair, now the second: so the errors make up for each other.
            second = self._second.get(level, bool(level % 2))
            self._second[level] = not second
            rows = both[second::2].copy()
            self._moved += 2**level
            level += 1
        self._collapsed[level] = rows


def _ends(rows: FloatArray, keep: int) -> tuple[FloatArray, FloatArray]:
    """The smallest and the largest entries of each column, (keep, columns) of either."""
    if len(rows) <= MAX_SORTED:
        ordered = np.sort(rows, axis=0)
        return ordered[:keep].copy(), ordered[len(rows) - keep :]
    lowest = np.partition(rows, keep - 1, axis=0)[:keep].copy()  # a view would keep all in memory
    return lowest, np.partition(rows, len(rows) - keep, axis=0)[len(rows) - keep :]


def binomial_interval(
    successes: FloatArray, count: int | NDArray[np.int64], confidence: float = 0.95
) -> tuple[FloatArray, FloatArray]:
    """Confidence interval of a proportion, exact in that it never covers less than it says.

    C. J. Clopper and E. S. Pearson, Biometrika 26(4), 1934.

    Args:
        successes: (...), whole numbers from 0 to `count`; NaN gives NaN.
        count: Number of trials, one for all or (...).
        confidence: Probability of the interval.

    Returns:
        Its lower and upper ends (...).
    """
    miss = (1.0 - confidence) / 2.0
    failures = count - successes
    # The beta quantiles have no meaning where a count is 0; the ends are then 0 and 1.
    low = betaincinv(np.maximum(successes, 1), failures + 1, miss)
    high = betaincinv(successes + 1, np.maximum(failures, 1), 1.0 - miss)
    return np.where(successes == 0, 0.0, low), np.where(failures == 0, 1.0, high)
