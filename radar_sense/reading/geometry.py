"""The poses of a scenario file: an orbit or a path."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from radar_sense import axis
from radar_sense.axis import Axis
from radar_sense.limits import DEG, NOT_NEGATIVE, Limit
from radar_sense.model.geometry import orbit
from radar_sense.model.horizon import Horizon
from radar_sense.reading.trajectory import read_path
from radar_sense.reading.yaml_reader import Entry
from radar_sense.states import FloatArray

MAX_POSES = 1_000_000


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
        theta_r_deg * DEG,
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
