"""The events of a mission: a detection by now, and a track by now.

Given P_D, looks are independent. The probability of a detection is P_c = 1 − Π (1 − P_D).

A track is m detections in n consecutive looks of one scan group. The outcomes of the last n − 1
looks are the state of a Markov chain, and success is its absorbing state (J. C. Fu and M. V.
Koutras, "Distribution theory of runs: a Markov chain approach", J. Amer. Statist. Assoc. 89, 1994).
The probability is therefore exact. Before look n the window has fewer looks.

Each scan group has its own window: a missed look of one group does not break the track of another
group. Given the states, the groups are independent. The probability of the network is therefore
T = 1 − Π (1 − T_g) over its groups.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from radar_sense.mission.schedule import Schedule
from radar_sense.model.fusion import either
from radar_sense.states import BLOCK, FloatArray, slices


def fuse(radars: Sequence[Sequence[int]], p_d: Sequence[FloatArray]) -> list[FloatArray]:
    """Return P_D (L, n) of the L looks of each scan group, from P_D of each radar (L, n)."""
    return [reduce(either, (p_d[radar] for radar in group)) for group in radars]


def detection_by_time(
    schedule: Schedule, p_d: Sequence[FloatArray], times: NDArray[np.intp]
) -> FloatArray:
    """Return the probability (T, n) of a detection by some times, with no possible one between.

    Each scan group has its P_D (L, n). The times, 0 to K − 1 (T,), increase.
    """
    p_c = p_d_by_time(schedule, p_d, times)
    for before, now in pairwise(p_c):
        now += (1.0 - now) * before
    return p_c


def p_d_by_time(
    schedule: Schedule, p_d: Sequence[FloatArray], times: NDArray[np.intp]
) -> FloatArray:
    """Return P_D (T, n) of all looks at some times, from P_D of each scan group (L, n)."""
    by_time = np.zeros((len(times), *p_d[0].shape[1:]))
    for group, of_group in enumerate(p_d):
        look = schedule.looks[times, group]
        rows = schedule.latest(group)[times[look]]
        by_time[look] = either(by_time[look], of_group[rows])
    return by_time


def track_by_time(
    schedule: Schedule, tracks: Sequence[FloatArray], times: NDArray[np.intp]
) -> FloatArray:
    """Return the probability (T, n) of a track by some times, from that of each group (L, n)."""
    by_group = (t[schedule.latest(group)[times]] for group, t in enumerate(tracks))
    return reduce(either, by_group)


def event_probabilities(
    schedule: Schedule, p_d: Sequence[FloatArray], window: tuple[int, int] | None
) -> list[FloatArray]:
    """Return the probability by each time (K, n) of a detection, and of a track of m of n looks.

    P_D is that of each radar (L, n).
    """
    groups, times = fuse(schedule.radars, p_d), np.arange(len(schedule.time))
    events = [detection_by_time(schedule, groups, times)]
    if window is not None:
        tracks = [m_of_n_track(p, *window) for p in groups]
        events.append(track_by_time(schedule, tracks, times))
    return events


def m_of_n_track(p_d: FloatArray, m: int, n: int) -> FloatArray:
    """Return the probability (L, n) of m of n looks by each look, from P_D (L, n).

    It is a sum without cancellation, accurate to a relative rounding error.

    Args:
        p_d: P_D of each look.
        m: Detections needed, 1 to n.
        n: Length of the window of consecutive looks, in `limits.WINDOW`.
    """
    # bit 0 of a history of the last n − 1 looks is the latest look
    detections = np.array([state.bit_count() for state in range(2 ** (n - 1))])
    p = np.empty(p_d.shape)
    for rows in slices(p_d.shape[1], max(64, BLOCK // len(detections))):
        _chain(p_d[:, rows], detections, m, n, p[:, rows])
    # a sum of rounded terms may exceed 1 by its rounding error
    return np.minimum(p, 1.0, out=p)


def _chain(p_d: FloatArray, detections: NDArray[np.intp], m: int, n: int, p: FloatArray) -> None:
    """Write the probability (L, rows) of one block of rows."""
    one_short = np.flatnonzero(detections == m - 1)
    weight = np.zeros((len(detections), p_d.shape[1]))
    weight[0] = 1.0
    total, unseen = np.zeros(p_d.shape[1]), 0
    for k, hit in enumerate(p_d):
        unseen = 0 if hit.any() else unseen + 1
        if unseen < n:  # after n looks without a possible detection the history is empty
            total += hit * weight[one_short].sum(axis=0)
            weight = _advanced(weight, hit, one_short)
        p[k] = total


def _advanced(weight: FloatArray, hit: FloatArray, one_short: NDArray[np.intp]) -> FloatArray:
    """Return the probability of each history (states, n) one look of P_D (n,) later, unsuccessful.

    The probabilities before are overwritten. `one_short` are the histories that a detection makes a
    success.
    """
    half, later = len(weight) // 2, np.empty_like(weight)
    if not half:  # m = n = 1: any detection is success
        return weight * (1.0 - hit)
    # The oldest outcome, the highest bit, drops out. The new outcome is the lowest bit.
    np.multiply(weight[:half] + weight[half:], 1.0 - hit, out=later[0::2])
    weight[one_short] = 0.0
    np.multiply(weight[:half] + weight[half:], hit, out=later[1::2])
    return later
