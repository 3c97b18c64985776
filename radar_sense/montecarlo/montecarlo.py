"""Monte Carlo: draw the states, compute P_D, compute statistics.

As in the paper, the radar state is drawn once per run and shared by all poses of the run. The
aircraft state is drawn at every pose of every run. Runs are computed in blocks. The draws of a
block depend only on the seed and the number of the block. Statistics are merged in the order of the
blocks. The result therefore depends only on the states and the seed, and not on the threads.
"""

from __future__ import annotations

import math
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from radar_sense.cost import foresee
from radar_sense.errors import InputError, counted, describe
from radar_sense.limits import SIGMAS, WORKERS, Limit, check_number
from radar_sense.montecarlo.parallel import in_order
from radar_sense.montecarlo.sampler import Sampler, clipped
from radar_sense.montecarlo.sequences import SAMPLERS, UnitNormals, check_sampler
from radar_sense.montecarlo.statistics import DrawStatistics, Statistics, binomial_interval
from radar_sense.progress import report
from radar_sense.propagation import Moments, propagate_scenario
from radar_sense.propagation.moments import BETA
from radar_sense.scenario import Scenario, check_scenario
from radar_sense.states import FloatArray
from radar_sense.uncertain_states import MAX_NUMBERS

#: Approximate number of samples of a block. Another number gives other draws.
SAMPLES_PER_BLOCK = 131_072
#: Most runs that are kept for the figure, with no more than MAX_NUMBERS values of P_D.
MAX_SAMPLE_PATHS = 500
#: Probability beyond either bound of the draws.
TAIL = float(ndtr(-BETA))
#: Relative rounding of P_D. Method and draws may round the same value differently.
ROUNDING = 1e-13


@dataclass(frozen=True, eq=False, repr=False)
class MonteCarlo(DrawStatistics):
    """Statistics of the draws at each of n poses, beside the band of a method of propagation.

    Attributes:
        mean: Mean of the draws (n,).
        std: Standard deviation of the draws (n,).
        lower: Quantile of the draws at Φ(−k) (n,), exact.
        upper: Quantile of the draws at Φ(k) (n,), exact.
        runs: Number of runs.
        seed: Seed of the draws.
        band: Moments by the method, with bounds at Φ(−k) and Φ(k).
        inside: Number of draws within the method's bounds (n,).
        clipped: Number of runs whose radar constant was drawn below zero and set to zero.
        sample_paths: P_D of the first runs (h, n), h at most MAX_SAMPLE_PATHS.
        sampler: Source of the draws, "random" or "sobol".
        k: Number of σ of the bounds.
    """

    runs: int
    seed: int
    band: Moments
    inside: FloatArray
    clipped: int
    sample_paths: FloatArray
    sampler: str = "random"
    k: float = BETA

    @property
    def expected(self) -> float:
        """Share of draws expected within the bounds."""
        return 1.0 - 2.0 * float(ndtr(-self.k))

    @property
    def coverage(self) -> FloatArray:
        """Share of the draws within the method's bounds (n,), NaN without bounds."""
        return np.where(self.has_band, self.inside / self.runs, np.nan)

    @property
    def has_band(self) -> NDArray[np.bool_]:
        """Where the method has bounds (n,)."""
        return np.isfinite(self.band.lower + self.band.upper)

    @property
    def most_expected(self) -> FloatArray:
        """Largest share of draws (n,) within bounds that are right.

        None are beyond a bound of method and draws alike, because P_D often has this value.
        """
        ends = (self.lower, self.band.lower), (self.upper, self.band.upper)
        same = [abs(drawn - end) <= ROUNDING * abs(self.band.p_d) for drawn, end in ends]
        return self.expected + np.sum(same, axis=0) * (1.0 - self.expected) / 2.0

    def coverage_interval(self, confidence: float = 0.95) -> tuple[FloatArray, FloatArray]:
        """Return the binomial confidence interval of the coverage, lower and upper ends (n,).

        The interval is valid for random draws only. Sobol' points are more even.
        """
        check_number("confidence", confidence, Limit(above=0, below=1))
        low, high = binomial_interval(self.inside, self.runs, confidence)
        return np.where(self.has_band, low, np.nan), np.where(self.has_band, high, np.nan)

    def __repr__(self) -> str:
        return (
            f"MonteCarlo({self.runs} runs of {len(self.mean)} poses, seed {self.seed}, "
            f"{self.sampler}: {self.coverage.mean():.2%} within the {self.k:g}-sigma band)"
        )


