"""Checks of a method of propagation: where its moments are not to be trusted.

A check is not part of a method. It costs more than `linear` and `probit` themselves, so it is made
once an analysis, on the total, where its warning is shown.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from radar_sense.covariance import square_root, variance_along
from radar_sense.propagation import form as _form
from radar_sense.propagation.lobes import scan
from radar_sense.propagation.moments import Moments
from radar_sense.propagation.standard_space import (
    RelativeProbit,
    StandardNormalSpace,
    UncertainStates,
)
from radar_sense.states import AIRCRAFT, RADAR, FloatArray

#: A method is nonlinear at a pose where higher orders would change σ by more than this part of it,
STD_CHANGE = 0.02
#: or a bound by more than this.
BOUND_CHANGE = 0.005

#: Draws about each centre, where a check draws.
DRAWS = 256
#: Part of BOUND_CHANGE that the draws of a check allow, since they have an error of their own,
SAFETY = 0.7
#: and the change of σ that they allow, as a part of σ or of SMALL_STD if that is greater.
DRAWN_STD_CHANGE, SMALL_STD = 0.03, 1e-3

#: Distance along each axis of u within which the limits of a radar must not lie. A limit 3 away
#: across a position's axes is 3√3 away along each of them.
REACH = 5.2


def second_order_matters(
    states: UncertainStates, moments: Moments, beta: float
) -> NDArray[np.bool_]:
    """Return where (k,) the second-order terms of z would change the moments of P_D, or σ of z.

    With H the second derivatives of z by u and g the gradient, z has to second order the mean
    z(0) + tr H/2, the variance gᵀg + tr H²/2 and the third cumulant 3 gᵀHg + tr H³. No eigenvectors
    are needed. σ of z is tested too, because a P_D that is nearly always 0 or 1 does not show what
    becomes of z.
    """
    found = []
    for part, given in _blocks(states, moments):
        probit = RelativeProbit.of(part)
        value, gradient, second = probit.derivatives()
        root = probit.sqrt_cov
        g = np.einsum("kij,ki->kj", root, gradient)
        h = root.swapaxes(1, 2) @ second @ root
        first = np.sum(g * g, axis=1)
        variance = first + 0.5 * np.sum(h * h, axis=(1, 2))
        hg = np.einsum("kij,kj->ki", h, g)
        third = 3.0 * np.sum(g * hg, axis=1) + np.sum((h @ h) * h, axis=(1, 2))
        mean = value + 0.5 * np.trace(h, axis1=1, axis2=2)
        skewness = third / np.where(variance > 0, variance, 1.0) ** 1.5
        better = _skewed(mean, np.sqrt(variance), skewness, beta)
        bends = ~(variance <= (1.0 + STD_CHANGE) ** 2 * first)
        warned = _differ(given, better) | bends | limit_matters(part, given[0], beta)
        warned |= _expansion_is_off(probit, value, g, h, beta)
        if part.model.rcs.lobed:
            warned |= _lobe_beyond(probit, given, beta)
        found.append(warned)
    return np.concatenate(found)


def _expansion_is_off(
    probit: RelativeProbit, value: FloatArray, g: FloatArray, h: FloatArray, beta: float
) -> NDArray[np.bool_]:
    """Return where (k,) the second-order expansion of z is off a distance β along the gradient."""
    k, g, h = len(value), np.nan_to_num(g), np.nan_to_num(h)  # other tests warn where NaN
    root = np.broadcast_to(probit.sqrt_cov, (k, *probit.sqrt_cov.shape[1:]))
    length = np.sqrt(np.sum(g * g, axis=1))
    u = (beta / np.where(length > 0, length, np.inf))[:, np.newaxis] * g
    u = np.where(np.isfinite(u), u, 0.0)  # the model refuses NaN; no gradient is warned of anyway
    bend = 0.5 * np.sum(u * np.einsum("kij,kj->ki", h, u), axis=1)
    error = np.einsum("kij,kj->ik", root, u)
    exact, _ = probit(np.hstack([error, -error]), np.tile(np.arange(k), 2))
    floor = probit.floor
    expanded = np.maximum(value + beta * np.array([[1.0], [-1.0]]) * length + bend, floor)
    error = np.abs(ndtr(np.maximum(exact.reshape(2, k), floor)) - ndtr(expanded))
    off: NDArray[np.bool_] = error.max(axis=0) > BOUND_CHANGE
    return off


def _lobe_beyond(
    probit: RelativeProbit, given: tuple[FloatArray, FloatArray, FloatArray], beta: float
) -> NDArray[np.bool_]:
    """Return where (k,) a lobe of the RCS within the ball |u| ≤ β takes P_D beyond a bound."""
    root = probit.sqrt_cov
    found = scan(probit, np.broadcast_to(root, (len(probit.states), *root.shape[1:])), beta)
    _, lower, upper = given
    floor = probit.floor
    highest = ndtr(np.maximum(found.promise.max(axis=0), floor))
    lowest = ndtr(np.maximum(found.threat.min(axis=0), floor))
    beyond: NDArray[np.bool_] = ~(
        (highest <= upper + BOUND_CHANGE) & (lowest >= lower - BOUND_CHANGE)
    )
    return beyond


def form_is_off(states: UncertainStates, moments: Moments, beta: float) -> NDArray[np.bool_]:
    """Return where (k,) the moments by `form` are not to be trusted.

    Poses are suspect where orders above the second change the moments, the second changes σ of z,
    or an extreme lies on another lobe. Draws then tell whether the moments are off.
    """
    found = []
    for part, given in _blocks(states, moments):
        space = StandardNormalSpace.of(part)
        betas = _form.betas_for(beta)
        quantiles = _form.quantiles(space, betas, beta)
        _, std, lower, upper = _form.spread(space, quantiles.second_order, beta)
        first = np.sum(space.gradient**2, axis=0)
        variance = first + 0.5 * np.sum(space.curvature**2, axis=0)
        bends = ~(variance <= (1.0 + STD_CHANGE) ** 2 * first)
        ends = [int(np.flatnonzero(betas == b)[-1]) for b in (-beta, beta)]
        moved = np.any(quantiles.extreme != quantiles.nearest, axis=(0, 1))
        suspect = _differ(given, (std, lower, upper)) | bends | moved
        limit = limit_matters(part, given[0], beta)
        suspect &= quantiles.converged & ~limit
        off = ~quantiles.converged | limit
        centres = np.concatenate([quantiles.extreme[:, ends], quantiles.nearest[:, ends]], axis=1)
        for pose in np.flatnonzero(suspect):
            ends_given = [float(values[pose]) for values in given]
            off[pose] = _draws_refute(space, int(pose), centres[:, :, pose], ends_given, beta)
        found.append(off)
    return np.concatenate(found)


def _draws_refute(
    space: StandardNormalSpace,
    pose: int,
    centres: FloatArray,
    given: Sequence[float],
    beta: float,
) -> bool:
    """Return whether weighted draws show that σ or a bound is off.

    Draws are from a mixture of unit normals about u = 0 and about the extremes, so that as many lie
    beyond the bounds as are needed (G. I. Schuëller and R. Stix, Structural Safety 4(4), 1987).
    """
    r = len(centres)
    normals = _normals(r)
    means = np.concatenate([np.zeros((r, 1)), np.unique(centres, axis=1)], axis=1)
    u = (normals[:, np.newaxis] + means[:, :, np.newaxis]).reshape(r, -1)
    # density of the mixture over that of the unit normals
    exponents = means.T @ u - 0.5 * np.sum(means * means, axis=0)[:, np.newaxis]
    weights = 1.0 / np.mean(np.exp(exponents), axis=0)
    weights /= weights.sum()
    value, _ = space.probit(space.sqrt_cov[pose] @ u, np.full(u.shape[1], pose))
    p_d = ndtr(np.maximum(value, space.probit.floor[pose]))
    std, lower, upper = given
    tail, slack = float(ndtr(-beta)), BOUND_CHANGE * SAFETY
    mean = np.sum(weights * p_d)
    drawn_std = np.sqrt(np.sum(weights * np.square(p_d - mean)))
    return bool(
        np.sum(weights[p_d > upper + slack]) > tail
        or np.sum(weights[p_d >= upper - slack]) < tail
        or np.sum(weights[p_d < lower - slack]) > tail
        or np.sum(weights[p_d <= lower + slack]) < tail
        or abs(std - drawn_std) > DRAWN_STD_CHANGE * max(drawn_std, SMALL_STD)
    )


@cache
def _normals(r: int) -> FloatArray:
    """Return unit normals (r, DRAWS) from a Sobol' sequence, the same in every call."""
    from scipy.stats import qmc  # slow to import

    points = qmc.Sobol(r, scramble=True, rng=1).random(DRAWS)
    return np.asarray(ndtri(points.T))


