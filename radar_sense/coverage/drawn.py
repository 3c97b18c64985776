"""Detection ranges of drawn states: each draw of the errors has one farthest range along a ray.

Errors are the same all along a ray. The range of a draw is the farthest at which its P_D reaches a
value within the limits of the radar. It may be at a limit, in another lobe, or nowhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from radar_sense.coverage.rays import FARTHEST, NEAREST, Rays, lobes_passed, with_lobes
from radar_sense.model.detectors import required_snr
from radar_sense.model.geometry import slant_range
from radar_sense.propagation.draws import Estimate, estimate_of
from radar_sense.states import FloatArray, components_first, slices
from radar_sense.uncertain_states import MAX_NUMBERS, UncertainStates

#: Distances at which draws are looked at, of which each is 16 % farther than the one before. More
#: divide the way through a lobe in parts of this length.
DISTANCES, PART = 105, 0.125

#: From draws (l,) and the numbers of their places (l,) to ln of S over the required S, and the
#: distance [m] to the nearest limit, negative beyond it (2, l).
Look: TypeAlias = Callable[[NDArray[np.intp], NDArray[np.intp]], FloatArray]


@dataclass(frozen=True, eq=False)
class DrawnRanges:
    """Slant ranges of drawn states along n rays.

    Attributes:
        around: The rays.
        states: Uncertain states (n,) about which errors are drawn, one on each ray.
        snr: Signal-to-noise ratio at the range.
        distance: Distances (k,) at which draws are looked at, ascending [m].
        lobes: Number (k,) of lobes from the first distance on.
    """

    around: Rays
    states: UncertainStates
    snr: float
    distance: FloatArray
    lobes: FloatArray

    @classmethod
    def about(cls, around: Rays, centre: FloatArray, p_d: float) -> DrawnRanges:
        """Return the ranges with a P_D, for errors that matter at distances (n,) along the rays."""
        (radar,) = around.limited.radars
        snr = required_snr(radar.model.detector, radar.model.p_fa, p_d)
        distance = with_lobes(around, np.geomspace(NEAREST, FARTHEST, DISTANCES), PART)
        lobes = np.insert(np.cumsum(lobes_passed(around, distance)), 0, 0.0)
        return cls(around, around.at(centre, limits=True).states(), snr, distance, lobes)

    def estimate(self, rays: NDArray[np.intp], draws: int, beta: float) -> Estimate:
        """Return what draws say of the range along some rays (j,)."""
        size = max(1, MAX_NUMBERS // (2 * draws))
        return Estimate.join(
            [self._of(rays[part], draws, beta) for part in slices(len(rays), size)]
        )

    def _of(self, rays: NDArray[np.intp], draws: int, beta: float) -> Estimate:
        around, states = self.around.part(rays), self.states.at(rays)

        def ranges(rows: slice, aircraft: FloatArray, radar: FloatArray) -> FloatArray:
            errors = aircraft - states.aircraft[rows, np.newaxis]
            return self._farthest(around.part(rows), errors, radar)

        return estimate_of(ranges, states, draws, beta)

    def _farthest(self, around: Rays, errors: FloatArray, radar: FloatArray) -> FloatArray:
        """Return the ranges (j, n) along j rays, 0 where there is none.

        Args:
            around: The rays.
            errors: Errors (j, n, 6) of the aircraft.
            radar: States (j, n, 7) of the radar.
        """
        (single,), (j, n) = around.limited.radars, errors.shape[:2]
        beyond = replace(single, min_range=0.0)
        nominal = around.states(np.broadcast_to(self.distance, (j, len(self.distance))))
        places, ray = components_first(nominal), np.repeat(np.arange(j), n)
        of_aircraft, of_radar = (array.reshape(j * n, -1).T for array in (errors, radar))

        def look(draw: NDArray[np.intp], at: NDArray[np.intp]) -> FloatArray:
            states = (places[:, ray[draw], at] + of_aircraft[:, draw]).T, of_radar[:, draw].T
            with np.errstate(divide="ignore"):
                excess = np.log(single.model.unchecked_snr(*states) / self.snr)
            return np.stack([excess, beyond.margin(*states)])

        edge = self._search(look, j * n)
        low = np.searchsorted(self.distance, edge, side="right") - 1
        low = np.clip(low, 0, len(self.distance) - 2)
        part = (edge - self.distance[low]) / np.diff(self.distance)[low]
        place = places[:, ray, low] + part * (places[:, ray, low + 1] - places[:, ray, low])
        seen = slant_range((place + of_aircraft).T, of_radar.T) >= single.min_range
        # R² is linear in the square of the distance along a ray
        square, slant = self.distance**2, slant_range(nominal, around.scenario.radar) ** 2
        slope = np.diff(slant, axis=1) / np.diff(square)
        ranges = np.sqrt(slant[ray, low] + slope[ray, low] * (edge**2 - square[low]))
        return np.where(seen & (edge > 0), ranges, 0.0).reshape(j, n)

    def _search(self, look: Look, draws: int) -> FloatArray:
        """Return the farthest distance (l,) at which draws are inside: S is enough, within limits.

        The search goes inward from the farthest place, and passes no limit and no lobe, until a
        place is inside. Then it looks between this and the nearest that is known not to be.
        """
        last = len(self.distance) - 1
        low, high = np.full(draws, -1), np.full(draws, last + 1)
        at_low, at_high = np.zeros((2, 2, draws))
        at, left, rounds = np.full(draws, last), np.arange(draws), 0
        while left.size:
            found, here = look(left, at[left]), at[left]
            inside = np.all(found >= 0, axis=0)
            for which, end, values in ((inside, low, at_low), (~inside, high, at_high)):
                end[left[which]], values[:, left[which]] = here[which], found[:, which]
            left = left[high[left] - low[left] > 1]
            ends = low[left], high[left]
            edge = self._edge(*ends, at_low[:, left], at_high[:, left])
            between = np.searchsorted(self.distance, edge, side="right") - 1
            if rounds % 3 == 2:  # where ln S is far from linear
                between = (ends[0] + ends[1]) // 2
            between = np.clip(between, ends[0] + 1, ends[1] - 1)
            at[left] = np.where(ends[0] < 0, self._inward(ends[1], *at_high[:, left]), between)
            rounds += 1
        return self._edge(low, high, at_low, at_high)

    def _inward(
        self, at: NDArray[np.intp], excess: FloatArray, margin: FloatArray
    ) -> NDArray[np.intp]:
        """Return the next place (l,) to look at, nearer than places (l,) that are not inside.

        Beyond a limit all is beyond it within the margin. Where S is too low, it is so up to where
        R⁻⁴ makes up for it, unless the next part of a lobe comes first.
        """
        distance = self.distance[at]
        limit = np.searchsorted(self.distance, distance + margin)
        enough = distance * np.exp(np.maximum(excess, -100.0) / 4.0)
        strong = np.searchsorted(self.distance, enough, side="right") - 1
        lobe = np.searchsorted(self.lobes, self.lobes[at] - PART)
        return np.clip(np.where(margin < 0, limit, np.maximum(strong, lobe)), 0, at - 1)

    def _edge(
        self,
        low: NDArray[np.intp],
        high: NDArray[np.intp],
        at_low: FloatArray,
        at_high: FloatArray,
    ) -> FloatArray:
        """Return the edge (l,) [m] between places inside (l,), −1 for none, and places outside.

        ln S is taken to be linear in the logarithm of the distance, and a margin in the distance.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            part = np.where(at_high < 0, at_low / (at_low - at_high), 1.0)
        near = self.distance[np.maximum(low, 0)]
        far = self.distance[np.minimum(high, len(self.distance) - 1)]
        edge = np.minimum(near * (far / near) ** part[0], near + part[1] * (far - near))
        return np.asarray(np.where(low < 0, 0.0, edge))
