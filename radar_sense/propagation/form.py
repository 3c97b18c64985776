"""The first-order reliability method (FORM), corrected to second order.

FORM approximates the quantile of z at Φ(β) by an extreme of z in standard normal space (A. M.
Hasofer and N. C. Lind, J. Eng. Mech. Div. ASCE 100(1), 1974). For positive β the extreme is the
greatest z in the ball |u| ≤ β. For negative β the extreme is the least z in the ball |u| ≤ |β|. The
approximation is exact where z is linear in u, or a monotone function of one variable. The extreme
does not account for the curvature of z across its gradient. The second-order expansion of z has the
same curvature, and its quantile can be computed. The correction is the quantile of the expansion
minus the extreme of the expansion in the ball.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from radar_sense.propagation.aspect_scan import scan_aspects
from radar_sense.propagation.gaussian_states import (
    MAX_NUMBERS,
    StdFunction,
    UncertainStates,
    block_size,
)
from radar_sense.propagation.moments import STD_CHANGE, Moments, differ
from radar_sense.propagation.relative_probit import RelativeProbit
from radar_sense.propagation.standard_space import StandardNormalSpace
from radar_sense.states import AIRCRAFT, FloatArray

#: β of the quantiles from which mean and standard deviation are computed.
NODES = np.array([-4.5, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 4.5])
#: Largest gain within the ball that the gradient predicts where a search has converged, in standard
#: deviations of z.
TOLERANCE = 1e-4
#: β of the quantiles for probabilities of exceedance, and number of steps from one β to the next.
EXCEEDANCE_NODES, EXCEEDANCE_STEPS = np.arange(-5.0, 6.0), 100
#: Most evaluations of a search. On the paper's scenario one or two are enough.
ITERATIONS = 60
#: Another lobe is searched if the scan predicts an extreme farther out by this, in standard
#: deviations of z.
WORTH = 0.02
#: A gain above this factor times the predicted gain shows a curvature less than at u = 0. Without
#: any curvature the gain is twice the predicted gain.
EASY = 1.2


def form(states: UncertainStates, beta: float) -> Moments:
    """Return bounds by FORM with its correction, and mean and σ as integrals over quantiles."""
    blocks, order = _blocks(states, len(NODES))
    parts = (states.part(*block) for block in blocks)
    moments = (moments_in(StandardNormalSpace.of(part), beta) for part in parts)
    return Moments.concatenated(moments).at(order)


def form_upper(states: UncertainStates, beta: float) -> FloatArray:
    """Return the upper bound (k,) of `form`; NaN where the search has not converged."""
    bounds = []
    blocks, order = _blocks(states, 1)
    for block in blocks:
        space = StandardNormalSpace.of(states.part(*block))
        solution = quantiles(space, np.array([beta]), beta)
        upper = ndtr(np.maximum(solution.corrected[0], space.probit.floor))
        bounds.append(np.where(solution.converged, upper, np.nan))
    return np.concatenate(bounds)[order]


def form_exceedance(states: UncertainStates, p_max: float) -> FloatArray:
    """Return P(P_D > p_max) (k,), which is Φ(−β) for the β whose quantile of P_D is p_max.

    The quantiles are for the lobe about u = 0. NaN where a search has not converged.
    """
    probabilities = []
    blocks, order = _blocks(states, len(EXCEEDANCE_NODES))
    for block in blocks:
        space = StandardNormalSpace.of(states.part(*block))
        solution = quantiles(space, EXCEEDANCE_NODES, np.nan)
        z = np.maximum(solution.corrected, space.probit.floor)
        probability = exceedance(EXCEEDANCE_NODES, z, float(ndtri(p_max)))
        probabilities.append(np.where(solution.converged, probability, np.nan))
    return np.concatenate(probabilities)[order]


def exceedance(betas: FloatArray, z: FloatArray, z_max: float) -> FloatArray:
    """Return P(z > z_max) (k,) from quantiles of z (n, k) at Φ(β) for increasing β (n,).

    β is interpolated by a cubic spline, and extrapolated linearly.
    """
    from scipy.interpolate import CubicSpline  # slow to import

    fine = np.linspace(betas[0], betas[-1], EXCEEDANCE_STEPS * (len(betas) - 1) + 1)
    curve = np.maximum.accumulate(CubicSpline(betas, np.eye(len(betas)), axis=0)(fine) @ z, axis=0)
    left = np.clip(np.count_nonzero(curve <= z_max, axis=0) - 1, 0, len(fine) - 2)
    pose = np.arange(z.shape[1])
    low, high = curve[left, pose], curve[left + 1, pose]
    with np.errstate(divide="ignore", invalid="ignore"):
        beta = fine[left] + (z_max - low) / (high - low) * (fine[1] - fine[0])
    flat = high == low  # z does not change with β, or z_max is beyond a floor
    beta = np.where(flat, np.where(z_max < low, -np.inf, np.inf), beta)
    return np.asarray(ndtr(-beta))


def form_std(states: UncertainStates) -> StdFunction:
    """Return a function from covariances to σ of P_D, which shares the derivatives of z.

    The derivatives are computed once, with the covariances of the states. The searches for the
    extremes start from these derivatives.
    """
    blocks, order = _blocks(states, len(NODES))
    derivatives = [RelativeProbit(states.part(*block)).derivatives() for block in blocks]

    def std(cov_aircraft: FloatArray, cov_radar: FloatArray) -> FloatArray:
        std_parts = []
        changed = states.with_covariances(cov_aircraft, cov_radar)
        for block, known in zip(blocks, derivatives, strict=True):
            space = StandardNormalSpace.expanded(RelativeProbit(changed.part(*block)), known)
            std_parts.append(_values(space, quantiles(space, NODES, 3.0), 3.0)[1])
        return np.concatenate(std_parts)[order]

    return std


def moments_in(space: StandardNormalSpace, beta: float) -> Moments:
    """Return the moments of P_D at the poses of a standard normal space."""
    solution = quantiles(space, betas_for(beta), beta)
    mean, std, lower, upper = _values(space, solution, beta)
    states = space.probit.states
    p_d = states.model.p_d(states.aircraft, states.radar) + np.zeros(len(states))
    suspect = _suspect(space, solution, (std, lower, upper), beta)
    return Moments(p_d, mean, std, lower, upper, solution.converged, suspect)


def _values(
    space: StandardNormalSpace, solution: Quantiles, beta: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return mean, σ, lower and upper bound (k,), NaN where the search has not converged."""
    values = spread(space, solution.corrected, beta)
    mean, std, lower, upper = (np.where(solution.converged, v, np.nan) for v in values)
    return mean, std, lower, upper


