"""Statistics of many draws per pose, gathered block by block without keeping the draws."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv

from radar_sense.states import FloatArray


class RunningMoments:
    """Mean and standard deviation per column of blocks of rows.

    Blocks are merged by the update of Chan, Golub and LeVeque ("Updating formulae and a pairwise
    algorithm for computing sample variances", 1979), which does not lose digits as a sum of squares
    does when the deviation is small beside the mean.
    """

    def __init__(self, columns: int) -> None:
        self.count = 0
        self.mean = np.zeros(columns)
        self._squares = np.zeros(columns)  # sum of squared deviations from the mean

    def add(self, block: FloatArray) -> None:
        """Take in a block (rows, columns)."""
        rows = len(block)
        mean = block.mean(axis=0)
        deviation = block - mean
        total = self.count + rows
        step = mean - self.mean
        self._squares += np.sum(deviation * deviation, axis=0)
        self._squares += step * step * (self.count * rows / total)
        self.mean += step * (rows / total)
        self.count = total

    def std(self) -> FloatArray:
        """Sample standard deviation (columns,), with n − 1 in the denominator."""
        return np.sqrt(self._squares / (self.count - 1))


class Tails:
    """Exact quantiles near both ends, from the few smallest and largest rows of each column.

    The quantile at probability p of n draws lies between two order statistics, found from the end
    by counting about p n draws; those are all that is kept. As soon as that many more rows wait,
    they are merged with them and the inner ones are dropped.

    Args:
        columns: Number of columns.
        count: How many rows there will be in total.
        probability: p of the lower quantile; the upper one is at 1 − p.
    """

    def __init__(self, columns: int, count: int, probability: float) -> None:
        # The definition of numpy.quantile's default: linear between the order statistics around
        # (n − 1) p. (Hyndman and Fan, The American Statistician 50(4), 1996, number 7.)
        position = (count - 1) * probability
        self._below = math.floor(position)
        self._part = position - self._below
        self._keep = self._below + 2
        self._low = np.empty((0, columns))
        self._high = np.empty((0, columns))
        self._waiting: list[FloatArray] = []
        self._waiting_rows = 0

    def add(self, block: FloatArray) -> None:
        """Take in a block (rows, columns)."""
        self._waiting.append(block)
        self._waiting_rows += len(block)
        if self._waiting_rows >= self._keep:
            self._merge()

    def quantiles(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper quantile (columns,) of all rows taken in."""
        self._merge()
        low, high = (self._between(np.sort(rows, axis=0)) for rows in (self._low, self._high))
        return low, -high

    def _merge(self) -> None:
        new = self._waiting
        self._low = self._trim(np.vstack([self._low, *new]))
        # The largest are the smallest of the negated draws, so that one rule serves both ends.
        self._high = self._trim(np.vstack([self._high, *(-block for block in new)]))
        self._waiting, self._waiting_rows = [], 0

    def _trim(self, rows: FloatArray) -> FloatArray:
        if len(rows) <= self._keep:
            return rows
        return np.partition(rows, self._keep - 1, axis=0)[: self._keep]

    def _between(self, rows: FloatArray) -> FloatArray:
        below: FloatArray = rows[self._below]
        above: FloatArray = rows[min(self._below + 1, len(rows) - 1)]
        return below + self._part * (above - below)


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
