"""Checks of a method of propagation: the poses where its moments are unreliable.

A check costs more than `linear` and `probit` themselves. An analysis calls it once, on the total,
and shows its warning.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from radar_sense.covariance import square_root, variance_along
from radar_sense.propagation import form as _form
from radar_sense.propagation.aspect_scan import scan_aspects
from radar_sense.propagation.gaussian_states import BLOCK, UncertainStates
from radar_sense.propagation.moments import BOUND_CHANGE, STD_CHANGE, Moments, differ
from radar_sense.propagation.relative_probit import RelativeProbit
from radar_sense.propagation.second_order import (
    Invariants,
    invariants,
    invariants_of_independent,
)
from radar_sense.propagation.standard_space import StandardNormalSpace
from radar_sense.states import AIRCRAFT, FloatArray, components_of

#: Draws about each centre in a check by draws.
DRAWS = 256
#: Poses of a block without draws for each pose of a block with draws.
DRAWN_POINTS = 128
#: Fraction of BOUND_CHANGE that a check by draws allows. The rest is for the sampling error.
SAFETY = 0.7
#: Change of σ that a check by draws allows, as a fraction of the greater of σ and SMALL_STD.
DRAWN_STD_CHANGE, SMALL_STD = 0.03, 1e-3

#: Numbers per pose and radar in the second derivatives of z by the states of one radar (7 × 7).
RADAR_NUMBERS = 50

#: Least distance of the limits of a radar from u = 0 along each axis. A limit at the distance 3
#: across the three axes of a position is at 3√3 along each axis.
REACH = 5.2


def second_order_matters(
    states: UncertainStates, moments: Moments, beta: float
) -> NDArray[np.bool_]:
    """Return where (k,) the second-order terms of z would change the moments of P_D, or σ of z.

    g is the gradient of z by u, and H are the second derivatives. To second order, z has the mean
    z(0) + tr H/2 and the variance gᵀg + tr H²/2. The third cumulant is 3 gᵀHg + tr H³. σ of z is
    compared too, because a P_D that is nearly always 0 or 1 hides a change of z.
    """
    unreliable = limit_matters(states, moments.std, beta)
    for poses, radars in states.sight():
        seen = states.part(poses, radars)
        unreliable[poses] |= _expansion_differs(seen, moments.at(poses), beta)
    return unreliable


def _expansion_differs(states: UncertainStates, moments: Moments, beta: float) -> NDArray[np.bool_]:
    """Return `second_order_matters` (k,) within the limits of the radars."""
    parts, off = [], []
    lobed, independent = states.model.rcs.lobed, states.has_independent_radars
    numbers_a_pose = _numbers(states)
    if independent and not lobed:  # the matrices of one radar after the other
        numbers_a_pose = RADAR_NUMBERS * len(states.log_constant)
    for part, std_and_bounds in _blocks(states, moments, numbers_a_pose):
        probit = RelativeProbit(part)
        # A lobe may be as narrow as the differences are wide.
        expansion = probit.derivatives(sides=2 if lobed else 1)
        if independent:
            numbers, along = invariants_of_independent(expansion, part.cov_aircraft, part.cov_radar)
        else:
            numbers, along = invariants(expansion, probit.covariance)
        parts.append(numbers)
        off.append(_expansion_is_off(probit, numbers, along, beta))
        if lobed:
            off[-1] |= _lobe_beyond(probit, std_and_bounds, beta)
    # What follows takes few arrays, and is computed for all blocks together.
    z = Invariants(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
    variance = z.slope + 0.5 * z.trace_of_square
    third = 3.0 * z.curvature + z.trace_of_cube
    cube = variance**1.5  # 0 for variances below 1e-216
    skewness = third / np.where(cube > 0, cube, 1.0)
    better = _skewed(z.value + 0.5 * z.trace, np.sqrt(variance), skewness, beta)
    unreliable: NDArray[np.bool_] = (
        differ((moments.std, moments.lower, moments.upper), better)
        | ~(variance <= (1.0 + STD_CHANGE) ** 2 * z.slope)
        | np.concatenate(off)
    )
    return unreliable


def _expansion_is_off(
    probit: RelativeProbit, z: Invariants, along: FloatArray, beta: float
) -> NDArray[np.bool_]:
    """Return where (k,) the second-order expansion of z is off a distance β along the gradient."""
    known = np.isfinite(z.slope + z.curvature) & (z.slope > 0)  # other tests warn elsewhere
    step = beta / np.sqrt(np.where(known, z.slope, np.inf))
    error = np.where(known, along, 0.0) * step
    exact = probit.p_d(np.stack([error, -error], axis=1))
    rise = step * np.where(known, z.slope, 0.0)
    middle = z.value + 0.5 * np.where(known, z.curvature, 0.0) * step * step
    expanded = np.stack([middle + rise, middle - rise])
    change = np.abs(exact - ndtr(np.maximum(expanded, probit.floor)))
    off: NDArray[np.bool_] = change.max(axis=0) > BOUND_CHANGE
    return off


def _lobe_beyond(
    probit: RelativeProbit, std_and_bounds: tuple[FloatArray, FloatArray, FloatArray], beta: float
) -> NDArray[np.bool_]:
    """Return where (k,) a lobe of the RCS within the ball |u| ≤ β takes P_D beyond a bound."""
    sqrt_cov = probit.sqrt_cov
    scanned = scan_aspects(
        probit, np.broadcast_to(sqrt_cov, (len(probit.states), *sqrt_cov.shape[1:])), beta
    )
    _, lower, upper = std_and_bounds
    floor = probit.floor
    highest = ndtr(np.maximum(scanned.promise.max(axis=0), floor))
    lowest = ndtr(np.maximum(scanned.threat.min(axis=0), floor))
    beyond: NDArray[np.bool_] = ~(
        (highest <= upper + BOUND_CHANGE) & (lowest >= lower - BOUND_CHANGE)
    )
    return beyond


def form_is_off(states: UncertainStates, moments: Moments, beta: float) -> NDArray[np.bool_]:
    """Return where (k,) the moments by `form` are unreliable.

    `form` marks the poses that are suspect. Draws at these poses decide.
    """
    blocks = _blocks(states, moments, _numbers(states))
    limit = np.concatenate(
        [limit_matters(part, std_and_bounds[0], beta) for part, std_and_bounds in blocks]
    )
    off: NDArray[np.bool_] = ~moments.converged | limit
    suspect = np.flatnonzero(moments.suspect & ~off)
    suspects = states.at(suspect)
    for poses, radars in suspects.sight():
        rows, seen = suspect[poses], suspects.part(poses, radars)
        drawn = _blocks(seen, moments.at(rows), DRAWN_POINTS * _numbers(seen))
        off[rows] = np.concatenate([_draws_refute(*part, beta) for part in drawn])
    return off


def _draws_refute(
    states: UncertainStates, std_and_bounds: tuple[FloatArray, FloatArray, FloatArray], beta: float
) -> NDArray[np.bool_]:
    """Return where (k,) weighted draws show that σ or a bound is off.

    The draws are from a mixture of unit normals about u = 0 and about the extremes. The mixture
    puts enough draws beyond the bounds (G. I. Schuëller and R. Stix, Structural Safety 4(4), 1987).
    """
    space = StandardNormalSpace.of(states, idle=True)
    r, k = space.gradient.shape
    if not k:
        return np.zeros(0, dtype=bool)
    solution = _form.quantiles(space, np.array([-beta, beta]), beta)
    means = np.concatenate([np.zeros((r, 1, k)), solution.extreme, solution.nearest], axis=1)
    # An extreme that both searches have found is one centre.
    distinct = np.ones(means.shape[1:], dtype=bool)
    for number in range(2, len(distinct)):
        same = np.all(means[:, 1:number] == means[:, number : number + 1], axis=0)
        distinct[number] = ~same.any(axis=0)
    pose, centre = np.nonzero(distinct.T)
    u = means[:, centre, pose, np.newaxis] + _normals(r)[:, np.newaxis]
    # ratio of the density of the mixture to the density of the unit normals
    density = np.zeros(u.shape[1:])
    for i in np.flatnonzero(distinct.any(axis=1)).tolist():
        mean = means[:, i, pose]
        exponent = np.einsum("rp,rpd->pd", mean, u) - 0.5 * np.sum(mean * mean, axis=0)[:, None]
        density += np.where(distinct[i, pose, None], np.exp(exponent), 0.0)
    first = np.flatnonzero(centre == 0)

    def total(values: FloatArray) -> FloatArray:
        """Return sums (k,) over all draws at a pose."""
        return np.asarray(np.add.reduceat(values.sum(axis=1), first))

    weights = 1.0 / density
    weights /= total(weights)[pose, None]
    error = np.einsum("pir,rpd->ipd", space.sqrt_cov[pose], u)
    p_d = space.probit.p_d(error.reshape(len(error), -1), np.repeat(pose, DRAWS))
    p_d = p_d.reshape(weights.shape)
    mean = total(weights * p_d)
    drawn_std = np.sqrt(total(weights * np.square(p_d - mean[pose, None])))
    tail, slack = float(ndtr(-beta)), BOUND_CHANGE * SAFETY
    std, lower, upper = std_and_bounds
    low, high = lower[pose, None], upper[pose, None]
    refuted: NDArray[np.bool_] = (
        (total(weights * (p_d > high + slack)) > tail)
        | (total(weights * (p_d >= high - slack)) < tail)
        | (total(weights * (p_d < low - slack)) > tail)
        | (total(weights * (p_d <= low + slack)) < tail)
        | (np.abs(std - drawn_std) > DRAWN_STD_CHANGE * np.maximum(drawn_std, SMALL_STD))
    )
    return refuted


@cache
def _normals(r: int) -> FloatArray:
    """Return unit normals (r, DRAWS) from a Sobol' sequence, the same in every call."""
    from scipy.stats import qmc  # slow to import

    points = qmc.Sobol(r, scramble=True, rng=1).random(DRAWS)
    return np.asarray(ndtri(points.T))