def _suspect(
    space: StandardNormalSpace,
    solution: Quantiles,
    values: Sequence[FloatArray],
    beta: float,
) -> NDArray[np.bool_]:
    """Return where (k,) σ and bounds may be unreliable.

    At these poses orders above the second change σ or a bound, or the second order changes σ of z.
    An extreme may also lie on another lobe, or the search has not converged.
    """
    _, *second_order = spread(space, solution.second_order, beta)
    first = np.sum(space.gradient**2, axis=0)
    variance = first + 0.5 * np.sum(space.curvature**2, axis=0)
    bends = ~(variance <= (1.0 + STD_CHANGE) ** 2 * first)
    moved = np.any(solution.extreme != solution.nearest, axis=(0, 1))
    suspect: NDArray[np.bool_] = differ(values, second_order) | bends | moved
    return suspect


class Quantiles(NamedTuple):
    """Quantiles of z at n values of β, at each of k poses.

    Attributes:
        corrected: Quantiles by FORM with its correction (n, k).
        second_order: Quantiles of the second-order expansion (n, k).
        converged: Whether the search for the extremes has converged at all β (k,). Elsewhere, and
            where z has no gradient, the quantiles have no meaning.
        extreme: u (r, n, k) of the extremes.
        nearest: u (r, n, k) of the extremes that the search from u = 0 finds.
    """

    corrected: FloatArray
    second_order: FloatArray
    converged: NDArray[np.bool_]
    extreme: FloatArray
    nearest: FloatArray


