"""Random combinations of the draws of independent radars or scan groups."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from radar_sense.states import FloatArray

#: Share of the combinations that is drawn without an emphasis, and with low values of all sources.
NATURAL, LOW = 0.15, 0.15
#: Low values are drawn so that the sum falls by this number of standard deviations.
LOW_SIGMAS = 3.0
#: Larger values count as this one: P rounds to 1, and the value may be infinite.
LARGEST = 50.0


def combine(
    generator: np.random.Generator,
    weights: Sequence[FloatArray],
    values: Sequence[FloatArray],
    emphasis: FloatArray,
    combinations: int,
) -> tuple[list[NDArray[np.intp]], FloatArray]:
    """Combine the draws of independent sources at random, for each pose path.

    A combination has an emphasis on one source, on low values of all sources, or on none. A source
    without emphasis is drawn in proportion to its weights, which is its own distribution. The
    source with emphasis is drawn uniformly, which is the distribution of its draws. For low values,
    the weights of all sources have a factor that falls exponentially with the value (exponential
    tilting, which suits the tail of a sum: S. Asmussen and P. W. Glynn, *Stochastic Simulation*,
    2007, ch. VI.2). The weight of a combination is the ratio of the densities for the mixture of
    all emphases (the balance heuristic: E. Veach and L. J. Guibas, "Optimally combining sampling
    techniques for Monte Carlo rendering", SIGGRAPH 1995).

    Args:
        generator: Makes the random choices.
        weights: Weights (p, draws) of each source.
        values: A value (p, draws) of each draw of each source, such as −ln(1 − P).
        emphasis: Relative frequency of the emphasis on each source, not normalized (sources,).
        combinations: Combinations for each pose path.

    Returns:
        For each source the draws taken (p, combinations), and weights (p, combinations).
    """
    shape = (len(weights[0]), combinations)
    alpha = (1.0 - NATURAL - LOW) * emphasis / emphasis.sum()
    focus = np.searchsorted(np.cumsum(alpha), generator.random(shape), side="right")
    low = generator.random(shape) < LOW / (NATURAL + LOW)
    low &= focus == len(weights)
    values = [np.minimum(value, LARGEST) for value in values]
    rate = _low_rate(weights, values)
    picks, mass, mixture, low_ratio = [], np.ones((shape[0], 1)), np.full(shape, NATURAL), LOW
    for source, (weight, value) in enumerate(zip(weights, values, strict=True)):
        draws = weight.shape[1]
        # The least value of each path keeps the factors of a path from being all zero.
        factor = np.exp(-rate * (value - value.min(axis=1, keepdims=True)))
        uniform = generator.permuted(
            np.broadcast_to(np.arange(combinations) % draws, shape), axis=1
        )
        level = generator.random(shape)
        pick = np.where(low, _pick(weight * factor, level), _pick(weight, level))
        pick = np.where(focus == source, uniform, pick)
        mean = weight.mean(axis=1, keepdims=True)
        mass = mass * mean
        mixture += alpha[source] * mean / np.take_along_axis(weight, pick, axis=1)
        low_mean = np.mean(weight * factor, axis=1, keepdims=True)
        low_ratio = low_ratio * mean * np.take_along_axis(factor, pick, axis=1) / low_mean
        picks.append(pick)
    return picks, mass / (mixture + low_ratio)


def _pick(weight: FloatArray, level: FloatArray) -> NDArray[np.intp]:
    """Return draws (p, c) in proportion to weights (p, draws), from uniform levels (p, c)."""
    total = np.cumsum(weight, axis=1)
    below = total[:, np.newaxis] <= (level * total[:, -1:])[..., np.newaxis]
    picks: NDArray[np.intp] = np.minimum(np.sum(below, axis=-1), weight.shape[1] - 1)
    return picks


def _low_rate(weights: Sequence[FloatArray], values: Sequence[FloatArray]) -> float:
    """Return the rate of the exponential factor, from the lower half of each distribution."""
    variance = 0.0
    for weight, value in zip(weights, values, strict=True):
        order = np.argsort(value, axis=None)
        rank = np.cumsum(weight.ravel()[order])
        low, middle = value.ravel()[order][
            np.searchsorted(rank, np.array([ndtr(-1.0), 0.5]) * rank[-1])
        ]
        variance += (middle - low) ** 2
    return LOW_SIGMAS / math.sqrt(variance) if variance > 0.0 else 0.0
