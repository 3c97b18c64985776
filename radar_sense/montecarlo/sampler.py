"""Draws of the states of a scenario, and P_D of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sense.covariance import checked, component_first, draws, factor, factor_apart
from radar_sense.model.detection_model import Model
from radar_sense.model.radar_constant import Part, draw
from radar_sense.scenario import Scenario
from radar_sense.states import CONSTANT, CONSTANTS, RADAR, FloatArray, check_finite

#: All poses of a scenario.
EVERY = slice(None)


def normals(components: int, parts: Sequence[Sequence[Part]]) -> int:
    """How many unit normals radar states take: one for each component, and for c_r its parts."""
    return components + sum(max(0, len(of_radar) - 1) for of_radar in parts)


def made_of_parts(parts: Sequence[Sequence[Part]]) -> list[int]:
    """Return the places, among the states of all radars, of each c_r that is made of parts."""
    return [len(RADAR) * i + CONSTANT for i, of_radar in enumerate(parts) if of_radar]


def columns(components: int, parts: Sequence[Sequence[Part]]) -> list[list[int]]:
    """Return which of these unit normals the parts of each radar take.

    The first takes that of its c_r, the others take more, which come after those of all components.
    """
    found, end = [], components
    for i, of_radar in enumerate(parts):
        more = range(end, end + max(0, len(of_radar) - 1))
        found.append([len(RADAR) * i + CONSTANT, *more] if of_radar else [])
        end = more.stop
    return found


@dataclass(frozen=True, eq=False)
class Sampler:
    """Draws the states of a scenario and computes P_D from them.

    Attributes:
        model: The detection model, of a radar or of a network of m.
        aircraft: Nominal aircraft states (n, 6).
        radar: Nominal radar state (4,), or (4m,) of a network of m.
        factor_aircraft: F (6, 6) with F Fᵀ = C_aa, or one for each pose (n, 6, 6).
        factor_radar: F (4, 4), or (4m, 4m), with F Fᵀ = C_rr.
        parts: What makes the c_r of each radar uncertain, where that is known; it is then drawn as
            they make it.
    """

    model: Model
    aircraft: FloatArray
    radar: FloatArray
    factor_aircraft: FloatArray
    factor_radar: FloatArray
    parts: tuple[tuple[Part, ...], ...] = ()

    @classmethod
    def of(cls, scenario: Scenario) -> Sampler:
        """Make the sampler of a scenario at its level of radar uncertainty.

        Raises:
            ValueError: If a state is not finite, or a matrix is not a covariance.
        """
        check_finite("aircraft", scenario.aircraft)
        check_finite("radar", scenario.radar)
        return cls(
            model=scenario.model,
            aircraft=scenario.aircraft,
            radar=scenario.radar,
            factor_aircraft=component_first(factor(checked("aircraft", scenario.cov_aircraft))),
            factor_radar=factor_apart(
                checked("radar", scenario.cov_radar[scenario.level]), made_of_parts(scenario.parts)
            ),
            parts=scenario.parts,
        )

    @property
    def radar_normals(self) -> int:
        """Unit normals that a radar state takes: 4 each, or 3 and one for each part of c_r."""
        return normals(len(self.radar), self.parts)

    def draw_radar(self, white: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Draw radar states from unit normals.

        Args:
            white: Unit normals (runs, radar_normals).

        Returns:
            Radar states (runs, 4m), and where a c_r was drawn below zero and set to zero (runs,).
        """
        radar = draws(self.radar, self.factor_radar, white[:, : len(self.radar)])
        constants = radar[:, CONSTANTS]
        negative = constants < 0
        constants[negative] = 0.0  # in `radar` too, of which it is a part
        inputs = columns(len(self.radar), self.parts)
        for i, (parts, own) in enumerate(zip(self.parts, inputs, strict=True)):
            if parts:  # a parameter below zero has been set to zero, and c_r with it
                constants[:, i] = draw(self.radar[CONSTANTS][i], parts, white[:, own])
                negative[:, i] = constants[:, i] == 0
        return radar, np.asarray(negative.any(axis=1))

    def draw_p_d(
        self,
        white: FloatArray,
        radar: FloatArray,
        poses: slice = EVERY,
        *,
        overwrite: bool = False,
    ) -> FloatArray:
        """Draw an aircraft for each pose of each run and compute P_D.

        Args:
            white: Unit normals for the aircraft (runs, poses, 6).
            radar: Radar states (runs, 4m).
            poses: Which of the scenario's poses.
            overwrite: Whether the memory of the normals may be used.

        Returns:
            P_D (runs, poses).
        """
        root = self.factor_aircraft
        root = root if root.ndim == 2 else root[poses]
        aircraft = draws(self.aircraft[poses], root, white, overwrite=overwrite)
        return self.model.p_d(aircraft, radar[:, np.newaxis])
