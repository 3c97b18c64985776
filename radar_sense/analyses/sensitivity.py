"""3σ of P_D for every level of radar uncertainty."""

from __future__ import annotations

from typing import TYPE_CHECKING

from radar_sense.analyses.columns import AXIS, quantity
from radar_sense.analyses.contract import Result, analysis
from radar_sense.analyses.report import (
    describe_extreme,
    gathered,
    largest_by_radar,
    mean_column,
    method_warnings,
    peak,
    radar_lines,
    radar_summary,
)
from radar_sense.propagation import propagate_scenario
from radar_sense.scenario import Scenario

if TYPE_CHECKING:
    from radar_sense.plotting import Figure


def plot(result: Result, figure: Figure) -> None:
    """Draw the figure."""
    from radar_sense import plotting

    (axes,), x = plotting.pose_panels(figure, 1, result.scenario.axis)
    for level, style in zip(result.scenario.cov_radar, plotting.styles(), strict=False):
        plotting.draw_line(axes, x, result.table[f"three_sigma_{level}"], style, label=level)
    axes.set_ylabel(r"$3\,\sigma$ of $P_D$")
    plotting.from_zero(axes)
    plotting.draw_legend(figure, axes, on_lines=axes.lines)


_TABLE = (
    *AXIS,
    quantity("three_sigma_<level>", "3 sigma of P_D at the level <level> of radar uncertainty."),
    quantity("mean_pd_<level>", "Mean of P_D at the level <level>; not by linear."),
)


@analysis(
    plot=plot,
    columns=_TABLE,
    options=["radar", "method"],
    examples=[
        "radar-sense sensitivity",
        "radar-sense sensitivity my.yaml --out results",
        "radar-sense sensitivity network.yaml --radar ridge",
    ],
)
def sensitivity(scenario: Scenario, *, method: str = "linear") -> Result:
    """3 sigma of P_D for every level of radar uncertainty.

    Args:
        scenario: The scenario.
        method: Method of propagation.

    Raises:
        InputError: If there is no such method.
    """
    axis = scenario.axis
    at_level = {level: scenario.with_analysis(level=level) for level in scenario.cov_radar}
    moments = {level: propagate_scenario(s, method=method) for level, s in at_level.items()}
    worst = {level: peak(3 * m.std, axis) for level, m in moments.items()}
    width = max(map(len, worst))
    by_itself = {level: largest_by_radar(s, method) for level, s in at_level.items()}
    of_radars = {
        name: ", ".join(
            f"{level} {describe_extreme(tops[name], axis)}" for level, tops in by_itself.items()
        )
        for name in by_itself[scenario.level]
    }
    by_method = "" if method == "linear" else f" ({method})"
    return Result(
        scenario=scenario,
        method=method,
        table={
            axis.key: axis.values,
            **{f"three_sigma_{level}": 3 * m.std for level, m in moments.items()},
            **{
                key: column
                for level, m in moments.items()
                for key, column in mean_column(m.mean, method, f"_{level}").items()
            },
        },
        summary={
            "largest_three_sigma": worst,
            **radar_summary(by_itself if of_radars else {}),
        },
        report=(
            f"largest 3 sigma of P_D by level{by_method}:",
            *(f"  {level:{width}}  {describe_extreme(top, axis)}" for level, top in worst.items()),
            *radar_lines(of_radars),
        ),
        warnings=gathered(
            (level, text)
            for level, m in moments.items()
            for text in method_warnings(at_level[level], m, method)
        ),
    )
