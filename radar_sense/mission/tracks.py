"""Track initiation: the probability that m of n looks in a row have detected the aircraft.

Given P_D the looks are independent. The outcomes of the last n − 1 looks are the state of a Markov
chain, which success absorbs (J. C. Fu and M. V. Koutras, "Distribution theory of runs: a Markov
chain approach", J. Amer. Statist. Assoc. 89, 1994). So the probability is exact. Before look n the
window holds the looks so far.

Looks of several scan groups do not share a window: a look of one group that sees nothing does not
break the track of another. Given the states the groups are independent, so that the network's
probability is T = 1 − Π (1 − T_g) over its groups.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

from radar_sense.covariance import checked, variance_along
from radar_sense.mission.cumulative import (
    FAR,
    Cumulative,
    bounds_method,
    density,
    in_time_order,
)
from radar_sense.mission.looks import Looks, pose_variance
from radar_sense.states import FloatArray

#: Largest n of m-of-n, which has 2^(n−1) histories.
MAX_WINDOW = 12
#: Numbers that one step of the Markov chain works on, to stay within a second-level cache.
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
    beta: float = 3.0,
) -> Cumulative:
    """Probability of m of n looks in a row by each look, with its uncertainty to first order.

    Time and memory grow with K². 2000 looks take some 0.6 s.

    Args:
        looks: The looks.
        m: Detections needed.
        n: Looks in a row that they must be within, at most `MAX_WINDOW`.
        cov_aircraft: C_aa (6, 6), or (K, 6, 6) with one for each look.
        cov_radar: C_rr (4m, 4m) of the radars' errors, constant during the mission.
        correlation_time: τ [s] of the pose errors, from 0 to infinity.
        scan_group: The scan group of each look (K,); None if all looks are of one group.
        method: Name of the method, one of `cumulative.METHODS`.
        beta: β > 0; the bounds are at Φ(−β) and Φ(β).

    Raises:
        ValueError: If there is no such method, a shape does not fit or a number is out of range.
    """
    p_d, miss = looks.p_d, ndtr(-looks.probit)
    p, left = any_group(p_d, miss, m, n, scan_group)
    # dP_D/dz = φ(z)
    slope = any_group_gradient(p_d, miss, m, n, scan_group) * density(looks.probit)
    variance = pose_variance(looks, slope, cov_aircraft, correlation_time)
    # Rows end with their own look: the partials for later ones are 0.
    by_radar = variance_along(_sum_over(slope, looks.by_radar), checked("radar", cov_radar))
    std = np.sqrt(variance[..., -1] + by_radar)
    # Before look m no track is possible, and later it may be so sure that nothing is left of φ(z).
    z = np.clip(np.where(p < 0.5, ndtri(p), -ndtri(left)), -FAR, FAR)
    std_z = np.where(abs(z) < FAR, std / density(z), 0.0)
    return in_time_order(p, bounds_method(method, beta)(z, std, std_z, beta), std)


def any_group(
    p_d: FloatArray, miss: FloatArray, m: int, n: int, scan_group: NDArray[np.intp] | None
) -> tuple[FloatArray, FloatArray]:
    """Return T and 1 − T (..., K) of m of n in one scan group or more, as `m_of_n` does."""
    if scan_group is None:
        return m_of_n(p_d, miss, m, n)
    p, left = np.zeros(p_d.shape), np.ones(p_d.shape)
    for mine, latest in _groups(scan_group):
        p_group, left_group = m_of_n(p_d[..., mine], miss[..., mine], m, n)
        begun = latest >= 0
        p += left * np.where(begun, p_group[..., latest], 0.0)
        left *= np.where(begun, left_group[..., latest], 1.0)
    return p, left


def any_group_gradient(
    p_d: FloatArray,
    miss: FloatArray,
    m: int,
    n: int,
    scan_group: NDArray[np.intp] | None,
    ends: NDArray[np.intp] | None = None,
) -> FloatArray:
    """Partials (E, K) of `any_group` at looks `ends` (E,), all of them if None, for P_D (K,).

    ∂T/∂P_j = ∂T_g/∂P_j Π (1 − T_h) over the other scan groups h.
    """
    ends = np.arange(len(p_d)) if ends is None else ends
    if scan_group is None:
        return m_of_n_gradient(p_d, miss, m, n, ends)
    groups = [(mine, latest[ends]) for mine, latest in _groups(scan_group)]
    lefts = [
        np.where(latest >= 0, m_of_n(p_d[mine], miss[mine], m, n)[1][latest], 1.0)
        for mine, latest in groups
    ]
    gradient = np.zeros((len(ends), len(p_d)))
    for i, (mine, latest) in enumerate(groups):
        others = np.prod([left for j, left in enumerate(lefts) if j != i], axis=0)
        own = m_of_n_gradient(p_d[mine], miss[mine], m, n, np.maximum(latest, 0))
        gradient[:, mine] = np.where(
            latest[:, np.newaxis] >= 0, np.reshape(others, (-1, 1)) * own, 0.0
        )
    return gradient


def m_of_n(p_d: FloatArray, miss: FloatArray, m: int, n: int) -> tuple[FloatArray, FloatArray]:
    """Probability T of m of n looks in a row by each look, and 1 − T, from P_D and 1 − P_D.

    Both are sums of numbers that are not negative, so that each is right to its own digits.

    Args:
        p_d: P_D of each look (..., K).
        miss: 1 − P_D (..., K).
        m: Detections needed, 1 to n.
        n: Looks in a row that they must be within, at most `MAX_WINDOW`.

    Returns:
        T and 1 − T (..., K).

    Raises:
        ValueError: If m or n is out of range.
    """
    detections = histories(m, n)
    shape, states = p_d.shape, len(detections)
    p_d, miss = (np.ascontiguousarray(a.reshape(-1, shape[-1]).T) for a in (p_d, miss))
    p, left = np.empty(p_d.shape), np.empty(p_d.shape)
    block = max(64, CHAIN_BLOCK // states)
    for start in range(0, p_d.shape[1], block):
        rows = slice(start, start + block)
        _chain(p_d[:, rows], miss[:, rows], detections, m, n, p[:, rows], left[:, rows])
    return p.T.reshape(shape), left.T.reshape(shape)


def _chain(
    p_d: FloatArray,
    miss: FloatArray,
    detections: NDArray[np.intp],
    m: int,
    n: int,
    p: FloatArray,
    left: FloatArray,
) -> None:
    """Write T and 1 − T (K, rows) of one block of rows."""
    one_short = np.flatnonzero(detections == m - 1)
    weight = np.zeros((len(detections), p_d.shape[1]))
    weight[0] = 1.0
    total, unseen = np.zeros(p_d.shape[1]), 0
    rest = weight.sum(axis=0)
    for k, (hit, missed) in enumerate(zip(p_d, miss, strict=True)):
        unseen = 0 if hit.any() else unseen + 1
        if unseen < n:  # after n looks that cannot detect, the history is empty already
            total = total + hit * weight[one_short].sum(axis=0)
            weight = _advanced(weight, hit, missed, detections, m)
            rest = weight.sum(axis=0)
        p[k], left[k] = total, rest


def m_of_n_gradient(
    p_d: FloatArray, miss: FloatArray, m: int, n: int, ends: NDArray[np.intp]
) -> FloatArray:
    """Partials (E, K) of T at looks `ends` (E,) for P_D of each look (K,).

    Forwards goes the probability of every history before look j, backwards the probability of
    success by a look of `ends` from every history after it. The partial is the difference that a
    detection at j makes to it. Where success is likely, the probability of failure goes backwards,
    because a difference of two numbers near 1 would lose digits.
    """
    detections = histories(m, n)
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


def histories(m: int, n: int) -> NDArray[np.intp]:
    """Number of detections in each history of the last n − 1 looks, the latest the lowest bit.

    Raises:
        ValueError: If m or n is out of range.
    """
    if not 1 <= m <= n <= MAX_WINDOW:
        raise ValueError(f"m of n must have 1 <= m <= n <= {MAX_WINDOW}, got {m} of {n}")
    return np.array([state.bit_count() for state in range(2 ** (n - 1))])


def _groups(
    scan_group: NDArray[np.intp],
) -> list[tuple[NDArray[np.bool_], NDArray[np.intp]]]:
    """For each scan group: its looks (K,), and the place of its latest by each look (K,), or −1."""
    return [
        (mine, np.cumsum(mine) - 1) for mine in (scan_group == g for g in np.unique(scan_group))
    ]


def _sum_over(slope: FloatArray, by_radar: FloatArray) -> FloatArray:
    """Sum slope (k, K) times partials (K, 4m) over the looks; 0 · NaN is 0 for a later look."""
    total: FloatArray = np.einsum("kj,ji->ki", slope, np.nan_to_num(by_radar))
    unknown = np.maximum.accumulate(np.isnan(by_radar), axis=0)
    return np.where(unknown, np.nan, total)


def _advanced(
    weight: FloatArray, p_d: FloatArray, miss: FloatArray, detections: NDArray[np.intp], m: int
) -> FloatArray:
    """Probability of each history (states, ...) one look later, without success so far."""
    states = len(detections)
    if states == 1:  # m = n = 1: nothing to remember, and any detection is success
        return weight * miss
    going_on = weight.copy()
    going_on[detections >= m - 1] = 0.0
    later = np.empty_like(weight)
    # The oldest outcome, the highest bit, is forgotten; the new one becomes the lowest.
    later[0::2] = (weight[: states // 2] + weight[states // 2 :]) * miss
    later[1::2] = (going_on[: states // 2] + going_on[states // 2 :]) * p_d
    return later
