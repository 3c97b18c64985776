"""Detectors: from signal-to-noise ratio to probability of detection.

Pulses pass a square-law detector, and a target is declared where the output is above a threshold.
The detectors differ in the fluctuation of the target's cross section: none (`Marcum`, and its
approximation `North`), or the cases of P. Swerling (IRE Trans. IT-6(2), 1960). S is the mean
signal-to-noise ratio of one pulse. For a single pulse case 2 equals case 1, and case 4 equals
case 3.

North's approximation is a closed form. All other detectors are computed by `integration` and
interpolated by `probit_table`.

All detectors keep their relative accuracy in both tails. z = Φ⁻¹(P_D) is computed from the lesser
of P_D and 1 − P_D, which is never a difference from 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv, ndtr, ndtri, ndtri_exp

from radar_sense.errors import InputError, check_has, check_pair
from radar_sense.limits import Checked, Limit, check_number, parameter
from radar_sense.model.integration import MOfN, OrderedCells, PulseSum, Tails
from radar_sense.model.normal import density, hazard
from radar_sense.model.probit_table import ProbitTable
from radar_sense.states import FloatArray, real_array

#: The accuracy is tested within these limits.
PULSES = Limit(at_least=1, at_most=1000, whole=True)
_CELLS = Limit(at_least=1, at_most=1000, whole=True)
_LOOKS = Limit(at_least=1, at_most=100, whole=True)
#: What is allowed of a detector of one's own: an error of P_D, a relative error of the slope, and
#: rounding of S times the slope. And the step of differences, as a part of S.
_P_D_ERROR, _SLOPE_ERROR, _ROUNDING, _STEP = 1e-3, 0.02, 1e-6, 1e-4


class Detector(Protocol):
    """What every detector has. A class of one's own that has it needs no base class.

    S is (...) and not negative.
    """

    def p_d(self, snr: FloatArray, p_fa: float) -> FloatArray:
        """Return P_D (...)."""

    def linearize_probit(self, snr: FloatArray, p_fa: float) -> tuple[FloatArray, FloatArray]:
        """Return the probit z = Φ⁻¹(P_D) (...) and its slope dz/dS (...)."""


def check_detector(detector: Any, p_fa: float) -> None:
    """Raise InputError unless an object is a detector, with a P_D that rises with S.

    A detector of this package is one. Any other is asked at signal-to-noise ratios from −20 to 30
    dB, and its slope is compared with differences.
    """
    check_has("detector", detector, ("p_d", "linearize_probit"), "a detector", "Marcum()")
    if type(detector).__module__.startswith("radar_sense."):
        return
    name, snr = type(detector).__name__, np.geomspace(1e-2, 1e3, 26)
    with np.errstate(all="ignore"):
        p_d, both = detector.p_d(snr, p_fa), detector.linearize_probit(snr, p_fa)
        z, slope = check_pair(f"{name}.linearize_probit", both)
        low, high = (detector.linearize_probit(snr * (1.0 + s), p_fa)[0] for s in (-_STEP, _STEP))
        numeric = (high - low) / (2.0 * _STEP * snr)
    for what, values in (
        (f"{name}.p_d", p_d),
        (f"z of {name}.linearize_probit", z),
        (f"dz/dS of {name}.linearize_probit", slope),
    ):
        array = real_array(what, values)
        if array.shape != snr.shape:
            raise InputError(f"{what} must have the shape of S, {snr.shape}, got {array.shape}")
        lost = np.isnan(array) & ~np.isinf(z)  # z is infinite where P_D rounds to 1
        if lost.any():
            raise InputError(f"{what} must be a number, it is NaN at S = {snr[lost][0]:.3g}")
    error = abs(ndtr(z) - p_d)
    if np.max(error) > _P_D_ERROR:
        raise InputError(
            f"z of {name}.linearize_probit is not the probit of {name}.p_d: P_D differs by "
            f"{np.max(error):.2g} at S = {snr[np.argmax(error)]:.3g}"
        )
    if np.any(z[1:] < z[:-1]):
        raise InputError(f"P_D of {name} must rise with the signal-to-noise ratio S")
    off = abs(slope - numeric) > _SLOPE_ERROR * abs(numeric) + _ROUNDING / snr
    if np.count_nonzero(off) > off.size / 2:  # at a kink there is no slope
        raise InputError(
            f"dz/dS of {name}.linearize_probit is not the slope of its z, by differences of it at "
            f"{np.count_nonzero(off)} of {off.size} S"
        )


@dataclass(frozen=True)
class North:
    """North's approximation to the detection of a steady target by one pulse, eq. (1) of the paper.

    P_D ≈ ½ erfc(√(−ln P_fa) − √(S + ½)) (D. O. North, Proc. IEEE 51(7), 1963). ½ erfc(−x) is
    Φ(√2 x), so the probit is √2 times the argument, and exact where P_D rounds to 0 or 1.
    """

    def p_d(self, snr: FloatArray, p_fa: float) -> FloatArray:
        """Return P_D (...) at signal-to-noise ratios (...) not below zero."""
        return ndtr(math.sqrt(2.0) * (np.sqrt(snr + 0.5) - math.sqrt(-math.log(p_fa))))

    def linearize_probit(self, snr: FloatArray, p_fa: float) -> tuple[FloatArray, FloatArray]:
        """Return the probit z = Φ⁻¹(P_D) (...) and its slope dz/dS (...)."""
        root = np.sqrt(snr + 0.5)
        return math.sqrt(2.0) * (root - math.sqrt(-math.log(p_fa))), math.sqrt(0.5) / root


@dataclass(frozen=True)
class CellAveraging(Checked):
    """A threshold proportional to the mean of the noise in reference cells."""

    cells: int = parameter(
        "cells",
        "Number M of reference cells, each with the sum of as many pulses as the cell tested.",
        _CELLS,
    )


@dataclass(frozen=True)
class OrderedStatistics(Checked):
    """A threshold proportional to one of the sorted reference cells.

    P_D = Π_{i<k} (M − i)/(M − i + α/(1 + S)) for an exponential target, and P_fa is P_D at S = 0
    (H. Rohling, IEEE Trans. AES-19(4), 1983).
    """

    cells: int = parameter("cells", "Number M of reference cells.", _CELLS)
    rank: int = parameter("rank", "Rank k of the cell, 1 for the one with the least noise.", _CELLS)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rank > self.cells:
            raise InputError(f"rank must be at most {self.cells}, the cells; got {self.rank}")


#: The kinds of CFAR that a scenario can name.
CFARS: Mapping[str, type[CellAveraging] | type[OrderedStatistics]] = {
    "cell_averaging": CellAveraging,
    "ordered_statistics": OrderedStatistics,
}


@dataclass(frozen=True)
class BinaryIntegration(Checked):
    """A detection where m of n looks are above the threshold; the n looks are one look.

    P_fa belongs to the n looks together.
    """

    m: int = parameter("m", "Looks above the threshold that make a detection.", _LOOKS)
    n: int = parameter("n", "Looks, each with the sum of `pulses` pulses.", _LOOKS)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.m > self.n:
            raise InputError(f"m must be at most {self.n}, the n looks; got {self.m}")


@dataclass(frozen=True)
class PulseDetector(Checked):
    """A detector of N pulses, with a fixed threshold or CFAR."""

    pulses: int = parameter(
        "pulses", "Number N of pulses that are integrated noncoherently.", PULSES, default=1
    )
    cfar: CellAveraging | OrderedStatistics | None = parameter(
        "cfar", "CFAR, or None for a fixed threshold.", CFARS, default=None
    )
    binary: BinaryIntegration | None = parameter(
        "binary", "Detection by m of n looks, or None.", BinaryIntegration, default=None
    )

    #: Shape of the distribution of a cross section; infinite for a steady one.
    degree: ClassVar[float] = math.inf
    #: Whether the cross section is the same for all pulses of a scan, yet random.
    slow: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.binary and self.slow:
            raise InputError(
                "binary needs pulses that fluctuate independently, or not at all: it is for "
                "marcum, swerling2 and swerling4"
            )
        if isinstance(self.cfar, OrderedStatistics) and not (self.degree == 1 and self.pulses == 1):
            raise InputError(
                "cfar ordered_statistics is for swerling1 and swerling2 with one pulse; "
                "cell_averaging is for all"
            )

    def p_d(self, snr: FloatArray, p_fa: float) -> FloatArray:
        """Return P_D (...) at mean signal-to-noise ratios (...) of a pulse, not below zero."""
        return np.asarray(ndtr(self.linearize_probit(snr, p_fa)[0]))

    def linearize_probit(self, snr: FloatArray, p_fa: float) -> tuple[FloatArray, FloatArray]:
        """Return the probit z = Φ⁻¹(P_D) (...) and its slope dz/dS (...)."""
        return _table(self, p_fa).linearize_probit(snr)

    def tails(self, p_fa: float) -> Tails:
        """Return the exact tails of P_D; a threshold more than 30 dB above noise is refused."""
        if self.binary is None:
            return self._look(p_fa)
        m, n = self.binary.m, self.binary.n
        return MOfN(m, n, self._look(float(betaincinv(m, n - m + 1, p_fa))))

    def _look(self, p_fa: float) -> Tails:
        if isinstance(self.cfar, OrderedStatistics):
            return OrderedCells.of(self.cfar.cells, self.cfar.rank, p_fa)
        cells = math.inf if self.cfar is None else float(self.cfar.cells)
        return PulseSum.of(self.pulses, self.shape, self.pulses * cells, p_fa)

    @property
    def shape(self) -> float:
        """Shape K of the count of the signal in `integration`."""
        return self.degree if self.slow else self.degree * self.pulses


@dataclass(frozen=True)
class Marcum(PulseDetector):
    """A steady target, exactly. `North` is an approximation to it.

    For a single pulse P_D = Q₁(√(2S), √(2X)) with the threshold X = −ln P_fa (J. I. Marcum, IRE
    Trans. IT-6(2), 1960).
    """


@dataclass(frozen=True)
class Swerling1(PulseDetector):
    """Swerling's case 1: many similar scatterers, with an exponential cross section.

    The cross section is the same for all pulses. For a single pulse P_D = P_fa^(1/(1 + S)), the
    mean of Marcum's P_D over an exponential distribution of S.
    """

    degree: ClassVar[float] = 1.0
    slow: ClassVar[bool] = True


@dataclass(frozen=True)
class Swerling2(Swerling1):
    """Swerling's case 2: case 1 with a new cross section at each pulse."""

    slow: ClassVar[bool] = False


