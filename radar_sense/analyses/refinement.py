"""Poses between the rows of a path, added until P_D and its bound are resolved.

Between two rows the position is on a straight line, in latitude and longitude if the path follows
the curve of the earth. The attitude turns the short way at a constant rate. The covariance is
interpolated linearly. A mission has the same states between rows.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from radar_sense.model.geometry import body_vector
from radar_sense.model.trajectory import interpolate
from radar_sense.propagation import Moments
from radar_sense.provenance import Path
from radar_sense.scenario import Scenario
from radar_sense.states import POSITION, RADAR, FloatArray

#: Largest turn of the aspect [rad] between two poses, for a smooth RCS and for an RCS with lobes.
SMOOTH_ASPECT, LOBED_ASPECT = np.deg2rad(5.0), np.deg2rad(1.0)
#: Largest distance between two poses, as a part of the range of each radar.
LARGEST_MOVE = 0.1
#: Shorter steps [s] are not halved. P_D jumps at a horizon, where no step is short enough.
SHORTEST = 0.2
#: Most poses of a refined path.
MAX_POSES = 20_000


@dataclass(frozen=True, eq=False)
class Refined:
    """A path with poses between its rows.

    Attributes:
        scenario: The scenario of n poses.
        moments: The moments of P_D (n,).
        rows: Poses (m,) that are rows of the path.
        resolved: Whether the poses resolve P_D.
    """

    scenario: Scenario
    moments: Moments
    rows: NDArray[np.intp]
    resolved: bool

    @property
    def added(self) -> int:
        """Number of poses between the rows."""
        return len(self.scenario.aircraft) - len(self.rows)


def can_refine(scenario: Scenario) -> bool:
    """Return whether the scenario is a path of two rows or more without `geometry.interpolate`."""
    geometry = scenario.provenance.geometry
    interpolated = isinstance(geometry, Path) and geometry.step_s is not None
    return scenario.time_s is not None and len(scenario.time_s) > 1 and not interpolated


def refined(
    scenario: Scenario,
    moments: Moments,
    propagate: Callable[[Scenario], Moments],
    tolerance: float,
) -> Refined:
    """Return a path with poses added until P_D and its upper bound are linear between poses.

    First, steps are halved by geometry. In one step the aspect of each radar may turn by a few
    degrees, and the aircraft may move by a tenth of the range. Then steps are halved until P_D and
    its bound are within the tolerance of straight lines, by their second differences.

    Args:
        scenario: The scenario of a path.
        moments: Moments of P_D at its poses.
        propagate: Propagates a scenario.
        tolerance: The tolerance.
    """
    time = scenario.time_s
    assert time is not None
    n = len(time)
    row = np.arange(n)  # number of the row, or −1
    while len(time) < MAX_POSES:
        coarse = coarse_steps(along(scenario, time)) & (np.diff(time) > SHORTEST)
        if not coarse.any():
            break
        time, row = _halved(time, row, coarse)
    if len(time) > n:
        values = propagate(along(scenario, time[row < 0]))
        moments = _merged(moments, values, row)
    while len(time) < MAX_POSES:
        bends = _bend(time, moments.p_d) > tolerance
        bends |= _bend(time, moments.upper) > tolerance
        bends &= np.diff(time) > SHORTEST
        if not bends.any():
            break
        time, new = _halved(time, np.arange(len(time)), bends)
        row = np.where(new < 0, -1, row[new])
        moments = _merged(moments, propagate(along(scenario, time[new < 0])), new)
    return Refined(
        _with_rows(scenario, time, row) if len(time) > n else scenario,
        moments,
        np.flatnonzero(row >= 0),
        len(time) < MAX_POSES,
    )


def along(scenario: Scenario, time: FloatArray) -> Scenario:
    """Return the scenario of a path with its poses at other times (k,) [s]."""
    route = scenario.route()
    poses = interpolate(route, time)
    values = np.interp(time, route.time_s, scenario.axis.values)
    return scenario.along_path(
        axis=dataclasses.replace(scenario.axis, values=values),
        aircraft=poses.aircraft,
        cov_aircraft=scenario.cov_aircraft if poses.covariance is None else poses.covariance,
        time_s=time,
    )


def coarse_steps(path: Scenario) -> NDArray[np.bool_]:
    """Return the steps (n − 1,) between poses in which an aspect or a range changes much."""
    largest = LOBED_ASPECT if path.model.rcs.lobed else SMOOTH_ASPECT
    coarse = np.zeros(len(path.aircraft) - 1, dtype=bool)
    for radar in path.radar.reshape(-1, len(RADAR)):
        line = path.aircraft[:, POSITION] - radar[POSITION]
        distance = np.linalg.norm(line, axis=1)
        moved = np.linalg.norm(np.diff(line, axis=0), axis=1)
        coarse |= moved > LARGEST_MOVE * np.minimum(distance[1:], distance[:-1])
        with np.errstate(divide="ignore", invalid="ignore"):
            direction = body_vector(path.aircraft, radar) / distance[:, np.newaxis]
        if not path.model.rcs.isotropic:
            chord = np.linalg.norm(np.diff(direction, axis=0), axis=1)
            coarse |= chord > 2.0 * np.sin(0.5 * largest)
    return coarse


def _bend(time: FloatArray, values: FloatArray) -> FloatArray:
    """Return the distance (n − 1,) of values from straight lines between poses; 0 if unknown.

    The distance is h²/8 times the second derivative. The greater derivative of both ends is used.
    """
    step = np.diff(time)
    if len(step) < 2:
        return np.zeros(len(step))
    slope = np.diff(values) / step
    second = np.abs(2.0 * np.diff(slope) / (time[2:] - time[:-2]))
    greater = np.fmax(np.append(second, second[-1]), np.insert(second, 0, second[0]))
    bend: FloatArray = np.nan_to_num(0.125 * step**2 * greater)
    return bend


def _halved(
    time: FloatArray, row: NDArray[np.intp], steps: NDArray[np.bool_]
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return times and rows with new times in the middle of some steps, with row number −1."""
    after = np.flatnonzero(steps) + 1
    middle = 0.5 * (time[after - 1] + time[after])
    return np.insert(time, after, middle), np.insert(row, after, -1)


def _merged(old: Moments, new: Moments, row: NDArray[np.intp]) -> Moments:
    """Return the moments of old poses, by the number in `row`, and of new poses at row −1."""
    arrays = []
    for field in fields(Moments):
        values, added = getattr(old, field.name), getattr(new, field.name)
        merged = np.empty(len(row), dtype=values.dtype)
        merged[row >= 0], merged[row < 0] = values[row[row >= 0]], added
        arrays.append(merged)
    return Moments(*arrays)


def _with_rows(scenario: Scenario, time: FloatArray, row: NDArray[np.intp]) -> Scenario:
    """Return the scenario at some times, with the exact states at its rows."""
    path = along(scenario, time)
    at_row = np.flatnonzero(row >= 0)
    aircraft = path.aircraft.copy()
    aircraft[at_row] = scenario.aircraft[row[at_row]]
    covariance = path.cov_aircraft
    if covariance.ndim == 3:
        covariance = covariance.copy()
        covariance[at_row] = scenario.cov_aircraft[row[at_row]]
    return path.along_path(axis=path.axis, aircraft=aircraft, cov_aircraft=covariance, time_s=time)
