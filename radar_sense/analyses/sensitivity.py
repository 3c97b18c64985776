"""3σ of P_D for every level of radar uncertainty."""

from __future__ import annotations

from matplotlib.figure import Figure

from radar_sense.analyses.contract import Result
from radar_sense.analyses.report import (
    _by,
    _by_radar,
    _by_radar_summary,
    _chosen,
    _doubts,
    _largest_by_radar,
    _mean,
    _not_as_taken,
    at,
    peak,
)
from radar_sense.plotting import _LINES, _from_zero, _legend, _line, _new, _x
from radar_sense.propagation import propagate_scenario
from radar_sense.scenario import Scenario


def _sensitivity(result: Result) -> Figure:
    figure, (axes,) = _new(1, result)
    levels = list(result.scenario.cov_radar)
    for i, level in enumerate(levels):
        values = result.table[f"three_sigma_{level}"]
        _line(axes, _x(result), values, _LINES[i % len(_LINES)], label=level)
    axes.set_ylabel(r"$3\,\sigma_{pd}$")
    _from_zero(axes)
    _legend(figure, axes)
    return figure


def sensitivity(scenario: Scenario, *, method: str | None = None) -> Result:
    """3σ of P_D for every level of radar uncertainty."""
    axis = scenario.axis
    moments = {
        level: propagate_scenario(scenario.with_analysis(level=level), method=_chosen(method))
        for level in scenario.cov_radar
    }
    worst = {level: peak(3 * m.std, axis) for level, m in moments.items()}
    width = max(map(len, worst))
    by_itself = {
        level: _largest_by_radar(scenario.with_analysis(level=level), method)
        for level in scenario.cov_radar
    }
    of_radars = {
        name: ", ".join(f"{level} {at(tops[name], axis)}" for level, tops in by_itself.items())
        for name in by_itself[scenario.level]
    }
    return Result(
        analysis="sensitivity",
        scenario=scenario,
        method=_chosen(method),
        table={
            axis.key: axis.values,
            **{f"three_sigma_{level}": 3 * m.std for level, m in moments.items()},
            **{
                key: column
                for level, m in moments.items()
                for key, column in _mean(m.mean, method, f"_{level}").items()
            },
        },
        summary={
            "largest_three_sigma": worst,
            **_by_radar_summary(by_itself if of_radars else {}),
        },
        report=(
            f"largest 3 sigma of P_D by level{_by(method)}:",
            *(f"  {level:{width}}  {at(top, axis)}" for level, top in worst.items()),
            *_by_radar(of_radars),
        ),
        warnings=tuple(
            f"{level}: {doubt}"
            for level, m in moments.items()
            for doubt in (
                *_doubts(m, method, axis),
                *_not_as_taken(scenario.with_analysis(level=level), method),
            )
        ),
    )
