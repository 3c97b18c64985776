"""Random combinations of the draws of independent radars or scan groups."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from radar_sense.states import FloatArray

#: Share of the combinations that is drawn without an emphasis on any source.
NATURAL = 0.2


def combine(
    generator: np.random.Generator,
    weights: Sequence[FloatArray],
    emphasis: FloatArray,
    combinations: int,
) -> tuple[list[NDArray[np.intp]], FloatArray]:
    """Combine the draws of independent sources at random, for each pose path.

    A combination has an emphasis on one source, or on none. A source without emphasis is drawn in
    proportion to its weights, which is its own distribution. The source with emphasis is drawn
    uniformly, which is the distribution of its draws. The weight of a combination is the ratio of
    the densities for the mixture of all emphases (the balance heuristic: E. Veach and L. J. Guibas,
    "Optimally combining sampling techniques for Monte Carlo rendering", SIGGRAPH 1995).

    Args:
        generator: Makes the random choices.
        weights: Weights (p, draws) of each source.
        emphasis: Relative frequency of the emphasis on each source, not normalized (sources,).
        combinations: Combinations for each pose path.

    Returns:
        For each source the draws taken (p, combinations), and weights (p, combinations).
    """
    paths = len(weights[0])
    shape = (paths, combinations)
    alpha = (1.0 - NATURAL) * emphasis / emphasis.sum()
    focus = np.searchsorted(np.cumsum(alpha), generator.random(shape), side="right")
    picks, mass, mixture = [], np.ones((paths, 1)), np.full(shape, NATURAL)
    for source, weight in enumerate(weights):
        draws = weight.shape[1]
        total = np.cumsum(weight, axis=1)
        level = generator.random(shape) * total[:, -1:]
        natural = np.sum(total[:, np.newaxis] <= level[..., np.newaxis], axis=-1)
        uniform = generator.permuted(
            np.broadcast_to(np.arange(combinations) % draws, shape), axis=1
        )
        pick = np.where(focus == source, uniform, np.minimum(natural, draws - 1))
        mean = total[:, -1:] / draws
        mass = mass * mean
        mixture += alpha[source] * mean / np.take_along_axis(weight, pick, axis=1)
        picks.append(pick)
    return picks, mass / mixture
