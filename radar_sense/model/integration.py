"""Detection after noncoherent integration of N pulses, with a fixed threshold or with CFAR.

The square-law outputs of N pulses are added, in units of the mean noise power. Signal and threshold
are counts here. Given a count k of the signal, the sum is a gamma variable of shape N + k. A gamma
variable of shape n exceeds T if a Poisson variable j of mean T is less than n. The two tails are

    P_D = P(j < N + k) = Σ_k w_k Q_k,   1 − P_D = P(j ≥ N + k) = Σ_k w_k P_k.

- k is Poisson of mean N S for a steady target. For a fluctuating target k is negative binomial of
  mean N S and shape K. K is 1, N, 2, 2N for the cases 1 to 4 of P. Swerling (IRE Trans. IT-6(2),
  1960). S is the mean signal-to-noise ratio of a pulse.
- j is Poisson of mean T for a fixed threshold, with Γ(N, T)/Γ(N) = P_fa. With cell-averaging CFAR
  the threshold is α times the sum of M cells of N pulses each. The sum is a gamma variable of shape
  M N. Then j is negative binomial of mean T = α M N and shape M N. Q_k is the incomplete beta
  function I_{1/(1+α)}(M N, N + k) (M. A. Richards, "Fundamentals of Radar Signal Processing", 2005,
  chapter 7).

All terms are positive, so nothing cancels. With p_k = Q_{k+1} − Q_k = P(j = N + k) and m = N S the
slope has the same weights,

    dP_D/dm = Σ_k w_k (1 + k/K)/(1 + m/K) p_k,

where a Poisson count is the limit K → ∞.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, betainccinv, comb, gammainc, gammainccinv, gammaln

from radar_sense.errors import InputError
from radar_sense.states import BLOCK, FloatArray, slices

#: Terms below exp(−45) = 3e-20 of the largest are left out.
_NEGLIGIBLE = 45.0
#: Largest threshold of a pulse, 30 dB above noise. CFAR with few cells needs more for a small P_fa.
_HIGHEST = 1000.0
#: Least count of the signal in a miss for which the miss is an integral in place of a sum. The
#: integral agrees with the sum to 2e-11 of 1 − P_D there, and to 2e-8 with a single cell of CFAR.
_FAR = 400.0
#: Places on one half of the path of the integral, in standard deviations, at equal steps from 0. A
#: Gaussian is below 1e-17 beyond. The other half has the complex conjugates.
_PATH = np.arange(0.0, 9.1, 0.25)
#: Mean of a signal from which ln(1 − P_D) is proportional to the mean.
_LARGEST = 1e18
#: Smallest P_fa of a look.
_LEAST = 1e-300
_LOG_HALF = -math.log(2.0)


class Tail(NamedTuple):
    """The lesser tail of P_D (...), as its logarithm. At a P_D near 1/2 it may be either tail."""

    upper: NDArray[np.bool_]  #: whether the tail is 1 − P_D
    log: FloatArray  #: ln of the tail
    rate: FloatArray  #: |d ln tail/dS|


class Tails(Protocol):
    """P_D as a function of S."""

    def tail(self, snr: FloatArray) -> Tail:
        """Return the lesser tail of P_D (n,) at mean signal-to-noise ratios (n,) of a pulse."""


class _Terms(NamedTuple):
    """Factors of the terms k = 0, 1, ... of the sum that are the same at all signals (k,)."""

    k: FloatArray
    log_density: FloatArray  #: ln p_k
    log_detected: FloatArray  #: ln Q_k
    log_missed: FloatArray  #: ln P_k


@dataclass(frozen=True)
class PulseSum:
    """The sum of N pulses against a threshold.

    Attributes:
        pulses: Pulses N.
        shape: Shape K of the count of the signal; infinite for a steady target.
        reference: M N of a cell-averaging CFAR; infinite for a fixed threshold.
        p_fa: Probability of false alarm.
        threshold: T of P(j < N) = P_fa.
    """

    pulses: int
    shape: float
    reference: float
    p_fa: float
    threshold: float

    @classmethod
    def of(cls, pulses: int, shape: float, reference: float, p_fa: float) -> PulseSum:
        """Return the sum with the threshold of a P_fa."""
        return cls(pulses, shape, reference, p_fa, _threshold(pulses, reference, p_fa))

    def tail(self, snr: FloatArray) -> Tail:
        """Return the lesser tail of P_D (n,) at mean signal-to-noise ratios (n,) of a pulse."""
        terms, mean = self._terms, self.pulses * np.asarray(snr, dtype=float)
        log_tail, rate = np.empty_like(mean), np.empty_like(mean)
        # sum and threshold have one mean, and P_D is from 0.37 to 0.63: either tail is accurate
        upper = mean > self.threshold - self.pulses
        far = upper & (mean > self._far_mean)
        near, lower = upper & ~far, ~upper
        log_tail[lower], rate[lower] = self._sum(mean[lower], terms.log_detected, beyond=True)
        log_tail[near], rate[near] = self._sum(mean[near], terms.log_missed)
        if far.any():
            log_tail[far], rate[far] = self._far_miss(mean[far])
        return Tail(upper, log_tail, self.pulses * rate)

    @cached_property
    def _far_mean(self) -> float:
        """Mean of a Poisson signal from which terms of the miss far from k = 0 suffice."""
        if math.isfinite(self.shape):
            return math.inf
        k = max(_FAR, 2.0 * self.threshold)
        slope = self.threshold / (1.0 + self.threshold / self.reference)
        return k * (self.pulses + k) / (slope * (1.0 + (self.pulses + k) / self.reference))

    @cached_property
    def _terms(self) -> _Terms:
        """The terms of the sum, up to where they are negligible at all signals that use them."""
        n, b, mean = self.pulses, self.reference, self.threshold
        largest = min(self._far_mean, 1e30)
        size = 128
        while True:
            k = np.arange(float(size))
            log_density = log_probability(n + k, mean, b)
            term = log_density + log_probability(k, largest, self.shape)
            if term[-1] < term.max() - _NEGLIGIBLE:
                break
            size *= 2
        last = size - int(np.argmax(term[::-1] > term.max() - _NEGLIGIBLE))
        k, log_density = k[:last], log_density[:last]
        ratios = _ratio(n + k, mean, b)
        over = np.empty(last)  # P_k/p_k, from the last to the first
        beyond = float(_above(n + last, np.asarray(mean), b))
        density = math.exp(log_probability(np.asarray(n + float(last)), mean, b))
        # Where both are too small for a number, the ratios are small and soon forget the first.
        following = beyond / density if beyond > 1e-290 else 1.0
        for i in range(last - 1, -1, -1):
            following = 1.0 + ratios[i] * following
            over[i] = following
        detected = self.p_fa + np.concatenate([[0.0], np.cumsum(np.exp(log_density[:-1]))])
        log_missed = log_density + np.log(over)
        log_detected = np.where(
            detected < 0.5, np.log(detected), np.log1p(-np.exp(np.minimum(log_missed, -0.5)))
        )
        return _Terms(k, log_density, log_detected, log_missed)

    def _sum(
        self, mean: FloatArray, log_tails: FloatArray, *, beyond: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """Return ln Σ_k w_k (tail k) (n,) and the slope of P_D by m over this sum (n,).

        Args:
            mean: Means m of the signal (n,).
            log_tails: ln Q_k or ln P_k (k,).
            beyond: Whether the tails are 1, not 0, beyond the last k.
        """
        k, log_density = self._terms.k, self._terms.log_density
        log_sum, rate = np.empty_like(mean), np.empty_like(mean)
        # a NaN stays one, and ln 0 is −∞ where nothing is beyond the last k
        with np.errstate(divide="ignore", under="ignore", invalid="ignore"):
            factor = 1.0 + k / self.shape
            for block in slices(len(mean), max(1, BLOCK // len(k))):
                m = mean[block, np.newaxis]
                log_weight = _log_over_zero(k, m, self.shape)
                terms = log_weight + log_tails
                top = terms.max(axis=1, keepdims=True)
                total = np.exp(terms - top).sum(axis=1)
                slope = (np.exp(log_weight + (log_density - top)) * factor).sum(axis=1)
                log_sum[block] = top[:, 0] + np.log(total)
                rate[block] = slope / total / (1.0 + m[:, 0] / self.shape)
            log_sum += _log_zero(mean, self.shape)
            if beyond:
                rest = np.log(_above(len(k), mean, self.shape))
                whole = np.logaddexp(log_sum, rest)
                rate *= np.exp(log_sum - whole)
                log_sum = whole
        return log_sum, rate

    def _far_miss(self, mean: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ln(1 − P_D) (n,) of a strong steady target and its slope by m (n,).

        With the generating functions of the counts and s = r exp(w), Cauchy's integral formula is

            P(j − k ≥ N) = 1/(2πi) ∫ exp(m(1/s − 1)) E(s^j) s^(−N) / (1 − 1/s) dw.

        r is the saddle point. The path w = iy + κy² follows the steepest descent, so that the
        trapezoidal rule has all digits (S. O. Rice, Bell System Technical Journal 52(5), 1973; C.
        W. Helstrom, IEEE Trans. AES-14(4), 1978). The slope −dP/dm has no factor 1/(1 − 1/s).
        """
        n, b, t = float(self.pulses), self.reference, self.threshold
        m = np.minimum(mean, _LARGEST)[:, np.newaxis]
        # r solves T (1 + N/b) r² + (m T/b − N (1 + T/b)) r = m (1 + T/b)
        square, constant = t * (1.0 + n / b), m * (1.0 + t / b)
        half = 0.5 * (m * t / b - n * (1.0 + t / b))
        root = abs(half) + np.hypot(half, np.sqrt(square * constant))
        r = np.where(half > 0.0, constant / root, root / square)
        # mean counts k and j at the saddle point, second and third cumulants of j, and of j − k
        k = m / r
        j = n + k
        second = j * (1.0 + j / b)
        third = second * (1.0 + 2.0 * j / b)
        variance = k + second
        bend = (third - k) / (6.0 * variance)
        y = _PATH / np.sqrt(variance)
        w = 1j * y + bend * y * y
        if math.isinf(b):
            log_saddle, noise = t * (r - 1.0), j * np.expm1(w)
        else:
            log_saddle, noise = -b * np.log(t * r / j), -b * np.log1p(-j / b * np.expm1(w))
        terms = np.exp(k * np.expm1(-w) - n * w + noise) * (1.0 - 2j * bend * y)
        terms[:, 1:] *= 2.0  # both halves
        total = (terms / (1.0 - np.exp(-w) / r)).real.sum(axis=1)
        log_saddle = log_saddle + m * (1.0 / r - 1.0) - n * np.log(r)
        step = _PATH[1] / np.sqrt(variance[:, 0])
        log_tail = log_saddle[:, 0] + np.log(total * step / (2.0 * math.pi))
        return log_tail * (mean / m[:, 0]), terms.real.sum(axis=1) / total


