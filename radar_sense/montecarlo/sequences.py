"""Unit normals for the states of a scenario: random, or from a Sobol' sequence.

They come in blocks. Every run has one vector for the radar, and one for the aircraft at every pose.
A block depends only on the seed and its number, and is always whole.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from radar_sense.errors import InputError, check_choice
from radar_sense.states import AIRCRAFT, RADAR, FloatArray
from radar_sense.streams import Stream, random_stream

#: Bits of a coordinate of a Sobol' point. SciPy 1.17 can skip ahead with up to 32 bits.
BITS = 32
_UNIT = 2.0**-BITS
#: Limit of the runs with Sobol' points. SciPy skips to a block by counting, which takes longer than
#: P_D with more runs.
MAX_SOBOL_RUNS = 2**24


@dataclass(frozen=True)
class UnitNormals:
    """Unit normals of all states, block after block.

    Attributes:
        seed: Seed of all blocks.
        runs: Runs of a block.
        poses: Number of poses n.
        radar: Number of unit normals of the radars, m.
    """

    seed: int
    runs: int
    poses: int
    radar: int = len(RADAR)

    def block(self, index: int) -> tuple[FloatArray, FloatArray]:
        """Return unit normals of a block for radar (runs, m) and aircraft (runs, n, 6)."""
        raise NotImplementedError


class Random(UnitNormals):
    """Pseudo-random unit normals, a stream for each block."""

    def block(self, index: int) -> tuple[FloatArray, FloatArray]:
        """As of `UnitNormals`."""
        generator = random_stream(self.seed, index)
        radar = generator.standard_normal((self.runs, self.radar))
        # Component first in memory, as P_D is computed component by component.
        aircraft = generator.standard_normal((len(AIRCRAFT), self.runs, self.poses))
        return radar, np.moveaxis(aircraft, 0, -1)


class Sobol(UnitNormals):
    """Unit normals from a scrambled Sobol' sequence in the dimensions of all states.

    The sequence has a dimension for each unit normal of the radars, and six for the aircraft. All
    poses share the draws of the radar. The draws of the aircraft have a different digital shift at
    each pose, an exclusive-or with random bits, so that the errors differ from pose to pose. A
    digital shift keeps the evenness of a Sobol' sequence (P. L'Ecuyer and C. Lemieux, "Recent
    advances in randomized quasi-Monte Carlo methods", 2002).

    Statistics of one pose are valid. Joint statistics of two poses are not valid: the aircraft's
    draws at two poses are shifts of each other, and not independent. Over many seeds the
    correlation of the draws has mean 0. For one seed the correlation is about ±0.7, for any number
    of runs.
    """

    def block(self, index: int) -> tuple[FloatArray, FloatArray]:
        """As of `UnitNormals`."""
        from scipy.stats import qmc  # slow to import

        sequence = qmc.Sobol(
            self.radar + len(AIRCRAFT), bits=BITS, rng=random_stream(self.seed, Stream.SCRAMBLE)
        )
        if index:
            sequence.fast_forward(index * self.runs)
        points = (sequence.random(self.runs) / _UNIT).astype(np.uint32)
        radar, aircraft = np.split(points, [self.radar], axis=1)
        shift = random_stream(self.seed, Stream.SHIFT).integers(
            2**BITS, size=(len(AIRCRAFT), self.poses), dtype=np.uint32
        )
        return _normal(radar), np.moveaxis(_normal(aircraft[:, :, np.newaxis] ^ shift), 1, -1)


def _normal(bits: NDArray[np.uint32]) -> FloatArray:
    """Return unit normals from whole coordinates; half a bit keeps the normals finite."""
    return ndtri((bits + 0.5) * _UNIT)


#: The kinds by name.
SAMPLERS: Mapping[str, type[UnitNormals]] = {"random": Random, "sobol": Sobol}


def check_sampler(name: str, runs: int) -> None:
    """Raise InputError if there is no such sampler, or if it allows fewer runs."""
    check_choice("sampler", name, SAMPLERS)
    if name == "sobol" and runs > MAX_SOBOL_RUNS:
        raise InputError(
            f"runs with Sobol' points must be at most {MAX_SOBOL_RUNS:,}, got {runs:,}"
        )
