"""Independent streams of random numbers of one seed, and the register of their keys."""

from __future__ import annotations

from enum import IntEnum, unique

import numpy as np


@unique
class Stream(IntEnum):
    """First number of the key of each kind of draws.

    Runs of `monte_carlo` have the number of their block, which is less than 2³¹, as whole key.
    """

    #: Scramblings of a Sobol' sequence, and its digital shifts at each pose.
    SHIFT = 2**32 - 1
    SCRAMBLE = 2**32 - 2
    #: Seeds of the repetitions of `convergence`.
    REPETITIONS = 2**32 - 3
    #: Draws with emphasis on the tails.
    EMPHASIS = 2**32 - 4
    #: Runs along a path, with correlated errors.
    PATH = 2**32 - 5
    #: Seeds of the parts of the draws of `validate` and `compare`.
    PARTS = 2**32 - 6
    #: Plain runs of a mission.
    MISSION = 2**32 - 7
    #: Replicates of a mission, with recombined draws.
    RECOMBINED = 2**32 - 8


def random_stream(seed: int, *key: int) -> np.random.Generator:
    """Return the generator of one of the independent streams of a seed."""
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed, spawn_key=key)))
