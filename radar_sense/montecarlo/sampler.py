"""P_D of drawn states, with radars that are the same at all poses of a run."""

from __future__ import annotations

import itertools
from functools import cached_property

import numpy as np

from radar_sense.covariance import draws
from radar_sense.model.network import NetworkModel
from radar_sense.model.radar import NEVER
from radar_sense.states import BLOCK, CONSTANT, RADAR_AND_ERRORS, FloatArray, of_radar, slices
from radar_sense.uncertain_states import UncertainStates, in_sight


class Sampler:
    """Draws P_D of n poses, with radar states that `UncertainStates.radars_at` draws.

    Args:
        states: The uncertain states.
        sqrt_cov: F (6, 6) or (n, 6, 6) with F Fᵀ = C_aa; that of the states by default.
    """

    def __init__(self, states: UncertainStates, sqrt_cov: FloatArray | None = None) -> None:
        given = states.sqrt_cov_aircraft if sqrt_cov is None else sqrt_cov
        self.states = states
        # each entry contiguous in memory
        self.sqrt_cov = np.asfortranarray(given[0] if len(given) == 1 else given)

    @cached_property
    def _parts(self) -> list[tuple[slice, NetworkModel, list[int]]]:
        """Parts of the poses: poses, the radars that may see them, and their components of x_r."""
        sight, poses = self.states.sight(), len(self.states.aircraft)
        edges = np.flatnonzero(np.any(sight[1:] != sight[:-1], axis=1)) + 1
        parts = []
        for start, end in itertools.pairwise([0, *edges.tolist(), poses]):
            if np.any(sight[start] != NEVER):
                numbers, radars = in_sight(self.states.model, sight[start])
                own = [c for i in numbers for c in range(of_radar(i).start, of_radar(i).stop)]
                parts.append((slice(start, end), radars, own))
        return parts

    def draw_p_d(self, normals: FloatArray, radar: FloatArray) -> FloatArray:
        """Return P_D (runs, n) of unit normals for aircraft (runs, n, 6), and radars (runs, 7m)."""
        p_d, sqrt_cov = np.zeros(normals.shape[:-1]), self.sqrt_cov
        for poses, radars, own in self._parts:
            nominal = self.states.aircraft[poses]
            root = sqrt_cov if sqrt_cov.ndim == 2 else sqrt_cov[poses]
            for runs in slices(len(p_d), max(1, BLOCK // len(nominal))):
                aircraft = draws(nominal, root, normals[runs, poses])
                p_d[runs, poses] = radars.unchecked_p_d(aircraft, radar[runs, np.newaxis, own])
        return p_d


def clipped(radar: FloatArray) -> int:
    """Return in how many states of radars (runs, 7m) a c_r was drawn below zero and set to zero."""
    return int(np.count_nonzero(np.any(radar[:, CONSTANT :: len(RADAR_AND_ERRORS)] == 0, axis=1)))
