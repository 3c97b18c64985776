"""The error of Monte Carlo by number of runs, from many independent repetitions.

The errors of mean, standard deviation and 3σ quantiles are against a reference of many more runs.
The unit is σ_pd.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sense.axis import Axis
from radar_sense.montecarlo.montecarlo import TAIL, draw_block
from radar_sense.montecarlo.parallel import in_order
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.montecarlo.sequences import SAMPLERS
from radar_sense.montecarlo.statistics import LEAST_STD, tail_quantiles
from radar_sense.progress import report
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray
from radar_sense.streams import Stream, random_stream

#: Most numbers of runs. Each number is twice the number before.
SIZES = 9
#: The rate is fitted to the last RATE_SIZES numbers of runs.
RATE_SIZES = 5
#: Number of poses, spread evenly, every 15 deg of half an orbit. Errors are averaged over them.
POSES = 13
#: Independent repetitions. The relative uncertainty of the errors is about 1/√(2 · 32), an eighth.
REPLICATIONS = 32
#: The reference: number of independent Sobol' sequences, and the factor on the largest runs. Its
#: error is a quarter (1/√16) of theirs or less, which adds 3 % at most (√(1 + 1/16) − 1).
REFERENCES, REFERENCE_FACTOR = 8, 2
#: Most runs drawn at a time, a power of two. Another number would give other random numbers.
BLOCK = 4096
#: A standard deviation of P_D whose standard error in the reference is a larger part is not known.
LARGEST_ERROR = 0.1
#: Nor is σ known where means of n random draws are off by more than this times σ/√n, by definition
#: their error: the reference has missed a tail. By chance 32 normal means are not off by so much.
MISSED = 2.0
#: The statistics, as rows of an array.
STATISTICS = {"mean": slice(0, 1), "std": slice(1, 2), "quantile": slice(2, 4)}


def draw(sampler: Sampler, kind: str, seed: int, runs: int) -> FloatArray:
    """Draw P_D (runs, n)."""
    poses, radar_normals = len(sampler.states.aircraft), sampler.states.radar_normals
    normals = SAMPLERS[kind](seed, min(runs, BLOCK), poses, radar_normals)
    blocks = range(math.ceil(runs / normals.runs))
    return np.concatenate([draw_block(sampler, normals, block, runs)[0] for block in blocks])


def estimate(p_d: FloatArray) -> FloatArray:
    """Return mean, standard deviation, lower and upper quantile (4, n) of draws (runs, n)."""
    quantiles = tail_quantiles(p_d, len(p_d), TAIL)
    return np.stack([p_d.mean(axis=0), p_d.std(axis=0, ddof=1), *quantiles])


def root_mean_square(difference: FloatArray, std: FloatArray) -> dict[str, FloatArray]:
    """Return RMS differences (k,) by statistic, over repetitions and poses, in units of σ_pd.

    Those of estimates are (repetitions, k, 4, n). Poses are left out where σ_pd (n,) is NaN. The
    differences are NaN without poses.
    """
    usable = np.isfinite(std)
    if not usable.any():
        return dict.fromkeys(STATISTICS, np.full(difference.shape[1], np.nan))
    square = (difference[..., usable] / std[usable]) ** 2
    return {
        name: np.sqrt(square[:, :, rows].mean(axis=(0, 2, 3))) for name, rows in STATISTICS.items()
    }


@dataclass(frozen=True, eq=False, repr=False)
class Convergence:
    """Errors by number of runs.

    Attributes:
        runs: Numbers of runs (k,), each twice the number before.
        axis: The n poses.
        reference: Mean, standard deviation, lower and upper quantile (4, n).
        unknown: Where (n,) the reference does not know σ_pd, the unit. The errors leave out these
            poses, and those where σ_pd is zero.
        reference_error: Standard error of the reference by statistic, in units of σ_pd.
        errors: RMS errors (k,) by statistic and sampler, in units of σ_pd.
    """

    runs: NDArray[np.int64]
    axis: Axis
    reference: FloatArray
    unknown: NDArray[np.bool_]
    reference_error: dict[str, float]
    errors: dict[str, dict[str, FloatArray]]


def measure(
    scenario: Scenario, runs: int, repetitions: int = REPLICATIONS, *, workers: int = 1
) -> Convergence:
    """Estimate repeatedly with up to `runs` runs, a power of two, and compute the reference."""
    poses = np.unique(np.linspace(0, len(scenario.aircraft) - 1, POSES).round().astype(int))
    subset = scenario.at_poses(poses)
    sampler = Sampler(subset.states())
    sizes = [n for i in reversed(range(SIZES)) if (n := runs >> i) >= 2]
    generator = random_stream(scenario.seed, Stream.REPETITIONS)
    seeds = generator.integers(2**63, size=REFERENCES + repetitions)

    def repeat(number: int) -> list[FloatArray]:
        seed = int(seeds[number])
        if number < REFERENCES:
            return [estimate(draw(sampler, "sobol", seed, REFERENCE_FACTOR * runs))]
        drawn = [draw(sampler, kind, seed, runs) for kind in SAMPLERS]
        return [np.stack([estimate(p_d[:n]) for n in sizes]) for p_d in drawn]

    found = []
    for estimates in in_order(repeat, len(seeds), workers):
        found.append(estimates)
        report("repetitions", len(found), len(seeds))
    references = np.stack([reference for (reference,) in found[:REFERENCES]])
    reference = references.mean(axis=0)
    standard_error = references.std(axis=0, ddof=1) / np.sqrt(REFERENCES)
    repeated = zip(SAMPLERS, zip(*found[REFERENCES:], strict=True), strict=True)
    estimated = {kind: np.stack(estimates) for kind, estimates in repeated}
    std = np.maximum(reference[1], LEAST_STD)
    off = np.sqrt(np.mean((estimated["random"][:, -1, 0] - reference[0]) ** 2, axis=0))
    unknown = standard_error[1] > LARGEST_ERROR * std
    unknown |= off > MISSED * std / math.sqrt(runs)
    unit = np.where(unknown | (reference[1] <= LEAST_STD), np.nan, reference[1])
    of_reference = root_mean_square(standard_error[np.newaxis, np.newaxis], unit)
    of_samplers = {
        kind: root_mean_square(each - reference, unit) for kind, each in estimated.items()
    }
    return Convergence(
        runs=np.array(sizes),
        axis=subset.axis,
        reference=reference,
        unknown=unknown,
        reference_error={name: float(error[0]) for name, error in of_reference.items()},
        errors={s: {kind: of_samplers[kind][s] for kind in SAMPLERS} for s in STATISTICS},
    )


def rate(runs: NDArray[np.int64], error: FloatArray) -> float:
    """Return the exponent r of an error proportional to runs^r, by least squares."""
    runs, error = runs[-RATE_SIZES:], error[-RATE_SIZES:]
    if len(runs) < 2 or not (error > 0).all():
        return float("nan")
    return float(np.polyfit(np.log(runs), np.log(error), 1)[0])
