"""Warnings of scenarios that are allowed but implausible, for example of wrong units."""

from __future__ import annotations

import numpy as np
from scipy.constants import speed_of_light
from scipy.special import ndtr

from radar_sense.acceptance.refinement import can_refine, coarse_steps
from radar_sense.flight import Path
from radar_sense.model.geodesy import geodetic_from_ned, ned_from_geodetic
from radar_sense.model.geometry import body_vector, radar_from_aircraft, slant_range
from radar_sense.model.rcs_table import TableRCS
from radar_sense.scenario import Scenario
from radar_sense.states import CONSTANT, DOWN, POSITION, RADAR, FloatArray
from radar_sense.words import describe_poses, warning

#: Greatest speed [m/s] and slant range [m] without a warning.
MAX_SPEED, MAX_RANGE = 2e3, 5e6
#: Least height above the ellipsoid [m]: the lowest land minus the greatest depth of the geoid.
MIN_HEIGHT = -600.0
#: Greatest height [m]: the edge of space (Fédération Aéronautique Internationale, Sporting Code,
#: section 8, 2.18.1).
MAX_HEIGHT = 100e3
#: Frequencies of radars [GHz], from HF to the millimetre waves (IEEE Std 521-2019, table 1).
FREQUENCIES = 0.003, 300.0
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
        *_antenna(scenario),
        *_spacing(scenario),
        *_step(scenario),
        *_frequency(scenario),
        *_constant(scenario),
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
    text = (
        f"the aircraft flies at up to {speed[fastest] / 1e3:.3g} km/s, after "
        f"{scenario.axis.at(fastest)}: is time_s in seconds, and are positions in their units?"
    )
    return (warning("too-fast", text),)


def _height(scenario: Scenario) -> tuple[str, ...]:
    down = scenario.aircraft[:, DOWN]
    height, above = -down, "the origin"
    if scenario.origin is not None:
        height = geodetic_from_ned(scenario.aircraft[:, POSITION], scenario.origin)[:, 2]
        above = "the ellipsoid"
    highest, texts = float(height.max()), []
    if highest > MAX_HEIGHT:
        text = f"the aircraft is up to {highest / 1e3:.4g} km above {above}: is the height in "
        texts.append(warning("too-high", text + "its unit?"))
    # On a route that lands, the height is known worse than itself at some poses.
    std = np.sqrt(np.broadcast_to(scenario.cov_aircraft[..., DOWN, DOWN], height.shape))
    if highest > 0 and np.all(std > height):
        text = (
            f"sigma of the height, {std.max():.4g} m, is above the height at all poses, "
            f"{highest:.4g} m above {above} at most: are both in their units?"
        )
        texts.append(warning("uncertainty-large", text))
    if scenario.origin is not None:
        if height.min() < MIN_HEIGHT:
            text = (
                f"the aircraft is below the ground, {-height.min():.4g} m below the ellipsoid: "
                "are altitudes in metres, and positive upwards?"
            )
            texts.append(warning("below-ground", text))
        return tuple(texts)
    below = down > _lowest_down(scenario)
    if below.any():
        text = (
            f"the aircraft is {down.max():.4g} m below the origin and below every radar "
            f"{describe_poses(below, scenario.axis)}: down is positive downwards, so heights are "
            "negative"
        )
        texts.append(warning("below-ground", text))
    return tuple(texts)


def below_ground(scenario: Scenario, down_km: float | None) -> tuple[str, ...]:
    """Return a warning if the down coordinate of an option is below the origin and all radars.

    Args:
        scenario: The scenario.
        down_km: The coordinate [km]; None for none.
    """
    if down_km is None or 1e3 * down_km <= _lowest_down(scenario):
        return ()
    text = (
        f"the aircraft is {1e3 * down_km:.4g} m below the origin and below every radar: --down-km "
        "is positive downwards, so heights are negative"
    )
    return (warning("below-ground", text),)


def _lowest_down(scenario: Scenario) -> float:
    """Return the down coordinate [m] of the lowest of origin and radars."""
    return max(0.0, float(scenario.radar_states[:, DOWN].max()))


def _range(scenario: Scenario) -> tuple[str, ...]:
    distances = _ranges(scenario.aircraft[:, POSITION], scenario.radar)
    farthest = distances.max(axis=1)
    if not farthest.max() > MAX_RANGE:
        return ()
    names = scenario.model.names
    number = int(np.argmax(farthest))
    radar = f"radar {names[number]}" if names else "the radar"
    swapped = "are latitude and longitude swapped?"
    ask = swapped if _swapped(scenario) else "are positions in their units?"
    text = f"the aircraft is up to {farthest[number] / 1e3:.4g} km from {radar}: {ask}"
    return (warning("too-far", text),)


