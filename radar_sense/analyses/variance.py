"""P_D along the geometry, its standard deviation and band, and the threshold test."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from radar_sense import options, plotting, words
from radar_sense.acceptance.threshold import PathTest
from radar_sense.analyses.verdict import draw_limit, require, requirement
from radar_sense.axis import reached, widest_of_highest
from radar_sense.command import Figure, Result, Table, command
from radar_sense.flight import Radial
from radar_sense.model.geodesy import geodetic_from_ned
from radar_sense.model.geometry import body_vector, slant_range
from radar_sense.propagation import Band, Moments, band_of_scenario, propagate_scenario
from radar_sense.scenario import Scenario, single_radar_scenarios
from radar_sense.states import POSITION, FloatArray


@command(
    options.LEVEL,
    options.ONE_RADAR,
    options.METHOD,
    options.THRESHOLD,
    options.AT_LEAST,
    options.K,
    options.PROBABILITY,
    examples=(
        "radar-sense variance",
        "radar-sense variance my.yaml --level high --method form",
        "radar-sense variance my.yaml --threshold 0.1 --k 2",
        "radar-sense variance my.yaml --threshold 0.1 --probability 0.01",
        "radar-sense variance my.yaml --at-least 0.9",
        "radar-sense variance network.yaml --radar ridge",
    ),
)
def variance(
    scenario: Scenario,
    *,
    threshold: float | None = None,
    at_least: float | None = None,
    k: float | None = None,
    probability: float | None = None,
) -> Result:
    """P_D and its band along the geometry.

    A threshold adds the test of path planning, P_D + K sigma <= P_MAX, and P(P_D > P_MAX). For
    radars that are to detect, --at-least adds P_D - K sigma >= P_MIN. Exit code 3 means that the
    test is violated or not known.
    """
    axis, result = scenario.axis, Result(scenario)
    required = requirement(threshold, k, probability, at_least)
    k, limit = (k or 3.0, None) if required is None else (required.k, required.limit)
    moments = propagate_scenario(scenario, p_max=limit if k == 3 else None)
    band = moments
    if k != 3:
        at_k = band_of_scenario(scenario, method=scenario.method, beta=k, p_max=limit)
        band = replace(moments, **vars(at_k))
    by_radar = {
        name: (radar, propagate_scenario(radar))
        for name, radar in single_radar_scenarios(scenario).items()
    }

    words.add_axis(result.table, axis)
    _add_band(result.table, scenario, moments)
    words.add_mean(result.table, moments.mean, scenario.method)
    for name, (radar, of_radar) in by_radar.items():
        _add_band(result.table, radar, of_radar, name)
    if k != 3 and required is None:
        words.add_bounds(result.table, band, k)

    low, high = words.trough(moments.p_d, axis), words.peak(moments.p_d, axis)
    worst = words.peak(3 * moments.std, axis)
    result.summary |= {"lowest_p_d": low, "highest_p_d": high, "largest_three_sigma": worst}
    result.report += [
        words.describe_span(moments.p_d, axis),
        *_bands(scenario, band, k),
        f"largest 3 sigma of P_D ({words.level_and_method(scenario)}): "
        f"{words.describe_extreme(worst, axis)}",
    ]
    words.add_radars(result, {scenario.level: {name: m.std for name, (_, m) in by_radar.items()}})
    result.warnings += words.validity_warnings(scenario, band, k)
    result.warnings += words.table_warnings(scenario)
    result.warnings += words.gathered(
        (f"{name} alone", text)
        for name, (radar, of_radar) in by_radar.items()
        for text in words.validity_warnings(radar, of_radar)
    )
    tested, each = None, {name: m.p_d for name, (_, m) in by_radar.items()}
    if required is not None:
        tested = require(result, required, band)
        singles = single_radar_scenarios(tested.path.scenario).items()
        each = {name: one.p_d() for name, one in singles}
    else:
        words.add_trust(result, by_draws=int(np.count_nonzero(band.error)))
    _add_places(result.table, scenario)
    errors = {"": moments.error, **{name: m.error for name, (_, m) in by_radar.items()}}
    for name, error in errors.items():
        if np.any(error > 0):
            of_one, ending = words.of_radar(name)
            meaning = f"{of_one}Standard error of the 3-sigma bounds."
            result.table.add(f"error_3sigma{ending}", error, meaning)
    result.draw = partial(_draw, result=result, band=band, each=each, k=k, tested=tested)
    return result


def _bands(scenario: Scenario, band: Band, k: float) -> list[str]:
    """Return P_D and its band where the band is widest, and where P_D is largest."""
    width = band.upper - band.lower
    if not np.isfinite(width).any():
        return []
    widest = int(np.argmax(reached(width)))
    highest = widest_of_highest(band.p_d, width)
    places = {"the band is widest": widest, "P_D is largest": highest}
    if widest == highest:
        places = {"the band is widest and P_D largest": widest}
    return [
        f"where {place}, at {scenario.axis.at(pose)}: "
        f"{words.describe_band(band.p_d[pose], band.lower[pose], band.upper[pose], k)}"
        for place, pose in places.items()
    ]


def _add_band(table: Table, scenario: Scenario, moments: Moments, radar_name: str = "") -> None:
    """Add range, RCS and SNR of a single radar, and P_D with its band."""
    aircraft, radar = scenario.aircraft, scenario.radar
    of_radar, ending = words.of_radar(radar_name)
    if len(scenario.model.models) == 1:
        snr = scenario.model.snr(aircraft, radar).reshape(len(aircraft))
        sigma = scenario.radars[0].model.rcs.cross_section(body_vector(aircraft, radar))
        meaning = f"{of_radar}Slant range to the radar."
        table.add(f"range_m{ending}", slant_range(aircraft, radar), meaning, "m")
        table.add(f"rcs_m2{ending}", sigma, f"{of_radar}RCS towards the radar.", "m²")
        meaning = f"{of_radar}Signal-to-noise ratio of a single pulse, -inf beyond a limit."
        table.add(f"snr_db{ending}", words.decibels(snr), meaning, "dB")
    words.add_band(table, moments, radar=radar_name)


def _add_places(table: Table, scenario: Scenario) -> None:
    """Add the positions on a path."""
    if scenario.time_s is None:
        return
    position = scenario.aircraft[:, POSITION]
    for name, values in zip(("north", "east", "down"), position.T, strict=True):
        table.add(f"{name}_m", values, f"{name.capitalize()} of the aircraft from the origin.", "m")
    if scenario.origin is None:
        return
    latitude, longitude, altitude = geodetic_from_ned(position, scenario.origin).T
    table.add("latitude_deg", np.rad2deg(latitude), "WGS-84 latitude of the aircraft.", "°")
    table.add("longitude_deg", np.rad2deg(longitude), "WGS-84 longitude of the aircraft.", "°")
    table.add("altitude_m", altitude, "Height of the aircraft above the ellipsoid.", "m")


def _draw(
    figure: Figure,
    result: Result,
    band: Band,
    each: Mapping[str, FloatArray],
    k: float,
    tested: PathTest | None,
) -> None:
    """Draw P_D, its band, P_D by each radar, and the threshold, at the poses of the test."""
    scenario = result.scenario
    if tested is not None:
        scenario, band = tested.path.scenario, tested.band
    names = list(each)
    by_range = isinstance(scenario.geometry, Radial)
    (axes, *others), x = plotting.pose_panels(figure, 1 + by_range, scenario.axis)
    # Where one radar alone sees the aircraft, the network's line is under the radar's line.
    under = {"lw": plotting.points(2.2), "zorder": 1.8} if names else {}
    plotting.draw_line(axes, x, band.p_d, ("black", "-"), label=r"$P_D$", **under)
    for name, style in plotting.radar_styles(names).items():
        plotting.draw_line(axes, x, each[name], style, label=name, lw=plotting.points(0.8))
    plotting.draw_fill(axes, x, band.lower, band.upper, color=plotting.BAND[0], alpha=0.18, lw=0)
    label = rf"band of ${k:.4g}\,\sigma$ ({scenario.level})"
    plotting.draw_band(axes, x, band.lower, band.upper, label)
    if tested is not None:
        draw_limit(axes, tested.requirement, ":")
        plotting.draw_shade(axes, tested.violated, x, label="violated")
    axes.set_ylabel(r"Probability of detection $P_D$")
    for snr_axes in others:
        snr = words.decibels(scenario.model.snr(scenario.aircraft, scenario.radar))
        styles = plotting.styles(plotting.BAND) if names else [("black", "-")]
        for values, style in zip(snr.reshape(len(x), -1).T, styles, strict=False):
            plotting.draw_line(snr_axes, x, values, style)
        snr_axes.set_ylabel("SNR [dB]")
    plotting.draw_legend(figure, axes)
