"""P_D along the geometry, its standard deviation and band, and the threshold test."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from radar_sense.analyses.columns import AXIS, BAND, MEAN, of_radars, quantities
from radar_sense.analyses.contract import OPTIONS, Option, Result, analysis
from radar_sense.analyses.verdicts.threshold import (
    AUTOMATIC,
    COLUMNS,
    FORM,
    require_threshold,
)
from radar_sense.errors import InputError
from radar_sense.limits import SIGMAS, THRESHOLD
from radar_sense.model.geodesy import geodetic_from_ned
from radar_sense.model.geometry import body_vector, slant_range
from radar_sense.propagation import propagate_scenario
from radar_sense.scenario import Scenario, single_radar_scenarios
from radar_sense.states import POSITION, FloatArray
from radar_sense.words import (
    band_columns,
    decibels,
    describe_extreme,
    describe_span,
    level_and_method,
    mean_column,
    method_warnings,
    peak,
    radar_lines,
    radar_summary,
    trough,
)

if TYPE_CHECKING:
    from radar_sense.plotting import Axes, Figure


def plot(result: Result, figure: Figure) -> None:
    """Draw the figure."""
    from radar_sense import plotting

    (axes,), x = plotting.pose_panels(figure, 1, result.scenario.axis)
    table = result.table
    plotting.draw_line(axes, x, table["p_d"], ("black", "-"), label=r"$P_D$")
    names = result.scenario.model.names
    radar_lines = []
    if len(names) > 1:
        # Where one radar alone sees the aircraft, the network's line is under the radar's line.
        axes.lines[-1].set(linewidth=plotting.points(2.2), zorder=1.8)
        for name, style in zip(names, plotting.styles(plotting.BAND), strict=False):
            plotting.draw_line(axes, x, table[f"p_d_{name}"], style, label=name)
            radar_lines.append(axes.lines[-1])
            axes.lines[-1].set_linewidth(plotting.points(0.8))
    plotting.draw_fill(
        axes,
        x,
        table["lower_3sigma"],
        table["upper_3sigma"],
        color=plotting.BAND[0],
        alpha=0.18,
        lw=0,
    )
    plotting.draw_band(axes, x, table["lower_3sigma"], table["upper_3sigma"], result.band_label)
    if "threshold" in result.summary:
        _draw_threshold(axes, x, result)
    axes.set_ylabel(r"Probability of detection $P_D$")
    plotting.draw_legend(figure, axes, on_lines=radar_lines)


_METHOD = dataclasses.replace(
    OPTIONS["method"],
    help=f"{OPTIONS['method'].help} automatic is linear, and with --threshold form, with draws "
    "where form is unreliable.",
    default=AUTOMATIC,
    also=(AUTOMATIC,),
)
_THRESHOLD = Option(
    "threshold",
    "Test P_D + K sigma <= P_MAX at every pose, on a path between poses too; exit code 3 if the "
    "test is violated or not known.",
    THRESHOLD,
    metavar="P_MAX",
)
_K = Option("k", "K of the threshold test.", SIGMAS, metavar="K", default_text="3")


_LINK = quantities(
    {
        "range_m": "Slant range to the radar.",
        "rcs_m2": "Radar cross section towards the radar.",
        "snr_db": "Signal-to-noise ratio of a single pulse.",
    }
)
_PLACES = quantities(
    {
        "north_m": "North of the aircraft from the origin, on a path.",
        "east_m": "East of the aircraft from the origin, on a path.",
        "down_m": "Down of the aircraft from the origin, on a path.",
        "latitude_deg": "WGS-84 latitude of the aircraft, on a path with an origin.",
        "longitude_deg": "WGS-84 longitude of the aircraft, on a path with an origin.",
        "altitude_m": "Height of the aircraft above the ellipsoid, on a path with an origin.",
    }
)
_TABLE = (
    *AXIS,
    *_LINK,
    *BAND,
    MEAN,
    *of_radars((*_LINK, *BAND)),
    *COLUMNS,
    *_PLACES,
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

    A threshold adds the test of path planning, P_D + K sigma <= P_MAX, and P(P_D > P_MAX). Exit
    code 3 means that the test is violated or not known.

    Args:
        scenario: The scenario.
        method: Method of propagation. "automatic" is linear without a threshold. With a threshold
            "automatic" is form, and draws where form is unreliable.
        threshold: P_max of the threshold test; None for no test.
        k: Number of σ in the threshold test, 3 by default.

    Raises:
        InputError: If an option is not allowed, or k is given alone.
    """
    if k is not None and threshold is None:
        raise InputError("k belongs to threshold, which is not given")
    chosen = method
    if method == AUTOMATIC:
        chosen = "linear" if threshold is None else FORM
    result = _along_geometry(scenario, chosen)
    if threshold is not None:
        sigmas = 3.0 if k is None else k
        result = require_threshold(result, threshold, sigmas, with_draws=method == AUTOMATIC)
    return dataclasses.replace(result, table={**result.table, **_places(scenario)})


def _along_geometry(scenario: Scenario, method: str) -> Result:
    """Return P_D with standard deviation and 3σ band, of all radars and of each radar."""
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
        warnings=method_warnings(scenario, moments, method),
    )


def _places(scenario: Scenario) -> dict[str, FloatArray]:
    """Return the columns of the positions on a path; {} for an orbit."""
    if scenario.time_s is None:
        return {}
    position = scenario.aircraft[:, POSITION]
    columns = dict(zip(("north_m", "east_m", "down_m"), position.T, strict=True))
    if scenario.origin is not None:
        latitude, longitude, altitude = geodetic_from_ned(position, scenario.origin).T
        columns["latitude_deg"] = np.rad2deg(latitude)
        columns["longitude_deg"] = np.rad2deg(longitude)
        columns["altitude_m"] = altitude
    return columns


def _link_columns(scenario: Scenario) -> dict[str, FloatArray]:
    """Return the columns of range, RCS and SNR of a single radar; {} for a network."""
    aircraft, radar = scenario.aircraft, scenario.radar
    if len(scenario.model.models) > 1:
        return {}
    snr = scenario.model.snr(aircraft, radar).reshape(len(aircraft))
    return {
        "range_m": slant_range(aircraft, radar),
        "rcs_m2": scenario.model.rcs.cross_section(body_vector(aircraft, radar)),
        "snr_db": decibels(snr),
    }


def _draw_threshold(axes: Axes, x: FloatArray, result: Result) -> None:
    """Draw the threshold, and shade the poses with a bound above the threshold."""
    from radar_sense import plotting

    test = result.summary["threshold"]
    if test["bound"] != "upper_3sigma":
        bound = rf"bound at ${test['k']:g}\,\sigma$"
        plotting.draw_line(axes, x, result.table[test["bound"]], plotting.LINES[3], label=bound)
    axes.axhline(
        test["p_max"],
        color="black",
        lw=plotting.points(0.8),
        ls=":",
        label=f"threshold {test['p_max']:g}",
    )
    plotting.draw_shade(axes, result.table["violated"] > 0, x, label="violated")
