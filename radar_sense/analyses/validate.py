"""Verdict on a method by adaptive Monte Carlo, pose by pose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from radar_sense.analyses.columns import AXIS, BAND, COVERAGE, DRAWS, MEAN, quantities
from radar_sense.analyses.contract import Option, Progress, Result, analysis, silent
from radar_sense.montecarlo import adaptive
from radar_sense.montecarlo.adaptive import DIGITS
from radar_sense.montecarlo.montecarlo import WITHIN_3_SIGMA
from radar_sense.propagation import no_draws
from radar_sense.scenario import Scenario
from radar_sense.words import (
    band_columns,
    clipping_warnings,
    describe_poses,
    mean_column,
    monte_carlo_columns,
    peak,
    reached,
    table_warnings,
    validity_warnings,
)

if TYPE_CHECKING:
    from radar_sense.plotting import Figure


def plot(result: Result, figure: Figure) -> None:
    """Draw the figure."""
    from radar_sense import plotting

    (top, bottom), x = plotting.pose_panels(figure, 2, result.scenario.axis)
    table = result.table
    for axes in (top, bottom):
        label = f"{result.method} validated" if axes is top else None
        plotting.draw_shade(axes, table["validated"] > 0, x, label=label)
    for end, style in zip(("lower", "upper"), plotting.LINES, strict=False):
        with np.errstate(invalid="ignore"):  # 0/0 where no radar sees the aircraft, a gap
            distance = table[f"distance_{end}"] / table["delta"]
        plotting.draw_line(top, x, distance, style, label=f"{end} bound")
    top.axhline(1.0, color="black", lw=plotting.points(0.8))
    top.set_yscale("log")
    top.set_ylabel("Distance from Monte Carlo\nover its tolerance")
    bottom.axhline(100 * WITHIN_3_SIGMA, color="black", lw=plotting.points(0.8), label="99.73 %")
    plotting.draw_fill(
        bottom,
        x,
        100 * table["coverage_low"],
        100 * table["coverage_high"],
        color=plotting.LINES[2][0],
        lw=plotting.points(0.4),
        label="coverage (95 %)",
    )
    bottom.set_ylabel("Coverage [%]")
    plotting.draw_legend(figure, top, bottom)


_DIGITS = Option(
    "digits", "Significant digits of the standard deviation that matter.", DIGITS, default=2
)


_TABLE = (
    *AXIS,
    *BAND,
    *DRAWS,
    *quantities(
        {
            "delta": "Numerical tolerance of P_D, from the significant digits of sigma.",
            "distance_lower": "Distance between the lower bounds by the method and by the draws.",
            "distance_upper": "Distance between the upper bounds by the method and by the draws.",
            "runs": "Number of draws at this pose.",
        }
    ),
    COVERAGE,
    *quantities(
        {
            "coverage_low": "Lower end of the 95 % confidence interval of the coverage.",
            "coverage_high": "Upper end of the 95 % confidence interval of the coverage.",
            "stable": "1 where the draws are stable to the tolerance, else 0.",
            "validated": "1 where the method is validated, else 0.",
        }
    ),
    MEAN,
)


@analysis(
    plot=plot,
    columns=_TABLE,
    options=["level", "radar", "method", _DIGITS, "seed", "workers"],
    examples=[
        "radar-sense validate --digits 1",
        "radar-sense validate my.yaml --method form --digits 1",
    ],
)
def validate(
    scenario: Scenario,
    *,
    digits: int = 2,
    workers: int = 1,
    progress: Progress = silent,
) -> Result:
    """May a method be trusted here? A verdict by adaptive Monte Carlo.

    Runs are drawn until mean, deviation and 3-sigma interval are stable to the digits that matter.
    Then the intervals of the method and of the draws are compared (JCGM 101, clauses 7.9 and 8).
    The exit code is 3 if the method is not validated at every pose.

    Args:
        scenario: The scenario.
        digits: Significant digits of the standard deviation that matter.
        workers: Threads to compute with; the result does not depend on their number.
        progress: Shows the poses that are done.

    Raises:
        InputError: If there is no such method, or digits are out of range.
    """
    method = scenario.method
    no_draws(method)
    axis = scenario.axis
    with progress(len(axis), "poses") as advance:
        verdict = adaptive.validate_method(
            scenario, method=method, digits=digits, workers=workers, progress=advance
        )
    low, high = verdict.coverage_interval()
    distance = np.fmax(verdict.distance_lower, verdict.distance_upper)
    # Where P_D is certain δ is 0. The distance is 0 too, unless the method is wrong.
    without = np.where(distance > 0, np.inf, distance)
    ratio = np.divide(distance, verdict.delta, out=without, where=verdict.delta > 0)
    no_result = ~np.isfinite(verdict.moments.lower + verdict.moments.upper)
    count = int(np.count_nonzero(verdict.validated))
    report = [
        f"{method} 3-sigma interval ({scenario.level}), {digits} significant "
        f"digit{'s' if digits > 1 else ''}: "
        + ("validated" if verdict.verdict == "validated" else "NOT validated"),
        f"  validated at {count} of {len(axis)} poses",
    ]
    if place := describe_poses(no_result, axis):
        report.append(f"  no result {place}")
    if place := describe_poses(verdict.refuted & ~no_result, axis):
        report.append(f"  refuted {place}")
    if place := describe_poses(verdict.undecided, axis):
        report.append(f"  undecided {place}: the draws did not become stable")
    worst = peak(ratio, axis)
    if not no_result.all():
        pose = int(np.argmax(reached(ratio)))
        report += [
            f"  worst: bound off by {distance[pose]:.2g} at {axis.at(pose)} "
            f"(tolerance {verdict.delta[pose]:.1g})",
            f"  coverage {np.nanmin(verdict.coverage):.2%} to {np.nanmax(verdict.coverage):.2%} "
            f"of {verdict.runs.min():,} to {verdict.runs.max():,} draws a pose, "
            f"{WITHIN_3_SIGMA:.2%} expected",
        ]
    return Result(
        scenario=scenario,
        method=method,
        table={
            axis.key: axis.values,
            **band_columns(verdict.moments),
            **monte_carlo_columns(verdict.draws),
            "delta": verdict.delta,
            "distance_lower": verdict.distance_lower,
            "distance_upper": verdict.distance_upper,
            "runs": verdict.runs.astype(float),
            "coverage_3sigma": verdict.coverage,
            "coverage_low": low,
            "coverage_high": high,
            "stable": verdict.stable.astype(float),
            "validated": verdict.validated.astype(float),
            **mean_column(verdict.moments.mean, method),
        },
        summary={
            "verdict": verdict.verdict,
            "digits": digits,
            "poses_validated": count,
            "poses_refuted": int(np.count_nonzero(verdict.refuted)),
            "poses_undecided": int(np.count_nonzero(verdict.undecided)),
            "largest_distance_by_delta": worst,
            "radar_constants_set_to_zero": verdict.clipped,
        },
        report=tuple(report),
        warnings=(
            *validity_warnings(scenario, verdict.moments, method, "the draws hold there"),
            *clipping_warnings(verdict.clipped),
            *table_warnings(scenario),
        ),
        passed=verdict.verdict == "validated",
    )
