"""Rays from a radar, the aircraft on each ray, and how far along a ray P_D reaches a value.

A ray leaves the radar at one bearing. The aircraft is on the ray at one height, roll, pitch and
yaw. The distance along a ray is horizontal, in the level plane of the radar.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from radar_sense.coverage.grid import pose_in_cells, put_at_height
from radar_sense.model import geodesy
from radar_sense.model.geometry import body_vector, slant_range
from radar_sense.propagation import distribution
from radar_sense.scenario import Scenario
from radar_sense.states import AIRCRAFT, ATTITUDE, BLOCK, DOWN, POSITION, YAW, FloatArray, slices

#: Nearest and farthest distance of the search [m].
NEAREST, FARTHEST = 1.0, 5e6
#: Number of distances at which P_D is computed on a ray. Each step is 2 % of the distance. Steps in
#: which the line of sight turns by more than HALF of a lobe of RCS or antenna are halved, until
#: there are MOST_SAMPLES.
SAMPLES, MOST_SAMPLES, HALF = 768, 6144, 0.5
#: Factor from the minimum range to the end of a window that is found, in spite of the step.
NARROW = 1.001
#: Halvings of a bracket. A bracket of 2 % shrinks to 1e-14 of the distance.
HALVINGS = 42
#: Factors by which a bracket of a bound grows, in this order.
EXPANSIONS = (1.01, 1.02, 1.05, 1.1, 1.2, 1.5, 2.0, 4.0, 16.0, 256.0, 1e4, 1e6)
#: Relative error of the distance that ends a search, and |z| that counts as a root. An error of z
#: by 1e-7 is a relative error of the distance by 1e-8.
NEAR_ENOUGH, Z_TOLERANCE = 1e-10, 1e-7
#: Factor on the distance of a limit. The product is within the limit in spite of rounding.
INSIDE = 1.0 - 1e-9
#: Distance [m] from which on a range is the end of the search, and not a range.
END = INSIDE * FARTHEST
#: |z| of a P_D that is 0 or 1 to rounding.
LARGEST_PROBIT = 40.0
#: Evaluations of P_D that take as long as a ray with its band, which draws judge.
RAY = 15_000

#: Function from distances (n,) to whether (n,) the ray reaches the value there.
Reaches = Callable[[FloatArray], NDArray[np.bool_]]


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays of one radar.

    Attributes:
        scenario: The scenario of one radar, without the limits of the radar.
        limited: The same scenario with the limits.
        bearing: Bearing from the radar (n,) [rad].
        yaw: Yaw of the aircraft on each ray (n,) [rad], relative to the level plane at the
            aircraft.
        pose: State of the aircraft (6,). Only down, roll and pitch are used. With an origin, down
            is minus the height above the origin.
        aspect: Bearing of the radar from the heading (n,) [rad], which gives the yaw with an
            origin: north is another direction at each distance. None for rays of one yaw each.
    """

    scenario: Scenario
    limited: Scenario
    bearing: FloatArray
    yaw: FloatArray
    pose: FloatArray
    aspect: FloatArray | None = None

    def states(self, distance: FloatArray) -> FloatArray:
        """Return aircraft states (n, ..., 6) at distances (n, ...) [m]."""
        radar, origin = self.scenario.radar, self.scenario.origin
        of_ray = (slice(None), *[np.newaxis] * (distance.ndim - 1))
        states = np.empty((*distance.shape, len(AIRCRAFT)))
        states[...] = self.pose
        bearing = self.bearing[of_ray]
        states[..., 0], states[..., 1] = distance * np.cos(bearing), distance * np.sin(bearing)
        states[..., YAW] = self.yaw[of_ray]
        if origin is None:
            states[..., :DOWN] += radar[:DOWN]
            return states
        # first in the frame of the radar, whose level plane contains the rays
        place = geodesy.geodetic_from_ned(radar[POSITION], origin)
        states[..., DOWN] += place[2] - origin[2]
        aspect = None if self.aspect is None else self.aspect[of_ray]
        put_at_height(states, (place[0], place[1], place[2]), aspect)
        turn = geodesy.turn_to_origin(place, origin)
        states[..., POSITION] = states[..., POSITION] @ turn.T + radar[POSITION]
        states[..., ATTITUDE] = geodesy.turned_attitude(states[..., ATTITUDE], turn)
        return states

    def at(self, distance: FloatArray, *, limits: bool = False) -> Scenario:
        """Return the scenario with the poses at distances (n, ...), one pose after the other.

        It is without the limits of the radar, or with those, which errors may cross.
        """
        scenario = self.limited if limits else self.scenario
        return scenario.at_states(self.states(distance))

    def slant_range(self, distance: FloatArray) -> FloatArray:
        """Return the slant ranges (n,) [m] at distances (n,) [m]; 0 for 0, and NaN for NaN."""
        exists = np.nan_to_num(distance) > 0
        states = self.states(np.where(exists, distance, NEAREST))
        return np.where(exists, slant_range(states, self.scenario.radar), distance)

    def part(self, rays: slice | NDArray[np.intp]) -> Rays:
        """Return some of the rays."""
        aspect = None if self.aspect is None else self.aspect[rays]
        return dataclasses.replace(
            self, bearing=self.bearing[rays], yaw=self.yaw[rays], aspect=aspect
        )

    def p_d(self, distance: FloatArray, *, limits: bool = False) -> FloatArray:
        """Return P_D (n, ...) at distances (n, ...), without limits of the radar or with them."""
        model = (self.limited if limits else self.scenario).model
        return model.p_d(self.states(distance), self.scenario.radar)

    def visible(self, distance: FloatArray) -> NDArray[np.bool_]:
        """Return where (n, ...) distances (n, ...) are within the limits of the radar."""
        return self.limited.model.visible(self.states(distance), self.scenario.radar)[..., 0]

    def quantile(self, distance: FloatArray, method: str, beta: float) -> FloatArray:
        """Return the quantile of P_D (n, ...) at Φ(β) by a method at distances (n, ...)."""
        return distribution(self.at(distance), method).quantile(beta).reshape(distance.shape)


