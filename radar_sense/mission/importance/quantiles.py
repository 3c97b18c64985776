"""Statistics of weighted draws: moments, range, and quantiles in the tails."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from radar_sense.montecarlo.montecarlo import TAIL
from radar_sense.states import FloatArray

#: Ranks of the tail quantiles of a replicate, in order. Φ(−3) is in the middle.
RANKS = TAIL * np.geomspace(1 / 4, 4, 33)
MIDDLE = len(RANKS) // 2
#: Halvings of the interval that has a pooled quantile.
HALVINGS = 40
#: Largest number of draws that are all sorted. With more draws only the tails are sorted.
SORTED = 1024
#: The smallest 1/8 is sorted if its weight is enough, else the smallest 1/3, else all.
PARTS = (8, 3)


class WeightedStatistics(NamedTuple):
    """Statistics of weighted draws at J times.

    Attributes:
        mean: Mean (J,).
        variance: Variance (J,).
        lower: Quantiles at `RANKS` (q, J).
        upper: Quantiles at 1 − `RANKS` (q, J).
        spread: Greatest minus least draw (J,).
    """

    mean: FloatArray
    variance: FloatArray
    lower: FloatArray
    upper: FloatArray
    spread: FloatArray


def weighted_statistics(values: FloatArray, weights: FloatArray) -> WeightedStatistics:
    """Return the statistics of values (draws, J) with weights (draws,)."""
    share = weights / weights.sum()
    mean = np.einsum("d,dj->j", share, values)
    variance = np.einsum("d,dj->j", share, (values - mean) ** 2)
    columns = np.ascontiguousarray(values.T)
    lower = np.array([_tail_quantiles(column, share) for column in columns])
    upper = np.array([-_tail_quantiles(-column, share) for column in columns])
    return WeightedStatistics(mean, variance, lower.T, upper.T, np.ptp(values, axis=0))


def pooled_quantile(tails: FloatArray) -> FloatArray:
    """Return the quantile at Φ(−3) (J,) of the draws of r replicates together.

    The mean of the replicates' quantiles would have the bias of a quantile of few draws.

    Args:
        tails: Quantiles at `RANKS` of each replicate (r, q, J).
    """
    low, high = tails[:, MIDDLE].min(axis=0), tails[:, MIDDLE].max(axis=0)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        short = np.mean([_rank(tail, middle) for tail in tails], axis=0) < TAIL
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    quantile: FloatArray = 0.5 * (low + high)
    return quantile


def _rank(tail: FloatArray, values: FloatArray) -> FloatArray:
    """Return the ranks of values (J,) in a distribution with quantiles (q, J) at `RANKS`."""
    above = np.clip(np.count_nonzero(tail <= values, axis=0), 1, len(tail) - 1)
    columns = np.arange(len(values))
    left, right = tail[above - 1, columns], tail[above, columns]
    part = np.divide(values - left, right - left, out=np.zeros_like(values), where=right > left)
    rank: FloatArray = RANKS[above - 1] + np.clip(part, 0.0, 1.0) * (
        RANKS[above] - RANKS[above - 1]
    )
    return rank


def _tail_quantiles(values: FloatArray, share: FloatArray) -> FloatArray:
    """Return the quantiles at `RANKS` of values (draws,), of which only the smallest are sorted."""
    if len(values) > SORTED:
        for part in PARTS:
            limit = np.partition(values, len(values) // part)[len(values) // part]
            smallest = np.flatnonzero(values <= limit)
            if share[smallest].sum() > 1.1 * RANKS[-1]:
                values, share = values[smallest], share[smallest]
                break
    order = np.argsort(values, kind="stable")
    share = share[order]
    # The rank of a draw is the middle of its share.
    quantiles: FloatArray = np.interp(RANKS, np.cumsum(share) - 0.5 * share, values[order])
    return quantiles
