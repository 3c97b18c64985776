"""Track initiation: the probability that m of n looks in a row have detected the aircraft.

Given P_D, the looks are independent. The outcomes of the last n − 1 looks are the state of a Markov
chain, and success is its absorbing state (J. C. Fu and M. V. Koutras, "Distribution theory of runs:
a Markov chain approach", J. Amer. Statist. Assoc. 89, 1994). The probability is therefore exact.
Before look n the window has fewer looks.

Each scan group has its own window: a missed look of one group does not break the track of another
group. Given the states, the groups are independent. The probability of the network is therefore
T = 1 − Π (1 − T_g) over its groups.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

from radar_sense.covariance import checked, variance_along
from radar_sense.mission.cumulative import (
    FAR,
    Cumulative,
    density,
    first_order_moments,
    in_time_order,
)
from radar_sense.mission.looks import Looks, pose_variance
from radar_sense.states import FloatArray

#: Largest n of m-of-n, which has 2^(n−1) histories.
MAX_WINDOW = 12
#: Numbers in one step of the Markov chain, which fit into a second-level cache.
CHAIN_BLOCK = 65_536


def track_initiation(
    looks: Looks,
    m: int,
    n: int,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    correlation_time: float,
    scan_group: NDArray[np.intp] | None = None,
    method: str = "probit",
) -> Cumulative:
    """Return the probability of m of n looks by each look, with its uncertainty to first order.

    Time and memory grow with K².

    Args:
        looks: The looks.
        m: Detections needed.
        n: Length of the window of consecutive looks, at most `MAX_WINDOW`.
        cov_aircraft: C_aa (6, 6), or (K, 6, 6) with one for each look.
        cov_radar: C_rr (4m, 4m) of the radars' errors, constant during the mission.
        correlation_time: τ [s] of the pose errors, from 0 to infinity.
        scan_group: The scan group of each look (K,); None if all looks are of one group.
        method: Name of the method, one of `cumulative.METHODS`.

    Raises:
        ValueError: If there is no such method, a shape does not fit or a number is out of range.
    """
    p_d, miss = looks.p_d, ndtr(-looks.probit)
    p, no_track = any_group(p_d, miss, m, n, scan_group)
    # dP_D/dz = φ(z)
    slope = any_group_gradient(p_d, miss, m, n, scan_group) * density(looks.probit)
    variance = pose_variance(looks, slope, cov_aircraft, correlation_time)
    # The partials of row k for looks after k are 0.
    by_radar = variance_along(_sum_over(slope, looks.by_radar), checked("radar", cov_radar))
    std = np.sqrt(variance[..., -1] + by_radar)
    # P is 0 before look m and may round to 1 later; φ(z) underflows in both cases.
    z = np.clip(np.where(p < 0.5, ndtri(p), -ndtri(no_track)), -FAR, FAR)
    std_z = np.where(abs(z) < FAR, std / density(z), 0.0)
    return in_time_order(p, first_order_moments(method, z, std, std_z), std)


def any_group(
    p_d: FloatArray, miss: FloatArray, m: int, n: int, scan_group: NDArray[np.intp] | None
) -> tuple[FloatArray, FloatArray]:
    """Return T and 1 − T (..., K) of m of n in any scan group."""
    if scan_group is None:
        return m_of_n(p_d, miss, m, n)
    p, no_track = np.zeros(p_d.shape), np.ones(p_d.shape)
    for looks, latest in _groups(scan_group):
        p_of_group, no_track_of_group = m_of_n(p_d[..., looks], miss[..., looks], m, n)
        begun = latest >= 0
        p += no_track * np.where(begun, p_of_group[..., latest], 0.0)
        no_track *= np.where(begun, no_track_of_group[..., latest], 1.0)
    return np.minimum(p, 1.0), no_track


def any_group_gradient(
    p_d: FloatArray,
    miss: FloatArray,
    m: int,
    n: int,
    scan_group: NDArray[np.intp] | None,
    ends: NDArray[np.intp] | None = None,
) -> FloatArray:
    """Return partials (E, K) of T at looks `ends` (E,), or at all looks, for P_D (K,).

    ∂T/∂P_j = ∂T_g/∂P_j Π (1 − T_h) over the other scan groups h.
    """
    ends = np.arange(len(p_d)) if ends is None else ends
    if scan_group is None:
        return m_of_n_gradient(p_d, miss, m, n, ends)
    groups = [(looks, latest[ends]) for looks, latest in _groups(scan_group)]
    no_track = [
        np.where(latest >= 0, m_of_n(p_d[looks], miss[looks], m, n)[1][latest], 1.0)
        for looks, latest in groups
    ]
    gradient = np.zeros((len(ends), len(p_d)))
    for i, (looks, latest) in enumerate(groups):
        others = np.prod(no_track[:i] + no_track[i + 1 :], axis=0)
        of_group = m_of_n_gradient(p_d[looks], miss[looks], m, n, np.maximum(latest, 0))
        gradient[:, looks] = np.where(
            latest[:, np.newaxis] >= 0, np.reshape(others, (-1, 1)) * of_group, 0.0
        )
    return gradient


def m_of_n(p_d: FloatArray, miss: FloatArray, m: int, n: int) -> tuple[FloatArray, FloatArray]:
    """Return the probability T of m of n looks by each look, and 1 − T.

    Both are sums without cancellation, accurate to a relative rounding error.

    Args:
        p_d: P_D of each look (..., K).
        miss: 1 − P_D (..., K).
        m: Detections needed, 1 to n.
        n: Length of the window of consecutive looks, at most `MAX_WINDOW`.

    Returns:
        T and 1 − T (..., K).

    Raises:
        ValueError: If m or n is out of range.
    """
    detections = _detections(m, n)
    shape, states = p_d.shape, len(detections)
    p_d, miss = (np.ascontiguousarray(a.reshape(-1, shape[-1]).T) for a in (p_d, miss))
    p, no_track = np.empty(p_d.shape), np.empty(p_d.shape)
    block = max(64, CHAIN_BLOCK // states)
    for start in range(0, p_d.shape[1], block):
        rows = slice(start, start + block)
        _chain(p_d[:, rows], miss[:, rows], detections, m, n, p[:, rows], no_track[:, rows])
    # a sum of rounded terms may exceed 1 by its rounding error
    p, no_track = np.minimum(p, 1.0, out=p), np.minimum(no_track, 1.0, out=no_track)
    return p.T.reshape(shape), no_track.T.reshape(shape)


def _chain(
    p_d: FloatArray,
    miss: FloatArray,
    detections: NDArray[np.intp],
    m: int,
    n: int,
    p: FloatArray,
    no_track: FloatArray,
) -> None:
    """Write T and 1 − T (K, rows) of one block of rows."""
    one_short = np.flatnonzero(detections == m - 1)
    weight = np.zeros((len(detections), p_d.shape[1]))
    weight[0] = 1.0
    total, unseen = np.zeros(p_d.shape[1]), 0
    remainder = weight.sum(axis=0)
    for k, (hit, missed) in enumerate(zip(p_d, miss, strict=True)):
        unseen = 0 if hit.any() else unseen + 1
        if unseen < n:  # after n looks without a possible detection the history is empty
            total = total + hit * weight[one_short].sum(axis=0)
            weight = _advanced(weight, hit, missed, detections, m)
            remainder = weight.sum(axis=0)
        p[k], no_track[k] = total, remainder


def m_of_n_gradient(
    p_d: FloatArray, miss: FloatArray, m: int, n: int, ends: NDArray[np.intp]
) -> FloatArray:
    """Return partials (E, K) of T at looks `ends` (E,) for P_D of each look (K,).

    A forward pass gives the probability of each history before look j. A backward pass gives the
    probability of success by a look of `ends`, for each history after look j. The partial is the
    difference between a detection and a miss at j. Where success is likely, the backward pass gives
    the probability of failure, because a difference of two numbers near 1 would lose digits.
    """
    detections = _detections(m, n)
    looks, states = len(p_d), len(detections)
    before = np.zeros((looks, states))
    weight = np.zeros(states)
    weight[0] = 1.0
    success = np.zeros(looks)
    for j in range(looks):
        before[j] = weight
        success[j] = success[j - 1] + p_d[j] * weight[detections == m - 1].sum()
        weight = _advanced(weight, p_d[j], miss[j], detections, m)
    likely = success[ends] > 0.5
    after_miss = (2 * np.arange(states)) % states
    after_hit = (after_miss + 1) % states
    gradient = np.zeros((len(ends), looks))
    later = np.repeat(np.where(likely, 1.0, 0.0)[:, np.newaxis], states, axis=1)
    on_success = np.where(likely, 0.0, 1.0)[:, np.newaxis]
    sign = np.where(likely, -1.0, 1.0)
    for j in range(looks - 1, -1, -1):
        now = ends >= j
        hit = np.where(detections == m - 1, on_success[now], later[np.ix_(now, after_hit)])
        missed = later[np.ix_(now, after_miss)]
        gradient[now, j] = sign[now] * np.sum((hit - missed) * before[j], axis=1)
        later[now] = p_d[j] * hit + miss[j] * missed
    return gradient


def check_window(m: int, n: int) -> None:
    """Raise ValueError if m or n is out of range."""
    if not 1 <= m <= n <= MAX_WINDOW:
        raise ValueError(f"m of n must have 1 <= m <= n <= {MAX_WINDOW}, got {m} of {n}")


def _detections(m: int, n: int) -> NDArray[np.intp]:
    """Return the detections in each history of the last n − 1 looks; bit 0 is the latest look.

    Raises:
        ValueError: If m or n is out of range.
    """
    check_window(m, n)
    return np.array([state.bit_count() for state in range(2 ** (n - 1))])


def _groups(
    scan_group: NDArray[np.intp],
) -> list[tuple[NDArray[np.bool_], NDArray[np.intp]]]:
    """Return the mask of each scan group (K,), and its latest look by each look (K,) or −1."""
    masks = (scan_group == group for group in np.unique(scan_group))
    return [(looks, np.cumsum(looks) - 1) for looks in masks]


def _sum_over(slope: FloatArray, by_radar: FloatArray) -> FloatArray:
    """Return slope (k, K) times partials (K, 4m), summed; 0 · NaN is 0 for a later look."""
    total: FloatArray = np.einsum("kj,ji->ki", slope, np.nan_to_num(by_radar))
    unknown = np.maximum.accumulate(np.isnan(by_radar), axis=0)
    return np.where(unknown, np.nan, total)


def _advanced(
    weight: FloatArray, p_d: FloatArray, miss: FloatArray, detections: NDArray[np.intp], m: int
) -> FloatArray:
    """Return the probability of each history (states, ...) one look later, without success."""
    states = len(detections)
    if states == 1:  # m = n = 1: any detection is success
        return weight * miss
    without_success = weight.copy()  # if this look detects
    without_success[detections >= m - 1] = 0.0
    later = np.empty_like(weight)
    # The oldest outcome, the highest bit, drops out. The new outcome is the lowest bit.
    later[0::2] = (weight[: states // 2] + weight[states // 2 :]) * miss
    later[1::2] = (without_success[: states // 2] + without_success[states // 2 :]) * p_d
    return later