def betas_for(beta: float) -> FloatArray:
    """Return the nodes, and after them −β and β unless they are nodes."""
    return NODES if beta in NODES else np.append(NODES, (-beta, beta))


def quantiles(space: StandardNormalSpace, betas: FloatArray, bound: float) -> Quantiles:
    """Return quantiles of z at Φ(β) for each of k poses and n values of β.

    Lobes of the RCS within reach are searched too for β = ± `bound`.
    """
    known = np.isfinite(space.value + space.gradient.sum(axis=0) + space.curvature.sum(axis=0))
    pose = np.flatnonzero(known)
    shape = (len(betas), len(pose))
    # One row for each β and pose. With the sign of β, every row is a maximization.
    row, beta = np.tile(pose, len(betas)), np.repeat(betas, len(pose))
    sign, radius = np.where(beta < 0, -1.0, 1.0), np.abs(beta)
    g, lam = sign * space.gradient[:, row], sign * space.curvature[:, row]
    start = ball_maximum(g, lam, radius)
    expanded = space.value[row] + sign * np.sum((g + 0.5 * lam * start) * start, axis=0)
    first = climb(space, row, sign, radius, g, lam, start)
    extremes = first
    if space.probit.states.model.rcs.lobed:
        extremes = _highest_lobes(space, row, sign, radius, g, lam, first, radius == bound)

    second_order = np.zeros((len(betas), len(known)))
    second_order[:, pose] = (space.value + space.drift)[pose] + quadratic_quantile(
        space.gradient[:, pose], space.curvature[:, pose], betas
    )
    corrected = second_order.copy()
    corrected[:, pose] += (sign * first.value - expanded).reshape(shape)
    # The expansion about u = 0 does not describe another lobe. Its correction does not apply there.
    moved = (extremes.value > first.value).reshape(shape)
    corrected[:, pose] = np.where(moved, (sign * extremes.value).reshape(shape), corrected[:, pose])
    u = np.zeros((len(space.gradient), len(betas), len(known)))
    u[:, :, pose] = extremes.u.reshape(len(u), *shape)
    u_first = np.zeros_like(u)
    u_first[:, :, pose] = first.u.reshape(len(u), *shape)
    converged = known & np.isfinite(corrected).all(axis=0)
    converged[pose] &= extremes.converged.reshape(shape).all(axis=0)
    corrected[:, ~converged] = 0.0  # any finite number
    return Quantiles(corrected, second_order, converged, u, u_first)


class Extremes(NamedTuple):
    """Maxima of sign · z in a ball: u (r, j), sign · z (j,), and convergence of the search (j,)."""

    u: FloatArray
    value: FloatArray
    converged: NDArray[np.bool_]


def _highest_lobes(
    space: StandardNormalSpace,
    row: NDArray[np.intp],
    sign: FloatArray,
    radius: FloatArray,
    g: FloatArray,
    lam: FloatArray,
    first: Extremes,
    searched: NDArray[np.bool_],
) -> Extremes:
    """Return the maxima, replaced by the maxima of other lobes where these are greater."""
    rows = np.flatnonzero(searched)
    if not rows.size:
        return first
    scanned = scan_aspects(space.probit, space.sqrt_cov, float(radius[rows[0]]))
    up = sign[rows] > 0
    promise = np.where(up, scanned.promise[:, row[rows]], -scanned.threat[:, row[rows]])
    point = np.argmax(promise, axis=0)
    size = np.sqrt(np.sum(g[:, rows] ** 2 + 0.5 * lam[:, rows] ** 2, axis=0))
    more = promise[point, np.arange(len(rows))] > first.value[rows] + WORTH * size
    rows, point, up = rows[more], point[more], up[more]
    if not rows.size:
        return first
    start = np.where(up, scanned.best[:, point, row[rows]], scanned.worst[:, point, row[rows]])
    expansion = g[:, rows], lam[:, rows]
    other = climb(space, row[rows], sign[rows], radius[rows], *expansion, start)
    better = other.converged & (other.value > first.value[rows] + WORTH * size[more])
    rows = rows[better]
    u, value, converged = first.u.copy(), first.value.copy(), first.converged.copy()
    u[:, rows], value[rows], converged[rows] = other.u[:, better], other.value[better], True
    return Extremes(u, value, converged)


