"""Error of Monte Carlo by number of runs, for random and Sobol' draws."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np

from radar_sense import options, plotting
from radar_sense.command import Axes, Figure, Option, Result, command
from radar_sense.limits import Limit
from radar_sense.montecarlo.convergence import (
    LARGEST_ERROR,
    RATE_SIZES,
    REPLICATIONS,
    STATISTICS,
    Convergence,
    measure,
    rate,
)
from radar_sense.montecarlo.sequences import SAMPLERS
from radar_sense.montecarlo.statistics import LEAST_STD
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray
from radar_sense.words import placed, warning

#: Limit of the largest number of runs.
LIMIT = Limit(at_least=2, at_most=2**17, whole=True)


@command(
    options.LEVEL,
    options.ONE_RADAR,
    Option("runs", "Largest number of runs, rounded down to a power of two.", LIMIT),
    options.SEED_OF_DRAWS,
    options.WORKER_THREADS,
    examples=(
        "radar-sense convergence --runs 4096",
        "radar-sense convergence my.yaml --level high --runs 65536",
    ),
)
def convergence(scenario: Scenario, *, runs: int = 2**14, workers: int = 1) -> Result:
    """Error of Monte Carlo by number of runs, for random and Sobol' draws.

    Sobol' points are best for mean and sigma. Their error falls nearly as 1/runs. For 3-sigma
    quantiles the gain is smaller. Only random draws give the coverage a binomial confidence
    interval.
    """
    runs = 1 << (runs.bit_length() - 1)
    measured = measure(scenario, runs, workers=workers)
    result = Result(scenario.with_analysis(runs=runs))

    result.table.add("runs", measured.runs.astype(float), "Number of runs.")
    names = {"mean": "the mean", "std": "sigma", "quantile": "the 3-sigma quantiles"}
    last: dict[str, dict[str, dict[str, float]]] = {}
    for statistic, of in measured.errors.items():
        last[statistic] = {}
        for kind, error in of.items():
            meaning = f"RMS error of {names[statistic]} by {kind} draws, in sigma of P_D."
            result.table.add(f"error_{statistic}_{kind}", error, meaning)
            times = of["random"][-1] / error[-1] if error[-1] > 0 else np.nan
            last[statistic][kind] = {
                "error": float(error[-1]),
                "rate": rate(measured.runs, error),
                "random_runs_for_the_same": float(runs * times**2),
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


def _cell(error: float, rate: float, random_runs_for_the_same: float) -> str:
    if not error > 0:
        return "none" if error == 0 else "undefined"
    # from one seed to another rates differ by some 0.1, and the runs by a factor of 2
    slope = f"n^{rate:<+7.1f}" if np.isfinite(rate) else f"{'no rate':9}"
    runs = f"{random_runs_for_the_same:.1e}".replace("e+0", "e")
    if random_runs_for_the_same < 1e6:
        runs = f"{float(runs):,.0f}"
    return f"{error:<9.2g}{slope}{runs}"


def _warnings(measured: Convergence) -> Iterator[str]:
    """Yield warnings of too few runs, of poses without σ of P_D, and of a σ that is not known."""
    if (count := len(measured.runs)) < RATE_SIZES:
        text = f"too few numbers of runs for a rate: {count}; take {2**RATE_SIZES} runs or more"
        yield warning("runs-few", text)
    axis, unknown, zero = measured.axis, measured.unknown, ~(measured.reference[1] > LEAST_STD)
    others = "" if np.all(zero | unknown) else "; the errors are of the other poses"
    text = "sigma of P_D, the unit of the errors, is"
    yield from placed("sigma-zero", zero & ~unknown, axis, f"{text} zero in the draws", others)
    rough, more = f"{text} known to no better than {LARGEST_ERROR:.0%}", f"{others}; take more runs"
    yield from placed("reference-imprecise", unknown, axis, rough, more)


def _draw(figure: Figure, runs: FloatArray, errors: Mapping[str, Mapping[str, FloatArray]]) -> None:
    """Draw the errors of each statistic by number of runs."""
    rows = plotting.panels(figure, len(STATISTICS))
    names = ("the mean", r"$\sigma$", r"the $3\,\sigma$ quantiles")
    labels = {"random": ("random", "o"), "sobol": ("Sobol\N{PRIME}", "s")}
    for axes, statistic, name in zip(rows, STATISTICS, names, strict=True):
        for (kind, error), style in zip(errors[statistic].items(), plotting.LINES, strict=False):
            label, marker = labels[kind]
            size = plotting.points(2.8)
            plotting.draw_line(axes, runs, error, style, marker=marker, ms=size, label=label)
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
    guide = start * (runs / runs[0]) ** power
    axes.plot(runs, guide, color="0.55", lw=plotting.points(0.7))
    middle, above = len(runs) // 2, power > -1
    up, side = (3.0, "left") if above else (-3.0, "right")
    plotting.note(axes, name, (runs[middle], guide[middle]), 0.0, up, ha=side, color="0.35")
