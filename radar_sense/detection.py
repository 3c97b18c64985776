"""Detectors: from signal-to-noise ratio to probability of detection."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.special import erfc

from radar_sense.states import FloatArray

_HALF_OVER_SQRT_PI = 0.5 / np.sqrt(np.pi)


class Detector(Protocol):
    """What the rest of the package asks of a detector. S is (...) and not below zero."""

    def p_d(self, snr: FloatArray, p_fa: float) -> FloatArray:
        """Probability of detection (...)."""
        ...

    def linearize(self, snr: FloatArray, p_fa: float) -> tuple[FloatArray, FloatArray]:
        """Probability of detection (...) and its slope dP_D/dS (...)."""
        ...

    def linearize_probit(self, snr: FloatArray, p_fa: float) -> tuple[FloatArray, FloatArray]:
        """The probit z = Φ⁻¹(P_D) (...) and its slope dz/dS (...)."""
        ...


class North:
    """North's approximation to the detection of a steady target by one pulse, `eq:pd_approx`.

    P_D ≈ ½ erfc(√(−ln P_fa) − √(S + ½)) (D. O. North, Proc. IEEE 51(7), 1963).
    """

    def p_d(self, snr: FloatArray, p_fa: float) -> FloatArray:
        """Probability of detection (...) at signal-to-noise ratios (...) not below zero."""
        p_d: FloatArray = 0.5 * erfc(np.sqrt(-np.log(p_fa)) - np.sqrt(snr + 0.5))
        return p_d

    def linearize(self, snr: FloatArray, p_fa: float) -> tuple[FloatArray, FloatArray]:
        """Probability of detection (...) and its slope dP_D/dS (...)."""
        root = np.sqrt(snr + 0.5)
        miss = np.sqrt(-np.log(p_fa)) - root
        return 0.5 * erfc(miss), _HALF_OVER_SQRT_PI * np.exp(-miss * miss) / root

    def linearize_probit(self, snr: FloatArray, p_fa: float) -> tuple[FloatArray, FloatArray]:
        """The probit z = Φ⁻¹(P_D) (...) and its slope dz/dS (...).

        ½ erfc(−x) is Φ(√2 x), so here the probit is the argument itself, and stays exact where P_D
        rounds to 0 or 1.
        """
        root = np.sqrt(snr + 0.5)
        return np.sqrt(2.0) * (root - np.sqrt(-np.log(p_fa))), np.sqrt(0.5) / root
