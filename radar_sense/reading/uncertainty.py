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
from radar_sense.model.track import covariance_in_frame
from radar_sense.provenance import StatedCovariance
from radar_sense.reading.data_sheet import read_tolerances
from radar_sense.reading.geometry import Poses
from radar_sense.reading.yaml_reader import Entry
from radar_sense.states import FloatArray


@dataclass(frozen=True, eq=False)
class Levels:
    """The uncertainty of a radar: C_rr (4, 4) and the tolerances of c_r, by level."""

    covariance: Mapping[str, FloatArray] = field(default_factory=dict)
    tolerances: Mapping[str, tuple[Tolerance, ...]] = field(default_factory=dict)


def read_uncertainty(
    entry: Entry, poses: Poses, sheet: DataSheet | None, *, of_radar: bool
) -> tuple[StatedCovariance, float, Levels | None]:
    """Read C_aa, its correlation time [s], and the levels of a single radar.

    Args:
        entry: The mapping.
        poses: The poses, with C_aa if the route file has it.
        sheet: Data sheet of a single radar.
        of_radar: Whether the mapping has the levels of a single radar. Entries of several radars
        have
            their levels.
    """
    aircraft, radar = (key.name for key in keys.UNCERTAINTY if key is not keys.CORRELATION)
    if not of_radar and radar in entry.entries():
        raise entry.entries()[radar].error(
            "must be left out here: each of 'radars' has an 'uncertainty' of its own"
        )
    radars = [radar] if of_radar else []
    correlation = keys.CORRELATION
    if poses.covariance is None:
        entries = entry.mapping([aircraft, *radars], [correlation.name])
        stated = _read_covariance(entries[aircraft], keys.COV_AIRCRAFT)[0]
        made = stated
        if poses.origin is not None and poses.time_s is not None:
            try:
                made = covariance_in_frame(stated, poses.time_s, poses.aircraft, poses.origin)
            except InputError as error:
                raise entries[aircraft].error(str(error)) from error
        cov_aircraft = StatedCovariance(stated, made)
    else:
        entries = entry.mapping(radars, [aircraft, correlation.name])
        if aircraft in entries:
            raise entries[aircraft].error(
                "must be left out here, or the columns std_... and cov_... in the route file: "
                "both say how uncertain the aircraft is"
            )
        cov_aircraft = StatedCovariance(None, poses.covariance)
    correlation_s = correlation.default
    if correlation.name in entries:
        correlation_s = entries[correlation.name].value(correlation)
    levels = read_levels(entries[radar], sheet) if of_radar else None
    return cov_aircraft, correlation_s, levels


def read_levels(entry: Entry, sheet: DataSheet | None) -> Levels:
    """Read the uncertainty of a radar, level by level."""
    entries = entry.named(keys.LEVEL_NAME)
    if not entries:
        raise entry.error("needs at least one level of uncertainty")
    cov_radar: dict[str, FloatArray] = {}
    tolerances: dict[str, tuple[Tolerance, ...]] = {}
    for level, level_entry in entries.items():
        cov_radar[level], of_constant = _read_covariance(level_entry, keys.COV_RADAR, sheet)
        if of_constant:
            tolerances[level] = of_constant
    return Levels(cov_radar, tolerances)


def _read_covariance(
    entry: Entry, parts: Sequence[Key], sheet: DataSheet | None = None
) -> tuple[FloatArray, tuple[Tolerance, ...]]:
    """Read the covariance of a state, part by part or as a whole, and the tolerances of c_r."""
    names = [key.name for key in parts]
    whole = keys.COVARIANCE.name
    units = np.repeat([key.unit for key in parts], [key.size for key in parts])
    entries = entry.mapping([], [*names, whole])
    if whole in entries:
        if len(entries) > 1:
            raise entry.error(
                f"has 'covariance' beside {', '.join(names)}; allowed is one or other"
            )
        return _read_matrix(entries[whole], len(units)) * np.outer(units, units), ()
    entries = entry.mapping(names, [whole])
    total = np.zeros((len(units), len(units)))
    tolerances: tuple[Tolerance, ...] = ()
    start = 0
    for key in parts:
        some = slice(start, start + key.size)
        value = entries[key.name]
        if key.size == 1 and value.is_mapping():
            tolerances = _read_constant(value, sheet)
            assert sheet is not None
            std = sheet.constant * relative_std(tolerances)
            total[some, some] = covariance.from_std([std])
        else:
            total[some, some] = _read_part(value, key) * key.unit**2
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
