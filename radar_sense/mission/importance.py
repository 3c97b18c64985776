"""Importance sampling of missions: bounds of P_c and of track initiation that need no gradient.

What makes 3σ bounds cheap here:

- Given the pose errors, radars are independent. ln(1 − P_c) is a sum over radars, and ln(1 − T) is
  a sum over scan groups. So the errors of each radar are drawn by themselves, for a number of pose
  paths. For each pose path, draws of different radars are combined at random. A combination takes
  no evaluation of the detection model.
- The normals are widened along the directions that P depends on most, so that draws in the tails
  are frequent. Each draw has the ratio of the densities as its weight. Directions and widths are
  found by first order, and by a pilot. They change the standard error, and not the mean
  of the estimate (A. B. Owen, *Monte Carlo theory, methods and examples*, 2013, ch. 9).
- The widened normals are scrambled Sobol' points.

Everything is done in `REPLICATES` independent replicates. The spread of the replicates' quantiles
gives the standard errors of the bounds.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from radar_sense.covariance import block_diagonal
from radar_sense.mission.cumulative import Cumulative, cumulative_p_d, density, inverse_mills
from radar_sense.mission.draws import PoseProcess
from radar_sense.mission.looks import linearize_looks, pose_slopes
from radar_sense.mission.schedule import Schedule
from radar_sense.mission.tracks import any_group, any_group_gradient, m_of_n
from radar_sense.montecarlo.montecarlo import TAIL
from radar_sense.montecarlo.parallel import in_order
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.montecarlo.sequences import random_stream
from radar_sense.scenario import Scenario, single_radar_scenarios
from radar_sense.states import AIRCRAFT, RADAR, FloatArray

#: Independent replicates. The standard error of a standard error is a quarter of it.
REPLICATES = 8
#: Draws of each radar in a replicate: a power of two, by the work that all looks of a draw take. A
#: track has longer tails than detection.
MIN_DRAWS, MAX_DETECTION_DRAWS, MAX_TRACK_DRAWS = 256, 4096, 8192
DETECTION_WORK, TRACK_WORK = 4e6, 1.5e7
#: Histories of a track whose Markov chain takes as long as P_D does.
HISTORIES = 32
#: Draws of each radar for one pose path, where there are several radars to combine: fewer, and more
#: pose paths, where the pose errors have more than this share of the variance.
DRAWS_PER_PATH, FEWER_DRAWS_PER_PATH, LARGE_POSE_SHARE = 16, 4, 0.1
#: Combinations of the radars of one scan group for each draw, each of which takes a Markov chain.
GROUP_COMBINATIONS = 2
#: Combinations of scan groups in a replicate, which take sums alone.
COMBINATIONS = 16_384
#: Share of the combinations that is drawn without an emphasis on any radar.
NATURAL = 0.2
#: A direction with a share of the variance is widened to 1 + WIDENING · share^WIDENING_POWER.
WIDENING, WIDENING_POWER = 1.2, 0.35
#: Directions of a radar, or of the pose path, that are widened: at most so many, each with this
#: share of the variance or more.
MAX_DIRECTIONS, MIN_SHARE = 6, 0.01
#: Draws of a pilot, their width, and the probability of the tails that directions point to.
PILOT_DRAWS, PILOT_WIDTH, PILOT_TAIL = 1024, 1.8, float(ndtr(-2.5))
#: Times that bounds are computed at. With more times they are interpolated between these.
NODES = 384
#: Times that directions are chosen for.
ENDS = 24
#: As many draws are sorted as a whole; of more, the tails alone are sorted.
SORTED = 1024
#: A standard deviation of P that is too small to be of interest when directions are chosen.
NEGLIGIBLE = 1e-4

#: Branches of a seed's streams.
_PILOT, _PATHS, _POSES, _RADARS = 101, 102, 103, 104


@dataclass(frozen=True, eq=False)
class Directions:
    """Directions in a space of unit normals that are drawn wider.

    Attributes:
        vectors: Orthonormal columns (d, j).
        widths: Standard deviation along each (j,).
    """

    vectors: FloatArray
    widths: FloatArray

    @classmethod
    def of(cls, slopes: FloatArray, spread: FloatArray) -> Directions:
        """Choose directions for events.

        Args:
            slopes: Vectors (e, d) along which P changes; their squares are shares of its variance.
            spread: How far apart the bounds of each event are, about (e,).
        """
        # an event counts in proportion to its spread, so that rare events count little
        scaled = slopes * np.sqrt(np.where(spread > NEGLIGIBLE, spread, 0.0))[:, np.newaxis]
        if not scaled.any():
            return cls(np.zeros((slopes.shape[1], 0)), np.zeros(0))
        # principal directions by way of the small matrix (e, e), as d may be tens of thousands
        squares, mix = np.linalg.eigh(np.einsum("ed,fd->ef", scaled, scaled))
        share = np.minimum(squares[::-1] / np.sum(spread[spread > NEGLIGIBLE]), 1.0)
        share = share[:MAX_DIRECTIONS][share[:MAX_DIRECTIONS] > MIN_SHARE]
        vectors = np.einsum("ej,ed->jd", mix[:, ::-1][:, : len(share)], scaled)
        vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
        largest = np.argmax(abs(vectors), axis=1)  # the sign of an eigenvector is arbitrary
        vectors *= np.sign(vectors[np.arange(len(vectors)), largest])[:, np.newaxis]
        return cls(vectors.T, 1.0 + WIDENING * share**WIDENING_POWER)

    def widen(self, normals: FloatArray, along: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Replace unit normals (d, runs) along the directions; return them and weights (runs,).

        Args:
            normals: Unit normals, overwritten.
            along: Unit normals (j, runs) to widen.
        """
        old = np.einsum("dj,dr->jr", self.vectors, normals)
        widths = self.widths[:, np.newaxis]
        for vector, change in zip(self.vectors.T, widths * along - old, strict=True):
            normals += vector[:, np.newaxis] * change
        log_weight = np.log(widths) - 0.5 * (widths * widths - 1.0) * along * along
        return normals, np.exp(log_weight.sum(axis=0))


