"""A table of the probit of a detector, for detectors whose exact P_D takes long."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from radar_sense.states import FloatArray

#: From S (n,) to z (n,) and dz/dS (n,).
Probit: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]

#: Largest signal-to-noise ratio of the table, 80 dB, and of the table beyond.
HIGHEST, FARTHEST = 1e8, 1e100
#: Width of a cell in x, and of a cell beyond the highest S, where z is smoother. With half
#: the width a single pulse is no better; a slow target with 1000 pulses is, by 2e-11 of z.
_WIDTH, _WIDTH_BEYOND = 0.1, 0.4
#: Places in a cell with exact values, from -1 to 1. The polynomial has twice as many coefficients.
_NODES = -np.cos(np.pi * np.arange(4) / 3)


@dataclass(frozen=True, eq=False)
class ProbitTable:
    """z = Φ⁻¹(P_D) and its slope, interpolated in x = ln(1 + q S).

    In each cell z is a polynomial with the exact values and slopes at both ends of the cell and at
    two places between. z and dz/dx are therefore continuous, and dz/dx is the exact slope of the
    interpolated z. P_D leaves P_fa on the scale 1/q, and S = 0 is in the table. Higher S are in a
    second table, which is made when the first of them is met.

    Attributes:
        exact: The exact function.
        scale: q.
        first: x of the lower end of the first cell.
        width: Width of a cell in x.
        coefficients: By the power of the place in the cell, from -1 to 1 (2 nodes, cells).
        highest: Largest S of the table.
    """

    exact: Probit
    scale: float
    first: float
    width: float
    coefficients: FloatArray
    highest: float

    @classmethod
    def of(cls, exact: Probit, scale: float) -> ProbitTable:
        """Compute the table of an exact function, up to HIGHEST."""
        return cls._between(exact, scale, 0.0, HIGHEST, _WIDTH)

    @classmethod
    def _between(
        cls, exact: Probit, scale: float, lowest: float, highest: float, width: float
    ) -> ProbitTable:
        first = float(np.log1p(scale * lowest))
        cells = int(np.ceil((np.log1p(scale * highest) - first) / width))
        per_cell = len(_NODES) - 1
        middle = first + width * (np.arange(cells) + 0.5)
        # Both ends belong to two cells; each place is computed once.
        nodes = (middle[:, np.newaxis] + 0.5 * width * _NODES[:-1]).ravel()
        snr = np.expm1(np.append(nodes, first + cells * width)) / scale
        z, by_snr = exact(snr)
        slope = by_snr * (0.5 * width) * (snr + 1.0 / scale)
        here = per_cell * np.arange(cells)
        values = np.stack([of[here + i] for of in (z, slope) for i in range(per_cell + 1)])
        values[: per_cell + 1] -= (shift := z[here].copy())
        power = np.arange(2 * len(_NODES))
        place = _NODES[:, np.newaxis]
        rows = np.vstack([place**power, power * place ** np.maximum(power - 1, 0)])
        coefficients = np.linalg.solve(rows, values)
        coefficients[0] += shift
        return cls(exact, scale, first, width, coefficients, highest)

    @cached_property
    def _beyond(self) -> Probit:
        """The function for S above the table: a second table, and above that the exact values."""
        if self.highest >= FARTHEST:
            return self.exact
        table = self._between(self.exact, self.scale, self.highest, FARTHEST, _WIDTH_BEYOND)
        return table.linearize_probit

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
        slope /= (0.5 * self.width) * (snr + 1.0 / self.scale)
        beyond = snr > self.highest
        if beyond.any():
            z[beyond], slope[beyond] = self._beyond(snr[beyond])
        return z.reshape(shape)[()], slope.reshape(shape)[()]

    def _find(self, snr: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Return the cell of each S (...) and the place in the cell, from -1 to 1."""
        x = np.log1p(self.scale * snr)
        x -= self.first
        x *= 1.0 / self.width
        # fmin: a NaN is in the last cell, and stays NaN
        cell = np.fmin(x, self.coefficients.shape[1] - 1.0).astype(np.intp)
        x -= cell
        x -= 0.5
        x *= 2.0
        return cell, x
