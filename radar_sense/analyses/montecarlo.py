"""Monte Carlo draws of P_D against the 3σ band of a method."""

from __future__ import annotations

from concurrent.futures import Executor
from functools import partial
from typing import Any

import numpy as np

from radar_sense import options, plotting, words
from radar_sense.command import Figure, Result, command
from radar_sense.montecarlo.montecarlo import MonteCarlo, monte_carlo
from radar_sense.propagation import no_draws
from radar_sense.scenario import Scenario


@command(
    options.LEVEL,
    options.ONE_RADAR,
    options.METHOD_BUT_DRAWS,
    options.K,
    options.NUMBER_OF_RUNS,
    options.SEED_OF_DRAWS,
    options.SAMPLER,
    options.WORKER_THREADS,
    options.DASK,
    examples=(
        "radar-sense montecarlo",
        "radar-sense montecarlo my.yaml --runs 1e6 --seed 7",
        "radar-sense montecarlo --sampler sobol --runs 4096",
        "radar-sense montecarlo network.yaml --radar ridge",
    ),
)
def montecarlo(
    scenario: Scenario,
    *,
    k: float = 3.0,
    sampler: str = "random",
    workers: int = 1,
    executor: Executor | None = None,
) -> Result:
    """Monte Carlo draws of P_D against the band of a method."""
    axis, method = scenario.axis, scenario.method
    no_draws(method)
    result = Result(scenario)
    mc = monte_carlo(
        scenario, method=method, k=k, sampler=sampler, workers=workers, executor=executor
    )

    words.add_axis(result.table, axis)
    words.add_band(result.table, mc.band, k)
    words.add_draws(result.table, mc, k)
    meaning = f"Share of the draws within the {k:g}-sigma band of the method."
    result.table.add(f"coverage_{k:.12g}sigma", mc.coverage, meaning)
    words.add_mean(result.table, mc.band.mean, method)

    result.summary |= {"runs": mc.runs, "sampler": mc.sampler}
    result.warnings += words.validity_warnings(scenario, mc.band, k, words.BY_DRAWS)
    _add_coverage(result, mc)
    result.summary |= {
        "largest_mean_shift": words.peak(abs(mc.mean - mc.band.p_d), axis),
        "radar_constants_set_to_zero": mc.clipped,
    }
    result.warnings += words.table_warnings(scenario)
    by = "" if method == "linear" else f" by {method}"
    label = rf"band of ${k:g}\,\sigma${by} ({scenario.level})"
    draw = _draw_histogram if len(axis) == 1 else _draw
    result.draw = partial(draw, scenario=scenario, mc=mc, band_label=label)
    return result


def _add_coverage(result: Result, mc: MonteCarlo) -> None:
    """Add the share of the draws in the band, beside the expected share."""
    axis, banded, method = result.scenario.axis, mc.has_band, result.scenario.method
    without = int(np.count_nonzero(~banded))
    pose = int(np.argmin(np.where(banded, mc.coverage, np.inf)))
    overall = float(mc.coverage[banded].mean()) if banded.any() else float("nan")
    lowest: dict[str, Any] = {
        "value": float(mc.coverage[pose]),
        axis.key: float(axis.values[pose]) if banded.any() else float("nan"),
    }
    result.summary |= {
        "coverage_expected": mc.expected,
        "coverage_overall": overall,
        "coverage_lowest": lowest,
        "poses_without_band": without,
    }
    confidence = told = ""
    if mc.sampler == "random":
        low, high = mc.coverage_interval()
        # Bonferroni's correction: 95 % confidence for all poses together.
        least, most = mc.coverage_interval(1 - 0.05 / len(axis))
        fewer, more = most < mc.expected, least > mc.most_expected
        off = fewer | more
        confidence = f" (95 % confidence {low[pose]:.2%} to {high[pose]:.2%})"
        lowest["confidence_95"] = [float(low[pose]), float(high[pose])]
        result.summary["coverage_confidence_95"] = {"lower": low.tolist(), "upper": high.tolist()}
        result.summary["poses_inconsistent"] = int(np.count_nonzero(off))
        if off.any():
            seen = (word for word, mask in (("fewer", fewer), ("more", more)) if mask.any())
            told = (
                f"the {method} band holds {' or '.join(seen)} than "
                f"{100 * mc.expected:.2f} % of the draws "
                f"{words.describe_poses(off, axis)} (95 % confidence for all poses together)"
            )
    points = "" if mc.sampler == "random" else ", Sobol' points"
    drawn = f"{mc.runs} runs ({result.scenario.level}, seed {mc.seed}{points})"
    if banded.any():
        least_at = words.describe_poses(banded & (mc.coverage == mc.coverage[pose]), axis)
        of_poses = f" at the {len(axis) - without} poses with a band" if without else ""
        result.report += [
            f"{drawn}: {overall:.2%} of the draws lie in the {method} {mc.k:g}-sigma band"
            f"{of_poses}, {mc.expected:.2%} expected",
            f"lowest coverage {mc.coverage[pose]:.2%} {least_at}{confidence}",
        ]
    else:
        result.report.append(f"{drawn}: no coverage")
    if told and any(text.endswith("[band-off]") for text in result.warnings):
        result.report.append(told)  # one warning of a band is enough
    elif told:
        result.warnings.append(words.warning("coverage-off", told))
    if without:
        result.report.append(
            f"{without} of {len(axis)} poses have no {method} band and no coverage"
        )


def _draw(figure: Figure, scenario: Scenario, mc: MonteCarlo, band_label: str) -> None:
    """Draw the first runs and the band, and both without the nominal P_D."""
    p_d, paths, label = mc.band.p_d, mc.sample_paths, _runs_label(mc)
    (top, bottom), x = plotting.pose_panels(figure, 2, scenario.axis)
    plotting.draw_sample_paths(top, x, paths, label)
    plotting.draw_line(top, x, p_d, ("black", "-"), label=r"nominal $\bar P_D$")
    plotting.draw_band(top, x, mc.band.lower, mc.band.upper, band_label)
    top.set_ylabel(r"$P_D$")
    plotting.draw_sample_paths(bottom, x, paths - p_d, label)
    plotting.draw_band(bottom, x, mc.band.lower - p_d, mc.band.upper - p_d, band_label)
    bottom.set_ylabel(r"Error $P_D - \bar P_D$")
    plotting.draw_legend(figure, top)


def _draw_histogram(figure: Figure, scenario: Scenario, mc: MonteCarlo, band_label: str) -> None:
    """Draw a histogram of the first runs at the only pose."""
    (axes,) = plotting.panels(figure, 1)
    colour = plotting.SAMPLE_PATH_COLOURS[1]
    axes.hist(mc.sample_paths[:, 0], bins=30, color=colour, label=_runs_label(mc))
    axes.axvline(mc.band.p_d[0], color="black", label=r"nominal $\bar P_D$")
    for end, label in ((mc.band.lower, band_label), (mc.band.upper, None)):
        if np.isfinite(end[0]):
            axes.axvline(end[0], color=plotting.BAND[0], ls=plotting.BAND[1], label=label)
    axes.set_xlabel(rf"$P_D$ at {scenario.axis.name} {scenario.axis.at(0)}")
    axes.set_ylabel("Number of draws")
    plotting.draw_legend(figure, axes)


def _runs_label(mc: MonteCarlo) -> str:
    """Return the number of runs in the figure, of all runs."""
    drawn = len(mc.sample_paths)
    return f"{mc.runs} runs" if drawn == mc.runs else f"{drawn} of {mc.runs} runs"