def rays(
    scenario: Scenario,
    angle: FloatArray,
    *,
    by_aspect: bool,
    down: float | None,
    course: float | None,
) -> Rays:
    """Return the rays of a scenario of one radar at bearings (n,) [rad], clockwise from north.

    With `by_aspect` the angles are bearings of the radar from the heading, in the level plane at
    the aircraft, which turns at the first pose's bearing. The first pose gives height and attitude,
    unless `down` [m] or course [rad] is given.
    """
    pose = pose_in_cells(scenario, down, course)
    (radar,) = scenario.radars
    without = dataclasses.replace(scenario, radars=(radar.without_limits(),))
    bearing, yaw = angle, np.full(len(angle), pose[YAW])
    if by_aspect:
        first = _bearing(scenario)
        bearing, yaw = np.full(len(angle), first), first + math.pi - angle
    return Rays(without, scenario, bearing, yaw, pose, angle if by_aspect else None)


@dataclass(frozen=True, eq=False)
class Reach:
    """How far the rays reach a value of P_D.

    Attributes:
        distance: Farthest distance with at least this P_D (n,) [m]; 0 where there is none.
        limited: Where (n,) a limit of the radar comes first, and P_D is still higher there.
        edges: How often (n,) P_D passes the value along a ray without limits.
    """

    distance: FloatArray
    limited: NDArray[np.bool_]
    edges: NDArray[np.intp]

    @property
    def endless(self) -> NDArray[np.bool_]:
        """Where (n,) P_D is still as high at the end of the search."""
        return np.asarray(self.distance >= END)


