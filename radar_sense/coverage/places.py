"""Places along rays, and the farthest at which a radar has enough signal within its limits."""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from radar_sense.covariance import largest_variance
from radar_sense.coverage.rays import FARTHEST, NEAREST, Rays
from radar_sense.model.geometry import body_vector, elevation_of, slant_range
from radar_sense.model.radar import Radar
from radar_sense.states import POSITION, FloatArray, components_first

#: Number of places, each 2 % farther than the one before. More divide the way through a lobe in
#: parts of this length, until there are MOST, or they are CLOSE, as a part of the distance.
NUMBER, PART, MOST, CLOSE = 768, 0.125, 6144, 1e-4
#: Most steps through all lobes of the RCS: a table with nodes much closer than its lobes would need
#: more.
STEPS = 200
#: Standard deviations of the positions up to which lobes are counted.
WIDE = 3.0
#: Part of the turn to the edge of a mask that a search passes at once. The rest is for errors
#: beyond `WIDE`, with which the line of sight turns more than it is counted to.
HIDDEN = 0.5

#: From draws (l,), and numbers of places (l,), to (5, l): ln of the signal over what is enough, how
#: far within maximum range and horizon it is [m], how far above the mask [rad], by how much ln of
#: the factors of the signal may rise at most, up to where R⁻⁴ alone makes up for too low a signal,
#: and the part of a lobe of the RCS by which the line of sight may turn: its azimuth then turns by
#: no more than the lobe.
Look: TypeAlias = Callable[[NDArray[np.intp], NDArray[np.intp]], FloatArray]


