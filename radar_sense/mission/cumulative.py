"""Cumulative probability of detection by each look, and its uncertainty to first order.

Given the states, looks are independent, and the probability of detection by look k is

    P_c(k) = 1 − Π_{j≤k} (1 − P_j) = 1 − exp(−H_k), H_k = Σ_{j≤k} h_j, h_j = −ln(1 − P_j).

H is a sum of functions of one look each. To first order its variance is a double sum over the looks
whose terms do not depend on k. With an exponential correlation the sum needs one pass over them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import erfcx, ndtr, ndtri_exp

from radar_sense.covariance import checked, variance_along
from radar_sense.mission.looks import Looks, pose_variance
from radar_sense.propagation import Moments, probit_moments
from radar_sense.states import FloatArray

#: Methods of first order.
METHODS = ("linear", "probit")
#: Bounds are at Φ(−β) and Φ(β).
BETA = 3.0
#: The normal density underflows farther out in the tails.
FAR = 37.5
_SQRT_2 = math.sqrt(2.0)
_ROOT_2_OVER_PI = math.sqrt(2.0 / math.pi)


@dataclass(frozen=True, eq=False)
class Cumulative:
    """Probability of an event up to each look (K,), and its uncertainty.

    Attributes:
        p: Probability with the nominal states.
        mean: Mean over the errors of the states.
        std: Standard deviation.
        lower: Bound that the probability falls below with probability Φ(−3).
        upper: Bound that the probability stays below with probability Φ(3).
        lower_se: Standard error of `lower`, None for a method that draws nothing.
        upper_se: Standard error of `upper`.
    """

    p: FloatArray
    mean: FloatArray
    std: FloatArray
    lower: FloatArray
    upper: FloatArray
    lower_se: FloatArray | None = None
    upper_se: FloatArray | None = None

    def at(self, looks: NDArray[np.intp]) -> Cumulative:
        """Return the probability by the looks of these numbers, which may recur."""
        errors = (None if e is None else e[looks] for e in (self.lower_se, self.upper_se))
        return Cumulative(
            self.p[looks],
            self.mean[looks],
            self.std[looks],
            self.lower[looks],
            self.upper[looks],
            *errors,
        )


def cumulative_p_d(p_d: ArrayLike) -> FloatArray:
    """Return P_c (..., K) from P_D (..., K) of each look.

    Small probabilities are accurate to a relative rounding error. Where P_D rounds to 1, P_c is 1.
    For 1 − P_c there, use `Looks.hazard`.
    """
    with np.errstate(divide="ignore"):  # ln(1 − 1) = −inf, and P_c is 1 from there on
        log_miss = np.log1p(-np.asarray(p_d, dtype=float))
    p_c: FloatArray = -np.expm1(np.cumsum(log_miss, axis=-1))
    return p_c


def cumulative_detection(
    looks: Looks,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    correlation_time: float,
    method: str = "probit",
) -> Cumulative:
    """Return P_c up to each look, with its uncertainty to first order.

    The time grows in proportion to K.

    Args:
        looks: The looks.
        cov_aircraft: C_aa (6, 6), or (K, 6, 6) with one for each look.
        cov_radar: C_rr (4m, 4m) of the radars' errors, constant during the mission.
        correlation_time: τ [s] of the pose errors, from 0 to infinity.
        method: Name of the method, one of `METHODS`.

    Raises:
        ValueError: If there is no such method, a shape does not fit or a number is out of range.
    """
    hazard = np.cumsum(looks.hazard)
    # dh/dz = φ(z)/Φ(−z), the inverse of Mills' ratio, which is finite where 1 − P_D rounds to 0
    slope = inverse_mills(looks.probit)
    variance = pose_variance(looks, slope, cov_aircraft, correlation_time)
    by_radar = np.cumsum(slope[:, np.newaxis] * looks.by_radar, axis=0)
    std = np.sqrt(variance + variance_along(by_radar, checked("radar", cov_radar)))
    # Before the first look of a visible aircraft, P_c is 0 with certainty.
    z = np.where(hazard == 0, -FAR, -ndtri_exp(-hazard))
    moments = first_order_moments(method, z, std * np.exp(-hazard), std / inverse_mills(z))
    return in_time_order(-np.expm1(-hazard), moments, std)


def first_order_moments(method: str, z: FloatArray, std: FloatArray, std_z: FloatArray) -> Moments:
    """Return moments of a probability to first order.

    The method `linear` linearizes the probability, and bounds may leave [0, 1]. The method `probit`
    linearizes z. For a single look, propagation by the method of the same name gives these moments.

    Args:
        method: Name of the method, one of `METHODS`.
        z: Probit of the probability (K,).
        std: Standard deviation of the probability to first order (K,).
        std_z: Standard deviation of z to first order (K,).

    Raises:
        ValueError: If there is no such method.
    """
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    p = ndtr(z)
    if method == "linear":
        return Moments(p, p, std, p - BETA * std, p + BETA * std, np.isfinite(p))
    mean, deviation = probit_moments(z, std_z)
    bounds = ndtr(z - BETA * std_z), ndtr(z + BETA * std_z)
    return Moments(p, mean, deviation, *bounds, np.isfinite(p))


def in_time_order(p: FloatArray, moments: Moments, std: FloatArray) -> Cumulative:
    """Return moments that do not decrease with time, and are exact where nothing is uncertain.

    P never decreases along a mission. A lower bound therefore holds at all later looks too, and an
    upper bound at all earlier looks. Mean and nominal P do not decrease either.
    """
    certain = std == 0
    mean, lower, upper = (
        np.where(certain, p, values) for values in (moments.mean, moments.lower, moments.upper)
    )
    earlier = np.fmin.accumulate(upper[::-1])[::-1]
    return Cumulative(
        p=np.maximum.accumulate(p),
        mean=np.maximum.accumulate(mean),
        std=np.where(certain, 0.0, moments.std),
        lower=np.maximum.accumulate(lower),
        upper=np.where(np.isnan(upper), np.nan, earlier),
    )


def inverse_mills(z: FloatArray) -> FloatArray:
    """Return φ(z)/Φ(−z) (...), finite in both tails."""
    ratio: FloatArray = _ROOT_2_OVER_PI / erfcx(z / _SQRT_2)
    return ratio


def density(z: FloatArray) -> FloatArray:
    """Return φ(z) (...)."""
    phi: FloatArray = np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    return phi