@dataclass(frozen=True)
class OrderedCells:
    """One pulse of exponential power against one of the sorted cells of noise.

    P_D = Π_{i<k} (M − i)/(M − i + α/(1 + S)) (H. Rohling, IEEE Trans. AES-19(4), 1983).

    Attributes:
        left: M − i of the factors (k,).
        factor: α.
    """

    left: FloatArray
    factor: float

    @classmethod
    def of(cls, cells: int, rank: int, p_fa: float) -> OrderedCells:
        """Return the cells with the factor that makes P_D = P_fa without signal."""
        from scipy.optimize import brentq  # slow to import

        left = cells - np.arange(float(rank))

        def excess(log_factor: float) -> float:
            return float(np.log1p(math.exp(log_factor) / left).sum() + math.log(p_fa))

        log_factor = brentq(excess, -100.0, 700.0, xtol=1e-15, rtol=1e-15)
        return cls(left, math.exp(log_factor))

    def tail(self, snr: FloatArray) -> Tail:
        """Return the lesser tail of P_D (n,) at mean signal-to-noise ratios (n,)."""
        total = 1.0 + np.asarray(snr, dtype=float)
        odds = self.factor / self.left / total[:, np.newaxis]
        log_p_d = -np.log1p(odds).sum(axis=1)
        rate = (odds / (1.0 + odds)).sum(axis=1) / total
        upper = log_p_d > _LOG_HALF
        missed = -np.expm1(log_p_d)
        return Tail(
            upper,
            np.where(upper, np.log(missed), log_p_d),
            np.where(upper, rate * np.exp(log_p_d) / missed, rate),
        )


