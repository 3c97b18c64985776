"""Monte Carlo: draw the states, compute P_D, gather statistics.

As in the paper the radar state is drawn once per run and shared by all poses of that run, the
aircraft state at every pose of every run. Runs come in blocks. Each block has a random stream of
its own, spawned from one seed, and the blocks are taken in in their order; so the result depends on
scenario and seed alone, not on who computed which block.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from radar_sense.covariance import factor
from radar_sense.geometry import join
from radar_sense.model import DetectionModel
from radar_sense.scenario import Scenario
from radar_sense.states import CONSTANT, FloatArray
from radar_sense.statistics import Moments, Tails, binomial_interval

#: Runs that share a random stream. A part of the result's definition: another value, other draws.
RUNS_PER_BLOCK = 32
#: Samples drawn and evaluated at a time; of no influence on the result.
CHUNK = 8192
#: Runs kept whole for the hair lines of the figure: so many, and never more numbers than that.
MAX_HAIRS = 500
MAX_HAIR_POINTS = 2_000_000

#: Probability below −3 standard deviations of a normal distribution.
TAIL = float(ndtr(-3.0))
#: Share of a normal distribution within 3 standard deviations.
WITHIN_3_SIGMA = 1.0 - 2.0 * TAIL


@dataclass(frozen=True, eq=False)
class MonteCarlo:
    """What the draws show at each of n poses, beside what the linearization says.

    Attributes:
        runs: Number of runs.
        seed: Seed of the draws.
        p_d: P_D of the nominal states (n,).
        sigma_pd: Linearized standard deviation (n,).
        mean: Mean of the draws (n,).
        std: Standard deviation of the draws (n,).
        lower: Quantile of the draws at Φ(−3) (n,).
        upper: Quantile of the draws at Φ(3) (n,).
        inside: Number of draws within P_D ± 3 σ_pd (n,).
        clipped: Number of runs whose radar constant was drawn below zero and set to zero.
        hairs: P_D of the first runs (h, n), h at most MAX_HAIRS.
    """

    runs: int
    seed: int
    p_d: FloatArray
    sigma_pd: FloatArray
    mean: FloatArray
    std: FloatArray
    lower: FloatArray
    upper: FloatArray
    inside: FloatArray
    clipped: int
    hairs: FloatArray

    @property
    def coverage(self) -> FloatArray:
        """Share of the draws within P_D ± 3 σ_pd (n,)."""
        return self.inside / self.runs

    def coverage_interval(self, confidence: float = 0.95) -> tuple[FloatArray, FloatArray]:
        """Ends of the binomial confidence interval of the coverage, each (n,)."""
        return binomial_interval(self.inside, self.runs, confidence)


@dataclass(frozen=True, eq=False)
class _Sampler:
    """All that a block of runs is computed from."""

    model: DetectionModel
    aircraft: FloatArray
    radar: FloatArray
    factor_aircraft: FloatArray
    factor_radar: FloatArray
    runs: int
    seed: int

    def block(self, index: int) -> tuple[FloatArray, int]:
        """P_D (runs of the block, n) and the number of radar constants set to zero."""
        stream = np.random.SeedSequence(self.seed, spawn_key=(index,))
        generator = np.random.default_rng(stream)
        runs = min(RUNS_PER_BLOCK, self.runs - index * RUNS_PER_BLOCK)
        poses = len(self.aircraft)
        # A last block that is not full draws as many, so that more runs begin with the same ones.
        white = generator.standard_normal((RUNS_PER_BLOCK, len(self.radar)))[:runs]
        radar = self.radar + _colour(self.factor_radar, white)
        negative = radar[:, CONSTANT] < 0
        radar[negative, CONSTANT] = 0.0
        p_d = np.empty((runs, poses))
        together = max(1, CHUNK // poses)
        for start in range(0, runs, together):
            part = slice(start, min(start + together, runs))
            white = generator.standard_normal((part.stop - start, poses, 6))
            aircraft = self.aircraft + _colour(self.factor_aircraft, white)
            p_d[part] = self.model.p_d(aircraft, radar[part, np.newaxis])
        return p_d, int(np.count_nonzero(negative))


def monte_carlo(
    scenario: Scenario,
    runs: int | None = None,
    seed: int | None = None,
    workers: int = 1,
    *,
    level: str | None = None,
    progress: Callable[[int], None] | None = None,
) -> MonteCarlo:
    """Draw aircraft and radar states and compare P_D with its linearization.

    Args:
        scenario: What to draw; also runs, seed and level where these are None.
        runs: Number of runs, two or more.
        seed: Seed of the draws; the same seed gives the same result.
        workers: Threads to compute with; of no influence on the result.
        level: Level of radar uncertainty.
        progress: Called with the number of runs that have come in since the last call.

    Raises:
        ScenarioError: If runs, seed or level are not allowed.
    """
    scenario = scenario.with_analysis(runs=runs, seed=seed, level=level)
    cov_radar = scenario.cov_radar[scenario.level]
    linear = scenario.model.linearize(scenario.aircraft, scenario.radar)
    sigma_pd = linear.std(scenario.cov_aircraft, cov_radar)
    sampler = _Sampler(
        model=scenario.model,
        aircraft=scenario.aircraft,
        radar=scenario.radar,
        factor_aircraft=factor(scenario.cov_aircraft),
        factor_radar=factor(cov_radar),
        runs=scenario.runs,
        seed=scenario.seed,
    )
    poses = len(scenario.aircraft)
    moments = Moments(poses)
    tails = Tails(poses, scenario.runs, TAIL)
    inside = np.zeros(poses)
    clipped = 0
    hairs: list[FloatArray] = []
    kept = min(MAX_HAIRS, max(1, MAX_HAIR_POINTS // poses))
    lower, upper = linear.p_d - 3 * sigma_pd, linear.p_d + 3 * sigma_pd
    for p_d, negative in _blocks(sampler, workers):
        if moments.count < kept:
            hairs.append(p_d[: kept - moments.count])
        moments.add(p_d)
        tails.add(p_d)
        inside += np.count_nonzero((p_d >= lower) & (p_d <= upper), axis=0)
        clipped += negative
        if progress:
            progress(len(p_d))
    low, high = tails.quantiles()
    return MonteCarlo(
        runs=scenario.runs,
        seed=scenario.seed,
        p_d=linear.p_d,
        sigma_pd=sigma_pd,
        mean=moments.mean,
        std=moments.std(),
        lower=low,
        upper=high,
        inside=inside,
        clipped=clipped,
        hairs=np.vstack(hairs),
    )


def _blocks(sampler: _Sampler, workers: int) -> Iterator[tuple[FloatArray, int]]:
    """Compute all blocks and give them in their order."""
    blocks = range(-(-sampler.runs // RUNS_PER_BLOCK))
    if workers == 1:
        yield from map(sampler.block, blocks)
        return
    with ThreadPoolExecutor(workers) as executor:
        yield from _in_order(executor, sampler, blocks, ahead=2 * workers)


def _in_order(
    executor: Executor, sampler: _Sampler, blocks: range, ahead: int
) -> Iterator[tuple[FloatArray, int]]:
    """Keep a few blocks under way, so that memory does not grow with the number of blocks."""
    waiting: deque[Future[tuple[FloatArray, int]]] = deque()
    for index in blocks:
        waiting.append(executor.submit(sampler.block, index))
        if len(waiting) > ahead:
            yield waiting.popleft().result()
    while waiting:
        yield waiting.popleft().result()


def _colour(factor: FloatArray, white: FloatArray) -> FloatArray:
    """Turn independent unit normals (..., n) into draws with covariance F Fᵀ.

    Written out instead of a matrix product, whose rounding depends on the library behind it and on
    the number of draws multiplied at a time.
    """
    rows = []
    for weights in factor:
        row = np.zeros(white.shape[:-1])
        for j in np.flatnonzero(weights):
            row += weights[j] * white[..., j]
        rows.append(row)
    return join(rows)
