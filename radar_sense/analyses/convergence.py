"""Error of Monte Carlo by number of runs, for random and Sobol' draws.

The errors of mean, standard deviation and 3σ quantiles are estimated from many independent
repetitions, against a reference of many more runs. The unit is σ_pd.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from radar_sense.axis import Axis
from radar_sense.command import (
    LEVEL,
    ONE_RADAR,
    SEED_OF_DRAWS,
    WORKER_THREADS,
    Option,
    Result,
    command,
)
from radar_sense.limits import Limit
from radar_sense.montecarlo.montecarlo import TAIL, draw_block
from radar_sense.montecarlo.parallel import in_order
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.montecarlo.sequences import SAMPLERS
from radar_sense.montecarlo.statistics import tail_quantiles
from radar_sense.progress import report
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray
from radar_sense.streams import Stream, random_stream
from radar_sense.words import describe_poses, warning

if TYPE_CHECKING:
    from radar_sense.plotting import Axes, Figure


#: Largest number of runs: default and limit.
DEFAULT_RUNS = 2**14
LIMIT = Limit(at_least=2, at_most=2**17, whole=True)
#: Most numbers of runs. Each number is twice the number before.
SIZES = 9
#: The rate is fitted to the last RATE_SIZES numbers of runs.
RATE_SIZES = 5
#: Number of poses, spread evenly, every 15 deg of half an orbit. Errors are averaged over them.
POSES = 13
#: Independent repetitions. The relative uncertainty of the errors is about 1/√(2 · 32), an eighth.
REPLICATIONS = 32
#: The reference: number of independent Sobol' sequences, and the factor on the largest runs.
REFERENCES, REFERENCE_FACTOR = 8, 8
#: Most runs drawn at a time, a power of two. Another number would give other random numbers.
BLOCK = 4096
#: A smaller standard deviation of P_D counts as zero.
LEAST_STD = 1e-12
#: The statistics, as rows of an array.
STATISTICS = {"mean": slice(0, 1), "std": slice(1, 2), "quantile": slice(2, 4)}


def draw(sampler: Sampler, kind: str, seed: int, runs: int) -> FloatArray:
    """Draw P_D (runs, n)."""
    source = SAMPLERS[kind](seed, min(runs, BLOCK), sampler.poses, sampler.radar_normals)
    blocks = range(math.ceil(runs / source.runs))
    return np.concatenate([draw_block(sampler, source, block, runs)[0] for block in blocks])


def estimate(p_d: FloatArray) -> FloatArray:
    """Return mean, standard deviation, lower and upper quantile (4, n) of draws (runs, n)."""
    quantiles = tail_quantiles(p_d, len(p_d), TAIL)
    return np.stack([p_d.mean(axis=0), p_d.std(axis=0, ddof=1), *quantiles])


def root_mean_square(difference: FloatArray, std: FloatArray) -> dict[str, FloatArray]:
    """Return RMS differences by statistic, over repetitions and poses, in units of σ_pd.

    Args:
        difference: Differences of estimates (repetitions, k, 4, n).
        std: σ_pd (n,). Poses where it is zero are left out.

    Returns:
        (k,) of each statistic, NaN without poses.
    """
    usable = std > LEAST_STD
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
        reference_error: Standard error of the reference by statistic, in units of σ_pd.
        errors: RMS errors (k,) by statistic and sampler, in units of σ_pd.
    """

    runs: NDArray[np.int64]
    axis: Axis
    reference: FloatArray
    reference_error: dict[str, float]
    errors: dict[str, dict[str, FloatArray]]


def measure(
    scenario: Scenario, runs: int, repetitions: int = REPLICATIONS, *, workers: int = 1
) -> Convergence:
    """Estimate repeatedly with up to `runs` runs, a power of two, and compute the reference.

    Args:
        scenario: The scenario, at its level. The seed determines the seeds of the repetitions.
        runs: Largest number of runs.
        repetitions: Number of independent repetitions.
        workers: Threads to compute with; the result does not depend on their number.
    """
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
    of_reference = root_mean_square(standard_error[np.newaxis, np.newaxis], reference[1])
    of_samplers = {
        kind: root_mean_square(np.stack(estimates) - reference, reference[1])
        for kind, estimates in zip(SAMPLERS, zip(*found[REFERENCES:], strict=True), strict=True)
    }
    return Convergence(
        runs=np.array(sizes),
        axis=subset.axis,
        reference=reference,
        reference_error={name: float(error[0]) for name, error in of_reference.items()},
        errors={s: {kind: of_samplers[kind][s] for kind in SAMPLERS} for s in STATISTICS},
    )


