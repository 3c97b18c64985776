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
from radar_sense.montecarlo.sequences import TOGETHER
from radar_sense.scenario import Scenario
from radar_sense.states import CONSTANT, RADAR, FloatArray, check_finite, constants_of

#: All poses of a scenario.
ALL_POSES = slice(None)


def count_normals(components: int, parts: Sequence[Sequence[Tolerance]]) -> int:
    """Return the number of unit normals of a radar state.

    Each component has one normal. A radar constant made of k uncertain parameters has k normals.
    """
    return components + sum(max(0, len(radar_parts) - 1) for radar_parts in parts)


def components_with_parts(parts: Sequence[Sequence[Tolerance]]) -> list[int]:
    """Return the places of the radar constants made of uncertain parameters, in all states."""
    return [len(RADAR) * i + CONSTANT for i, radar_parts in enumerate(parts) if radar_parts]


def columns_of_normals(components: int, parts: Sequence[Sequence[Tolerance]]) -> list[list[int]]:
    """Return the columns of the unit normals that the parameters of each radar constant use.

    The first parameter uses the column of its c_r. The other parameters use columns after the
    columns of all components.
    """
    columns_by_radar, end = [], components
    for i, radar_parts in enumerate(parts):
        added = range(end, end + max(0, len(radar_parts) - 1))
        columns_by_radar.append([len(RADAR) * i + CONSTANT, *added] if radar_parts else [])
        end = added.stop
    return columns_by_radar


@dataclass(frozen=True, eq=False)
class Sampler:
    """Draws states and computes P_D.

    Attributes:
        model: The detection model, of a radar or of a network of m.
        aircraft: Nominal aircraft states (n, 6).
        radar: Nominal radar state (4,), or (4m,) of a network of m. The errors of further
            parameters may follow, see `states`. A draw of them holds for all poses of a run.
        sqrt_cov_aircraft: F (6, 6) with F Fᵀ = C_aa, or one for each pose (n, 6, 6).
        sqrt_cov_radar: F (4, 4), or (4m, 4m), with F Fᵀ = C_rr.
        parts: The uncertain parameters of the c_r of each radar; () for a Gaussian c_r. The
            parameters are drawn, and c_r is computed from the parameters.
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
        check_finite("radar", radar, len(as_network(model).radars))
        return cls(
            model=as_network(model),
            aircraft=aircraft,
            radar=radar,
            sqrt_cov_aircraft=component_first(square_root(checked("aircraft", cov_aircraft))),
            sqrt_cov_radar=block_square_root(
                checked("radar", cov_radar), components_with_parts(parts)
            ),
            parts=parts,
        )

    @property
    def radar_normals(self) -> int:
        """Number of unit normals of all radars: 4 each, or 3 and one for each part of c_r."""
        return count_normals(len(self.radar), self.parts)

    def draw_radar(self, normals: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Draw radar states from unit normals.

        Args:
            normals: Unit normals (runs, radar_normals).

        Returns:
            Radar states (runs, 4m), and where a c_r was drawn below zero and set to zero (runs,).
        """
        radar = draws(self.radar, self.sqrt_cov_radar, normals[:, : len(self.radar)])
        places = constants_of(len(self.model.radars))
        constants = radar[:, places]  # a view: assignments change `radar`
        negative = constants < 0
        constants[negative] = 0.0
        columns_by_radar = columns_of_normals(len(self.radar), self.parts)
        for i, (parts, part_columns) in enumerate(zip(self.parts, columns_by_radar, strict=True)):
            if parts:  # `draw` returns 0 for a negative parameter
                constants[:, i] = draw(self.radar[places][i], parts, normals[:, part_columns])
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
            poses: Poses of the sampler.
            overwrite: Whether to overwrite the unit normals, to save memory.

        Returns:
            P_D (runs, poses).
        """
        sqrt_cov, nominal = self.sqrt_cov_aircraft, self.aircraft[poses]
        sqrt_cov = sqrt_cov if sqrt_cov.ndim == 2 else sqrt_cov[poses]
        p_d = np.empty(normals.shape[:-1])
        size = max(1, TOGETHER // max(1, int(normals.shape[1])))
        for start in range(0, len(p_d), size):
            runs = slice(start, start + size)
            aircraft = draws(nominal, sqrt_cov, normals[runs], overwrite=overwrite)
            p_d[runs] = self.model.p_d(aircraft, radar[runs, np.newaxis])
        return p_d
