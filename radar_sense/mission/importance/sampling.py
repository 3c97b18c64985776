"""Importance sampling of a mission: all replicates, and the bounds from their quantiles."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from radar_sense.mission.cumulative import Cumulative, cumulative_p_d
from radar_sense.mission.importance.events import MissionEvents
from radar_sense.mission.importance.plan import make_plan
from radar_sense.mission.importance.quantiles import MIDDLE, WeightedStatistics, pooled_quantile
from radar_sense.mission.importance.replicates import compute_replicate
from radar_sense.mission.schedule import Schedule
from radar_sense.mission.tracks import any_group
from radar_sense.montecarlo.parallel import all_in_order
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray

#: Independent replicates. The standard error of a standard error is a quarter of it.
REPLICATES = 8


def importance_sampling(
    scenario: Scenario,
    schedule: Schedule,
    m_of_n: tuple[int, int] | None = None,
    *,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> list[tuple[Cumulative, ...]]:
    """Return the probability of detection, and of a track, by each time.

    The first entry is the network's. The entries of its single radars follow. A scenario of one
    radar has one entry.

    Args:
        scenario: The scenario, with a pose for each of K times.
        schedule: Its looks.
        m_of_n: m and n of a track; None for detection alone.
        workers: Threads to compute with. The result does not depend on their number.
        progress: Called with 1 after each of `REPLICATES` replicates.
    """
    events = MissionEvents.of(scenario, schedule, m_of_n)
    plan, clock = make_plan(events)
    replicates = all_in_order(partial(compute_replicate, plan), REPLICATES, workers, progress)
    nodes = plan.events.nodes

    def bounds(source: int, nominal: tuple[FloatArray, ...]) -> tuple[Cumulative, ...]:
        return tuple(
            _bounds(p, [r[source][event] for r in replicates], nodes, clock)
            for event, p in enumerate(nominal)
        )

    cumulatives = [bounds(0, _nominal(scenario, schedule, m_of_n))]
    for i, radar in enumerate(events.radars if len(events.radars) > 1 else ()):
        radar_schedule, times = schedule.of_radar(i)
        latest = np.searchsorted(times, np.arange(len(schedule.time)), side="right") - 1
        nominal = _nominal(radar.at_poses(times), radar_schedule, m_of_n)
        of_radar = bounds(i + 1, tuple(p[latest] for p in nominal))
        # The probability is constant between two looks of a radar; interpolated bounds are not.
        cumulatives.append(tuple(event.at(times[latest]) for event in of_radar))
    return cumulatives


def _nominal(
    scenario: Scenario, schedule: Schedule, m_of_n: tuple[int, int] | None
) -> tuple[FloatArray, ...]:
    """Return P (K,) of detection, and of a track, by each time with the nominal states."""
    p_d = schedule.p_d(scenario)
    p_by_event = [cumulative_p_d(p_d)]
    if m_of_n is not None:
        p_by_event.append(any_group(p_d, 1.0 - p_d, *m_of_n, schedule.scan_group)[0])
    return tuple(p[schedule.last] for p in p_by_event)


def _bounds(
    nominal: FloatArray,
    replicates: Sequence[WeightedStatistics],
    nodes: NDArray[np.intp],
    clock: FloatArray,
) -> Cumulative:
    """Return moments, bounds and standard errors (K,) from the statistics of replicates."""
    means, variances, lowers, uppers, spreads = (
        np.array(values) for values in zip(*replicates, strict=True)
    )
    mean, spread = means.mean(axis=0), spreads.mean(axis=0)
    std = np.sqrt(variances.mean(axis=0) + means.var(axis=0))
    lower, upper = pooled_quantile(lowers), -pooled_quantile(-uppers)
    errors = (
        tails[:, MIDDLE].std(axis=0, ddof=1) / math.sqrt(len(replicates))
        for tails in (lowers, uppers)
    )
    # A spread within rounding is no uncertainty.
    certain = spread <= 1e-12 * mean
    p = nominal[nodes]
    mean, lower, upper = (
        np.interp(clock, clock[nodes], np.where(certain, p, v)) for v in (mean, lower, upper)
    )
    std, lower_se, upper_se = (
        np.interp(clock, clock[nodes], np.where(certain, 0.0, v)) for v in (std, *errors)
    )
    certain_at_all = np.interp(clock, clock[nodes], certain) == 1.0
    p = np.maximum.accumulate(nominal)
    # Each draw grows with time, as do mean and quantiles. The accumulation removes rounding errors.
    mean, lower, upper = (
        np.maximum.accumulate(np.where(certain_at_all, p, v)) for v in (mean, lower, upper)
    )
    return Cumulative(p, mean, std, lower, upper, lower_se, upper_se)
