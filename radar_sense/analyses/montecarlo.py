"""Monte Carlo draws of P_D against the 3σ band of a method."""

from __future__ import annotations

from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from radar_sense.analyses.columns import AXIS, BAND, COVERAGE, DRAWS, MEAN
from radar_sense.analyses.contract import Result, analysis
from radar_sense.montecarlo.montecarlo import WITHIN_3_SIGMA, MonteCarlo, monte_carlo
from radar_sense.propagation import no_draws
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray
from radar_sense.words import (
    band_columns,
    clipping_warnings,
    describe_extreme,
    describe_poses,
    largest_by_radar,
    mean_column,
    monte_carlo_columns,
    peak,
    points_named,
    radar_lines,
    radar_summary,
    table_warnings,
    validity_warnings,
)

if TYPE_CHECKING:
    from radar_sense.plotting import Figure


def plot(result: Result, figure: Figure) -> None:
    """Draw the figure."""
    if len(result.scenario.axis) == 1:
        _plot_one_pose(result, figure)
        return
    from radar_sense import plotting

    table = result.table
    paths, p_d, label = result.arrays["sample_paths"], table["p_d"], _runs_label(result)
    (top, bottom), x = plotting.pose_panels(figure, 2, result.scenario.axis)
    lower, upper = table["lower_3sigma"], table["upper_3sigma"]
    plotting.draw_sample_paths(top, x, paths, label)
    plotting.draw_line(top, x, p_d, ("black", "-"), label=r"nominal $\bar P_D$")
    plotting.draw_band(top, x, lower, upper, result.band_label)
    top.set_ylabel(r"$P_D$")
    plotting.draw_sample_paths(bottom, x, paths - p_d, label)
    plotting.draw_band(bottom, x, lower - p_d, upper - p_d, result.band_label)
    bottom.set_ylabel(r"Error $P_D - \bar P_D$")
    plotting.draw_legend(figure, top)


def _plot_one_pose(result: Result, figure: Figure) -> None:
    """Draw a histogram of the draws at the only pose."""
    from radar_sense import plotting

    table, axis = result.table, result.scenario.axis
    (axes,) = plotting.panels(figure, 1)
    draws = result.arrays["sample_paths"][:, 0]
    axes.hist(draws, bins=30, color=plotting.SAMPLE_PATH_COLOUR, label=_runs_label(result))
    axes.axvline(table["p_d"][0], color="black", label=r"nominal $\bar P_D$")
    for end, words in (("lower_3sigma", result.band_label), ("upper_3sigma", None)):
        if np.isfinite(table[end][0]):
            axes.axvline(table[end][0], color=plotting.BAND[0], ls=plotting.BAND[1], label=words)
    axes.set_xlabel(rf"$P_D$ at {axis.name} {axis.at(0)}")
    axes.set_ylabel("Number of draws")
    plotting.draw_legend(figure, axes)


def _runs_label(result: Result) -> str:
    """Return the number of runs in the figure, of all runs."""
    drawn, runs = len(result.arrays["sample_paths"]), result.summary["runs"]
    return f"{runs} runs" if drawn == runs else f"{drawn} of {runs} runs"


_TABLE = (*AXIS, *BAND, *DRAWS, COVERAGE, MEAN)


