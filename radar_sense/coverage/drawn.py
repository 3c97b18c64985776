"""Detection ranges of drawn states: each draw of the errors has one farthest range along a ray.

Errors are the same all along a ray. The range of a draw is the farthest at which its P_D reaches a
value within the limits of the radar. It may be at a limit, in another lobe, or nowhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sense.coverage.places import Places
from radar_sense.coverage.rays import Rays
from radar_sense.model.detectors import required_snr
from radar_sense.model.geometry import slant_range
from radar_sense.propagation.draws import Estimate, estimate_of
from radar_sense.states import FloatArray, slices
from radar_sense.uncertain_states import MAX_NUMBERS, UncertainStates


@dataclass(eq=False)
class DrawnRanges:
    """Slant ranges of drawn states along n rays.

    Attributes:
        around: The rays.
        places: Places along the rays.
        low, high: Uncertain states (n,) on each ray, at about the lower and upper bound of the
            range: errors that lower P_D at the one matter, and those that raise it at the other.
        snr: Signal-to-noise ratio at the range.
        looks: At how many places (n,) a draw was looked at, on average, of the last draws.
    """

    around: Rays
    places: Places
    low: UncertainStates
    high: UncertainStates
    snr: float
    looks: FloatArray

    @classmethod
    def about(
        cls, around: Rays, places: Places, lower: FloatArray, upper: FloatArray, p_d: float
    ) -> DrawnRanges:
        """Return the ranges with a P_D, whose bounds (n,) are about these distances."""
        (radar,) = around.limited.radars
        snr = required_snr(radar.model.detector, radar.model.p_fa, p_d)
        low, high = (around.at(end, limits=True).states() for end in (lower, upper))
        return cls(around, places, low, high, snr, np.zeros(len(lower)))

    def estimate(self, rays: NDArray[np.intp], draws: int, beta: float) -> Estimate:
        """Return what draws say of the range along some rays (j,)."""
        size = MAX_NUMBERS // (2 * draws)
        return Estimate.join(
            [self._of(rays[part], draws, beta) for part in slices(len(rays), size)]
        )

    def _of(self, some: NDArray[np.intp], draws: int, beta: float) -> Estimate:
        around, high = self.around.part(some), self.high.at(some)
        (radar,) = around.limited.radars

        def ranges(rows: slice, aircraft: FloatArray, radars: FloatArray) -> FloatArray:
            nominal = self.places.states(around.part(rows))
            errors = aircraft - high.aircraft[rows, np.newaxis]
            distance, self.looks[some[rows]] = self.places.farthest(
                nominal, radar, self.snr, errors, radars
            )
            return self._slant(slant_range(nominal, self.around.scenario.radar), distance)

        return estimate_of(ranges, self.low.at(some), high, draws, beta)

    def _slant(self, at_places: FloatArray, distance: FloatArray) -> FloatArray:
        """Return slant ranges (j, n) at distances (j, n), from those (j, k) at the places.

        R² is taken to be linear in the square of the distance, as it is on a flat earth.
        """
        reached = np.maximum(distance, self.places.distance[0])
        low, square = self.places.below(reached), self.places.distance**2
        near = np.take_along_axis(at_places, low, axis=1) ** 2
        far = np.take_along_axis(at_places, low + 1, axis=1) ** 2
        part = (reached**2 - square[low]) / np.diff(square)[low]
        return np.where(distance > 0, np.sqrt(near + part * (far - near)), 0.0)
