"""The attenuation of the signal on the way to the target and back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from radar_sense.limits import NOT_NEGATIVE, Checked, Limit, declared
from radar_sense.model.geometry import Vector, range_squared
from radar_sense.model.radar_equation import MOST_NEPERS, NEPERS
from radar_sense.states import FloatArray


@dataclass(frozen=True)
class Attenuation(Checked):
    """A constant attenuation, which multiplies the signal by 10^(−2αR/10).

    α is log-normal, with the value here as its median: the error is of ln α.

    Attributes:
        one_way: One-way attenuation α [dB/m].
    """

    one_way: float = declared(NOT_NEGATIVE)
    term: ClassVar = "attenuation"
    parameter: ClassVar = "attenuation"
    std_limit: ClassVar = Limit(at_least=0, at_most=1)
    detail: ClassVar = math.inf

    def nepers(self, line: Vector, error: FloatArray) -> FloatArray:
        """Return ln of the factor (...) of the signal along d, with an error of ln α."""
        return self._nepers(range_squared(line), error)

    def linearize(self, line: Vector, error: FloatArray) -> tuple[FloatArray, Vector, FloatArray]:
        """Return `nepers`, their gradient by d [1/m] and by the error of ln α."""
        squared = range_squared(line)
        nepers = self._nepers(squared, error)
        along = nepers / squared
        return nepers, Vector(*(along * d for d in line)), nepers

    def rise(self, line: Vector, error: FloatArray, part: FloatArray) -> FloatArray:
        """Return by how much (...) `nepers` may rise at most on the way, see `Factor`."""
        return -self.nepers(line, error) * (1.0 - part)

    def _nepers(self, squared: FloatArray, error: FloatArray) -> FloatArray:
        growth = np.exp(np.minimum(error, MOST_NEPERS))
        return np.asarray(-2.0 * NEPERS * (self.one_way * growth) * np.sqrt(squared))
