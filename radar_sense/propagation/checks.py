"""Checks of a method of propagation: where its moments are not to be trusted.

A check is not part of a method. It costs more than `linear` and `probit` themselves, so it is made
once an analysis, on the total, where its warning is shown.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from radar_sense.covariance import factor
from radar_sense.propagation import form as _form
from radar_sense.propagation.moments import Moments
from radar_sense.propagation.standard_space import (
    RelativeProbit,
    StandardNormalSpace,
    UncertainStates,
)
from radar_sense.states import AIRCRAFT, FloatArray

#: A method is nonlinear at a pose where higher orders would change σ by more than this part of it,
STD_CHANGE = 0.02
#: or a bound by more than this.
BOUND_CHANGE = 0.005

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
        found.append(_differ(given, better) | bends | limit_within_reach(part))
    return np.concatenate(found)


def form_is_off(states: UncertainStates, moments: Moments, beta: float) -> NDArray[np.bool_]:
    """Return where (k,) the moments by `form` are not to be trusted."""
    found = []
    for part, given in _blocks(states, moments):
        space = StandardNormalSpace.of(part)
        quantiles = _form.quantiles(space, _form.betas_for(beta))
        _, std, lower, upper = _form.spread(space, quantiles.second_order, beta)
        first = np.sum(space.gradient**2, axis=0)
        variance = first + 0.5 * np.sum(space.curvature**2, axis=0)
        bends = ~(variance <= (1.0 + STD_CHANGE) ** 2 * first)
        found.append(_differ(given, (std, lower, upper)) | bends | limit_within_reach(part))
    return np.concatenate(found)


def limit_within_reach(states: UncertainStates) -> NDArray[np.bool_]:
    """Return where (k,) a limit to what a radar sees is within reach of the states."""
    near = np.zeros(len(states), dtype=bool)
    if not states.model.limited:
        return near
    aircraft, radar = states.aircraft, states.radar
    visible = states.model.visible(aircraft, radar)
    for size in (REACH, -REACH):
        for error in np.moveaxis(size * factor(states.cov_aircraft), -1, 0):
            seen = states.model.visible(aircraft + error, radar)
            near |= np.any(seen != visible, axis=-1)
        for error in np.moveaxis(size * factor(states.cov_radar), -1, 0):
            seen = states.model.visible(aircraft, radar + error)
            near |= np.any(seen != visible, axis=-1)
    return near


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