@dataclass(frozen=True)
class MOfN:
    """Detection by m of n independent looks with the same P_D.

    Attributes:
        m: Looks that make a detection.
        n: Looks.
        look: A single look.
    """

    m: int
    n: int
    look: Tails

    def tail(self, snr: FloatArray) -> Tail:
        """Return the lesser tail of P_D (n,) at mean signal-to-noise ratios (n,) of a pulse.

        With p = P_D of a look and q = 1 − p both tails are sums of positive terms,

            P_D = p^m Σ_{j≥m} C(n, j) p^(j−m) q^(n−j),
            1 − P_D = q^(n−m+1) Σ_{j<m} C(n, j) p^j q^(m−1−j),

        and dP_D/dp = n C(n−1, m−1) p^(m−1) q^(n−m).
        """
        m, n, one = self.m, self.n, self.look.tail(snr)
        other = np.log1p(-np.exp(one.log))
        log_p, log_q = np.where(one.upper, other, one.log), np.where(one.upper, one.log, other)
        hits = _log_binomial(n, np.arange(m, n + 1), log_p, log_q, m, 0)
        misses = _log_binomial(n, np.arange(m), log_p, log_q, 0, n - m + 1)
        upper = m * log_p + hits > _LOG_HALF
        log_slope = math.log(n * comb(n - 1, m - 1)) + np.where(
            upper, (m - 1) * log_p - misses, (n - m) * log_q - hits
        )
        to_lesser = np.where(upper == one.upper, 0.0, np.where(upper, log_p - log_q, log_q - log_p))
        return Tail(
            upper,
            np.where(upper, (n - m + 1) * log_q + misses, m * log_p + hits),
            one.rate * np.exp(log_slope + to_lesser),
        )


