"""The plan of importance sampling: nodes, directions and numbers of draws."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sense.covariance import block_diagonal
from radar_sense.mission.cumulative import density, inverse_mills
from radar_sense.mission.draws import PoseProcess
from radar_sense.mission.importance.events import MissionEvents
from radar_sense.mission.importance.mixtures import DISTANCE, NEGLIGIBLE, Directions, Mixture
from radar_sense.mission.importance.pilot import Pilot, PilotStatistics
from radar_sense.mission.looks import pose_slopes
from radar_sense.mission.tracks import any_group_gradient
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.states import AIRCRAFT, RADAR, FloatArray

#: Draws of each radar in a replicate: a power of two, chosen by the work of all looks of a draw.
#: The limit is higher for a track, whose distribution has longer tails than P_c.
MIN_DRAWS, MAX_DETECTION_DRAWS, MAX_TRACK_DRAWS = 256, 4096, 8192
DETECTION_WORK, TRACK_WORK = 4e6, 1.5e7
#: Number of histories at which half of the draws are made. Tracks of many looks have long tails and
#: need many draws, although their Markov chain takes longer.
HISTORIES = 256
#: Draws of each radar for one pose path, if several radars are combined. Where the pose errors have
#: more than LARGE_POSE_SHARE of the variance, more pose paths with fewer draws are better.
DRAWS_PER_PATH, FEWER_DRAWS_PER_PATH, LARGE_POSE_SHARE = 16, 4, 0.1
#: Bounds are computed at all times, if these are ALL_TIMES or fewer. Else bounds are interpolated
#: between about NODES times.
ALL_TIMES, NODES = 512, 384
#: Times that the mixtures of the radars, and of the pose path, are chosen for.
RADAR_TIMES, POSE_TIMES = 96, 24
#: Shares of the natural and of the wide component in the mixtures of the radars and the pose path.
RADAR_SHARES, POSE_SHARES = (0.5, 0.1), (0.75, 0.07)


@dataclass(frozen=True, eq=False)
class RadarUnit:
    """Radars whose errors are drawn together: one radar, or all radars if they are correlated.

    An uncertain RCS correlates all radars.

    Attributes:
        radars: The radars.
        sampler: Draws the radar states.
        mixture: Mixture that the normals are drawn from.
    """

    radars: tuple[int, ...]
    sampler: Sampler
    mixture: Mixture


@dataclass(frozen=True, eq=False)
class Plan:
    """The inputs that all replicates share.

    Attributes:
        events: The events of the mission, at the nodes.
        process: The process of the pose errors.
        pose_directions: Directions of the pose path (6K, j).
        units: Radars whose errors are drawn together.
        emphasis: Share of each radar's standard deviation in the standard deviation of P (m,).
        paths: Pose paths of a replicate.
        draws: Draws of each unit for one pose path.
    """

    events: MissionEvents
    process: PoseProcess
    pose_directions: Directions
    units: tuple[RadarUnit, ...]
    emphasis: FloatArray
    paths: int
    draws: int

    @property
    def independent(self) -> bool:
        """Whether the errors of each radar are drawn separately."""
        return len(self.units) == len(self.events.radars)


def make_plan(events: MissionEvents) -> tuple[Plan, FloatArray]:
    """Choose nodes, directions and numbers of draws.

    Returns:
        The plan, and the clock (K,) that bounds are interpolated along.
    """
    count, members, process = len(events.radars), _members(events), _pose_process(events)
    pilots = [Pilot.draw(events, radars, sampler, u) for u, (radars, sampler) in enumerate(members)]
    clock = _clock(events.schedule.time, pilots)
    nodes = _nodes(clock)
    times = _some_of(nodes, POSE_TIMES)
    pose_slope = _pose_slopes(events, process, times)
    pose_variance = np.sum(pose_slope * pose_slope, axis=1)
    pilot_statistics = [pilot.statistics(times) for pilot in pilots]
    radar_variance = _radar_variance(pilot_statistics)
    total = radar_variance.sum(axis=0) + pose_variance
    floored = np.maximum(total, NEGLIGIBLE**2)
    spread = np.max([s.spread for s in pilot_statistics], axis=0) + 6.0 * np.sqrt(pose_variance)
    pose_directions = Directions.of(
        pose_slope / np.sqrt(floored)[:, np.newaxis], spread, *POSE_SHARES
    )
    units = [
        RadarUnit(radars, sampler, _mixture(pilot.statistics(_some_of(nodes, RADAR_TIMES))))
        for (radars, sampler), pilot in zip(members, pilots, strict=True)
    ]
    uncertain = total > NEGLIGIBLE**2
    share = np.max(radar_variance[:, uncertain] / total[uncertain], axis=1, initial=0.0)
    per_path = 1
    if len(units) > 1:
        pose_share = np.sum(spread * pose_variance / floored) / max(np.sum(spread), NEGLIGIBLE)
        large = pose_share > LARGE_POSE_SHARE
        per_path = FEWER_DRAWS_PER_PATH if large else DRAWS_PER_PATH
    plan = Plan(
        events=dataclasses.replace(events, nodes=nodes),
        process=process,
        pose_directions=pose_directions,
        units=tuple(units),
        emphasis=share + 0.05 if len(units) == count else np.ones(count),
        paths=_draws(events) // per_path,
        draws=per_path,
    )
    return plan, clock


def _some_of(nodes: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """Return about `count` of the nodes, at equal distances."""
    chosen = np.unique(np.linspace(0, len(nodes) - 1, count).round().astype(int))
    some: NDArray[np.intp] = nodes[chosen]
    return some


def _mixture(statistics: PilotStatistics) -> Mixture:
    """Return the mixture of a unit's normals, as if the unit had all of the variance of P.

    The bounds of a single radar come from the same draws as the bounds of the network.
    """
    targets = DISTANCE * statistics.directions.reshape(-1, statistics.directions.shape[-1])
    return Mixture.of(targets, np.tile(statistics.spread, 2), *RADAR_SHARES)


def _members(events: MissionEvents) -> list[tuple[tuple[int, ...], Sampler]]:
    """Return the radars that are drawn together, with their sampler."""
    scenario, count, size = events.scenario, len(events.radars), len(RADAR)
    covariance = scenario.cov_radar[scenario.level]
    states = [slice(size * i, size * (i + 1)) for i in range(count)]
    independent = np.array_equal(covariance, block_diagonal([covariance[s, s] for s in states]))
    if independent and not scenario.rcs_std:
        return [((i,), Sampler.of(radar)) for i, radar in enumerate(events.radars)]
    return [(tuple(range(count)), Sampler.of(scenario))]


def _radar_variance(pilot_statistics: Sequence[PilotStatistics]) -> FloatArray:
    """Return the variance of the network's P (units, e) from the errors of each unit."""
    # 1 − P of the network is a product over the units.
    misses = [statistics.miss for statistics in pilot_statistics]
    return np.array(
        [
            statistics.variance * np.prod(misses[:u] + misses[u + 1 :], axis=0) ** 2
            for u, statistics in enumerate(pilot_statistics)
        ]
    )