def limit_matters(states: UncertainStates, std: FloatArray, beta: float) -> NDArray[np.bool_]:
    """Return where (k,) a limit of a radar is within reach and changes the moments of P_D.

    A limit within reach adds at most p²/4 to the variance of P_D, with p a bound of the radar's
    P_D. The limit is ignored where p²/4 changes σ by less than a quarter of STD_CHANGE and p is
    less than BOUND_CHANGE. The quarter allows for correlation with the other terms.
    """
    k, m = len(states), len(states.log_constant)
    matters = np.zeros(k, dtype=bool)
    if not states.model.limited:
        return matters
    aircraft, radar = states.aircraft, states.radar
    visible = states.model.visible(aircraft, radar)
    near = np.zeros((k, m), dtype=bool)
    for size in (REACH, -REACH):
        for error in np.moveaxis(size * square_root(states.cov_aircraft), -1, 0):
            near |= states.model.visible(aircraft + error, radar) != visible
        for error in np.moveaxis(size * square_root(states.cov_radar), -1, 0):
            near |= states.model.visible(aircraft, radar + error) != visible
    allowed = np.minimum(BOUND_CHANGE, np.sqrt(2.0 * STD_CHANGE) * std)
    for i in np.flatnonzero(near.any(axis=0)):
        components = components_of([int(i)], m, radar.shape[-1])
        z, by_aircraft, by_radar = states.model.models[i].linearize_probit(
            aircraft, radar[:, components]
        )
        variance = variance_along(by_aircraft, states.cov_aircraft)
        variance = variance + variance_along(
            by_radar, states.cov_radar[:, components][..., components]
        )
        matters |= near[:, i] & ~(ndtr(z + beta * np.sqrt(variance)) <= allowed)
    return matters


