"""Read, validate and print a scenario in full; compute nothing."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import timedelta

import numpy as np

from radar_sense import files
from radar_sense.command import Result, command
from radar_sense.errors import counted
from radar_sense.flight import Path
from radar_sense.limits import DEG
from radar_sense.model.geometry import slant_range
from radar_sense.model.horizon import Horizon
from radar_sense.model.radar_constant import Tolerance, moments, relative_std
from radar_sense.model.trajectory import distance_flown
from radar_sense.plausibility import level_attitude
from radar_sense.scenario import Scenario
from radar_sense.states import CONSTANT, FloatArray
from radar_sense.words import decibels, describe_poses, listed

#: A smaller number of a summary is rounding, and stands as 0.
ROUNDING = 1e-9


@command(examples=("radar-sense check", "radar-sense check my.yaml"), endings=(), formats=())
def check(scenario: Scenario) -> Result:
    """Read, validate and print a scenario in full; compute nothing.

    The output is a scenario file with every default filled in. Comments at the top summarize the
    radars and the path, and show an error of units.
    """
    result = Result(scenario)
    result.report += [f"# {line}" for line in overview(scenario)]
    result.report += files.yaml_text(scenario.resolved()).splitlines()
    return result


def overview(scenario: Scenario) -> tuple[str, ...]:
    """Return the radar constants, the flight, and range and SNR of each radar, in lines.

    The flight has duration, length, speed, height and bank. The speed is the mean from row to row.
    Ranges are without the limits of a radar, and so is the SNR of a radar that never sees the
    aircraft. A radar whose limits hide the aircraft has a line where they do, and one whose horizon
    is not asked for where the aircraft is beyond it.
    """
    lines, geometry = _constants(scenario), scenario.geometry
    scenario = scenario.along(geometry.whole)
    height = Horizon(scenario.origin).height(scenario.aircraft)
    if isinstance(geometry, Path) and len(geometry.axis) > 1:
        route = geometry.route
        distance = distance_flown(route, route.time_s, geometry.method)
        speed = np.diff(distance) / np.diff(route.time_s)
        duration, length = np.ptp(route.time_s), distance[-1] / 1e3
        clock = timedelta(seconds=round(duration))
        lines.append(f"path: {duration:.6g} s ({clock}), {length:.4g} km, speed {_span(speed)} m/s")
    above = "the ellipsoid" if scenario.origin is not None else "the origin"
    bank = level_attitude(scenario)[:, 0] / DEG
    lines.append(f"height {_span(height)} m above {above}, bank {_span(bank)} deg")
    states = scenario.radar_states
    names = scenario.model.names or ("radar",)
    for name, radar, state in zip(names, scenario.model.radars, states, strict=True):
        distance = slant_range(scenario.aircraft, state)
        snr_db = decibels(radar.model.snr(scenario.aircraft, state))
        beyond_limit = {
            limit: margin < 0 for limit, margin in radar.margins(scenario.aircraft, state).items()
        }
        hidden = np.any([*beyond_limit.values()], axis=0)
        snr = f"{_span(snr_db)} dB"
        if hidden.any() and not hidden.all():
            snr = f"{_span(snr_db[~hidden])} dB where in sight"
        lines.append(f"{name}: range {_span(distance / 1e3)} km, SNR {snr}")
        if hidden.any():
            limits = listed(limit for limit, mask in beyond_limit.items() if mask.any())
            place = describe_poses(hidden, scenario.axis)
            lines.append(f"{name}: out of sight {place}, by {limits}")
        horizon = geometry.horizon.range(scenario.aircraft, state)
        # a height of 0 is a plane, not the ground
        beyond = (distance > horizon) & (distance <= radar.max_range) & (horizon > 0)
        if radar.horizon is None and beyond.any():
            place = describe_poses(beyond, scenario.axis)
            lines.append(
                f"{name}: beyond the horizon, {_span(horizon[beyond] / 1e3)} km, {place}; "
                "horizon: true hides the aircraft there"
            )
    return tuple(lines)


def _constants(scenario: Scenario) -> list[str]:
    """Return the number of poses, and the radar constants with their distributions."""
    names, constants = scenario.model.names, scenario.radar_states[:, CONSTANT]
    poses, whole = counted(len(scenario.aircraft), "pose"), len(scenario.geometry.whole.axis)
    if whole > len(scenario.aircraft):
        poses += f" ({whole} with the rows of the path between them)"
    shown = [f"c_r = {constant:g} J m^2/K" for constant in constants]
    lines = [f"{poses}, {shown[0]}"]
    if names:
        lines = [f"{poses}, {counted(len(names), 'radar')}"]
        lines += [f"{name}: {text}" for name, text in zip(names, shown, strict=True)]
    prefixes = [f"{name}, " for name in names] if len(names) > 1 else [""]
    for level in scenario.levels:
        tolerances = [radar.levels[level].tolerances for radar in scenario.radars]
        lines += [
            f"{prefix}{level}: {_shape(constant, parts)}"
            for prefix, constant, parts in zip(prefixes, constants, tolerances, strict=True)
            if parts
        ]
    return lines


def _shape(constant: float, tolerances: Sequence[Tolerance]) -> str:
    """Return a sentence with the moments of c_r, exactly and to first order."""
    mean, std, skewness = moments(tolerances)
    first_order = constant * relative_std(tolerances)
    return (
        f"c_r has mean {constant * mean:.4g}, standard deviation {constant * std:.4g} "
        f"(first order {first_order:.4g}), skewness {round(skewness, 2) + 0.0:.4g}"
    )


def _span(values: FloatArray) -> str:
    """Return the least and the largest value in four digits, or one value if these are equal."""
    ends = (float(np.min(values)), float(np.max(values)))
    # a bank of 1e-15 is rounding
    low, high = (f"{0.0 if abs(end) < ROUNDING else end:.4g}" for end in ends)
    return low if low == high else f"{low} to {high}"
