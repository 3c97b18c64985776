"""The radars of a scenario file."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from radar_sense import covariance
from radar_sense.errors import did_you_mean
from radar_sense.limits import POSITIVE, PROBABILITY
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.detectors import DETECTORS, Detector
from radar_sense.model.geodesy import ned_from_geodetic, turn_to_origin
from radar_sense.model.network import NetworkModel, Station, name_problem
from radar_sense.model.radar_equation import RADARS
from radar_sense.reading.data_sheet import Makeup, read_makeup
from radar_sense.reading.geometry import _Poses
from radar_sense.reading.trajectory import read_geodetic
from radar_sense.reading.uncertainty import _Levels, _levels
from radar_sense.reading.yaml_reader import Entry
from radar_sense.states import POSITION, RADAR, FloatArray

MAX_RADARS = 64
_GEODETIC = "position_geodetic"


@dataclass(frozen=True, eq=False)
class _Geodetic:
    """A place in latitude, longitude [rad] and height [m], and where the file says it."""

    place: tuple[float, float, float]
    entry: Entry


@dataclass(frozen=True, eq=False)
class _Radar:
    """What a scenario says of a radar; name, limits and levels are for one of `radars` only.

    Where `geodetic` says its place, `state` has it once it is `_placed`.
    """

    state: FloatArray
    makeup: Makeup | None
    p_fa: float
    detector: Detector
    name: str = ""
    max_range: float = math.inf
    horizon: bool = False
    scan_period: float | None = None
    levels: _Levels = field(default_factory=_Levels)
    geodetic: _Geodetic | None = None

    @property
    def called(self) -> str:
        """What to call it in an error."""
        return f"radar {self.name!r}" if self.name else "the radar"


def _radar(
    entry: Entry, required: Sequence[str] = (), optional: Sequence[str] = ()
) -> tuple[_Radar, dict[str, Any]]:
    """Read what is said of any radar; other keys, which someone else reads, may stand beside it."""
    given = entry.entries()
    if "position_m" in given and _GEODETIC in given:
        raise given[_GEODETIC].error(
            "must be left out, or 'position_m'; allowed is one or the other"
        )
    place, other = ("position_m", _GEODETIC) if _GEODETIC not in given else (_GEODETIC, None)
    found = entry.mapping(
        [*required, place, "p_fa"],
        [
            *filter(None, [other]),
            "constant",
            *RADARS,
            "detector",
            "scan_period_s",
            *optional,
        ],
    )
    chosen = [key for key in ("constant", *RADARS) if key in found]
    if len(chosen) != 1:
        *others, last = (f"'{key}'" for key in ("constant", *RADARS))
        raise entry.error(
            f"needs one of the keys {', '.join(others)} and {last}, and not "
            + ("both" if len(chosen) < 3 else "more")
        )
    document: dict[str, Any] = {}
    position, geodetic = [0.0] * 3, None
    if place == _GEODETIC:
        where, document[_GEODETIC] = read_geodetic(found[_GEODETIC])
        geodetic = _Geodetic(where, found[_GEODETIC])
    else:
        document["position_m"] = position = found["position_m"].numbers(3)
    makeup: Makeup | None = None
    if "constant" in found:
        document["constant"] = constant = found["constant"].number(POSITIVE)
    else:
        makeup, document[chosen[0]] = read_makeup(found[chosen[0]], chosen[0])
        constant = makeup.constant
    document["p_fa"] = found["p_fa"].number(PROBABILITY)
    document["detector"] = found["detector"].choice(DETECTORS) if "detector" in found else "north"
    state = np.array([*position, constant])
    detector = DETECTORS[document["detector"]]()
    scan_period = None
    if "scan_period_s" in found:
        document["scan_period_s"] = scan_period = found["scan_period_s"].number(POSITIVE)
    radar = _Radar(
        state, makeup, document["p_fa"], detector, scan_period=scan_period, geodetic=geodetic
    )
    return radar, document


def _placed(radar: _Radar, poses: _Poses) -> _Radar:
    """Put a radar whose place is in latitude and longitude into the frame of the poses."""
    if radar.geodetic is None:
        return radar
    if poses.origin is None:
        raise radar.geodetic.entry.error(
            "needs a path whose route is in latitude and longitude, with its geometry.origin; "
            "here give position_m"
        )
    state = radar.state.copy()
    state[POSITION] = ned_from_geodetic(radar.geodetic.place, poses.origin)
    return dataclasses.replace(radar, state=state, levels=_turned(radar, radar.levels, poses))


def _turned(radar: _Radar, levels: _Levels, poses: _Poses) -> _Levels:
    """Turn C_rr from north, east and down at a radar in latitude and longitude to the frame."""
    if radar.geodetic is None or poses.origin is None:
        return levels
    turn = np.eye(len(RADAR))
    turn[POSITION, POSITION] = turn_to_origin(radar.geodetic.place, poses.origin)
    turned = {}
    for level, matrix in levels.covariance.items():
        matrix = turn @ matrix @ turn.T
        turned[level] = covariance.without_rounding((matrix + matrix.T) / 2)
    return dataclasses.replace(levels, covariance=turned)


def _radars(entry: Entry) -> tuple[list[_Radar], list[dict[str, Any]]]:
    """Read the radars of a network."""
    if not entry.is_list() or not entry.items():
        raise entry.wrong("a list of one radar or more, each with a name")
    entries = entry.items()
    if len(entries) > MAX_RADARS:
        raise entry.error(f"has {len(entries)} radars, allowed are {MAX_RADARS}")
    radars: list[_Radar] = []
    documents: list[dict[str, Any]] = []
    for radar_entry in entries:
        radar, document = _one_of_several(radar_entry)
        name = radar_entry.entries()["name"]
        if radar.name in (other.name for other in radars):
            raise name.error(f"must be a name that no other radar has, got {radar.name!r}")
        problem = name_problem([*(other.name for other in radars), radar.name])
        if problem:
            raise name.error(problem)
        _refuse_other_levels(radar_entry.entries()["uncertainty"], radar, (radars or [radar])[0])
        radars.append(radar)
        documents.append(document)
    return radars, documents


def _one_of_several(entry: Entry) -> tuple[_Radar, dict[str, Any]]:
    radar, of_radar = _radar(entry, ["name"], ["max_range_km", "horizon", "uncertainty"])
    found = entry.entries()
    name = found["name"].text(
        "[A-Za-z0-9][A-Za-z0-9_-]{0,39}",
        "the name of a radar, up to 40 letters A to Z, digits, '_' or '-'",
    )
    document: dict[str, Any] = {"name": name, **of_radar}
    max_range = math.inf
    if "max_range_km" in found:
        document["max_range_km"] = found["max_range_km"].number(POSITIVE)
        max_range = document["max_range_km"] * 1e3
    horizon = "horizon" in found and found["horizon"].choice(["true", "false"]) == "true"
    document["horizon"] = horizon
    if "uncertainty" not in found:
        raise entry.error("missing key 'uncertainty'; every one of 'radars' has one of its own")
    levels, document["uncertainty"] = _levels(found["uncertainty"], radar.makeup)
    radar = dataclasses.replace(
        radar,
        name=name,
        max_range=max_range,
        horizon=horizon,
        levels=levels,
    )
    return radar, document


def _refuse_other_levels(entry: Entry, radar: _Radar, first: _Radar) -> None:
    """All radars of a network must have the levels of the first."""
    expected, levels = list(first.levels.covariance), entry.entries()
    for level, level_entry in levels.items():
        if level not in expected:
            raise level_entry.error(
                f"must be a level that {first.called} has too: {', '.join(expected)}"
                + did_you_mean(level, set(expected) - set(levels))
            )
    missing = [level for level in expected if level not in levels]
    if missing:
        raise entry.error(
            f"missing level '{missing[0]}'; {radar.called} must have the levels that "
            f"{first.called} has: {', '.join(expected)}"
        )


def _network(
    radars: Sequence[_Radar], models: Sequence[DetectionModel], poses: _Poses
) -> NetworkModel:
    return NetworkModel(
        tuple(
            Station(
                model,
                name=radar.name,
                max_range=radar.max_range,
                horizon=poses.earth if radar.horizon else None,
                scan_period=radar.scan_period,
            )
            for radar, model in zip(radars, models, strict=True)
        )
    )
