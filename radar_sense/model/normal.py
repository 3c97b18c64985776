"""The density of the standard normal distribution, and its ratio to a tail."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import erfcx

from radar_sense.states import FloatArray


def density(z: FloatArray) -> FloatArray:
    """Return φ(z) (...)."""
    return np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)


def hazard(z: FloatArray) -> FloatArray:
    """Return φ(z)/Φ(−z) (...), finite in both tails; the inverse of Mills' ratio."""
    return math.sqrt(2.0 / math.pi) / erfcx(z / math.sqrt(2.0))
