"""Verdict on a method by draws, pose by pose."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from radar_sense import words
from radar_sense.command import (
    LEVEL,
    METHOD,
    ONE_RADAR,
    SEED_OF_DRAWS,
    WORKER_THREADS,
    Option,
    Result,
    command,
)
from radar_sense.montecarlo.adaptive import DIGITS, Validation, validate_method
from radar_sense.montecarlo.montecarlo import WITHIN_3_SIGMA
from radar_sense.propagation import no_draws
from radar_sense.scenario import Scenario

if TYPE_CHECKING:
    from radar_sense.axis import Axis
    from radar_sense.plotting import Figure


@command(
    LEVEL,
    ONE_RADAR,
    METHOD,
    Option(
        "digits", "Significant digits of the standard deviation that matter.", DIGITS, default=2
    ),
    SEED_OF_DRAWS,
    WORKER_THREADS,
    examples=(
        "radar-sense validate --digits 1",
        "radar-sense validate my.yaml --method form --digits 1",
    ),
)
def validate(scenario: Scenario, *, digits: int = 2, workers: int = 1) -> Result:
    """May a method be trusted here? A verdict by as many draws as it takes.

    The 3-sigma intervals of the method and of the draws are compared, to the digits that matter
    (the tolerance of JCGM 101, clauses 7.9.2 and 8.1). The exit code is 3 if the method does not
    agree with the draws at every pose.

    Args:
        scenario: The scenario.
        digits: Significant digits of the standard deviation that matter.
        workers: Threads to compute with; the result does not depend on their number.

    Raises:
        InputError: If there is no such method, or digits are out of range.
    """
    axis, method = scenario.axis, scenario.method
    no_draws(method)
    result = Result(scenario, method)
    verdict = validate_method(scenario, method=method, digits=digits, workers=workers)
    plain = verdict.plain
    low, high = plain.coverage_interval()

    words.add_axis(result.table, axis)
    words.add_band(result.table, plain.band)
    words.add_draws(result.table, replace(plain, lower=verdict.lower, upper=verdict.upper))
    for name, values, meaning in (
        ("delta", verdict.delta, "Numerical tolerance of P_D, from the digits of sigma."),
        ("distance_lower", verdict.distance_lower, "Distance of the method's lower bound."),
        ("distance_upper", verdict.distance_upper, "Distance of the method's upper bound."),
        ("runs", verdict.runs.astype(float), "Number of draws with emphasis on the tails."),
        ("coverage_3sigma", plain.coverage, words.COVERAGE),
        ("coverage_low", low, "Lower end of the 95 % confidence interval of the coverage."),
        ("coverage_high", high, "Upper end of the 95 % confidence interval of the coverage."),
        ("stable", verdict.stable.astype(float), "1 where the draws are stable to the tolerance."),
        ("validated", verdict.agrees.astype(float), "1 where the method agrees with the draws."),
    ):
        result.table.add(name, values, meaning)
    words.add_mean(result.table, plain.band.mean, method)

    distance = np.fmax(verdict.distance_lower, verdict.distance_upper)
    # Where P_D is certain δ is 0. The distance is 0 too, unless the method is wrong.
    without = np.where(distance > 0, np.inf, distance)
    ratio = np.divide(distance, verdict.delta, out=without, where=verdict.delta > 0)
    count = int(np.count_nonzero(verdict.agrees))
    result.passed = verdict.verdict == "agrees"
    result.summary |= {
        "verdict": verdict.verdict,
        "digits": digits,
        "plain_runs": plain.runs,
        "poses_agree": count,
        "poses_differ": int(np.count_nonzero(verdict.differs)),
        "poses_undecided": int(np.count_nonzero(verdict.undecided)),
        "largest_distance_by_delta": words.peak(ratio, axis),
        "radar_constants_set_to_zero": plain.clipped,
    }
    result.report += [
        f"{method} 3-sigma interval ({scenario.level}), {digits} significant "
        f"digit{'s' if digits > 1 else ''}: "
        + ("agrees with draws" if result.passed else "does NOT agree with draws"),
        f"  agrees at {count} of {len(axis)} poses",
    ]
    for what, mask in (
        ("no result", ~plain.has_band),
        ("differs", verdict.differs & plain.has_band),
        ("undecided, too few draws", verdict.undecided),
    ):
        if place := words.describe_poses(mask, axis):
            result.report.append(f"  {what} {place}")
    if plain.has_band.any():
        pose = int(np.argmax(words.reached(ratio)))
        result.report += [
            f"  worst: bound off by {distance[pose]:.2g} at {axis.at(pose)} "
            f"(tolerance {verdict.delta[pose]:.1g})",
            f"  coverage {np.nanmin(plain.coverage):.2%} to {np.nanmax(plain.coverage):.2%} "
            f"of {plain.runs:,} plain draws a pose, {WITHIN_3_SIGMA:.2%} expected",
        ]
    result.warnings += words.validity_warnings(scenario, plain.band, method, "the draws hold there")
    result.warnings += words.clipping_warnings(plain.clipped)
    result.warnings += words.table_warnings(scenario)
    result.draw = partial(_draw, axis=axis, verdict=verdict)
    return result


def _draw(figure: Figure, axis: Axis, verdict: Validation) -> None:
    """Draw the distances over the tolerance, the coverage, and where the method agrees."""
    from radar_sense import plotting

    (top, bottom), x = plotting.pose_panels(figure, 2, axis)
    for axes in (top, bottom):
        label = f"{verdict.method} agrees" if axes is top else None
        plotting.draw_shade(axes, verdict.agrees, x, label=label)
    distances = {"lower": verdict.distance_lower, "upper": verdict.distance_upper}
    for (end, distance), style in zip(distances.items(), plotting.LINES, strict=False):
        with np.errstate(invalid="ignore"):  # 0/0 where no radar sees the aircraft, a gap
            plotting.draw_line(top, x, distance / verdict.delta, style, label=f"{end} bound")
    top.axhline(1.0, color="black", lw=plotting.points(0.8))
    top.set_yscale("log")
    top.set_ylabel("Distance from Monte Carlo\nover its tolerance")
    bottom.axhline(100 * WITHIN_3_SIGMA, color="black", lw=plotting.points(0.8), label="99.73 %")
    low, high = verdict.plain.coverage_interval()
    plotting.draw_fill(
        bottom,
        x,
        100 * low,
        100 * high,
        color=plotting.LINES[2][0],
        lw=plotting.points(0.4),
        label="coverage (95 %)",
    )
    bottom.set_ylabel("Coverage [%]")
    plotting.draw_legend(figure, top, bottom)
