"""The looks of a mission: drawn poses of the aircraft, and P_D of each radar at its looks.

The pose errors are a first-order Gauss-Markov process, see `montecarlo.gauss_markov`. The pose at
time i is x̄_i + F_i u_i. The unit normals u_i have the covariance exp(−|t_i − t_j|/τ) I, and F_i is
`Geometry.square_root`, F_i F_iᵀ = C_i. All radars that look at one time see one pose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from radar_sense import axis
from radar_sense.covariance import draws
from radar_sense.errors import InputError
from radar_sense.flight import Path
from radar_sense.mission.schedule import Schedule, schedule_looks
from radar_sense.montecarlo.gauss_markov import correlate
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray, of_each


@dataclass(frozen=True, eq=False)
class Looks:
    """The looks of the m radars of a scenario.

    Attributes:
        scenario: The scenario, with a pose for each of K times.
        schedule: The times of the looks.
        times: The times, 0 to K − 1, of the looks of each radar (m,).
        sqrt_cov: F (6, 6), or (K, 1, 6, 6) with F Fᵀ = C_aa.
    """

    scenario: Scenario
    schedule: Schedule
    times: tuple[NDArray[np.intp], ...]
    sqrt_cov: FloatArray

    @classmethod
    def of(cls, scenario: Scenario) -> Looks:
        """Make the looks along the path of a scenario."""
        flight = scenario.geometry
        if not isinstance(flight, Path):
            raise InputError(
                "a mission needs times, which only a path has: "
                "give a path, geometry: {type: path, file: my_route.csv}, in Python Path.of"
            )
        schedule = schedule_looks(scenario.model, flight.time_s)
        along = axis.time(schedule.time)
        scenario = scenario.along(replace(flight.at(schedule.time), axis=along))
        scenario.check_ranges("the look at ")
        root = scenario.geometry.square_root
        return cls(
            scenario=scenario,
            schedule=schedule,
            times=tuple(schedule.times_of(i) for i in range(len(scenario.model.radars))),
            sqrt_cov=root if root.ndim == 2 else root[:, np.newaxis],
        )

    def poses(self, normals: FloatArray) -> FloatArray:
        """Return aircraft states (K, runs, 6); unit normals (K, 6, runs) are overwritten."""
        correlate(normals, self.schedule.time, self.scenario.correlation_s)
        return draws(
            self.scenario.aircraft[:, np.newaxis], self.sqrt_cov, np.moveaxis(normals, 1, -1)
        )

    def p_d(
        self,
        radar: int,
        poses: FloatArray,
        states: FloatArray,
        times: NDArray[np.intp] | None = None,
    ) -> FloatArray:
        """Return P_D (L, paths * draws) of a radar, 0 to m − 1, at its looks, or at some of them.

        Aircraft states are (K, paths, 6), radar states (paths, draws, 7), times (L,) of 0 to K − 1.
        """
        station = self.scenario.radars[radar]
        of_looks = poses[self.times[radar] if times is None else times, :, np.newaxis]
        visible = station.visible(of_looks, states)
        p_d = np.zeros(visible.shape)
        seen = visible.any(axis=(1, 2))
        if seen.any():  # most looks of a long mission are beyond the limits of a radar
            within = station.model.unchecked_p_d(of_looks[seen], states)
            p_d[seen] = np.where(visible[seen], within, 0.0)
        return p_d.reshape(len(p_d), -1)

    @cached_property
    def nominal_p_d(self) -> list[FloatArray]:
        """P_D (L, 1) of the looks of each radar (m,) with the nominal states."""
        poses = self.scenario.aircraft[:, np.newaxis]
        states = of_each(self.scenario.radar, len(self.scenario.radars))
        return [self.p_d(i, poses, s[np.newaxis, np.newaxis]) for i, s in enumerate(states)]
