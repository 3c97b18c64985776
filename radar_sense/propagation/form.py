"""The first-order reliability method (FORM), corrected to second order.

FORM approximates the quantile of z at Φ(β) by an extreme of z in standard normal space (A. M.
Hasofer and N. C. Lind, J. Eng. Mech. Div. ASCE 100(1), 1974). For positive β the extreme is the
greatest z in the ball |u| ≤ β. For negative β the extreme is the least z in the ball |u| ≤ |β|. The
approximation is exact where z is linear in u, or a monotone function of one variable. The extreme
does not account for the curvature of z across its gradient. The second-order expansion of z has the
same curvature, and its quantile can be computed. The correction is the quantile of the expansion
minus the extreme of the expansion in the ball.

One extreme is searched, from u = 0, and radars keep seeing what they see there. Limits, other lobes
and the tail of another radar are left out: draws judge whether that matters (`judged`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from radar_sense.propagation.expansion import RelativeProbit, SecondOrder, StandardNormalSpace
from radar_sense.propagation.moments import Distribution
from radar_sense.states import FloatArray
from radar_sense.uncertain_states import UncertainStates

#: β of the quantiles from which mean and standard deviation are computed.
NODES = np.array([-4.5, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 4.5])
#: Largest gain within the ball that the gradient predicts where a search has converged, in standard
#: deviations of z.
TOLERANCE = 1e-4
#: β of the quantiles for probabilities of exceedance, and number of steps from one β to the next.
EXCEEDANCE_NODES, EXCEEDANCE_STEPS = np.arange(-5.0, 6.0), 100
#: Most evaluations of a search. On the paper's scenario one or two are enough.
ITERATIONS = 60
#: Relative change of the last step of Newton's iteration, or bracket left by it, above which it has
#: not converged.
UNSETTLED = 1e-6
#: A gain above this factor times the predicted gain shows a curvature less than at u = 0. Without
#: any curvature the gain is twice the predicted gain.
EASY = 1.2


class Form(Distribution):
    """P_D of uncertain states by FORM: quantiles, and mean and σ as integrals over quantiles.

    A value is NaN where a search has not converged, or z has no gradient.

    Args:
        states: The uncertain states of k poses.
        derivatives: Expansions of z by block of poses, if they are known from other covariances.
    """

    def __init__(
        self, states: UncertainStates, derivatives: Sequence[SecondOrder] | None = None
    ) -> None:
        super().__init__(states)
        if derivatives is not None:
            self._derivatives = derivatives

    def quantile(self, beta: float) -> FloatArray:
        """Return the quantile of P_D (k,) at Φ(β)."""
        if beta in NODES and "_at_nodes" in vars(self):
            z, floor, _ = self._at_nodes
            z = z[np.flatnonzero(beta == NODES)]
        else:
            z, floor, _ = self._quantiles(np.array([beta]))
        return ndtr(np.maximum(z[0], floor))

    def exceedance(self, p_max: float) -> FloatArray:
        """Return P(P_D > p_max) (k,), which is Φ(−β) for the β whose quantile of P_D is p_max.

        β is interpolated by a cubic spline, and extrapolated linearly.
        """
        quantiles_of_z, floor, _ = self._quantiles(EXCEEDANCE_NODES)
        z, z_max = np.nan_to_num(quantiles_of_z), float(ndtri(p_max))
        ends = EXCEEDANCE_NODES[0], EXCEEDANCE_NODES[-1]
        fine = np.linspace(*ends, EXCEEDANCE_STEPS * (len(z) - 1) + 1)
        curve = np.maximum.accumulate(_along(_spline(EXCEEDANCE_NODES, fine), z), axis=0)
        left = np.clip(np.count_nonzero(curve <= z_max, axis=0) - 1, 0, len(fine) - 2)
        pose = np.arange(z.shape[1])
        low, high = curve[left, pose], curve[left + 1, pose]
        with np.errstate(divide="ignore", invalid="ignore"):
            beta = fine[left] + (z_max - low) / (high - low) * (fine[1] - fine[0])
        flat = high == low  # z does not change with β
        beta = np.where(flat, np.where(z_max < low, -np.inf, np.inf), beta)
        probability = np.where(z_max < floor, 1.0, ndtr(-beta))  # a floor comes after the spline
        return np.where(np.isnan(quantiles_of_z[0]), np.nan, probability)

    def with_covariances(self, changed: UncertainStates) -> Form:
        """Return the method for the same states with other covariances, at less cost."""
        return Form(changed, self._derivatives)

    @cached_property
    def _derivatives(self) -> Sequence[SecondOrder]:
        return [RelativeProbit(part).derivatives() for part in self._blocks]

    @property
    def _blocks(self) -> Iterator[UncertainStates]:
        n = 3 + self.states.radar.shape[-1]
        return self.states.blocks(n * max(n, len(NODES)))

    def _spaces(self) -> Iterator[StandardNormalSpace]:
        keep = "_derivatives" in vars(self)
        for number, part in enumerate(self._blocks):
            probit = RelativeProbit(part)
            z = self._derivatives[number] if keep else probit.derivatives()
            yield StandardNormalSpace.expanded(probit, z)

    def _quantiles(self, betas: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return z at Φ(β) (n, k), the floor of z (k,) and z of the nominal states (k,)."""
        z, floor, nominal = [], [], []
        for space in self._spaces():
            z.append(quantiles(space, betas))
            floor.append(space.probit.floor)
            nominal.append(space.value)
        return np.concatenate(z, axis=1), np.concatenate(floor), np.concatenate(nominal)

    @cached_property
    def _at_nodes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return self._quantiles(NODES)

    @cached_property
    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation of P_D (k,).

        P_D increases with z: the quantiles of z at Φ(β) give the quantiles of P_D at Φ(β). Mean and
        variance are integrals over the normal distribution of β. The lesser of P_D and 1 − P_D is
        integrated, about its median. A small deviation beside P_D ≈ 1 is then not lost.
        """
        z, floor, nominal = self._at_nodes
        weights, spline = _integration()
        side = np.where(nominal > 0, -1.0, 1.0)
        lesser = ndtr(side * np.maximum(_along(spline, z), floor))
        median = lesser[len(lesser) // 2].copy()
        lesser -= median
        drift = weights @ lesser
        lesser -= drift
        mean = median + drift
        return np.where(nominal > 0, 1.0 - mean, mean), np.sqrt(weights @ np.square(lesser))


def quantiles(space: StandardNormalSpace, betas: FloatArray) -> FloatArray:
    """Return quantiles of z (n, k) at Φ(β) for each β (n,); NaN where a search has no result."""
    known = np.isfinite(space.value + space.gradient.sum(axis=0) + space.curvature.sum(axis=0))
    # where nothing has an effect every quantile is z itself
    pose = np.flatnonzero(known & np.any((space.gradient != 0) | (space.curvature != 0), axis=0))
    shape = (len(betas), len(pose))
    # One row for each β and pose. With the sign of β, every row is a maximization.
    row, beta = np.tile(pose, len(betas)), np.repeat(betas, len(pose))
    sign, radius = np.where(beta < 0, -1.0, 1.0), np.abs(beta)
    g, lam = sign * space.gradient[:, row], sign * space.curvature[:, row]
    start = ball_maximum(g, lam, radius)
    expanded = space.value[row] + sign * np.sum((g + 0.5 * lam * start) * start, axis=0)
    extreme, converged = climb(space, row, sign, radius, g, lam, start)
    corrected = np.tile(space.value, (len(betas), 1))
    corrected[:, pose] = space.value[pose] + quadratic_quantile(
        space.gradient[:, pose], space.curvature[:, pose], betas
    )
    corrected[:, pose] += (sign * extreme - expanded).reshape(shape)
    known[pose] &= converged.reshape(shape).all(axis=0)
    known &= np.isfinite(corrected).all(axis=0)
    return np.where(known, corrected, np.nan)


def climb(
    space: StandardNormalSpace,
    row: NDArray[np.intp],
    sign: FloatArray,
    radius: FloatArray,
    g: FloatArray,
    lam: FloatArray,
    start: FloatArray,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the maxima of sign · z over |u| ≤ radius (j,), and where the search converged (j,).

    Each step goes to the maximum of an expansion in the ball. The expansion has the gradient at the
    present point and the curvature at u = 0. Without the curvature the maximum is β times the unit
    vector of the gradient (R. Rackwitz and B. Fiessler, Computers & Structures 9(5), 1978). A step
    that decreases z is undone. The next step is then damped as by Levenberg and Marquardt, which
    turns the step towards the gradient. After a step that gains far more than the curvature at
    u = 0 predicts, the next step uses less of the curvature.

    At the poses `row` (j,), sign · z has the gradient g and the curvatures λ (r, j) at u = 0.
    `start` (r, j) is the first u that is evaluated, the maximum of the second-order expansion.
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
    return best, converged


def ball_maximum(g: FloatArray, lam: FloatArray, radius: FloatArray) -> FloatArray:
    """Return the u (r, j) that maximizes Σ (g_i u_i + λ_i u_i²/2) in the ball |u| ≤ radius (j,).

    The maximum is u_i = g_i/(μ − λ_i) with the least μ ≥ max(0, λ_i) for which |u| ≤ radius.
    Newton's iteration solves 1/|u| = 1/radius for μ (J. J. Moré and D. C. Sorensen, SIAM J. Sci.
    Stat. Comput. 4(3), 1983). Where g has no component along the greatest λ, u and its mirror image
    may both be maxima. The u with the positive component is then returned. u is NaN where the
    iteration has not converged.
    """
    highest = np.max(lam, axis=0, initial=-np.inf)
    size = np.sqrt(np.sum(g * g, axis=0)) + radius * np.max(np.abs(lam), axis=0, initial=0.0)
    least = 1e-6 * size
    forks = (lam == highest) & (np.abs(g) < least)
    g = np.where(forks, np.where(g < 0, -least, least), g)
    low = np.maximum(highest, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        # From a μ too low, where |u| is too long, the iteration rises to the solution.
        mu = low + np.max(np.abs(g) / radius + lam - low, axis=0, initial=0.0)
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
            change = np.abs(mu[left] - before)
            still = change > 1e-14 * before
            left, change = left[still], change[still]
            if not left.size:
                break
        u = g / (mu - lam)
    u = np.where(np.isfinite(u), u, 0.0)  # 0/0: nothing to gain, or a ball of radius 0
    u[:, left[change > UNSETTLED * mu[left]]] = np.nan
    return u


def quadratic_quantile(g: FloatArray, lam: FloatArray, betas: FloatArray) -> FloatArray:
    """Return quantiles (n, k) of Σ (g_i u_i + λ_i u_i²/2) at Φ(β) for β (n,); g, λ are (r, k).

    The quantiles are by the saddlepoint approximation r* (O. E. Barndorff-Nielsen, Biometrika
    73(2), 1986). From the cumulant generating function K(t) = ½ Σ [t² g²/(1 − λt) − ln(1 − λt)],

        x = K'(t) is the quantile at β = r + ln(v/r)/r,  r = sign(t) √(2(tx − K)),  v = t √K''(t).

    β rises with t between the poles 1/λ. The substitution is t = w/(1 + λw), with λ the curvature
    of the pole on the same side. β is close to linear in w. Newton's method within a bracket finds
    the w of each β. A quantile is NaN where the iteration has not converged.
    """
    n, k = len(betas), g.shape[1]
    spread = np.sqrt(np.sum(g * g + 0.5 * lam * lam, axis=0))
    unit = np.where(spread > 0, spread, 1.0)
    g2, lam = (g / unit) ** 2, lam / unit
    skewness = np.sum((3.0 * g2 + lam * lam) * lam, axis=0)
    highest = np.max(lam, axis=0, initial=0.0)
    lowest = np.min(lam, axis=0, initial=0.0)
    row, beta = np.tile(np.arange(k), n), np.repeat(betas, k)
    w = beta - skewness[row] / 6.0
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
    x[left[np.arcsinh(high[left]) - np.arcsinh(low[left]) > UNSETTLED]] = np.nan
    return spread * x.reshape(n, k)


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


@cache
def _integration() -> tuple[FloatArray, FloatArray]:
    """Return weights (p,) of the normal distribution, and the spline matrix (p, nodes)."""
    beta = np.linspace(-6.0, 6.0, 61)
    weights = np.exp(-0.5 * beta * beta)
    return weights / weights.sum(), _spline(NODES, beta)


def _along(spline: FloatArray, z: FloatArray) -> FloatArray:
    """Return the spline (p, k) of quantiles of z (n, k). Only what changes with β is rounded."""
    middle = z[len(z) // 2]
    return middle + spline @ (z - middle)


def _spline(nodes: FloatArray, x: FloatArray) -> FloatArray:
    """Return the matrix (p, n) from values at nodes (n,) to their cubic spline at x (p,).

    The third derivative jumps at all nodes but the first two and the last two ("not a knot"). SciPy
    has this spline, but its import takes longer than FORM of the paper's scenario.
    """

    def basis(at: FloatArray) -> FloatArray:
        at = at[:, np.newaxis]
        return np.hstack([at ** np.arange(4), np.maximum(at - nodes[2:-2], 0.0) ** 3])

    return basis(x) @ np.linalg.inv(basis(nodes))
