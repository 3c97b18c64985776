"""Random states of aircraft and radars, and P_D at these states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sense.covariance import block_square_root, checked, component_first, draws, square_root
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.network import NetworkModel, as_network
from radar_sense.model.radar_constant import Tolerance, draw
from radar_sense.scenario import Scenario
from radar_sense.states import CONSTANT, CONSTANTS, RADAR, FloatArray, check_finite

#: All poses of a scenario.
ALL_POSES = slice(None)


def normals(components: int, parts: Sequence[Sequence[Tolerance]]) -> int:
    """Return the number of unit normals of a radar state.

    Each component has one. A radar constant made of k uncertain parameters has k.
    """
    return components + sum(max(0, len(radar_parts) - 1) for radar_parts in parts)


def made_of_parts(parts: Sequence[Sequence[Tolerance]]) -> list[int]:
    """Return the places of the radar constants made of uncertain parameters, in all states."""
    return [len(RADAR) * i + CONSTANT for i, radar_parts in enumerate(parts) if radar_parts]


def columns(components: int, parts: Sequence[Sequence[Tolerance]]) -> list[list[int]]:
    """Return the columns of the unit normals that the parameters of each radar constant use.

    The first parameter uses the column of its c_r. The others use columns after those of all
    components.
    """
    used, end = [], components
    for i, radar_parts in enumerate(parts):
        more = range(end, end + max(0, len(radar_parts) - 1))
        used.append([len(RADAR) * i + CONSTANT, *more] if radar_parts else [])
        end = more.stop
    return used


@dataclass(frozen=True, eq=False)
class Sampler:
    """Draws states and computes P_D.

    Attributes:
        model: The detection model, of a radar or of a network of m.
        aircraft: Nominal aircraft states (n, 6).
        radar: Nominal radar state (4,), or (4m,) of a network of m. The error of the RCS follows
            where it is uncertain. A draw of it holds for all radars and poses of a run.
        sqrt_cov_aircraft: F (6, 6) with F Fᵀ = C_aa, or one for each pose (n, 6, 6).
        sqrt_cov_radar: F (4, 4), or (4m, 4m), with F Fᵀ = C_rr.
        parts: The uncertain parameters of the c_r of each radar, where they are known. The
            parameters are drawn, and c_r is computed from them.
    """

    model: NetworkModel
    aircraft: FloatArray
    radar: FloatArray
    sqrt_cov_aircraft: FloatArray
    sqrt_cov_radar: FloatArray
    parts: tuple[tuple[Tolerance, ...], ...] = ()

    @classmethod
    def of(cls, scenario: Scenario) -> Sampler:
        """Make the sampler of a scenario at its level of radar uncertainty."""
        return cls.of_states(
            scenario.model,
            scenario.aircraft,
            scenario.shared,
            scenario.cov_aircraft,
            scenario.cov_shared,
            scenario.tolerances_at_level,
        )

    @classmethod
    def of_states(
        cls,
        model: DetectionModel | NetworkModel,
        aircraft: FloatArray,
        radar: FloatArray,
        cov_aircraft: FloatArray,
        cov_radar: FloatArray,
        parts: tuple[tuple[Tolerance, ...], ...] = (),
    ) -> Sampler:
        """Make the sampler of states and covariances.

        Raises:
            ValueError: If a state is not finite, or a matrix is not a covariance.
        """
        check_finite("aircraft", aircraft)
        check_finite("radar", radar)
        return cls(
            model=as_network(model),
            aircraft=aircraft,
            radar=radar,
            sqrt_cov_aircraft=component_first(square_root(checked("aircraft", cov_aircraft))),
            sqrt_cov_radar=block_square_root(checked("radar", cov_radar), made_of_parts(parts)),
            parts=parts,
        )

    @property
    def radar_normals(self) -> int:
        """Number of unit normals of a radar state: 4 each, or 3 and one for each part of c_r."""
        return normals(len(self.radar), self.parts)

    def draw_radar(self, normals: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Draw radar states from unit normals.

        Args:
            normals: Unit normals (runs, radar_normals).

        Returns:
            Radar states (runs, 4m), and where a c_r was drawn below zero and set to zero (runs,).
        """
        radar = draws(self.radar, self.sqrt_cov_radar, normals[:, : len(self.radar)])
        constants = radar[:, CONSTANTS]  # a view: assignments change `radar`
        negative = constants < 0
        constants[negative] = 0.0
        used = columns(len(self.radar), self.parts)
        for i, (parts, part_columns) in enumerate(zip(self.parts, used, strict=True)):
            if parts:  # a negative parameter has been set to zero, and c_r is then zero too
                constants[:, i] = draw(self.radar[CONSTANTS][i], parts, normals[:, part_columns])
                negative[:, i] = constants[:, i] == 0
        return radar, np.asarray(negative.any(axis=1))

    def draw_p_d(
        self,
        normals: FloatArray,
        radar: FloatArray,
        poses: slice = ALL_POSES,
        *,
        overwrite: bool = False,
    ) -> FloatArray:
        """Draw an aircraft state for each pose of each run and compute P_D.

        Args:
            normals: Unit normals for the aircraft (runs, poses, 6).
            radar: Radar states (runs, 4m).
            poses: The poses, among those of the sampler.
            overwrite: Overwrite the unit normals, to save memory.

        Returns:
            P_D (runs, poses).
        """
        sqrt_cov = self.sqrt_cov_aircraft
        sqrt_cov = sqrt_cov if sqrt_cov.ndim == 2 else sqrt_cov[poses]
        aircraft = draws(self.aircraft[poses], sqrt_cov, normals, overwrite=overwrite)
        return self.model.p_d(aircraft, radar[:, np.newaxis])
