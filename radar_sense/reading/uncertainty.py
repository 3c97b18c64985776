"""The covariances of a scenario file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from radar_sense import covariance
from radar_sense.errors import ScenarioError
from radar_sense.limits import DEG, NOT_NEGATIVE
from radar_sense.model.radar_constant import Part, relative_std
from radar_sense.model.radar_equation import RADARS
from radar_sense.model.trajectory import in_frame
from radar_sense.reading.data_sheet import Makeup
from radar_sense.reading.geometry import _Poses
from radar_sense.reading.yaml_reader import Entry
from radar_sense.states import FloatArray

_CORRELATION = "aircraft_correlation_s"
#: Keys of an uncertainty block: name, number of components, and its unit in SI.
_AIRCRAFT_PARTS = (("position_m", 3, 1.0), ("attitude_deg", 3, DEG))
_RADAR_PARTS = (("position_m", 3, 1.0), ("constant", 1, 1.0))


@dataclass(frozen=True, eq=False)
class _Levels:
    """How uncertain a radar is at each level: C_rr (4, 4), and parts of c_r where there are any."""

    covariance: Mapping[str, FloatArray] = field(default_factory=dict)
    parts: Mapping[str, tuple[Part, ...]] = field(default_factory=dict)


def _uncertainty(
    entry: Entry, poses: _Poses, makeup: Makeup | None, *, of_radar: bool
) -> tuple[FloatArray, _Levels | None, dict[str, Any]]:
    """Read how uncertain the aircraft is, and the radar unless each of several says so itself."""
    document: dict[str, Any] = {}
    if not of_radar and "radar" in entry.entries():
        raise entry.entries()["radar"].error(
            "must be left out here: each of 'radars' has an 'uncertainty' of its own"
        )
    radar = ["radar"] if of_radar else []
    if poses.covariance is None:
        found = entry.mapping(["aircraft", *radar], [_CORRELATION])
        cov_aircraft, document["aircraft"] = _covariance(found["aircraft"], _AIRCRAFT_PARTS)
        if poses.origin is not None and poses.time_s is not None:
            try:
                cov_aircraft = in_frame(cov_aircraft, poses.time_s, poses.aircraft, poses.origin)
            except ScenarioError as error:
                raise found["aircraft"].error(str(error)) from error
    else:
        found = entry.mapping(radar, ["aircraft", _CORRELATION])
        cov_aircraft = poses.covariance
        if "aircraft" in found:
            raise found["aircraft"].error(
                "must be left out here, or the columns std_... and cov_... in the route file: "
                "both say how uncertain the aircraft is"
            )
    if _CORRELATION in found:
        correlation = found[_CORRELATION].number_or_infinity(NOT_NEGATIVE)
        # a word for infinity, as JSON has no number for it
        document[_CORRELATION] = correlation if math.isfinite(correlation) else "inf"
    elif poses.time_s is not None:
        document[_CORRELATION] = 0.0  # independent errors at every pose, as Monte Carlo draws them
    if not of_radar:
        return cov_aircraft, None, document
    levels, document["radar"] = _levels(found["radar"], makeup)
    return cov_aircraft, levels, document


def _levels(entry: Entry, makeup: Makeup | None) -> tuple[_Levels, dict[str, Any]]:
    """Read how uncertain a radar is, level by level."""
    levels = entry.named(
        "[A-Za-z0-9][A-Za-z0-9_-]{0,39}",
        "the name of a level, up to 40 letters A to Z, digits, '_' or '-'",
    )
    if not levels:
        raise entry.error("needs at least one level of uncertainty")
    cov_radar: dict[str, FloatArray] = {}
    parts: dict[str, tuple[Part, ...]] = {}
    document: dict[str, Any] = {}
    for level, level_entry in levels.items():
        cov_radar[level], document[level] = _covariance(level_entry, _RADAR_PARTS, makeup)
        tolerances = document[level].get("constant")
        if makeup and isinstance(tolerances, dict):
            parts[level] = makeup.parts(tolerances)
    return _Levels(cov_radar, parts), document


def _covariance(
    entry: Entry, parts: Sequence[tuple[str, int, float]], makeup: Makeup | None = None
) -> tuple[FloatArray, dict[str, Any]]:
    """Read one state's covariance: a key for each part, or `covariance` for all of it at once."""
    keys = [key for key, _, _ in parts]
    units = np.repeat([unit for _, _, unit in parts], [size for _, size, _ in parts])
    found = entry.mapping([], [*keys, "covariance"])
    if "covariance" in found:
        if len(found) > 1:
            raise entry.error(f"has 'covariance' beside {', '.join(keys)}; allowed is one or other")
        matrix, document = _matrix(found["covariance"], len(units))
        return matrix * np.outer(units, units), {"covariance": document}
    found = entry.mapping(keys, ["covariance"])
    total = np.zeros((len(units), len(units)))
    documents: dict[str, Any] = {}
    start = 0
    for key, size, unit in parts:
        if key == "constant" and found[key].is_mapping():
            part, documents[key] = _tolerances(found[key], makeup)
        else:
            part, documents[key] = _part(found[key], size)
        total[start : start + size, start : start + size] = part * unit**2
        start += size
    return total, documents


def _tolerances(entry: Entry, makeup: Makeup | None) -> tuple[FloatArray, dict[str, float]]:
    """Read standard deviations of what c_r is made of; they give its variance to first order."""
    if makeup is None:
        raise entry.error(
            f"must be {NOT_NEGATIVE}, got a mapping; standard deviations by parameter need "
            f"{' or '.join(f'radar.{kind}' for kind in RADARS)} in place of radar.constant"
        )
    tolerances = makeup.read_tolerances(entry)
    std = makeup.constant * relative_std(makeup.parts(tolerances))
    return covariance.from_std([std]), tolerances


def _part(entry: Entry, size: int) -> tuple[FloatArray, Any]:
    """Read a standard deviation for all components, one for each, or a covariance matrix."""
    if size > 1 and entry.is_matrix():
        return _matrix(entry, size)
    if size > 1 and entry.is_list():
        std = entry.numbers(size, NOT_NEGATIVE)
        return covariance.from_std(std), std
    number = entry.number(NOT_NEGATIVE)
    return covariance.from_std([number] * size), number


def _matrix(entry: Entry, size: int) -> tuple[FloatArray, list[list[float]]]:
    rows = entry.matrix(size)
    matrix = np.array(rows)
    problem = covariance.problem(matrix)
    if problem:
        raise entry.error(problem)
    return (matrix + matrix.T) / 2, rows