def _swapped(scenario: Scenario) -> bool:
    """Return whether latitude and longitude of the aircraft or of a radar are likely swapped."""
    if scenario.origin is None:
        return False
    aircraft = scenario.aircraft[:, POSITION]
    radars = scenario.radar_states
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
        limits = "max_range_km, min_range_km, horizon and mask"
        text = f"no radar sees the aircraft anywhere: see {limits}"
        return (warning("never-seen", text),)
    p_d = scenario.model.p_d(scenario.aircraft, scenario.radar)
    floor = ndtr(scenario.model.floor(visible))
    if np.any(p_d > (1.0 + ABOVE_FLOOR) * floor):
        return ()
    text = (
        f"P_D is at its floor at all poses, {np.max(p_d):.3g}, as without a signal: are radar "
        "constant, RCS and ranges in their units?"
    )
    return (warning("no-signal", text),)


def _elevation(scenario: Scenario) -> tuple[str, ...]:
    """Return a warning if a table without elevations is used far above or below the aircraft."""
    level = [isinstance(m.rcs, TableRCS) and m.rcs.elevation is None for m in scenario.model.models]
    if not any(level):
        return ()
    towards = np.stack([body_vector(scenario.aircraft, radar) for radar in scenario.radar_states])
    x, y, z = np.moveaxis(towards, -1, 0)
    elevation = np.abs(np.arctan2(z, np.hypot(x, y)))
    used = scenario.model.visible(scenario.aircraft, scenario.radar) & level
    highest = np.max(elevation, axis=0, where=used.T, initial=0.0)
    far = highest > MAX_ELEVATION
    if not far.any():
        return ()
    text = (
        f"the RCS table has no elevations and is used at up to {np.rad2deg(highest.max()):.3g} deg "
        f"above or below the aircraft {describe_poses(far, scenario.axis)}: measure at elevations"
    )
    return (warning("table-level", text),)


def _antenna(scenario: Scenario) -> tuple[str, ...]:
    """Return a warning if an antenna is used beyond the elevations of its gain."""
    far = np.zeros(len(scenario.aircraft))
    visible = scenario.model.visible(scenario.aircraft, scenario.radar)
    for i, radar in enumerate(scenario.radars):
        if radar.model.antenna is not None:
            line = radar_from_aircraft(scenario.aircraft, scenario.radar_states[i])
            far = np.maximum(far, radar.model.antenna.outside(line) * visible[:, i])
    if not (far > 0).any():
        return ()
    text = (
        f"the gain of an antenna is used up to {np.rad2deg(far.max()):.3g} deg beyond its "
        f"elevations {describe_poses(far > 0, scenario.axis)}, where the last gain holds: add "
        "elevations to the file of elevation_gain"
    )
    return (warning("gain-beyond", text),)


def _spacing(scenario: Scenario) -> tuple[str, ...]:
    if not can_refine(scenario) or scenario.time_s is None:
        return ()
    coarse = coarse_steps(scenario)
    if not coarse.any():
        return ()
    longest = float(np.diff(scenario.time_s)[coarse].max())
    text = (
        f"rows of the path are up to {longest:.4g} s apart, and P_D may differ much between them: "
        f"aspect or range change much in {np.count_nonzero(coarse)} of {len(coarse)} steps; add "
        "poses between the rows with geometry.interpolate"
    )
    return (warning("rows-apart", text),)


def _step(scenario: Scenario) -> tuple[str, ...]:
    """Return a warning if the step between the poses of a path is longer than the path."""
    geometry = scenario.geometry
    if not isinstance(geometry, Path) or geometry.step_s is None:
        return ()
    duration = float(np.ptp(geometry.time_s))
    if geometry.step_s <= duration or len(geometry.axis) < 2:
        return ()
    text = (
        f"geometry.interpolate has a step of {geometry.step_s:g} s, longer than the route of "
        f"{duration:.4g} s: no pose is added"
    )
    return (warning("step-long", text),)


def _frequency(scenario: Scenario) -> tuple[str, ...]:
    """Return a warning of the frequencies in a scenario file that no radar has."""
    if scenario.source is None:
        return ()
    file = scenario.source.file
    odd = []
    for radar in file.radars or (file.radar,):
        sheet = radar.tracking
        if sheet is None:
            continue
        frequency = sheet.frequency_ghz or speed_of_light / 1e9 / sheet.wavelength_m
        if not FREQUENCIES[0] <= frequency <= FREQUENCIES[1]:
            odd.append(f"{frequency:.4g} GHz")
    if not odd:
        return ()
    low, high = FREQUENCIES
    text = f"a radar at {', '.join(odd)}: radars are at {low:g} to {high:g} GHz, is the unit right?"
    return (warning("frequency-odd", text),)


def _constant(scenario: Scenario) -> tuple[str, ...]:
    """Return a warning if sigma of a radar constant is above the constant itself."""
    constant = scenario.radar_states[:, CONSTANT]
    variance = np.diagonal(scenario.cov_radar).reshape(-1, len(RADAR))
    std = np.sqrt(variance[:, CONSTANT])
    worst = int(np.argmax(std / constant))
    if std[worst] <= constant[worst] or scenario.tolerances[worst]:
        return ()
    text = (
        f"sigma of c_r, {std[worst]:.4g}, is above c_r itself, {constant[worst]:.4g}, at the level "
        f"{scenario.level}: are both in the same unit?"
    )
    return (warning("uncertainty-large", text),)