@command(
    LEVEL,
    ONE_RADAR,
    Option(
        "runs",
        "Largest number of runs, rounded down to a power of two.",
        LIMIT,
        default=DEFAULT_RUNS,
    ),
    SEED_OF_DRAWS,
    WORKER_THREADS,
    examples=(
        "radar-sense convergence --runs 4096",
        "radar-sense convergence my.yaml --level high --runs 65536",
    ),
)
def convergence(scenario: Scenario, *, runs: int = DEFAULT_RUNS, workers: int = 1) -> Result:
    """Error of Monte Carlo by number of runs, for random and Sobol' draws.

    Sobol' points are best for mean and sigma. Their error falls nearly as 1/runs. For 3-sigma
    quantiles the gain is smaller. Only random draws give the coverage a binomial confidence
    interval.

    Args:
        scenario: The scenario. The number of runs of the scenario is not used.
        runs: Largest number of runs, rounded down to a power of two.
        workers: Threads to compute with; the result does not depend on their number.

    Raises:
        InputError: If runs are out of range.
    """
    runs = 1 << (runs.bit_length() - 1)
    measured = measure(scenario, runs, workers=workers)
    result = Result(scenario.with_analysis(runs=runs))

    result.table.add("runs", measured.runs.astype(float), "Number of runs.")
    names = {"mean": "the mean", "std": "sigma", "quantile": "the 3-sigma quantiles"}
    for statistic, of in measured.errors.items():
        for kind, error in of.items():
            meaning = f"RMS error of {names[statistic]} by {kind} draws, in sigma of P_D."
            result.table.add(f"error_{statistic}_{kind}", error, meaning)

    last = {
        statistic: {
            kind: {
                "error": float(error[-1]),
                "rate": rate(measured.runs, error),
                "random_runs_for_the_same": float(runs * (of["random"][-1] / error[-1]) ** 2)
                if error[-1] > 0
                else float("nan"),
            }
            for kind, error in of.items()
        }
        for statistic, of in measured.errors.items()
    }
    result.summary |= {
        "runs": runs,
        "repetitions": REPLICATIONS,
        "poses": {measured.axis.key: measured.axis.values.tolist()},
        "reference_error": measured.reference_error,
        "at_largest_runs": last,
    }
    result.report += [
        f"RMS error with {runs:,} runs ({scenario.level}) in units of sigma of P_D, its rate, "
        "and the number of random runs for the same error:",
        f"  {'':8}{'mean':27}{'sigma':27}3-sigma quantiles",
    ]
    for kind in SAMPLERS:
        cells = "".join(f"{_cell(**last[statistic][kind]):27}" for statistic in STATISTICS)
        result.report.append(f"  {kind:8}{cells.rstrip()}")
    result.warnings += _warnings(measured)
    result.draw = partial(_draw, runs=result.table["runs"], errors=measured.errors)
    return result


def rate(runs: NDArray[np.int64], error: FloatArray) -> float:
    """Return the exponent r of an error proportional to runs^r, by least squares."""
    runs, error = runs[-RATE_SIZES:], error[-RATE_SIZES:]
    if len(runs) < 2 or not (error > 0).all():
        return float("nan")
    x = np.log(runs) - np.log(runs).mean()
    return float(np.sum(x * np.log(error)) / np.sum(x * x))


def _cell(error: float, rate: float, random_runs_for_the_same: float) -> str:
    if not error > 0:
        return "none" if error == 0 else "undefined"
    slope = f"n^{rate:<+7.2f}" if np.isfinite(rate) else f"{'no rate':9}"
    return f"{error:<9.2g}{slope}" + f"{random_runs_for_the_same:.1e}".replace("e+0", "e")


def _warnings(measured: Convergence) -> tuple[str, ...]:
    """Return warnings of too few runs, and of poses without σ of P_D."""
    few = []
    if (count := len(measured.runs)) < RATE_SIZES:
        shown = f"{count} number{'s' if count > 1 else ''} of runs"
        text = f"{shown} can hardly show a rate; take {2**RATE_SIZES} runs or more"
        few = [warning("runs-few", text)]
    zero = ~(measured.reference[1] > LEAST_STD)
    others = "" if zero.all() else "; the errors are of the other poses"
    if zero.any():
        text = "sigma of P_D, the unit of the errors, is zero "
        few.append(warning("sigma-zero", text + describe_poses(zero, measured.axis) + others))
    return tuple(few)


def _draw(figure: Figure, runs: FloatArray, errors: Mapping[str, Mapping[str, FloatArray]]) -> None:
    """Draw the errors of each statistic by number of runs."""
    from radar_sense import plotting

    rows = plotting.panels(figure, len(STATISTICS))
    names = ("the mean", r"$\sigma$", r"the $3\,\sigma$ quantiles")
    labels = {"random": ("random", "o"), "sobol": ("Sobol\N{PRIME}", "s")}
    for axes, statistic, name in zip(rows, STATISTICS, names, strict=True):
        for (kind, error), style in zip(errors[statistic].items(), plotting.LINES, strict=False):
            label, marker = labels[kind]
            plotting.draw_line(axes, runs, error, style, label=label if axes is rows[0] else None)
            axes.lines[-1].set(marker=marker, markersize=plotting.points(2.8))
        axes.set_ylabel(f"Error of {name},\nin $\\sigma$ of $P_D$")
        axes.set_xscale("log", base=2)
        axes.margins(x=0.03)
        first = [error[0] for error in errors[statistic].values() if np.all(error > 0)]
        if not first:
            continue  # a logarithmic axis cannot show 0
        axes.set_yscale("log")
        _slope(axes, runs, 1.6 * np.max(first), -0.5, "$n^{-1/2}$")
        if statistic != "quantile":  # no estimator of the quantiles has this rate
            _slope(axes, runs, np.min(first) / 1.6, -1.0, "$n^{-1}$")
    rows[-1].set_xlabel("Number of runs $n$")
    plotting.draw_legend(figure, rows[0])


def _slope(axes: Axes, runs: FloatArray, start: float, power: float, name: str) -> None:
    """Draw a power of the number of runs, to compare the lines with."""
    if len(runs) < 2:
        return
    from radar_sense import plotting

    guide = start * (runs / runs[0]) ** power
    axes.plot(runs, guide, color="0.55", lw=plotting.points(0.7))
    middle, above = len(runs) // 2, power > -1
    axes.annotate(
        name,
        (runs[middle], guide[middle]),
        xytext=(0, plotting.points(3) if above else -plotting.points(3)),
        textcoords="offset points",
        ha="left" if above else "right",
        va="bottom" if above else "top",
        fontsize=plotting.points(6.5),
        color="0.35",
    )
