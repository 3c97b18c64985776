"""Warnings of scenarios that are allowed but implausible, for example of wrong units."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from radar_sense.acceptance.refinement import can_refine, coarse_steps
from radar_sense.model.geodesy import geodetic_from_ned, ned_from_geodetic
from radar_sense.model.geometry import body_vector, slant_range
from radar_sense.model.rcs_table import TableRCS
from radar_sense.scenario import Scenario
from radar_sense.states import DOWN, POSITION, RADAR, FloatArray
from radar_sense.words import describe_poses

#: Greatest speed [m/s] and slant range [m] without a warning.
MAX_SPEED, MAX_RANGE = 2e3, 5e6
#: Least height above the ellipsoid [m]: the lowest land minus the greatest depth of the geoid.
MIN_HEIGHT = -600.0
#: Latitude and longitude count as swapped if a swap reduces the range to less than this part.
NEARER = 0.2
#: Largest elevation [rad] at which a table without elevations stands for all elevations. The area
#: that an upright plate shows falls by 3 % up to 15°, and its cross section, with the square of the
#: area, by 0.3 dB.
MAX_ELEVATION = np.deg2rad(15.0)
#: P_D counts as at the floor up to this part above the floor.
ABOVE_FLOOR = 1e-6


def plausibility_warnings(scenario: Scenario) -> tuple[str, ...]:
    """Return a warning for each implausible property of a scenario."""
    return (
        *_speed(scenario),
        *_height(scenario),
        *_range(scenario),
        *_floor(scenario),
        *_elevation(scenario),
        *_spacing(scenario),
    )


def _speed(scenario: Scenario) -> tuple[str, ...]:
    if scenario.time_s is None or len(scenario.time_s) < 2:
        return ()
    step = np.linalg.norm(np.diff(scenario.aircraft[:, POSITION], axis=0), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = step / np.diff(scenario.time_s)
    fastest = int(np.nanargmax(speed))
    if not speed[fastest] > MAX_SPEED:
        return ()
    return (
        f"the aircraft flies at up to {speed[fastest] / 1e3:.3g} km/s, after "
        f"{scenario.axis.at(fastest)}: is time_s in seconds, and are positions in their units?",
    )


def _height(scenario: Scenario) -> tuple[str, ...]:
    if scenario.origin is not None:
        height = geodetic_from_ned(scenario.aircraft[:, POSITION], scenario.origin)[:, 2]
        if height.min() >= MIN_HEIGHT:
            return ()
        return (
            f"the aircraft is below the ground, {-height.min():.4g} m below the ellipsoid: "
            "are altitudes in metres, and positive upwards?",
        )
    down = scenario.aircraft[:, DOWN]
    below = down > _lowest_down(scenario)
    if not below.any():
        return ()
    return (
        f"the aircraft is {down.max():.4g} m below the origin and below every radar "
        f"{describe_poses(below, scenario.axis)}: down is positive downwards, so heights are "
        "negative",
    )


def below_ground(scenario: Scenario, down_km: float | None) -> tuple[str, ...]:
    """Return a warning if the down coordinate of an option is below the origin and all radars.

    Args:
        scenario: The scenario.
        down_km: The coordinate [km]; None for none.
    """
    if down_km is None or 1e3 * down_km <= _lowest_down(scenario):
        return ()
    return (
        f"the aircraft is {1e3 * down_km:.4g} m below the origin and below every radar: --down-km "
        "is positive downwards, so heights are negative",
    )


def _lowest_down(scenario: Scenario) -> float:
    """Return the down coordinate [m] of the lowest of origin and radars."""
    return max(0.0, float(scenario.radar.reshape(-1, len(RADAR))[:, DOWN].max()))


def _range(scenario: Scenario) -> tuple[str, ...]:
    distances = _ranges(scenario.aircraft[:, POSITION], scenario.radar)
    farthest = distances.max(axis=1)
    if not farthest.max() > MAX_RANGE:
        return ()
    names = scenario.model.names
    number = int(np.argmax(farthest))
    radar = f"radar {names[number]}" if names else "the radar"
    warning = f"the aircraft is up to {farthest[number] / 1e3:.4g} km from {radar}"
    if _swapped(scenario):
        return (f"{warning}: are latitude and longitude swapped?",)
    return (f"{warning}: are positions in their units?",)


def _swapped(scenario: Scenario) -> bool:
    """Return whether latitude and longitude of the aircraft or of a radar are likely swapped."""
    if scenario.origin is None:
        return False
    aircraft = scenario.aircraft[:, POSITION]
    radars = scenario.radar.reshape(-1, len(RADAR))
    nearest = _ranges(aircraft, scenario.radar).min(axis=1)
    moved_radars = radars.copy()
    moved_radars[:, POSITION] = _with_swapped_place(radars[:, POSITION], scenario.origin)
    moved_aircraft = _with_swapped_place(aircraft, scenario.origin)
    with_aircraft = _ranges(moved_aircraft, scenario.radar).min(axis=1)
    with_radars = _ranges(aircraft, moved_radars.ravel()).min(axis=1)
    far = nearest > 0.2 * MAX_RANGE
    swapped = (with_aircraft < NEARER * nearest) | (with_radars < NEARER * nearest)
    return bool(np.any(far & swapped))


def _with_swapped_place(position: FloatArray, origin: tuple[float, float, float]) -> FloatArray:
    place = geodetic_from_ned(position, origin)
    latitude = np.clip(place[:, 1], -0.5 * np.pi, 0.5 * np.pi)
    return ned_from_geodetic(np.stack([latitude, place[:, 0], place[:, 2]], axis=-1), origin)


def _ranges(position: FloatArray, radar: FloatArray) -> FloatArray:
    """Return the slant ranges (m, n) of positions (n, 3) from radars (4m,)."""
    aircraft = np.hstack([position, np.zeros_like(position)])
    return np.stack([slant_range(aircraft, one) for one in radar.reshape(-1, len(RADAR))])


def _floor(scenario: Scenario) -> tuple[str, ...]:
    visible = scenario.model.visible(scenario.aircraft, scenario.radar)
    if not visible.any():
        return ("no radar sees the aircraft anywhere: see max_range_km, min_range_km and horizon",)
    p_d = scenario.model.p_d(scenario.aircraft, scenario.radar)
    floor = ndtr(scenario.model.floor(visible))
    if np.any(p_d > (1.0 + ABOVE_FLOOR) * floor):
        return ()
    return (
        f"P_D is at its floor at all poses, {np.max(p_d):.3g}, as without a signal: are radar "
        "constant, RCS and ranges in their units?",
    )


def _elevation(scenario: Scenario) -> tuple[str, ...]:
    """Return a warning if a table without elevations is used far above or below the aircraft."""
    rcs = scenario.model.rcs
    if not isinstance(rcs, TableRCS) or rcs.elevation is not None:
        return ()
    radars = scenario.radar.reshape(-1, len(RADAR))
    towards = np.stack([body_vector(scenario.aircraft, radar) for radar in radars])
    x, y, z = np.moveaxis(towards, -1, 0)
    elevation = np.abs(np.arctan2(z, np.hypot(x, y)))
    visible = scenario.model.visible(scenario.aircraft, scenario.radar)
    highest = np.max(elevation, axis=0, where=visible.T, initial=0.0)
    far = highest > MAX_ELEVATION
    if not far.any():
        return ()
    return (
        f"the RCS table has no elevations and is used at up to {np.rad2deg(highest.max()):.3g} deg "
        f"above or below the aircraft {describe_poses(far, scenario.axis)}: measure at elevations",
    )


def _spacing(scenario: Scenario) -> tuple[str, ...]:
    if not can_refine(scenario) or scenario.time_s is None:
        return ()
    coarse = coarse_steps(scenario)
    if not coarse.any():
        return ()
    longest = float(np.diff(scenario.time_s)[coarse].max())
    return (
        f"rows of the path are up to {longest:.4g} s apart, and P_D may differ much between them: "
        f"aspect or range change much in {np.count_nonzero(coarse)} of {len(coarse)} steps; add "
        "poses between the rows with geometry.interpolate",
    )