def climb(
    space: StandardNormalSpace,
    row: NDArray[np.intp],
    sign: FloatArray,
    radius: FloatArray,
    g: FloatArray,
    lam: FloatArray,
    start: FloatArray,
) -> Extremes:
    """Return the maxima of sign · z over the ball |u| ≤ radius, from one start each.

    Each step goes to the maximum of an expansion in the ball. The expansion has the gradient at the
    present point and the curvature at u = 0. Without the curvature the maximum is β times the unit
    vector of the gradient (R. Rackwitz and B. Fiessler, Computers & Structures 9(5), 1978). A step
    that decreases z is undone. The next step is then damped as by Levenberg and Marquardt, which
    turns the step towards the gradient. After a step that gains far more than the curvature at
    u = 0 predicts, the next step uses less of the curvature.

    Args:
        space: Standard normal space.
        row: Poses (j,).
        sign: 1 or −1 (j,).
        radius: Radius of the ball (j,).
        g: Gradient of sign · z at u = 0 (r, j).
        lam: Curvatures of sign · z at u = 0 (r, j).
        start: The first u that is evaluated (r, j): the maximum of the second-order expansion, or
            a point on another lobe.
    """
    count = len(row)
    best, converged = sign * space.value[row], np.zeros(count, dtype=bool)
    spread = np.sqrt(np.sum(g * g + 0.5 * lam * lam, axis=0))
    u, slope = np.zeros_like(g), g.copy()
    damping, ease = np.zeros(count), np.ones(count)
    stiffness = spread / np.where(radius > 0, radius, 1.0) + np.max(np.abs(lam), axis=0, initial=0)
    left, trial = np.arange(count), start
    model = lam
    for iteration in range(ITERATIONS):
        if iteration:
            model = ease[left] * lam[:, left] - damping[left]
            trial = ball_maximum(slope[:, left] - model * u[:, left], model, radius[left])
        step = trial - u[:, left]
        expected = np.sum((slope[:, left] + 0.5 * model * step) * step, axis=0)
        value, by_u = space(trial, row[left])
        value, by_u = sign[left] * value, sign[left] * by_u
        # Without a gradient, as straight above the aircraft, the search stops.
        gains = (value >= best[left] - 1e-12) & np.isfinite(by_u).all(axis=0)
        won, lost = left[gains], left[~gains]
        gain = (value - best[left]) / np.where(expected > 0, expected, np.inf)
        ease[left[gains & (gain > EASY) & (gain < 2.0)]] *= 0.5
        by_u, trial = by_u[:, gains], trial[:, gains]
        u[:, won], best[won], slope[:, won] = trial, value[gains], by_u
        damping[won] /= 4.0
        damping[lost] = np.maximum(4.0 * damping[lost], stiffness[lost])
        promise = radius[won] * np.sqrt(np.sum(by_u * by_u, axis=0)) - np.sum(by_u * trial, axis=0)
        at_floor = (sign[won] < 0) & (-best[won] <= space.probit.floor[row[won]])
        converged[won] = (promise <= TOLERANCE * spread[won]) | at_floor
        left = left[~converged[left]]
        if not left.size:
            break
    return Extremes(u, best, converged)


