"""Sobol' indices: shares of a variance by groups of independent inputs.

The first-order index of a group is the share of the variance that remains when all other inputs are
averaged out. The total index adds every interaction of the group (I. M. Sobol', Math. Comput.
Simul. 55, 2001). Groups must be independent, because a correlation has no group.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from radar_sense.cost import MOST_BYTES
from radar_sense.errors import InputError
from radar_sense.montecarlo.statistics import REPLICATES
from radar_sense.states import FloatArray, slices
from radar_sense.uncertain_states import MAX_NUMBERS


@dataclass(frozen=True, eq=False, repr=False)
class SobolIndices:
    """Indices of g groups for s outputs, with standard errors.

    Attributes:
        mean: Mean of the outputs (s,).
        variance: Variance of the outputs (s,).
        first: First-order indices (g, s).
        total: Total indices (g, s).
        first_error: Standard errors of the first-order indices (g, s).
        total_error: Standard errors of the total indices (g, s).
        variance_error: Standard errors of the variance (s,).
        first_without_one: First-order indices without one of r replicates (r, g, s), see
            `jackknife_error`.
    """

    mean: FloatArray
    variance: FloatArray
    first: FloatArray
    total: FloatArray
    first_error: FloatArray
    total_error: FloatArray
    variance_error: FloatArray
    first_without_one: FloatArray


def sobol_indices(
    function: Callable[[FloatArray, slice], FloatArray],
    groups: Sequence[Sequence[int]],
    *,
    outputs: int,
    samples: int,
    seed: int,
) -> SobolIndices:
    """Return indices of groups of independent standard normal inputs, NaN where nothing varies.

    The sample is a scrambled Sobol' sequence. The estimators are those of I. Azzini, T. A. Mara and
    R. Rosati (Environ. Model. Softw. 144, 2021), with a group in place of one input. Their errors
    are small where an index is small, and a first-order index is at most the total one. A group
    that has most of the variance is known better by all other inputs, of which the same outputs
    tell: its first-order index is 1 minus their total index, and its total index is 1 minus their
    first-order index. The outputs are computed in blocks to limit the memory.

    Args:
        function: Returns some outputs (k, m) at inputs (m, d). The slice selects the outputs.
        groups: Input numbers of each group. All groups together have all d inputs. A group may
            contain other groups.
        outputs: Number of outputs, s.
        samples: Base samples, rounded up to a power of two for each replicate. The function is
            evaluated 2g + 2 times for each base sample.
        seed: Seed of the scramblings.
    """
    # scipy.stats is slow to import
    from scipy.stats import qmc

    dimension = len(set().union(*groups))
    exponent = max(1, int(np.ceil(np.log2(samples / REPLICATES))))
    # 10 numbers an input for normals, states and temporaries; 4 a value at A, B and each mixture
    row_bytes = 8 * (10 * dimension + 4 * (len(groups) + 2))
    if row_bytes << exponent > MOST_BYTES:
        fit = REPLICATES << int(np.log2(MOST_BYTES / row_bytes))
        raise InputError(
            f"Sobol' indices of {samples:,} runs would take "
            f"{(row_bytes << exponent) / 1e9:,.1f} GB of memory, more than "
            f"{MOST_BYTES / 1e9:g} GB; at most {fit:,} runs fit"
        )
    block = max(1, MAX_NUMBERS // ((len(groups) + 2) << exponent))
    replicates = []
    for stream in np.random.SeedSequence(seed).spawn(REPLICATES):
        points = qmc.Sobol(2 * dimension, rng=np.random.default_rng(stream)).random_base2(exponent)
        # a point of exactly 0 would become an infinite normal
        np.clip(points, 2.0**-60, 1 - 2.0**-53, out=points)
        normals = ndtri(points, out=points)
        blocks = [_indices(function, groups, normals, part) for part in slices(outputs, block)]
        replicates.append([np.concatenate(parts, axis=-1) for parts in zip(*blocks, strict=True)])
    of_replicates = [np.stack(values) for values in zip(*replicates, strict=True)]
    mean, variance, (own, rest) = _joined(*of_replicates)
    without_one = [
        _joined(*(np.delete(values, i, axis=0) for values in of_replicates))
        for i in range(REPLICATES)
    ]
    minor = own[1] <= rest[1]

    def chosen(own: FloatArray, rest: FloatArray) -> FloatArray:
        """Return the indices (2, g, s) of groups: their own, or 1 less those of all others."""
        return np.where(variance == 0, np.nan, np.where(minor, own, 1.0 - rest[::-1]))

    first, total = chosen(own, rest)
    firsts, totals = np.stack([chosen(*indices) for *_, indices in without_one], axis=1)
    return SobolIndices(
        mean=mean,
        variance=variance,
        first=first,
        total=total,
        first_error=jackknife_error(firsts),
        total_error=jackknife_error(totals),
        variance_error=jackknife_error(np.stack([spread for _, spread, _ in without_one])),
        first_without_one=firsts,
    )


def jackknife_error(without_one: FloatArray) -> FloatArray:
    """Return the standard error (...) of a value, from the values without one replicate (r, ...).

    Few samples make a ratio skewed, and its error to first order would be too small (B. Efron and
    C. Stein, Ann. Statist. 9(3), 1981).
    """
    return np.sqrt((len(without_one) - 1) * np.var(without_one, axis=0))


def _joined(
    means: FloatArray, variances: FloatArray, parts: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean, variance (s,), and indices (2, 2, g, s), as `_indices`, of replicates (r, ...).

    Indices are 0 where nothing varies. Each index is a ratio of means, because the mean of ratios
    of few samples would be biased.
    """
    variance = variances.mean(axis=0)
    variance = np.where(variance == 0, 0.0, variance + means.var(axis=0))
    divisor = np.where(variance == 0, np.inf, variance)
    return means.mean(axis=0), variance, parts.mean(axis=0) / divisor


def _indices(
    function: Callable[[FloatArray, slice], FloatArray],
    groups: Sequence[Sequence[int]],
    normals: FloatArray,
    outputs: slice,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean and variance (k,) of some outputs, and parts of the variance (2, 2, g, k).

    The parts are the first-order and the total index, each times the variance, of each group, and
    of all inputs that are not of the group.
    """
    a, b = np.hsplit(normals, 2)
    at_a, at_b = function(a, outputs), function(b, outputs)
    both = np.concatenate([at_a, at_b], axis=1)
    parts = np.empty((2, 2, len(groups), len(both)))
    for i, group in enumerate(groups):
        near_a, near_b = a.copy(), b.copy()
        near_a[:, list(group)], near_b[:, list(group)] = b[:, list(group)], a[:, list(group)]
        ends = function(near_a, outputs), function(near_b, outputs)
        for of, (one, other) in zip(parts, (ends, ends[::-1]), strict=True):
            change, back = one - at_a, at_b - other
            of[0, i] = np.mean(change * back, axis=1) / 2.0
            of[1, i] = np.mean(change**2 + back**2, axis=1) / 4.0
    return both.mean(axis=1), both.var(axis=1), parts
