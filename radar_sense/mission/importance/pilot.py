"""The pilot of importance sampling: a few wide draws that show where P has its tails."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from radar_sense.mission.importance.events import MissionEvents, draw_radars
from radar_sense.mission.importance.mixtures import sobol_normals
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.states import FloatArray
from radar_sense.streams import Stream

#: Draws of a pilot, their width, and the probability of the tails that directions point to.
PILOT_DRAWS, PILOT_WIDTH, PILOT_TAIL = 1024, 1.8, float(ndtr(-2.5))


@dataclass(frozen=True, eq=False)
class Pilot:
    """Draws of one radar, or of all correlated radars, with the nominal pose path.

    Attributes:
        normals: Unit normals (draws, d).
        log_miss: −ln(1 − P) (draws, K) of each event.
    """

    normals: FloatArray
    log_miss: tuple[FloatArray, ...]

    @classmethod
    def draw(
        cls, events: MissionEvents, radars: tuple[int, ...], sampler: Sampler, number: int
    ) -> Pilot:
        """Draw widened states of some radars, and compute the events."""
        normals = PILOT_WIDTH * sobol_normals(
            PILOT_DRAWS,
            sampler.radar_normals,
            1,
            events.scenario.seed,
            Stream.MISSION_PILOT,
            number,
        )
        states = draw_radars(sampler, normals)[np.newaxis]
        poses = events.scenario.aircraft[:, np.newaxis]
        by_radar = [
            events.of_radar(radar, events.hazard(radar, poses, states[:, :, place])[0])
            for place, radar in enumerate(radars)
        ]
        log_miss = tuple(np.sum(parts, axis=0) for parts in zip(*by_radar, strict=True))
        return cls(normals, log_miss)

    def statistics(self, times: NDArray[np.intp]) -> PilotStatistics:
        """Return statistics of the events at some times."""
        p = -np.expm1(-np.concatenate([event[:, times] for event in self.log_miss], axis=1))
        squares = np.sum(self.normals * self.normals, axis=1)
        weight = np.exp(-0.5 * squares * (1.0 - PILOT_WIDTH**-2))
        limit = PILOT_TAIL * weight.sum()
        tails = []
        for sign in (-1.0, 1.0):
            order = np.argsort(sign * p, axis=0, kind="stable")
            ordered = weight[order]
            ordered[np.cumsum(ordered, axis=0) - ordered > limit] = 0.0
            tails.append(np.einsum("re,red->ed", ordered, self.normals[order]))
        directions = np.array(tails)
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return PilotStatistics(
            directions=directions,
            spread=np.ptp(p, axis=0),
            variance=p.var(axis=0) / PILOT_WIDTH**2,
            miss=1.0 - p.mean(axis=0),
        )


class PilotStatistics(NamedTuple):
    """Statistics of a pilot for e events.

    Attributes:
        directions: Unit vectors (2, e, d) from the nominal states to the tails of P.
        spread: Greatest P minus least P (e,).
        variance: Variance of P (e,), scaled to normals of width 1.
        miss: Mean of 1 − P (e,).
    """

    directions: FloatArray
    spread: FloatArray
    variance: FloatArray
    miss: FloatArray
