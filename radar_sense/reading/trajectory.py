"""The path that a scenario names: a route file, and what is to be made of it.

    geometry:
      type: path
      file: route.csv                   looked for from the folder of the scenario file
      axis: time                        or distance: what tables and figures are laid out along
      origin: {latitude_deg: 47.3, longitude_deg: 8.5, altitude_m: 430}
                                        of the north-east-down frame, for a route in latitude and
                                        longitude, and only for one
      interpolate: {step_s: 10, method: legs}
                                        or smooth; without it every row of the file is a pose
      max_gap_s: 60                     refuse a file with a longer step between two rows

In the same frame a radar may say its place in latitude and longitude, too:

    radar:
      position_geodetic: {latitude_deg: 47.1, longitude_deg: 9.2, altitude_m: 1500}

The covariance of its position is then relative to north, east and down at the radar. Errors of the
aircraft, in the route file or in the scenario, are relative to the level of the aircraft.

What may be in the file is said at the top of `route`. Attitude is that of the file, else it
follows from the track.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from radar_sense import axis
from radar_sense.errors import ScenarioError
from radar_sense.limits import POSITIVE, Limit
from radar_sense.model.trajectory import METHODS, Route, resample
from radar_sense.reading.route_file import MAX_BYTES, load_route
from radar_sense.reading.yaml_reader import Entry, recorded

#: The keys of a scenario's path, beside `type` and `file`.
OPTIONAL = ("axis", "origin", "interpolate", "max_gap_s", "sha256")
#: What the poses can be laid out along.
AXES = ("time", "distance")
_GEODETIC: Mapping[str, Limit] = {
    "latitude_deg": Limit(at_least=-90, at_most=90),
    "longitude_deg": Limit(at_least=-180, at_most=360),
    "altitude_m": Limit(at_least=-10e3, at_most=100e3),
}


def read_path(entry: Entry) -> tuple[axis.Axis, Route, dict[str, Any]]:
    """Read the path that an entry of a scenario names.

    Returns:
        The axis of its poses, the route, and the entry as it is to be recorded: with the file
        as seen from the working folder and its SHA-256, so that it reads back as this route or not
        at all.

    Raises:
        ScenarioError: If anything in the entry or the file is not allowed.
    """
    found = entry.mapping(["type", "file"], OPTIONAL)
    name = found["file"].text(r"[^\0\r\n]{1,1000}", "the name of a CSV file")
    path = Path(entry.source).parent / name
    document: dict[str, Any] = {"type": "path", "file": recorded(path)}
    document["axis"] = found["axis"].choice(AXES) if "axis" in found else AXES[0]
    origin = None
    if "origin" in found:
        origin, document["origin"] = read_geodetic(found["origin"])
    step, method = 0.0, METHODS[0]
    if "interpolate" in found:
        parts = found["interpolate"].mapping(["step_s"], ["method"])
        step = parts["step_s"].number(POSITIVE)
        method = parts["method"].choice(METHODS) if "method" in parts else method
        document["interpolate"] = {"step_s": step, "method": method}
    max_gap_s = None
    if "max_gap_s" in found:
        document["max_gap_s"] = max_gap_s = found["max_gap_s"].number(POSITIVE)
    document["sha256"] = _digest(found["file"], path)
    if "sha256" in found:
        expected = found["sha256"].text("[0-9a-f]{64}", "64 digits 0 to 9 and a to f")
        if expected != document["sha256"]:
            raise found["sha256"].error(
                f"{path} is another file than it was: it has {document['sha256']}"
            )
    route = load_route(path, origin=origin, max_gap_s=max_gap_s)
    if step:
        try:
            route = resample(route, step, method)
        except ScenarioError as error:
            raise found["interpolate"].error(str(error)) from error
    along = (
        axis.time(route.time_s) if document["axis"] == "time" else axis.distance(route.distance_m)
    )
    return along, route, document


def read_geodetic(entry: Entry) -> tuple[tuple[float, float, float], dict[str, float]]:
    """Read a place: latitude, longitude [rad] and height [m]; and the entry, in its own units.

    Raises:
        ScenarioError: If it is no place.
    """
    found = entry.mapping(list(_GEODETIC))
    document = {key: found[key].number(limit) for key, limit in _GEODETIC.items()}
    latitude, longitude, altitude = document.values()
    return (float(np.deg2rad(latitude)), float(np.deg2rad(longitude)), altitude), document


def _digest(entry: Entry, path: Path) -> str:
    """SHA-256 of a file, which may be too large to be in memory at once."""
    digest, size = hashlib.sha256(), 0
    try:
        with path.open("rb") as file:
            while data := file.read(2**20):
                size += len(data)
                if size > MAX_BYTES:  # some files have no end
                    raise entry.error(f"{path} is larger than {MAX_BYTES // 2**20} MiB")
                digest.update(data)
    except ScenarioError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte in it
        reason = getattr(error, "strerror", None) or error
        raise entry.error(f"{path} cannot be read: {reason}") from error
    return digest.hexdigest()
