"""Monte Carlo draws of P_D against the 3σ band of a method."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from radar_sense.analyses.contract import Result
from radar_sense.analyses.report import (
    _band,
    _band_name,
    _by_radar,
    _by_radar_summary,
    _chosen,
    _clipped,
    _doubts,
    _drawn,
    _largest_by_radar,
    _mean,
    _mixed_rounding,
    _not_as_taken,
    _points,
    at,
    peak,
    where,
)
from radar_sense.montecarlo.montecarlo import WITHIN_3_SIGMA, monte_carlo
from radar_sense.plotting import _draw_band, _hairs, _legend, _line, _new, _x
from radar_sense.scenario import Scenario


def _montecarlo(result: Result) -> Figure:
    if result.monte_carlo is None:
        raise ValueError("a Monte Carlo figure needs the draws")
    mc, x = result.monte_carlo, _x(result)
    figure, (top, bottom) = _new(2, result)
    shown = len(mc.sample_paths)
    label = f"{mc.runs} runs" if shown == mc.runs else f"{shown} of {mc.runs} runs"
    _hairs(top, x, mc.sample_paths, label)
    _line(top, x, mc.band.p_d, ("black", "-"), label=r"nominal $\bar P_D$")
    _draw_band(top, x, result.table["lower_3sigma"], result.table["upper_3sigma"], result)
    top.set_ylabel(r"$P_D$")
    _hairs(bottom, x, mc.sample_paths - mc.band.p_d, label)
    _draw_band(bottom, x, mc.band.lower - mc.band.p_d, mc.band.upper - mc.band.p_d, result)
    bottom.set_ylabel(r"Error $P_D - \bar P_D$")
    _legend(figure, top)
    return figure


def montecarlo(
    scenario: Scenario,
    *,
    method: str | None = None,
    sampler: str = "random",
    workers: int = 1,
    executor: Executor | None = None,
    progress: Callable[[int], None] | None = None,
) -> Result:
    """Monte Carlo draws of P_D against the 3σ band of a method."""
    axis = scenario.axis
    mc = monte_carlo(
        scenario,
        method=_chosen(method),
        sampler=sampler,
        workers=workers,
        executor=executor,
        progress=progress,
    )
    pose = int(np.argmin(mc.coverage))
    overall = float(mc.coverage.mean())
    name = _band_name(method)
    warnings = list(_doubts(mc.band, method, axis))
    lowest_summary: dict[str, Any] = {
        "value": float(mc.coverage[pose]),
        axis.key: float(axis.values[pose]),
    }
    summary: dict[str, Any] = {
        "runs": mc.runs,
        "sampler": mc.sampler,
        "coverage_expected": WITHIN_3_SIGMA,
        "coverage_overall": overall,
        "coverage_lowest": lowest_summary,
    }
    lowest = f"lowest coverage {mc.coverage[pose]:.2%} at {axis.at(pose)}"
    if mc.sampler == "random":
        low, high = mc.coverage_interval()
        # Bonferroni: with 95 % confidence none of the poses is called inconsistent by chance.
        least, most = mc.coverage_interval(1 - 0.05 / len(axis))
        off = (most < WITHIN_3_SIGMA) | (least > WITHIN_3_SIGMA)
        lowest += f" (95 % confidence {low[pose]:.2%} to {high[pose]:.2%})"
        lowest_summary["confidence_95"] = [float(low[pose]), float(high[pose])]
        summary["coverage_confidence_95"] = {"lower": low.tolist(), "upper": high.tolist()}
        summary["poses_inconsistent"] = int(np.count_nonzero(off))
        if off.any():
            warnings.append(
                f"the {name} band does not hold the 99.73 % of the draws that it should "
                f"{where(off, axis)} (95 % confidence for all poses together)"
            )
    warnings += (*_not_as_taken(scenario, method), *_clipped(mc.clipped), *_mixed_rounding(mc))
    by_itself = _largest_by_radar(scenario, method)
    return Result(
        analysis="montecarlo",
        scenario=scenario,
        method=_chosen(method),
        table={
            axis.key: axis.values,
            **_band(mc.band),
            **_drawn(mc.mean, mc.std, mc.lower, mc.upper),
            "coverage_3sigma": mc.coverage,
            **_mean(mc.band.mean, method),
        },
        summary={
            **summary,
            "largest_mean_shift": peak(abs(mc.mean - mc.band.p_d), axis),
            "radar_constants_set_to_zero": mc.clipped,
            **_by_radar_summary(by_itself),
        },
        report=(
            f"{mc.runs} runs ({scenario.level}, seed {mc.seed}{_points(mc)}): {overall:.2%} of the "
            f"draws lie in the {name} 3-sigma band, {WITHIN_3_SIGMA:.2%} should",
            lowest,
            *_by_radar({name: at(top, axis) for name, top in by_itself.items()}, name),
        ),
        warnings=tuple(warnings),
        monte_carlo=mc,
    )