@analysis(
    plot=plot,
    columns=_TABLE,
    options=["level", "radar", "method", "runs", "seed", "sampler", "workers", "dask"],
    examples=[
        "radar-sense montecarlo",
        "radar-sense montecarlo my.yaml --runs 1e6 --seed 7",
        "radar-sense montecarlo --sampler sobol --runs 4096",
        "radar-sense montecarlo network.yaml --radar ridge",
    ],
)
def montecarlo(
    scenario: Scenario,
    *,
    sampler: str = "random",
    workers: int = 1,
    executor: Executor | None = None,
) -> Result:
    """Monte Carlo draws of P_D against the band of a method.

    Args:
        scenario: The scenario.
        sampler: "random" or "sobol".
        workers: Threads to compute with; the result does not depend on their number.
        executor: Computes the blocks in place of threads.

    Raises:
        InputError: If there is no such method or sampler.
    """
    method = scenario.method
    no_draws(method)
    axis = scenario.axis
    mc = monte_carlo(scenario, method=method, sampler=sampler, workers=workers, executor=executor)
    coverage = _coverage(scenario, mc, method)
    by_itself = largest_by_radar(scenario, method)
    return Result(
        scenario=scenario,
        method=method,
        table={
            axis.key: axis.values,
            **band_columns(mc.band),
            **monte_carlo_columns(mc),
            "coverage_3sigma": mc.coverage,
            **mean_column(mc.band.mean, method),
        },
        summary={
            "runs": mc.runs,
            "sampler": mc.sampler,
            **coverage.summary,
            "largest_mean_shift": peak(abs(mc.mean - mc.band.p_d), axis),
            "radar_constants_set_to_zero": mc.clipped,
            **radar_summary(by_itself),
        },
        report=(
            *coverage.report,
            *radar_lines(
                {name: describe_extreme(top, axis) for name, top in by_itself.items()}, method
            ),
        ),
        warnings=(
            *validity_warnings(scenario, mc.band, method, "the draws hold there"),
            *coverage.warnings,
            *clipping_warnings(mc.clipped),
            *table_warnings(scenario, runs=mc.runs),
        ),
        arrays={"sample_paths": mc.sample_paths},
    )


class _Coverage(NamedTuple):
    """The coverage of the band, for the record, the terminal and the warnings."""

    summary: dict[str, Any]
    report: list[str]
    warnings: list[str]


def _coverage(scenario: Scenario, mc: MonteCarlo, method: str) -> _Coverage:
    """Compare the share of the draws in the 3σ band with the expected share."""
    axis, banded = scenario.axis, mc.has_band
    without = int(np.count_nonzero(~banded))
    pose = int(np.argmin(np.where(banded, mc.coverage, np.inf)))
    overall = float(mc.coverage[banded].mean()) if banded.any() else float("nan")
    lowest: dict[str, Any] = {
        "value": float(mc.coverage[pose]),
        axis.key: float(axis.values[pose]) if banded.any() else float("nan"),
    }
    summary: dict[str, Any] = {
        "coverage_expected": WITHIN_3_SIGMA,
        "coverage_overall": overall,
        "coverage_lowest": lowest,
        "poses_without_band": without,
    }
    confidence, warnings = "", []
    if mc.sampler == "random":
        low, high = mc.coverage_interval()
        # Bonferroni's correction: 95 % confidence for all poses together.
        least, most = mc.coverage_interval(1 - 0.05 / len(axis))
        off = (most < WITHIN_3_SIGMA) | (least > WITHIN_3_SIGMA)
        confidence = f" (95 % confidence {low[pose]:.2%} to {high[pose]:.2%})"
        lowest["confidence_95"] = [float(low[pose]), float(high[pose])]
        summary["coverage_confidence_95"] = {"lower": low.tolist(), "upper": high.tolist()}
        summary["poses_inconsistent"] = int(np.count_nonzero(off))
        if off.any():
            warnings.append(
                f"the {method} band holds {_fewer_or_more(most, least)} than 99.73 % of the draws "
                f"{describe_poses(off, axis)} (95 % confidence for all poses together)"
            )
    drawn = f"{mc.runs} runs ({scenario.level}, seed {mc.seed}{points_named(mc)})"
    report = [f"{drawn}: no coverage"]
    if banded.any():
        of_poses = f" at the {len(axis) - without} poses with a band" if without else ""
        report = [
            f"{drawn}: {overall:.2%} of the draws lie in the {method} 3-sigma band{of_poses}, "
            f"{WITHIN_3_SIGMA:.2%} expected",
            f"lowest coverage {mc.coverage[pose]:.2%} at {axis.at(pose)}{confidence}",
        ]
    if without:
        report.append(f"{without} of {len(axis)} poses have no {method} band and no coverage")
    return _Coverage(summary, report, warnings)


def _fewer_or_more(most: FloatArray, least: FloatArray) -> str:
    """Return "fewer", "more" or both, for coverages below and above the expected coverage."""
    words = []
    if (most < WITHIN_3_SIGMA).any():
        words.append("fewer")
    if (least > WITHIN_3_SIGMA).any():
        words.append("more")
    return " or ".join(words)
