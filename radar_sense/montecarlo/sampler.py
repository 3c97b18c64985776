"""Random states of aircraft and radars, and P_D at these states."""

from __future__ import annotations

import itertools
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from radar_sense.covariance import component_first, draws
from radar_sense.model.network import NetworkModel
from radar_sense.model.radar import NEVER
from radar_sense.states import BLOCK, CONSTANT, FloatArray, component, of_radar
from radar_sense.uncertain_states import UncertainStates, in_sight


class Sampler:
    """Draws states of n poses, with radars that are the same at all poses, and computes P_D.

    Args:
        states: The uncertain states.
        sqrt_cov_aircraft: F (6, 6) or (n, 6, 6) with F Fᵀ = C_aa; that of the states by default.
    """

    def __init__(
        self, states: UncertainStates, sqrt_cov_aircraft: FloatArray | None = None
    ) -> None:
        self.states, self._sqrt_cov_aircraft = states, sqrt_cov_aircraft

    @property
    def model(self) -> NetworkModel:
        """The network."""
        return self.states.model

    @property
    def poses(self) -> int:
        """Number of poses n."""
        return len(self.states.aircraft)

    @property
    def radar_normals(self) -> int:
        """Number of unit normals of all radars."""
        return self.states.radar_normals

    @cached_property
    def sqrt_cov_aircraft(self) -> FloatArray:
        """F (6, 6) or (n, 6, 6) with F Fᵀ = C_aa, entry by entry contiguous."""
        sqrt_cov = self._sqrt_cov_aircraft
        if sqrt_cov is None:
            sqrt_cov = self.states.sqrt_cov_aircraft
        if len(sqrt_cov) == 1 and sqrt_cov.ndim == 3:
            sqrt_cov = sqrt_cov[0]
        return component_first(sqrt_cov)

    def draw_radar(self, normals: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Draw radar states from unit normals.

        Args:
            normals: Unit normals (runs, radar_normals).

        Returns:
            Radar states (runs, 7m), and where a c_r was drawn below zero and set to zero (runs,).
        """
        radar = self.states.radars_at(normals)
        constants = radar[:, component(CONSTANT, len(self.model.radars))]
        return radar, np.asarray((constants == 0).any(axis=1))

    @cached_property
    def _parts(self) -> list[tuple[slice, NetworkModel, list[int]]]:
        """Parts of the poses: poses, the radars that may see them, and their components of x_r."""
        sight = self.states.sight
        edges = np.flatnonzero(np.any(sight[1:] != sight[:-1], axis=1)) + 1
        parts = []
        for start, end in itertools.pairwise([0, *edges.tolist(), self.poses]):
            if np.any(sight[start] != NEVER):
                numbers, radars = in_sight(self.model, sight[start])
                own = [c for i in numbers for c in range(of_radar(i).start, of_radar(i).stop)]
                parts.append((slice(start, end), radars, own))
        return parts

    def draw_p_d(self, normals: FloatArray, radar: FloatArray) -> FloatArray:
        """Draw an aircraft state for each pose of each run and compute P_D.

        Args:
            normals: Unit normals for the aircraft (runs, poses, 6).
            radar: Radar states (runs, 7m).

        Returns:
            P_D (runs, poses).
        """
        p_d, sqrt_cov = np.zeros(normals.shape[:-1]), self.sqrt_cov_aircraft
        for poses, radars, own in self._parts:
            nominal = self.states.aircraft[poses]
            root = sqrt_cov if sqrt_cov.ndim == 2 else sqrt_cov[poses]
            size = max(1, BLOCK // len(nominal))
            for start in range(0, len(p_d), size):
                runs = slice(start, start + size)
                aircraft = draws(nominal, root, normals[runs, poses])
                p_d[runs, poses] = radars.unchecked_p_d(aircraft, radar[runs, np.newaxis, own])
        return p_d
