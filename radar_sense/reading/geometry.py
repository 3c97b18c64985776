"""The poses of a scenario file: an orbit or a path."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from radar_sense import axis, keys, provenance
from radar_sense.axis import Axis
from radar_sense.limits import DEG
from radar_sense.model.geometry import orbit
from radar_sense.model.horizon import Horizon
from radar_sense.reading.trajectory import read_path
from radar_sense.reading.yaml_reader import Entry
from radar_sense.states import FloatArray

MAX_POSES = 1_000_000


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses along an axis.

    Attributes:
        axis: Axis of the poses (n,).
        aircraft: Aircraft states (n, 6).
        source: The orbit or the path.
        covariance: C_aa (n, 6, 6), if the route file has it.
        earth: The horizon of radars that have one.
        time_s: Times (n,) [s], on a path.
        origin: Latitude, longitude [rad] and height above the ellipsoid [m] of the frame's origin,
            if the route is in latitude and longitude.
    """

    axis: Axis
    aircraft: FloatArray
    source: provenance.Orbit | provenance.Path
    covariance: FloatArray | None = None
    earth: Horizon = field(default_factory=Horizon)
    time_s: FloatArray | None = None
    origin: tuple[float, float, float] | None = None


def is_path(entry: Entry) -> bool:
    """Return whether the geometry is a path."""
    entries = entry.entries()
    key = keys.GEOMETRY_TYPE
    return key.name in entries and entries[key.name].value(key) == "path"


def read_geometry(entry: Entry, attitude: FloatArray | None) -> Poses:
    """Read the geometry.

    Args:
        entry: The mapping.
        attitude: Roll, pitch, yaw [rad] on an orbit; None for a path.
    """
    if attitude is None:
        along, route, path = read_path(entry)
        earth = Horizon(origin=route.origin)
        return Poses(
            along, route.aircraft, path, route.covariance, earth, route.time_s, route.origin
        )
    section = entry.section(keys.ORBIT)
    section.value(keys.GEOMETRY_TYPE)
    radius, down = section.si(keys.RANGE), section.si(keys.DOWN)
    theta_r_deg, sweep = _read_sweep(section["azimuth_deg"])
    azimuth_from = section.value(keys.AZIMUTH_FROM)
    position = orbit(theta_r_deg * DEG, radius=radius, down=down, azimuth_from=azimuth_from)
    aircraft = np.hstack([position, np.broadcast_to(attitude, position.shape)])
    source = provenance.Orbit(radius, down, sweep, azimuth_from)
    return Poses(axis.azimuth(theta_r_deg), aircraft, source)


def _read_sweep(entry: Entry) -> tuple[FloatArray, tuple[float, float, float]]:
    """Read azimuths (n,) [deg]: first, last and step."""
    section = entry.section(keys.SWEEP)
    start, stop, step = (section.value(key) for key in keys.SWEEP)
    if step == 0 or (stop - start) * step < 0:
        raise section["step"].error(
            f"must be a step other than 0 that leads from {start:g} to {stop:g}, got {step:g}"
        )
    # Rounding must not lose the last pose, as in (180 − 0)/0.1 = 1799.9999999999998.
    steps = math.floor((stop - start) / step * (1 + 1e-12) + 1e-9)
    if steps >= MAX_POSES:
        raise section["step"].error(f"makes {steps + 1:,} poses, allowed are {MAX_POSES:,}")
    # Rounding to 1e-12 degrees turns 3 · 0.1 = 0.30000000000000004 into 0.3.
    return np.round(start + step * np.arange(steps + 1), 12), (start, stop, step)
