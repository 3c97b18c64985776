"""Unit normals of importance sampling: quasi-random, and widened along some directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from radar_sense.montecarlo.sequences import random_stream
from radar_sense.states import FloatArray

#: A direction with a share of the variance is widened to 1 + WIDENING · share^WIDENING_POWER.
WIDENING, WIDENING_POWER = 1.2, 0.35
#: Largest number of widened directions, of a radar or of the pose path, and their least share of
#: the variance.
MAX_DIRECTIONS, MIN_SHARE = 6, 0.01
#: A standard deviation of P below this one has no influence on the choice of directions.
NEGLIGIBLE = 1e-4

#: Branches of a seed's random streams, one for each kind of draw.
PILOT_STREAM, PATHS_STREAM, POSES_STREAM, RADARS_STREAM = 101, 102, 103, 104


@dataclass(frozen=True, eq=False)
class Directions:
    """Directions in a space of unit normals along which the draws are widened.

    Attributes:
        vectors: Orthonormal columns (d, j).
        widths: Standard deviation along each direction (j,).
    """

    vectors: FloatArray
    widths: FloatArray

    @classmethod
    def of(cls, slopes: FloatArray, spread: FloatArray) -> Directions:
        """Choose directions for e events.

        Args:
            slopes: Vectors (e, d) along which P changes; their squares are shares of its variance.
            spread: Approximate distance between the bounds of each event (e,).
        """
        # The spread is the weight of an event: rare events have little influence.
        scaled = slopes * np.sqrt(np.where(spread > NEGLIGIBLE, spread, 0.0))[:, np.newaxis]
        if not scaled.any():
            return cls(np.zeros((slopes.shape[1], 0)), np.zeros(0))
        # principal directions by way of the small matrix (e, e), as d may be tens of thousands
        squares, mix = np.linalg.eigh(np.einsum("ed,fd->ef", scaled, scaled))
        share = np.minimum(squares[::-1] / np.sum(spread[spread > NEGLIGIBLE]), 1.0)
        share = share[:MAX_DIRECTIONS][share[:MAX_DIRECTIONS] > MIN_SHARE]
        vectors = np.einsum("ej,ed->jd", mix[:, ::-1][:, : len(share)], scaled)
        vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
        largest = np.argmax(abs(vectors), axis=1)  # the sign of an eigenvector is arbitrary
        vectors *= np.sign(vectors[np.arange(len(vectors)), largest])[:, np.newaxis]
        return cls(vectors.T, 1.0 + WIDENING * share**WIDENING_POWER)

    def widen(self, normals: FloatArray, along: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Replace the components along the directions; return normals and weights (runs,).

        Args:
            normals: Unit normals (d, runs), overwritten.
            along: Unit normals (j, runs) to widen, one for each direction.
        """
        components = np.einsum("dj,dr->jr", self.vectors, normals)
        widths = self.widths[:, np.newaxis]
        for vector, change in zip(self.vectors.T, widths * along - components, strict=True):
            normals += vector[:, np.newaxis] * change
        log_weight = np.log(widths) - 0.5 * (widths * widths - 1.0) * along * along
        return normals, np.exp(log_weight.sum(axis=0))


def sobol_normals(runs: int, dimensions: int, together: int, seed: int, *stream: int) -> FloatArray:
    """Return unit normals (runs, dimensions) from a scrambled Sobol' sequence, in a random order.

    The random order is needed: two Sobol' sequences in their own order depend on each other, with
    any scrambling. Blocks of `together` points stay in a row. `runs` and `together` are powers of
    two.
    """
    if not dimensions:
        return np.zeros((runs, 0))
    from scipy.stats import qmc  # slow to import

    generator = random_stream(seed, *stream)
    points = qmc.Sobol(dimensions, bits=30, rng=generator).random(runs)
    blocks = points.reshape(-1, together, dimensions)
    points = blocks[generator.permutation(len(blocks))].reshape(runs, dimensions)
    normals: FloatArray = ndtri(points + 2.0**-31)  # half a bit keeps them finite
    return normals
