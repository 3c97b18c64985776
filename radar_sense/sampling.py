"""Unit normals for the states of a scenario: random, or from a Sobol' sequence.

A source gives, for each block of runs, one vector for the radar of every run and one for the
aircraft at every pose of every run. What it gives depends on the seed and the number of the block
alone, and the first runs of a block do not depend on how many are asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from radar_sense.reader import ScenarioError, did_you_mean
from radar_sense.states import AIRCRAFT, RADAR, FloatArray

#: Bits of a coordinate of a Sobol' point, the most that SciPy can skip ahead in (1.17).
BITS = 32
_UNIT = 2.0**-BITS

#: Runs with Sobol' points. SciPy skips to a block by counting up to it, which with more runs than
#: this would take longer than all the rest.
MAX_SOBOL_RUNS = 2**24

#: Branch of a seed's streams that randomizes Sobol' points.
_SCRAMBLE, _SHIFT = 2**32 - 2, 2**32 - 1


def random_stream(seed: int, *key: int) -> np.random.Generator:
    """Make the generator of one of the independent streams that belong to a seed."""
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed, spawn_key=key)))


class Source(Protocol):
    """Where unit normals come from."""

    def block(self, index: int, runs: int) -> tuple[FloatArray, FloatArray]:
        """Unit normals of the first runs of a block.

        Returns:
            For the radar (runs, m) and for the aircraft (runs, n, 6).
        """
        ...


@dataclass(frozen=True)
class Random:
    """Pseudo-random unit normals, a stream for each block.

    Attributes:
        seed: Seed of all streams.
        runs: Runs of a block.
        poses: Number of poses n.
        radar: Unit normals that a radar state takes, m.
    """

    seed: int
    runs: int
    poses: int
    radar: int = len(RADAR)

    def block(self, index: int, runs: int) -> tuple[FloatArray, FloatArray]:
        """Unit normals of the first runs of a block, (runs, m) and (runs, n, 6)."""
        generator = random_stream(self.seed, index)
        # The radar's of the whole block, so that more runs begin with the same ones.
        radar = generator.standard_normal((self.runs, self.radar))
        # In memory the components of a run one after the other: arithmetic goes by component.
        aircraft = generator.standard_normal((runs, len(AIRCRAFT), self.poses))
        return radar[:runs], np.moveaxis(aircraft, 1, -1)


@dataclass(frozen=True)
class Sobol:
    """Unit normals from a scrambled Sobol' sequence in the dimensions of all states.

    These are ten, four more for each further radar of a network, and one more for each part of a
    radar constant beyond the first. All poses share the sequence, and so the radar's draws. The
    aircraft's are made different at every pose by a digital shift (an exclusive-or with random
    bits), under which a Sobol' sequence remains one: at each pose the draws fill all dimensions
    evenly, while from pose to pose their errors differ. (P. L'Ecuyer and C. Lemieux, "Recent
    advances in randomized quasi-Monte Carlo methods", 2002.)

    So what is said of each pose by itself is right. Of two poses together it is not: their draws of
    the aircraft are shifts of each other, not independent. Over many seeds the correlation is 0 in
    the mean, but with one seed it is some 0.7, up or down, however many runs there are.

    Attributes:
        seed: Seed of scrambling and shifts.
        runs: Runs of a block.
        poses: Number of poses n.
        radar: Unit normals that a radar state takes, m.
    """

    seed: int
    runs: int
    poses: int
    radar: int = len(RADAR)

    def block(self, index: int, runs: int) -> tuple[FloatArray, FloatArray]:
        """Unit normals of the first runs of a block, (runs, m) and (runs, n, 6)."""
        from scipy.stats import qmc  # slow to import

        sequence = qmc.Sobol(
            self.radar + len(AIRCRAFT), bits=BITS, rng=random_stream(self.seed, _SCRAMBLE)
        )
        if index:
            sequence.fast_forward(index * self.runs)
        points = (sequence.random(self.runs)[:runs] / _UNIT).astype(np.uint32)
        radar, aircraft = np.split(points, [self.radar], axis=1)
        shift = random_stream(self.seed, _SHIFT).integers(
            2**BITS, size=(len(AIRCRAFT), self.poses), dtype=np.uint32
        )
        return _normal(radar), np.moveaxis(_normal(aircraft[:, :, np.newaxis] ^ shift), 1, -1)


def _normal(bits: NDArray[np.uint32]) -> FloatArray:
    """Turn coordinates given as whole numbers into unit normals; half a bit keeps them finite."""
    normal: FloatArray = ndtri((bits + 0.5) * _UNIT)
    return normal


#: The samplers that can be named.
SAMPLERS: Mapping[str, Any] = {"random": Random, "sobol": Sobol}


def check_sampler(name: str, runs: int) -> None:
    """Refuse a sampler that does not exist, or more runs than it is made for.

    Raises:
        ScenarioError: If there is none of this name, or runs are too many for it.
    """
    if name not in SAMPLERS:
        raise ScenarioError(
            f"sampler must be one of {', '.join(SAMPLERS)}, got {name!r}"
            + did_you_mean(name, SAMPLERS)
        )
    if name == "sobol" and runs > MAX_SOBOL_RUNS:
        raise ScenarioError(
            f"runs with Sobol' points must be at most {MAX_SOBOL_RUNS:,}, got {runs:,}"
        )