def _draws(events: MissionEvents) -> int:
    """Return the draws of each radar in a replicate, by the work of a draw."""
    affordable = DETECTION_WORK / sum(map(len, events.looks))
    most = MAX_DETECTION_DRAWS
    if events.m_of_n is not None:
        most = MAX_TRACK_DRAWS
        histories = 2 ** (events.m_of_n[1] - 1)
        affordable *= TRACK_WORK / DETECTION_WORK / (1.0 + histories / HISTORIES)
    return int(2 ** int(np.log2(np.clip(affordable, MIN_DRAWS, most))))


def _clock(time: FloatArray, pilots: Sequence[Pilot]) -> FloatArray:
    """Return a clock (K,) that runs with time, and faster where P grows in a draw of a pilot.

    Nodes at equal steps of the clock are close to each other where a bound may rise.
    """
    since_start = time - time[0]
    clock: FloatArray = since_start / max(since_start[-1], 1e-300)
    for pilot in pilots:
        for event in pilot.log_miss:
            clock = clock - np.expm1(-event.max(axis=0)) - np.expm1(-event.mean(axis=0))
    return clock


def _nodes(clock: FloatArray) -> NDArray[np.intp]:
    """Return the times, 0 to K − 1, that bounds are computed at."""
    if len(clock) <= ALL_TIMES:
        return np.arange(len(clock))
    even = np.linspace(clock[0], clock[-1], NODES)
    return np.unique(np.minimum(np.searchsorted(clock, even), len(clock) - 1))


def _pose_process(events: MissionEvents) -> PoseProcess:
    """Return the process of the pose errors at the K times."""
    scenario = events.scenario
    return PoseProcess.of(
        events.schedule.time, scenario.aircraft, scenario.cov_aircraft, scenario.correlation_s
    )


def _pose_slopes(
    events: MissionEvents, process: PoseProcess, times: NDArray[np.intp]
) -> FloatArray:
    """Return slopes (e, 6K) of the events at some times for the normals of the pose path."""
    scenario, schedule = events.scenario, events.schedule
    pose = schedule.pose
    covariance = scenario.cov_aircraft
    looks = schedule.linearize(scenario)
    slopes = pose_slopes(looks, covariance if covariance.ndim == 2 else covariance[pose])
    last = schedule.last[times]
    miss = np.exp(-np.cumsum(looks.hazard))[last, np.newaxis]
    past = np.arange(len(pose)) <= last[:, np.newaxis]
    by_look = [np.where(past, miss * inverse_mills(looks.probit), 0.0)]
    if events.m_of_n is not None:
        p_d = looks.p_d
        by_p = any_group_gradient(p_d, 1.0 - p_d, *events.m_of_n, schedule.scan_group, last)
        by_look.append(by_p * density(looks.probit))
    count = len(schedule.time)
    by_normals = np.zeros((len(last) * len(by_look), count, len(AIRCRAFT)))
    weights = np.nan_to_num(np.concatenate(by_look))
    for look, time in enumerate(pose):
        by_normals[:, time] += weights[:, look, np.newaxis] * np.nan_to_num(slopes[look])
    for k in range(count - 2, -1, -1):  # pose error k + 1 is ρ times pose error k, and new noise
        by_normals[:, k] += process.rho[k] * by_normals[:, k + 1]
    by_normals[:, 1:] *= process.innovation_std[:, np.newaxis]
    by_event: FloatArray = by_normals.reshape(len(by_normals), -1)
    return by_event
