"""Verdict on a method by adaptive Monte Carlo, pose by pose."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

from radar_sense.analyses.contract import Result
from radar_sense.analyses.report import (
    _band,
    _band_name,
    _chosen,
    _clipped,
    _doubts,
    _drawn,
    _mean,
    _not_as_taken,
    peak,
    reached,
    where,
)
from radar_sense.montecarlo import adaptive as validation
from radar_sense.montecarlo.montecarlo import WITHIN_3_SIGMA
from radar_sense.plotting import _LINES, _fill, _legend, _line, _new, _shade, _x
from radar_sense.scenario import Scenario


def _validate(result: Result) -> Figure:
    figure, (top, bottom) = _new(2, result)
    table, x = result.table, _x(result)
    for axes in (top, bottom):
        label = f"{result.method} validated" if axes is top else None
        _shade(axes, table["validated"] > 0, x, label=label)
    for end, style in zip(("lower", "upper"), _LINES, strict=False):
        with np.errstate(invalid="ignore"):  # 0/0 where a radar sees nothing: a gap in the line
            distance = table[f"distance_{end}"] / table["delta"]
        _line(top, x, distance, style, label=f"{end} bound")
    top.axhline(1.0, color="black", lw=0.8)
    top.set_yscale("log")
    top.set_ylabel(r"Distance from Monte Carlo [$\delta$]")
    expected = "99.73 %"
    bottom.axhline(100 * WITHIN_3_SIGMA, color="black", lw=0.8, label=expected)
    _fill(
        bottom,
        x,
        100 * table["coverage_low"],
        100 * table["coverage_high"],
        color=_LINES[2][0],
        lw=0.4,
        label="coverage (95 %)",
    )
    bottom.set_ylabel("Coverage [%]")
    _legend(figure, top, bottom)
    return figure


def validate(
    scenario: Scenario,
    *,
    method: str | None = None,
    digits: int = 2,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Result:
    """Verdict on a method of propagation by adaptive Monte Carlo, pose by pose."""
    axis = scenario.axis
    found = validation.validate(
        scenario, method=_chosen(method), digits=digits, workers=workers, progress=progress
    )
    low, high = found.coverage_interval()
    distance = np.fmax(found.distance_lower, found.distance_upper)
    # where a radar sees nothing there is no deviation and no δ, and no distance either
    without = np.where(distance > 0, np.inf, distance)
    ratio = np.divide(distance, found.delta, out=without, where=found.delta > 0)
    no_result = ~np.isfinite(found.moments.lower + found.moments.upper)
    count = int(np.count_nonzero(found.validated))
    name = _band_name(method)
    report = [
        f"{name} 3-sigma interval ({scenario.level}), {digits} significant "
        f"digit{'s' if digits > 1 else ''}: "
        + ("validated" if found.verdict == "validated" else "NOT validated"),
        f"  validated at {count} of {len(axis)} poses",
    ]
    if place := where(no_result, axis):
        report.append(f"  no result {place}")
    if place := where(found.refuted & ~no_result, axis):
        report.append(f"  refuted {place}")
    if place := where(found.undecided, axis):
        report.append(f"  undecided {place}: the draws did not become stable")
    worst = peak(ratio, axis)
    if not no_result.all():
        pose = int(np.argmax(reached(ratio)))
        report += [
            f"  farthest for what is allowed: {distance[pose]:.2g} "
            f"at {axis.at(pose)}, where {found.delta[pose]:.1g} is",
            f"  coverage {np.nanmin(found.coverage):.2%} to {np.nanmax(found.coverage):.2%} "
            f"of {found.runs.min():,} to {found.runs.max():,} draws a pose, "
            f"{WITHIN_3_SIGMA:.2%} expected",
        ]
    return Result(
        analysis="validate",
        scenario=scenario,
        method=_chosen(method),
        table={
            axis.key: axis.values,
            **_band(found.moments),
            **_drawn(found.mc_mean, found.mc_std, found.mc_lower, found.mc_upper),
            "delta": found.delta,
            "distance_lower": found.distance_lower,
            "distance_upper": found.distance_upper,
            "runs": found.runs.astype(float),
            "coverage_3sigma": found.coverage,
            "coverage_low": low,
            "coverage_high": high,
            "stable": found.stable.astype(float),
            "validated": found.validated.astype(float),
            **_mean(found.moments.mean, method),
        },
        summary={
            "verdict": found.verdict,
            "digits": digits,
            "poses_validated": count,
            "poses_refuted": int(np.count_nonzero(found.refuted)),
            "poses_undecided": int(np.count_nonzero(found.undecided)),
            "largest_distance_by_delta": worst,
            "radar_constants_set_to_zero": found.clipped,
        },
        report=tuple(report),
        warnings=(
            *_doubts(found.moments, method, axis),
            *_not_as_taken(scenario, method),
            *_clipped(found.clipped),
        ),
        passed=found.verdict == "validated",
    )
