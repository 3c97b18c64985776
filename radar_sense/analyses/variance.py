"""P_D along the geometry, its standard deviation and band, and the threshold test."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from radar_sense.analyses.columns import AXIS, BAND, LINK, MEAN, OF_THRESHOLD, PLACES, of_radars
from radar_sense.analyses.contract import OPTIONS, Option, Result, analysis
from radar_sense.analyses.report import (
    band_columns,
    describe_extreme,
    describe_span,
    distribution_warnings,
    level_and_method,
    mean_column,
    peak,
    radar_lines,
    radar_summary,
    table_warnings,
    trough,
    validity_warnings,
)
from radar_sense.analyses.threshold import AUTOMATIC, FORM, check_threshold, require_threshold
from radar_sense.errors import InputError
from radar_sense.limits import SIGMAS, THRESHOLD
from radar_sense.model.geodesy import geodetic_from_ned
from radar_sense.model.geometry import body_vector, slant_range
from radar_sense.propagation import propagate_scenario
from radar_sense.scenario import Scenario, single_radar_scenarios
from radar_sense.states import POSITION, FloatArray

if TYPE_CHECKING:
    from radar_sense.plotting import Axes, Figure


def plot(result: Result, figure: Figure) -> None:
    """Draw the figure."""
    from radar_sense.plotting import (
        BAND,
        draw_band,
        draw_fill,
        draw_legend,
        draw_line,
        points,
        pose_coordinates,
        pose_panels,
        styles,
    )

    (axes,) = pose_panels(figure, 1, result.scenario.axis)
    table, x = result.table, pose_coordinates(result.scenario.axis)
    draw_line(axes, x, table["p_d"], ("black", "-"), label=r"$P_D$")
    names = result.scenario.model.names
    if len(names) > 1:  # the line of a radar that is alone in view hides the network's line
        axes.lines[-1].set(linewidth=points(2.2), zorder=1.8)
    of_radars = []
    for name, style in zip(names if len(names) > 1 else (), styles(BAND), strict=False):
        draw_line(axes, x, table[f"p_d_{name}"], style, label=name)
        of_radars.append(axes.lines[-1])
        axes.lines[-1].set_linewidth(points(0.8))
    draw_fill(
        axes, x, table["lower_3sigma"], table["upper_3sigma"], color=BAND[0], alpha=0.18, lw=0
    )
    draw_band(axes, x, table["lower_3sigma"], table["upper_3sigma"], result.band_label)
    if "threshold" in result.summary:
        _draw_threshold(axes, x, result)
    axes.set_ylabel(r"Probability of detection $P_D$")
    draw_legend(figure, axes, on_lines=of_radars)


_METHOD = dataclasses.replace(
    OPTIONS["method"],
    default=None,
    default_text="linear; with --threshold form, and draws where form is unreliable",
)
_THRESHOLD = Option(
    "threshold",
    "Test P_D + K sigma <= P_MAX at every pose, on a path between them too; exit code 3 if the "
    "test is violated or not known.",
    THRESHOLD,
    metavar="P_MAX",
)
_K = Option("k", "K of the threshold test.", SIGMAS, metavar="K", default_text="3")


_TABLE = (
    *AXIS,
    *LINK,
    *BAND,
    MEAN,
    *of_radars((*LINK, *BAND)),
    *OF_THRESHOLD,
    *PLACES,
)


@analysis(
    plot=plot,
    columns=_TABLE,
    options=["level", "radar", _METHOD, _THRESHOLD, _K],
    examples=[
        "radar-sense variance",
        "radar-sense variance my.yaml --level high --method form",
        "radar-sense variance my.yaml --threshold 0.1 --k 2",
        "radar-sense variance network.yaml --radar ridge",
    ],
)
def variance(
    scenario: Scenario,
    *,
    method: str = AUTOMATIC,
    threshold: float | None = None,
    k: float | None = None,
) -> Result:
    """Standard deviation of P_D along the geometry.

    With --threshold also the test of path planning, P_D + K sigma <= P_MAX, and P(P_D > P_MAX).
    Exit code 3 means that the test is violated or not known.

    Args:
        scenario: The scenario.
        method: Method of propagation. "automatic" is linear without a threshold. With a threshold
            it is form, and draws where form is unreliable.
        threshold: P_max of the threshold test; None for no test.
        k: Number of σ in the threshold test, 3 by default.

    Raises:
        InputError: If there is no such method, P_max or k is out of range, or k is given alone.
    """
    if k is not None and threshold is None:
        raise InputError("--k belongs to --threshold, which is not given")
    if threshold is not None:
        k = 3.0 if k is None else k
        check_threshold(threshold, k)
    chosen = method
    if method == AUTOMATIC:
        chosen = "linear" if threshold is None else FORM
    result = _along_geometry(scenario, chosen)
    if threshold is not None and k is not None:
        result = require_threshold(result, threshold, k, with_draws=method == AUTOMATIC)
    return dataclasses.replace(result, table={**result.table, **_places(scenario)})


def _along_geometry(scenario: Scenario, method: str) -> Result:
    """Return P_D with its standard deviation and 3σ band, of all radars and of each."""
    axis = scenario.axis
    moments = propagate_scenario(scenario, method=method)
    low, high = trough(moments.p_d, axis), peak(moments.p_d, axis)
    worst = peak(3 * moments.std, axis)
    single = {
        name: (radar_scenario, propagate_scenario(radar_scenario, method=method))
        for name, radar_scenario in single_radar_scenarios(scenario).items()
    }
    by_itself = {name: peak(3 * values.std, axis) for name, (_, values) in single.items()}
    return Result(
        scenario=scenario,
        method=method,
        table={
            axis.key: axis.values,
            **_link_columns(scenario),
            **band_columns(moments),
            **mean_column(moments.mean, method),
            **{
                f"{name}_{radar}": column
                for radar, (radar_scenario, values) in single.items()
                for name, column in {
                    **_link_columns(radar_scenario),
                    **band_columns(values),
                }.items()
            },
        },
        summary={
            "lowest_p_d": low,
            "highest_p_d": high,
            "largest_three_sigma": worst,
            **radar_summary(by_itself),
        },
        report=(
            describe_span(low, high, axis),
            f"largest 3 sigma of P_D ({level_and_method(scenario.level, method)}): "
            f"{describe_extreme(worst, axis)}",
            *radar_lines({name: describe_extreme(top, axis) for name, top in by_itself.items()}),
        ),
        warnings=(
            *validity_warnings(scenario, moments, method),
            *distribution_warnings(scenario, method),
            *table_warnings(scenario),
        ),
    )


def _places(scenario: Scenario) -> dict[str, FloatArray]:
    """Return the columns of the positions on a path; {} for an orbit."""
    if scenario.time_s is None:
        return {}
    position = scenario.aircraft[:, POSITION]
    columns = dict(zip(("north_m", "east_m", "down_m"), position.T, strict=True))
    if scenario.origin is not None:
        latitude, longitude, altitude = geodetic_from_ned(position, scenario.origin).T
        columns["latitude_deg"], columns["longitude_deg"] = (
            np.rad2deg(latitude),
            np.rad2deg(longitude),
        )
        columns["altitude_m"] = altitude
    return columns


def _link_columns(scenario: Scenario) -> dict[str, FloatArray]:
    """Return range, RCS and SNR of a single radar; {} for a network."""
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


def _draw_threshold(axes: Axes, x: FloatArray, result: Result) -> None:
    """Mark the threshold of path planning, and where the bound is above it."""
    from radar_sense.plotting import LINES, draw_line, draw_shade, points

    test = result.summary["threshold"]
    if test["bound"] != "upper_3sigma":
        bound = rf"bound at ${test['k']:g}\,\sigma$"
        draw_line(axes, x, result.table[test["bound"]], LINES[3], label=bound)
    axes.axhline(
        test["p_max"], color="black", lw=points(0.8), ls=":", label=f"threshold {test['p_max']:g}"
    )
    draw_shade(axes, result.table["violated"] > 0, x, label="violated")
