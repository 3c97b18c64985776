"""3 sigma of P_D for every level of radar uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from radar_sense import options, plotting, words
from radar_sense.axis import Axis
from radar_sense.command import Figure, Result, command
from radar_sense.propagation import distribution, std_off_in_scenario
from radar_sense.scenario import Scenario, single_radar_scenarios
from radar_sense.states import FloatArray


@command(
    options.ONE_RADAR,
    options.METHOD,
    examples=(
        "radar-sense sensitivity",
        "radar-sense sensitivity my.yaml --out results",
        "radar-sense sensitivity network.yaml --radar ridge",
    ),
)
def sensitivity(scenario: Scenario) -> Result:
    """3 sigma of P_D for every level of radar uncertainty."""
    method, axis, result = scenario.method, scenario.axis, Result(scenario)
    at_level = {level: scenario.with_analysis(level=level) for level in scenario.levels}
    spreads = {level: _spread(at) for level, at in at_level.items()}
    alone = {
        level: {name: _spread(radar) for name, radar in single_radar_scenarios(at).items()}
        for level, at in at_level.items()
    }

    words.add_axis(result.table, axis)
    lines = {level: 3 * std for level, (_, _, std) in spreads.items()}
    for level, three_sigma in lines.items():
        meaning = f"3 sigma of P_D at the level {level} of radar uncertainty."
        result.table.add(f"three_sigma_{level}", three_sigma, meaning)
    for level, (_, mean, _) in spreads.items():
        words.add_mean(result.table, mean, method, f"_{level}")

    worst = {level: words.peak(three_sigma, axis) for level, three_sigma in lines.items()}
    result.summary["largest_three_sigma"] = worst
    by_method = "" if method == "linear" else f" ({method})"
    result.report += [f"largest 3 sigma of P_D by level{by_method}:"]
    result.report += words.rows((n, words.describe_extreme(top, axis)) for n, top in worst.items())
    stds = {level: {n: std for n, (_, _, std) in of.items()} for level, of in alone.items()}
    words.add_radars(result, stds)
    of_radars = {
        f"{name} alone, {level}": radar
        for level, radars in alone.items()
        for name, radar in radars.items()
    }
    result.warnings += words.gathered(
        (label, text)
        for label, (of, mean, std) in (spreads | of_radars).items()
        for text in words.std_warnings(of, std, std_off_in_scenario(of, mean, std))
    )
    result.warnings += words.table_warnings(scenario)
    words.add_trust(result, "sigma ")
    result.draw = partial(_draw, axis=axis, lines=lines)
    return result


def _spread(scenario: Scenario) -> tuple[Scenario, FloatArray, FloatArray]:
    found = distribution(scenario, scenario.method)
    return scenario, found.mean, found.std


def _draw(figure: Figure, axis: Axis, lines: Mapping[str, FloatArray]) -> None:
    (axes,), x = plotting.pose_panels(figure, 1, axis)
    for (level, three_sigma), style in zip(lines.items(), plotting.styles(), strict=False):
        plotting.draw_line(axes, x, three_sigma, style, label=level)
    plotting.finish(figure, axes, r"$3\,\sigma$ of $P_D$")
