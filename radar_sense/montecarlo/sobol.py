"""Sobol' indices: shares of a variance by groups of independent inputs.

The first-order index of a group is the share of the variance that is left when all else is averaged
out; its total index adds every interaction the group takes part in (I. M. Sobol', Math. Comput.
Simul. 55, 2001). They need independent groups: a correlation between two groups belongs to neither.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from radar_sense.states import FloatArray

#: Independent scramblings of the same size; their spread gives the standard errors.
REPLICATES = 8


@dataclass(frozen=True, eq=False)
class SobolIndices:
    """Indices of g groups for s outputs, with standard errors.

    Attributes:
        mean: Mean of the outputs (s,).
        variance: Their variance (s,).
        first: First-order indices (g, s).
        total: Total indices (g, s).
        first_error: Standard errors of the first-order indices (g, s).
        total_error: Standard errors of the total indices (g, s).
    """

    mean: FloatArray
    variance: FloatArray
    first: FloatArray
    total: FloatArray
    first_error: FloatArray
    total_error: FloatArray


def sobol_indices(
    function: Callable[[FloatArray], FloatArray],
    groups: Sequence[Sequence[int]],
    *,
    samples: int,
    seed: int,
) -> SobolIndices:
    """Estimate the indices of groups of independent standard normal inputs.

    The sample is a scrambled Sobol' sequence and the estimators are SciPy's (A. Saltelli et al.,
    Comput. Phys. Commun. 181, 2010), to which a group is one input.

    Args:
        function: From inputs (m, d) to outputs (s, m).
        groups: Input numbers of each group; together they are all d inputs. A group may also be
            listed with groups that are parts of it.
        samples: Base samples, rounded up to a power of two for each of the replicates. The function
            is evaluated g + 2 times as often.
        seed: Seed of the scramblings.

    Returns:
        The indices; NaN for an output without variance.
    """
    # scipy.stats takes long to import, and only those who ask for these indices need it
    from scipy.stats import qmc
    from scipy.stats import sobol_indices as estimate

    dimension = len(set().union(*groups))
    exponent = max(1, int(np.ceil(np.log2(samples / REPLICATES))))
    found = []
    for stream in np.random.SeedSequence(seed).spawn(REPLICATES):
        points = qmc.Sobol(2 * dimension, rng=np.random.default_rng(stream)).random_base2(exponent)
        # a point of exactly 0 would become an infinite normal
        white = ndtri(np.clip(points, 2.0**-60, 1 - 2.0**-53))
        a, b = white[:, :dimension], white[:, dimension:]
        of_a, of_b = function(a), function(b)
        swapped = []
        for group in groups:
            mixed = a.copy()
            mixed[:, list(group)] = b[:, list(group)]
            swapped.append(function(mixed))
        both = np.concatenate([of_a, of_b], axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):  # an output without variance
            indices = estimate(
                func={"f_A": of_a, "f_B": of_b, "f_AB": np.stack(swapped)}, n=len(points)
            )
        # SciPy has the outputs first, the inputs last
        found.append(
            (
                both.mean(axis=1),
                both.var(axis=1),
                np.reshape(indices.first_order, (-1, len(groups))).T,
                np.reshape(indices.total_order, (-1, len(groups))).T,
            )
        )
    means, variances, firsts, totals = (np.stack(values) for values in zip(*found, strict=True))
    constant = variances.mean(axis=0) == 0
    firsts[..., constant] = totals[..., constant] = np.nan
    error = np.sqrt(REPLICATES)
    return SobolIndices(
        mean=means.mean(axis=0),
        variance=variances.mean(axis=0),
        first=firsts.mean(axis=0),
        total=totals.mean(axis=0),
        first_error=firsts.std(axis=0, ddof=1) / error,
        total_error=totals.std(axis=0, ddof=1) / error,
    )
