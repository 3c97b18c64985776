"""Poses added between the poses of a flight, until P_D and its bound are resolved.

Between two rows the aircraft flies as `flight.Path` says. A mission has the same states between
rows.

Between two azimuths of an orbit the position is on the circle, and between two ranges of a radial
on the line. The attitude is constant.

No lobe of an RCS, node of a table, gain or mask fits between two poses of the test, and those where
a radar is closest or a limit is nearest or crossed are among them. This does not depend on P_D of
the nominal states: errors may reach a lobe, a gap or a limit that the nominal states do not. The
peaks and troughs of P_D are among them, too: the gap between two lobes may be much narrower than a
lobe.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from radar_sense.acceptance.requirement import Requirement
from radar_sense.flight import CERTAIN
from radar_sense.limits import MIN_RANGE
from radar_sense.model.fusion import UNSEEN, fuse_probits
from radar_sense.model.geometry import body_vector, join, slant_range
from radar_sense.propagation import Band
from radar_sense.scenario import Scenario
from radar_sense.search import golden_section
from radar_sense.states import POSITION, FloatArray

#: Largest turn between two poses [rad], of the aspect and of the direction from a radar. It is also
#: PART of a lobe of the RCS, or of the distance of two nodes of a table, gain or mask: less than a
#: half, with which all poses may lie half way between top and gap.
LARGEST_TURN, PART = np.deg2rad(5.0), 0.45
#: Largest distance between two poses, as a part of the range of each radar. Rows are left out
#: where a covariance changes by less than this part of its variances.
LARGEST_MOVE = 0.1
#: Most poses between the rows of a flight.
MAX_POSES = 20_000
#: P_D and its bound may differ from straight lines between poses by the smaller of
#: RELATIVE_TOLERANCE · the room of the limit and TOLERANCE, and by RELATIVE_TOLERANCE · their
#: distance beyond the limit. A bound within the limit may differ by no more than its distance to
#: the limit, down to CLOSEST of this. That is two more halvings, of which each leaves a quarter of
#: the difference.
RELATIVE_TOLERANCE, TOLERANCE, CLOSEST = 0.01, 0.002, 1.0 / 16.0
#: Decimals of the places of closest points and crossings, and a unit of the last one.
DECIMALS = 6
UNIT = 10.0**-DECIMALS
#: Differences below this part of the greatest value are rounding, and no maximum is searched there.
ROUNDING = 1e-12
#: Part of the distance by which an aircraft that is straight above or below a radar, in its own
#: frame, is aside by rounding.
ABOVE = 1e-9
#: Steps of a search: a bracket of a closest point shrinks to 4e-9 of itself, one of a crossing to
#: 2⁻⁴⁰.
SEARCH = 40


@dataclass(frozen=True, eq=False)
class Refined:
    """A flight with added poses.

    Attributes:
        scenario: The scenario of n poses.
        band: The band of P_D (n,).
        rows: Numbers (m,) of the poses that were given.
        resolved: Whether the poses resolve P_D.
        tolerance: Tolerance of P_D and its bound between poses; None if no poses can be added.
    """

    scenario: Scenario
    band: Band
    rows: NDArray[np.intp]
    resolved: bool
    tolerance: float | None

    @property
    def added(self) -> int:
        """Number of poses between the rows."""
        return len(self.scenario.aircraft) - len(self.rows)


def unresolved() -> str:
    """Return the message about poses that do not resolve P_D, with the remedy."""
    return f"P_D is not resolved by {MAX_POSES:,} poses between the rows: test a shorter part"


def resolve(
    scenario: Scenario, propagate: Callable[[Scenario], Band], requirement: Requirement, band: Band
) -> Refined:
    """Return a scenario with poses added until P_D and its bound are linear between poses.

    `band` is the band of its poses. Without a flight the scenario is returned unchanged.

    Poses are added as in `places`. Then steps are halved until P_D and its bound are within the
    tolerance of straight lines, and a bound near the limit within less, see `CLOSEST`: it may be
    beyond the limit in the middle of a step. Second differences estimate the distance from the
    lines. Two standard errors of a bound are no bend. P_D is not resolved if this takes more than
    `MAX_POSES` poses. If the places alone are more, only the place with the least margin of P_D is
    added.
    """
    if not scenario.geometry.continuous:
        return Refined(scenario, band, np.arange(len(band.p_d)), True, None)
    tolerance = min(TOLERANCE, RELATIVE_TOLERANCE * requirement.room)
    given, shortest = scenario.geometry.coordinate, scenario.geometry.shortest
    order, most = -1 if given[0] > given[-1] else 1, len(given) + MAX_POSES

    added = places(scenario, lowest=requirement.at_least)
    along(_nominal(scenario), added).check_ranges()
    place, new = given, np.setdiff1d(added, given)[::order]
    resolved = len(place) + len(new) < most
    if not resolved:
        margin = requirement.margin(along(_nominal(scenario), new).p_d())
        new = new[[margin.argmin()]]
    while True:
        if new.size:
            place = np.concatenate([place, new])
            ranked = np.argsort(order * place)
            band = Band.join([band, propagate(along(scenario, new))]).at(ranked)
            place = place[ranked]
        noise, bound = 2.0 * np.maximum(band.error[1:], band.error[:-1]), requirement.bound(band)
        margin = requirement.margin(bound)
        within = np.minimum(margin[1:], margin[:-1])
        near = np.clip(within, CLOSEST * tolerance, tolerance)
        allowed = np.where(within >= 0, near, _tolerance(margin, tolerance))
        bent = _bend(place, bound) > allowed + noise
        if not requirement.width:
            bent |= _bend(place, band.p_d) > _tolerance(requirement.margin(band.p_d), tolerance)
        new = _middles(place)[bent & (abs(np.diff(place)) > shortest)]
        resolved &= len(place) + len(new) < most
        if not (resolved and new.size):
            break
    return Refined(
        along(scenario, place) if len(place) > len(given) else scenario,
        band,
        np.flatnonzero(np.isin(place, given)),
        resolved,
        tolerance,
    )


def _tolerance(margin: FloatArray, least: float) -> FloatArray:
    """Return the tolerance (n − 1,) of values with a margin (n,), above the least far beyond."""
    return np.fmax(least, -RELATIVE_TOLERANCE * np.maximum(margin[1:], margin[:-1]))


def along(scenario: Scenario, place: FloatArray) -> Scenario:
    """Return the scenario at other coordinates (k,) of its flight, in any order."""
    return scenario.along(scenario.geometry.at(place))


def coarseness(path: Scenario, *, lobes: bool = True) -> FloatArray:
    """Return how much (n − 1,) aspect and range of a radar change in each step: above 1 too much.

    Where the gain or a mask depends on the direction from the radar, it may not turn more.

    Args:
        path: The poses.
        lobes: Whether a step may be no longer than `PART` of the finest detail of a radar.
    """
    changes = np.zeros(len(path.aircraft) - 1)
    for single, radar in zip(path.radars, path.radar_states, strict=True):
        rcs, by_direction = single.model.rcs, [f.detail for f in single.model.factors]
        if single.mask is not None:
            by_direction.append(single.mask.detail)
        finest = min([rcs.detail, *by_direction]) if lobes else math.inf
        largest = min(LARGEST_TURN, PART * finest)
        line = path.aircraft[:, POSITION] - radar[POSITION]
        distance = np.linalg.norm(line, axis=1)
        moved = np.linalg.norm(np.diff(line, axis=0), axis=1)
        moved /= np.maximum(np.minimum(distance[1:], distance[:-1]), MIN_RANGE)
        turns = min(by_direction, default=math.inf) < math.inf
        changes = np.maximum(
            changes, moved / (min(LARGEST_MOVE, largest) if turns else LARGEST_MOVE)
        )
        if rcs.isotropic:
            continue
        x, y, z = body_vector(path.aircraft, radar).T
        across = np.hypot(x, y)
        turn = abs(np.diff(np.unwrap(np.arctan2(y, x))))
        # an azimuth straight above or below is rounding
        turn[np.minimum(across[1:], across[:-1]) <= ABOVE * distance[1:]] = 0.0
        turn = np.maximum(turn, abs(np.diff(np.arctan2(z, across))))
        changes = np.maximum(changes, turn / largest)
    return changes


@lru_cache(maxsize=2)  # a test and the warning of a far origin need the same places
def places(scenario: Scenario, *, lowest: bool = False) -> FloatArray:
    """Return coordinates (k,) of a flight, ascending, between which no lobe, gap or limit fits.

    These are the poses and rows of the flight, see `_rows`, the middles of coarse steps, the
    closest point to each radar, the point nearest to its limits, both sides of each crossing of a
    limit, the peaks and troughs of P_D, also of each radar alone, the peaks of the spread of an
    RCS, and a place just before each waypoint at which the course jumps. Where the lowest P_D
    matters, the farthest points are among them, and those deepest beyond a limit. Steps are halved
    until `MAX_POSES` coordinates are added. With more, some steps may still be coarse.
    """
    nominal, shortest = _nominal(scenario), scenario.geometry.shortest
    place = _rows(scenario, lowest=lowest)
    most = len(scenario.geometry.axis) + MAX_POSES
    while len(place) < most:
        coarse = (coarseness(along(nominal, place)) > 1.0) & (np.diff(place) > shortest)
        if not coarse.any():
            break
        place = np.sort(np.append(place, _middles(place)[coarse]))
    of_peaks = [_nearness, _margins, _probits, _spreads]
    of_troughs = [_nearness, _margins, _probits] if lowest else [_probits]
    for sign, functions in ((1.0, of_peaks), (-1.0, of_troughs)):
        for function in functions:
            place = np.union1d(place, _maxima(nominal, place, function, sign))
    place = np.union1d(place, _crossings(nominal, place))
    before = np.intersect1d(scenario.geometry.turns, place) - UNIT
    return np.union1d(place, before[before > place[0]])


def _rows(scenario: Scenario, *, lowest: bool) -> FloatArray:
    """Return coordinates (k,) of the poses and of rows of the flight between them, ascending.

    Rows between which aspect, range and covariance change little are parts of the flight. Of each
    part the first row is returned, and those where P_D is greatest, a radar is closest, its limits
    are nearest, and a variance is greatest. Where the lowest P_D matters, the rows with the least
    of each are returned, too.
    """
    geometry = scenario.geometry
    whole = scenario.along(geometry.whole)
    place = whole.geometry.coordinate
    if len(place) == len(geometry.axis):
        return np.sort(place)
    changes, values = coarseness(whole), [_nearness(whole), _margins(whole), _probits(whole)]
    if whole.cov_aircraft.ndim == 3:
        changes = np.maximum(changes, _scattering(whole.cov_aircraft))
        values.append(np.diagonal(whole.cov_aircraft, axis1=1, axis2=2))
    if lowest:
        values += [-value for value in values]
    part = np.insert(np.floor(np.cumsum(np.minimum(changes, 1.0))), 0, -1.0)
    kept = np.isin(place, geometry.coordinate) | (np.diff(part, prepend=-2.0) > 0)
    for value in np.hstack(values).T:
        order = np.lexsort((value, part))
        kept[order[np.diff(part[order], append=np.inf) > 0]] = True
    return place[kept]


def _scattering(covariance: FloatArray) -> FloatArray:
    """Return how much (n − 1,) a covariance (n, 6, 6) changes in each step: above 1 too much."""
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    std = np.maximum(std[1:], std[:-1])
    scale, change = std[:, :, np.newaxis] * std[:, np.newaxis], abs(np.diff(covariance, axis=0))
    relative = np.divide(change, scale, out=np.zeros_like(change), where=scale > 0)
    return relative.max(axis=(1, 2)) / LARGEST_MOVE


def _nominal(scenario: Scenario) -> Scenario:
    """Return the scenario without covariances, which its nominal states do not need."""
    return scenario.along(dataclasses.replace(scenario.geometry, covariance=CERTAIN))


def _nearness(poses: Scenario) -> FloatArray:
    """Return minus the slant range (n, m) [m] of each radar."""
    return join([-slant_range(poses.aircraft, state) for state in poses.radar_states])


def _margins(poses: Scenario) -> FloatArray:
    """Return the distance (n, j) [m] to the nearest limit of each radar that has limits.

    It is negative beyond the limit.
    """
    each = zip(poses.radars, poses.radar_states, strict=True)
    margins = [radar.margin(poses.aircraft, state) for radar, state in each if radar.limited]
    return join(margins) if margins else np.empty((len(poses.aircraft), 0))


def _probits(poses: Scenario) -> FloatArray:
    """Return the probit of P_D (n, 1 + m): of all radars, and of each without its limits.

    Between two poses where P_D is 1 there may be a gap. A radar that fills the gap of another one
    may do so at the nominal states alone.
    """
    each = zip(poses.model.models, poses.radar_states, strict=True)
    snr = [(model, model.unchecked_snr(poses.aircraft, state)) for model, state in each]
    z = np.stack([model.detector.linearize_probit(s, model.p_fa)[0] for model, s in snr])
    z = np.clip(np.nan_to_num(z, nan=-UNSEEN), UNSEEN, -UNSEEN)
    visible = poses.model.visible(poses.aircraft, poses.radar).T
    return np.vstack([fuse_probits(np.where(visible, z, UNSEEN)), z]).T


def _spreads(poses: Scenario) -> FloatArray:
    """Return the spread (n, j) [dB] of each RCS that has one by aspect."""
    each = zip(poses.model.models, poses.radar_states, strict=True)
    spreads = [
        spread.cross_section(body_vector(poses.aircraft, state))
        for model, state in each
        if (spread := getattr(model.rcs, "spread", None)) is not None
    ]
    return join(spreads) if spreads else np.empty((len(poses.aircraft), 0))


def _maxima(
    scenario: Scenario, place: FloatArray, value: Callable[[Scenario], FloatArray], sign: float
) -> FloatArray:
    """Return the places (j,) of the maxima of functions (n, m) of the poses, by golden sections.

    With the sign −1 those of the minima.

    The greatest value may lie beside the first or the last place, too.
    """
    values = sign * value(along(scenario, place))
    before, after = np.vstack([values[:1], values[:-1]]), np.vstack([values[1:], values[-1:]])
    # along a circle about a radar all distances are equal but for rounding
    slack = ROUNDING * abs(values).max(axis=0, initial=0.0)
    flat = values - np.minimum(before, after) <= slack
    top, number = np.nonzero((values >= before - slack) & (values >= after - slack) & ~flat)
    low, high = place[np.maximum(top - 1, 0)], place[np.minimum(top + 1, len(place) - 1)]

    def each(x: FloatArray) -> FloatArray:
        return sign * value(along(scenario, x))[np.arange(len(x)), number]

    if top.size:
        _, low = golden_section(each, low, high, SEARCH)
    return np.clip(np.round(low, DECIMALS), place[0], place[-1])


def _crossings(scenario: Scenario, place: FloatArray) -> FloatArray:
    """Return the places on both sides of each crossing of a limit, where a margin changes sign."""
    seen = _margins(along(scenario, place)) >= 0
    crossing, number = np.nonzero(seen[1:] != seen[:-1])
    low, high, first = place[crossing], place[crossing + 1], seen[crossing, number]
    for _ in range(SEARCH if crossing.size else 0):
        middle = 0.5 * (low + high)
        margins = _margins(along(scenario, middle))
        same = (margins[np.arange(len(middle)), number] >= 0) == first
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.concatenate([np.floor(low / UNIT) * UNIT, np.ceil(high / UNIT) * UNIT])


def _bend(place: FloatArray, values: FloatArray) -> FloatArray:
    """Return the distance (n − 1,) of values from straight lines between poses.

    The distance is h²/8 times the second derivative, the greater of those at the two ends. At the
    crossing of a limit P_D may jump, and has no second derivative. Where both ends of a step are at
    crossings, and between the only two poses, the distance is infinite. It is 0 beside a pose
    without a value.
    """
    step = np.diff(place)
    if len(step) < 2:
        return np.full(len(step), np.inf)
    slope, crossing = np.diff(values) / step, abs(step) < 2.0 * UNIT
    second = np.nan_to_num(abs(2.0 * np.diff(slope) / (place[2:] - place[:-2])))
    second[crossing[1:] | crossing[:-1]] = np.nan
    greater = np.fmax(np.append(second, second[-1]), np.insert(second, 0, second[0]))
    return np.nan_to_num(0.125 * step**2 * greater, nan=np.inf)


def _middles(place: FloatArray) -> FloatArray:
    """Return the middle of each step (n − 1,)."""
    return 0.5 * (place[:-1] + place[1:])