def _blocks(
    states: UncertainStates, moments: Moments, numbers: int
) -> Iterator[tuple[UncertainStates, tuple[FloatArray, FloatArray, FloatArray]]]:
    """Cut states, and σ and bounds of their moments, into blocks of poses."""
    start = 0
    for part in states.blocks(numbers):
        poses = slice(start, start + len(part))
        yield part, (moments.std[poses], moments.lower[poses], moments.upper[poses])
        start += len(part)


def _numbers(states: UncertainStates) -> int:
    """Return the numbers per pose in the largest array of a check."""
    return 2 * (len(AIRCRAFT) + int(states.radar.shape[-1])) ** 2


def _skewed(
    m: FloatArray, s: FloatArray, skewness: FloatArray, beta: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return σ and bounds (k,) of Φ(z) where z is m + s (u + γ (u² − 1)/6), γ its skewness.

    (E. A. Cornish and R. A. Fisher, Rev. Inst. Int. Statist. 5(4), 1937.)
    """
    u, weights = _gauss_hermite()
    side = np.where(m > 0, -1.0, 1.0)
    terms = np.stack([m, s, s * skewness / 6.0])
    std = np.empty(m.shape)
    for start in range(0, len(m), BLOCK):  # arrays of 16 numbers a pose stay in a cache
        poses = slice(start, start + BLOCK)
        # of P_D and 1 − P_D: none rounds to 1
        lesser = _hermite(u) @ (side[poses] * terms[:, poses])
        ndtr(lesser, out=lesser)
        lesser -= weights @ lesser
        std[poses] = np.sqrt(weights @ np.square(lesser, out=lesser))
    ends = ndtr(_hermite(np.array([-beta, beta])) @ terms)
    return np.where(s == 0, 0.0, std), ends.min(axis=0), ends.max(axis=0)


def _hermite(u: FloatArray) -> FloatArray:
    """Return 1, u and u² − 1 (n, 3)."""
    return np.stack([np.ones_like(u), u, u * u - 1.0], axis=1)


@cache
def _gauss_hermite() -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights (16,) of integrals over the normal distribution."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(16)
    return nodes, weights / weights.sum()
