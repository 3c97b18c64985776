"""Unit normals of importance sampling: quasi-random, and often in the tails of the events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from radar_sense.states import FloatArray
from radar_sense.streams import random_stream

#: Distance of the centers from the nominal states: the bounds are quantiles at 3 sigma.
DISTANCE = 3.0
#: Centers closer to the nominal states than this distance are left out.
NEAREST = 0.7
#: Largest number of centers, and the distance within which one center serves several events.
MAX_CENTERS, REACH = 8, 1.2
#: The share of a center grows with this power of the spread of its events.
SHARE_POWER = 0.25
#: Standard deviation of the wide component.
WIDE = 1.6
#: Largest number of directions of the pose path, and their least share of the variance.
MAX_DIRECTIONS, MIN_SHARE = 6, 0.01
#: A standard deviation or spread of P below this one has no influence on centers or directions.
NEGLIGIBLE = 1e-4


@dataclass(frozen=True, eq=False)
class Mixture:
    """A mixture of normal densities to draw from in a space of unit normals.

    The first component is the distribution of the unit normals, which bounds all weights (a
    defensive mixture: T. Hesterberg, "Weighted average importance sampling and defensive mixture
    distributions", Technometrics 37(2), 1995). The second component is wide. The others have unit
    covariance about centers in the tails of the events.

    Attributes:
        centers: Centers (c, d).
        shares: Shares of the components (c + 2,). Their sum is 1.
    """

    centers: FloatArray
    shares: FloatArray

    @classmethod
    def of(cls, targets: FloatArray, spread: FloatArray, natural: float, wide: float) -> Mixture:
        """Choose centers for e events.

        Args:
            targets: Likely points of the tails of the events (e, d).
            spread: Approximate distance between the bounds of each event (e,).
            natural: Share of the first component.
            wide: Share of the second component.
        """
        far = (np.linalg.norm(targets, axis=1) > NEAREST) & (spread > NEGLIGIBLE)
        targets, spread = targets[far], spread[far]
        centers: list[FloatArray] = []
        spreads: list[float] = []
        while len(targets) and len(centers) < MAX_CENTERS:
            near = np.linalg.norm(targets[:, np.newaxis] - targets, axis=-1) < REACH
            chosen = near[np.argmax(np.einsum("ce,e->c", near, spread))]
            spreads.append(spread[chosen].sum())
            centers.append(np.einsum("e,ed->d", spread[chosen] / spreads[-1], targets[chosen]))
            targets, spread = targets[~chosen], spread[~chosen]
        if not centers:
            return cls(np.zeros((0, targets.shape[1])), np.array([1.0, 0.0]))
        shares = np.array(spreads) ** SHARE_POWER
        shares *= (1.0 - natural - wide) / shares.sum()
        return cls(np.array(centers), np.array([natural, wide, *shares]))

    def draw(self, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return draws (runs, d) and weights (runs,) from unit normals (runs, 1 + d).

        The first normal of each run chooses the component. The weight is the density of the unit
        normals divided by the density of the mixture.
        """
        chosen = np.searchsorted(ndtri(np.cumsum(self.shares[:-1])), normals[:, 0])
        draws = normals[:, 1:].copy()
        draws[chosen == 1] *= WIDE
        for component, center in enumerate(self.centers, start=2):
            draws[chosen == component] += center
        squares = np.einsum("rd,rd->r", draws, draws)
        natural, wide, *shares = self.shares
        wide_ratio = np.exp(0.5 * (1.0 - WIDE**-2) * squares) / WIDE ** draws.shape[1]
        ratio = natural + wide * wide_ratio
        for share, center in zip(shares, self.centers, strict=True):
            ratio += share * np.exp(np.einsum("rd,d->r", draws, center) - 0.5 * center @ center)
        return draws, 1.0 / ratio


@dataclass(frozen=True, eq=False)
class Directions:
    """Directions in a space of many unit normals, and the mixture to draw from along them.

    Attributes:
        vectors: Orthonormal columns (d, j).
        mixture: The mixture in the space of the j components.
    """

    vectors: FloatArray
    mixture: Mixture

    @classmethod
    def of(cls, slopes: FloatArray, spread: FloatArray, natural: float, wide: float) -> Directions:
        """Choose directions for e events, in the same way to both sides.

        Args:
            slopes: Vectors (e, d) along which P grows; their squares are shares of its variance.
            spread: Approximate distance between the bounds of each event (e,).
            natural: Share of the first component of the mixture.
            wide: Share of the second component.
        """
        known = np.where(spread > NEGLIGIBLE, spread, 0.0)
        # The spread is the weight of an event: rare events have little influence.
        scaled = slopes * np.sqrt(known)[:, np.newaxis]
        # principal directions by way of the small matrix (e, e), as d may be tens of thousands
        squares, mix = np.linalg.eigh(np.einsum("ed,fd->ef", scaled, scaled))
        share = squares[::-1] / max(known.sum(), NEGLIGIBLE)
        share = share[:MAX_DIRECTIONS][share[:MAX_DIRECTIONS] > MIN_SHARE]
        vectors = np.einsum("ej,ed->jd", mix[:, ::-1][:, : len(share)], scaled)
        vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
        if len(vectors):
            largest = np.argmax(abs(vectors), axis=1)  # the sign of an eigenvector is arbitrary
            vectors *= np.sign(vectors[np.arange(len(vectors)), largest])[:, np.newaxis]
        targets = DISTANCE * np.einsum("ed,jd->ej", slopes, vectors)
        both_sides = np.concatenate([targets, -targets])
        return cls(vectors.T, Mixture.of(both_sides, np.tile(spread, 2), natural, wide))

    @property
    def dimensions(self) -> int:
        """Number of unit normals of a run of `draw`."""
        return 1 + len(self.vectors.T)

    def draw(self, normals: FloatArray, along: FloatArray) -> FloatArray:
        """Replace the components along the directions; return weights (runs,).

        Args:
            normals: Unit normals (d, runs), overwritten.
            along: Unit normals (runs, `dimensions`) to draw the components from.
        """
        draws, weight = self.mixture.draw(along)
        components = np.einsum("dj,dr->jr", self.vectors, normals)
        for vector, change in zip(self.vectors.T, draws.T - components, strict=True):
            normals += vector[:, np.newaxis] * change
        return weight


def sobol_normals(runs: int, dimensions: int, together: int, seed: int, *stream: int) -> FloatArray:
    """Return unit normals (runs, dimensions) from a scrambled Sobol' sequence, in a random order.

    The random order is needed: two Sobol' sequences in their own order depend on each other, with
    any scrambling. Blocks of `together` points stay in a row. `runs` and `together` are powers of
    two.
    """
    from scipy.stats import qmc  # slow to import

    generator = random_stream(seed, *stream)
    points = qmc.Sobol(dimensions, bits=30, rng=generator).random(runs)
    blocks = points.reshape(-1, together, dimensions)
    points = blocks[generator.permutation(len(blocks))].reshape(runs, dimensions)
    normals: FloatArray = ndtri(points + 2.0**-31)  # half a bit keeps them finite
    return normals
