"""How far P_D, or a quantile of P_D, reaches a value along rays."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from radar_sense.coverage.places import Places
from radar_sense.coverage.rays import FARTHEST, NEAREST, Rays
from radar_sense.states import BLOCK, FloatArray, slices

#: Halvings of a bracket. A bracket of 2 % shrinks to 5e-15 of the distance.
HALVINGS = 42
#: Factors by which a bracket of a bound grows, in this order.
EXPANSIONS = (1.01, 1.02, 1.05, 1.1, 1.2, 1.5, 2.0, 4.0, 16.0, 256.0, 1e4, 1e6)
#: Relative error of the distance that ends a search, and |z| that counts as a root. An error of z
#: by 1e-7 is a relative error of the distance by 1e-8.
NEAR_ENOUGH, Z_TOLERANCE = 1e-10, 1e-7
#: Factor on the distance of a limit. The product is within the limit in spite of rounding.
INSIDE = 1.0 - 1e-9
#: Distance [m] from which on a range is the end of the search, and not a range.
END = INSIDE * FARTHEST
#: |z| of a P_D that is 0 or 1 to rounding.
LARGEST_PROBIT = 40.0
#: Evaluations of P_D that take as long as a ray with its band, which draws judge.
RAY = 15_000


@dataclass(frozen=True, eq=False)
class Reach:
    """How far the rays reach a value of P_D.

    Attributes:
        distance: Farthest distance with at least this P_D (n,) [m]; 0 where there is none.
        free: The same without the limits of the radar.
        limited: Where (n,) a limit of the radar comes first, and P_D is still higher there.
        edges: How often (n,) P_D passes the value along a ray without limits.
    """

    distance: FloatArray
    free: FloatArray
    limited: NDArray[np.bool_]
    edges: NDArray[np.intp]

    @property
    def endless(self) -> NDArray[np.bool_]:
        """Where (n,) P_D is still as high at the end of the search."""
        return self.distance >= END


@dataclass(frozen=True, eq=False)
class Survey:
    """P_D and limits of the nominal states at the places of all rays.

    Attributes:
        all_rays: The rays.
        places: The places (k,).
        p_d: P_D (n, k), without the limits of the radar.
        within: Where (n, k) the aircraft is within the limits of the radar, or too near.
    """

    all_rays: Rays
    places: Places
    p_d: FloatArray
    within: NDArray[np.bool_]

    def reach(self, p_d: float) -> Reach:
        """Return how far the rays reach a P_D."""
        around, enough = self.all_rays, self.p_d >= p_d

        def reaches(distance: FloatArray) -> NDArray[np.bool_]:
            return around.p_d(distance) >= p_d

        def inside(distance: FloatArray) -> NDArray[np.bool_]:
            return reaches(distance) & around.within(distance)

        free = np.sqrt(np.multiply(*self._farthest(enough, reaches)))
        near, far = self._farthest(enough & self.within, inside)
        # what is inside may lie between two places, and ends at the edge of P_D or of a limit
        for edge in (free, self.limit):
            before = INSIDE * edge
            farther = (before > near) & inside(np.maximum(before, NEAREST))
            near = np.where(farther, before, near)
            far = np.where(farther, edge / INSIDE, far)
        far = np.where(around.visible(near), far, 0.0)
        distance = np.sqrt(near * far)
        # P_D at or above the value beyond the edge means that a limit made the edge.
        limited = reaches(np.maximum(far, NEAREST)) & (distance > 0) & (distance < END)
        edges = np.count_nonzero(np.diff(enough, axis=1), axis=1)
        return Reach(distance, free, limited, edges)

    @functools.cached_property
    def limit(self) -> FloatArray:
        """The farthest distance (n,) [m] within the limits; 0 where there is none."""
        near, far = self._farthest(self.within, self.all_rays.within)
        return np.where(self.all_rays.visible(near), np.sqrt(near * far), 0.0)

    def _farthest(
        self, inside: NDArray[np.bool_], reaches: Callable[[FloatArray], NDArray[np.bool_]]
    ) -> tuple[FloatArray, FloatArray]:
        """Return brackets (n,) of the farthest distance that is inside, from 0 where none is.

        The function returns whether distances (n,) are inside, as places (n, k) are.
        """
        last = inside.shape[1] - 1
        low = last - np.argmax(inside[:, ::-1], axis=1)
        near, far = (self.places.distance[np.minimum(at, last)] for at in (low, low + 1))
        for _ in range(HALVINGS):
            middle = np.sqrt(near * far)  # halves the bracket of the logarithm
            still = reaches(middle)
            near, far = np.where(still, middle, near), np.where(still, far, middle)
        return np.where(inside.any(axis=1), near, 0.0), far


def survey(all_rays: Rays) -> Survey:
    """Compute P_D and limits along all rays."""
    places, count = Places.along(all_rays), len(all_rays.yaw)
    shape = count, len(places.distance)
    p_d, within = np.empty(shape), np.empty(shape, dtype=bool)
    for block in slices(count, max(1, BLOCK // len(places.distance))):
        aircraft = places.states(all_rays.part(block))
        p_d[block] = all_rays.scenario.model.p_d(aircraft, all_rays.scenario.radar)
        within[block] = all_rays.outer.visible(aircraft, all_rays.scenario.radar)
    return Survey(all_rays, places, p_d, within)


def reach_of_quantile(
    seen: Survey, value: float, method: str, beta: float, guess: FloatArray
) -> FloatArray:
    """Return how far (n,) the quantile of P_D at Φ(β) by a method reaches a value.

    The distance at which P_D falls below a value is random, because P_D is uncertain. Where P_D
    falls with distance, the random distance exceeds r if P_D at r exceeds the value. The quantiles
    of the distance are therefore the distances at which the quantiles of P_D have the value.

    The distance is within the limits of the radar. It is 0 where the quantile is nowhere as high
    from the guess (n,) [m] inward, and NaN where the method has no value.
    """
    from scipy.optimize.elementwise import find_root  # slow to import

    limit = seen.limit

    def excess(rows: NDArray[np.intp], distance: FloatArray) -> FloatArray:
        """Return z of the quantile less z of the value on some rays."""
        if not len(rows):
            return np.empty(0)
        quantile = np.clip(seen.all_rays.part(rows).quantile(distance, method, beta), 0.0, 1.0)
        z = ndtri(quantile) - ndtri(value)
        return np.clip(z, -LARGEST_PROBIT, LARGEST_PROBIT)

    near = np.clip(guess, NEAREST, np.maximum(limit, NEAREST))
    at_near = excess(np.arange(len(near)), near)
    far, at_far = near.copy(), at_near.copy()
    for factor in EXPANSIONS:
        rows = np.flatnonzero((at_near < 0) & (near > NEAREST))  # the bound is too low here
        far[rows], at_far[rows] = near[rows], at_near[rows]
        near[rows] = np.maximum(near[rows] / factor, NEAREST)
        at_near[rows] = excess(rows, near[rows])
        rows = np.flatnonzero((at_far >= 0) & (far < limit))
        near[rows], at_near[rows] = far[rows], at_far[rows]
        far[rows] = np.minimum(far[rows] * factor, limit[rows])
        at_far[rows] = excess(rows, far[rows])
    reach = np.where(at_near < 0, 0.0, far)  # `far` is the limit if the bound is high enough there
    rows = np.flatnonzero((at_near >= 0) & (at_far < 0))
    root = find_root(
        lambda x, row: excess(row, np.exp(x)),
        (np.log(near[rows]), np.log(far[rows])),
        args=(rows,),
        tolerances={"xatol": NEAR_ENOUGH, "fatol": Z_TOLERANCE},
    )
    reach[rows] = np.exp(root.x)
    reach[np.isnan(at_near) | np.isnan(at_far)] = np.nan
    inside = np.where(reach > 0, reach * INSIDE, NEAREST)
    reach[(limit == 0) | (reach > 0) & ~seen.all_rays.visible(inside)] = 0.0
    return reach