@dataclass(frozen=True, eq=False)
class Weighted:
    """Weighted draws of events at J times, for each of p pose paths.

    Attributes:
        log_miss: For each event its −ln(1 − P) (p, draws, J).
        weight: Ratio of the densities (p, draws), without the weight of the pose path.
    """

    log_miss: tuple[FloatArray, ...]
    weight: FloatArray


@dataclass(frozen=True, eq=False)
class _Unit:
    """Radars whose errors are drawn together: one radar, or all radars if they are correlated.

    An error of the RCS, which all radars share, correlates them.
    """

    radars: tuple[int, ...]
    sampler: Sampler
    directions: Directions

    def draw(self, runs: int, together: int, *stream: int) -> tuple[FloatArray, FloatArray]:
        """Draw states (runs, radars, 4 to 6) and weights (runs,), even over `together` in a row."""
        j, d = len(self.directions.widths), self.sampler.radar_normals
        points = _sobol_normals(runs, j + d, together, *stream).T
        normals, weight = self.directions.widen(np.ascontiguousarray(points[j:]), points[:j])
        return self.states(normals.T), weight

    def states(self, normals: FloatArray) -> FloatArray:
        """Radar states (runs, radars, 4 to 6) from unit normals (runs, d)."""
        return _drawn_states(self.sampler, normals)


