"""A scenario file to a `Scenario`."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path

import numpy as np

from radar_sense import covariance, keys
from radar_sense.errors import InputError, describe
from radar_sense.limits import DEG, MIN_RANGE
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.geometry import body_vector, slant_range
from radar_sense.model.rcs import RCS
from radar_sense.model.rcs_table import TableRCS
from radar_sense.provenance import Provenance
from radar_sense.reading.aircraft import read_aircraft
from radar_sense.reading.geometry import Poses, read_geometry
from radar_sense.reading.radars import (
    RadarEntry,
    network,
    place_radar,
    read_radar,
    read_radars,
    with_levels,
)
from radar_sense.reading.uncertainty import read_uncertainty
from radar_sense.reading.yaml_reader import Entry, parse, read_file
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray


def default_text() -> str:
    """Return the text of the embedded scenario, which is the scenario of the paper."""
    return resources.files("radar_sense").joinpath("paper.yaml").read_text(encoding="utf-8")


def load_scenario(path: str | Path | None = None) -> Scenario:
    """Read and check a scenario file, or the scenario of the paper if no path is given.

    Raises:
        InputError: If the file cannot be read or anything in the file is not allowed.
    """
    if path is None:
        return parse_scenario(default_text(), "paper.yaml")
    return parse_scenario(read_file(path), str(path))


def parse_scenario(text: str, source: str = "scenario") -> Scenario:
    """Check the text of a scenario.

    Args:
        text: YAML.
        source: Name of the text in errors. Files that the scenario names are looked for from the
            folder of this name.

    Raises:
        InputError: If anything in the text is not allowed.
    """
    if not isinstance(text, str):
        raise InputError(f"text must be YAML as text, got {describe(text)}")
    root = parse(text, source)
    present = root.entries() if root.is_mapping() else {}
    several = "radars" in present
    if several and "radar" in present:
        raise present["radar"].error("stands beside 'radars'; give only one of the two")
    unused = "radar" if several else "radars"
    entries = root.mapping([key.name for key in keys.SCENARIO if key.name != unused])
    name = entries["name"].value(keys.NAME)
    radars = read_radars(entries["radars"]) if several else [read_radar(entries["radar"])]
    rcs, rcs_source, attitude = read_aircraft(entries["aircraft"], entries["geometry"])
    poses = read_geometry(entries["geometry"], attitude)
    radars = [place_radar(radar, poses) for radar in radars]
    for radar in radars:
        _refuse_collision(entries["geometry"], poses, radar)
        _refuse_uncovered(entries["geometry"], rcs, poses, radar)
    cov_aircraft, correlation_s, rcs_db, levels = read_uncertainty(
        entries["uncertainty"],
        poses,
        radars[0].data_sheet,
        of_radar=not several,
        rcs=rcs,
        attenuation=radars[0].attenuation,
    )
    if levels is not None:
        radars = [with_levels(radars[0], levels, poses)]
    cov_radar = {
        level: covariance.block_diagonal([radar.levels.covariance[level] for radar in radars])
        for level in radars[0].levels.covariance
    }
    level, runs, seed, method = _read_analysis(entries["analysis"], cov_radar)
    models = [DetectionModel(rcs, r.p_fa, r.detector, r.attenuation) for r in radars]
    for array in (poses.axis.values, poses.aircraft, cov_aircraft.made):
        array.flags.writeable = False
    return Scenario(
        name=name,
        model=network(radars, models, poses),
        axis=poses.axis,
        aircraft=poses.aircraft,
        radar=np.concatenate([radar.state for radar in radars]),
        cov_aircraft=cov_aircraft.made,
        cov_radar=cov_radar,
        level=level,
        runs=runs,
        seed=seed,
        method=method,
        tolerances={
            level: tuple(radar.levels.tolerances.get(level, ()) for radar in radars)
            for level in cov_radar
            if any(level in radar.levels.tolerances for radar in radars)
        },
        time_s=poses.time_s,
        rcs_db=rcs_db,
        attenuation_std={
            level: tuple(radar.levels.attenuation.get(level, 0.0) for radar in radars)
            for level in cov_radar
            if any(level in radar.levels.attenuation for radar in radars)
        },
        correlation_s=correlation_s,
        origin=poses.origin,
        provenance=Provenance(
            geometry=poses.source,
            aircraft=poses.aircraft,
            cov_aircraft=cov_aircraft,
            rcs=rcs_source,
            radars={radar.name: radar.source for radar in radars},
            earth=poses.earth,
        ),
    )


def _refuse_collision(entry: Entry, poses: Poses, radar: RadarEntry) -> None:
    distance = slant_range(poses.aircraft, radar.state)
    nearest = int(np.argmin(distance))
    if distance[nearest] < MIN_RANGE:
        raise entry.error(
            f"the aircraft is on top of {radar.called} at "
            f"{poses.axis.name} {poses.axis.at(nearest)}, "
            f"slant range {distance[nearest]:.2g} m; allowed is {MIN_RANGE:g} m or more"
        )


def _refuse_uncovered(entry: Entry, rcs: RCS, poses: Poses, radar: RadarEntry) -> None:
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


def _read_analysis(entry: Entry, levels: Mapping[str, FloatArray]) -> tuple[str, int, int, str]:
    section = entry.section(keys.ANALYSIS)
    return (
        section["level"].choice(levels),
        section.value(keys.RUNS_KEY),
        section.value(keys.SEED_KEY),
        section.value(keys.ANALYSIS_METHOD),
    )
