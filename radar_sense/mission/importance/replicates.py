"""One replicate of importance sampling: draws of all radars, combined for each pose path."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sense.mission.importance.combinations import combine
from radar_sense.mission.importance.events import draw_radars
from radar_sense.mission.importance.mixtures import (
    sobol_normals,
)
from radar_sense.mission.importance.plan import Plan, RadarUnit
from radar_sense.mission.importance.quantiles import WeightedStatistics, weighted_statistics
from radar_sense.states import AIRCRAFT, FloatArray
from radar_sense.streams import Stream, random_stream

#: Combinations of the radars of one scan group for each draw. Each one takes a Markov chain.
GROUP_COMBINATIONS = 2
#: Combinations of scan groups in a replicate. These only take sums.
COMBINATIONS = 16_384


@dataclass(frozen=True, eq=False)
class WeightedDraws:
    """Weighted draws of events at J times, for each of p pose paths.

    Attributes:
        log_miss: −ln(1 − P) (p, draws, J) of each event.
        weight: Ratio of the densities (p, draws), without the weight of the pose path.
    """

    log_miss: tuple[FloatArray, ...]
    weight: FloatArray

    @property
    def final(self) -> FloatArray:
        """−ln(1 − P) (p, draws) of detection by the last time."""
        return self.log_miss[0][..., -1]


def compute_replicate(plan: Plan, number: int) -> list[tuple[WeightedStatistics, ...]]:
    """Return the statistics of each event, of all radars and of each radar."""
    events = plan.events
    generator = random_stream(events.scenario.seed, Stream.MISSION_PATHS, number)
    poses, path_weight = _draw_poses(plan, generator, number)
    hazards: dict[int, FloatArray] = {}
    weights: dict[int, FloatArray] = {}
    for u, unit in enumerate(plan.units):
        states, weight = _draw_radars(plan, unit, number, u)
        for place, radar in enumerate(unit.radars):
            hazards[radar] = events.hazard(radar, poses, states[:, :, place])
            weights[radar] = weight
    by_radar = [
        WeightedDraws(events.of_radar(radar, hazards[radar]), weights[radar])
        for radar in range(len(events.radars))
    ]
    groups = [
        _combine_group(plan, generator, members, hazards, by_radar)
        for members in events.schedule.radars
    ]
    emphasis = [plan.emphasis[list(members)].sum() for members in events.schedule.radars]
    network = _combine_groups(plan, generator, groups, np.array(emphasis))
    return [
        tuple(
            weighted_statistics(
                -np.expm1(-log_miss.reshape(-1, log_miss.shape[-1])),
                (path_weight[:, np.newaxis] * draws.weight).ravel(),
            )
            for log_miss in draws.log_miss
        )
        for draws in (network, *(by_radar if len(by_radar) > 1 else ()))
    ]


def _draw_poses(
    plan: Plan, generator: np.random.Generator, number: int
) -> tuple[FloatArray, FloatArray]:
    """Draw poses (K, paths, 6) and their weights (paths,)."""
    times, directions = len(plan.process.aircraft), plan.pose_directions
    normals = generator.standard_normal((times * len(AIRCRAFT), plan.paths))
    along = sobol_normals(
        plan.paths,
        directions.dimensions,
        1,
        plan.events.scenario.seed,
        Stream.MISSION_POSES,
        number,
    )
    weight = directions.draw(normals, along)
    return plan.process.poses(normals.reshape(times, len(AIRCRAFT), plan.paths)), weight


def _draw_radars(plan: Plan, unit: RadarUnit, number: int, u: int) -> tuple[FloatArray, FloatArray]:
    """Draw states (paths, draws, radars, 4 to 6) and weights (paths, draws) of a unit."""
    runs = plan.paths * plan.draws
    stream = (plan.events.scenario.seed, Stream.MISSION_RADARS, number, u)
    points = sobol_normals(runs, 1 + unit.sampler.radar_normals, plan.draws, *stream)
    normals, weight = unit.mixture.draw(points)
    states = draw_radars(unit.sampler, normals)
    shape = plan.paths, plan.draws
    return states.reshape(*shape, *states.shape[1:]), weight.reshape(shape)


def _combine_group(
    plan: Plan,
    generator: np.random.Generator,
    members: tuple[int, ...],
    hazards: Mapping[int, FloatArray],
    by_radar: Sequence[WeightedDraws],
) -> WeightedDraws:
    """Combine the radars of one scan group, which look together."""
    if len(members) == 1:
        return by_radar[members[0]]
    weights = [by_radar[radar].weight for radar in members]
    if plan.independent:
        picks, weight = combine(
            generator,
            weights,
            [by_radar[radar].final for radar in members],
            plan.emphasis[list(members)],
            GROUP_COMBINATIONS * plan.draws,
        )
    else:
        draws = np.broadcast_to(np.arange(plan.draws), weights[0].shape)
        picks, weight = [draws] * len(members), weights[0]
    detection = _sum_of_picks((by_radar[i].log_miss[0] for i in members), picks)
    if plan.events.m_of_n is None:
        return WeightedDraws((detection,), weight)
    hazard = _sum_of_picks((hazards[i] for i in members), picks)
    return WeightedDraws((detection, plan.events.track(members[0], hazard)), weight)


def _combine_groups(
    plan: Plan,
    generator: np.random.Generator,
    groups: Sequence[WeightedDraws],
    emphasis: FloatArray,
) -> WeightedDraws:
    """Combine the scan groups of the network by adding up their −ln(1 − P)."""
    if len(groups) == 1:
        return groups[0]
    log_miss_by_event = zip(*(group.log_miss for group in groups), strict=True)
    if not plan.independent:
        return WeightedDraws(
            tuple(sum(parts, start=np.zeros(())) for parts in log_miss_by_event), groups[0].weight
        )
    picks, weight = combine(
        generator,
        [group.weight for group in groups],
        [group.final for group in groups],
        emphasis,
        max(COMBINATIONS // plan.paths, 2 * plan.draws),
    )
    return WeightedDraws(tuple(_sum_of_picks(parts, picks) for parts in log_miss_by_event), weight)


def _sum_of_picks(values: Iterable[FloatArray], picks: Sequence[NDArray[np.intp]]) -> FloatArray:
    """Sum, over the sources, the picked draws of each source (p, combinations, ...)."""
    paths = np.arange(len(picks[0]))[:, np.newaxis]
    return sum(
        (of_source[paths, pick] for of_source, pick in zip(values, picks, strict=True)),
        start=np.zeros(()),
    )
