"""Unit normals for the states of a scenario: random, or from a Sobol' sequence.

A source gives, for each block of runs, one vector for the radar of every run and one for the
aircraft at every pose of every run. What it gives depends on the seed and the number of the block
alone: it is always the whole block, also where fewer runs are wanted of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from radar_sense.errors import ScenarioError, did_you_mean
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

    def block(self, index: int) -> tuple[FloatArray, FloatArray]:
        """Unit normals of a block, for the radar (runs, m) and for the aircraft (runs, n, 6)."""
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

    def block(self, index: int) -> tuple[FloatArray, FloatArray]:
        """Unit normals of a block, for the radar (runs, m) and for the aircraft (runs, n, 6)."""
        generator = random_stream(self.seed, index)
        radar = generator.standard_normal((self.runs, self.radar))
        # In memory one component after the other, as arithmetic goes by component.
        aircraft = np.empty((len(AIRCRAFT), self.runs, self.poses))
        _fill_with_normals(generator, aircraft)
        return radar, np.moveaxis(aircraft, 0, -1)


def _fill_with_normals(generator: np.random.Generator, values: FloatArray) -> None:
    """Fill an array (2k, ...) with independent unit normals, made in pairs.

    With u and v uniform in [0, 1), r = √(−2 ln(1 − u)) and t = tan πv they are (G. E. P. Box and
    M. E. Muller, "A note on the generation of random normal deviates", 1958)

        r cos 2πv = 2r/(1 + t²) − r,  r sin 2πv = t · 2r/(1 + t²).

    For many of them this takes half the time of NumPy's own, which draws one after the other.
    """
    generator.random(out=values)
    u, v = values[::2], values[1::2]
    radius = np.subtract(1.0, u, out=u)
    np.log(radius, out=radius)
    radius *= -2.0
    np.sqrt(radius, out=radius)
    t = np.multiply(np.pi, v, out=v)
    np.tan(t, out=t)
    scale = t * t
    scale += 1.0
    np.divide(radius, scale, out=scale)
    scale += scale
    np.subtract(scale, radius, out=radius)
    t *= scale


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

    def block(self, index: int) -> tuple[FloatArray, FloatArray]:
        """Unit normals of a block, for the radar (runs, m) and for the aircraft (runs, n, 6)."""
        from scipy.stats import qmc  # slow to import

        sequence = qmc.Sobol(
            self.radar + len(AIRCRAFT), bits=BITS, rng=random_stream(self.seed, _SCRAMBLE)
        )
        if index:
            sequence.fast_forward(index * self.runs)
        points = (sequence.random(self.runs) / _UNIT).astype(np.uint32)
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
