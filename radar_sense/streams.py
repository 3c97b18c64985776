"""Independent streams of random numbers of one seed, and the register of their keys.

A stream has a key of whole numbers that starts with one of the names below. Blocks of Monte Carlo
runs have the number of the block as their whole key.
"""

from __future__ import annotations

import numpy as np

#: Draws with emphasis on the tails, and runs along a path.
EMPHASIS, PATH = 2**32 - 4, 2**32 - 5


def random_stream(seed: int, *key: int) -> np.random.Generator:
    """Return the generator of one of the independent streams of a seed."""
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed, spawn_key=key)))
