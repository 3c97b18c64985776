"""From the sections of radars to `Radar`: data sheets, levels, types, and what they depend on.

Everywhere `stated` is a section.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.constants import speed_of_light

from radar_sense import covariance
from radar_sense.errors import InputError, did_you_mean
from radar_sense.flight import Geometry
from radar_sense.limits import DEG, LARGEST, NOT_NEGATIVE, SMALLEST
from radar_sense.model.antenna import ElevationGain, Mask
from radar_sense.model.attenuation import Attenuation
from radar_sense.model.detection_model import DetectionModel, Factor
from radar_sense.model.detectors import Detector, PulseDetector
from radar_sense.model.geodesy import ned_from_geodetic, turn_to_origin
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
from radar_sense.scenario_file import sections
from radar_sense.scenario_file.conversion import KM, PER_KM, covariance_of, on_earth, read_named
from radar_sense.scenario_file.curve_file import read_gain, read_mask
from radar_sense.scenario_file.declare import keys_of
from radar_sense.source_names import name_problem
from radar_sense.states import POSITION, FloatArray


def radars_of(file: sections.File, rcs: Mapping[str, RCS], geometry: Geometry) -> tuple[Radar, ...]:
    """Return the radars."""
    levels, place = file.uncertainty.radar, file.uncertainty.place
    if file.radar is not None:
        if levels is None:
            raise place.error("missing key 'radar', required with 'radar'")
        return (_radar(file.radar, levels, file, rcs, geometry),)
    if levels is not None:
        raise place["radar"].error(
            "must be left out here: give 'uncertainty' of each radar in 'radars'"
        )
    stated = file.radars or ()
    for i, radar in enumerate(stated):
        names, at = [r.name for r in stated[: i + 1]], radar.place["name"]
        if radar.name in names[:-1]:
            raise at.error(f"must be a name that no other radar has, got {radar.name!r}")
        if problem := name_problem(names, [*rcs], [*(file.types or {})]):
            raise at.error(problem)
        _refuse_other_levels(stated[0], radar)
    return tuple(_radar(radar, radar.uncertainty, file, rcs, geometry) for radar in stated)


def refuse_unused_types(file: sections.File) -> None:
    """Raise InputError if a type is of no radar: its errors would be left out."""
    used = [radar.type for radar in (file.radar, *(file.radars or ())) if radar is not None]
    for name in file.types or {}:
        if name not in used:
            raise file.place["types"][name].error(
                f"is the type of no radar; give radars 'type: {name}', or leave it out"
            )


def _refuse_other_levels(first: sections.NamedRadar, radar: sections.NamedRadar) -> None:
    """Raise InputError unless a radar has the levels of the first."""
    expected, levels = list(first.uncertainty), radar.uncertainty
    for level, stated in levels.items():
        if level not in expected:
            raise stated.place.error(
                f"must be a level that radar {first.name!r} has too: {', '.join(expected)}"
                + did_you_mean(level, set(expected) - set(levels))
            )
    missing = [level for level in expected if level not in levels]
    if missing:
        raise radar.place["uncertainty"].error(
            f"missing level '{missing[0]}'; radar {radar.name!r} must have the levels that radar "
            f"{first.name!r} has: {', '.join(expected)}"
        )


def _radar(
    stated: sections.Radar,
    levels: sections.Levels,
    file: sections.File,
    rcs: Mapping[str, RCS],
    geometry: Geometry,
) -> Radar:
    """Return a radar. The file has what radars of a type share, and the poses have the frame."""
    sheet = _data_sheet(stated)
    _refuse_detector(stated)
    band = _band(stated, rcs)
    shared = _shared(file, stated, [*levels])
    position, axes = _position(stated, geometry)
    factors = tuple(_factors(stated, axes))
    model = DetectionModel(rcs[band], float(stated.p_fa), stated.detector, factors)
    constant = stated.constant if sheet is None else sheet.constant
    period = stated.scan_period_s
    if period is None and sheet is not None:
        period = sheet.scan_time
    return Radar(
        model,
        name=getattr(stated, "name", ""),
        state=np.array([*position, constant], dtype=float),
        levels={
            name: _level(level, stated, sheet, axes, shared.get(name))
            for name, level in levels.items()
        },
        max_range=math.inf if stated.max_range_km is None else stated.max_range_km * KM,
        min_range=_min_range(stated, sheet),
        horizon=geometry.horizon if stated.horizon else None,
        scan_period=None if period is None else float(period),
        sheet=sheet,
        band=band,
        mask=None
        if stated.mask is None
        else Mask(*read_named(stated.mask, "a file of a mask", read_mask), axes=axes),
    )


def _factors(stated: sections.Radar, axes: FloatArray) -> Iterator[Factor]:
    """Yield the factors of the signal.

    The axes (3, 3) are north, east and down at the radar, in the frame of the poses.
    """
    if stated.attenuation_db_per_km:
        yield Attenuation(stated.attenuation_db_per_km * PER_KM)
    if stated.elevation_gain is not None:
        curve = read_named(stated.elevation_gain, "a file of gains", read_gain)
        yield ElevationGain(*curve, stated.tilt_deg * DEG, axes=axes)
    elif stated.tilt_deg:
        raise stated.place["tilt_deg"].error("needs elevation_gain, the gain that is tilted")


def _band(stated: sections.Radar, rcs: Mapping[str, RCS]) -> str:
    """Return the band of a radar, "" where all radars have one RCS."""
    place = stated.place
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


def _position(stated: sections.Radar, geometry: Geometry) -> tuple[FloatArray, FloatArray]:
    """Return the place (3,) [m], and the axes (3, 3) in which the file has its uncertainty.

    The axes are north, east and down at a radar on the earth, else those of the poses.
    """
    if stated.position_geodetic is None:
        return np.array(stated.position_m), np.eye(3)
    origin = geometry.origin
    if origin is None:
        raise stated.position_geodetic.place.error(
            "needs a path whose route is in latitude and longitude, with its geometry.origin; "
            "here give position_m"
        )
    geodetic = on_earth(stated.position_geodetic)
    return ned_from_geodetic(geodetic, origin), turn_to_origin(geodetic, origin)


def _refuse_detector(stated: sections.Radar) -> None:
    detector: Detector = stated.detector
    place = stated.place["detector"]
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


def _min_range(stated: sections.Radar, sheet: DataSheet | None) -> float:
    """Return the slant range [m] within which a radar detects nothing."""
    min_range, key = stated.min_range_km * KM, "min_range_km"
    if stated.eclipsing:
        if sheet is None or "pulse_width_us" not in sheet.values:
            raise stated.place["eclipsing"].error(
                "needs the length of the pulse, pulse_width_us of 'tracking'; here give "
                "min_range_km"
            )
        eclipsed = 0.5 * speed_of_light * sheet.values["pulse_width_us"] * 1e-6
        if eclipsed > min_range:
            min_range, key = eclipsed, "eclipsing"
    if stated.max_range_km is not None and min_range >= stated.max_range_km * KM:
        raise stated.place[key].error(
            f"hides the target within {min_range / KM:g} km, must be less than max_range_km, "
            f"{stated.max_range_km:g} km"
        )
    return min_range


def _level(
    stated: sections.RadarUncertainty,
    radar: sections.Radar,
    sheet: DataSheet | None,
    axes: FloatArray,
    shared: Any,
) -> Level:
    """Return the uncertainty of a radar at one level, in the frame of the poses.

    The axes are those of `_position`. `shared` are the `Tolerances` that radars of the type share.
    """
    place, tolerances = stated.place, tuple[Tolerance, ...]()
    if isinstance(stated.constant, sections.Tolerances):
        tolerances = _tolerances(stated.constant, sheet)
    if shared is not None:
        if not tolerances and (stated.covariance is not None or stated.constant):
            raise (place if stated.constant is None else place["constant"]).error(
                "must have standard deviations by parameter, or constant: 0, as the radar has a "
                f"type: the errors of type {radar.type!r} are of parameters too"
            )
        both = _tolerances(shared, sheet)
        if twice := {t.key for t in tolerances} & {t.key for t in both}:
            raise shared.place.error(
                f"{min(twice)} stands at a radar of this type too; give only one of the two"
            )
        tolerances += tuple(dataclasses.replace(t, shared=radar.type or "") for t in both)
    std = {}
    if tolerances:
        assert sheet is not None
        std = {"constant": sheet.constant * relative_std(tolerances)}
    matrix = covariance_of(stated, {"position_m": (3, 1.0), "constant": (1, 1.0)}, **std)
    frame = np.eye(len(matrix))
    frame[POSITION, POSITION] = axes
    matrix = frame @ matrix @ frame.T
    matrix = covariance.without_rounding(0.5 * (matrix + matrix.T))
    return Level(matrix, tolerances, _errors(stated, radar))


def _errors(stated: sections.RadarUncertainty, radar: sections.Radar) -> dict[str, float]:
    """Return the standard deviations of the errors of factors of the signal, by parameter."""
    place, errors = stated.place, {}
    if std := stated.attenuation_db_per_km:
        if std > radar.attenuation_db_per_km:
            raise place["attenuation_db_per_km"].error(
                "must be at most the attenuation_db_per_km of the radar, "
                f"{radar.attenuation_db_per_km:g}, got {std:g}"
            )
        errors["attenuation"] = std / radar.attenuation_db_per_km
    if stated.tilt_deg:
        if radar.elevation_gain is None:
            raise place["tilt_deg"].error(
                "needs elevation_gain of the radar, the gain that is tilted"
            )
        errors["tilt"] = stated.tilt_deg * DEG
    return errors


def _shared(file: sections.File, radar: sections.Radar, levels: Sequence[str]) -> Mapping[str, Any]:
    """Return what a radar shares with others of its type by level; {} without a type."""
    types = file.types or {}
    if radar.type is None:
        return {}
    if radar.type not in types:
        known = ", ".join(types) or "none is there"
        raise radar.place["type"].error(
            f"must be one of types ({known}), got {radar.type!r}" + did_you_mean(radar.type, types)
        )
    if types[radar.type].keys() != {*levels}:
        at = file.place["types"][radar.type]
        raise at.error(f"must have the levels of its radars: {', '.join(levels)}")
    return types[radar.type]


# Data sheets.


def _data_sheet(stated: sections.Radar) -> DataSheet | None:
    """Return the data sheet of a radar, or None for a constant."""
    kind = next((kind for kind in RADARS if getattr(stated, kind) is not None), None)
    if kind is None:
        return None
    sheet = getattr(stated, kind)
    losses: Mapping[str, float] = getattr(sheet, LOSSES_KEY) or {}
    given = _given(sheet)
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
            raise sheet.place[LOSSES_KEY][name].error(
                f"must have another name, as {column!r} is a key of the radar"
            )
    constant = RADARS[kind](**arguments).constant()
    if not SMALLEST <= constant <= LARGEST:
        raise sheet.place.error(
            f"makes the radar constant {constant:g} J m^2/K, allowed is {SMALLEST:g} to {LARGEST:g}"
        )
    return DataSheet(kind, constant, given, arguments.get("scan_time"))


def _given(section: Any) -> dict[str, Any]:
    """Return the parameters of a data sheet that a section has, the losses by `loss_key`."""
    values = {k.name: getattr(section, k.name) for k in keys_of(type(section))}
    losses = values.pop(LOSSES_KEY) or {}
    given = {name: value for name, value in values.items() if value is not None}
    return given | {loss_key(name): loss for name, loss in losses.items()}


def _tolerances(stated: Any, sheet: DataSheet | None) -> tuple[Tolerance, ...]:
    """Return the tolerances of parameters of a data sheet."""
    place = stated.place
    if sheet is None:
        raise place.error(
            f"must be {NOT_NEGATIVE}, got a mapping; standard deviations by parameter need "
            f"{' or '.join(f'radar.{kind}' for kind in RADARS)} in place of radar.constant"
        )
    std = _given(stated)
    limits = {n: v.half_width for n, v in std.items() if isinstance(v, sections.HalfWidth)}
    std |= {name: limit / math.sqrt(3.0) for name, limit in limits.items()}  # JCGM 101:2008, 6.4.2
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
        if not tolerance.decibels and limits.get(name, 0.0) > tolerance.value:
            raise at["half_width"].error(
                f"must be at most {tolerance.value:g}, the parameter, which is not negative; "
                f"got {limits[name]:g}"
            )
        most = MAX_DIVISOR_STD * tolerance.value
        if tolerance.power < 0 and not tolerance.decibels and value > most:
            raise at.error(
                f"must be a number not less than 0 and not greater than {most:g}, 1/6 of the "
                f"parameter because c_r is divided by this parameter; got {value:g}"
            )
    return sheet.tolerances(std, limits)
