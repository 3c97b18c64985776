"""Errors of Monte Carlo by number of runs: random draws, Sobol' points, and a control variate.

The errors of mean, standard deviation and 3σ quantiles are estimated from many independent
repetitions, against a reference of many more runs. The unit is σ_pd. Random draws and Sobol' points
each have a variant with the paper's linear model L as a control variate (P. Glasserman, *Monte
Carlo Methods in Financial Engineering*, 2003, section 4.1). On the same draws

    L = P̄_D + A_a (a − ā) + A_r (r − r̄),    r before c_r is cut off at 0,

is normal with mean P̄_D and standard deviation σ_L exactly. The error of the draws of L is therefore
known, and is subtracted from the statistics of P_D:

    mean        m_P − (m_L − P̄_D)
    variance    s_P² − (s_L² − σ_L²)
    quantile    the order statistic of P_D whose rank is the number of draws of L below P̄_D − 3σ_L
                (the upper quantile by the number above P̄_D + 3σ_L)

The coefficient of the control is 1 and is not estimated. The mean is therefore unbiased for any
number of runs, and the variance of random draws is unbiased too. A coefficient by regression would
have a bias of the order 1/runs. With Sobol' points, n − 1 in the denominator makes s² too large by
up to σ²/n. The control removes this error too. The control needs a gradient of P_D.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from radar_sense.analyses.columns import quantities
from radar_sense.analyses.contract import Option, Progress, Result, analysis, silent
from radar_sense.analyses.report import problem_warnings
from radar_sense.axis import Axis
from radar_sense.limits import Limit
from radar_sense.montecarlo.montecarlo import TAIL, Blocks
from radar_sense.montecarlo.parallel import all_in_order
from radar_sense.montecarlo.sampler import Sampler, columns_of_normals
from radar_sense.montecarlo.sequences import SAMPLERS
from radar_sense.montecarlo.statistics import order_statistics, tail_quantiles
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray, constants_of
from radar_sense.streams import random_stream

if TYPE_CHECKING:
    from radar_sense.plotting import Axes, Figure


#: Largest number of runs: default and limit.
DEFAULT_RUNS = 2**14
LIMIT = Limit(at_least=2, at_most=2**17, whole=True)
#: Most numbers of runs. Each number is twice the number before.
SIZES = 9
#: The rate is fitted to the last RATE_SIZES numbers of runs.
RATE_SIZES = 5
#: Number of poses, spread evenly over the scenario. Errors are averaged over these poses.
POSES = 19
#: Independent repetitions. The relative uncertainty of the errors is about 1/√(2 · 32), an eighth.
REPLICATIONS = 32
#: The reference: number of independent Sobol' sequences, and the factor on the largest runs.
REFERENCES, REFERENCE_FACTOR = 8, 8
#: Runs drawn at a time, a power of two. Another number would give other random numbers.
BLOCK = 4096
#: A smaller standard deviation of P_D counts as zero.
LEAST_STD = 1e-12
STATISTICS = ("mean", "std", "quantile")
ESTIMATORS = ("random", "sobol", "random_control", "sobol_control")
#: Number of the random stream of the seeds of the repetitions.
_SEEDS = 2**32 - 3


@dataclass(frozen=True, eq=False)
class LinearModel:
    """The deviation L − P̄_D of the linear model as a function of the unit normals.

    Attributes:
        by_radar: Partials for the unit normals of the radar (n, m), A_r F_r with F Fᵀ = C.
        by_aircraft: Partials for the unit normals of the aircraft (n, 6), A_a F_a.
    """

    by_radar: FloatArray
    by_aircraft: FloatArray

    @classmethod
    def of(cls, sampler: Sampler) -> LinearModel:
        """Linearize P_D at the nominal states of a sampler; NaN where there is no gradient."""
        lin = sampler.model.linearize(sampler.aircraft, sampler.radar)
        by_radar = _partials(lin.jac_radar, sampler.sqrt_cov_radar)
        added = sampler.radar_normals - by_radar.shape[1]
        by_radar = np.hstack([by_radar, np.zeros((len(by_radar), added))])
        constants = constants_of(len(sampler.model.radars))
        by_log_constant = (lin.jac_radar * sampler.radar)[:, constants]
        columns_by_radar = columns_of_normals(len(sampler.radar), sampler.parts)
        for i, (parts, part_columns) in enumerate(
            zip(sampler.parts, columns_by_radar, strict=True)
        ):
            for part, column in zip(parts, part_columns, strict=True):
                by_radar[:, column] = by_log_constant[:, i] * part.slope
        return cls(by_radar, _partials(lin.jac_aircraft, sampler.sqrt_cov_aircraft))

    @property
    def std(self) -> FloatArray:
        """σ_L (n,), which is the linearized σ_pd."""
        total: FloatArray = np.sum(self.by_radar**2, axis=1) + np.sum(self.by_aircraft**2, axis=1)
        return np.sqrt(total)

    def deviation(self, radar_normals: FloatArray, aircraft_normals: FloatArray) -> FloatArray:
        """Return L − P̄_D (runs, n) from unit normals (runs, m) and (runs, n, 6)."""
        total = np.zeros(aircraft_normals.shape[:-1])
        # A loop, because the rounding of a matrix product depends on the BLAS library.
        for i in range(self.by_radar.shape[1]):
            total += radar_normals[:, i, np.newaxis] * self.by_radar[:, i]
        for i in range(self.by_aircraft.shape[1]):
            total += aircraft_normals[..., i] * self.by_aircraft[:, i]
        return total


def _partials(jacobian: FloatArray, sqrt_cov: FloatArray) -> FloatArray:
    # A gradient may be undefined where nothing is uncertain; 0 · NaN must be 0 there.
    known = np.where(np.any(sqrt_cov != 0, axis=-1), jacobian, 0.0)
    partials: FloatArray = np.sum(known[..., np.newaxis] * sqrt_cov, axis=-2)
    return partials


def draw(
    sampler: Sampler, linear: LinearModel | None, kind: str, seed: int, runs: int
) -> tuple[FloatArray, FloatArray | None]:
    """Draw P_D (runs, n) and, on the same draws, L − P̄_D (runs, n)."""
    poses = len(sampler.aircraft)
    source = SAMPLERS[kind](seed, BLOCK, poses, sampler.radar_normals)
    blocks = Blocks(sampler, source, runs, BLOCK)
    p_d = np.empty((runs, poses))
    deviation = None if linear is None else np.empty((runs, poses))
    for block in range(blocks.blocks):
        rows, normals = blocks.runs_of(block), blocks.normals(block)
        if linear is not None and deviation is not None:
            deviation[rows] = linear.deviation(*normals)
        p_d[rows], _ = blocks.p_d(*normals)  # overwrites the normals
    return p_d, deviation


def plain(p_d: FloatArray) -> FloatArray:
    """Return mean, standard deviation, lower and upper quantile (4, n) of draws (runs, n)."""
    quantiles = tail_quantiles(p_d, len(p_d), TAIL)
    return np.stack([p_d.mean(axis=0), p_d.std(axis=0, ddof=1), *quantiles])


def controlled(p_d: FloatArray, deviation: FloatArray, std: FloatArray) -> FloatArray:
    """Return the statistics of `plain` (4, n) with the linear model as control variate.

    See the docstring of this module for the formulas.

    Args:
        p_d: Draws of P_D (runs, n).
        deviation: L − P̄_D (runs, n) on the same draws.
        std: σ_L (n,).

    Returns:
        (4, n), NaN where L is NaN.
    """
    runs = len(p_d)
    mean = p_d.mean(axis=0) - deviation.mean(axis=0)
    variance = p_d.var(axis=0, ddof=1) - (deviation.var(axis=0, ddof=1) - std * std)
    tail_counts = [np.sum(side * deviation < -3.0 * std, axis=0) for side in (1, -1)]
    lower, upper = (
        side * order_statistics(side * p_d, (runs - 1) / runs * count)
        for side, count in zip((1, -1), tail_counts, strict=True)
    )
    estimates = np.stack([mean, np.sqrt(np.maximum(variance, 0.0)), lower, upper])
    estimates[:, np.isnan(std)] = np.nan
    return estimates


@dataclass(frozen=True, eq=False, repr=False)
class Convergence:
    """Estimates by number of runs, and the reference.

    Attributes:
        runs: Numbers of runs (k,), each twice the number before.
        axis: The n poses.
        reference: Mean, standard deviation, lower and upper quantile (4, n).
        reference_error: Standard errors of the reference (4, n).
        estimates: Estimates of each estimator (repetitions, k, 4, n).
    """

    runs: NDArray[np.int64]
    axis: Axis
    reference: FloatArray
    reference_error: FloatArray
    estimates: dict[str, FloatArray]

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Poses (n,) at which σ_pd is large enough to be the unit of errors."""
        usable: NDArray[np.bool_] = self.reference[1] > LEAST_STD
        return usable

    def error(self, estimator: str, statistic: str) -> FloatArray:
        """Return the RMS error (k,) over repetitions and poses, in units of σ_pd.

        Without usable poses the error is NaN.
        """
        return self._rms(self.estimates[estimator] - self.reference, statistic)

    def reference_rms(self, statistic: str) -> float:
        """Return the RMS standard error of the reference over poses, in units of σ_pd."""
        return float(self._rms(self.reference_error[np.newaxis, np.newaxis], statistic)[0])

    def _rms(self, difference: FloatArray, statistic: str) -> FloatArray:
        rows = {"mean": slice(0, 1), "std": slice(1, 2), "quantile": slice(2, 4)}[statistic]
        poses = self.usable & np.isfinite(difference).all(axis=(0, 1, 2))
        if not poses.any():
            return np.full(difference.shape[1], np.nan)
        relative = difference[:, :, rows, poses] / self.reference[1, poses]
        square: FloatArray = np.mean(relative**2, axis=(0, 2, 3))
        return np.sqrt(square)