def ball_maximum(g: FloatArray, lam: FloatArray, radius: FloatArray) -> FloatArray:
    """Return the u (r, j) that maximizes Σ (g_i u_i + λ_i u_i²/2) in the ball |u| ≤ radius (j,).

    The maximum is u_i = g_i/(μ − λ_i) with the least μ ≥ max(0, λ_i) for which |u| ≤ radius.
    Newton's iteration solves 1/|u| = 1/radius for μ (J. J. Moré and D. C. Sorensen, SIAM J. Sci.
    Stat. Comput. 4(3), 1983). Where g has no component along the greatest λ, u and its mirror image
    may both be maxima. The u with the positive component is then returned.
    """
    highest = np.max(lam, axis=0, initial=-np.inf)
    size = np.sqrt(np.sum(g * g, axis=0)) + radius * np.max(np.abs(lam), axis=0, initial=0.0)
    least = 1e-6 * size
    forks = (lam == highest) & (np.abs(g) < least)
    if forks.any():
        g = np.where(forks, np.where(g < 0, -least, least), g)
    low = np.maximum(highest, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        # From a μ too low, where |u| is too long, the iteration rises to the solution.
        mu = low + np.maximum(np.max(np.abs(g) / radius + lam - low, axis=0, initial=0.0), 0.0)
        left = np.arange(len(mu))
        for _ in range(12):
            inverse = 1.0 / (mu[left] - lam[:, left])
            square = (g[:, left] * inverse) ** 2
            length = np.sum(square, axis=0)
            step = (
                (np.sqrt(length) / radius[left] - 1.0) * length / np.sum(square * inverse, axis=0)
            )
            before = mu[left]
            mu[left] = np.where(np.isfinite(step), np.maximum(before + step, low[left]), before)
            left = left[np.abs(mu[left] - before) > 1e-14 * before]
            if not left.size:
                break
        u = g / (mu - lam)
    return np.where(np.isfinite(u), u, 0.0)  # 0/0: nothing to gain, or a ball of radius 0


def quadratic_quantile(g: FloatArray, lam: FloatArray, betas: FloatArray) -> FloatArray:
    """Return quantiles (n, k) of Σ (g_i u_i + λ_i u_i²/2) at Φ(β) for β (n,); g, λ are (r, k).

    The quantiles are by the saddlepoint approximation r* (O. E. Barndorff-Nielsen, Biometrika
    73(2), 1986). From the cumulant generating function K(t) = ½ Σ [t² g²/(1 − λt) − ln(1 − λt)],

        x = K'(t) is the quantile at β = r + ln(v/r)/r,  r = sign(t) √(2(tx − K)),  v = t √K''(t).

    β rises with t between the poles 1/λ. The substitution is t = w/(1 + λw), with λ the curvature
    of the pole on the same side. β is close to linear in w. Newton's method within a bracket finds
    the w of each β.
    """
    n, k = len(betas), g.shape[1]
    spread = np.sqrt(np.sum(g * g + 0.5 * lam * lam, axis=0))
    unit = np.where(spread > 0, spread, 1.0)
    g2, lam = (g / unit) ** 2, lam / unit
    skewness = np.sum((3.0 * g2 + lam * lam) * lam, axis=0)
    highest = np.max(lam, axis=0, initial=0.0)
    lowest = np.min(lam, axis=0, initial=0.0)
    row, beta = np.tile(np.arange(k), n), np.repeat(betas, k)
    w = np.where(spread[row] > 0, beta - skewness[row] / 6.0, 0.0)
    low, high = np.full(n * k, -np.sinh(18.0)), np.full(n * k, np.sinh(18.0))
    x = np.zeros(n * k)
    left = np.flatnonzero(spread[row] > 0)
    for _ in range(60):
        if not left.size:
            break
        here, target = w[left], beta[left]
        pole = np.where(here > 0, highest[row[left]], lowest[row[left]])
        beta_here, slope, x[left] = _beta_at(g2[:, row[left]], lam[:, row[left]], here, pole)
        above = beta_here > target
        high[left[above]], low[left[~above]] = here[above], here[~above]
        new = here + (target - beta_here) / slope
        # Newton's step, or the middle in asinh(w) where the step leaves the bracket
        outside = ~((new > low[left]) & (new < high[left]))
        if outside.any():
            ends = np.arcsinh(low[left[outside]]) + np.arcsinh(high[left[outside]])
            new[outside] = np.sinh(0.5 * ends)
        w[left] = new
        left = left[np.abs(beta_here - target) > 1e-9]
    quantile: FloatArray = spread * x.reshape(n, k)
    return quantile


def _beta_at(
    g2: FloatArray, lam: FloatArray, w: FloatArray, pole: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return β, ∂β/∂w and x (j,) at t = w/(1 + λw), with λ the curvature of the pole (j,)."""
    scale = 1.0 / (1.0 + pole * w)
    t = w * scale
    lt = lam * t
    d = 1.0 / (1.0 - lt)
    g2d = g2 * d
    k0 = 0.5 * np.sum(t * t * g2d - np.log1p(-lt), axis=0)
    k1 = np.sum(d * (t * g2d * (1.0 - 0.5 * lt) + 0.5 * lam), axis=0)
    lamd2 = (lam * d) ** 2
    g2d3 = g2d * d * d
    k2 = np.sum(g2d3 + 0.5 * lamd2, axis=0)
    k3 = np.sum((3.0 * g2d3 + lamd2) * lam * d, axis=0)
    r = np.sign(t) * np.sqrt(np.maximum(2.0 * (t * k1 - k0), 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithm = np.log(t * np.sqrt(k2) / r)
        beta = r + logarithm / r
        by_r = t * k2 / r  # ∂r/∂t
        slope = by_r + (1.0 / t + 0.5 * k3 / k2 - by_r / r - logarithm * by_r / r) / r
    near = np.abs(r) < 1e-3  # the limit at the mean
    beta = np.where(near, r + k3 / 6.0 / k2**1.5, beta)
    slope = np.where(near | ~(slope > 0), np.sqrt(k2), slope)
    return beta, slope * scale * scale, k1


def spread(
    space: StandardNormalSpace, quantile: FloatArray, beta: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return mean, σ, lower and upper bound (k,) from quantiles of z (n, k) at `betas_for(beta)`.

    P_D increases with z: the quantiles of z at Φ(β) give the quantiles of P_D at Φ(β). Mean and
    variance are integrals over the normal distribution of β. The lesser of P_D and 1 − P_D is
    integrated, about its median. A small deviation beside P_D ≈ 1 is then not lost.
    """
    weights, curve = _integration()
    betas = betas_for(beta)
    floor = space.probit.floor
    side = np.where(space.value > 0, -1.0, 1.0)
    lesser = ndtr(side * np.maximum(curve @ quantile[: len(NODES)], floor))
    median = lesser[len(lesser) // 2].copy()
    lesser -= median
    drift = weights @ lesser
    lesser -= drift
    variance = weights @ np.square(lesser)
    mean = median + drift
    ends = (quantile[int(np.flatnonzero(betas == b)[-1])] for b in (-beta, beta))
    lower, upper = (ndtr(np.maximum(end, floor)) for end in ends)
    certain = np.ptp(quantile, axis=0) == 0  # σ would be the rounding of the spline
    std = np.where(certain, 0.0, np.sqrt(variance))
    return np.where(space.value > 0, 1.0 - mean, mean), std, lower, upper


@cache
def _integration() -> tuple[FloatArray, FloatArray]:
    """Return weights (p,) of the normal distribution, and the spline matrix (p, nodes)."""
    from scipy.interpolate import CubicSpline  # slow to import

    beta = np.linspace(-6.0, 6.0, 61)
    weights = np.exp(-0.5 * beta * beta)
    return weights / weights.sum(), CubicSpline(NODES, np.eye(len(NODES)), axis=0)(beta)


def _blocks(
    states: UncertainStates, betas: int
) -> tuple[list[tuple[NDArray[np.intp], list[int] | None]], NDArray[np.intp]]:
    """Return blocks of poses with the radars that see them, and the places of all poses in these.

    The blocks serve for other covariances too.
    """
    blocks: list[tuple[NDArray[np.intp], list[int] | None]] = []
    for poses, radars in states.sight():
        size = block_size(_numbers(states.part(poses, radars), betas))
        starts = range(0, max(len(poses), 1), size)
        blocks.extend((poses[start : start + size], radars) for start in starts)
    return blocks, np.argsort(np.concatenate([poses for poses, _ in blocks]))


def _numbers(states: UncertainStates, betas: int) -> int:
    """Return the numbers per pose in the largest array of FORM, for 16 poses a block or more.

    Most radars with independent errors keep one component. If all components are kept, the largest
    array has up to four times the numbers.
    """
    components = len(AIRCRAFT) + int(states.radar.shape[-1])
    kept = components
    if states.has_independent_radars:
        kept = len(AIRCRAFT) + len(states.log_constant)
    return min(components * max(kept, betas), MAX_NUMBERS // 16)
