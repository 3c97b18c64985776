"""The analyses: from a scenario to one table, one summary and a few lines for a person.

They take `method`, a method of propagation. Without it they are the paper's: linear, and with the
paper's columns alone; a method that is named adds columns of its own, its mean among them.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from radar_sense.analyses.contract import Result
from radar_sense.analyses.report import (
    _band,
    _by_radar,
    _by_radar_summary,
    _chosen,
    _doubts,
    _mean,
    _named,
    _not_as_taken,
    at,
    peak,
    trough,
)
from radar_sense.model.geometry import body_vector, slant_range
from radar_sense.plotting import (
    _BAND,
    _LINES,
    _draw_band,
    _fill,
    _legend,
    _line,
    _new,
    _shade,
    _styles,
    _x,
)
from radar_sense.propagation import propagate_scenario
from radar_sense.scenario import Scenario, alone
from radar_sense.states import FloatArray


def variance(scenario: Scenario, *, method: str | None = None) -> Result:
    """P_D along the geometry with its standard deviation and 3σ band; of each radar too."""
    axis = scenario.axis
    moments = propagate_scenario(scenario, method=_chosen(method))
    low, high = trough(moments.p_d, axis), peak(moments.p_d, axis)
    worst = peak(3 * moments.std, axis)
    each = {
        name: (one, propagate_scenario(one, method=_chosen(method)))
        for name, one in alone(scenario).items()
    }
    by_itself = {name: peak(3 * found.std, axis) for name, (_, found) in each.items()}
    return Result(
        analysis="variance",
        scenario=scenario,
        method=_chosen(method),
        table={
            axis.key: axis.values,
            **_towards(scenario),
            **_band(moments),
            **_mean(moments.mean, method),
            **{
                f"{name}_{radar}": column
                for radar, (one, found) in each.items()
                for name, column in {**_towards(one), **_band(found)}.items()
            },
        },
        summary={
            "lowest_p_d": low,
            "highest_p_d": high,
            "largest_three_sigma": worst,
            **_by_radar_summary(by_itself),
        },
        report=(
            f"P_D runs from {at(low, axis)} to {at(high, axis)}",
            f"largest 3 sigma of P_D ({_named(scenario.level, method)}): {at(worst, axis)}",
            *_by_radar({name: at(top, axis) for name, top in by_itself.items()}),
        ),
        warnings=(*_doubts(moments, method, axis), *_not_as_taken(scenario, method)),
    )


def _towards(scenario: Scenario) -> dict[str, FloatArray]:
    """Return the columns of what a single radar has to do with; none for a network."""
    aircraft, radar = scenario.aircraft, scenario.radar
    if len(scenario.model.models) > 1:
        return {}
    snr = scenario.model.snr(aircraft, radar).reshape(len(aircraft))
    with np.errstate(divide="ignore"):  # no cross section, no signal: −inf dB
        snr_db = 10.0 * np.log10(snr)
    return {
        "range_m": slant_range(aircraft, radar),
        "rcs_m2": scenario.model.rcs.cross_section(body_vector(aircraft, radar)),
        "snr_db": snr_db,
    }


def _variance(result: Result) -> Figure:
    figure, (axes,) = _new(1, result)
    table, x = result.table, _x(result)
    _line(axes, x, table["p_d"], ("black", "-"), label=r"$P_D$")
    names = result.scenario.model.names
    if len(names) > 1:  # where one radar is all there is, its line is on that of the network
        axes.lines[-1].set(linewidth=2.2, zorder=1.8)
    for name, style in zip(names if len(names) > 1 else (), _styles(_BAND), strict=False):
        _line(axes, x, table[f"p_d_{name}"], style, label=name)
        axes.lines[-1].set_linewidth(0.8)
    _fill(axes, x, table["lower_3sigma"], table["upper_3sigma"], color=_BAND[0], alpha=0.18, lw=0)
    _draw_band(axes, x, table["lower_3sigma"], table["upper_3sigma"], result)
    if "threshold" in result.summary:
        _threshold(axes, x, result)
    axes.set_ylabel(r"Probability of detection $P_D$")
    _legend(figure, axes)
    return figure


def _threshold(axes: Axes, x: FloatArray, result: Result) -> None:
    """Mark the threshold of path planning, and where the bound is above it."""
    test = result.summary["threshold"]
    if test["bound"] != "upper_3sigma":
        bound = rf"bound at ${test['k']:g}\,\sigma$"
        _line(axes, x, result.table[test["bound"]], _LINES[3], label=bound)
    axes.axhline(test["p_max"], color="black", lw=0.8, ls=":", label=f"threshold {test['p_max']:g}")
    _shade(axes, result.table["violated"] > 0, x, label="violated")