def _log_binomial(
    n: int, j: NDArray[np.intp], log_p: FloatArray, log_q: FloatArray, p_out: int, q_out: int
) -> FloatArray:
    """Return ln Σ_j C(n, j) p^j q^(n−j) (...) without the factors p^p_out and q^q_out."""
    j = j[:, np.newaxis]
    terms = np.log(comb(n, j)) + (j - p_out) * log_p + (n - j - q_out) * log_q
    top = terms.max(axis=0)
    return top + np.log(np.exp(terms - top).sum(axis=0))


def _threshold(n: int, b: float, p_fa: float) -> float:
    """Return T of P(j < n) = P_fa."""
    if not _LEAST <= p_fa < 1.0:
        raise InputError(f"p_fa of a look must be from {_LEAST:g} to below 1, got {p_fa:g}")
    if math.isinf(b):
        threshold = float(gammainccinv(n, p_fa))
    else:
        part = float(betainccinv(n, b, p_fa))  # α/(1 + α)
        threshold = b * part / (1.0 - part) if part < 1.0 else math.inf
    if not threshold <= _HIGHEST * n:
        raise InputError(
            f"p_fa {p_fa:g} puts the threshold more than 30 dB above noise; cfar needs more cells, "
            "or p_fa must be larger"
        )
    if p_fa > 0.5:  # ln P_fa has no digits left where P_fa is 1
        return threshold
    j = np.arange(float(n))
    for _ in range(3):  # Newton's method on ln P_fa
        log_terms = log_probability(j, threshold, b)
        top = log_terms.max()
        log_sum = top + math.log(np.exp(log_terms - top).sum())
        slope = math.exp(log_terms[-1] - log_sum) * (1.0 + (n - 1) / b) / (1.0 + threshold / b)
        threshold += (log_sum - math.log(p_fa)) / slope
    return threshold


def log_probability(k: FloatArray, mean: FloatArray | float, shape: float) -> FloatArray:
    """Return ln of the probability of counts k (...) of a negative binomial or Poisson variable."""
    return _log_zero(mean, shape) + _log_over_zero(k, mean, shape)


def _log_zero(mean: FloatArray | float, shape: float) -> FloatArray:
    """Return ln of the probability of the count 0 (...)."""
    mean = np.asarray(mean)
    return -mean if math.isinf(shape) else -shape * np.log1p(mean / shape)


def _log_over_zero(k: FloatArray, mean: FloatArray | float, shape: float) -> FloatArray:
    """Return ln of the probability of counts k (...) over the probability of the count 0.

    Factorials are Stirling's, in logarithms of ratios (C. Loader, "Fast and accurate computation of
    binomial probabilities", 2000). Differences of ln Γ would lose four digits.
    """
    mean = np.maximum(mean, 1e-300)
    positive = np.maximum(k, 1.0)
    constant = -0.5 * np.log(2.0 * math.pi * positive) - _stirling(positive)
    if math.isinf(shape):
        constant += positive
        ratio = mean / positive
    else:
        total = shape + positive
        constant += 0.5 * np.log(shape / total) + _stirling(total) - _stirling(np.asarray(shape))
        constant += shape * np.log1p(positive / shape)
        ratio = mean / positive * (total / (shape + mean))
    return np.where(k > 0, positive * np.log(ratio) + constant, 0.0)


def _stirling(n: FloatArray) -> FloatArray:
    """Return ln n! − ln(√(2πn) (n/e)^n) of n ≥ 1 (DLMF 5.11.1)."""
    exact = gammaln(n + 1.0) - ((n + 0.5) * np.log(n) - n + 0.5 * math.log(2.0 * math.pi))
    i = 1.0 / n
    q = i * i
    series = i * (1 / 12 - q * (1 / 360 - q * (1 / 1260 - q * (1 / 1680 - q / 1188))))
    return np.where(n < 16.0, exact, series)


def _ratio(k: Any, mean: float, shape: float) -> Any:
    """Return P(j = k + 1)/P(j = k) of a negative binomial or Poisson count."""
    return (1.0 + k / shape) / (1.0 + mean / shape) * mean / (k + 1.0)


def _above(k: int, mean: FloatArray, shape: float) -> FloatArray:
    """Return the probability of k or more of a negative binomial or Poisson count."""
    return gammainc(k, mean) if math.isinf(shape) else betainc(k, shape, mean / (shape + mean))