def draw_block(
    sampler: Sampler, normals: UnitNormals, block: int, runs: int
) -> tuple[FloatArray, int]:
    """Return P_D (m, n) of a block of runs, and how many of them are clipped, see `clipped`.

    The last block may have fewer of all `runs`.
    """
    rows = slice(min(normals.runs, runs - block * normals.runs))
    radar_normals, aircraft_normals = normals.block(block)
    radar = sampler.states.radars_at(radar_normals[rows])
    return sampler.draw_p_d(aircraft_normals[rows], radar), clipped(radar)


def monte_carlo(
    scenario: Scenario,
    runs: int | None = None,
    seed: int | None = None,
    workers: int = 1,
    *,
    level: str | None = None,
    method: str = "linear",
    k: float = BETA,
    sampler: str = "random",
    executor: Executor | None = None,
) -> MonteCarlo:
    """Draw the states of a scenario, and compare P_D with the band of a method of propagation.

    Args:
        scenario: The scenario. Its runs, seed and level are the defaults.
        runs: Number of runs, two or more.
        seed: Seed of the draws; the same seed gives the same result.
        workers: Threads to compute with; the result does not depend on their number.
        level: Level of radar uncertainty.
        method: Method of propagation of the band; the default is the paper's linearization.
        k: Number of σ of the band, and of the quantiles of the draws.
        sampler: "random", or "sobol" for quasi-random points.
        executor: Computes in place of threads, with up to 8 calls pending for each of `workers`.
            The result does not depend on the executor.

    Raises:
        InputError: If an argument is not allowed, or if the runs and poses take too much memory.
        ComputationError: If memory, threads or workers run out.
    """
    check_scenario(scenario)
    scenario = scenario.with_analysis(runs=runs, seed=seed, level=level)
    poses, runs, states = len(scenario.aircraft), scenario.runs, scenario.states()
    tail = float(ndtr(-check_number("k", k, SIGMAS)))
    check_number("workers", workers, WORKERS)
    if not isinstance(executor, Executor | None):
        raise InputError(f"executor must be an Executor, got {describe(executor)}")
    check_sampler(sampler, runs)
    total, all_inside, all_clipped, paths = Statistics(poses, runs, tail), np.zeros(poses), 0, []
    radars = len(scenario.radars)
    what = f"{runs:,} runs of {poses:,} poses and {counted(radars, 'radar')}"
    foresee(what, float(runs) * poses * radars, less="fewer --runs", workers=workers)
    drawing, band = Sampler(states), propagate_scenario(scenario, method=method, beta=k)
    # a power of two, for Sobol' points
    runs_per_block = 1 << max(0, (SAMPLES_PER_BLOCK // poses).bit_length() - 1)
    normals = SAMPLERS[sampler](scenario.seed, runs_per_block, poses, states.radar_normals)
    shown = min(MAX_SAMPLE_PATHS, max(1, MAX_NUMBERS // poses), runs)
    slack = ROUNDING * abs(band.p_d)
    lower, upper = band.lower - slack, band.upper + slack

    draw = partial(_draw, drawing, normals, runs, shown, (lower, upper), tail)
    blocks = math.ceil(runs / runs_per_block)
    for statistics, inside, of_block, sample_paths in in_order(draw, blocks, workers, executor):
        total.merge(statistics)
        all_inside += inside
        all_clipped += of_block
        paths.append(sample_paths)
        report("runs", total.count, runs)
    return MonteCarlo(
        **vars(total.result()),
        runs=runs,
        seed=scenario.seed,
        band=band,
        inside=all_inside,
        clipped=all_clipped,
        sample_paths=np.concatenate(paths),
        sampler=sampler,
        k=float(k),
    )


def _draw(
    drawing: Sampler,
    normals: UnitNormals,
    runs: int,
    shown: int,
    band: tuple[FloatArray, FloatArray],
    tail: float,
    block: int,
) -> tuple[Statistics, FloatArray, int, FloatArray]:
    """Return statistics of a block, how many are within a band, clipped, and the runs shown.

    It is no function within another, which an executor of processes could not pickle.
    """
    p_d, of_block = draw_block(drawing, normals, block, runs)
    statistics = Statistics(p_d.shape[1], runs, tail)
    statistics.add(p_d)
    inside = np.count_nonzero((p_d >= band[0]) & (p_d <= band[1]), axis=0)
    return statistics, inside, of_block, p_d[: max(0, shown - block * normals.runs)].copy()