@dataclass(frozen=True, eq=False)
class _Problem:
    """A mission, and the times that its bounds are computed at.

    Attributes:
        scenario: The scenario, with a pose for each time.
        schedule: The looks.
        m_of_n: m and n of a track, if it is asked for.
        radars: The scenario of each radar by itself.
        looks: The times, 0 to K − 1, at which each radar looks.
        nodes: The times, 0 to K − 1, that bounds are computed at (J,); all of them at first.
    """

    scenario: Scenario
    schedule: Schedule
    m_of_n: tuple[int, int] | None
    radars: tuple[Scenario, ...]
    looks: tuple[NDArray[np.intp], ...]
    nodes: NDArray[np.intp]

    @classmethod
    def of(cls, scenario: Scenario, schedule: Schedule, m_of_n: tuple[int, int] | None) -> _Problem:
        """Take the scenario apart into its radars."""
        radars = tuple(single_radar_scenarios(scenario).values()) or (scenario,)
        groups = [schedule.group_of(i) for i in range(len(radars))]
        looks = tuple(np.flatnonzero(schedule.looks[:, group]) for group in groups)
        return cls(scenario, schedule, m_of_n, radars, looks, np.arange(len(schedule.time)))

    def hazard(self, radar: int, poses: FloatArray, states: FloatArray) -> FloatArray:
        """Hazard −ln(1 − P_D) of a radar's looks (p, draws, looks).

        Args:
            radar: The radar.
            poses: Aircraft states (K, p, 6).
            states: Radar states (p, draws, 4 to 6).
        """
        model, own = self.radars[radar].model, self.looks[radar]
        aircraft = np.moveaxis(poses[own], 0, 1)[:, np.newaxis]
        radars = states[:, :, np.newaxis]
        hazard = np.zeros((*states.shape[:2], len(own)))
        seen = np.flatnonzero(model.visible(aircraft, radars).any(axis=(0, 1, 3)))
        if len(seen):  # most looks of a long mission are beyond the range of a radar
            with np.errstate(divide="ignore"):  # P_D may round to 1
                hazard[..., seen] = -np.log1p(-model.p_d(aircraft[:, :, seen], radars))
        return hazard

    def detection(self, radar: int, hazard: FloatArray) -> FloatArray:
        """−ln(1 − P_c) (..., J) from the hazard (..., looks) of a radar."""
        return self._at_nodes(radar, np.cumsum(hazard, axis=-1))

    def track(self, radar: int, hazard: FloatArray) -> FloatArray:
        """−ln(1 − T) (..., J) from the hazard (..., looks) of a radar, or of its scan group."""
        assert self.m_of_n is not None
        p, left = m_of_n(-np.expm1(-hazard), np.exp(-hazard), *self.m_of_n)
        p, left = self._at_nodes(radar, p), self._at_nodes(radar, left, start=1.0)
        with np.errstate(divide="ignore"):
            return np.where(p < 0.5, -np.log1p(-np.minimum(p, 0.5)), -np.log(left))

    def events(self, radar: int, hazard: FloatArray) -> tuple[FloatArray, ...]:
        """−ln(1 − P) (..., J) of detection, and of a track if it is asked for."""
        detection = self.detection(radar, hazard)
        return (detection,) if self.m_of_n is None else (detection, self.track(radar, hazard))

    def _at_nodes(self, radar: int, values: FloatArray, start: float = 0.0) -> FloatArray:
        """Values (..., looks) after each look of a radar at the nodes (..., J)."""
        latest = np.searchsorted(self.looks[radar], self.nodes, side="right") - 1
        return np.where(latest >= 0, values[..., np.maximum(latest, 0)], start)


