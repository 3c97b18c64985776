"""Cumulative P_D and tracks along a path."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from radar_sense.analyses.contract import OPTIONS, Option, Progress, Result, analysis, silent
from radar_sense.errors import InputError
from radar_sense.limits import RUNS, WINDOW
from radar_sense.mission import mission as along_path
from radar_sense.scenario import Scenario

if TYPE_CHECKING:
    from radar_sense.plotting import Figure


def plot(result: Result, figure: Figure) -> None:
    """Draw the figure."""
    from radar_sense.plotting import (
        BAND,
        LINES,
        draw_band,
        draw_fill,
        draw_legend,
        draw_line,
        pose_coordinates,
        pose_panels,
        styles,
    )

    table, x = result.table, pose_coordinates(result.scenario.axis)
    tracked = "track_p_d" in table
    (top, *below) = pose_panels(figure, 3 if tracked else 2, result.scenario.axis)
    names = result.scenario.model.names
    radars = dict(zip(names if len(names) > 1 else (), styles(BAND, LINES[0]), strict=False))
    for name, style in radars.items():
        looks = np.isfinite(table[f"p_d_{name}"])
        draw_line(top, x[looks], table[f"p_d_{name}"][looks], style, label=name)
        top.lines[-1].set_linewidth(0.8)
    if not radars:
        draw_line(top, x, table["p_d"], ("black", "-"), label=r"$P_D$ of a look")
        if len(x) <= 100:
            top.lines[-1].set(marker="o", markersize=1.8)
    top.set_ylabel(r"$P_D$ of a look")
    events = [("", "cumulative_p_d", r"Cumulative $P_D$"), ("track_", "track_p_d", "Track")]
    for axes, (before, column, name) in zip(below, events, strict=False):
        for radar, style in radars.items():
            draw_line(axes, x, table[f"{column}_{radar}"], style)
            axes.lines[-1].set_linewidth(0.8)
        if f"{before}mc_mean" in table:
            ends = table[f"{before}mc_lower"], table[f"{before}mc_upper"]
            draw_fill(axes, x, *ends, color="0.8", lw=0, label="Monte Carlo")
        draw_line(axes, x, table[column], LINES[0], label="nominal")
        draw_band(
            axes,
            x,
            table[f"{before}lower_3sigma"],
            table[f"{before}upper_3sigma"],
            result.band_label,
        )
        if f"{before}mc_mean" in table:
            some = slice(None, None, -(-len(x) // 40))
            mean = table[f"{before}mc_mean"]
            axes.plot(x[some], mean[some], "k.", ms=2.5, label="mean of runs")
        if before:
            name = "Track, {} of {}".format(*result.summary["m_of_n"])
            own = result.summary.get("radars", {}).values()
            if len({radar["scan_period_s"] for radar in own}) > 1:
                name += "\nlooks of one period"
        axes.set_ylabel(name)
    draw_legend(figure, *([top] if radars else []), *below[:1])


_METHOD = dataclasses.replace(OPTIONS["method"], help="probit or linear.", default="probit")
_M = Option("m", "With --n: detections that start a track.", WINDOW)
_N = Option("n", "Looks in a row that they must be within; of radars with one period.", WINDOW)
_RUNS = Option("runs", "Also draw so many missions.", RUNS, default_text="none")


@analysis(
    plot=plot,
    options=["level", "radar", _METHOD, _M, _N, _RUNS, "seed", "workers"],
    examples=[
        "radar-sense mission my.yaml",
        "radar-sense mission my.yaml --m 3 --n 5 --runs 10000",
    ],
)
def mission(
    scenario: Scenario,
    *,
    method: str = "probit",
    m: int | None = None,
    n: int | None = None,
    runs: int | None = None,
    workers: int = 1,
    progress: Progress = silent,
) -> Result:
    """Cumulative P_D over the looks along a path.

    The scenario must have a path, whose poses have times. A radar looks every
    radar.scan_period_s, or at the poses if that is not given. The pose errors are correlated over
    uncertainty.aircraft_correlation_s, the radar errors the same at all looks.

    A track is M detections in N looks in a row. Radars of a network that have the same period look
    together, as one; a track that the radars of any one period have started is the network's.

    Args:
        scenario: The scenario.
        method: "probit" or "linear".
        m: Detections that start a track.
        n: Looks in a row that they must be within.
        runs: Missions to draw too.
        workers: Threads to draw with; of no influence on the result.
        progress: Shows the runs that are done.

    Raises:
        InputError: If the geometry has no times, or a choice is not allowed.
    """
    if (m is None) != (n is None):
        raise InputError("--m and --n belong together, as in --m 3 --n 5")
    window = None if m is None or n is None else (m, n)
    if runs is None:
        return along_path(scenario, method=method, m_of_n=window, workers=workers)
    with progress(runs, "runs") as advance:
        return along_path(
            scenario,
            method=method,
            m_of_n=window,
            runs=runs,
            workers=workers,
            progress=advance,
        )