@dataclass(frozen=True, eq=False)
class Places:
    """Places along rays, between which no lobe of RCS or antenna fits.

    Attributes:
        distance: Distances (k,), ascending [m].
        lobes: Number (2, k) of lobes of the RCS, and of the antenna, from the first place on.
        turn: Turn (k,) of the line of sight from the first place on [rad].
        way: Length (k,) of the way of the aircraft from the first place on [m]. With an origin it
            is longer than the distance, because the aircraft follows the round earth.
        slant: Slant range (k,) [m].
    """

    distance: FloatArray
    lobes: FloatArray
    turn: FloatArray
    way: FloatArray
    slant: FloatArray

    @classmethod
    def along(cls, around: Rays) -> Places:
        """Return the places along rays."""
        distance = np.geomspace(NEAREST, FARTHEST, NUMBER)
        while True:
            passed, turn = turned(around, distance)
            coarse = np.max(passed, axis=0) > PART
            coarse &= np.diff(distance) > CLOSE * distance[1:]  # the heading turns over a pole
            if len(distance) >= MOST or not coarse.any():
                (states,) = around.part(slice(0, 1)).states(distance[np.newaxis])
                steps = np.linalg.norm(np.diff(states[:, POSITION], axis=0), axis=1)
                sums = (np.cumsum(x, axis=-1) for x in (passed, turn, steps))
                lobes, turn, way = (np.insert(x, 0, 0.0, axis=-1) for x in sums)
                return cls(distance, lobes, turn, way, slant_range(states, around.scenario.radar))
            middle = np.sqrt(distance[1:] * distance[:-1])[coarse]
            distance = np.sort(np.append(distance, middle))

    @functools.cached_property
    def step(self) -> float:
        """Lobes of the RCS that a search passes at once."""
        return max(PART, float(self.lobes[0, -1]) / STEPS)

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
    ) -> tuple[FloatArray, FloatArray]:
        """Return the farthest distances (j, n) with enough signal, within the limits; 0 for none.

        Also returned is at how many places (j,) a draw is looked at, on average.

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
        falling = replace(radar, min_range=0.0, mask=None)  # limits that hide all beyond them
        rcs = radar.model.rcs

        def look(draw: NDArray[np.intp], at: NDArray[np.intp]) -> FloatArray:
            aircraft, own = (places[:, ray[draw], at] + of_aircraft[:, draw]).T, of_radar[:, draw].T
            signal = np.maximum(radar.model.unchecked_snr(aircraft, own), sys.float_info.min)
            excess = np.log(signal) - math.log(snr)
            margin, clearance = np.full((2, len(draw)), np.inf)
            lobe = np.ones(len(draw))
            if falling.limited:
                margin = falling.margin(aircraft, own)
            if radar.mask is not None:
                clearance = radar.mask.clearance(aircraft, own)
            by_range = np.exp(np.minimum(excess, 0.0) / 4.0)
            rise = radar.model.unchecked_rise(aircraft, own, by_range)
            if not rcs.isotropic:  # the nearer to its pole, the faster its azimuth turns
                lobe = np.cos(elevation_of(body_vector(aircraft, own)))
                lobe /= 1.0 + self.step * rcs.detail
            return np.stack([excess, margin, clearance, rise, lobe])

        apart = of_aircraft[POSITION] - of_radar[POSITION]
        apart += np.asarray(radar.state)[POSITION, np.newaxis]
        steepness = 1.0 if radar.mask is None else radar.mask.steepness
        edge, looks = self._search(look, 2.0 * np.linalg.norm(apart, axis=0), steepness)
        low = self.below(edge)
        part = (edge - self.distance[low]) / np.diff(self.distance)[low]
        place = places[:, ray, low] + part * (places[:, ray, low + 1] - places[:, ray, low])
        near = slant_range((place + of_aircraft).T, of_radar.T) < radar.min_range
        return np.where(near, 0.0, edge).reshape(shape), looks.reshape(shape).mean(axis=1)

    @np.errstate(divide="ignore", invalid="ignore")  # of draws that have no place inside
    def _search(
        self, look: Look, displaced: FloatArray, steepness: float
    ) -> tuple[FloatArray, NDArray[np.intp]]:
        """Return the farthest distances (l,) of draws that are inside: signal enough, in limits.

        The search goes inward from the farthest place, and passes no lobe, until a place is inside
        but for the mask. Then it looks between this and the nearest that is known not to be. Where
        the mask hides the place that it finds, it goes on inward. Also returned is how often it
        looks (l,). `_inward` explains `displaced` and `steepness`.
        """
        draws, last = len(displaced), len(self.distance) - 1
        low, high = np.full(draws, -1), np.full(draws, last + 1)
        at_low, at_high = np.full((2, 5, draws), np.inf)
        at, left, rounds = np.full(draws, last), np.arange(draws), 0
        looks, veiled = np.zeros(draws, dtype=np.intp), np.zeros(draws, dtype=bool)
        while left.size:
            found, here = look(left, at[left]), at[left]
            looks[left] += 1
            inside = np.all(found[:2] >= 0, axis=0)
            beside = high[left] - here == 1
            inside[beside] |= _appears(found[:, beside], at_high[:, left[beside]])
            inside &= ~veiled[left]
            for which, end, values in ((inside, low, at_low), (~inside, high, at_high)):
                end[left[which]], values[:, left[which]] = here[which], found[:, which]
            hidden = left[(high[left] - low[left] == 1) & (low[left] >= 0)]
            hidden = hidden[_hidden(at_low[:, hidden], at_high[:, hidden])]
            high[hidden], at_high[:, hidden] = low[hidden], at_low[:, hidden]
            low[hidden] = -1
            left = left[high[left] - low[left] > 1]
            searching = low[left] < 0
            further, between = left[searching], left[~searching]
            at[further], veiled[further] = self._inward(
                high[further], at_high[:, further], displaced[further], steepness
            )
            ends = low[between], high[between]
            if rounds % 3 == 2:  # where ln S is far from linear
                edge = sum(ends) // 2
            else:
                edge = self.below(self._edge(*ends, at_low[:, between], at_high[:, between]))
            at[between] = np.clip(edge, ends[0] + 1, ends[1] - 1)
            rounds += 1
        return self._edge(low, high, at_low, at_high), looks

    def _inward(
        self, at: NDArray[np.intp], values: FloatArray, displaced: FloatArray, steepness: float
    ) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """Return the next place (l,) to look at, nearer than places (l,) that are not inside.

        A place beyond a limit stays beyond it on a way of the margin. Where S is too low, it may be
        enough further in by R⁻⁴ and the largest rise of the factors. The slant range falls by no
        more than the way. The next place is no nearer than that, and no lobe is passed on the way.
        Lobes of the antenna are passed where S is surely too low in them, whatever the errors of
        the place. A place that a mask hides stays hidden until the line of sight has turned far
        enough. Also returned is where (l,) the mask hides the next place and all places on the way
        to it.

        Args:
            at: Numbers of the places.
            values: What `Look` returns there (5, l).
            displaced: Distance (l,) [m] up to which errors may turn R⁻⁴ and elevation around.
            steepness: That of the mask.
        """
        excess, margin, clearance, rise, lobe = values
        way, slant = self.way[at], self.slant[at]
        limit = np.searchsorted(self.way, way + np.minimum(margin, 0.0))
        fall = 1.0 - np.exp(np.clip(excess + rise, -100.0, 0.0) / 4.0)
        strong, surely = (
            np.searchsorted(self.way, way - fall * r, side="right") - 1
            for r in (slant, np.maximum(slant - displaced, 0.0))
        )
        of_rcs, of_antenna = (
            np.searchsorted(lobes, lobes[at] - step)
            for lobes, step in zip(self.lobes, (self.step * lobe, PART), strict=True)
        )
        weak = np.maximum(np.maximum(strong, of_rcs), np.minimum(of_antenna, surely))
        inward = np.clip(np.where(margin < 0, limit, weak), 0, at - 1)
        turn = HIDDEN * np.minimum(clearance, 0.0) / steepness
        veil = np.where(clearance < 0, np.searchsorted(self.turn, self.turn[at] + turn), at)
        return np.minimum(inward, veil), veil <= inward

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
        part = _part(at_low, at_high)
        near = self.distance[np.maximum(low, 0)]
        far = self.distance[np.minimum(high, len(self.distance) - 1)]
        limit = near + np.min(part[1:3], axis=0) * (far - near)
        return np.where(low < 0, 0.0, np.minimum(near * (far / near) ** part[0], limit))


def _part(at_low: FloatArray, at_high: FloatArray) -> FloatArray:
    """Return the part (3, l) of the way from low to high after which a value is negative."""
    return np.where(at_high < 0, at_low / (at_low - at_high), 1.0)


def _appears(at_low: FloatArray, at_high: FloatArray) -> NDArray[np.bool_]:
    """Return where (l,) a signal that rises outward is enough just before maximum range or horizon.

    The low places are within the limits, and the signal is too low there. The high places are
    beyond, and the signal is enough.
    """
    appears = 1.0 - _part(at_high, at_low)[0]
    apart = (at_low[0] < 0) & (at_high[0] >= 0) & (at_low[1] >= 0) & (at_high[1] < 0)
    return apart & (appears < _part(at_low, at_high)[1])


def _hidden(at_low: FloatArray, at_high: FloatArray) -> NDArray[np.bool_]:
    """Return where (l,) the mask hides a place and all up to the edge of the signal beyond it."""
    appears = 1.0 - _part(at_high, at_low)[2]
    window = (at_high[2] >= 0) & (appears < np.min(_part(at_low, at_high)[:2], axis=0))
    return (at_low[2] < 0) & ~window


def turned(around: Rays, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the turn of the line of sight from each distance (k,) to the next: in lobes, in rad.

    The lobes (2, k − 1) are those of the RCS and those of the antenna. The RCS turns with the
    aircraft, and the antenna with the radar. The turn (k − 1,) in radians is that of the antenna.
    All rays have the same turns, because the aircraft has one height on all of them. Errors
    displace the aircraft, and its line of sight then turns more or less. Of the nominal aircraft
    and six that are `WIDE` standard deviations away, the largest turn counts.
    """
    (radar,), state, first = around.limited.radars, around.scenario.radar, around.part(slice(0, 1))
    errors = first.at(distance[-1:]).states()
    covariances = (c[:1, POSITION, POSITION] for c in (errors.cov_aircraft, errors.cov_radar))
    error = WIDE * math.sqrt(sum(float(largest_variance(c)[0]) for c in covariances))
    aircraft = np.repeat(first.states(distance[np.newaxis]), 7, axis=0)
    aircraft[1:, :, POSITION] += error * np.vstack([np.eye(3), -np.eye(3)])[:, np.newaxis]
    turns = []
    for line in (body_vector(aircraft, state), aircraft[..., POSITION] - state[POSITION]):
        unit = line / np.linalg.norm(line, axis=-1, keepdims=True)
        turn = 2.0 * np.arcsin(0.5 * np.linalg.norm(np.diff(unit, axis=1), axis=-1))
        turns.append(np.max(turn, axis=0))
    of_antenna = min((f.detail for f in radar.model.factors), default=math.inf)
    return np.stack([turns[0] / radar.model.rcs.detail, turns[1] / of_antenna]), turns[1]
