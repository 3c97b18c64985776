"""Poses added between the rows of a path, or on an orbit, until P_D and its bound are resolved.

Between two rows the position is on a straight line. The line is in latitude and longitude if the
path follows the curve of the earth. The attitude turns the short way at a constant rate. The
covariance is interpolated linearly. A mission has the same states between rows.

Between two azimuths of an orbit the position is on the circle, and the attitude is constant.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from radar_sense.model.geometry import body_vector
from radar_sense.propagation import Moments
from radar_sense.scenario import Scenario
from radar_sense.states import POSITION, RADAR, FloatArray

#: Largest turn of the aspect [rad] between two poses, for a smooth RCS and for an RCS with lobes.
SMOOTH_ASPECT, LOBED_ASPECT = np.deg2rad(5.0), np.deg2rad(1.0)
#: Largest distance between two poses, as a part of the range of each radar.
LARGEST_MOVE = 0.1
#: Shorter steps of a path [s] and of an orbit [deg] are not halved, because P_D jumps at a horizon.
SHORTEST, SHORTEST_ARC = 0.2, 0.01
#: Most poses of a refined path.
MAX_POSES = 20_000
#: P_D and its bound may differ from straight lines between poses by the smaller of
#: RELATIVE_TOLERANCE · limit and TOLERANCE.
RELATIVE_TOLERANCE, TOLERANCE = 0.01, 0.002


@dataclass(frozen=True, eq=False)
class Refined:
    """A path or an orbit with added poses.

    Attributes:
        scenario: The scenario of n poses.
        moments: The moments of P_D (n,).
        rows: Numbers (m,) of the poses that are rows of the path, or azimuths of the orbit.
        resolved: Whether the poses resolve P_D.
        tolerance: Tolerance of P_D and its bound between poses; None if no poses can be added.
    """

    scenario: Scenario
    moments: Moments
    rows: NDArray[np.intp]
    resolved: bool
    tolerance: float | None

    @property
    def added(self) -> int:
        """Number of poses between the rows."""
        return len(self.scenario.aircraft) - len(self.rows)


def can_refine(scenario: Scenario) -> bool:
    """Return whether poses can be added between the poses of a scenario.

    A path of two rows or more can be refined, and an orbit of two azimuths or more. With
    `geometry.interpolate` the user has chosen all poses.
    """
    return scenario.geometry.continuous


def resolve(scenario: Scenario, propagate: Callable[[Scenario], Moments], limit: float) -> Refined:
    """Return a scenario with poses added to compare P_D and its bound with a limit.

    A scenario that `can_refine` excludes is returned unchanged.

    Args:
        scenario: The scenario.
        propagate: Returns the moments of a scenario.
        limit: The limit, which sets the tolerance.
    """
    moments = propagate(scenario)
    if not can_refine(scenario):
        return unrefined(scenario, moments)
    return refined(scenario, moments, propagate, min(TOLERANCE, RELATIVE_TOLERANCE * limit))


def unrefined(scenario: Scenario, moments: Moments) -> Refined:
    """Return a scenario and its moments without poses between the rows."""
    return Refined(scenario, moments, np.arange(len(moments.p_d)), True, None)


def unresolved(path: Refined) -> str:
    """Return the message about poses that do not resolve P_D, with the remedy."""
    scenario = path.scenario
    key = "geometry.azimuth_deg" if scenario.time_s is None else "geometry.interpolate"
    return f"P_D is not resolved by {len(scenario.axis)} poses: choose steps with {key}"


def refined(
    scenario: Scenario,
    moments: Moments,
    propagate: Callable[[Scenario], Moments],
    tolerance: float,
) -> Refined:
    """Return a scenario with poses added until P_D and its upper bound are linear between poses.

    First, steps are halved by geometry. In one step the aspect of each radar may turn by a few
    degrees. The aircraft may move by a tenth of the range. Then steps are halved until P_D and its
    bound are within the tolerance of straight lines. Second differences estimate the distance.

    Args:
        scenario: The scenario of a path or an orbit, see `can_refine`.
        moments: Moments of P_D at the poses of the scenario.
        propagate: Returns the moments of a scenario.
        tolerance: Largest distance of P_D and its bound from straight lines.
    """
    place = scenario.geometry.coordinate
    shortest = SHORTEST_ARC if scenario.time_s is None else SHORTEST
    n = len(place)
    row = np.arange(n)  # number of the row, or −1
    while len(place) < MAX_POSES:
        coarse = coarse_steps(along(scenario, place)) & (abs(np.diff(place)) > shortest)
        if not coarse.any():
            break
        place, row = _halved(place, row, coarse)
    if len(place) > n:
        values = propagate(along(scenario, place[row < 0]))
        moments = _merged(moments, values, row)
    while len(place) < MAX_POSES:
        bends = _bend(place, moments.p_d) > tolerance
        bends |= _bend(place, moments.upper) > tolerance
        bends &= abs(np.diff(place)) > shortest
        if not bends.any():
            break
        place, new = _halved(place, np.arange(len(place)), bends)
        row = np.where(new < 0, -1, row[new])
        moments = _merged(moments, propagate(along(scenario, place[new < 0])), new)
    return Refined(
        _with_rows(scenario, place, row) if len(place) > n else scenario,
        moments,
        np.flatnonzero(row >= 0),
        len(place) < MAX_POSES,
        tolerance,
    )


def along(scenario: Scenario, place: FloatArray) -> Scenario:
    """Return the scenario at other times (k,) [s] of the path, or azimuths [deg] of the orbit."""
    return scenario.along(scenario.geometry.at(place))


def coarse_steps(path: Scenario) -> NDArray[np.bool_]:
    """Return the steps (n − 1,) in which the aspect or the range of a radar changes much."""
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


def _bend(place: FloatArray, values: FloatArray) -> FloatArray:
    """Return the distance (n − 1,) of values from straight lines between poses; 0 if unknown.

    The distance is h²/8 times the second derivative, the greater derivative of the two ends.
    """
    step = np.diff(place)
    if len(step) < 2:
        return np.zeros(len(step))
    slope = np.diff(values) / step
    second = np.abs(2.0 * np.diff(slope) / (place[2:] - place[:-2]))
    greater = np.fmax(np.append(second, second[-1]), np.insert(second, 0, second[0]))
    bend: FloatArray = np.nan_to_num(0.125 * step**2 * greater)
    return bend


def _halved(
    place: FloatArray, row: NDArray[np.intp], steps: NDArray[np.bool_]
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return places and rows, with a place in the middle of some steps added as row −1."""
    after = np.flatnonzero(steps) + 1
    middle = 0.5 * (place[after - 1] + place[after])
    return np.insert(place, after, middle), np.insert(row, after, -1)


def _merged(old: Moments, new: Moments, row: NDArray[np.intp]) -> Moments:
    """Return moments with the old moments by number in `row`, and new moments where `row` is −1."""
    arrays = []
    for field in fields(Moments):
        values, added = getattr(old, field.name), getattr(new, field.name)
        merged = np.empty(len(row), dtype=values.dtype)
        merged[row >= 0], merged[row < 0] = values[row[row >= 0]], added
        arrays.append(merged)
    return Moments(*arrays)


def _with_rows(scenario: Scenario, place: FloatArray, row: NDArray[np.intp]) -> Scenario:
    """Return the scenario at some places, with the states of the rows unchanged to the last bit."""
    geometry = scenario.geometry.at(place)
    at_row = np.flatnonzero(row >= 0)
    aircraft = geometry.aircraft.copy()
    aircraft[at_row] = scenario.aircraft[row[at_row]]
    covariance = geometry.covariance
    if covariance is not None:
        covariance = covariance.copy()
        covariance[at_row] = scenario.cov_aircraft[row[at_row]]
    return scenario.along(dataclasses.replace(geometry, aircraft=aircraft, covariance=covariance))
