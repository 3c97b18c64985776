"""Plain draws of whole missions: one draw of the radars a run, pose errors correlated in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_sense.mission.looks import Model, look_times, pose_sqrt_cov
from radar_sense.mission.tracks import any_group, check_window
from radar_sense.montecarlo.gauss_markov import correlate, successive_correlation
from radar_sense.montecarlo.montecarlo import SAMPLES_PER_BLOCK, TAIL
from radar_sense.montecarlo.parallel import in_order
from radar_sense.montecarlo.statistics import DrawStatistics, Statistics
from radar_sense.states import AIRCRAFT, FloatArray
from radar_sense.streams import Stream, random_stream


class RadarSampler(Protocol):
    """Draws the states of all radars, as `montecarlo.Sampler` does."""

    @property
    def radar_normals(self) -> int:
        """Number of unit normals of a draw."""
        ...

    def draw_radar(self, normals: FloatArray, /) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return states (runs, 4m), and where a c_r below 0 was set to 0 (runs,)."""
        ...


@dataclass(frozen=True, eq=False)
class MissionDraws:
    """Statistics of draws of a whole mission.

    Attributes:
        runs: Number of runs.
        seed: Seed of the draws.
        events: Statistics, at each look (K,), of P_c as "detection", and of m-of-n as "track" if m
            and n are given. The quantiles are at Φ(−3) and Φ(3).
        clipped: Number of runs in which a radar constant was drawn below zero and set to zero.
    """

    runs: int
    seed: int
    events: dict[str, DrawStatistics]
    clipped: int


@dataclass(frozen=True, eq=False)
class PoseProcess:
    """The Gauss-Markov process of the pose errors.

    Attributes:
        aircraft: Nominal aircraft states (K, 6).
        sqrt_cov: Symmetric square roots of C_aa (K, 6, 6).
        rho: Correlation of each pose error with the next (K − 1,).
        innovation_std: √(1 − ρ²) (K − 1,).
    """

    aircraft: FloatArray
    sqrt_cov: FloatArray
    rho: FloatArray
    innovation_std: FloatArray

    @classmethod
    def of(
        cls, time: FloatArray, aircraft: FloatArray, cov: ArrayLike, correlation_time: float
    ) -> PoseProcess:
        """Make the process from times (K,), poses (K, 6) and C_aa (6, 6) or (K, 6, 6)."""
        correlation = successive_correlation(time, correlation_time)
        return cls(aircraft, pose_sqrt_cov(cov, len(time)), *correlation)

    def poses(self, normals: FloatArray) -> FloatArray:
        """Return aircraft states (K, runs, 6); unit normals (K, 6, runs) are overwritten."""
        correlate(normals, self.rho, self.innovation_std)
        states = np.empty((len(AIRCRAFT), len(normals), normals.shape[-1]))
        for i, state in enumerate(states):
            state[:] = self.aircraft[:, i, np.newaxis]
            for j in range(len(AIRCRAFT)):
                weight = self.sqrt_cov[:, i, j, np.newaxis]
                if weight.any():
                    state += weight * normals[:, j]
        return np.moveaxis(states, 0, -1)


@dataclass(frozen=True, eq=False)
class _Runs:
    """The runs of a mission in blocks."""

    model: Model
    process: PoseProcess
    sampler: RadarSampler
    m_of_n: tuple[int, int] | None
    scan_group: NDArray[np.intp] | None
    runs: int
    runs_per_block: int
    seed: int

    @property
    def blocks(self) -> int:
        """Number of blocks; the last block may have fewer runs."""
        return -(-self.runs // self.runs_per_block)

    def statistics(self, index: int) -> tuple[list[Statistics], int]:
        """Return statistics of the events in a block of runs, and the runs with a c_r set to 0."""
        generator = random_stream(self.seed, Stream.MISSION, index)
        looks, width = len(self.process.aircraft), self.runs_per_block
        # A whole block is drawn, because a longer computation must begin with the same runs.
        radar_normals = generator.standard_normal((width, self.sampler.radar_normals))
        normals = generator.standard_normal((looks, len(AIRCRAFT), width))
        runs = min(width, self.runs - index * width)
        radar, negative = self.sampler.draw_radar(radar_normals[:runs])
        p_d = self.model.p_d(self.process.poses(normals[..., :runs]), radar).T
        events = [_accumulated(p_d)]
        if self.m_of_n:
            events.append(any_group(p_d, 1.0 - p_d, *self.m_of_n, self.scan_group)[0])
        statistics = []
        for rows in events:
            statistics.append(Statistics(looks, self.runs, TAIL))
            statistics[-1].add(rows)
        return statistics, int(np.count_nonzero(negative))


def mission_monte_carlo(
    model: Model,
    time: ArrayLike,
    aircraft: ArrayLike,
    cov_aircraft: ArrayLike,
    sampler: RadarSampler,
    *,
    correlation_time: float,
    runs: int,
    seed: int,
    m_of_n: tuple[int, int] | None = None,
    scan_group: NDArray[np.intp] | None = None,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> MissionDraws:
    """Draw whole missions and return their statistics.

    Args:
        model: The model.
        time: Times of the looks (K,) [s], which do not decrease.
        aircraft: Nominal aircraft states (K, 6).
        cov_aircraft: C_aa (6, 6), or (K, 6, 6) with one for each look.
        sampler: Draws the radars.
        correlation_time: τ [s] of the pose errors, from 0 to infinity.
        runs: Number of runs, two or more.
        seed: Seed of the draws.
        m_of_n: m and n of a track; None for detection alone.
        scan_group: The scan group of each look (K,); None if all looks are of one group.
        workers: Threads to compute with; the result does not depend on their number.
        progress: Called with the number of new runs.

    Raises:
        ValueError: If a shape does not fit or a number is out of range.
    """
    time, aircraft = look_times(time), np.asarray(aircraft, float)
    if aircraft.shape != (len(time), len(AIRCRAFT)):
        raise ValueError(
            f"aircraft states must have shape ({len(time)}, 6), one a look, got {aircraft.shape}"
        )
    if runs < 2:
        raise ValueError(f"needs 2 runs or more, got {runs}")
    if m_of_n is not None:
        check_window(*m_of_n)
    blocks = _Runs(
        model=model,
        process=PoseProcess.of(time, aircraft, cov_aircraft, correlation_time),
        sampler=sampler,
        m_of_n=m_of_n,
        scan_group=scan_group,
        runs=runs,
        runs_per_block=max(1, SAMPLES_PER_BLOCK // len(time)),
        seed=seed,
    )
    names = ("detection", "track") if m_of_n else ("detection",)
    events, clipped = {name: Statistics(len(time), runs, TAIL) for name in names}, 0
    for statistics, negative in in_order(blocks.statistics, blocks.blocks, workers):
        for event, more in zip(events.values(), statistics, strict=True):
            event.merge(more)
        clipped += negative
        if progress:
            progress(statistics[0].count)
    results = {name: event.result() for name, event in events.items()}
    return MissionDraws(runs=runs, seed=seed, events=results, clipped=clipped)


def _accumulated(p_d: FloatArray) -> FloatArray:
    """Return P_c (runs, K) from P_D (runs, K), by sums without cancellation."""
    p_c = np.empty(p_d.shape)
    total = np.zeros(len(p_d))
    for k in range(p_d.shape[1]):
        total += (1.0 - total) * p_d[:, k]
        p_c[:, k] = total
    return p_c
