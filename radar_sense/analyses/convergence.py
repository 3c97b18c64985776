"""How fast Monte Carlo settles: random draws, Sobol' points, and the linear model as a control.

The error of mean, standard deviation and 3σ quantiles is measured by many independent repetitions
against a reference of many more runs, in units of σ_pd, for two kinds of draws. Of each kind there
is a variant with the paper's linear model as a control variate (P. Glasserman, *Monte Carlo Methods
in Financial Engineering*, 2003, section 4.1): on the same draws

    L = P̄_D + A_a (a − ā) + A_r (r − r̄),    r before c_r is cut off at 0,

is normal with mean P̄_D and standard deviation σ_L exactly, so what the draws make wrong with L is
known and is taken off what they say of P_D:

    mean        m_P − (m_L − P̄_D)
    variance    s_P² − (s_L² − σ_L²)
    quantile    the draw of P_D below which there are as many as there are of L below P̄_D − 3σ_L;
                the other end alike

The coefficient of the control is 1 throughout, so nothing has to be estimated: the mean is unbiased
for any number of runs, and so is the variance of random draws. (With Sobol' points n − 1 in the
denominator makes s² too large by up to σ²/n, a fifth of their error at 16384 runs; the control
takes that off too.) A coefficient by regression has a bias of the order 1/runs; measured on the
paper's scenario at Medium and High it does not better the mean, and takes nothing to a fifth off
the error of σ.

What each is good for, measured on the paper's scenario with 16384 runs at Medium (High):

- Random draws are good for all, slowly: the error falls as runs^−1/2. They are the only ones whose
  coverage has a binomial confidence interval.
- Sobol' points are best for mean and σ, whose error falls about as 1/runs: they do what
  130 000 (60 000) times as many random draws do for the mean, 2100 (560) times as many for σ. Of
  the quantiles a few of a thousand draws decide: there it is 7 (7) times as many.
- The control makes random draws worth 150 (46) times their number for the mean and 20 (6) for σ,
  and takes half (a quarter) off the error of Sobol' points for the mean, a third (a tenth) off that
  for σ. For the quantiles it needs some 2000 runs, so that draws of L lie beyond; then random draws
  are about as good with it as Sobol' points, for which it does next to nothing. It needs a gradient
  of P_D.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from radar_sense.plotting import Axes, Figure

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sense.analyses.contract import Option, Progress, Result, analysis, silent
from radar_sense.analyses.report import describe_poses
from radar_sense.axis import Axis
from radar_sense.errors import ScenarioError
from radar_sense.limits import RUNS, Limit
from radar_sense.montecarlo.montecarlo import TAIL
from radar_sense.montecarlo.sampler import Sampler, columns
from radar_sense.montecarlo.sequences import SAMPLERS, random_stream
from radar_sense.scenario import Scenario
from radar_sense.states import CONSTANTS, FloatArray

#: Largest number of runs unless another is asked for, and the limit of it.
DEFAULT_RUNS = 2**14
LIMIT = Limit(at_least=2, at_most=2**17, whole=True)
#: How many numbers of runs, each twice the one before.
SIZES = 9
#: The rate is that of the last so many of them, where the quantiles have draws beyond them.
RATE_SIZES = 5
#: Poses, spread evenly over the scenario's: errors are averaged over them.
POSES = 19
#: Independent repetitions. Their number makes the errors uncertain by about an eighth.
REPLICATIONS = 32
#: The reference: so many independent Sobol' sequences, each of so many times the largest runs.
REFERENCES, REFERENCE_FACTOR = 8, 8
#: Runs drawn at a time, a power of two; a part of the result's definition.
BLOCK = 4096
#: Below this a standard deviation of P_D is rounding.
LEAST_STD = 1e-12
STATISTICS = ("mean", "std", "quantile")
ESTIMATORS = ("random", "sobol", "random_control", "sobol_control")
#: Branch of a seed's streams that gives the seeds of the repetitions.
_SEEDS = 2**32 - 3


@dataclass(frozen=True, eq=False)
class LinearModel:
    """The deviation L − P̄_D of the linear model as a function of the unit normals.

    Attributes:
        by_radar: Partials for the unit normals of the radar (n, m), A_r F_r with F Fᵀ = C.
        by_aircraft: Partials for those of the aircraft (n, 6), A_a F_a.
    """

    by_radar: FloatArray
    by_aircraft: FloatArray

    @classmethod
    def of(cls, sampler: Sampler) -> LinearModel:
        """Linearize P_D at the nominal states of a sampler; NaN where there is no gradient."""
        lin = sampler.model.linearize(sampler.aircraft, sampler.radar)
        by_radar = _partials(lin.jac_radar, sampler.factor_radar)
        more = sampler.radar_normals - by_radar.shape[1]
        by_radar = np.hstack([by_radar, np.zeros((len(by_radar), more))])
        by_log_constant = (lin.jac_radar * sampler.radar)[:, CONSTANTS]
        inputs = columns(len(sampler.radar), sampler.parts)
        for i, (parts, own) in enumerate(zip(sampler.parts, inputs, strict=True)):
            for part, column in zip(parts, own, strict=True):  # a normal each, in place of c_r's
                by_radar[:, column] = by_log_constant[:, i] * part.slope
        return cls(by_radar, _partials(lin.jac_aircraft, sampler.factor_aircraft))

    @property
    def std(self) -> FloatArray:
        """σ_L (n,), which is the linearized σ_pd."""
        total: FloatArray = np.sum(self.by_radar**2, axis=1) + np.sum(self.by_aircraft**2, axis=1)
        return np.sqrt(total)

    def deviation(self, white_radar: FloatArray, white_aircraft: FloatArray) -> FloatArray:
        """L − P̄_D (runs, n) from unit normals (runs, m) and (runs, n, 6)."""
        total = np.zeros(white_aircraft.shape[:-1])
        # Written out: the rounding of a matrix product depends on the library behind it.
        for i in range(self.by_radar.shape[1]):
            total += white_radar[:, i, np.newaxis] * self.by_radar[:, i]
        for i in range(self.by_aircraft.shape[1]):
            total += white_aircraft[..., i] * self.by_aircraft[:, i]
        return total


def _partials(jacobian: FloatArray, factor: FloatArray) -> FloatArray:
    # A gradient may be undefined where nothing is uncertain: 0 · NaN is no uncertainty here.
    known = np.where(np.any(factor != 0, axis=-1), jacobian, 0.0)
    partials: FloatArray = np.sum(known[..., np.newaxis] * factor, axis=-2)
    return partials


def draw(
    sampler: Sampler, linear: LinearModel | None, kind: str, seed: int, runs: int
) -> tuple[FloatArray, FloatArray | None]:
    """Draw P_D (runs, n) and, on the same draws, L − P̄_D (runs, n)."""
    poses = len(sampler.aircraft)
    source = SAMPLERS[kind](seed, BLOCK, poses, sampler.radar_normals)
    p_d = np.empty((runs, poses))
    deviation = None if linear is None else np.empty((runs, poses))
    for first in range(0, runs, BLOCK):
        part = slice(first, min(first + BLOCK, runs))
        block = source.block(first // BLOCK)
        white_radar, white_aircraft = (white[: part.stop - first] for white in block)
        radar, _ = sampler.draw_radar(white_radar)
        p_d[part] = sampler.draw_p_d(white_aircraft, radar)
        if linear is not None and deviation is not None:
            deviation[part] = linear.deviation(white_radar, white_aircraft)
    return p_d, deviation


def plain(p_d: FloatArray) -> FloatArray:
    """Mean, standard deviation, lower and upper quantile (4, n) of draws (runs, n)."""
    # The quantile is numpy's default, as in `monte_carlo`.
    position = np.full(p_d.shape[1], (len(p_d) - 1) * TAIL)
    low, high = _ordered(p_d, position), -_ordered(-p_d, position)
    return np.stack([p_d.mean(axis=0), p_d.std(axis=0, ddof=1), low, high])


def controlled(p_d: FloatArray, deviation: FloatArray, std: FloatArray) -> FloatArray:
    """The same (4, n) with the linear model as control variate; see the head of this module.

    Args:
        p_d: Draws of P_D (runs, n).
        deviation: L − P̄_D (runs, n) on the same draws.
        std: σ_L (n,).

    Returns:
        (4, n), NaN where L is.
    """
    runs = len(p_d)
    mean = p_d.mean(axis=0) - deviation.mean(axis=0)
    variance = p_d.var(axis=0, ddof=1) - (deviation.var(axis=0, ddof=1) - std * std)
    beyond = [np.sum(side * deviation < -3.0 * std, axis=0) for side in (1, -1)]
    low, high = (
        side * _ordered(side * p_d, (runs - 1) / runs * count)
        for side, count in zip((1, -1), beyond, strict=True)
    )
    found = np.stack([mean, np.sqrt(np.maximum(variance, 0.0)), low, high])
    found[:, np.isnan(std)] = np.nan
    return found


def _ordered(rows: FloatArray, position: FloatArray) -> FloatArray:
    """Order statistics (n,) of rows (m, n) at positions (n,) from 0, linear between two."""
    below = np.floor(position).astype(int)
    keep = min(len(rows), int(below.max()) + 2)
    smallest = np.sort(np.partition(rows, keep - 1, axis=0)[:keep], axis=0)
    column = np.arange(rows.shape[1])
    low, high = smallest[below, column], smallest[np.minimum(below + 1, keep - 1), column]
    value: FloatArray = low + (position - below) * (high - low)
    return value


@dataclass(frozen=True, eq=False)
class Convergence:
    """Estimates by number of runs, with what they should be.

    Attributes:
        runs: Numbers of runs (k,), each twice the one before.
        axis: Where the n poses are.
        reference: Mean, standard deviation, lower and upper quantile (4, n).
        reference_error: Their standard errors (4, n).
        estimates: By estimator, (repetitions, k, 4, n).
    """

    runs: NDArray[np.int64]
    axis: Axis
    reference: FloatArray
    reference_error: FloatArray
    estimates: dict[str, FloatArray]

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Poses with a σ_pd that errors can be measured by (n,)."""
        usable: NDArray[np.bool_] = self.reference[1] > LEAST_STD
        return usable

    def error(self, estimator: str, statistic: str) -> FloatArray:
        """RMS error (k,) over repetitions and poses, in units of σ_pd; NaN if there is none."""
        return self._rms(self.estimates[estimator] - self.reference, statistic)

    def own_error(self, statistic: str) -> float:
        """Standard error of the reference, over poses and in units as the errors."""
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
    replications: int = REPLICATIONS,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Convergence:
    """Estimate again and again with up to `runs` runs, a power of two, and make the reference.

    Args:
        scenario: What to draw, at its level; from its seed come those of the repetitions.
        runs: Largest number of runs.
        replications: Independent repetitions.
        workers: Threads to compute with; of no influence on the result.
        progress: Called with 1 whenever one of `replications` + REFERENCES parts is done.
    """
    poses = np.unique(np.linspace(0, len(scenario.aircraft) - 1, POSES).round().astype(int))
    some = scenario.part(poses)
    sampler = Sampler.of(some)
    linear = LinearModel.of(sampler)
    sizes = [n for i in reversed(range(SIZES)) if (n := runs >> i) >= 2]
    seeds = random_stream(scenario.seed, _SEEDS).integers(2**63, size=REFERENCES + replications)

    def reference(seed: int) -> FloatArray:
        return plain(draw(sampler, None, "sobol", seed, REFERENCE_FACTOR * runs)[0])

    def repetition(seed: int) -> dict[str, FloatArray]:
        found = {}
        for kind in SAMPLERS:
            p_d, deviation = draw(sampler, linear, kind, seed, runs)
            assert deviation is not None
            found[kind] = np.stack([plain(p_d[:n]) for n in sizes])
            found[f"{kind}_control"] = np.stack(
                [controlled(p_d[:n], deviation[:n], linear.std) for n in sizes]
            )
        return found

    first, rest = (part.tolist() for part in np.split(seeds, [REFERENCES]))
    references, repetitions = [], []
    with ThreadPoolExecutor(workers) as threads:
        try:
            for stats in threads.map(reference, first):
                references.append(stats)
                if progress:
                    progress(1)
            for found in threads.map(repetition, rest):
                repetitions.append(found)
                if progress:
                    progress(1)
        except BaseException:  # interrupted: what has not begun is not worth waiting for
            threads.shutdown(wait=False, cancel_futures=True)
            raise
    known = np.stack(references)
    return Convergence(
        runs=np.array(sizes),
        axis=some.axis,
        reference=known.mean(axis=0),
        reference_error=known.std(axis=0, ddof=1) / np.sqrt(REFERENCES),
        estimates={name: np.stack([r[name] for r in repetitions]) for name in ESTIMATORS},
    )


