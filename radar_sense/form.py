"""The first-order reliability method (FORM), corrected to second order: quantiles of z.

FORM takes for the quantile of z at Φ(β) the greatest z in the ball |u| ≤ β of standardized state
space, or the least in |u| ≤ |β| where β is negative (A. M. Hasofer and N. C. Lind, J. Eng. Mech.
Div. ASCE 100(1), 1974). That is exact where z is linear in u, or a monotone function of one
variable. What it cannot see is the curvature of z across its gradient. The second-order expansion
of z has that curvature, an extreme of its own in the same ball, and a quantile that can be
computed. The difference of these two is added to the extreme of z.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radar_sense.standardized import Standardized
from radar_sense.states import FloatArray

#: An extreme has settled when the gradient there promises no more to gain within the ball than
#: this, in standard deviations of z.
TOLERANCE = 1e-4
#: Evaluations after which an extreme is given up; on the paper's scenario one or two are enough.
ITERATIONS = 60
#: A step that gains more than so many times what the curvature at u = 0 promises, though less than
#: twice that, which is what it gains without any, shows that there is less of it by now.
EASY = 1.2


def quantiles(
    z: Standardized, betas: FloatArray
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Quantiles of z at Φ(β) for each of m poses and n values of β.

    Returns:
        Quantiles of z (m, n), those of its second-order expansion (m, n), and whether the search
        for the extremes has settled for all β (m,). Where it has not, or z has no gradient, the
        quantiles have no meaning.
    """
    known = np.isfinite(z.value + z.gradient.sum(axis=1) + z.curvature.sum(axis=1))
    pose = np.flatnonzero(known)
    # One row for each pose and β, with the sign turned so that all look for a maximum.
    row, beta = np.repeat(pose, len(betas)), np.tile(betas, len(pose))
    sign, radius = np.where(beta < 0, -1.0, 1.0), np.abs(beta)
    g, lam = sign[:, np.newaxis] * z.gradient[row], sign[:, np.newaxis] * z.curvature[row]
    u = ball_maximum(g, lam, radius)
    expanded = z.value[row] + sign * np.sum(g * u + 0.5 * lam * u * u, axis=1)
    extreme, found = _climb(z, row, sign, radius, g, lam)

    second_order = np.zeros((len(known), len(betas)))
    second_order[pose] = z.value[pose, np.newaxis] + quadratic_quantile(
        z.gradient[pose], z.curvature[pose], betas
    )
    quantile = second_order.copy()
    quantile[pose] += (sign * extreme - expanded).reshape(-1, len(betas))
    settled = known & np.isfinite(quantile).all(axis=1)
    settled[pose] &= found.reshape(-1, len(betas)).all(axis=1)
    quantile[~settled] = 0.0  # any finite number
    return quantile, second_order, settled


