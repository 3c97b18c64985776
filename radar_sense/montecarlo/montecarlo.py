"""Monte Carlo: draw the states, compute P_D, gather statistics.

As in the paper the radar state is drawn once per run and shared by all poses of that run, the
aircraft state at every pose of every run. Runs come in blocks. What is drawn in a block depends on
the seed and its number alone, and the blocks' statistics are merged in an order that is always the
same; so the result depends on scenario and seed alone, not on who computed which block.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from radar_sense.montecarlo.parallel import in_order
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.montecarlo.sequences import SAMPLERS, Source, check_sampler
from radar_sense.montecarlo.statistics import RunningMoments, Tails, binomial_interval
from radar_sense.propagation import Moments, propagate_scenario
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray

#: Samples of a block, about. A part of the result's definition: another value, other draws.
SAMPLES_PER_BLOCK = 131_072
#: One thread computes so many blocks on end, so that it seldom waits to hand something over; fewer
#: with several radars, as a task that has begun is not interrupted, and where there would be fewer
#: tasks than this. Parts of the definition too: the order in which sums are rounded depends on it.
MOST_BLOCKS = 4
LEAST_TASKS = 64
#: Runs kept whole for the hair lines of the figure: so many, and never more numbers than that.
MAX_HAIRS = 500
MAX_HAIR_POINTS = 2_000_000
#: Probability below −3 standard deviations of a normal distribution.
TAIL = float(ndtr(-3.0))
#: Share of a normal distribution within 3 standard deviations.
WITHIN_3_SIGMA = 1.0 - 2.0 * TAIL


@dataclass(frozen=True, eq=False)
class MonteCarlo:
    """What the draws show at each of n poses, beside what a method of propagation says.

    Attributes:
        runs: Number of runs.
        seed: Seed of the draws.
        band: What the method says, with bounds at Φ(−3) and Φ(3).
        mean: Mean of the draws (n,).
        std: Standard deviation of the draws (n,).
        lower: Quantile of the draws at Φ(−3) (n,).
        upper: Quantile of the draws at Φ(3) (n,).
        inside: Number of draws within the method's bounds (n,).
        clipped: Number of runs whose radar constant was drawn below zero and set to zero.
        hairs: P_D of the first runs (h, n), h at most MAX_HAIRS.
        sampler: Where the draws come from, "random" or "sobol".
        rank_error: By how many of the sorted draws `lower` and `upper` are off at most; 0, exact,
            up to some 1.5 million runs of not too many poses.
    """

    runs: int
    seed: int
    band: Moments
    mean: FloatArray
    std: FloatArray
    lower: FloatArray
    upper: FloatArray
    inside: FloatArray
    clipped: int
    hairs: FloatArray
    sampler: str = "random"
    rank_error: int = 0

    @property
    def coverage(self) -> FloatArray:
        """Share of the draws within the method's bounds (n,), NaN where it has none."""
        return np.where(self.has_band, self.inside / self.runs, np.nan)

    @property
    def has_band(self) -> NDArray[np.bool_]:
        """Where the method has bounds (n,)."""
        return np.isfinite(self.band.lower + self.band.upper)

    def coverage_interval(self, confidence: float = 0.95) -> tuple[FloatArray, FloatArray]:
        """Ends of the binomial confidence interval of the coverage, each (n,); NaN without bounds.

        It holds for random draws; those of a Sobol' sequence are spread too evenly for it.
        """
        low, high = binomial_interval(self.inside, self.runs, confidence)
        return np.where(self.has_band, low, np.nan), np.where(self.has_band, high, np.nan)


class _Statistics:
    """What is kept of runs."""

    def __init__(self, poses: int, runs: int) -> None:
        self.moments, self.tails = RunningMoments(poses), Tails(poses, runs, TAIL)
        self.inside = np.zeros(poses)
        self.clipped = 0
        self.hairs: list[FloatArray] = []

    def add(self, p_d: FloatArray, clipped: int, hairs: int, band: Moments) -> None:
        """Take in P_D of runs (m, n), and as hairs the first so many of them."""
        self.moments.add(p_d)
        self.tails.add(p_d)
        self.inside += np.count_nonzero((p_d >= band.lower) & (p_d <= band.upper), axis=0)
        self.clipped += clipped
        if hairs:
            self.hairs.append(p_d[:hairs].copy())  # a view would keep all of the block

    def merge(self, other: _Statistics) -> None:
        """Take in all that another one has taken in."""
        self.moments.merge(other.moments)
        self.tails.merge(other.tails)
        self.inside += other.inside
        self.clipped += other.clipped
        self.hairs += other.hairs


