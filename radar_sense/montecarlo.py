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
from numpy.typing import NDArray
from scipy.special import ndtr

from radar_sense.covariance import draws, factor
from radar_sense.model import DetectionModel
from radar_sense.propagation import Moments, propagate_scenario
from radar_sense.reader import ScenarioError
from radar_sense.scenario import Scenario
from radar_sense.states import CONSTANT, FloatArray
from radar_sense.statistics import RunningMoments, Tails, binomial_interval

#: Runs that share a random stream. A part of the result's definition: another value, other draws.
RUNS_PER_BLOCK = 32
#: Samples drawn and evaluated at a time; of no influence on the result.
CHUNK = 8192
#: All poses of a scenario.
EVERY = slice(None)
#: Runs kept whole for the hair lines of the figure: so many, and never more numbers than that.
MAX_HAIRS = 500
MAX_HAIR_POINTS = 2_000_000

#: Numbers kept for the quantiles (4 GB with what it takes to sort them).
MAX_KEPT = 125_000_000

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

    @property
    def coverage(self) -> FloatArray:
        """Share of the draws within the method's bounds (n,)."""
        return self.inside / self.runs

    def coverage_interval(self, confidence: float = 0.95) -> tuple[FloatArray, FloatArray]:
        """Ends of the binomial confidence interval of the coverage, each (n,)."""
        return binomial_interval(self.inside, self.runs, confidence)


def random_stream(seed: int, *key: int) -> np.random.Generator:
    """Make the generator of one of the independent streams that belong to a seed."""
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed, spawn_key=key)))


@dataclass(frozen=True, eq=False)
class Sampler:
    """Draws the states of a scenario and computes P_D from them.

    Attributes:
        model: The detection model.
        aircraft: Nominal aircraft states (n, 6).
        radar: Nominal radar state (4,).
        factor_aircraft: F (6, 6) with F Fᵀ = C_aa.
        factor_radar: F (4, 4) with F Fᵀ = C_rr.
    """

    model: DetectionModel
    aircraft: FloatArray
    radar: FloatArray
    factor_aircraft: FloatArray
    factor_radar: FloatArray

    @classmethod
    def of(cls, scenario: Scenario) -> Sampler:
        """Make the sampler of a scenario at its level of radar uncertainty."""
        return cls(
            model=scenario.model,
            aircraft=scenario.aircraft,
            radar=scenario.radar,
            factor_aircraft=factor(scenario.cov_aircraft),
            factor_radar=factor(scenario.cov_radar[scenario.level]),
        )

    def draw_radar(
        self, generator: np.random.Generator, runs: int
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Radar states (runs, 4), and where c_r was drawn below zero and set to zero (runs,)."""
        white = generator.standard_normal((runs, len(self.radar)))
        radar = draws(self.radar, self.factor_radar, white)
        negative = radar[:, CONSTANT] < 0
        radar[negative, CONSTANT] = 0.0
        return radar, negative

    def draw_p_d(
        self, generator: np.random.Generator, radar: FloatArray, poses: slice = EVERY
    ) -> FloatArray:
        """P_D (runs, poses) of radar states (runs, 4) and an aircraft drawn for each of them."""
        nominal = self.aircraft[poses]
        p_d = np.empty((len(radar), len(nominal)))
        together = max(1, CHUNK // len(nominal))
        for start in range(0, len(radar), together):
            part = slice(start, min(start + together, len(radar)))
            white = generator.standard_normal((part.stop - start, *nominal.shape))
            aircraft = draws(nominal, self.factor_aircraft, white)
            p_d[part] = self.model.p_d(aircraft, radar[part, np.newaxis])
        return p_d


@dataclass(frozen=True, eq=False)
class _Blocks:
    """The runs of a Monte Carlo computation, a block at a time."""

    sampler: Sampler
    runs: int
    seed: int

    def __len__(self) -> int:
        return -(-self.runs // RUNS_PER_BLOCK)

    def block(self, index: int) -> tuple[FloatArray, int]:
        """P_D (runs of the block, n) and the number of radar constants set to zero."""
        generator = random_stream(self.seed, index)
        runs = min(RUNS_PER_BLOCK, self.runs - index * RUNS_PER_BLOCK)
        # A last block that is not full draws as many, so that more runs begin with the same ones.
        radar, negative = self.sampler.draw_radar(generator, RUNS_PER_BLOCK)
        p_d = self.sampler.draw_p_d(generator, radar[:runs])
        return p_d, int(np.count_nonzero(negative[:runs]))


def monte_carlo(
    scenario: Scenario,
    runs: int | None = None,
    seed: int | None = None,
    workers: int = 1,
    *,
    level: str | None = None,
    method: str = "linear",
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
        progress: Called with the number of runs that have come in since the last call.

    Raises:
        ScenarioError: If runs, seed or level are not allowed.
    """
    scenario = scenario.with_analysis(runs=runs, seed=seed, level=level)
    band = propagate_scenario(scenario, method=method)
    blocks = _Blocks(Sampler.of(scenario), scenario.runs, scenario.seed)
    poses = len(scenario.aircraft)
    if 2 * TAIL * scenario.runs * poses > MAX_KEPT:
        raise ScenarioError(
            f"{scenario.runs:,} runs of {poses:,} poses are more than fit into memory, allowed are "
            f"{int(MAX_KEPT / (2 * TAIL * poses)):,} runs of so many poses"
        )
    moments = RunningMoments(poses)
    tails = Tails(poses, scenario.runs, TAIL)
    inside = np.zeros(poses)
    clipped = 0
    hairs: list[FloatArray] = []
    kept = min(MAX_HAIRS, max(1, MAX_HAIR_POINTS // poses))
    for p_d, negative in _computed(blocks, workers):
        if moments.count < kept:
            hairs.append(p_d[: kept - moments.count])
        moments.add(p_d)
        tails.add(p_d)
        inside += np.count_nonzero((p_d >= band.lower) & (p_d <= band.upper), axis=0)
        clipped += negative
        if progress:
            progress(len(p_d))
    low, high = tails.quantiles()
    return MonteCarlo(
        runs=scenario.runs,
        seed=scenario.seed,
        band=band,
        mean=moments.mean,
        std=moments.std(),
        lower=low,
        upper=high,
        inside=inside,
        clipped=clipped,
        hairs=np.vstack(hairs),
    )


def _computed(blocks: _Blocks, workers: int) -> Iterator[tuple[FloatArray, int]]:
    """Compute all blocks and give them in their order."""
    if workers == 1:
        yield from map(blocks.block, range(len(blocks)))
        return
    with ThreadPoolExecutor(workers) as executor:
        yield from _in_order(executor, blocks, ahead=2 * workers)


def _in_order(executor: Executor, blocks: _Blocks, ahead: int) -> Iterator[tuple[FloatArray, int]]:
    """Keep a few blocks under way, so that memory does not grow with the number of blocks."""
    waiting: deque[Future[tuple[FloatArray, int]]] = deque()
    for index in range(len(blocks)):
        waiting.append(executor.submit(blocks.block, index))
        if len(waiting) > ahead:
            yield waiting.popleft().result()
    while waiting:
        yield waiting.popleft().result()