def _climb(
    z: Standardized,
    row: NDArray[np.intp],
    sign: FloatArray,
    radius: FloatArray,
    g: FloatArray,
    lam: FloatArray,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the maximum (k,) of sign · z over the ball |u| ≤ radius, and whether it has settled.

    Each step goes to where z would be greatest in the ball with its gradient here and its curvature
    at u = 0; without the curvature that is β times the unit vector of the gradient (R. Rackwitz and
    B. Fiessler, Computers & Structures 9(5), 1978). A step that loses is taken back, and the next
    one damped as by Levenberg and Marquardt, which turns it towards the gradient. Where a step wins
    far more than it should the curvature is less than it was at u = 0, as where one radar of a
    network has lost its signal and the others have not, and the next one takes less of it.
    """
    u, best = np.zeros_like(g), sign * z.value[row]
    g, damping, settled = g.copy(), np.zeros(len(g)), np.zeros(len(g), dtype=bool)
    floor = z.floor
    spread = np.sqrt(np.sum(g * g + 0.5 * lam * lam, axis=1))
    ease = np.ones(len(g))
    stiffness = spread / np.where(radius > 0, radius, 1.0) + np.abs(lam).max(axis=1)
    for _ in range(ITERATIONS):
        left = np.flatnonzero(~settled)
        if not left.size:
            break
        model = ease[left, np.newaxis] * lam[left] - damping[left, np.newaxis]
        trial = ball_maximum(g[left] - model * u[left], model, radius[left])
        step = trial - u[left]
        expected = np.sum(g[left] * step + 0.5 * model * step * step, axis=1)
        value, slope = z(trial, row[left])
        value, slope = sign[left] * value, sign[left, np.newaxis] * slope
        # Where there is no gradient, as straight above the aircraft, the search cannot go on.
        gains = (value >= best[left] - 1e-12) & np.isfinite(slope).all(axis=1)
        won, lost = left[gains], left[~gains]
        gain = (value - best[left]) / np.where(expected > 0, expected, np.inf)
        ease[left[gains & (gain > EASY) & (gain < 2.0)]] *= 0.5
        u[won], best[won], g[won] = trial[gains], value[gains], slope[gains]
        damping[won] /= 4.0
        damping[lost] = np.maximum(4.0 * damping[lost], stiffness[lost])
        promise = radius[won] * np.linalg.norm(g[won], axis=1) - np.sum(g[won] * u[won], axis=1)
        at_floor = (sign[won] < 0) & (-best[won] <= floor[row[won]])
        settled[won] = (promise <= TOLERANCE * spread[won]) | at_floor
    return best, settled


def ball_maximum(g: FloatArray, lam: FloatArray, radius: FloatArray) -> FloatArray:
    """Return the u (k, n) that maximizes Σ (g_i u_i + λ_i u_i²/2) in the ball |u| ≤ radius (k,).

    It is u_i = g_i/(μ − λ_i) with the least μ ≥ max(0, λ_i) for which |u| ≤ radius, found by
    Newton's iteration for 1/|u| = 1/radius (J. J. Moré and D. C. Sorensen, SIAM J. Sci. Stat.
    Comput. 4(3), 1983). Where g has no component along the greatest λ, u and its mirror image may
    be as good as each other, and u goes the positive way.
    """
    size = np.linalg.norm(g, axis=1) + radius * np.abs(lam).max(axis=1)
    least = 1e-6 * size[:, np.newaxis]
    forks = (lam == lam.max(axis=1, keepdims=True)) & (np.abs(g) < least)
    g = np.where(forks, np.where(g < 0, -least, least), g)
    low = np.maximum(lam.max(axis=1, keepdims=True), 0.0)
    radius = radius[:, np.newaxis]
    with np.errstate(divide="ignore", invalid="ignore"):
        # From a μ too low, where |u| is too long, the iteration rises to the solution.
        mu = low + np.maximum(np.max(np.abs(g) / radius + lam - low, axis=1, keepdims=True), 0.0)
        for _ in range(12):
            u = g / (mu - lam)
            square = np.sum(u * u, axis=1, keepdims=True)
            slope = np.sum(u * u / (mu - lam), axis=1, keepdims=True)
            step = (np.sqrt(square) / radius - 1.0) * square / slope
            mu = np.where(np.isfinite(step), np.maximum(mu + step, low), mu)
        u = g / (mu - lam)
    return np.where(np.isfinite(u), u, 0.0)  # 0/0: nothing to gain, or a ball of radius 0


def quadratic_quantile(g: FloatArray, lam: FloatArray, betas: FloatArray) -> FloatArray:
    """Quantiles (k, n) of Σ (g_i u_i + λ_i u_i²/2) at Φ(β) for β (n,); g and λ are (k, ...).

    With the saddlepoint approximation r* (O. E. Barndorff-Nielsen, Biometrika 73(2), 1986). From
    the cumulant generating function K(t) = ½ Σ [t² g²/(1 − λt) − ln(1 − λt)],

        x = K'(t) is the quantile at β = r + ln(v/r)/r,  r = sign(t) √(2(tx − K)),  v = t √K''(t),

    and β rises with t between the poles 1/λ, so that t is found by bisection.
    """
    spread = np.sqrt(np.sum(g * g + 0.5 * lam * lam, axis=1, keepdims=True))
    unit = np.where(spread > 0, spread, 1.0)
    g2, lam = ((g / unit) ** 2)[:, np.newaxis], (lam / unit)[:, np.newaxis]
    highest, lowest = np.maximum(lam.max(axis=2), 0.0), np.minimum(lam.min(axis=2), 0.0)
    skewness = np.sum(3.0 * g2 * lam + lam**3, axis=2)

    def at(y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """β and x (k, n) at any y; t = w/(1 + λw) stays between the poles for any w."""
        w = np.sinh(y)
        t = w / (1.0 + np.where(w > 0, highest, lowest) * w)
        lt = lam * t[..., np.newaxis]
        d, tt = 1.0 - lt, t[..., np.newaxis]
        k0 = 0.5 * np.sum(tt * tt * g2 / d - np.log1p(-lt), axis=2)
        k1 = np.sum(g2 * tt * (1.0 - 0.5 * lt) / d**2 + 0.5 * lam / d, axis=2)
        k2 = np.sum(g2 / d**3 + 0.5 * lam**2 / d**2, axis=2)
        r = np.sign(t) * np.sqrt(np.maximum(2.0 * (t * k1 - k0), 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            beta = r + np.log(t * np.sqrt(k2) / r) / r
        return np.where(np.abs(r) < 1e-3, r + skewness / 6.0, beta), k1  # its limit at the mean

    low = np.full((len(g), len(betas)), -18.0)
    high = -low
    for _ in range(45):
        y = 0.5 * (low + high)
        above = at(y)[0] > betas
        low, high = np.where(above, low, y), np.where(above, y, high)
    quantile: FloatArray = spread * at(0.5 * (low + high))[1]
    return quantile