@dataclass(frozen=True)
class Swerling3(PulseDetector):
    """Swerling's case 3: one large scatterer among many, chi-square with four degrees.

    The cross section is the same for all pulses. For a single pulse P_D = (1 + u s/(1 + s)) exp(−u)
    with s = S/2 and u = −ln P_fa/(1 + s). This is the mean of Marcum's P_D over signal-to-noise
    ratios t with the density (4t/S²) exp(−2t/S).
    """

    degree: ClassVar[float] = 2.0
    slow: ClassVar[bool] = True


@dataclass(frozen=True)
class Swerling4(Swerling3):
    """Swerling's case 4: case 3 with a new cross section at each pulse."""

    slow: ClassVar[bool] = False


#: The detectors that a scenario can name. Keys of a detector are declared with its fields.
DETECTORS: dict[str, type[Detector]] = {
    "north": North,
    "marcum": Marcum,
    "swerling1": Swerling1,
    "swerling2": Swerling2,
    "swerling3": Swerling3,
    "swerling4": Swerling4,
}


def linearize(detector: Detector, snr: FloatArray, p_fa: float) -> tuple[FloatArray, FloatArray]:
    """Return P_D (...) and its slope dP_D/dS = φ(z) dz/dS (...)."""
    z, by_snr = detector.linearize_probit(snr, p_fa)
    return ndtr(z), by_snr * density(z)


