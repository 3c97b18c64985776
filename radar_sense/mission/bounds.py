"""Bounds of a mission from weighted draws, which are made in independent replicates.

The quantiles of all replicates are pooled, and the spread of their bounds gives the standard
errors. A bound is computed at each time that P may rise at, and none is interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from radar_sense.mission.schedule import Schedule
from radar_sense.mission.tracks import detection_by_time, track_by_time
from radar_sense.montecarlo.statistics import DrawStatistics
from radar_sense.states import FloatArray

#: Ranks of the quantiles of a replicate, as parts of the rank of a bound, which is in the middle.
PARTS = np.geomspace(1 / 4, 4, 33)
#: Largest rank of a quantile.
MOST_RANK = 0.9


@dataclass(frozen=True, eq=False)
class Cumulative(DrawStatistics):
    """Statistics of the probability of an event by each time (K,), with bounds at Φ(−k) and Φ(k).

    Attributes:
        lower_se: Standard error of `lower`.
        upper_se: Standard error of `upper`.
        mean_se: Standard error of `mean`.
        p: Probability with the nominal states.
    """

    lower_se: FloatArray
    upper_se: FloatArray
    mean_se: FloatArray
    p: FloatArray

    @property
    def bound_se(self) -> FloatArray:
        """Standard error (K,) of the bound that is known worse."""
        return np.maximum(self.lower_se, self.upper_se)


class Weighted(NamedTuple):
    """Statistics of weighted draws at K times.

    Attributes:
        mean: Mean (K,).
        variance: Variance (K,).
        lower: Quantiles at ranks (K, q).
        upper: Quantiles at 1 − ranks (K, q).
    """

    mean: FloatArray
    variance: FloatArray
    lower: FloatArray
    upper: FloatArray


def weighted_statistics(
    schedule: Schedule,
    of_groups: Sequence[Sequence[FloatArray]],
    seen: NDArray[np.intp],
    weight: FloatArray,
    ranks: FloatArray,
) -> list[Weighted]:
    """Return statistics of detection, and of a track, by each time.

    Each scan group has P_D (L, n) of its looks, and the probability of a track by each. P changes
    at no other times than those `seen`, at which a radar may see the aircraft.
    """
    times, share = np.union1d([0], seen), weight / weight.sum()
    latest = np.searchsorted(times, np.arange(len(schedule.time)), side="right") - 1
    results = []
    by_event = zip((detection_by_time, track_by_time), zip(*of_groups, strict=True), strict=False)
    for by_time, of_event in by_event:
        values = by_time(schedule, of_event, times)
        mean = np.einsum("kn,n->k", values, share)
        variance = [np.sum(share * (row - m) ** 2) for row, m in zip(values, mean, strict=True)]
        # Each draw grows with time. Its lower tail is therefore followed backwards.
        lower = -upper_tails(-values[::-1], share, ranks)[::-1]
        statistics = mean, np.array(variance), lower, upper_tails(values, share, ranks)
        results.append(Weighted(*(of_times[latest] for of_times in statistics)))
    return results


def ranks_about(k: float) -> FloatArray:
    """Return the ranks (q,) of the quantiles about a bound at kσ, which is in the middle."""
    tail = float(ndtr(-k))
    return tail * PARTS ** min(1.0, math.log(MOST_RANK / tail) / math.log(PARTS[-1]))


def upper_tails(values: FloatArray, share: FloatArray, ranks: FloatArray) -> FloatArray:
    """Return the quantiles (K, q) at 1 − ranks (q,) of values (K, n), which grow with k.

    The draws in the tail at one time are above the least draw of the tail at the time before. Each
    draw has a share (n,) in the distribution.
    """
    quantiles, least = np.empty((len(values), len(ranks))), -np.inf
    for k, row in enumerate(values):
        (largest,) = (row >= least).nonzero()
        largest = largest[(-row[largest]).argsort()]
        rank = share[largest].cumsum()
        # the rank of a draw is the middle of its share
        quantiles[k] = np.interp(ranks, rank - 0.5 * share[largest], row[largest])
        tail = min(rank.searchsorted(ranks[-1]) + 1, len(largest) - 1)
        least = row[largest[tail]]
    return quantiles


def pooled(ranks: FloatArray, nominal: FloatArray, *replicates: Weighted) -> Cumulative:
    """Return the bounds (K,) of all replicates, and their standard errors."""
    p, middle = nominal[:, 0], len(ranks) // 2
    means, variances, lowers, uppers = (np.array(v) for v in zip(*replicates, strict=True))
    mean = means.mean(axis=0)
    std = np.sqrt(variances.mean(axis=0) + means.var(axis=0))
    lower, upper = pooled_quantiles(lowers, ranks), -pooled_quantiles(-uppers, ranks)
    lower_se, upper_se, mean_se = (
        found.std(axis=0, ddof=1) / math.sqrt(len(replicates))
        for found in (lowers[..., middle], uppers[..., middle], means)
    )
    # A deviation within rounding is no uncertainty. Each draw grows with time, as do mean and
    # bounds. The accumulation removes rounding errors, and the sum −0.
    certain = std <= 1e-12 * mean
    mean, lower, upper = (
        np.maximum.accumulate(np.where(certain, p, v)) + 0.0 for v in (mean, lower, upper)
    )
    std, lower_se, upper_se, mean_se = (
        np.where(certain, 0.0, v) for v in (std, lower_se, upper_se, mean_se)
    )
    return Cumulative(mean, std, lower, upper, lower_se, upper_se, mean_se, p)


def pooled_quantiles(tails: FloatArray, ranks: FloatArray) -> FloatArray:
    """Return the quantiles (K,) at the middle rank of the draws of all replicates together.

    They follow from the quantiles of each replicate (r, K, q). The mean of these would have the
    bias of a quantile of few draws. A value that many draws have, such as 0, has the ranks from its
    first to its last.
    """
    changed = np.append(True, np.any(tails[:, 1:] != tails[:, :-1], axis=(0, 2)))
    quantiles = []
    for of_time in np.moveaxis(tails[:, changed], 1, 0):
        values = np.unique(of_time)
        last = sum(np.interp(values, tail, ranks, left=0.0) for tail in of_time)
        # numpy.interp takes the last of equal values, and so the first from above
        first = sum(-np.interp(-values, -tail[::-1], -ranks[::-1], right=0.0) for tail in of_time)
        rank = np.column_stack([first, last]) / len(tails)
        quantiles.append(np.interp(ranks[len(ranks) // 2], np.ravel(rank), np.repeat(values, 2)))
    # where no radar sees the aircraft, nothing changes
    return np.array(quantiles)[np.cumsum(changed) - 1]