@dataclass(frozen=True, eq=False)
class _Blocks:
    """The runs of a Monte Carlo computation, a block at a time."""

    sampler: Sampler
    source: Source
    band: Moments
    runs: int
    runs_per_block: int
    hairs: int

    @property
    def blocks(self) -> int:
        """How many blocks there are; the last one need not be full."""
        return -(-self.runs // self.runs_per_block)

    @property
    def together(self) -> int:
        """Blocks of a task."""
        most = MOST_BLOCKS // len(self.sampler.model.models)
        return max(min(self.blocks // LEAST_TASKS, most), 1)

    @property
    def tasks(self) -> int:
        """How many tasks there are."""
        return -(-self.blocks // self.together)

    def p_d(self, block: int) -> tuple[FloatArray, int]:
        """P_D (runs of the block, n) and in how many a constant was set to 0."""
        runs = min(self.runs_per_block, self.runs - block * self.runs_per_block)
        white_radar, white_aircraft = self.source.block(block)
        radar, negative = self.sampler.draw_radar(white_radar[:runs])
        p_d = self.sampler.draw_p_d(white_aircraft[:runs], radar, overwrite=True)
        return p_d, int(np.count_nonzero(negative))

    def statistics(self, task: int) -> _Statistics:
        """Compute the blocks of a task and keep what is needed of them."""
        found = _Statistics(len(self.sampler.aircraft), self.runs)
        first = task * self.together
        for block in range(first, min(first + self.together, self.blocks)):
            hairs = max(0, self.hairs - block * self.runs_per_block)
            found.add(*self.p_d(block), hairs, self.band)
        return found


def monte_carlo(
    scenario: Scenario,
    runs: int | None = None,
    seed: int | None = None,
    workers: int = 1,
    *,
    level: str | None = None,
    method: str = "linear",
    sampler: str = "random",
    executor: Executor | None = None,
    progress: Callable[[int], None] | None = None,
) -> MonteCarlo:
    """Draw aircraft and radar states and compare P_D with what a method of propagation says.

    Args:
        scenario: What to draw; also runs, seed and level where these are None.
        runs: Number of runs, two or more.
        seed: Seed of the draws; the same seed gives the same result.
        workers: Threads to compute with; of no influence on the result.
        level: Level of radar uncertainty.
        method: Method of propagation that gives the band, the paper's linearization by default.
        sampler: "random", or "sobol" for draws that fill the space evenly.
        executor: Computes the blocks, MOST_BLOCKS or fewer in a call, in place of threads; as many
            as 8 calls for each of `workers` are under way at a time. Of no influence on the result.
        progress: Called with the number of runs that have come in since the last call.

    Raises:
        ScenarioError: If runs, seed, level, method or sampler are not allowed.
    """
    scenario = scenario.with_analysis(runs=runs, seed=seed, level=level)
    check_sampler(sampler, scenario.runs)
    band = propagate_scenario(scenario, method=method)
    poses = len(scenario.aircraft)
    # a power of two, as Sobol' points want it
    runs_per_block = 1 << max(0, (SAMPLES_PER_BLOCK // poses).bit_length() - 1)
    states = Sampler.of(scenario)
    blocks = _Blocks(
        sampler=states,
        source=SAMPLERS[sampler](scenario.seed, runs_per_block, poses, states.radar_normals),
        band=band,
        runs=scenario.runs,
        runs_per_block=runs_per_block,
        hairs=min(MAX_HAIRS, max(1, MAX_HAIR_POINTS // poses), scenario.runs),
    )
    total = _Statistics(poses, scenario.runs)
    for found in in_order(blocks.statistics, blocks.tasks, workers, executor):
        total.merge(found)
        if progress:
            progress(found.moments.count)
    low, high = total.tails.quantiles()
    return MonteCarlo(
        runs=scenario.runs,
        seed=scenario.seed,
        band=band,
        mean=total.moments.mean,
        std=total.moments.std(),
        lower=low,
        upper=high,
        inside=total.inside,
        clipped=total.clipped,
        hairs=np.vstack(total.hairs),
        sampler=sampler,
        rank_error=total.tails.rank_error,
    )
