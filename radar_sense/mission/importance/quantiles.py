"""Statistics of weighted draws: mean, variance, quantiles at Φ(−3) and Φ(3), and range."""

from __future__ import annotations

import numpy as np

from radar_sense.montecarlo.montecarlo import TAIL
from radar_sense.states import FloatArray

#: Up to this number of draws all are sorted. Of more draws only the tails are sorted.
SORTED = 1024
#: The smallest 1/8 is sorted if its weight is enough, else the smallest 1/3, else all.
PARTS = (8, 3)


def weighted_statistics(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Return mean, variance, quantiles at Φ(−3) and Φ(3), and range (5, J).

    Args:
        values: Values (draws, J).
        weights: Weights (draws,).
    """
    share = weights / weights.sum()
    mean = np.einsum("d,dj->j", share, values)
    variance = np.einsum("d,dj->j", share, (values - mean) ** 2)
    return np.array([mean, variance, *weighted_quantiles(values, weights), np.ptp(values, axis=0)])


def weighted_quantiles(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Return quantiles (2, J) at Φ(−3) and Φ(3) of values (draws, J) with weights (draws,)."""
    columns, total = np.ascontiguousarray(values.T), weights.sum()
    lower = [_tail_quantile(column, weights, total) for column in columns]
    upper = [-_tail_quantile(-column, weights, total) for column in columns]
    return np.array([lower, upper])


def _tail_quantile(values: FloatArray, weights: FloatArray, total: float) -> float:
    """Return the quantile at Φ(−3) of values (draws,), of which only the smallest are sorted."""
    if len(values) > SORTED:
        for part in PARTS:
            limit = np.partition(values, len(values) // part)[len(values) // part]
            smallest = np.flatnonzero(values <= limit)
            if weights[smallest].sum() > 2.0 * TAIL * total:
                values, weights = values[smallest], weights[smallest]
                break
    order = np.argsort(values, kind="stable")
    weights = weights[order]
    # The rank of a draw is the middle of its weight.
    rank = (np.cumsum(weights) - 0.5 * weights) / total
    return float(np.interp(TAIL, rank, values[order]))
