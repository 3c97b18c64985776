"""Statistics of many draws per pose, computed block by block without keeping the draws."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv

from radar_sense.errors import InputError
from radar_sense.states import FloatArray

#: Blocks up to this number of rows are sorted, because two partitions would take longer.
MAX_SORTED = 512
#: Limit of the memory for the tails [bytes].
MAX_TAIL_BYTES = 4_000_000_000
#: A tail is trimmed when it holds this many times the rows that its quantile needs.
TAIL_ROOM = 1.5


@dataclass(frozen=True, eq=False)
class DrawStatistics:
    """Statistics of draws at each of n poses or looks.

    Attributes:
        mean: Mean of the draws (n,).
        std: Standard deviation of the draws (n,).
        lower: Quantile of the draws at the probability of a tail (n,).
        upper: Quantile of the draws at 1 minus this probability (n,).
    """

    mean: FloatArray
    std: FloatArray
    lower: FloatArray
    upper: FloatArray

    def at(self, rows: NDArray[np.intp]) -> DrawStatistics:
        """Return the statistics at some poses or looks, which may recur."""
        return DrawStatistics(self.mean[rows], self.std[rows], self.lower[rows], self.upper[rows])


class RunningStatistics:
    """Statistics of each column of many rows.

    Args:
        columns: Number of columns.
        count: Number of rows that will be added in total.
        probability: Probability of a tail.
    """

    def __init__(self, columns: int, count: int, probability: float) -> None:
        self._moments, self._tails = RunningMoments(columns), Tails(columns, count, probability)

    @property
    def count(self) -> int:
        """Number of rows added."""
        return self._moments.count

    def add(self, rows: FloatArray) -> None:
        """Add rows (m, columns)."""
        self._moments.add(rows)
        self._tails.add(rows)

    def merge(self, other: RunningStatistics) -> None:
        """Add all rows of another instance, made for the same columns and count."""
        self._moments.merge(other._moments)
        self._tails.merge(other._tails)

    def statistics(self) -> DrawStatistics:
        """Return the statistics of all rows."""
        return DrawStatistics(self._moments.mean, self._moments.std(), *self._tails.quantiles())


class RunningMoments:
    """Mean and standard deviation of each column of many rows.

    Blocks of rows are merged by the update of Chan, Golub and LeVeque ("Updating formulae and a
    pairwise algorithm for computing sample variances", 1979). A sum of squares would lose digits
    if the deviation is small compared with the mean.
    """

    def __init__(self, columns: int) -> None:
        self.count = 0
        self.mean = np.zeros(columns)
        self._squares = np.zeros(columns)  # sum of squared deviations from the mean

    def add(self, rows: FloatArray) -> None:
        """Add rows (m, columns)."""
        mean = rows.sum(axis=0) / len(rows)
        deviation = rows - mean
        # The deviations sum to the rounding error of the mean (the corrected two-pass algorithm
        # of Chan, Golub and LeVeque, The American Statistician 37(3), 1983).
        rounding = deviation.sum(axis=0) / len(rows)
        squares = np.square(deviation, out=deviation).sum(axis=0)
        squares -= len(rows) * rounding * rounding
        self._merge(len(rows), mean + rounding, np.maximum(squares, 0.0))

    def merge(self, other: RunningMoments) -> None:
        """Add all rows of another instance."""
        self._merge(other.count, other.mean, other._squares)

    def _merge(self, count: int, mean: FloatArray, squares: FloatArray) -> None:
        total = self.count + count
        step = mean - self.mean
        self._squares += squares
        self._squares += step * step * (self.count * count / total)
        self.mean += step * (count / total)
        self.count = total

    def std(self) -> FloatArray:
        """Return the sample standard deviation (columns,), with n − 1 in the denominator."""
        return np.sqrt(self._squares / (self.count - 1))


class Tails:
    """Exact quantiles near both ends of each column of many rows.

    The quantile at probability p of n rows lies between two order statistics. The p n + 2 smallest
    and the p n + 2 largest rows determine both quantiles. Only these rows are kept.

    Args:
        columns: Number of columns.
        count: Number of rows that will be added in total, n.
        probability: p of the lower quantile; the upper quantile is at 1 − p.

    Raises:
        InputError: If the rows to keep take more than MAX_TAIL_BYTES.
    """

    def __init__(self, columns: int, count: int, probability: float) -> None:
        row, capacity = 2 * columns * 8, _capacity(count, probability)
        if capacity * row > MAX_TAIL_BYTES:
            fit = math.floor((math.floor(MAX_TAIL_BYTES / row / TAIL_ROOM) - 2) / probability)
            remedy = f"at most {fit:,} runs fit" if fit >= 2 else "use fewer poses"
            raise InputError(
                f"exact quantiles of {count:,} runs of {columns:,} poses would take "
                f"{capacity * row / 1e9:,.1f} GB of memory, more than "
                f"{MAX_TAIL_BYTES / 1e9:g} GB; {remedy}"
            )
        self._low = _Tail(columns, count, probability)
        # The largest rows are the smallest of the negated rows.
        self._high = _Tail(columns, count, probability)

    @property
    def bytes(self) -> int:
        """Memory in use."""
        return self._low.bytes + self._high.bytes

    def add(self, rows: FloatArray) -> None:
        """Add rows (m, columns)."""
        lowest, highest = _ends(rows, self._low.share(len(rows)))
        self._low.add(lowest, len(rows))
        self._high.add(-highest, len(rows))

    def merge(self, other: Tails) -> None:
        """Add all rows of another instance, made for the same columns and count."""
        self._low.merge(other._low)
        self._high.merge(other._high)

    def quantiles(self) -> tuple[FloatArray, FloatArray]:
        """Return the lower and upper quantile (columns,) of all rows.

        A quantile is NaN if a row of the tail was dropped. A block drops rows of the tail if the
        block has far more than its share. For independent rows the probability is below 1e-13.
        """
        return self._low.quantile(), -self._high.quantile()


class _Tail:
    """The smallest rows of each column that the lower quantile needs."""

    def __init__(self, columns: int, count: int, probability: float) -> None:
        self._position = quantile_position(count, probability)
        self._probability = probability
        self._keep = _needed(count, probability)
        self.capacity = _capacity(count, probability)
        self._buffer: FloatArray = np.empty((0, columns))  # grows to the capacity at most
        self._filled = 0
        self._dropped = np.full(columns, np.inf)  # lower bound of all dropped rows

    @property
    def bytes(self) -> int:
        return self._buffer.nbytes

    def share(self, rows: int) -> int:
        """Return the number of rows of a block to keep."""
        return min(tail_share(rows, self._probability), self._keep)

    def add(self, smallest: FloatArray, rows: int) -> None:
        """Add the smallest entries of each column of a block of `rows` rows."""
        if len(smallest) < min(rows, self._keep):
            self._dropped = np.minimum(self._dropped, smallest.max(axis=0))
        while len(smallest):
            if self._filled == self.capacity:
                self._buffer.partition(self._keep - 1, axis=0)
                self._filled = self._keep
            fits = min(len(smallest), self.capacity - self._filled)
            self._reserve(self._filled + fits)
            self._buffer[self._filled : self._filled + fits] = smallest[:fits]
            self._filled += fits
            smallest = smallest[fits:]

    def merge(self, other: _Tail) -> None:
        self._dropped = np.minimum(self._dropped, other._dropped)
        self.add(other._buffer[: other._filled], 0)

    def quantile(self) -> FloatArray:
        rows = self._buffer[: self._filled]
        below = math.floor(self._position)
        above = min(below + 1, len(rows) - 1)
        rows.partition([below, above], axis=0)
        low, high = rows[below], rows[above]
        fraction = self._position - below
        needed = high if fraction > 0 else low
        return np.where(needed > self._dropped, np.nan, low + fraction * (high - low))

    def _reserve(self, rows: int) -> None:
        """Make room for a number of rows, at most the capacity."""
        if rows <= len(self._buffer):
            return
        capacity = min(self.capacity, max(rows, 2 * len(self._buffer)))
        larger: FloatArray = np.empty((capacity, *self._columns))
        larger[: self._filled] = self._buffer[: self._filled]
        self._buffer = larger

    @property
    def _columns(self) -> tuple[int, ...]:
        return self._buffer.shape[1:]


def tail_share(rows: int, probability: float) -> int:
    """Return the number of rows in a tail that a block exceeds with a probability below 1e-13.

    The number is the expected number in the tail plus 8σ, at most all rows of the block.

    Args:
        rows: Number of rows of the block.
        probability: Probability of the tail.
    """
    expected = rows * probability
    return min(math.ceil(expected + 8 * math.sqrt(expected) + 8), rows)


def _needed(count: int, probability: float) -> int:
    """Return the number of the smallest of `count` rows that determine the quantile."""
    return min(math.floor(quantile_position(count, probability)) + 2, count)


def _capacity(count: int, probability: float) -> int:
    """Return the largest number of rows of a tail."""
    return math.ceil(TAIL_ROOM * _needed(count, probability))


def quantile_position(count: int, probability: float) -> float:
    """Return the position, counted from 0, of a quantile among `count` sorted rows.

    The quantile is linear between the order statistics around (n − 1) p, the default of NumPy
    (Hyndman and Fan, The American Statistician 50(4), 1996, number 7).
    """
    return (count - 1) * probability


def order_statistics(rows: FloatArray, position: FloatArray) -> FloatArray:
    """Return order statistics (columns,) of rows (m, columns), linear between two positions.

    Args:
        rows: The rows, or at least the smallest entries of each column up to the positions.
        position: Position in each column (columns,), counted from 0.
    """
    below = np.floor(position).astype(int)
    keep = min(len(rows), int(below.max()) + 2)
    smallest = np.sort(_lowest(rows, keep), axis=0)
    column = np.arange(rows.shape[1])
    low, high = smallest[below, column], smallest[np.minimum(below + 1, keep - 1), column]
    values: FloatArray = low + (position - below) * (high - low)
    return values


def tail_quantiles(
    rows: FloatArray, count: int, probability: float
) -> tuple[FloatArray, FloatArray]:
    """Return the quantiles (columns,) of `count` rows at a probability and at 1 − probability.

    Args:
        rows: All rows, or at least the rows of both tails (m, columns).
        count: Number of all rows.
        probability: Probability of the lower quantile.
    """
    # The rank from either end is the same in the tails as among all rows.
    position = np.full(rows.shape[1], quantile_position(count, probability))
    return order_statistics(rows, position), -order_statistics(-rows, position)


def highest(rows: FloatArray, keep: int) -> FloatArray:
    """Return the largest entries of each column (keep, columns), in no order."""
    return np.partition(rows, len(rows) - keep, axis=0)[len(rows) - keep :]


def _lowest(rows: FloatArray, keep: int) -> FloatArray:
    """Return the smallest entries of each column (keep, columns), in no order."""
    return np.partition(rows, keep - 1, axis=0)[:keep]


def _ends(rows: FloatArray, keep: int) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and the largest entries of each column, both (keep, columns)."""
    if len(rows) <= MAX_SORTED:
        ordered = np.sort(rows, axis=0)
        return ordered[:keep], ordered[len(rows) - keep :]
    return _lowest(rows, keep), highest(rows, keep)


def binomial_interval(
    successes: FloatArray, count: int | NDArray[np.int64], confidence: float = 0.95
) -> tuple[FloatArray, FloatArray]:
    """Return a confidence interval of a proportion, with at least the stated confidence.

    C. J. Clopper and E. S. Pearson, Biometrika 26(4), 1934.

    Args:
        successes: (...), whole numbers from 0 to `count`; NaN gives NaN.
        count: Number of trials, one for all or (...).
        confidence: Probability of the interval.

    Returns:
        Lower and upper ends (...).
    """
    miss = (1.0 - confidence) / 2.0
    failures = count - successes
    # The beta quantiles are undefined where a count is 0; the ends are then 0 and 1.
    low = betaincinv(np.maximum(successes, 1), failures + 1, miss)
    high = betaincinv(successes + 1, np.maximum(failures, 1), 1.0 - miss)
    return np.where(successes == 0, 0.0, low), np.where(failures == 0, 1.0, high)