@dataclass(frozen=True, eq=False)
class Survey:
    """P_D and visibility at the samples of all rays, which give the brackets of a search.

    Attributes:
        all_rays: The rays.
        distance: Distance of the samples (k,) [m].
        p_d: P_D (n, k), without the limits of the radar.
        visible: Where (n, k) a sample is within the limits.
    """

    all_rays: Rays
    distance: FloatArray
    p_d: FloatArray
    visible: NDArray[np.bool_]

    def reach(self, p_d: float, *, limits: bool = True) -> Reach:
        """Return how far the rays reach a P_D, within the limits of the radar or without limits."""
        rays = self.all_rays
        inside = self.p_d >= p_d
        if limits:
            inside &= self.visible

        def reaches(distance: FloatArray) -> NDArray[np.bool_]:
            return rays.p_d(distance, limits=limits) >= p_d

        near, far = _farthest(inside, self.distance, reaches)
        distance = np.sqrt(near * far)
        # what is visible may lie between two samples, and ends at the edge of P_D or of visibility
        for edge in (self.reach(p_d, limits=False).distance, self.limit) if limits else ():
            within = edge * INSIDE
            farther = reaches(np.maximum(within, NEAREST)) & (within > distance)
            distance = np.where(farther, within, distance)
            far = np.where(farther, edge / INSIDE, far)
        # P_D at or above the value beyond the edge means that a limit made the edge.
        beyond = rays.p_d(np.maximum(far, NEAREST)) >= p_d
        limited = beyond & (distance > 0) & (distance < END)
        edges = np.count_nonzero(np.diff(self.p_d >= p_d, axis=1), axis=1)
        return Reach(distance, limited, edges)

    @functools.cached_property
    def limit(self) -> FloatArray:
        """The farthest distance (n,) [m] within the limits; 0 where there is none."""
        near, far = _farthest(self.visible, self.distance, self.all_rays.visible)
        return np.sqrt(near * far)


