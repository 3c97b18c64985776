"""The events of a mission, detection and a track, for drawn states of aircraft and radars."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sense.mission.schedule import Schedule
from radar_sense.mission.tracks import m_of_n
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.scenario import Scenario, single_radar_scenarios
from radar_sense.states import FloatArray


@dataclass(frozen=True, eq=False)
class MissionEvents:
    """The events of a mission at the times that bounds are computed at.

    Attributes:
        scenario: The scenario, with a pose for each time.
        schedule: The looks.
        m_of_n: m and n of a track; None for detection alone.
        radars: The single-radar scenario of each radar.
        looks: The times, 0 to K − 1, at which each radar looks.
        nodes: The times, 0 to K − 1, that bounds are computed at (J,); all of them at first.
    """

    scenario: Scenario
    schedule: Schedule
    m_of_n: tuple[int, int] | None
    radars: tuple[Scenario, ...]
    looks: tuple[NDArray[np.intp], ...]
    nodes: NDArray[np.intp]

    @classmethod
    def of(
        cls, scenario: Scenario, schedule: Schedule, m_of_n: tuple[int, int] | None
    ) -> MissionEvents:
        """Split the scenario into single radars."""
        radars = tuple(single_radar_scenarios(scenario).values()) or (scenario,)
        groups = [schedule.group_of(i) for i in range(len(radars))]
        looks = tuple(np.flatnonzero(schedule.looks[:, group]) for group in groups)
        return cls(scenario, schedule, m_of_n, radars, looks, np.arange(len(schedule.time)))

    def hazard(self, radar: int, poses: FloatArray, states: FloatArray) -> FloatArray:
        """Return the hazard −ln(1 − P_D) of a radar's looks (p, draws, looks).

        Args:
            radar: The radar.
            poses: Aircraft states (K, p, 6).
            states: Radar states (p, draws, 4 to 6).
        """
        model, looks = self.radars[radar].model, self.looks[radar]
        aircraft = np.moveaxis(poses[looks], 0, 1)[:, np.newaxis]
        radars = states[:, :, np.newaxis]
        hazard = np.zeros((*states.shape[:2], len(looks)))
        visible = np.flatnonzero(model.visible(aircraft, radars).any(axis=(0, 1, 3)))
        if len(visible):  # most looks of a long mission are beyond the range of a radar
            with np.errstate(divide="ignore"):  # P_D may round to 1
                hazard[..., visible] = -np.log1p(-model.p_d(aircraft[:, :, visible], radars))
        return hazard

    def detection(self, radar: int, hazard: FloatArray) -> FloatArray:
        """Return −ln(1 − P_c) (..., J) from the hazard (..., looks) of a radar."""
        return self._at_nodes(radar, np.cumsum(hazard, axis=-1))

    def track(self, radar: int, hazard: FloatArray) -> FloatArray:
        """Return −ln(1 − T) (..., J) from the hazard (..., looks) of a radar or scan group."""
        assert self.m_of_n is not None
        p, miss = m_of_n(-np.expm1(-hazard), np.exp(-hazard), *self.m_of_n)
        p, miss = self._at_nodes(radar, p), self._at_nodes(radar, miss, start=1.0)
        with np.errstate(divide="ignore"):
            return np.where(p < 0.5, -np.log1p(-np.minimum(p, 0.5)), -np.log(miss))

    def of_radar(self, radar: int, hazard: FloatArray) -> tuple[FloatArray, ...]:
        """Return −ln(1 − P) (..., J) of detection, and of a track if m and n are given."""
        detection = self.detection(radar, hazard)
        return (detection,) if self.m_of_n is None else (detection, self.track(radar, hazard))

    def _at_nodes(self, radar: int, values: FloatArray, start: float = 0.0) -> FloatArray:
        """Return values (..., looks) after each look of a radar at the nodes (..., J)."""
        latest = np.searchsorted(self.looks[radar], self.nodes, side="right") - 1
        return np.where(latest >= 0, values[..., np.maximum(latest, 0)], start)


def draw_radars(sampler: Sampler, normals: FloatArray) -> FloatArray:
    """Return the states (runs, radars, 4 to 6) of a sampler's radars from normals (runs, d)."""
    return np.stack(sampler.model.split(sampler.draw_radar(normals)[0]), axis=-2)