def measure(
    scenario: Scenario,
    runs: int,
    *,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Convergence:
    """Estimate REPLICATIONS times with up to `runs` runs, a power of two, and the reference.

    Args:
        scenario: The scenario, at its level. The seed determines the seeds of the repetitions.
        runs: Largest number of runs.
        workers: Threads to compute with; the result does not depend on their number.
        progress: Called with 1 after each of REPLICATIONS + REFERENCES parts.
    """
    poses = np.unique(np.linspace(0, len(scenario.aircraft) - 1, POSES).round().astype(int))
    subset = scenario.at_poses(poses)
    sampler = Sampler.of(subset)
    linear = LinearModel.of(sampler)
    sizes = [n for i in reversed(range(SIZES)) if (n := runs >> i) >= 2]
    seeds = random_stream(scenario.seed, _SEEDS).integers(2**63, size=REFERENCES + REPLICATIONS)

    def reference(number: int) -> FloatArray:
        seed = int(seeds[number])
        return plain(draw(sampler, None, "sobol", seed, REFERENCE_FACTOR * runs)[0])

    def repetition(number: int) -> dict[str, FloatArray]:
        seed = int(seeds[REFERENCES + number])
        estimates = {}
        for kind in SAMPLERS:
            p_d, deviation = draw(sampler, linear, kind, seed, runs)
            assert deviation is not None
            estimates[kind] = np.stack([plain(p_d[:n]) for n in sizes])
            estimates[f"{kind}_control"] = np.stack(
                [controlled(p_d[:n], deviation[:n], linear.std) for n in sizes]
            )
        return estimates

    references = all_in_order(reference, REFERENCES, workers, progress)
    repetitions = all_in_order(repetition, REPLICATIONS, workers, progress)
    statistics = np.stack(references)
    return Convergence(
        runs=np.array(sizes),
        axis=subset.axis,
        reference=statistics.mean(axis=0),
        reference_error=statistics.std(axis=0, ddof=1) / np.sqrt(REFERENCES),
        estimates={name: np.stack([r[name] for r in repetitions]) for name in ESTIMATORS},
    )


def plot(result: Result, figure: Figure) -> None:
    """Draw the figure."""
    from radar_sense import plotting

    rows = plotting.panels(figure, len(STATISTICS))
    table, runs = result.table, result.table["runs"]
    marks = dict(zip(ESTIMATORS, ("o", "s", "^", "D"), strict=True))
    names = ("the mean", r"$\sigma$", r"the $3\,\sigma$ quantiles")
    for axes, statistic, name in zip(rows, STATISTICS, names, strict=True):
        errors = {e: table[f"error_{statistic}_{e}"] for e in ESTIMATORS}
        for (estimator, error), style in zip(errors.items(), plotting.LINES, strict=False):
            label = estimator.replace("sobol", "Sobol\N{PRIME}").replace("_", ", ")
            plotting.draw_line(axes, runs, error, style, label=label if axes is rows[0] else None)
            axes.lines[-1].set(marker=marks[estimator], markersize=plotting.points(2.8))
        axes.set_ylabel(f"Error of {name},\nin $\\sigma$ of $P_D$")
        axes.set_xscale("log", base=2)
        axes.margins(x=0.03)
        first = [error[0] for error in errors.values() if np.all(error > 0)]
        if not first:
            continue  # a logarithmic axis cannot show 0
        axes.set_yscale("log")
        _slope(axes, runs, 1.6 * np.max(first), -0.5, "$n^{-1/2}$")
        if statistic != "quantile":  # no estimator of the quantiles has this rate
            _slope(axes, runs, np.min(first) / 1.6, -1.0, "$n^{-1}$")
    rows[-1].set_xlabel("Number of runs $n$")
    plotting.draw_legend(figure, rows[0])


_RUNS = Option(
    "runs",
    "Largest number of runs, rounded down to a power of two.",
    LIMIT,
    default=DEFAULT_RUNS,
)


_TABLE = quantities(
    {
        "runs": "Number of runs.",
        "error_mean_<estimator>": "RMS error of the mean by <estimator>, in sigma of P_D.",
        "error_std_<estimator>": "RMS error of sigma by <estimator>, in sigma of P_D.",
        "error_quantile_<estimator>": (
            "RMS error of the 3-sigma quantiles by <estimator>, in sigma of P_D."
        ),
    }
)


@analysis(
    plot=plot,
    columns=_TABLE,
    options=["level", "radar", _RUNS, "seed", "workers"],
    examples=[
        "radar-sense convergence --runs 4096",
        "radar-sense convergence my.yaml --level high --runs 65536",
    ],
)
def convergence(
    scenario: Scenario,
    *,
    runs: int = DEFAULT_RUNS,
    workers: int = 1,
    progress: Progress = silent,
) -> Result:
    """Error of Monte Carlo by number of runs, for random and Sobol' draws.

    Both kinds of draws also have a variant with the linear model as a control variate. Sobol'
    points are best for mean and sigma. Their error falls nearly as 1/runs. For 3-sigma quantiles
    the gain is smaller. Only random draws give the coverage a binomial confidence interval.

    Args:
        scenario: The scenario. The number of runs of the scenario is not used.
        runs: Largest number of runs, rounded down to a power of two.
        workers: Threads to compute with; the result does not depend on their number.
        progress: Shows the repetitions that are done.

    Raises:
        InputError: If runs are out of range.
    """
    runs = 1 << (runs.bit_length() - 1)
    with progress(REPLICATIONS + REFERENCES, "repetitions") as advance:
        measured = measure(scenario, runs, workers=workers, progress=advance)
    errors = {
        (statistic, estimator): measured.error(estimator, statistic)
        for statistic in STATISTICS
        for estimator in ESTIMATORS
    }
    rates = {key: rate(measured.runs, error) for key, error in errors.items()}
    equal = {
        (statistic, estimator): _equal_runs(runs, errors[statistic, "random"][-1], error[-1])
        for (statistic, estimator), error in errors.items()
    }
    last = {
        statistic: {
            estimator: {
                "error": float(errors[statistic, estimator][-1]),
                "rate": rates[statistic, estimator],
                "random_runs_for_the_same": equal[statistic, estimator],
            }
            for estimator in ESTIMATORS
        }
        for statistic in STATISTICS
    }
    return Result(
        scenario=scenario.with_analysis(runs=runs),
        table={
            "runs": measured.runs.astype(float),
            **{f"error_{statistic}_{name}": e for (statistic, name), e in errors.items()},
        },
        summary={
            "runs": runs,
            "repetitions": REPLICATIONS,
            "poses": {measured.axis.key: measured.axis.values.tolist()},
            "reference_error": {s: measured.reference_rms(s) for s in STATISTICS},
            "at_largest_runs": last,
        },
        report=(
            f"RMS error with {runs:,} runs ({scenario.level}) in units of sigma of P_D, its rate, "
            "and the number of random runs for the same error:",
            f"  {'':17}{'mean':27}{'sigma':27}3-sigma quantiles",
            *(
                f"  {name.replace('_', ', '):17}"
                + "".join(
                    f"{_cell(errors[s, name][-1], rates[s, name], equal[s, name]):27}"
                    for s in STATISTICS
                ).rstrip()
                for name in ESTIMATORS
            ),
        ),
        warnings=(*_too_few(measured), *_warnings(measured)),
    )


def rate(runs: NDArray[np.int64], error: FloatArray) -> float:
    """Return the exponent r of an error proportional to runs^r, by least squares."""
    runs, error = runs[-RATE_SIZES:], error[-RATE_SIZES:]
    if len(runs) < 2 or not (error > 0).all():
        return float("nan")
    x = np.log(runs) - np.log(runs).mean()
    return float(np.sum(x * np.log(error)) / np.sum(x * x))


def _equal_runs(runs: int, random: float, error: float) -> float:
    """Return the number of random runs with this error, if `runs` have the error `random`."""
    return float(runs * (random / error) ** 2) if error > 0 else float("nan")


def _cell(error: float, rate: float, equal: float) -> str:
    if not error > 0:
        return "none" if error == 0 else "undefined"
    slope = f"n^{rate:<+7.2f}" if np.isfinite(rate) else f"{'no rate':9}"
    return f"{error:<9.2g}{slope}" + f"{equal:.1e}".replace("e+0", "e")


def _too_few(measured: Convergence) -> tuple[str, ...]:
    """Return a warning if there are too few runs to show a rate."""
    if len(measured.runs) >= RATE_SIZES:
        return ()
    least = 2**RATE_SIZES
    shown = f"{len(measured.runs)} number{'s' if len(measured.runs) > 1 else ''} of runs"
    return (f"{shown} can hardly show a rate; take {least} runs or more",)


def _warnings(measured: Convergence) -> tuple[str, ...]:
    undefined: NDArray[np.bool_] = np.isnan(measured.estimates["random_control"][0, 0, 0])
    reasons = (
        (undefined, "there is no control variate, as the gradient is undefined"),
        (~measured.usable, "sigma of P_D, the unit of the errors, is zero"),
    )
    others = "; the errors are of the other poses"
    return problem_warnings(
        [(mask, words, "" if mask.all() else others) for mask, words in reasons], measured.axis
    )


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
