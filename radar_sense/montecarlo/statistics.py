"""Statistics of many draws per pose, computed block by block without keeping the draws."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv

from radar_sense.cost import MOST_BYTES
from radar_sense.errors import InputError
from radar_sense.states import FloatArray

#: The tails are taken from the rows when these are this many times those of a tail; two are kept.
ROOM = 3
#: Independent replicates of draws, of the same size. Their spread gives the standard errors, which
#: are themselves known to a quarter.
REPLICATES = 8
#: A smaller standard deviation of P_D counts as zero, as in print.
LEAST_STD = 1e-6


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


class Statistics:
    """Mean, standard deviation, and exact quantiles near both ends, of columns of many rows.

    Blocks of rows are merged by the update of Chan, Golub and LeVeque ("Updating formulae and a
    pairwise algorithm for computing sample variances", 1979). A sum of squares would lose digits
    if the deviation is small compared with the mean.

    A quantile at probability p of n rows lies between two order statistics. The p n + 2 smallest
    and the p n + 2 largest values of a column determine both quantiles. Only these are kept.

    Args:
        columns: Number of columns.
        count: Largest number of rows that will be added, n.
        probability: p of the lower quantile; the upper quantile is at 1 − p.

    Attributes:
        count: Number of rows added.
        mean: Mean of each column (columns,).

    Raises:
        InputError: If the rows to keep take more than MOST_BYTES.
    """

    def __init__(self, columns: int, count: int, probability: float) -> None:
        self._keep = math.floor((count - 1) * probability) + 2
        row = ROOM * columns * 8
        if self._keep * row > MOST_BYTES:
            fit = math.floor((math.floor(MOST_BYTES / row) - 2) / probability)
            remedy = f"at most {fit:,} runs fit" if fit >= 2 else "use fewer poses"
            raise InputError(
                f"exact quantiles of {count:,} runs of {columns:,} poses would take "
                f"{self._keep * row / 1e9:,.1f} GB of memory, more than "
                f"{MOST_BYTES / 1e9:g} GB; {remedy}"
            )
        self.count = 0
        self.mean = np.zeros(columns)
        self._squares = np.zeros(columns)  # sum of squared deviations from the mean
        self._probability = probability
        self._rows: list[FloatArray] = []  # with all values of both tails

    def add(self, rows: FloatArray) -> None:
        """Add rows (m, columns), which must not change afterwards."""
        mean = rows.sum(axis=0) / len(rows)
        deviation = rows - mean
        # The deviations sum to the rounding error of the mean (the corrected two-pass algorithm
        # of Chan, Golub and LeVeque, The American Statistician 37(3), 1983).
        rounding = deviation.sum(axis=0) / len(rows)
        squares = np.square(deviation, out=deviation).sum(axis=0)
        squares -= len(rows) * rounding * rounding
        self._merge(len(rows), mean + rounding, np.maximum(squares, 0.0), [rows])

    def merge(self, other: Statistics) -> None:
        """Add all rows of another instance, made for the same columns and count."""
        self._merge(other.count, other.mean, other._squares, other._rows)

    def result(self) -> DrawStatistics:
        """Return the statistics of all rows, with n − 1 in the denominator of the deviation."""
        quantiles = tail_quantiles(np.concatenate(self._rows), self.count, self._probability)
        return DrawStatistics(self.mean, np.sqrt(self._squares / (self.count - 1)), *quantiles)

    def _merge(
        self, count: int, mean: FloatArray, squares: FloatArray, rows: list[FloatArray]
    ) -> None:
        total = self.count + count
        step = mean - self.mean
        self._squares += squares
        self._squares += step * step * (self.count * count / total)
        self.mean += step * (count / total)
        self.count = total
        self._rows += rows
        if sum(map(len, self._rows)) > ROOM * self._keep:
            # `np.sort` is vectorized, `np.partition` at two ranks takes two to five times as long
            ranked = np.sort(np.concatenate(self._rows), axis=0)
            self._rows = [ranked[: self._keep].copy(), ranked[-self._keep :].copy()]


def tail_quantiles(
    rows: FloatArray, count: int, probability: float
) -> tuple[FloatArray, FloatArray]:
    """Return the quantiles (columns,) of `count` rows at a probability and at 1 − probability.

    They are linear between the order statistics around (n − 1) p, the default of NumPy (Hyndman and
    Fan, The American Statistician 50(4), 1996, number 7). The rows of both tails (m, columns) are
    enough.
    """
    position = (count - 1) * probability
    below = math.floor(position)
    # a rank from either end is the same in the tails as among all rows
    end = len(rows) - 1 - below
    low, next_low, high, next_high = np.sort(rows, axis=0)[[below, below + 1, end, end - 1]]
    part = position - below
    return low + part * (next_low - low), high + part * (next_high - high)


def binomial_interval(
    successes: FloatArray, count: int, confidence: float = 0.95
) -> tuple[FloatArray, FloatArray]:
    """Return the ends (...) of an interval of a proportion, with at least the stated confidence.

    Successes (...) that are NaN give NaN (C. J. Clopper and E. S. Pearson, Biometrika 26(4), 1934).
    """
    miss = (1.0 - confidence) / 2.0
    failures = count - successes
    # The beta quantiles are undefined where a count is 0; the ends are then 0 and 1.
    low = betaincinv(np.maximum(successes, 1), failures + 1, miss)
    high = betaincinv(successes + 1, np.maximum(failures, 1), 1.0 - miss)
    return np.where(successes == 0, 0.0, low), np.where(failures == 0, 1.0, high)
