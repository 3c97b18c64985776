"""Blocks of a resolved scenario: from arrays in SI units to keys and numbers of a scenario file.

A number is the shortest decimal that reads back as the same SI value. The record of an array
without a file is the length and a digest, which cannot be read back.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from radar_sense import keys
from radar_sense.axis import Axis
from radar_sense.keys import Key, declared, declared_sections, in_unit, shortest
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.detectors import DETECTORS, Detector
from radar_sense.model.horizon import Horizon
from radar_sense.model.radar_constant import Tolerance, nest_losses, relative_std
from radar_sense.model.rcs import RCS, RCS_MODELS
from radar_sense.model.rcs_table import TableRCS
from radar_sense.provenance import (
    Orbit,
    Path,
    Provenance,
    RadarSource,
    StatedCovariance,
    TableFile,
)
from radar_sense.states import ATTITUDE, CONSTANT, POSITION, FloatArray

Block = dict[str, Any]


def radar_block(
    model: DetectionModel, state: FloatArray, source: RadarSource | None, scan_period: float | None
) -> Block:
    """Return the keys that a single radar and the radars of a network have.

    Args:
        model: P_fa, detector and attenuation.
        state: State of the radar (4,).
        source: Origin of the state, or None.
        scan_period: Time from one look to the next [s], or None.
    """
    block: Block = {}
    if source and source.place and np.array_equal(state[POSITION], source.state[POSITION]):
        block["position_geodetic"] = place_block(source.place)
    else:
        block["position_m"] = state[POSITION].tolist()
    sheet = _sheet(source, state)
    if sheet:
        block[sheet.kind] = nest_losses(sheet.values)
        if sheet.search_factor is not None:
            block[sheet.kind]["search_factor"] = sheet.search_factor
    else:
        block["constant"] = float(state[CONSTANT])
    block["p_fa"] = model.p_fa
    block["detector"] = detector_block(model.detector)
    if scan_period is not None:
        block["scan_period_s"] = scan_period
    if model.attenuation:
        block[keys.ATTENUATION.name] = in_unit(model.attenuation, keys.ATTENUATION.unit)
    return block


def limits_block(
    max_range: float, min_range: float, horizon: Horizon | None, earth: Horizon
) -> Block:
    """Return the keys of the limits of a radar; eclipsing is a minimum range."""
    block: Block = {}
    if math.isfinite(max_range):
        block[keys.MAX_RANGE.name] = in_unit(max_range, keys.MAX_RANGE.unit)
    if min_range:
        block[keys.MIN_RANGE.name] = in_unit(min_range, keys.MIN_RANGE.unit)
    if horizon is None or horizon == earth:
        block["horizon"] = horizon is not None
    else:
        block["horizon"] = dataclasses.asdict(horizon)
    return block


def level_block(
    covariance: FloatArray,
    tolerances: Sequence[Tolerance],
    source: RadarSource | None,
    state: FloatArray,
    level: str,
    attenuation_std: float,
) -> Block:
    """Return the uncertainty of one radar at one level.

    Tolerances need the data sheet of the file. Without a data sheet the tolerances are under
    `constant_tolerances`, a key that no scenario file has. A standard deviation alone would
    describe another scenario.
    """
    stated = source.covariances.get(level) if source else None
    block = covariance_block(as_stated(covariance, stated), keys.COV_RADAR)
    if attenuation_std:
        block[keys.ATTENUATION_STD.name] = in_unit(attenuation_std, keys.ATTENUATION_STD.unit)
    if not tolerances:
        return block
    by_key = nest_losses({tolerance.key: tolerance.std for tolerance in tolerances})
    sheet = _sheet(source, state)
    std = float(state[CONSTANT]) * relative_std(tolerances)
    if sheet and "constant" in block and covariance[CONSTANT, CONSTANT] == std * std:
        return {**block, "constant": by_key}
    return {**block, "constant_tolerances": by_key}


def rcs_block(rcs: RCS, source: TableFile | None) -> Block:
    """Return the RCS model with all keys."""
    if isinstance(rcs, TableRCS):
        block: Block = {"model": "table"}
        if source and source.table is rcs:
            block |= {"file": source.file, "mirror": source.mirror, "sha256": source.sha256}
        else:
            optional = (rcs.azimuth, rcs.rcs, rcs.elevation, rcs.std_db)
            arrays = [array for array in optional if array is not None]
            block |= {"nodes": rcs.rcs.size, "sha256": hash_arrays(*arrays)}
        if rcs.envelope is not None:
            block["envelope_deg"] = in_unit(rcs.envelope, keys.ENVELOPE_WIDTH.unit)
        return block
    names = [name for name, cls in RCS_MODELS.items() if type(rcs) is cls]
    if not names:
        return {"model": repr(rcs)}
    return {"model": names[0], **instance_block(rcs)}


def detector_block(detector: Detector) -> str | Block:
    """Return the name of a detector, or a mapping unless all keys are at their defaults."""
    names = [name for name, cls in DETECTORS.items() if type(detector) is cls]
    if not names:
        return repr(detector)
    block = instance_block(detector)
    defaults = {key.name: key.default for key in declared(type(detector))}
    return names[0] if block == defaults else {"model": names[0], **block}


def instance_block(instance: Any) -> Block:
    """Return the fields that a dataclass declares in `limits`, by key."""
    if not dataclasses.is_dataclass(instance):
        return {}
    attributes = {
        f.metadata["key"]: f.name for f in dataclasses.fields(instance) if "key" in f.metadata
    }
    block: Block = {}
    for key in declared(type(instance)):
        value = getattr(instance, attributes[key.name])
        whole = key.limit is not None and key.limit.whole
        block[key.name] = int(value) if whole else float(value)
    for name, field in declared_sections(type(instance)).items():
        value = getattr(instance, field.name)
        if value is not None:
            kinds = field.metadata["kinds"]
            type_of_section = {} if isinstance(kinds, type) else {"type": _name_of(value, kinds)}
            block[name] = {**type_of_section, **instance_block(value)}
    return block


def _name_of(value: Any, kinds: Mapping[str, type]) -> str:
    return next(name for name, cls in kinds.items() if type(value) is cls)


def attitude_block(aircraft: FloatArray, provenance: Provenance) -> Block:
    """Return the attitude on an orbit; {} for other poses."""
    if not (isinstance(provenance.geometry, Orbit) and is_as_made(aircraft, provenance)):
        return {}
    unit = keys.ATTITUDE.unit
    return {"attitude_deg": [in_unit(float(angle), unit) for angle in aircraft[0, ATTITUDE]]}


def geometry_block(aircraft: FloatArray, axis: Axis, provenance: Provenance) -> Block:
    """Return the orbit or the path of the poses, or their number and digest."""
    geometry = provenance.geometry
    if geometry is None or not is_as_made(aircraft, provenance):
        return {
            "type": "states",
            "axis": axis.key,
            "poses": len(aircraft),
            "sha256": hash_arrays(aircraft),
        }
    if isinstance(geometry, Orbit):
        return {
            "type": "orbit",
            "range_km": in_unit(geometry.radius, keys.RANGE.unit),
            "down_km": in_unit(geometry.down, keys.DOWN.unit),
            "azimuth_deg": dict(zip(("start", "stop", "step"), geometry.sweep, strict=True)),
            "azimuth_from": geometry.azimuth_from,
        }
    return _path_block(geometry, axis)


def _path_block(path: Path, axis: Axis) -> Block:
    block: Block = {"type": "path", "file": path.file, "axis": axis.name}
    if path.origin is not None:
        block["origin"] = place_block(path.origin)
    if path.step_s is not None:
        block["interpolate"] = {"step_s": path.step_s, "method": path.method}
    if path.max_gap_s is not None:
        block["max_gap_s"] = path.max_gap_s
    conventions = dataclasses.asdict(path.conventions)
    block |= {key: value for key, value in conventions.items() if value is not None}
    return {**block, "sha256": path.sha256}


def place_block(place: tuple[float, float, float]) -> Block:
    """Return a place in latitude, longitude and height."""
    pairs = zip(keys.PLACE, place, strict=True)
    return {key.name: in_unit(value, key.unit) for key, value in pairs}


def cov_aircraft_block(
    covariance: FloatArray, stated: StatedCovariance | None, rcs_db: float
) -> Block:
    """Return the keys of C_aa, unless the route file has C_aa, and of an uncertain RCS."""
    matrix = as_stated(covariance, stated)
    block: Block = {}
    if matrix is not None and matrix.ndim == 3:
        block = {"poses": len(matrix), "sha256": hash_arrays(matrix)}
    elif matrix is not None:
        block = covariance_block(matrix, keys.COV_AIRCRAFT)
    if rcs_db:
        block[keys.RCS_DB.name] = float(rcs_db)
    return {"aircraft": block} if block else {}


def correlation_block(correlation_s: float, *, has_times: bool) -> Block:
    """Return the correlation time of the pose errors; {} for poses without times."""
    if not (has_times or correlation_s):
        return {}
    # JSON has no number for infinity.
    return {keys.CORRELATION.name: correlation_s if math.isfinite(correlation_s) else "inf"}


def covariance_block(covariance: FloatArray, parts: Sequence[Key]) -> Block:
    """Return a covariance (n, n) by parts, or as a whole if the parts are correlated."""
    block: Block = {}
    between_parts = covariance.copy()
    start = 0
    for key in parts:
        part = slice(start, start + key.size)
        block[key.name] = _part(covariance[part, part], key.unit)
        between_parts[part, part] = 0.0
        start += key.size
    if not between_parts.any() and None not in block.values():
        return block
    units = np.repeat([key.unit for key in parts], [key.size for key in parts])
    products = np.outer(units, units).tolist()
    return {
        "covariance": [
            [in_unit(value, unit) for value, unit in zip(*row, strict=True)]
            for row in zip(covariance.tolist(), products, strict=True)
        ]
    }


def _part(matrix: FloatArray, unit: float) -> Any:
    """Return one standard deviation, one for each component, or a matrix; None if inexact."""
    square = unit**2
    if not (matrix - np.diag(np.diagonal(matrix))).any():
        std = [
            shortest(variance, math.sqrt(variance) / unit, lambda x: x * x * square)
            for variance in np.diagonal(matrix).tolist()
        ]
        if None not in std:
            return std[0] if len(set(std)) == 1 else std
    if len(matrix) == 1:
        return None
    rows = [
        [shortest(value, value / square, lambda x: x * square) for value in row]
        for row in matrix.tolist()
    ]
    return None if any(None in row for row in rows) else rows


def as_stated(covariance: FloatArray, stated: StatedCovariance | None) -> Any:
    """Return the covariance as the file states it; unchanged if the file has another covariance."""
    if stated is None or not np.array_equal(covariance, stated.made):
        return covariance
    return stated.stated


def hash_arrays(*arrays: FloatArray) -> str:
    """Return the SHA-256 of numbers as little-endian doubles."""
    return hashlib.sha256(
        b"".join(np.asarray(a, dtype="<f8").tobytes() for a in arrays)
    ).hexdigest()


def is_as_made(aircraft: FloatArray, provenance: Provenance) -> bool:
    """Return whether the states are the states made from the orbit or the path."""
    made = provenance.aircraft
    return made is not None and (aircraft is made or np.array_equal(aircraft, made))


def _sheet(source: RadarSource | None, state: FloatArray) -> Any:
    sheet = source.data_sheet if source else None
    return sheet if sheet and sheet.constant == state[CONSTANT] else None
