"""The covariances of a scenario file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from radar_sense import covariance, keys
from radar_sense.errors import InputError
from radar_sense.keys import Key
from radar_sense.limits import NOT_NEGATIVE
from radar_sense.model.radar_constant import DataSheet, Tolerance, relative_std
from radar_sense.model.radar_equation import RADARS
from radar_sense.model.rcs import RCS
from radar_sense.model.track import covariance_in_frame
from radar_sense.provenance import StatedCovariance
from radar_sense.reading.data_sheet import read_tolerances
from radar_sense.reading.geometry import Poses
from radar_sense.reading.yaml_reader import Entry, Section
from radar_sense.states import FloatArray


@dataclass(frozen=True, eq=False)
class Levels:
    """The uncertainty of a radar: C_rr (4, 4), tolerances of c_r, and σ of α [dB/m], by level."""

    covariance: Mapping[str, FloatArray] = field(default_factory=dict)
    tolerances: Mapping[str, tuple[Tolerance, ...]] = field(default_factory=dict)
    attenuation: Mapping[str, float] = field(default_factory=dict)


def read_uncertainty(
    entry: Entry,
    poses: Poses,
    sheet: DataSheet | None,
    *,
    of_radar: bool,
    rcs: RCS,
    attenuation: float,
) -> tuple[StatedCovariance, float, float, Levels | None]:
    """Read C_aa, its correlation time [s], σ of the RCS [dB], and the levels of a single radar.

    Args:
        entry: The mapping.
        poses: The poses, with C_aa if the route file has it.
        sheet: Data sheet of a single radar.
        of_radar: Whether the mapping has the levels of a single radar. With several radars, each
            entry of `radars` has the levels.
        rcs: The RCS. With a `spread` the RCS has its standard deviation already.
        attenuation: Attenuation of a single radar [dB/m].
    """
    aircraft, radar = (key.name for key in keys.UNCERTAINTY if key is not keys.CORRELATION)
    if not of_radar and radar in entry.entries():
        raise entry.entries()[radar].error(
            "must be left out here: give 'uncertainty' of each radar in 'radars'"
        )
    radars = [radar] if of_radar else []
    correlation = keys.CORRELATION
    if poses.covariance is None:
        entries = entry.mapping([aircraft, *radars], [correlation.name])
        stated = _read_covariance(entries[aircraft], keys.COV_AIRCRAFT, besides=[keys.RCS_DB.name])[
            0
        ]
        made = stated
        if poses.origin is not None and poses.time_s is not None:
            try:
                made = covariance_in_frame(stated, poses.time_s, poses.aircraft, poses.origin)
            except InputError as error:
                raise entries[aircraft].error(str(error)) from error
        cov_aircraft = StatedCovariance(stated, made)
    else:
        entries = entry.mapping(radars, [aircraft, correlation.name])
        present = entries[aircraft].entries() if aircraft in entries else {}
        if aircraft in entries and list(present) != [keys.RCS_DB.name]:
            raise entries[aircraft].error(
                "must be left out here, or the columns std_... and cov_... in the route file: "
                "both state the uncertainty of the aircraft"
            )
        cov_aircraft = StatedCovariance(None, poses.covariance)
    rcs_db = _read_rcs_db(entries[aircraft], rcs) if aircraft in entries else 0.0
    correlation_s = correlation.default
    if correlation.name in entries:
        correlation_s = entries[correlation.name].value(correlation)
    levels = read_levels(entries[radar], sheet, attenuation) if of_radar else None
    return cov_aircraft, correlation_s, rcs_db, levels


def _read_rcs_db(entry: Entry, rcs: RCS) -> float:
    """Read the standard deviation of the RCS [dB]."""
    present = entry.entries()
    if keys.RCS_DB.name not in present:
        return float(keys.RCS_DB.default)
    value = present[keys.RCS_DB.name]
    if getattr(rcs, "spread", None) is not None:
        raise value.error(
            "stands beside the column std_db of the RCS table; give only one of the two: both are "
            "the uncertainty of the RCS"
        )
    return float(value.value(keys.RCS_DB))


def read_levels(entry: Entry, sheet: DataSheet | None, attenuation: float) -> Levels:
    """Read the uncertainty of a radar, level by level.

    Args:
        entry: The mapping.
        sheet: Data sheet of the radar.
        attenuation: Attenuation [dB/m].
    """
    entries = entry.named(keys.LEVEL_NAME)
    if not entries:
        raise entry.error("needs at least one level of uncertainty")
    cov_radar: dict[str, FloatArray] = {}
    tolerances: dict[str, tuple[Tolerance, ...]] = {}
    attenuation_std: dict[str, float] = {}
    for level, level_entry in entries.items():
        cov_radar[level], of_constant = _read_covariance(
            level_entry, keys.COV_RADAR, sheet, besides=[keys.ATTENUATION_STD.name]
        )
        if of_constant:
            tolerances[level] = of_constant
        std = _read_attenuation_std(level_entry, attenuation)
        if std:
            attenuation_std[level] = std
    return Levels(cov_radar, tolerances, attenuation_std)


def _read_attenuation_std(entry: Entry, attenuation: float) -> float:
    """Read the standard deviation of an attenuation [dB/m]."""
    key = keys.ATTENUATION_STD
    section = Section(entry.entries())
    std: float = section.si(key)
    if std > attenuation:
        raise section[key].error(
            f"must be at most the {key.name} of the radar, {attenuation / key.unit:g}, "
            f"got {std / key.unit:g}"
        )
    return std


def _read_covariance(
    entry: Entry,
    parts: Sequence[Key],
    sheet: DataSheet | None = None,
    besides: Sequence[str] = (),
) -> tuple[FloatArray, tuple[Tolerance, ...]]:
    """Read the covariance of a state, part by part or as a whole, and the tolerances of c_r.

    Args:
        entry: The mapping.
        parts: Keys of the parts.
        sheet: Data sheet of a radar.
        besides: Further optional keys, which the caller reads.
    """
    names = [key.name for key in parts]
    whole = keys.COVARIANCE.name
    units = np.repeat([key.unit for key in parts], [key.size for key in parts])
    entries = entry.mapping([], [*names, whole, *besides])
    if whole in entries:
        if any(name in entries for name in names):
            raise entry.error(
                f"has 'covariance' beside {', '.join(names)}; give only one of the two"
            )
        return _read_matrix(entries[whole], len(units)) * np.outer(units, units), ()
    entries = entry.mapping(names, [whole, *besides])
    total = np.zeros((len(units), len(units)))
    tolerances: tuple[Tolerance, ...] = ()
    start = 0
    for key in parts:
        block = slice(start, start + key.size)
        value = entries[key.name]
        if key.size == 1 and value.is_mapping():
            tolerances = _read_constant(value, sheet)
            assert sheet is not None
            std = sheet.constant * relative_std(tolerances)
            total[block, block] = covariance.from_std([std])
        else:
            total[block, block] = _read_part(value, key) * key.unit**2
        start += key.size
    return total, tolerances


def _read_constant(entry: Entry, sheet: DataSheet | None) -> tuple[Tolerance, ...]:
    if sheet is None:
        raise entry.error(
            f"must be {NOT_NEGATIVE}, got a mapping; standard deviations by parameter need "
            f"{' or '.join(f'radar.{kind}' for kind in RADARS)} in place of radar.constant"
        )
    return read_tolerances(entry, sheet)


def _read_part(entry: Entry, key: Key) -> FloatArray:
    """Read a standard deviation for all components, one for each, or a covariance matrix."""
    limit = key.limit or NOT_NEGATIVE
    if key.size > 1 and entry.is_matrix():
        return _read_matrix(entry, key.size)
    if key.size > 1 and entry.is_list():
        return covariance.from_std(entry.numbers(key.size, limit))
    return covariance.from_std([entry.number(limit)] * key.size)


def _read_matrix(entry: Entry, size: int) -> FloatArray:
    matrix = np.array(entry.matrix(size))
    problem = covariance.problem(matrix)
    if problem:
        raise entry.error(problem)
    symmetric: FloatArray = (matrix + matrix.T) / 2
    return symmetric
