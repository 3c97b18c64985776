"""From a scenario file to a `Scenario`: SI, frames, levels, and the checks across sections."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from scipy.constants import speed_of_light

from radar_sense import axis, covariance
from radar_sense.errors import InputError, did_you_mean
from radar_sense.flight import CERTAIN, Geometry, Orbit, Path, Radial
from radar_sense.limits import DEG, LARGEST, MIN_RANGE, NOT_NEGATIVE, SMALLEST
from radar_sense.model.antenna import ElevationGain, Mask
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.detectors import Detector, PulseDetector
from radar_sense.model.geodesy import ned_from_geodetic, turn_to_origin
from radar_sense.model.geometry import body_vector, slant_range
from radar_sense.model.horizon import Horizon
from radar_sense.model.radar import Level, Radar
from radar_sense.model.radar_constant import (
    MAX_DIVISOR_STD,
    DataSheet,
    Tolerance,
    column_name,
    loss_key,
    relative_std,
)
from radar_sense.model.radar_equation import LOSSES_KEY, RADARS, SEARCH_FACTORS
from radar_sense.model.rcs import RCS
from radar_sense.model.rcs_table import TableRCS
from radar_sense.model.track import covariance_in_frame
from radar_sense.model.trajectory import MAX_ROWS, resample
from radar_sense.scenario import Scenario
from radar_sense.scenario_file import sections
from radar_sense.scenario_file.curve_file import GAIN_COLUMNS, MASK_COLUMNS, read_curve
from radar_sense.scenario_file.declare import keys_of
from radar_sense.scenario_file.place import Place
from radar_sense.scenario_file.rcs_file import read_rcs_table
from radar_sense.scenario_file.route_file import read_route
from radar_sense.scenario_file.table_file import Column
from radar_sense.scenario_file.text_file import DigestError, FileError, recorded
from radar_sense.source_names import name_problem
from radar_sense.states import POSITION, FloatArray

_KM, _PER_KM = 1e3, 1e-3
#: Keys of a path that the reader of routes takes as they are.
_OF_ROUTE = (
    *("max_gap_s", "altitude_above", "geoid_height_m", "down_km", "altitude_m"),
    *("speed_m_s", "icao24", "sha256"),
)


def build(
    file: sections.File, place: Place, again: Callable[[Mapping[str, Any]], Scenario]
) -> Scenario:
    """Return the scenario of a file.

    Args:
        file: The file.
        place: Root of the file, for errors.
        again: Reads the file again with other values of some keys.

    Raises:
        InputError: If sections contradict each other, or a file that is named is not allowed.
    """
    rcs, rcs_section = _rcs_by_band(file.aircraft.rcs, place["aircraft"]["rcs"])
    geometry, flight_section = _geometry(file, place)
    radars, radar_sections = zip(*_radars(file, place, rcs, geometry), strict=True)
    for radar in radars:
        _refuse_collision(place["geometry"], geometry, radar)
        _refuse_uncovered(place["geometry"], geometry, radar)
    geometry = _with_covariance(file.uncertainty, place["uncertainty"], geometry)
    levels, level = radars[0].levels, file.analysis.level
    if level not in levels:
        raise place["analysis"]["level"].error(
            f"must be one of {', '.join(levels)}, got {level!r}{did_you_mean(level, levels)}"
        )
    scenario = Scenario(
        name=file.name,
        radars=radars,
        geometry=geometry,
        level=level,
        runs=file.analysis.runs,
        seed=file.analysis.seed,
        method=file.analysis.method,
        rcs_db=_rcs_db(file.uncertainty.aircraft, place["uncertainty"]["aircraft"], rcs),
        correlation_s=float(file.uncertainty.aircraft_correlation_s),
    )
    aircraft = dataclasses.replace(file.aircraft, rcs=rcs_section)
    file = dataclasses.replace(
        file,
        aircraft=aircraft,
        geometry=flight_section,
        **({"radars": radar_sections} if file.radar is None else {"radar": radar_sections[0]}),
    )
    return scenario.of_file(file, again)


def _origin(geometry: Geometry) -> tuple[float, float, float] | None:
    return geometry.origin if isinstance(geometry, Path) else None


def _si(place: sections.Place) -> tuple[float, float, float]:
    """Return latitude, longitude [rad] and height [m]."""
    return place.latitude_deg * DEG, place.longitude_deg * DEG, float(place.altitude_m)


def _read_from(place: Place, read: Any, *args: Any, **options: Any) -> Any:
    """Read another file. Errors about the file as a whole get the place of the key that names it.

    Errors with a line of the other file stay as they are.
    """
    try:
        return read(*args, **options)
    except DigestError as error:
        raise place["sha256"].error(f"{error}") from error
    except FileError as error:
        raise (place["file"] if place.is_mapping else place).error(f"{error}") from error


# The aircraft and its flight.


def _rcs_by_band(stated: Any, place: Place) -> tuple[dict[str, RCS], Any]:
    """Return the RCS by band, by "" where all radars have one, and its section with digests."""
    if not isinstance(stated, sections.Bands):
        rcs, section = _rcs(stated, place)
        return {"": rcs}, section
    both = {band: _rcs(own, place["bands"][band]) for band, own in stated.bands.items()}
    section = sections.Bands(bands={band: section for band, (_, section) in both.items()})
    return {band: rcs for band, (rcs, _) in both.items()}, section


def _rcs(stated: Any, place: Place) -> tuple[RCS, Any]:
    """Return the RCS and its section, with the digest of the file of a table."""
    if not isinstance(stated, sections.Table):
        return stated, stated
    path = FilePath(place.file).parent / stated.file
    envelope = None if stated.envelope_deg is None else stated.envelope_deg * DEG
    options = {"mirror": stated.mirror, "envelope": envelope, "sha256": stated.sha256}
    table, sha256 = _read_from(place, read_rcs_table, path, **options)
    return table, dataclasses.replace(stated, file=recorded(path), sha256=sha256)


def _geometry(file: sections.File, place: Place) -> tuple[Geometry, Any]:
    """Return the poses and the flight, and their section, with the digest of a route file."""
    attitude = file.aircraft.attitude_deg
    if isinstance(file.geometry, sections.Path):
        if attitude is not None:
            raise place["aircraft"]["attitude_deg"].error(
                "must be left out with a path: attitude is from the route file or from its track"
            )
        return _path(file.geometry, place["geometry"])
    if attitude is None:
        kind = "a radial" if isinstance(file.geometry, sections.Radial) else "an orbit"
        raise place["aircraft"].error(f"missing key 'attitude_deg', required on {kind}")
    stated, level = file.geometry, np.array(attitude) * DEG
    of_both: dict[str, Any] = {
        "down": stated.down_km * _KM,
        "azimuth_from": stated.azimuth_from,
    }
    if isinstance(stated, sections.Radial):
        ranges = _steps(stated.range_km, place["geometry"]["range_km"]["step"])
        return Radial.of(ranges, level, azimuth=float(stated.azimuth_deg), **of_both), stated
    azimuths = _steps(stated.azimuth_deg, place["geometry"]["azimuth_deg"]["step"])
    return Orbit.of(azimuths, level, radius=stated.range_km * _KM, **of_both), stated


def _steps(stated: sections.Sweep | sections.Ranges, place: Place) -> FloatArray:
    """Return azimuths (n,) [deg] or ground ranges (n,) [km]."""
    try:
        return axis.steps(float(stated.start), float(stated.stop), float(stated.step), MAX_ROWS)
    except InputError as error:
        raise place.error(f"{error}") from error


def _path(stated: sections.Path, place: Place) -> tuple[Path, sections.Path]:
    path = FilePath(place.file).parent / stated.file
    route, sha256 = _read_from(
        place,
        read_route,
        path,
        origin=None if stated.origin is None else _si(stated.origin),
        **{name: getattr(stated, name) for name in _OF_ROUTE},
    )
    step_s = None
    if stated.interpolate is not None:
        step_s = float(stated.interpolate.step_s)
        try:
            route = resample(route, step_s, stated.interpolate.method)
        except InputError as error:
            raise place["interpolate"].error(f"{error}") from error
    along = axis.time(route.time_s) if stated.axis == "time" else axis.distance(route.distance_m)
    flight = Path(
        along,
        route.aircraft,
        CERTAIN if route.covariance is None else route.covariance,
        time_s=route.time_s,
        origin=route.origin,
        step_s=step_s,
    )
    return flight, dataclasses.replace(stated, file=recorded(path), sha256=sha256)


def _with_covariance(stated: sections.Uncertainty, place: Place, geometry: Geometry) -> Geometry:
    """Return the poses with C_aa (6, 6), or with C_aa of each pose (n, 6, 6)."""
    own = stated.aircraft
    if geometry.covariance.ndim == 3:
        if own is not None and {*place["aircraft"].items()} != {"rcs_db"}:
            raise place["aircraft"].error(
                "must be left out here, or the columns std_... and cov_... in the route file: "
                "both state the uncertainty of the aircraft"
            )
        return geometry
    if own is None:
        raise place.error("missing key 'aircraft', required unless the route file has std_...")
    place = place["aircraft"]
    matrix = _covariance(own, place, {"position_m": (3, 1.0), "attitude_deg": (3, DEG)})
    if isinstance(geometry, Path) and geometry.origin is not None:
        try:
            matrix = covariance_in_frame(
                matrix, geometry.time_s, geometry.aircraft, geometry.origin
            )
        except InputError as error:
            raise place.error(f"{error}") from error
    return dataclasses.replace(geometry, covariance=matrix)


def _rcs_db(stated: sections.PoseUncertainty | None, place: Place, rcs: Mapping[str, RCS]) -> float:
    """Return the standard deviation of the RCS [dB]."""
    if stated is None or not stated.rcs_db:
        return 0.0
    if any(getattr(own, "spread", None) is not None for own in rcs.values()):
        raise place["rcs_db"].error(
            "stands beside the column std_db of the RCS table; give only one of the two: both are "
            "the uncertainty of the RCS"
        )
    return float(stated.rcs_db)


def _covariance(
    stated: sections.PoseUncertainty | sections.RadarUncertainty,
    place: Place,
    parts: Mapping[str, tuple[int, float]],
) -> FloatArray:
    """Return a covariance in SI from its parts, or from the whole.

    Args:
        stated: The section.
        place: The section, for errors.
        parts: Size of each part, and SI value of 1 in the unit of the part.
    """
    if stated.covariance is not None:
        units = np.concatenate([np.full(size, unit) for size, unit in parts.values()])
        return _matrix(stated.covariance, place["covariance"]) * np.outer(units, units)
    total = np.zeros((sum(size for size, _ in parts.values()),) * 2)
    start = 0
    for name, (size, unit) in parts.items():
        block = slice(start, start + size)
        value = getattr(stated, name)
        if value is None:
            raise place.error(f"missing key '{name}', required without covariance")
        if isinstance(value, tuple) and isinstance(value[0], tuple):
            total[block, block] = _matrix(value, place[name]) * unit**2
        else:
            total[block, block] = covariance.from_std(np.broadcast_to(value, size)) * unit**2
        start += size
    return total


def _matrix(rows: Sequence[Sequence[float]], place: Place) -> FloatArray:
    matrix = np.array(rows)
    problem = covariance.problem(matrix)
    if problem:
        raise place.error(problem)
    symmetric: FloatArray = (matrix + matrix.T) / 2
    return symmetric


# The radars.


def _radars(
    file: sections.File, place: Place, rcs: Mapping[str, RCS], geometry: Geometry
) -> list[tuple[Radar, sections.Radar]]:
    """Return each radar, and its section with the digests of its files."""
    uncertainty, types = place["uncertainty"], _Types(file.types or {}, place["types"])
    if file.radar is not None:
        if file.uncertainty.radar is None:
            raise uncertainty.error("missing key 'radar', required with 'radar'")
        levels, at = file.uncertainty.radar, uncertainty["radar"]
        return [_radar(file.radar, levels, place["radar"], at, rcs, geometry, types)]
    if file.uncertainty.radar is not None:
        raise uncertainty["radar"].error(
            "must be left out here: give 'uncertainty' of each radar in 'radars'"
        )
    stated = file.radars or ()
    for i, radar in enumerate(stated):
        names = [r.name for r in stated[: i + 1]]
        _refuse_name(names, [*rcs], [*types.stated], place["radars"][i]["name"])
        _refuse_other_levels(stated[0], radar, place["radars"][i]["uncertainty"])
    return [
        _radar(radar, radar.uncertainty, entry, entry["uncertainty"], rcs, geometry, types)
        for radar, entry in zip(stated, place["radars"].entries(), strict=True)
    ]


def _refuse_name(
    names: Sequence[str], bands: Sequence[str], types: Sequence[str], place: Place
) -> None:
    """Raise InputError unless the last of some names of radars is unlike the others."""
    if names[-1] in names[:-1]:
        raise place.error(f"must be a name that no other radar has, got {names[-1]!r}")
    problem = name_problem(names, bands, types)
    if problem:
        raise place.error(problem)


def _refuse_other_levels(
    first: sections.NamedRadar, radar: sections.NamedRadar, place: Place
) -> None:
    """Raise InputError unless a radar has the levels of the first."""
    expected, levels = list(first.uncertainty), radar.uncertainty
    for level in levels:
        if level not in expected:
            raise place[level].error(
                f"must be a level that radar {first.name!r} has too: {', '.join(expected)}"
                + did_you_mean(level, set(expected) - set(levels))
            )
    missing = [level for level in expected if level not in levels]
    if missing:
        raise place.error(
            f"missing level '{missing[0]}'; radar {radar.name!r} must have the levels that radar "
            f"{first.name!r} has: {', '.join(expected)}"
        )


def _radar(
    stated: sections.Radar,
    levels: sections.Levels,
    place: Place,
    at_levels: Place,
    rcs: Mapping[str, RCS],
    geometry: Geometry,
    types: _Types,
) -> tuple[Radar, sections.Radar]:
    """Return a radar, and its section with the digests of its files.

    Args:
        stated: Its section.
        levels: Its levels of uncertainty.
        place: The section, for errors.
        at_levels: The levels, for errors.
        rcs: RCS of the aircraft by band.
        geometry: The poses, which have the frame.
        types: What the radars of a type share.
    """
    sheet = _data_sheet(stated, place)
    _refuse_detector(stated, place["detector"])
    attenuation = stated.attenuation_db_per_km * _PER_KM
    band = _band(stated, place, rcs)
    shared = types.of(stated, place, list(levels))
    position, turn = _position(stated, place, geometry)
    stated, antenna, mask = _by_direction(stated, place, np.eye(3) if turn is None else turn)
    model = DetectionModel(rcs[band], float(stated.p_fa), stated.detector, attenuation, antenna)
    constant = stated.constant if sheet is None else sheet.constant
    period = stated.scan_period_s
    radar = Radar(
        model,
        name=getattr(stated, "name", ""),
        state=np.array([*position, constant], dtype=float),
        levels={
            name: _level(level, at_levels[name], sheet, model, turn, shared.get(name))
            for name, level in levels.items()
        },
        max_range=math.inf if stated.max_range_km is None else stated.max_range_km * _KM,
        min_range=_min_range(stated, sheet, place),
        horizon=Horizon(_origin(geometry)) if stated.horizon else None,
        scan_period=None if period is None else float(period),
        sheet=sheet,
        band=band,
        mask=mask,
    )
    return radar, stated


def _by_direction(
    stated: sections.Radar, place: Place, axes: FloatArray
) -> tuple[sections.Radar, ElevationGain | None, Mask | None]:
    """Return the section of a radar with the digests of its files, its antenna and its mask.

    Args:
        stated: The section.
        place: The section, for errors.
        axes: North, east and down (3, 3) at the radar, in the frame of the poses.
    """
    antenna = mask = None
    if stated.elevation_gain is not None:
        file, elevation, gain_db = _curve(
            stated.elevation_gain, place["elevation_gain"], "a file of gains", GAIN_COLUMNS
        )
        stated = dataclasses.replace(stated, elevation_gain=file)
        antenna = ElevationGain(elevation, gain_db, stated.tilt_deg * DEG, axes=axes)
    elif stated.tilt_deg:
        raise place["tilt_deg"].error("needs elevation_gain, the gain that is tilted")
    if stated.mask is not None:
        file, azimuth, lowest = _curve(stated.mask, place["mask"], "a file of a mask", MASK_COLUMNS)
        stated, mask = dataclasses.replace(stated, mask=file), Mask(azimuth, lowest, axes=axes)
    return stated, antenna, mask


def _curve(
    stated: str | sections.DataFile, place: Place, kind: str, columns: Mapping[str, Column]
) -> tuple[sections.DataFile, FloatArray, FloatArray]:
    """Return the section of a file with its digest, and the angles and values of the file."""
    if isinstance(stated, str):
        stated = sections.DataFile(file=stated)
    path = FilePath(place.file).parent / stated.file
    angle, value, sha256 = _read_from(place, read_curve, path, kind, columns, stated.sha256)
    return sections.DataFile(file=recorded(path), sha256=sha256), angle, value


def _band(stated: sections.Radar, place: Place, rcs: Mapping[str, RCS]) -> str:
    """Return the band of a radar, "" where all radars have one RCS."""
    if "" in rcs:
        if stated.band is not None:
            raise place["band"].error("needs aircraft.rcs.bands, an RCS by band")
        return ""
    if stated.band is None:
        raise place.error(f"missing key 'band', one of {', '.join(rcs)} of aircraft.rcs.bands")
    if stated.band not in rcs:
        raise place["band"].error(
            f"must be one of {', '.join(rcs)} of aircraft.rcs.bands, got {stated.band!r}"
            + did_you_mean(stated.band, rcs)
        )
    return stated.band


def _position(
    stated: sections.Radar, place: Place, geometry: Geometry
) -> tuple[FloatArray, FloatArray | None]:
    """Return north, east, down (3,) [m], and the turn (3, 3) of local axes to the frame, if any."""
    if stated.position_geodetic is None:
        return np.array(stated.position_m), None
    origin = _origin(geometry)
    if origin is None:
        raise place["position_geodetic"].error(
            "needs a path whose route is in latitude and longitude, with its geometry.origin; "
            "here give position_m"
        )
    on_earth = _si(stated.position_geodetic)
    return ned_from_geodetic(on_earth, origin), turn_to_origin(on_earth, origin)


def _refuse_detector(stated: sections.Radar, place: Place) -> None:
    detector: Detector = stated.detector
    if not isinstance(detector, PulseDetector):
        return
    looks = detector.pulses * (detector.binary.n if detector.binary else 1)
    if stated.surveillance is not None and looks > 1:
        raise place.error(
            "must be of one pulse with 'surveillance', which takes all the energy of a scan "
            "for a single pulse; 'tracking' and 'constant' take one of several pulses"
        )
    try:
        detector.tails(float(stated.p_fa))  # a CFAR with few cells cannot have a small P_fa
    except InputError as error:
        raise place.error(f"{error}") from error


def _min_range(stated: sections.Radar, sheet: DataSheet | None, place: Place) -> float:
    """Return the slant range [m] within which a radar detects nothing."""
    min_range, key = stated.min_range_km * _KM, "min_range_km"
    if stated.eclipsing:
        if sheet is None or "pulse_width_us" not in sheet.values:
            raise place["eclipsing"].error(
                "needs the length of the pulse, pulse_width_us of 'tracking'; here give "
                "min_range_km"
            )
        eclipsed = 0.5 * speed_of_light * sheet.values["pulse_width_us"] * 1e-6
        if eclipsed > min_range:
            min_range, key = eclipsed, "eclipsing"
    if stated.max_range_km is not None and min_range >= stated.max_range_km * _KM:
        raise place[key].error(
            f"hides the target within {min_range / _KM:g} km, must be less than max_range_km, "
            f"{stated.max_range_km:g} km"
        )
    return min_range


def _level(
    stated: sections.RadarUncertainty,
    place: Place,
    sheet: DataSheet | None,
    model: DetectionModel,
    turn: FloatArray | None,
    shared: _Shared | None,
) -> Level:
    """Return the uncertainty of a radar at one level, in the frame of the poses.

    Args:
        stated: The section.
        place: The section, for errors.
        sheet: Data sheet of the radar, or None.
        model: Detection model of the radar.
        turn: Turn (3, 3) to the frame from north, east and down at a radar in latitude and
            longitude, where the file has the covariance; None if they are the same.
        shared: What the radars of its type share; None without a type.
    """
    tolerances: tuple[Tolerance, ...] = ()
    if isinstance(stated.constant, sections.Tolerances):
        tolerances = _tolerances(stated.constant, place["constant"], sheet)
    if shared is not None:
        if not tolerances and (stated.covariance is not None or stated.constant):
            raise (place if stated.constant is None else place["constant"]).error(
                "must have standard deviations by parameter, or constant: 0, as the radar has a "
                f"type: the errors of type {shared.type!r} are of parameters too"
            )
        tolerances = shared.beside(tolerances, sheet)
    if tolerances:
        assert sheet is not None
        std = sheet.constant * relative_std(tolerances)
        stated = dataclasses.replace(stated, constant=std)
    matrix = _covariance(stated, place, {"position_m": (3, 1.0), "constant": (1, 1.0)})
    if turn is not None:
        frame = np.eye(len(matrix))
        frame[POSITION, POSITION] = turn
        matrix = frame @ matrix @ frame.T
        matrix = covariance.without_rounding(0.5 * (matrix + matrix.T))
    std_attenuation = stated.attenuation_db_per_km * _PER_KM
    if std_attenuation > model.attenuation:
        raise place["attenuation_db_per_km"].error(
            "must be at most the attenuation_db_per_km of the radar, "
            f"{model.attenuation / _PER_KM:g}, got {stated.attenuation_db_per_km:g}"
        )
    if stated.tilt_deg and model.antenna is None:
        raise place["tilt_deg"].error("needs elevation_gain of the radar, the gain that is tilted")
    return Level(matrix, tolerances, std_attenuation, stated.tilt_deg * DEG)


@dataclass(frozen=True)
class _Shared:
    """What the radars of a type share at one level: the section, and its place for errors."""

    type: str
    stated: Any
    place: Place

    def beside(self, own: tuple[Tolerance, ...], sheet: DataSheet | None) -> tuple[Tolerance, ...]:
        """Return the tolerances of a radar and those of its type."""
        shared = _tolerances(self.stated, self.place, sheet)
        both = {t.key for t in own} & {t.key for t in shared}
        if both:
            raise self.place.error(
                f"{min(both)} stands at a radar of this type too; give only one of the two"
            )
        return (*own, *(dataclasses.replace(t, shared=self.type) for t in shared))


@dataclass(frozen=True)
class _Types:
    """The errors that radars of a type share: the sections, and their place for errors."""

    stated: sections.Types
    place: Place

    def of(self, radar: sections.Radar, place: Place, levels: list[str]) -> dict[str, _Shared]:
        """Return what a radar shares with others of its type, by level; {} without a type."""
        if radar.type is None:
            return {}
        if radar.type not in self.stated:
            known = ", ".join(self.stated) or "none is there"
            raise place["type"].error(
                f"must be one of types ({known}), got {radar.type!r}"
                + did_you_mean(radar.type, self.stated)
            )
        own, at = self.stated[radar.type], self.place[radar.type]
        if own.keys() != {*levels}:
            raise at.error(f"must have the levels of its radars: {', '.join(levels)}")
        return {level: _Shared(radar.type, own[level], at[level]) for level in levels}


# Data sheets.


def _data_sheet(stated: sections.Radar, place: Place) -> DataSheet | None:
    """Return the data sheet of a radar, or None for a constant."""
    kind = next((kind for kind in RADARS if getattr(stated, kind) is not None), None)
    if kind is None:
        return None
    sheet, place = getattr(stated, kind), place[kind]
    given = {k.name: v for k in keys_of(type(sheet)) if (v := getattr(sheet, k.name)) is not None}
    losses: dict[str, float] = given.pop(LOSSES_KEY, {})
    factor = given.pop("search_factor", None)
    arguments: dict[str, Any] = {LOSSES_KEY: losses, "loss_db": 0.0}
    for f in dataclasses.fields(RADARS[kind]):
        for name, unit in f.metadata.get("units", {}).items():
            if name in given:
                arguments[f.name] = unit.to_si(given[name])
    if factor is not None:
        arguments["search_factor"] = SEARCH_FACTORS[factor]
    for name in losses:
        column = column_name(loss_key(name))
        if column in (k.name for k in keys_of(type(sheet))):
            raise place[LOSSES_KEY][name].error(
                f"must have another name, as {column!r} is a key of the radar"
            )
    constant = RADARS[kind](**arguments).constant()
    if not SMALLEST <= constant <= LARGEST:
        raise place.error(
            f"makes the radar constant {constant:g} J m^2/K, allowed is {SMALLEST:g} to {LARGEST:g}"
        )
    values = {**given, **{loss_key(name): loss for name, loss in losses.items()}}
    return DataSheet(kind, constant, values)


def _tolerances(stated: Any, place: Place, sheet: DataSheet | None) -> tuple[Tolerance, ...]:
    """Return the tolerances of parameters of a data sheet."""
    if sheet is None:
        raise place.error(
            f"must be {NOT_NEGATIVE}, got a mapping; standard deviations by parameter need "
            f"{' or '.join(f'radar.{kind}' for kind in RADARS)} in place of radar.constant"
        )
    given = {k.name: v for k in keys_of(type(stated)) if (v := getattr(stated, k.name)) is not None}
    losses = given.pop(LOSSES_KEY, {})
    stds = {**given, **{loss_key(name): loss for name, loss in losses.items()}}
    limits = {name: v.half_width for name, v in stds.items() if hasattr(v, "half_width")}
    # JCGM 101:2008, 6.4.2
    std = {name: limits[name] / math.sqrt(3.0) if name in limits else stds[name] for name in stds}
    allowed = [name for name in sheet.values if name != "coherent_pulses"]
    if not std:
        raise place.error(f"needs at least one of the keys {', '.join(allowed)}")
    for name, value in std.items():
        at = place[LOSSES_KEY][name.rpartition(".")[2]] if "." in name else place[name]
        if name not in allowed:
            raise at.error(
                f"is not in the data sheet, allowed: {', '.join(allowed)}"
                + did_you_mean(name, set(allowed) - set(std))
            )
        (tolerance,) = sheet.tolerances({name: value})
        most = MAX_DIVISOR_STD * tolerance.value
        if tolerance.power < 0 and not tolerance.decibels and value > most:
            raise at.error(
                f"must be a number not less than 0 and not greater than {most:g}, 1/6 of the "
                f"parameter because c_r is divided by this parameter; got {value:g}"
            )
    return sheet.tolerances(std, limits)


# Checks of the radars against the poses.


def _refuse_collision(place: Place, geometry: Geometry, radar: Radar) -> None:
    distance = slant_range(geometry.aircraft, np.asarray(radar.state))
    nearest = int(np.argmin(distance))
    if distance[nearest] < MIN_RANGE:
        raise place.error(
            f"the aircraft is on top of {_called(radar)} at "
            f"{geometry.axis.name} {geometry.axis.at(nearest)}, "
            f"slant range {distance[nearest]:.2g} m; allowed is {MIN_RANGE:g} m or more"
        )


def _refuse_uncovered(place: Place, geometry: Geometry, radar: Radar) -> None:
    rcs = radar.model.rcs
    if not isinstance(rcs, TableRCS) or rcs.elevation is None:
        return
    body = body_vector(geometry.aircraft, np.asarray(radar.state))
    outside = np.flatnonzero(rcs.uncovered(body))
    if len(outside):
        x, y, z = body[outside[0]]
        raise place.error(
            f"at {geometry.axis.name} {geometry.axis.at(outside[0])} the aircraft sees "
            f"{_called(radar)} at elevation {np.arctan2(-z, np.hypot(x, y)) / DEG:.3g} deg, the "
            f"RCS table covers {rcs.elevation[0] / DEG:g} to {rcs.elevation[-1] / DEG:g} deg"
        )


def _called(radar: Radar) -> str:
    return f"radar {radar.name!r}" if radar.name else "the radar"