def plot(result: Result, figure: Figure) -> None:
    """Draw the figure."""
    from radar_sense.plotting import LINES, draw_legend, draw_line, panels

    rows = panels(figure, len(STATISTICS))
    table, runs = result.table, result.table["runs"]
    marks = dict(zip(ESTIMATORS, ("o", "s", "^", "D"), strict=True))
    names = ("the mean", r"$\sigma$", r"the $3\,\sigma$ quantiles")
    for axes, statistic, name in zip(rows, STATISTICS, names, strict=True):
        errors = {e: table[f"error_{statistic}_{e}"] for e in ESTIMATORS}
        for (estimator, error), style in zip(errors.items(), LINES, strict=False):
            label = estimator.replace("sobol", "Sobol\N{PRIME}").replace("_", ", ")
            draw_line(axes, runs, error, style, label=label if axes is rows[0] else None)
            axes.lines[-1].set(marker=marks[estimator], markersize=2.8)
        axes.set_ylabel(f"Error of {name} [$\\sigma_{{pd}}$]")
        axes.set_xscale("log", base=2)
        axes.margins(x=0.03)
        first = [error[0] for error in errors.values() if np.all(error > 0)]
        if not first:
            continue  # nothing that a logarithmic axis could show
        axes.set_yscale("log")
        _slope(axes, runs, 1.6 * np.max(first), -0.5, "$n^{-1/2}$")
        if statistic != "quantile":  # which nothing brings to fall so fast
            _slope(axes, runs, np.min(first) / 1.6, -1.0, "$n^{-1}$")
    rows[-1].set_xlabel("Number of runs $n$")
    draw_legend(figure, rows[0])


