"""Detection ranges of drawn states: each draw of the errors has one farthest range along a ray.

Errors are the same all along a ray. The range of a draw is the farthest at which its P_D reaches a
value within the limits of the radar. It may be at a limit, in another lobe, or nowhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radar_sense.coverage.places import Places
from radar_sense.coverage.rays import Rays
from radar_sense.model.detectors import required_snr
from radar_sense.model.geometry import slant_range
from radar_sense.propagation.draws import Estimate, estimate_of
from radar_sense.states import FloatArray, slices
from radar_sense.uncertain_states import MAX_NUMBERS


class DrawnRanges:
    """Slant ranges with a P_D of drawn states, along n rays.

    Args:
        around: The rays.
        places: Places along the rays.
        bounds: Distances (2, n) at about the lower and upper bound of the range: errors that lower
            P_D at the one matter, and those that raise it at the other.
        p_d: P_D at the range.

    Attributes:
        looks: At how many places (n,) a draw was looked at, on average, of the last draws.
    """

    def __init__(self, around: Rays, places: Places, bounds: FloatArray, p_d: float) -> None:
        (radar,) = around.limited.radars
        self._around, self._places, self._radar = around, places, radar
        self._snr = required_snr(radar.model.detector, radar.model.p_fa, p_d)
        self._low, self._high = (around.at(end, limits=True).states() for end in bounds)
        self.looks = np.zeros(bounds.shape[1])

    def estimate(self, rays: NDArray[np.intp], draws: int, beta: float) -> Estimate:
        """Return what draws say of the range along some rays (j,)."""
        size = MAX_NUMBERS // (2 * draws)
        parts = (self._of(rays[part], draws, beta) for part in slices(len(rays), size))
        return Estimate.join(list(parts))

    def _of(self, some: NDArray[np.intp], draws: int, beta: float) -> Estimate:
        around, high = self._around.part(some), self._high.at(some)

        def ranges(rows: slice, aircraft: FloatArray, radars: FloatArray) -> FloatArray:
            nominal = self._places.states(around.part(rows))
            errors = aircraft - high.aircraft[rows, np.newaxis]
            distance, self.looks[some[rows]] = self._places.farthest(
                nominal, self._radar, self._snr, errors, radars
            )
            return self._slant(slant_range(nominal, around.scenario.radar), distance)

        return estimate_of(ranges, self._low.at(some), high, draws, beta)

    def _slant(self, at_places: FloatArray, distance: FloatArray) -> FloatArray:
        """Return slant ranges (j, n) at distances (j, n), from those (j, k) at the places.

        R² is taken to be linear in the square of the distance, as it is on a flat earth.
        """
        reached = np.maximum(distance, self._places.distance[0])
        low, square = self._places.below(reached), self._places.distance**2
        near = np.take_along_axis(at_places, low, axis=1) ** 2
        far = np.take_along_axis(at_places, low + 1, axis=1) ** 2
        part = (reached**2 - square[low]) / np.diff(square)[low]
        return np.where(distance > 0, np.sqrt(near + part * (far - near)), 0.0)