@dataclass(frozen=True, eq=False)
class _Plan:
    """All that the replicates share.

    Attributes:
        problem: The mission.
        process: The process of the pose errors.
        pose_directions: Directions of the pose path (6K, j).
        units: Radars whose errors are drawn together.
        emphasis: Share of each radar's standard deviation in the standard deviation of P (m,).
        paths: Pose paths of a replicate.
        draws: Draws of each unit for one pose path.
    """

    problem: _Problem
    process: PoseProcess
    pose_directions: Directions
    units: tuple[_Unit, ...]
    emphasis: FloatArray
    paths: int
    draws: int

    def replicate(self, number: int) -> list[tuple[FloatArray, ...]]:
        """Return `statistics` (5, J) of each event, of all radars and of each radar."""
        problem, seed = self.problem, self.problem.scenario.seed
        generator = random_stream(seed, _PATHS, number)
        poses, path_weight = self._draw_poses(generator, number)
        hazards: dict[int, FloatArray] = {}
        weights: dict[int, FloatArray] = {}
        for u, unit in enumerate(self.units):
            states, weight = unit.draw(
                self.paths * self.draws, self.draws, seed, _RADARS, number, u
            )
            states = states.reshape(self.paths, self.draws, *states.shape[1:])
            for place, radar in enumerate(unit.radars):
                hazards[radar] = problem.hazard(radar, poses, states[:, :, place])
                weights[radar] = weight.reshape(self.paths, self.draws)
        by_radar = [
            Weighted(problem.events(radar, hazards[radar]), weights[radar])
            for radar in range(len(problem.radars))
        ]
        groups = [
            self._group(generator, members, hazards, by_radar)
            for members in problem.schedule.radars
        ]
        emphasis = [self.emphasis[list(members)].sum() for members in problem.schedule.radars]
        network = self._network(generator, groups, np.array(emphasis))
        draws = [network, *(by_radar if len(by_radar) > 1 else ())]
        return [
            tuple(
                statistics(
                    -np.expm1(-event.reshape(-1, event.shape[-1])),
                    (path_weight[:, np.newaxis] * one.weight).ravel(),
                )
                for event in one.log_miss
            )
            for one in draws
        ]

    @property
    def independent(self) -> bool:
        """Whether the errors of each radar are drawn by themselves."""
        return len(self.units) == len(self.problem.radars)

    def _draw_poses(
        self, generator: np.random.Generator, number: int
    ) -> tuple[FloatArray, FloatArray]:
        """Draw poses (K, paths, 6) and their weights (paths,)."""
        looks, directions = len(self.process.aircraft), self.pose_directions
        normals = generator.standard_normal((looks * len(AIRCRAFT), self.paths))
        along = _sobol_normals(
            self.paths, len(directions.widths), 1, self.problem.scenario.seed, _POSES, number
        )
        normals, weight = directions.widen(normals, along.T)
        return self.process.poses(normals.reshape(looks, len(AIRCRAFT), self.paths)), weight

    def _group(
        self,
        generator: np.random.Generator,
        members: tuple[int, ...],
        hazards: dict[int, FloatArray],
        by_radar: Sequence[Weighted],
    ) -> Weighted:
        """Combine the radars of one scan group, whose looks are one look."""
        if len(members) == 1:
            return by_radar[members[0]]
        weights = [by_radar[radar].weight for radar in members]
        if self.independent:
            picks, weight = combine(
                generator, weights, self.emphasis[list(members)], GROUP_COMBINATIONS * self.draws
            )
        else:
            picks, weight = (
                [np.broadcast_to(np.arange(self.draws), weights[0].shape)] * len(members),
                weights[0],
            )
        rows = [(np.arange(self.paths)[:, np.newaxis], pick) for pick in picks]
        detection = sum(
            (by_radar[i].log_miss[0][row] for i, row in zip(members, rows, strict=True)),
            start=np.zeros(()),
        )
        if self.problem.m_of_n is None:
            return Weighted((detection,), weight)
        hazard = sum(
            (hazards[i][row] for i, row in zip(members, rows, strict=True)), start=np.zeros(())
        )
        return Weighted((detection, self.problem.track(members[0], hazard)), weight)

    def _network(
        self, generator: np.random.Generator, groups: Sequence[Weighted], emphasis: FloatArray
    ) -> Weighted:
        """Combine the scan groups, whose −ln(1 − P) add up."""
        if len(groups) == 1:
            return groups[0]
        events = zip(*(group.log_miss for group in groups), strict=True)
        if not self.independent:
            return Weighted(
                tuple(sum(parts, start=np.zeros(())) for parts in events), groups[0].weight
            )
        picks, weight = combine(
            generator,
            [group.weight for group in groups],
            emphasis,
            max(COMBINATIONS // self.paths, 2 * self.draws),
        )
        rows = [(np.arange(self.paths)[:, np.newaxis], pick) for pick in picks]
        return Weighted(
            tuple(
                sum((p[row] for p, row in zip(parts, rows, strict=True)), start=np.zeros(()))
                for parts in events
            ),
            weight,
        )


def combine(
    generator: np.random.Generator,
    weights: Sequence[FloatArray],
    emphasis: FloatArray,
    combinations: int,
) -> tuple[list[NDArray[np.intp]], FloatArray]:
    """Combine the draws of independent sources at random, for each pose path.

    A combination has an emphasis on one source, or on none. A source without emphasis is drawn in
    proportion to its weights, which is its own distribution. The source with emphasis is drawn
    uniformly, which is the widened distribution. The weight of a combination is the ratio of the
    densities for the mixture of all emphases (the balance heuristic: E. Veach and L. J. Guibas,
    "Optimally combining sampling techniques for Monte Carlo rendering", SIGGRAPH 1995).

    Args:
        generator: Makes the random choices.
        weights: Weights (p, draws) of each source.
        emphasis: How often each source has the emphasis, not normalized (sources,).
        combinations: Combinations for each pose path.

    Returns:
        For each source the draws taken (p, combinations), and weights (p, combinations).
    """
    paths = len(weights[0])
    shape = (paths, combinations)
    alpha = (1.0 - NATURAL) * emphasis / emphasis.sum()
    focus = np.searchsorted(np.cumsum(alpha), generator.random(shape), side="right")
    picks, mass, mixture = [], np.ones((paths, 1)), np.full(shape, NATURAL)
    for source, weight in enumerate(weights):
        draws = weight.shape[1]
        total = np.cumsum(weight, axis=1)
        level = generator.random(shape) * total[:, -1:]
        natural = np.sum(total[:, np.newaxis] <= level[..., np.newaxis], axis=-1)
        uniform = generator.permuted(
            np.broadcast_to(np.arange(combinations) % draws, shape), axis=1
        )
        pick = np.where(focus == source, uniform, np.minimum(natural, draws - 1))
        mean = total[:, -1:] / draws
        mass = mass * mean
        mixture += alpha[source] * mean / np.take_along_axis(weight, pick, axis=1)
        picks.append(pick)
    return picks, mass / mixture


def importance_sampling(
    scenario: Scenario,
    schedule: Schedule,
    m_of_n: tuple[int, int] | None = None,
    *,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> list[tuple[Cumulative, ...]]:
    """Return detection, and a track if m and n are given, by each time: of all radars, and of each.

    The single radars of a network follow the network. A scenario of one radar has one entry.

    Args:
        scenario: The scenario, with a pose for each of K times.
        schedule: Its looks.
        m_of_n: m and n, to have the probability of m-of-n too.
        workers: Threads to compute with; of no influence on the result.
        progress: Called with 1 after each of `REPLICATES` replicates.
    """
    problem = _Problem.of(scenario, schedule, m_of_n)
    plan, clock = _plan(problem)
    replicates = []
    for one in in_order(plan.replicate, REPLICATES, workers):
        replicates.append(one)
        if progress:
            progress(1)
    nodes = plan.problem.nodes

    def bounds(source: int, nominal: tuple[FloatArray, ...]) -> tuple[Cumulative, ...]:
        return tuple(
            _bounds(p, np.array([one[source][event] for one in replicates]), nodes, clock)
            for event, p in enumerate(nominal)
        )

    found = [bounds(0, _nominal(scenario, schedule, m_of_n))]
    for i, radar in enumerate(problem.radars if len(problem.radars) > 1 else ()):
        own, rows = schedule.of_radar(i)
        latest = np.searchsorted(rows, np.arange(len(schedule.time)), side="right") - 1
        nominal = tuple(p[latest] for p in _nominal(radar.part(rows), own, m_of_n))
        # between two looks of a radar nothing happens, though bounds are interpolated there
        found.append(tuple(event.at(rows[latest]) for event in bounds(i + 1, nominal)))
    return found


def _nominal(
    scenario: Scenario, schedule: Schedule, m_of_n: tuple[int, int] | None
) -> tuple[FloatArray, ...]:
    """P (K,) by each time of detection, and of a track, with the nominal states."""
    pose = schedule.pose
    p_d = schedule.model(scenario.model).p_d(scenario.aircraft[pose], scenario.radar)
    events = [cumulative_p_d(p_d)]
    if m_of_n is not None:
        events.append(any_group(p_d, 1.0 - p_d, *m_of_n, schedule.scan_group)[0])
    return tuple(p[schedule.last] for p in events)


def statistics(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Mean, variance, quantiles at Φ(−3) and Φ(3), and range (5, J) of values (draws, J).

    Args:
        values: Values.
        weights: Weights (draws,).
    """
    share = weights / weights.sum()
    mean = np.einsum("d,dj->j", share, values)
    variance = np.einsum("d,dj->j", share, (values - mean) ** 2)
    return np.array([mean, variance, *weighted_quantiles(values, weights), np.ptp(values, axis=0)])


def _bounds(
    nominal: FloatArray, replicates: FloatArray, nodes: NDArray[np.intp], clock: FloatArray
) -> Cumulative:
    """Moments, bounds and their standard errors (K,) from `statistics` of replicates (r, 5, J)."""
    mean, variance, lower, upper, spread = replicates.mean(axis=0)
    std = np.sqrt(variance + replicates[:, 0].var(axis=0))
    errors = replicates[:, 2:4].std(axis=0, ddof=1) / math.sqrt(len(replicates))
    # Where nothing is uncertain, rounding is no uncertainty.
    certain = spread <= 1e-12 * mean
    p = nominal[nodes]
    mean, lower, upper = (
        np.interp(clock, clock[nodes], np.where(certain, p, v)) for v in (mean, lower, upper)
    )
    std, lower_se, upper_se = (
        np.interp(clock, clock[nodes], np.where(certain, 0.0, v)) for v in (std, *errors)
    )
    known = np.interp(clock, clock[nodes], certain) == 1.0
    p = np.maximum.accumulate(nominal)
    # Each draw grows with time, and so do mean and quantiles; this is for the rounding.
    mean, lower, upper = (
        np.maximum.accumulate(np.where(known, p, v)) for v in (mean, lower, upper)
    )
    return Cumulative(p, mean, std, lower, upper, lower_se, upper_se)


def weighted_quantiles(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Quantiles (2, J) at Φ(−3) and Φ(3) of values (draws, J) with weights (draws,)."""
    columns, total = np.ascontiguousarray(values.T), weights.sum()
    lower = [_tail_quantile(column, weights, total) for column in columns]
    upper = [-_tail_quantile(-column, weights, total) for column in columns]
    return np.array([lower, upper])


def _tail_quantile(values: FloatArray, weights: FloatArray, total: float) -> float:
    """Quantile at Φ(−3) of values (draws,), of which only the smallest are sorted."""
    smallest: NDArray[np.intp] | slice = slice(None)
    if len(values) > SORTED:
        limit = np.partition(values, len(values) // 8)[len(values) // 8]
        some = np.flatnonzero(values <= limit)
        if weights[some].sum() > 2.0 * TAIL * total:
            smallest = some
    values, weights = values[smallest], weights[smallest]
    order = np.argsort(values, kind="stable")
    weights = weights[order]
    # a draw stands for its weight, and is put in the middle of it
    rank = (np.cumsum(weights) - 0.5 * weights) / total
    return float(np.interp(TAIL, rank, values[order]))


def _plan(problem: _Problem) -> tuple[_Plan, FloatArray]:
    """Choose nodes, directions and numbers of draws.

    Returns:
        The plan, and the clock (K,) that bounds are interpolated along.
    """
    scenario, schedule = problem.scenario, problem.schedule
    covariance = scenario.cov_radar[scenario.level]
    size, count = len(RADAR), len(problem.radars)
    blocks = [
        covariance[size * i : size * (i + 1), size * i : size * (i + 1)] for i in range(count)
    ]
    independent = np.array_equal(covariance, block_diagonal(blocks)) and not scenario.rcs_std
    members = (
        [((i,), radar) for i, radar in enumerate(problem.radars)]
        if independent
        else [(tuple(range(count)), scenario)]
    )
    samplers = [Sampler.of(part) for _, part in members]
    pilots = [
        _Pilot.draw(problem, radars, sampler, u)
        for u, ((radars, _), sampler) in enumerate(zip(members, samplers, strict=True))
    ]
    clock = _clock(problem, pilots)
    nodes = np.arange(len(clock))
    if len(clock) > NODES:
        even = np.linspace(clock[0], clock[-1], NODES)
        nodes = np.unique(np.minimum(np.searchsorted(clock, even), len(clock) - 1))
    ends = nodes[np.unique(np.linspace(0, len(nodes) - 1, ENDS).round().astype(int))]
    pose = _pose_slopes(problem, ends)
    pose_variance = np.sum(pose * pose, axis=1)
    pilot_statistics = [pilot.at(ends) for pilot in pilots]
    # of the network's P: 1 − P is a product over the units
    misses = [statistics.miss for statistics in pilot_statistics]
    radar_variance = np.array(
        [
            one.variance * np.prod(misses[:u] + misses[u + 1 :], axis=0) ** 2
            for u, one in enumerate(pilot_statistics)
        ]
    )
    total = radar_variance.sum(axis=0) + pose_variance
    known = np.maximum(total, NEGLIGIBLE**2)
    units = []
    for u, ((radars, _), sampler) in enumerate(zip(members, samplers, strict=True)):
        one = pilot_statistics[u]
        # each of several radars is looked at by itself too, and there the share is its own
        share = np.sqrt(radar_variance[u] / known) if len(members) == 1 else np.ones(len(total))
        vectors = (one.directions * share[:, np.newaxis]).reshape(-1, one.directions.shape[-1])
        directions = Directions.of(vectors, np.tile(one.spread, 2))
        units.append(_Unit(radars, sampler, directions))
    spread = np.max([one.spread for one in pilot_statistics], axis=0) + 6.0 * np.sqrt(pose_variance)
    pose_directions = Directions.of(pose / np.sqrt(known)[:, np.newaxis], spread)
    shown = total > NEGLIGIBLE**2
    share = np.max(radar_variance[:, shown] / total[shown], axis=1, initial=0.0)
    affordable = DETECTION_WORK / sum(map(len, problem.looks))
    most = MAX_DETECTION_DRAWS
    if problem.m_of_n is not None:
        most = MAX_TRACK_DRAWS
        histories = 2 ** (problem.m_of_n[1] - 1)
        affordable *= TRACK_WORK / DETECTION_WORK / (1.0 + histories / HISTORIES)
    draws = 2 ** int(np.log2(np.clip(affordable, MIN_DRAWS, most)))
    per_path = 1
    if len(units) > 1:
        pose_share = np.sum(spread * pose_variance / known) / max(np.sum(spread), NEGLIGIBLE)
        large = pose_share > LARGE_POSE_SHARE
        per_path = FEWER_DRAWS_PER_PATH if large else DRAWS_PER_PATH
    plan = _Plan(
        problem=dataclasses.replace(problem, nodes=nodes),
        process=PoseProcess.of(
            schedule.time, scenario.aircraft, scenario.cov_aircraft, scenario.correlation_s
        ),
        pose_directions=pose_directions,
        units=tuple(units),
        emphasis=share + 0.05 if independent else np.ones(count),
        paths=draws // per_path,
        draws=per_path,
    )
    return plan, clock


def _clock(problem: _Problem, pilots: Sequence[_Pilot]) -> FloatArray:
    """Return a clock (K,) that goes with time, and faster where P grows in some draw of a pilot.

    So nodes that are even by the clock are close to each other where a bound may rise.
    """
    time = problem.schedule.time - problem.schedule.time[0]
    clock: FloatArray = time / max(time[-1], 1e-300)
    for pilot in pilots:
        for event in pilot.log_miss:
            clock = clock - np.expm1(-event.max(axis=0)) - np.expm1(-event.mean(axis=0))
    return clock


@dataclass(frozen=True, eq=False)
class _Pilot:
    """Draws of one unit with the nominal pose path, for the choice of directions.

    Attributes:
        normals: Unit normals (draws, d).
        log_miss: For each event its −ln(1 − P) (draws, K).
    """

    normals: FloatArray
    log_miss: tuple[FloatArray, ...]

    @classmethod
    def draw(
        cls, problem: _Problem, radars: tuple[int, ...], sampler: Sampler, number: int
    ) -> _Pilot:
        """Draw the states of a unit, wider than they are, and compute the events."""
        normals = PILOT_WIDTH * _sobol_normals(
            PILOT_DRAWS, sampler.radar_normals, 1, problem.scenario.seed, _PILOT, number
        )
        states = _drawn_states(sampler, normals)[np.newaxis]
        poses = problem.scenario.aircraft[:, np.newaxis]
        events = [
            problem.events(radar, problem.hazard(radar, poses, states[:, :, place])[0])
            for place, radar in enumerate(radars)
        ]
        return cls(normals, tuple(np.sum(parts, axis=0) for parts in zip(*events, strict=True)))

    def at(self, ends: NDArray[np.intp]) -> _PilotStatistics:
        """Return statistics of the events at some times."""
        p = -np.expm1(-np.concatenate([event[:, ends] for event in self.log_miss], axis=1))
        squares = np.sum(self.normals * self.normals, axis=1)
        weight = np.exp(-0.5 * squares * (1.0 - PILOT_WIDTH**-2))
        limit = PILOT_TAIL * weight.sum()
        tails = []
        for sign in (-1.0, 1.0):
            order = np.argsort(sign * p, axis=0, kind="stable")
            ordered = weight[order]
            ordered[np.cumsum(ordered, axis=0) - ordered > limit] = 0.0
            tails.append(np.einsum("re,red->ed", ordered, self.normals[order]))
        directions = np.array(tails)
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return _PilotStatistics(
            directions=directions,
            spread=np.ptp(p, axis=0),
            variance=p.var(axis=0) / PILOT_WIDTH**2,
            miss=1.0 - p.mean(axis=0),
        )


class _PilotStatistics(NamedTuple):
    """Statistics of a pilot for e events.

    Attributes:
        directions: Unit vectors (2, e, d) from the nominal states to the tails of P.
        spread: Greatest P minus least P (e,).
        variance: Variance of P (e,), for normals as wide as they are.
        miss: Mean of 1 − P (e,).
    """

    directions: FloatArray
    spread: FloatArray
    variance: FloatArray
    miss: FloatArray


def _pose_slopes(problem: _Problem, ends: NDArray[np.intp]) -> FloatArray:
    """Slopes (e, 6K) of the events at times `ends` for the normals of the pose path."""
    scenario, schedule = problem.scenario, problem.schedule
    pose = schedule.pose
    covariance = scenario.cov_aircraft
    looks = linearize_looks(
        schedule.model(scenario.model),
        schedule.time[pose],
        scenario.aircraft[pose],
        scenario.shared,
    )
    slopes = pose_slopes(looks, covariance if covariance.ndim == 2 else covariance[pose])
    last = schedule.last[ends]
    left = np.exp(-np.cumsum(looks.hazard))[last, np.newaxis]
    past = np.arange(len(pose)) <= last[:, np.newaxis]
    by_look = [np.where(past, left * inverse_mills(looks.probit), 0.0)]
    if problem.m_of_n is not None:
        p_d = looks.p_d
        by_p = any_group_gradient(p_d, 1.0 - p_d, *problem.m_of_n, schedule.scan_group, last)
        by_look.append(by_p * density(looks.probit))
    process = PoseProcess.of(schedule.time, scenario.aircraft, covariance, scenario.correlation_s)
    times = len(schedule.time)
    by_normals = np.zeros((len(last) * len(by_look), times, len(AIRCRAFT)))
    weights = np.nan_to_num(np.concatenate(by_look))
    for look, time in enumerate(pose):
        by_normals[:, time] += weights[:, look, np.newaxis] * np.nan_to_num(slopes[look])
    for k in range(times - 2, -1, -1):  # pose error k + 1 is ρ times pose error k, and new noise
        by_normals[:, k] += process.rho[k] * by_normals[:, k + 1]
    by_normals[:, 1:] *= process.innovation_std[:, np.newaxis]
    by_event: FloatArray = by_normals.reshape(len(by_normals), -1)
    return by_event


def _drawn_states(sampler: Sampler, normals: FloatArray) -> FloatArray:
    """Return the states (runs, radars, 4 to 6) of a sampler's radars from normals (runs, d)."""
    return np.stack(sampler.model.split(sampler.draw_radar(normals)[0]), axis=-2)


def _sobol_normals(
    runs: int, dimensions: int, together: int, seed: int, *stream: int
) -> FloatArray:
    """Unit normals (runs, dimensions) from a scrambled Sobol' sequence, in a random order.

    Without the random order two sequences depend on each other, however each is scrambled. Blocks
    of `together` points stay in a row; runs and `together` are powers of two.
    """
    if not dimensions:
        return np.zeros((runs, 0))
    from scipy.stats import qmc  # slow to import

    generator = random_stream(seed, *stream)
    points = qmc.Sobol(dimensions, bits=30, rng=generator).random(runs)
    blocks = points.reshape(-1, together, dimensions)
    points = blocks[generator.permutation(len(blocks))].reshape(runs, dimensions)
    normals: FloatArray = ndtri(points + 2.0**-31)  # half a bit keeps them finite
    return normals