def required_snr(detector: Detector, p_fa: float, p_d: float) -> float:
    """Return the signal-to-noise ratio at which a detector has a P_D; 0 if P_D is at most P_fa."""
    check_number("p_d", p_d, Limit(above=0, below=1))
    target, low, high = float(ndtri(p_d)), math.log(1e-12), 700.0  # e^700 is a number yet
    if detector.linearize_probit(np.asarray(math.exp(low)), p_fa)[0] >= target:
        return 0.0
    x = 0.0
    while high - low > 1e-13:  # Newton's method for ln S, within a bracket
        z, by_snr = detector.linearize_probit(np.asarray(math.exp(x)), p_fa)
        low, high = (x, high) if z < target else (low, x)
        by_x = float(by_snr) * math.exp(x)
        step = (target - float(z)) / by_x if by_x > 0.0 else math.inf
        if abs(step) <= 1e-13:
            break
        x = x + step if low < x + step < high else 0.5 * (low + high)
    return math.exp(x)


@lru_cache(maxsize=128)
def _table(detector: PulseDetector, p_fa: float) -> ProbitTable:
    """Return the table of z of a detector, which is made at the first use."""
    tails = detector.tails(p_fa)

    def exact(snr: FloatArray) -> tuple[FloatArray, FloatArray]:
        return probit_of_tail(*tails.tail(snr))

    # P_D doubles on the scale of 1/rate.
    return ProbitTable.of(exact, 3.0 * float(tails.tail(np.zeros(1)).rate[0]))


def probit_of_tail(
    upper: NDArray[np.bool_], log_tail: FloatArray, rate: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return z (...) and dz/dS (...) from one tail of P_D.

    Args:
        upper: Whether the tail is 1 − P_D, not P_D (...).
        log_tail: Logarithm of the tail (...).
        rate: |d ln tail/dS| (...). The slope of z is the rate times tail/φ(z), Mills' ratio.
    """
    side = ndtri_exp(log_tail)
    return np.where(upper, -side, side), rate / hazard(-side)
