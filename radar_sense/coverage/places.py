"""Places along rays, and the farthest at which a radar has enough signal within its limits."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from radar_sense.coverage.rays import FARTHEST, NEAREST, Rays
from radar_sense.model.geometry import body_vector, slant_range
from radar_sense.model.radar import Radar
from radar_sense.states import POSITION, FloatArray, components_first

#: Number of places, each 2 % farther than the one before. More divide the way through a lobe in
#: parts of this length, until there are MOST.
NUMBER, PART, MOST = 768, 0.125, 6144
#: Places beyond a limit that are passed at once, 15 % of the distance, and the most steps through
#: all lobes: a table with nodes much closer than its lobes would need more.
GAP, STEPS = 7, 200

#: From draws (l,), and numbers of places (l,), to ln of the signal over what is enough, and to the
#: distance [m] from the nearest limit, negative beyond it (2, l).
Look: TypeAlias = Callable[[NDArray[np.intp], NDArray[np.intp]], FloatArray]


@dataclass(frozen=True, eq=False)
class Places:
    """Places along rays, between which no lobe of RCS or antenna fits.

    Attributes:
        distance: Distances (k,), ascending [m].
        lobes: Number (k,) of lobes from the first place on.
    """

    distance: FloatArray
    lobes: FloatArray

    @classmethod
    def along(cls, around: Rays) -> Places:
        """Return the places along rays."""
        distance = np.geomspace(NEAREST, FARTHEST, NUMBER)
        while np.any(coarse := (passed := lobes_passed(around, distance)) > PART):
            if len(distance) > MOST:
                break
            middle = np.sqrt(distance[1:] * distance[:-1])[coarse]
            distance = np.sort(np.append(distance, middle))
        return cls(distance, np.insert(np.cumsum(passed), 0, 0.0))

    @functools.cached_property
    def step(self) -> float:
        """Lobes that a search passes at once."""
        return max(PART, float(self.lobes[-1]) / STEPS)

    def states(self, around: Rays) -> FloatArray:
        """Return the states (n, k, 6) of the aircraft at the places of all rays."""
        return around.states(np.broadcast_to(self.distance, (len(around.yaw), len(self.distance))))

    def below(self, distance: FloatArray) -> NDArray[np.intp]:
        """Return the last place (...) at or below a distance (...) that has one beyond it."""
        at = np.searchsorted(self.distance, distance, side="right") - 1
        return np.clip(at, 0, len(self.distance) - 2)

    def farthest(
        self,
        nominal: FloatArray,
        radar: Radar,
        snr: float,
        errors: FloatArray,
        states: FloatArray,
    ) -> FloatArray:
        """Return the farthest distances (j, n) with enough signal, within the limits; 0 for none.

        Args:
            nominal: States (j, k, 6) of the aircraft at the places of j rays.
            radar: The radar.
            snr: The signal-to-noise ratio that is enough.
            errors: Errors (j, n, 6) of the aircraft, the same all along a ray.
            states: States (j, n, 7) of the radar.
        """
        shape, places = errors.shape[:2], components_first(nominal)
        ray = np.repeat(np.arange(shape[0]), shape[1])
        of_aircraft, of_radar = (x.reshape(len(ray), -1).T for x in (errors, states))
        beyond = replace(radar, min_range=0.0)

        def look(draw: NDArray[np.intp], at: NDArray[np.intp]) -> FloatArray:
            both = (places[:, ray[draw], at] + of_aircraft[:, draw]).T, of_radar[:, draw].T
            with np.errstate(divide="ignore"):
                excess = np.log(radar.model.unchecked_snr(*both)) - math.log(snr)
            return np.stack([excess, beyond.margin(*both)])

        edge = self._search(look, len(ray))
        low = self.below(edge)
        part = (edge - self.distance[low]) / np.diff(self.distance)[low]
        place = places[:, ray, low] + part * (places[:, ray, low + 1] - places[:, ray, low])
        near = slant_range((place + of_aircraft).T, of_radar.T) < radar.min_range
        return np.where(near, 0.0, edge).reshape(shape)

    def _search(self, look: Look, draws: int) -> FloatArray:
        """Return the farthest distances (l,) of draws that are inside: signal enough, in limits.

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
            between = self.below(self._edge(*ends, at_low[:, left], at_high[:, left]))
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

        Beyond a limit all is beyond it within the margin, and S that is too low is so up to where
        R⁻⁴ makes up for it. No more than a step through a lobe, or `GAP` places, is passed at once.
        """
        distance = self.distance[at]
        lobe = np.searchsorted(self.lobes, self.lobes[at] - self.step)
        limit = np.searchsorted(self.distance, distance + margin)
        strong = self.below(distance * np.exp(np.maximum(excess, -100.0) / 4.0))
        hidden = np.minimum(limit, np.maximum(at - GAP, lobe))
        return np.clip(np.where(margin < 0, hidden, np.maximum(strong, lobe)), 0, at - 1)

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


def lobes_passed(around: Rays, distance: FloatArray) -> FloatArray:
    """Return the turn of the line of sight (k − 1,) from each distance (k,) to the next, in lobes.

    It is alike on all rays, because the aircraft has one height on all of them. The RCS has its
    lobes in the frame of the aircraft, and the antenna in that of the radar.
    """
    (radar,), state = around.limited.radars, around.scenario.radar
    aircraft = around.part(slice(0, 1)).states(distance[np.newaxis])[0]
    passed = np.zeros(len(distance) - 1)
    for line, details in (
        (body_vector(aircraft, state), [radar.model.rcs.detail]),
        (aircraft[:, POSITION] - state[POSITION], [f.detail for f in radar.model.factors]),
    ):
        unit = line / np.linalg.norm(line, axis=1, keepdims=True)
        turn = 2.0 * np.arcsin(0.5 * np.linalg.norm(np.diff(unit, axis=0), axis=1))
        passed = np.maximum(passed, turn / min(details, default=math.inf))
    return passed