_RUNS = Option(
    "runs",
    "Largest number of runs; a power of two is taken.",
    RUNS,
    default=DEFAULT_RUNS,
)


@analysis(
    plot=plot,
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

    Also with the linear model as a control variate for both. Sobol' points are best for mean and
    sigma, whose error falls nearly as 1/runs; for 3-sigma quantiles they win less. Random draws are
    the only ones whose coverage has a binomial confidence interval.

    Args:
        scenario: The scenario; its number of runs is not used.
        runs: Largest number of runs, of which the largest power of two is taken.
        workers: Threads to compute with; of no influence on the result.
        progress: Shows the repetitions that are done.

    Raises:
        InputError: If runs are out of range.
    """
    if not LIMIT.allows(runs):
        raise ScenarioError(f"runs must be {LIMIT} to show how Monte Carlo converges, got {runs}")
    runs = 1 << (int(runs).bit_length() - 1)
    with progress(REPLICATIONS + REFERENCES, "repetitions") as advance:
        found = measure(scenario, runs, workers=workers, progress=advance)
    errors = {
        (statistic, estimator): found.error(estimator, statistic)
        for statistic in STATISTICS
        for estimator in ESTIMATORS
    }
    rates = {key: rate(found.runs, error) for key, error in errors.items()}
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
            "runs": found.runs.astype(float),
            **{f"error_{statistic}_{name}": e for (statistic, name), e in errors.items()},
        },
        summary={
            "runs": runs,
            "repetitions": REPLICATIONS,
            "poses": {found.axis.key: found.axis.values.tolist()},
            "reference_error": {s: found.own_error(s) for s in STATISTICS},
            "at_largest_runs": last,
        },
        report=(
            f"RMS error with {runs:,} runs ({scenario.level}) in units of sigma of P_D, its rate, "
            "and how many random runs would do the same:",
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
        warnings=(*_too_few(found), *_doubts(found)),
    )


def rate(runs: NDArray[np.int64], error: FloatArray) -> float:
    """Exponent r of an error that falls as runs^r, by least squares over the last of them."""
    runs, error = runs[-RATE_SIZES:], error[-RATE_SIZES:]
    if len(runs) < 2 or not (error > 0).all():
        return float("nan")
    x = np.log(runs) - np.log(runs).mean()
    return float(np.sum(x * np.log(error)) / np.sum(x * x))


def _equal_runs(runs: int, random: float, error: float) -> float:
    """How many random runs have this error, where `runs` have the error `random`."""
    return float(runs * (random / error) ** 2) if error > 0 else float("nan")


def _cell(error: float, rate: float, equal: float) -> str:
    if not error > 0:
        return "none" if error == 0 else "undefined"
    slope = f"n^{rate:<+7.2f}" if np.isfinite(rate) else f"{'no rate':9}"
    return f"{error:<9.2g}{slope}" + f"{equal:.1e}".replace("e+0", "e")


def _too_few(found: Convergence) -> tuple[str, ...]:
    """Say so if there are too few runs for the errors to show a rate."""
    if len(found.runs) >= RATE_SIZES:
        return ()
    least = 2**RATE_SIZES
    shown = f"{len(found.runs)} number{'s' if len(found.runs) > 1 else ''} of runs"
    return (f"{shown} can hardly show a rate; take {least} runs or more",)


def _doubts(found: Convergence) -> tuple[str, ...]:
    undefined: NDArray[np.bool_] = np.isnan(found.estimates["random_control"][0, 0, 0])
    said = (
        (undefined, "the gradient is undefined, and there is no control without a linear model,"),
        (~found.usable, "sigma of P_D is zero, and errors cannot be measured by it,"),
    )
    return tuple(
        f"{words} {place}" + ("" if mask.all() else "; the errors are those of the other poses")
        for mask, words in said
        if (place := describe_poses(mask, found.axis))
    )


def _slope(axes: Axes, runs: FloatArray, start: float, power: float, name: str) -> None:
    """Draw what falls as a power of the number of runs, to compare the lines with."""
    if len(runs) < 2:
        return
    guide = start * (runs / runs[0]) ** power
    axes.plot(runs, guide, color="0.55", lw=0.7)
    middle, above = len(runs) // 2, power > -1
    axes.annotate(
        name,
        (runs[middle], guide[middle]),
        xytext=(0, 3 if above else -3),
        textcoords="offset points",
        ha="left" if above else "right",
        va="bottom" if above else "top",
        fontsize=6.5,
        color="0.35",
    )
