"""The scenario: who flies where, which radar looks, and how uncertain each of them is.

A scenario file has degrees, kilometres and decibels in it. They become radians, metres and ratios
here and nowhere else.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_sense import axis, covariance
from radar_sense.axis import Axis
from radar_sense.detection import Detector, Marcum, North, Swerling1, Swerling3
from radar_sense.geometry import body_vector, orbit, slant_range
from radar_sense.horizon import Horizon
from radar_sense.limits import (
    NOT_NEGATIVE,
    POSITIVE,
    PROBABILITY,
    RUNS,
    SEED,
    Limit,
    parameter_keys,
)
from radar_sense.model import DetectionModel, Model
from radar_sense.network import NetworkModel, Station, name_problem
from radar_sense.path import read_geodetic, read_path
from radar_sense.radar import RADARS
from radar_sense.radar_constant import Makeup, Part, read_makeup, relative_std
from radar_sense.rcs import RCS, ConstantRCS, EllipsoidRCS, ExactEllipsoidRCS, SpikeballRCS
from radar_sense.rcs_file import KEYS as TABLE_KEYS
from radar_sense.rcs_file import read_table
from radar_sense.rcs_table import TableRCS
from radar_sense.reader import MAX_NAME, Entry, ScenarioError, did_you_mean, parse, read_file
from radar_sense.route import in_frame
from radar_sense.states import POSITION, RADAR, FloatArray
from radar_sense.wgs84 import ned_from_geodetic, turn_to_origin

#: The RCS models that a scenario can name. Their keys are declared with their fields.
RCS_MODELS: Mapping[str, type[Any]] = {
    "constant": ConstantRCS,
    "ellipsoid": EllipsoidRCS,
    "ellipsoid_exact": ExactEllipsoidRCS,
    "spikeball": SpikeballRCS,
    "table": TableRCS,
}

#: The detectors that a scenario can name. With a single pulse Swerling's cases are two.
DETECTORS: Mapping[str, type[Detector]] = {
    "north": North,
    "marcum": Marcum,
    "swerling1": Swerling1,
    "swerling2": Swerling1,
    "swerling3": Swerling3,
    "swerling4": Swerling3,
}

MAX_POSES = 1_000_000
MAX_RADARS = 64
#: The model is one of the far field; nearer than this the aircraft is on top of the radar.
MIN_RANGE = 1.0

DEFAULT_RUNS = 500
DEFAULT_SEED = 1

_DEG = np.pi / 180.0
_CORRELATION = "aircraft_correlation_s"
_GEODETIC = "position_geodetic"
#: Keys of an uncertainty block: name, number of components, and its unit in SI.
_AIRCRAFT_PARTS = (("position_m", 3, 1.0), ("attitude_deg", 3, _DEG))
_RADAR_PARTS = (("position_m", 3, 1.0), ("constant", 1, 1.0))


@dataclass(frozen=True, eq=False)
class Scenario:
    """A scenario, checked, in SI units and radians.

    Attributes:
        name: Stem of the names of the files written.
        model: RCS, P_fa and detector; a `NetworkModel` if the file has `radars`.
        axis: What the poses are laid out along: azimuth, time or distance (n,).
        aircraft: Nominal aircraft states (n, 6).
        radar: Nominal radar state (4,), or (4m,) of a network of m.
        cov_aircraft: C_aa (6, 6), or one for each pose (n, 6, 6).
        cov_radar: C_rr (4, 4), or (4m, 4m), for each level of radar uncertainty, in the file's
            order.
        level: The level that an analysis of a single one uses.
        runs: Monte Carlo runs.
        seed: Seed of the Monte Carlo draws.
        document: The file's content, checked and with defaults filled in, in the file's units.
        constant_parts: What makes the c_r of each radar (m,) uncertain, for the levels that say so;
            C_rr has it to first order.
        time_s: Time of each pose (n,) [s] of a path; None on an orbit, which has no times.
        scan_period_s: Time from look to look of the radar [s]; None if the file does not say.
        correlation_s: Correlation time [s] of the errors of the pose, a first-order Gauss–Markov
            process: 0 for independent errors at every pose, infinity for the same at all.
        origin: Latitude, longitude [rad] and height above the ellipsoid [m] of the frame's origin,
            of a route in latitude and longitude; else None.
    """

    name: str
    model: Model
    axis: Axis
    aircraft: FloatArray
    radar: FloatArray
    cov_aircraft: FloatArray
    cov_radar: Mapping[str, FloatArray]
    level: str
    runs: int
    seed: int
    document: Mapping[str, Any]
    constant_parts: Mapping[str, tuple[tuple[Part, ...], ...]] = field(default_factory=dict)
    time_s: FloatArray | None = None
    scan_period_s: float | None = None
    correlation_s: float = 0.0
    origin: tuple[float, float, float] | None = None

    @property
    def parts(self) -> tuple[tuple[Part, ...], ...]:
        """What makes the c_r of each radar (m,) uncertain at the level; nothing if one number."""
        return self.constant_parts.get(self.level, ((),) * (len(self.radar) // len(RADAR)))

    @property
    def log_constant(self) -> NDArray[np.bool_]:
        """Which radars (m,) have a c_r to take for log-normal, as parts in decibels make it."""
        return np.array([bool(parts) for parts in self.parts])

    @property
    def theta_r_deg(self) -> FloatArray:
        """The place of each pose on the axis (n,): on an orbit θ_r [deg]."""
        return self.axis.values

    def part(self, poses: slice | NDArray[np.intp]) -> Scenario:
        """Return the scenario with some of its poses."""
        return dataclasses.replace(
            self,
            axis=self.axis.part(poses),
            aircraft=self.aircraft[poses],
            cov_aircraft=self.cov_aircraft
            if self.cov_aircraft.ndim == 2
            else self.cov_aircraft[poses],
            time_s=None if self.time_s is None else self.time_s[poses],
        )

    def resolved(self) -> dict[str, Any]:
        """Return the scenario as a document that reads back as this scenario."""
        chosen = {"level": self.level, "runs": self.runs, "seed": self.seed}
        return {**self.document, "analysis": chosen}

    def with_analysis(
        self, *, level: str | None = None, runs: int | None = None, seed: int | None = None
    ) -> Scenario:
        """Return the scenario with other choices of analysis; None leaves one as it is.

        Raises:
            ScenarioError: If there is no such level, or runs or seed are out of range.
        """
        if level is not None and level not in self.cov_radar:
            raise ScenarioError(
                f"level must be one of {', '.join(self.cov_radar)}, got {level!r}"
                + did_you_mean(level, self.cov_radar)
            )
        for name, value, limit in (("runs", runs, RUNS), ("seed", seed, SEED)):
            if value is not None and not limit.allows(value):
                raise ScenarioError(f"{name} must be {limit}, got {value}")
        return dataclasses.replace(
            self,
            level=self.level if level is None else level,
            runs=self.runs if runs is None else int(runs),
            seed=self.seed if seed is None else int(seed),
        )


def default_text() -> str:
    """Text of the embedded default, the scenario of the paper."""
    return resources.files("radar_sense").joinpath("paper.yaml").read_text(encoding="utf-8")


def load_scenario(path: str | Path | None = None) -> Scenario:
    """Read and check a scenario file; the paper's own scenario if no path is given.

    Raises:
        ScenarioError: If the file cannot be read or anything in it is not allowed.
    """
    if path is None:
        return parse_scenario(default_text(), "paper.yaml")
    return parse_scenario(read_file(path), str(path))


def parse_scenario(text: str, source: str = "scenario") -> Scenario:
    """Check the text of a scenario.

    Args:
        text: YAML.
        source: What to call it in errors.

    Raises:
        ScenarioError: If anything in it is not allowed.
    """
    root = parse(text, source)
    given = root.entries() if root.is_mapping() else {}
    several = "radars" in given
    if several and "radar" in given:
        raise given["radar"].error("must be left out, or 'radars'; allowed is one or the other")
    found = root.mapping(
        [
            "name",
            "radars" if several else "radar",
            "aircraft",
            "geometry",
            "uncertainty",
            "analysis",
        ]
    )
    document: dict[str, Any] = {
        "name": found["name"].text(
            f"[A-Za-z0-9][A-Za-z0-9_.-]{{0,{MAX_NAME - 1}}}",
            f"a name of up to {MAX_NAME} letters A to Z, digits, '_', '-' or '.'",
        )
    }
    if several:
        radars, document["radars"] = _radars(found["radars"])
    else:
        radar, document["radar"] = _radar(found["radar"])
        radars = [radar]
    rcs, attitude, document["aircraft"] = _aircraft(found["aircraft"], found["geometry"])
    poses, document["geometry"] = _geometry(found["geometry"], attitude)
    radars = [_placed(radar, poses) for radar in radars]
    for radar in radars:
        _refuse_collision(found["geometry"], poses, radar)
        _refuse_uncovered(found["geometry"], rcs, poses, radar)
    cov_aircraft, levels, document["uncertainty"] = _uncertainty(
        found["uncertainty"], poses, radars[0].makeup, of_radar=not several
    )
    if levels is not None:
        radars = [dataclasses.replace(radars[0], levels=_turned(radars[0], levels, poses))]
    cov_radar = {
        level: covariance.side_by_side([radar.levels.covariance[level] for radar in radars])
        for level in radars[0].levels.covariance
    }
    level, runs, seed = _analysis(found["analysis"], cov_radar)
    state = np.concatenate([radar.state for radar in radars])
    models = [DetectionModel(rcs=rcs, p_fa=r.p_fa, detector=r.detector) for r in radars]
    arrays = (poses.axis.values, poses.aircraft, state, cov_aircraft, *cov_radar.values())
    for array in arrays:
        array.flags.writeable = False
    return Scenario(
        name=document["name"],
        model=_network(radars, models, poses) if several else models[0],
        axis=poses.axis,
        aircraft=poses.aircraft,
        radar=state,
        cov_aircraft=cov_aircraft,
        cov_radar=MappingProxyType(cov_radar),
        level=level,
        runs=runs,
        seed=seed,
        document=MappingProxyType(document),
        constant_parts=MappingProxyType(
            {
                level: tuple(radar.levels.parts.get(level, ()) for radar in radars)
                for level in cov_radar
                if any(level in radar.levels.parts for radar in radars)
            }
        ),
        time_s=poses.time_s,
        scan_period_s=radars[0].scan_period,
        correlation_s=float(document["uncertainty"].get(_CORRELATION, 0.0)),
        origin=poses.origin,
    )


@dataclass(frozen=True, eq=False)
class _Levels:
    """How uncertain a radar is at each level: C_rr (4, 4), and parts of c_r where there are any."""

    covariance: Mapping[str, FloatArray] = field(default_factory=dict)
    parts: Mapping[str, tuple[Part, ...]] = field(default_factory=dict)


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


def _aircraft(entry: Entry, geometry: Entry) -> tuple[RCS, FloatArray | None, dict[str, Any]]:
    """Read RCS and attitude; a path has the attitude of its own."""
    on_path = _is_path(geometry)
    found = entry.mapping(*((["rcs"], ["attitude_deg"]) if on_path else (["rcs", "attitude_deg"],)))
    if on_path and "attitude_deg" in found:
        raise found["attitude_deg"].error(
            "must be left out with a path: attitude is that of the route file, or of its track"
        )
    keys = dict.fromkeys(key for model in RCS_MODELS.values() for key in parameter_keys(model))
    choices = found["rcs"].mapping([], ["model", *keys, *TABLE_KEYS])
    if "model" not in choices:
        raise found["rcs"].error(f"missing key 'model', one of {', '.join(RCS_MODELS)}")
    name = choices["model"].choice(RCS_MODELS)
    rcs, values = (
        read_table(found["rcs"])
        if name == "table"
        else found["rcs"].instance(RCS_MODELS[name], besides=["model"])
    )
    document: dict[str, Any] = {"rcs": {"model": name, **values}}
    if on_path:
        return rcs, None, document
    attitude = found["attitude_deg"].numbers(3, Limit(at_least=-360, at_most=360))
    document["attitude_deg"] = attitude
    return rcs, np.array(attitude) * _DEG, document


@dataclass(frozen=True, eq=False)
class _Poses:
    """The geometry: poses along an axis.

    Attributes:
        axis: What they are laid out along (n,).
        aircraft: Aircraft states (n, 6).
        covariance: C_aa (n, 6, 6), if the geometry says something of it.
        earth: What the surface of the earth is in its coordinates, for radars with a horizon.
        time_s: Times (n,) [s], if it has any.
        origin: Latitude, longitude [rad] and height above the ellipsoid [m] of the frame's origin,
            if that is known.
    """

    axis: Axis
    aircraft: FloatArray
    covariance: FloatArray | None = None
    earth: Horizon = field(default_factory=Horizon)
    time_s: FloatArray | None = None
    origin: tuple[float, float, float] | None = None


def _is_path(entry: Entry) -> bool:
    found = entry.entries()
    return "type" in found and found["type"].choice(["orbit", "path"]) == "path"


def _geometry(entry: Entry, attitude: FloatArray | None) -> tuple[_Poses, dict[str, Any]]:
    if attitude is None:
        along, route, document = read_path(entry)
        earth = Horizon(origin=route.origin)
        return _Poses(
            along, route.aircraft, route.covariance, earth, route.time_s, route.origin
        ), document
    found = entry.mapping(["type", "range_km", "down_km", "azimuth_deg"], ["azimuth_from"])
    document = {
        "type": found["type"].choice(["orbit"]),
        "range_km": found["range_km"].number(NOT_NEGATIVE),
        "down_km": found["down_km"].number(),
    }
    theta_r_deg, document["azimuth_deg"] = _sweep(found["azimuth_deg"])
    document["azimuth_from"] = (
        found["azimuth_from"].choice(["east", "north"]) if "azimuth_from" in found else "east"
    )
    position = orbit(
        theta_r_deg * _DEG,
        radius=document["range_km"] * 1e3,
        down=document["down_km"] * 1e3,
        azimuth_from=document["azimuth_from"],
    )
    aircraft = np.hstack([position, np.broadcast_to(attitude, position.shape)])
    return _Poses(axis.azimuth(theta_r_deg), aircraft), document


def _sweep(entry: Entry) -> tuple[FloatArray, dict[str, float]]:
    found = entry.mapping(["start", "stop", "step"])
    angle = Limit(at_least=-360, at_most=720)
    start, stop = found["start"].number(angle), found["stop"].number(angle)
    step = found["step"].number()
    if step == 0 or (stop - start) * step < 0:
        raise found["step"].error(
            f"must be a step other than 0 that leads from {start:g} to {stop:g}, got {step:g}"
        )
    # Rounding must not lose the last pose, as in (180 − 0)/0.1 = 1799.9999999999998.
    steps = math.floor((stop - start) / step * (1 + 1e-12) + 1e-9)
    if steps >= MAX_POSES:
        raise found["step"].error(f"makes {steps + 1:,} poses, allowed are {MAX_POSES:,}")
    # Rounding to 1e-12 degrees turns 3 · 0.1 = 0.30000000000000004 back into what was meant.
    degrees = np.round(start + step * np.arange(steps + 1), 12)
    return degrees, {"start": start, "stop": stop, "step": step}


def _refuse_collision(entry: Entry, poses: _Poses, radar: _Radar) -> None:
    distance = slant_range(poses.aircraft, radar.state)
    nearest = int(np.argmin(distance))
    if distance[nearest] < MIN_RANGE:
        raise entry.error(
            f"the aircraft is on top of {radar.called} at "
            f"{poses.axis.name} {poses.axis.at(nearest)}, "
            f"slant range {distance[nearest]:.2g} m; allowed is {MIN_RANGE:g} m or more"
        )


def _refuse_uncovered(entry: Entry, rcs: RCS, poses: _Poses, radar: _Radar) -> None:
    if not isinstance(rcs, TableRCS) or rcs.elevation is None:
        return
    body = body_vector(poses.aircraft, radar.state)
    outside = np.flatnonzero(rcs.uncovered(body))
    if len(outside):
        pose = outside[0]
        x, y, z = body[pose]
        raise entry.error(
            f"at {poses.axis.name} {poses.axis.at(pose)} the aircraft sees {radar.called} at "
            f"elevation {np.arctan2(-z, np.hypot(x, y)) / _DEG:.3g} deg, the RCS table covers "
            f"{rcs.elevation[0] / _DEG:g} to {rcs.elevation[-1] / _DEG:g} deg"
        )


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


def _analysis(entry: Entry, levels: Mapping[str, FloatArray]) -> tuple[str, int, int]:
    found = entry.mapping(["level"], ["runs", "seed"])
    return (
        found["level"].choice(levels),
        found["runs"].integer(RUNS) if "runs" in found else DEFAULT_RUNS,
        found["seed"].integer(SEED) if "seed" in found else DEFAULT_SEED,
    )