def limit_matters(states: UncertainStates, std: FloatArray, beta: float) -> NDArray[np.bool_]:
    """Return where (k,) a limit to what a radar sees is within reach and matters to P_D.

    A radar that may see or not adds at most p²/4 to the variance of P_D, with p a bound of its P_D.
    It is left out where that changes σ by less than a quarter of what is allowed, since it may be
    correlated with the rest, and where p is less than what is allowed for a bound.
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
        own = slice(len(RADAR) * i, len(RADAR) * (i + 1))
        z, by_aircraft, by_radar = states.model.models[i].linearize_probit(aircraft, radar[:, own])
        variance = variance_along(by_aircraft, states.cov_aircraft)
        variance = variance + variance_along(by_radar, states.cov_radar[:, own, own])
        matters |= near[:, i] & ~(ndtr(z + beta * np.sqrt(variance)) <= allowed)
    return matters


def _blocks(
    states: UncertainStates, moments: Moments
) -> Iterator[tuple[UncertainStates, tuple[FloatArray, FloatArray, FloatArray]]]:
    """Cut states, and σ and bounds of their moments, into blocks of poses."""
    start, numbers = 0, (len(AIRCRAFT) + states.radar.shape[-1]) ** 2
    for part in states.blocks(2 * numbers):
        poses = slice(start, start + len(part))
        yield part, (moments.std[poses], moments.lower[poses], moments.upper[poses])
        start += len(part)


def _skewed(
    m: FloatArray, s: FloatArray, skewness: FloatArray, beta: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return σ and bounds (k,) of Φ(z) where z is m + s (u + γ (u² − 1)/6), γ its skewness.

    (E. A. Cornish and R. A. Fisher, Rev. Inst. Int. Statist. 5(4), 1937.)
    """
    u, weights = _gauss_hermite()
    nodes = np.append(u, (-beta, beta))[:, np.newaxis]
    z = m + s * (nodes + skewness * (nodes * nodes - 1.0) / 6.0)
    lesser = ndtr(np.where(m > 0, -1.0, 1.0) * z[: len(u)])  # of P_D and 1 − P_D: none rounds to 1
    mean = weights @ lesser
    std = np.sqrt(weights @ np.square(lesser - mean))
    ends = ndtr(z[len(u) :])
    return np.where(s == 0, 0.0, std), ends.min(axis=0), ends.max(axis=0)


@cache
def _gauss_hermite() -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights (16,) of integrals over the normal distribution."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(16)
    return nodes, weights / weights.sum()


def _differ(
    given: tuple[FloatArray, FloatArray, FloatArray],
    better: tuple[FloatArray, FloatArray, FloatArray],
) -> NDArray[np.bool_]:
    """Return where (k,) σ or a bound is too far from a better one, or either is not known."""
    std, lower, upper = (abs(g - b) for g, b in zip(given, better, strict=True))
    return ~((std <= STD_CHANGE * better[0]) & (lower <= BOUND_CHANGE) & (upper <= BOUND_CHANGE))
