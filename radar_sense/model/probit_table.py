"""A table of the probit of a detector, for detectors whose exact P_D takes long."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from radar_sense.states import FloatArray

#: From S (n,) to z (n,) and dz/dS (n,).
Probit: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]

#: Largest signal-to-noise ratio of the table, 200 dB: that of a strong radar at 10 m.
HIGHEST = 1e20
#: Width of a cell in x. With half the width a single pulse is no better; a slow target with 1000
#: pulses is, by 2e-11 of z.
_WIDTH = 0.1
#: Places in a cell with exact values, from -1 to 1. The polynomial has twice as many coefficients.
_NODES = -np.cos(np.pi * np.arange(4) / 3)


@dataclass(frozen=True, eq=False)
class ProbitTable:
    """z = Φ⁻¹(P_D) and its slope, interpolated in x = ln(1 + q S).

    In each cell z is a polynomial with the exact values and slopes at both ends of the cell and at
    two places between. z and dz/dx are therefore continuous, and dz/dx is the exact slope of the
    interpolated z. P_D leaves P_fa on the scale 1/q, and S = 0 is in the table. Of S above
    `HIGHEST` the exact values are computed.

    Attributes:
        exact: The exact function.
        scale: q.
        coefficients: By the power of the place in the cell, from -1 to 1 (2 nodes, cells).
    """

    exact: Probit
    scale: float
    coefficients: FloatArray

    @classmethod
    def of(cls, exact: Probit, scale: float) -> ProbitTable:
        """Compute the table of an exact function."""
        cells = int(np.ceil(np.log1p(scale * HIGHEST) / _WIDTH))
        per_cell = len(_NODES) - 1
        middle = _WIDTH * (np.arange(cells) + 0.5)
        # Both ends belong to two cells; each place is computed once.
        nodes = (middle[:, np.newaxis] + 0.5 * _WIDTH * _NODES[:-1]).ravel()
        snr = np.expm1(np.append(nodes, cells * _WIDTH)) / scale
        z, by_snr = exact(snr)
        slope = by_snr * (0.5 * _WIDTH) * (snr + 1.0 / scale)
        here = per_cell * np.arange(cells)
        values = np.stack([of[here + i] for of in (z, slope) for i in range(per_cell + 1)])
        values[: per_cell + 1] -= (shift := z[here].copy())
        power = np.arange(2 * len(_NODES))
        place = _NODES[:, np.newaxis]
        rows = np.vstack([place**power, power * place ** np.maximum(power - 1, 0)])
        coefficients = np.linalg.solve(rows, values)
        coefficients[0] += shift
        return cls(exact, scale, coefficients)

    def linearize_probit(self, snr: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return z (...) and dz/dS (...)."""
        shape = np.shape(snr)
        snr = np.atleast_1d(np.asarray(snr, dtype=float))
        cell, place = self._find(snr)
        z = self.coefficients[-1].take(cell)
        slope = np.zeros_like(z)
        for coefficient in self.coefficients[-2::-1]:
            slope *= place
            slope += z
            z *= place
            z += coefficient.take(cell)
        slope /= (0.5 * _WIDTH) * (snr + 1.0 / self.scale)
        beyond = snr > HIGHEST
        if beyond.any():
            z[beyond], slope[beyond] = self.exact(snr[beyond])
        return z.reshape(shape)[()], slope.reshape(shape)[()]

    def _find(self, snr: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Return the cell of each S (...) and the place in the cell, from -1 to 1."""
        x = np.log1p(self.scale * snr)
        x *= 1.0 / _WIDTH
        # fmin: a NaN is in the last cell, and stays NaN
        cell = np.fmin(x, self.coefficients.shape[1] - 1.0).astype(np.intp)
        x -= cell
        x -= 0.5
        x *= 2.0
        return cell, x
