"""A scenario file to a `Scenario`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from radar_sense import covariance
from radar_sense.limits import DEG, MAX_NAME, RUNS, SEED
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.geometry import body_vector, slant_range
from radar_sense.model.rcs import RCS
from radar_sense.model.rcs_table import TableRCS
from radar_sense.reading.aircraft import _aircraft
from radar_sense.reading.geometry import _geometry, _Poses
from radar_sense.reading.radars import _network, _placed, _Radar, _radar, _radars, _turned
from radar_sense.reading.uncertainty import _CORRELATION, _uncertainty
from radar_sense.reading.yaml_reader import Entry, parse, read_file
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray

#: The model is one of the far field; nearer than this the aircraft is on top of the radar.
MIN_RANGE = 1.0
DEFAULT_RUNS = 500
DEFAULT_SEED = 1


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
            f"elevation {np.arctan2(-z, np.hypot(x, y)) / DEG:.3g} deg, the RCS table covers "
            f"{rcs.elevation[0] / DEG:g} to {rcs.elevation[-1] / DEG:g} deg"
        )


def _analysis(entry: Entry, levels: Mapping[str, FloatArray]) -> tuple[str, int, int]:
    found = entry.mapping(["level"], ["runs", "seed"])
    return (
        found["level"].choice(levels),
        found["runs"].integer(RUNS) if "runs" in found else DEFAULT_RUNS,
        found["seed"].integer(SEED) if "seed" in found else DEFAULT_SEED,
    )