def survey(all_rays: Rays) -> Survey:
    """Compute P_D along all rays."""
    distance = _samples(all_rays)
    shape = len(all_rays.bearing), len(distance)
    p_d, visible = np.empty(shape), np.empty(shape, dtype=bool)
    for block in slices(len(p_d), max(1, BLOCK // len(distance))):
        rays, samples = all_rays.part(block), np.broadcast_to(distance, p_d[block].shape)
        p_d[block], visible[block] = rays.p_d(samples), rays.visible(samples)
    return Survey(all_rays, distance, p_d, visible)


def _samples(all_rays: Rays) -> FloatArray:
    """Return the distances (k,) of the samples, ascending; one is just beyond the minimum range."""
    first, (radar,) = all_rays.part(slice(0, 1)), all_rays.limited.radars
    distance = with_lobes(all_rays, np.geomspace(NEAREST, FARTHEST, SAMPLES), HALF)
    if radar.min_range > 0:
        beyond = radar.min_range * math.sqrt(min(radar.max_range / radar.min_range, NARROW))
        ends = distance[:1], distance[-1:]
        near, far = halved(*ends, lambda at: first.slant_range(at) < beyond)
        distance = np.union1d(distance, np.sqrt(near * far))
    return distance


def with_lobes(all_rays: Rays, distance: FloatArray, part: float) -> FloatArray:
    """Return ascending distances (k,) and more, so that no step is longer than a part of a lobe."""
    while len(distance) < MOST_SAMPLES:
        middle = np.sqrt(distance[1:] * distance[:-1])[lobes_passed(all_rays, distance) > part]
        if not middle.size:
            break
        distance = np.sort(np.append(distance, middle))
    return distance


def lobes_passed(all_rays: Rays, distance: FloatArray) -> FloatArray:
    """Return the turn of the line of sight (k − 1,) from each distance (k,) to the next, in lobes.

    It is alike on all rays, because the aircraft has one height on all of them. The RCS has its
    lobes in the frame of the aircraft, and the antenna in that of the radar.
    """
    (radar,), states = all_rays.limited.radars, all_rays.part(slice(0, 1)).states(distance[None])[0]
    line = states[:, POSITION] - all_rays.scenario.radar[POSITION]
    passed = np.zeros(len(distance) - 1)
    for vector, details in (
        (line, [factor.detail for factor in radar.model.factors]),
        (body_vector(states, all_rays.scenario.radar), [radar.model.rcs.detail]),
    ):
        unit = vector / np.linalg.norm(vector, axis=1, keepdims=True)
        turn = 2.0 * np.arcsin(0.5 * np.linalg.norm(np.diff(unit, axis=0), axis=1))
        passed = np.maximum(passed, turn / min(details, default=math.inf))
    return passed


def reach_of_quantile(
    seen: Survey, value: float, method: str, beta: float, guess: FloatArray
) -> FloatArray:
    """Return how far (n,) the quantile of P_D at Φ(β) by a method reaches a value.

    The distance at which P_D falls below a value is random, because P_D is uncertain. Where P_D
    falls with distance, the random distance exceeds r if P_D at r exceeds the value. The quantiles
    of the distance are therefore the distances at which the quantiles of P_D have the value.

    The distance is within the limits of the radar. It is 0 where the quantile is nowhere as high
    from the guess (n,) [m] inward, and NaN where the method has no value.
    """
    from scipy.optimize.elementwise import find_root  # slow to import

    limit = seen.limit

    def excess(rows: NDArray[np.intp], distance: FloatArray) -> FloatArray:
        """Return z of the quantile less z of the value on some rays."""
        if not len(rows):
            return np.empty(0)
        quantile = np.clip(seen.all_rays.part(rows).quantile(distance, method, beta), 0.0, 1.0)
        z = ndtri(quantile) - ndtri(value)
        return np.asarray(np.clip(z, -LARGEST_PROBIT, LARGEST_PROBIT))

    near = np.clip(guess, NEAREST, np.maximum(limit, NEAREST))
    at_near = excess(np.arange(len(near)), near)
    far, at_far = near.copy(), at_near.copy()
    for factor in EXPANSIONS:
        rows = np.flatnonzero((at_near < 0) & (near > NEAREST))  # the bound is too low here
        far[rows], at_far[rows] = near[rows], at_near[rows]
        near[rows] = np.maximum(near[rows] / factor, NEAREST)
        at_near[rows] = excess(rows, near[rows])
        rows = np.flatnonzero((at_far >= 0) & (far < limit))
        near[rows], at_near[rows] = far[rows], at_far[rows]
        far[rows] = np.minimum(far[rows] * factor, limit[rows])
        at_far[rows] = excess(rows, far[rows])
    reach = np.where(at_near < 0, 0.0, far)  # `far` is the limit if the bound is high enough there
    rows = np.flatnonzero((at_near >= 0) & (at_far < 0))
    root = find_root(
        lambda x, row: excess(row, np.exp(x)),
        (np.log(near[rows]), np.log(far[rows])),
        args=(rows,),
        tolerances={"xatol": NEAR_ENOUGH, "fatol": Z_TOLERANCE},
    )
    reach[rows] = np.exp(root.x)
    reach[np.isnan(at_near) | np.isnan(at_far)] = np.nan
    inside = np.where(reach > 0, reach * INSIDE, NEAREST)
    reach[(limit == 0) | (reach > 0) & ~seen.all_rays.visible(inside)] = 0.0
    return reach


def _farthest(
    inside: NDArray[np.bool_], distance: FloatArray, reaches: Reaches
) -> tuple[FloatArray, FloatArray]:
    """Return brackets (n,) of the farthest distance that is inside; 0 where none is.

    Where the last sample is inside, both ends are the last distance.

    Args:
        inside: Whether (n, k) the samples are inside.
        distance: Distance of the samples (k,).
        reaches: Returns whether distances (n,) are inside.
    """
    count = inside.shape[1]
    last = count - 1 - np.argmax(inside[:, ::-1], axis=1)
    near, far = halved(distance[last], distance[np.minimum(last + 1, count - 1)], reaches)
    nowhere = ~inside.any(axis=1)
    near[nowhere] = far[nowhere] = 0.0
    return near, far


def halved(near: FloatArray, far: FloatArray, reaches: Reaches) -> tuple[FloatArray, FloatArray]:
    """Return brackets (n,) of the distance, from near (n,) to far (n,), that a ray reaches."""
    for _ in range(HALVINGS):
        middle = np.sqrt(near * far)  # halves the bracket of the logarithm
        still = reaches(middle)
        near, far = np.where(still, middle, near), np.where(still, far, middle)
    return near, far


def _bearing(scenario: Scenario) -> float:
    """Return the bearing [rad] of the first pose from the radar, in the radar's level plane."""
    line = scenario.aircraft[0, POSITION] - scenario.radar[POSITION]
    if scenario.origin is not None:
        line = line @ geodesy.turn_from_level(scenario.radar[POSITION], scenario.origin)
    return math.atan2(line[1], line[0])
