"""Warnings of scenarios that are allowed but implausible, for example of wrong units."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
from scipy.constants import speed_of_light
from scipy.special import ndtr

from radar_sense.acceptance.frames import attitude_off, turned_wrongly
from radar_sense.acceptance.refinement import along, coarseness, places
from radar_sense.flight import Path
from radar_sense.model.antenna import ElevationGain
from radar_sense.model.geodesy import turn_from_level, turned_attitude
from radar_sense.model.geometry import body_vector, elevation_of, radar_from_aircraft, slant_range
from radar_sense.model.horizon import horizon_range
from radar_sense.model.rcs_table import TableRCS
from radar_sense.propagation import BOUND_CHANGE
from radar_sense.scenario import Scenario
from radar_sense.states import ATTITUDE, CONSTANT, DOWN, POSITION, RADAR, FloatArray
from radar_sense.words import describe_poses, listed, placed, warning

#: Least speed [m/s] of a flight, if it moves at all, and greatest speed without a warning. A number
#: below the first may be a Mach number.
MIN_SPEED, MAX_SPEED = 3.0, 2e3
#: Greatest bank and pitch [rad] without a warning: a level turn at twice the weight.
STEEP = np.deg2rad(60.0)
#: Steps that may turn by more than an angle [rad] without a warning: routes of a planner have few
#: turns back.
SHARP_TURNS, SHARP = 10, np.deg2rad(120.0)
#: Greatest angle of the attitude [rad] without a warning: two turns, as of a yaw without steps. In
#: Python angles are in radians.
MAX_ANGLE = 4.0 * np.pi
#: Standard deviation of an angle of which nothing is known [rad]: uniform over a turn.
UNKNOWN_ANGLE = np.pi / np.sqrt(3.0)
#: Least height of the sea above the ellipsoid [m], south of India (EGM2008, -106.9 m).
MIN_HEIGHT = -107.0
#: Greatest height [m]: the edge of space (Fédération Aéronautique Internationale, Sporting Code,
#: section 8, 2.18.1).
MAX_HEIGHT = 100e3
#: Frequencies of radars [GHz], from HF to the millimetre waves (IEEE Std 521-2019, table 1).
FREQUENCIES = 0.003, 300.0
#: Largest elevation [rad] at which a table without elevations stands for all elevations. The area
#: that an upright plate shows falls by 3 % up to 15°, and its cross section, with the square of the
#: area, by 0.3 dB.
MAX_ELEVATION = np.deg2rad(15.0)
#: Scans and looks are at the same intervals up to this part: the rounding of a data sheet.
SAME_SCAN = 0.02
#: P_D counts as at the floor up to this part above the floor: a signal 30 dB below the noise.
ABOVE_FLOOR = 0.01


def plausibility_warnings(scenario: Scenario) -> tuple[str, ...]:
    """Return a warning for each implausible property of a scenario."""
    whole = scenario.along(scenario.geometry.whole)
    of_flight = (_speed, _steep, _height, _attitude, _ground, _range, _floor, _elevation, _antenna)
    others = (_spacing, _step, _origin, _frequency, _scan, _constant)
    texts = (*(check(whole) for check in of_flight), *(check(scenario) for check in others))
    return tuple(itertools.chain(*texts))


def _speed(scenario: Scenario) -> Iterator[str]:
    if scenario.time_s is None or len(scenario.time_s) < 2:
        return
    step = np.linalg.norm(np.diff(scenario.aircraft[:, POSITION], axis=0), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = step / np.diff(scenario.time_s)
    fastest = int(np.nanargmax(speed))
    if speed[fastest] > MAX_SPEED:
        yield warning(
            "too-fast",
            f"the aircraft flies at up to {speed[fastest] / 1e3:.3g} km/s, after "
            f"{scenario.axis.at(fastest)}: is time_s in seconds, and are positions in their units?",
        )
    elif 0 < speed[fastest] < MIN_SPEED:
        yield warning(
            "too-slow",
            f"the aircraft flies at {speed[fastest]:.2g} m/s at most: are times in seconds, speeds "
            "in m/s, and positions in their units?",
        )


def _steep(scenario: Scenario) -> Iterator[str]:
    if scenario.time_s is None:
        return
    roll, pitch, yaw = level_attitude(scenario).T
    bank, pitch = abs(roll), abs(pitch)
    yield from placed(
        "bank-steep",
        bank > STEEP,
        scenario.axis,
        f"the aircraft banks by up to {np.rad2deg(bank.max()):.3g} deg",
        ": if bank follows from the track, it needs precise positions",
    )
    yield from placed(
        "climb-steep",
        pitch > STEEP,
        scenario.axis,
        f"the aircraft climbs or dives by up to {np.rad2deg(pitch.max()):.3g} deg",
        ": if pitch follows from the track, give the attitude of what can climb on the spot",
    )
    turn = abs((np.diff(yaw) + np.pi) % math.tau - np.pi)
    sharp = np.count_nonzero(turn > SHARP)
    if sharp > SHARP_TURNS:
        yield warning(
            "course-noisy",
            f"the course turns by more than {np.rad2deg(SHARP):.0f} deg in {sharp} of {len(turn)} "
            "steps: of a recorded hover it is noise; leave out these rows, or give the attitude",
        )


def level_attitude(scenario: Scenario) -> FloatArray:
    """Return roll, pitch, yaw (n, 3) [rad], relative to the horizontal at the aircraft."""
    attitude = scenario.aircraft[:, ATTITUDE]
    if scenario.origin is not None:
        turn = turn_from_level(scenario.aircraft[:, POSITION], scenario.origin)
        attitude = turned_attitude(attitude, np.swapaxes(turn, -1, -2))
    return attitude


def _height(scenario: Scenario) -> Iterator[str]:
    height = scenario.geometry.horizon.height(scenario.aircraft)
    above = _surface(scenario)
    highest = float(height.max())
    if highest > MAX_HEIGHT:
        yield warning(
            "too-high",
            f"the aircraft is up to {highest / 1e3:.4g} km above {above}: is the height in its "
            "unit?",
        )
    # On a route that lands, the height is known worse than itself at some poses.
    covariance = np.broadcast_to(scenario.cov_aircraft, (len(height), 6, 6))[:, POSITION, POSITION]
    std = scenario.geometry.horizon.height_error(scenario.aircraft, covariance)
    if highest > 0 and np.all(std > height):
        yield warning(
            "uncertainty-large",
            f"sigma of the height, {std.max():.4g} m, is above the height at all poses, "
            f"{highest:.4g} m above {above} at most: are both in their units?",
        )
    below, lowest = height < _ground_height(scenario), f"{-height.min():.4g} m below {above}"
    if below.any() and scenario.origin is not None:
        yield warning(
            "below-ground",
            f"the aircraft is below every radar and {lowest}, lower than any sea: are altitudes in "
            "metres, and positive upwards?",
        )
    elif below.any():
        yield warning(
            "below-ground",
            f"the aircraft is {lowest} and below every radar "
            f"{describe_poses(below, scenario.axis)}: down is positive downwards, so heights are "
            "negative",
        )


def _attitude(scenario: Scenario) -> Iterator[str]:
    angle = float(abs(scenario.aircraft[:, ATTITUDE]).max())
    if angle > MAX_ANGLE:
        yield warning(
            "angle-large",
            f"an angle of the attitude is {angle:.4g} rad, {math.degrees(angle):.4g} deg: is it in "
            "its unit?",
        )
    variance = np.diagonal(scenario.cov_aircraft, axis1=-2, axis2=-1)[..., ATTITUDE]
    std = math.sqrt(variance.max())
    if std > UNKNOWN_ANGLE:
        yield warning(
            "uncertainty-large",
            f"sigma of the attitude, {math.degrees(std):.4g} deg, is above that of an angle of "
            f"which nothing is known, {math.degrees(UNKNOWN_ANGLE):.0f} deg: is it in its unit?",
        )


def _ground(scenario: Scenario) -> Iterator[str]:
    """Yield a warning of radars below the ground that their horizon has."""
    each = zip(_names(scenario), scenario.radars, scenario.radar_states, strict=True)
    height = {
        name: float(radar.horizon.height(state[POSITION]))
        for name, radar, state in each
        if radar.horizon is not None
    }
    below = [name for name, value in height.items() if value < 0]
    if below:
        are = "is" if len(below) == 1 else "are up to"
        yield warning(
            "below-ground",
            f"{listed(below)} {are} {-min(height.values()):.4g} m below {_surface(scenario)}, "
            "which is the ground of the horizon: down is positive downwards, altitude_m is above "
            "the ellipsoid",
        )


def _surface(scenario: Scenario) -> str:
    """Return what heights of a scenario are above, in words."""
    if scenario.origin is None:
        return "the origin"
    return "the sea level" if scenario.geometry.horizon.surface else "the ellipsoid"


def height_of_option(scenario: Scenario, down_km: float | None) -> Iterator[str]:
    """Yield a warning if a down coordinate of an option [km] is below the ground, or in space.

    None is no coordinate.
    """
    if down_km is None:
        return
    height = float(scenario.geometry.horizon.height(np.array([0.0, 0.0, 1e3 * down_km])))
    if height < _ground_height(scenario):
        further = "and below every radar" if scenario.origin is None else "at the origin"
        yield warning(
            "below-ground",
            f"the aircraft is {-height:.4g} m below {_surface(scenario)} {further}: --down-km is "
            "positive downwards, so heights are negative",
        )
    elif height > MAX_HEIGHT:
        yield warning(
            "too-high",
            f"the aircraft is {height / 1e3:.4g} km above {_surface(scenario)}: --down-km is in "
            "kilometres",
        )


def _ground_height(scenario: Scenario) -> float:
    """Return the least height of a ground [m]: of the lowest radar, or the lowest sea or origin."""
    lowest = float(scenario.geometry.horizon.height(scenario.radar_states).min())
    return min(lowest, 0.0 if scenario.origin is None else MIN_HEIGHT)


def _names(scenario: Scenario) -> list[str]:
    """Return the name of each radar (m,) for a sentence."""
    return [f"radar {name}" for name in scenario.model.names] or ["the radar"]


def _range(scenario: Scenario) -> Iterator[str]:
    """Yield a warning of radars, and of an origin, that see no pose above their horizon.

    The aircraft is taken to be at its height or at `MAX_HEIGHT`, whichever is higher.
    """
    highest = np.maximum(-scenario.aircraft[:, DOWN].min(), MAX_HEIGHT)
    beyond = horizon_range(np.zeros(()), highest)
    each = zip(_names(scenario), scenario.radar_states, strict=True)
    nearest = {name: slant_range(scenario.aircraft, radar).min() for name, radar in each}
    if scenario.origin is not None:
        nearest["the origin"] = slant_range(scenario.aircraft, np.zeros(len(RADAR))).min()
    far = {name: distance for name, distance in nearest.items() if distance > beyond}
    if far:
        order = "" if scenario.origin is None else ", and latitude and longitude in their order"
        yield warning(
            "too-far",
            f"the aircraft is at least {min(far.values()) / 1e3:.4g} km from {listed([*far])}: are "
            f"positions in their units{order}?",
        )


def _floor(scenario: Scenario) -> Iterator[str]:
    visible = scenario.model.visible(scenario.aircraft, scenario.radar)
    if not visible.any():
        limits = "max_range_km, min_range_km, horizon and mask"
        yield warning("never-seen", f"no radar sees the aircraft at a nominal pose: see {limits}")
        return
    p_d = scenario.p_d()
    floor = ndtr(scenario.model.floor(visible))
    if np.all(p_d <= (1.0 + ABOVE_FLOOR) * floor):
        yield warning(
            "no-signal",
            f"P_D is at its floor at all poses, {np.max(p_d):.3g}, as without a signal: are radar "
            "constant, RCS and ranges in their units?",
        )


def _elevation(scenario: Scenario) -> Iterator[str]:
    """Yield a warning if a table without elevations is used far above or below the aircraft."""
    level = [isinstance(m.rcs, TableRCS) and m.rcs.elevation is None for m in scenario.model.models]
    towards = np.stack([body_vector(scenario.aircraft, radar) for radar in scenario.radar_states])
    used = scenario.model.visible(scenario.aircraft, scenario.radar) & level
    highest = np.max(np.abs(elevation_of(towards)), axis=0, where=used.T, initial=0.0)
    yield from placed(
        "table-level",
        highest > MAX_ELEVATION,
        scenario.axis,
        "the RCS table has no elevations and is used at up to "
        f"{np.rad2deg(highest.max()):.3g} deg above or below the aircraft",
        ": measure at elevations",
    )


def _antenna(scenario: Scenario) -> Iterator[str]:
    """Yield a warning if an antenna is used beyond the elevations of its gain."""
    far = np.zeros(len(scenario.aircraft))
    visible = scenario.model.visible(scenario.aircraft, scenario.radar)
    for i, radar in enumerate(scenario.radars):
        line = radar_from_aircraft(scenario.aircraft, scenario.radar_states[i])
        for factor in radar.model.factors:
            if isinstance(factor, ElevationGain):
                far = np.maximum(far, factor.outside(line) * visible[:, i])
    yield from placed(
        "gain-beyond",
        far > 0,
        scenario.axis,
        f"the gain of an antenna is used up to {np.rad2deg(far.max()):.3g} deg beyond its "
        "elevations",
        ", where the last gain holds: add elevations to the file of elevation_gain",
    )


def _spacing(scenario: Scenario) -> Iterator[str]:
    geometry = scenario.geometry
    if not isinstance(geometry, Path) or geometry.flight is not None:
        return  # of poses between the rows the user has chosen the step
    coarse = coarseness(scenario, lobes=False) > 1.0
    if coarse.any():
        longest = float(np.diff(geometry.time_s)[coarse].max())
        yield warning(
            "rows-apart",
            f"rows of the path are up to {longest:.4g} s apart, and P_D may differ much between "
            f"them: aspect or range change much in {np.count_nonzero(coarse)} of {len(coarse)} "
            "steps; add poses between the rows"
            + (" with geometry.interpolate" if scenario.source is not None else ""),
        )


def _step(scenario: Scenario) -> Iterator[str]:
    """Yield a warning if the step between the poses of a path is longer than the path."""
    if scenario.source is None or scenario.time_s is None:
        return
    # of a path that has replaced the poses of a file, nothing is stated
    stated, time = getattr(scenario.source.file.geometry, "interpolate", None), scenario.time_s
    if stated is not None and float(stated.step_s) > np.ptp(time) > 0:
        yield warning(
            "step-long",
            f"geometry.interpolate has a step of {float(stated.step_s):g} s, longer than the route "
            f"of {np.ptp(time):.4g} s: no pose is added",
        )


def _origin(scenario: Scenario) -> Iterator[str]:
    """Yield a warning where a far origin changes what errors of attitude do to P_D.

    Where the aircraft flies from row to row, the greatest P_D between them counts, too.
    """
    if not turned_wrongly(scenario).any():
        return
    flight = along(scenario, places(scenario)) if scenario.geometry.continuous else scenario
    off = attitude_off(flight)
    yield from placed(
        "origin-far",
        off > BOUND_CHANGE,
        flight.axis,
        "the origin is too far for attitude errors this large: P_D at 3 sigma is off by up to "
        f"{off.max():.2g}",
        ": choose a geometry.origin near the route",
    )


def _frequency(scenario: Scenario) -> Iterator[str]:
    """Yield a warning of the frequencies in a scenario file that no radar has."""
    file = None if scenario.source is None else scenario.source.file
    radars = () if file is None else file.radars or (file.radar,)
    sheets = [radar.tracking for radar in radars if radar.tracking is not None]
    every = [s.frequency_ghz or speed_of_light / 1e9 / s.wavelength_m for s in sheets]
    low, high = FREQUENCIES
    odd = [f"{frequency:.4g} GHz" for frequency in every if not low <= frequency <= high]
    if odd:
        yield warning(
            "frequency-odd",
            f"a radar at {', '.join(odd)}: radars are at {low:g} to {high:g} GHz, is the unit "
            "right?",
        )


def _scan(scenario: Scenario) -> Iterator[str]:
    """Yield a warning if a radar looks at other intervals than its data sheet says."""
    for name, radar in zip(_names(scenario), scenario.radars, strict=True):
        period, scan = radar.scan_period, None if radar.sheet is None else radar.sheet.scan_time
        if period and scan and not math.isclose(period, scan, rel_tol=SAME_SCAN):
            yield warning(
                "scan-differs",
                f"{name} looks every {period:.4g} s, by scan_period_s, and its data sheet has "
                f"scans of {scan:.4g} s: c_r has the energy of a scan",
            )


def _constant(scenario: Scenario) -> Iterator[str]:
    """Yield a warning if a normal c_r, or a normal parameter of one, is below zero within 3σ."""
    normal = []
    for name, radar in zip(_names(scenario), scenario.radars, strict=True):
        level = radar.levels[scenario.level]
        normal += [
            (f"{t.key} of {name}", t.value, t.std)
            for t in level.tolerances
            if t.power > 0 and not (t.decibels or t.rectangular)
        ]
        if radar.state is not None and not level.tolerances:
            std = math.sqrt(level.covariance[CONSTANT, CONSTANT])
            normal.append((f"c_r of {name}", float(radar.state[CONSTANT]), std))
    what, value, std = max(normal, key=lambda of: of[2] / of[1], default=("", 1.0, 0.0))
    if 3.0 * std > value:
        yield warning(
            "constant-clipped",
            f"{what} is {value:.4g} with sigma {std:.4g} at the level {scenario.level}, so it "
            f"counts as 0 in {ndtr(-value / std):.1%} of the cases, as without a signal: give "
            "tolerances in dB, or check the units",
        )
