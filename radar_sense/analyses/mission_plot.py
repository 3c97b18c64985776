"""The figure of a mission."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from radar_sense.analyses.contract import Result
from radar_sense.plotting import _BAND, _LINES, _draw_band, _fill, _legend, _line, _new, _styles, _x


def _mission(result: Result) -> Figure:
    table, x = result.table, _x(result)
    tracked = "track_p_d" in table
    figure, (top, *below) = _new(3 if tracked else 2, result)
    names = result.scenario.model.names
    radars = dict(zip(names if len(names) > 1 else (), _styles(_BAND, _LINES[0]), strict=False))
    for name, style in radars.items():
        looks = np.isfinite(table[f"p_d_{name}"])
        _line(top, x[looks], table[f"p_d_{name}"][looks], style, label=name)
        top.lines[-1].set_linewidth(0.8)
    if not radars:
        _line(top, x, table["p_d"], ("black", "-"), label=r"$P_D$ of a look")
        if len(x) <= 100:
            top.lines[-1].set(marker="o", markersize=1.8)
    top.set_ylabel(r"$P_D$ of a look")
    events = [("", "cumulative_p_d", r"Cumulative $P_D$"), ("track_", "track_p_d", "Track")]
    for axes, (before, column, name) in zip(below, events, strict=False):
        for radar, style in radars.items():
            _line(axes, x, table[f"{column}_{radar}"], style)
            axes.lines[-1].set_linewidth(0.8)
        if f"{before}mc_mean" in table:
            ends = table[f"{before}mc_lower"], table[f"{before}mc_upper"]
            _fill(axes, x, *ends, color="0.8", lw=0, label="Monte Carlo")
        _line(axes, x, table[column], _LINES[0], label="nominal")
        _draw_band(axes, x, table[f"{before}lower_3sigma"], table[f"{before}upper_3sigma"], result)
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
    _legend(figure, *([top] if radars else []), *below[:1])
    return figure
