"""The probability that P_D exceeds a limit, by draws: at single poses, and anywhere on a path.

On a path the errors of the radars are common to all poses. The errors of the aircraft are a
first-order Gauss–Markov process with the correlation time of the scenario.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sense.covariance import component_first, symmetric_square_root
from radar_sense.montecarlo.gauss_markov import correlate, successive_correlation
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.montecarlo.statistics import binomial_interval, highest, order_statistics
from radar_sense.progress import report
from radar_sense.scenario import Scenario
from radar_sense.states import AIRCRAFT, FloatArray
from radar_sense.streams import Stream, random_stream

#: Largest number of draws of P_D in one call: poses times runs times radars.
MAX_DRAWS = 2e7
#: Runs before the first decision, and the growth of runs from decision to decision.
FIRST_RUNS, GROWTH = 2**13, 4
#: Largest number of runs of a pose, and a sufficient expected number of runs beyond the bound.
MAX_RUNS, ENOUGH_BEYOND = 2**18, 400
#: Confidence of a decision at one pose.
CONFIDENCE = 0.999
#: The draws of a path end when the standard error is below this part of the probability.
RELATIVE_ERROR = 0.02
#: Poses are left out of the draws of a path if together they have less than this part of the
#: probability.
NEGLIGIBLE = 0.005
#: Values of P_D in memory at a time.
_BLOCK = 2**20


@dataclass(frozen=True, eq=False)
class Decision:
    """Draws that decide whether P(P_D > p_max) ≤ 1 − Φ(k) at each of n poses.

    Attributes:
        probability: P(P_D > p_max) (n,).
        upper: Quantile of P_D at Φ(k) (n,).
        runs: Number of runs (n,).
        holds: Where the probability is at most 1 − Φ(k), with the confidence `CONFIDENCE` (n,).
        violated: Where the probability is greater, with the same confidence (n,).
    """

    probability: FloatArray
    upper: FloatArray
    runs: NDArray[np.intp]
    holds: NDArray[np.bool_]
    violated: NDArray[np.bool_]


def decide(scenario: Scenario, p_max: float, tail: float) -> Decision:
    """Draw at each pose of a scenario until P(P_D > p_max) ≤ `tail` is decided.

    A pose stays undecided if the probability is too near to the tail for `MAX_RUNS` runs. Poses may
    also stay undecided after `MAX_DRAWS` draws at all poses together.

    Args:
        scenario: The scenario, at its level and with its seed.
        p_max: The limit of P_D.
        tail: 1 − Φ(k).
    """
    n = len(scenario.aircraft)
    most = int(np.clip(ENOUGH_BEYOND / tail, FIRST_RUNS, MAX_RUNS))
    keep = math.ceil(tail * most) + 1
    above, runs = np.zeros(n), np.zeros(n, dtype=int)
    largest = np.full((keep, n), -np.inf)
    undecided, target, spent, stage = np.arange(n), FIRST_RUNS, 0.0, 0
    while undecided.size:
        radars = len(scenario.model.models)
        affordable = int((MAX_DRAWS - spent) / (len(undecided) * radars)) + int(runs[undecided[0]])
        target = min(target, most, max(affordable, 2))
        done = int(runs[undecided[0]])
        if target <= done:
            break
        sampler = Sampler.of(scenario.at_poses(undecided))
        for p_d in _independent(sampler, scenario.seed, stage, target - done):
            above[undecided] += np.count_nonzero(p_d > p_max, axis=0)
            candidates = np.concatenate([largest[:, undecided], p_d])
            largest[:, undecided] = highest(candidates, keep)
        runs[undecided] = target
        spent += len(undecided) * radars * (target - done)
        low, high = binomial_interval(above[undecided], runs[undecided], CONFIDENCE)
        undecided = undecided[(low <= tail) & (high > tail)]
        target, stage = target * GROWTH, stage + 1
    low, high = binomial_interval(above, runs, CONFIDENCE)
    rank = np.clip(np.ceil(tail * runs).astype(int), 1, keep)
    upper = order_statistics(largest, keep - rank)
    return Decision(above / runs, upper, runs, high <= tail, low > tail)


@dataclass(frozen=True)
class Anywhere:
    """P(P_D > p_max) at any pose of a path.

    Attributes:
        probability: The probability.
        error: Standard error of the probability.
        runs: Number of runs.
    """

    probability: float
    error: float
    runs: int


def exceeded_anywhere(scenario: Scenario, p_max: float, probability: FloatArray) -> Anywhere:
    """Return P(P_D > p_max) at any pose, from runs with common errors of the radars.

    Args:
        scenario: The scenario, at its level and with its seed.
        p_max: The limit of P_D.
        probability: P(P_D > p_max) at each pose (n,). The poses of least probability are left out
            if their sum is below `NEGLIGIBLE` times the greatest probability.
    """
    probability = np.where(np.isnan(probability), 1.0, probability)
    order = np.argsort(probability)
    negligible = np.cumsum(probability[order]) <= NEGLIGIBLE * probability.max()
    poses = np.sort(order[~negligible])
    if not poses.size:
        return Anywhere(0.0, 0.0, 0)
    path = scenario.at_poses(poses)
    most = int(np.clip(MAX_DRAWS / (len(poses) * len(scenario.model.models)), 100, MAX_RUNS))
    runs = hits = 0
    for p_d in _along_path(path, most):
        runs += len(p_d)
        hits += int(np.count_nonzero((p_d > p_max).any(axis=1)))
        mean = hits / runs
        if hits and math.sqrt(mean * (1.0 - mean) / runs) < RELATIVE_ERROR * min(mean, 1.0 - mean):
            break
        if runs >= FIRST_RUNS and hits == runs:
            break
    # One more run of each kind keeps the error above 0 if all runs agree.
    share = (hits + 1) / (runs + 2)
    return Anywhere(hits / runs, math.sqrt(share * (1.0 - share) / runs), runs)


def _independent(sampler: Sampler, seed: int, stage: int, runs: int) -> Iterator[FloatArray]:
    """Yield P_D (runs, n) with aircraft errors that are independent from pose to pose."""
    poses = len(sampler.aircraft)
    size = max(1, _BLOCK // (poses * len(sampler.model.models)))
    for block, start in enumerate(range(0, runs, size)):
        count = min(size, runs - start)
        generator = random_stream(seed, Stream.EMPHASIS, stage, block)
        radar, _ = sampler.draw_radar(generator.standard_normal((count, sampler.radar_normals)))
        normals = generator.standard_normal((count, poses, len(AIRCRAFT)))
        yield sampler.draw_p_d(normals, radar, overwrite=True)
        report("draws a pose", start + count, runs)


def _along_path(path: Scenario, runs: int) -> Iterator[FloatArray]:
    """Yield P_D (runs, n) with aircraft errors that are correlated along the path."""
    poses = len(path.aircraft)
    sampler = dataclasses.replace(
        Sampler.of(path),
        sqrt_cov_aircraft=component_first(symmetric_square_root(path.cov_aircraft)),
    )
    # the poses of an orbit have no times; their steps count as 1 s
    time = np.arange(float(poses)) if path.time_s is None else path.time_s
    correlation = successive_correlation(time, path.correlation_s)
    size = max(1, _BLOCK // (poses * len(path.model.models)))
    for block, start in enumerate(range(0, runs, size)):
        count = min(size, runs - start)
        generator = random_stream(path.seed, Stream.PATH, block)
        radar, _ = sampler.draw_radar(generator.standard_normal((count, sampler.radar_normals)))
        normals = generator.standard_normal((poses, count, len(AIRCRAFT)))
        correlate(normals, *correlation)
        yield sampler.draw_p_d(normals.swapaxes(0, 1), radar)
        report("runs along the path", start + count, runs)
