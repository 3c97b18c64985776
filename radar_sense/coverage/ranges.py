"""How far a radar detects the aircraft along rays, with σ and band of the range."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from radar_sense.coverage.rays import (
    END,
    FARTHEST,
    INSIDE,
    NEAREST,
    STRIDE,
    Rays,
    Reach,
    Survey,
    first_guess,
    halved,
    quantile_above,
    reach_of_bound,
    reach_of_quantile,
)
from radar_sense.model.radar import ALWAYS, NEVER
from radar_sense.propagation import AUTOMATIC, STD_CHANGE, distribution
from radar_sense.propagation.automatic import ERRORS
from radar_sense.propagation.draws import tail_probability
from radar_sense.propagation.staged import FIRST, FURTHER, MANY, PRECISE
from radar_sense.sources import error_budget
from radar_sense.states import FloatArray

#: Half the width in σ of the band whose ranges make σ.
WIDEST = 3.0
#: Nodes and weights (10,) of integrals from −1 to 1; 8 are enough to 0.1 % for a normal range.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(10)
#: Relative standard error of σ by the draws that find it, as of a normal number.
ERROR_OF_STD = 1.0 / math.sqrt(2.0 * FURTHER)
#: Relative step of the distance for the slope of P_D along a ray. The error is the square.
_STEP = 1e-5
#: Draws at a sample that look for a lobe beyond an end of a band, and the factor on the end from
#: which on they look: nearer, P is still near that of the end.
LOOKS, BEYOND = 128, 1.05
#: Draws at both sides of an end of a band, and more where these do not tell whether it is between.
DRAWS = FURTHER, PRECISE, MANY
#: Part of itself by which the end of a band may be off.
PRECISION = 0.01
#: What ends a search by draws: an error of Φ⁻¹(P) below its standard error, or of the distance.
TOLERANCES = 0.01, PRECISION / 100.0


@dataclass(frozen=True, eq=False)
class RangeAt:
    """Detection range for one P_D by bearing or aspect (n,), in metres of slant range.

    Attributes:
        p_d: P_D.
        reach: Distance along each ray.
        slant: Slant range; 0 where P_D is nowhere as high.
        std: Standard deviation; NaN where a limit of the radar comes first or cuts the band off,
            where P_D passes the value several times within the band, or there is no range.
        lower: Lower bound at Φ(−k).
        upper: Upper bound at Φ(k).
        by_source: Standard deviation from each source alone, to first order.
        unreliable: Where the method is off, or draws are not precise.
    """

    p_d: float
    reach: Reach
    slant: FloatArray
    std: FloatArray
    lower: FloatArray
    upper: FloatArray
    by_source: Mapping[str, FloatArray]
    unreliable: NDArray[np.bool_]

    def shares(self, rows: Sequence[int] | slice = slice(None)) -> dict[str, float]:
        """Return the share of each source in the variance of the range, averaged over angles."""
        variances = {name: std[rows] ** 2 for name, std in self.by_source.items()}
        total = np.sum(list(variances.values()), axis=0)
        known = total > 0
        if not known.any():
            return {}
        return {name: float(np.mean(v[known] / total[known])) for name, v in variances.items()}


def range_at(seen: Survey, value: float, method: str, k: float) -> RangeAt:
    """Return the detection range for a P_D, with σ, and a band of kσ by a method.

    By linear, σ is σ of P_D divided by the slope of P_D.
    """
    around, reach = seen.all_rays, seen.reach(value)
    exists, slant = reach.distance > 0, around.slant_range(reach.distance)
    # Where a limit comes first, the band is computed without the limit and cut off there.
    distance = np.where(exists, seen.reach(value, limits=False).distance, FARTHEST)
    slope = _slope(around, distance)
    slope = np.where(exists & (slope < 0), slope, np.nan)
    budget = error_budget(around.at(distance))
    if method == "linear":
        std = budget.total.std / abs(slope)
        middle, limit = around.slant_range(distance), limit_of_radar(seen)
        lower, upper = (np.clip(middle + sign * k * std, 0.0, limit) for sign in (-1, 1))
        ends = zip((lower, upper), (-k, k), strict=True)
        along = {beta: _along(around, end) for end, beta in ends}
        confirmed = [_confirmed(around, end, value, beta) for beta, end in along.items()]
        hidden = ~exists & (_hidden(seen, value, method, k) > 0)
        unreliable = exists & ~np.all(confirmed, axis=0) | hidden
        unreliable |= _farther(seen, along[k], value, k) > 0
    else:
        lower, upper, std, unreliable = _band(seen, value, method, k)
    defined = exists & ~reach.limited & ~reach.endless
    by_source = {
        name: np.where(defined, source.std / abs(slope), np.nan)
        for name, source in budget.sources.items()
    }
    std = np.where(defined, std, np.nan)
    return RangeAt(value, reach, slant, std, lower, upper, by_source, unreliable)


def _band(
    seen: Survey, value: float, method: str, k: float
) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return bounds and σ (n,) of the slant range, and where they are not reliable."""
    around, smooth = seen.all_rays, "form" if method == AUTOMATIC else method
    betas = {-k, k, -WIDEST, WIDEST}
    ends = {beta: reach_of_quantile(seen, value, smooth, beta) for beta in betas}
    off, hidden = {}, np.zeros(len(seen.p_d))
    nowhere = np.flatnonzero(np.any([end == 0 for end in ends.values()], axis=0))
    if nowhere.size:
        hidden[nowhere] = _hidden(seen.part(nowhere), value, smooth, k)
    rises = np.zeros(len(seen.p_d), dtype=bool)
    for beta, end in ends.items():
        farther, confirmed = _farther(seen, end, value, beta), _confirmed(around, end, value, beta)
        rises |= confirmed & (farther > 0)
        wrong = np.where(end == 0, hidden > 0, ~confirmed) | (farther > 0)
        if method == AUTOMATIC:  # at a limit the end is not of the method, and errors may cross it
            wrong |= (end >= INSIDE * seen.limit) & (end > 0) & _limit_in_reach(around, end)
        rows = np.flatnonzero(wrong)
        if method == AUTOMATIC and rows.size:
            guess = np.where(farther > 0, farther, np.where(end == 0, hidden, end))[rows]
            end[rows], wrong[rows] = _by_draws(seen.part(rows), guess, value, beta)
        off[beta] = wrong & ~np.isnan(end)  # which is said to have no value
    lower, upper = (around.slant_range(ends[beta]) for beta in (-k, k))
    std, of_std = _std(around, ends[-WIDEST], ends[WIDEST], value, method)
    std[rises | (ends[-WIDEST] <= seen.last_window(value))] = np.nan
    return lower, upper, std, off[-k] | off[k] | of_std


def _farther(seen: Survey, end: FloatArray, value: float, beta: float) -> FloatArray:
    """Return how far (n,) draws find P_D above a value beyond an end of a band; 0 if nowhere.

    Errors may turn a lobe of RCS or antenna to an aircraft far beyond the range.
    """
    farthest = np.zeros(len(end))
    if beta < 0 or seen.monotone:
        return farthest
    samples = seen.distance[::STRIDE]
    beyond = samples > BEYOND * np.nan_to_num(end)[:, np.newaxis]
    rays, at = np.nonzero(beyond & (samples <= seen.limit[:, np.newaxis]))
    for draws, sign in ((LOOKS, 1.0), (FURTHER, -1.0)):  # few draws say where there is none
        states = seen.all_rays.part(rays).at(samples[at], limits=True).states()
        tail, error = tail_probability(states, draws, beta, value)
        above = tail + sign * ERRORS * error > ndtr(-beta)
        rays, at = rays[above], at[above]
    np.maximum.at(farthest, rays, samples[at])
    return farthest


def _hidden(seen: Survey, value: float, method: str, k: float) -> FloatArray:
    """Return how far (n,) errors may bring the aircraft in sight where its bound at kσ is enough.

    The bound is that without limits. The distance is 0 where errors do not.
    """
    far, above = np.full(len(seen.p_d), FARTHEST), quantile_above(value, method, k)
    free = reach_of_bound(seen, *first_guess(seen, value, k), far, above)
    samples = np.broadcast_to(seen.distance, seen.p_d.shape)
    sight = seen.all_rays.at(samples, limits=True).states().sight().reshape(samples.shape)
    seen_at = (sight != NEVER) & (samples <= np.nan_to_num(free, nan=FARTHEST)[:, np.newaxis])
    return np.asarray(np.max(samples, axis=1, where=seen_at, initial=0.0))


def _std(
    around: Rays, lower: FloatArray, upper: FloatArray, value: float, method: str
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return σ (n,) of the slant range, and where draws say that it is off.

    The band is between two distances (n,), at ±`WIDEST` σ. σ is NaN where errors within the band
    may cross a limit or leave no range, and where the band reaches the end of the search.
    """
    std, off = np.full(len(lower), np.nan), np.zeros(len(lower), dtype=bool)
    cut = [(end == 0) | (end >= END) | _limit_in_reach(around, end) for end in (lower, upper)]
    rows = np.flatnonzero(~np.any(cut, axis=0))
    if rows.size:
        part = around.part(rows)
        ends = part.slant_range(lower[rows]), part.slant_range(upper[rows])
        std[rows] = drawn = _integrated_std(part, *ends, value, AUTOMATIC)
        if method != AUTOMATIC:
            std[rows] = _integrated_std(part, *ends, value, method)
            off[rows] = abs(std[rows] - drawn) > (STD_CHANGE + ERRORS * ERROR_OF_STD) * drawn
    return std, off


def _integrated_std(
    around: Rays, lower: FloatArray, upper: FloatArray, value: float, method: str
) -> FloatArray:
    """Return σ (n,) of the slant range, from P(P_D > value) by a method between two ends (n,).

    A range is above r with the probability that P_D at r exceeds the value, see
    `reach_of_quantile`. Its moments are integrals of this probability.
    """
    half = (upper - lower)[:, np.newaxis] / 2.0
    above_lower = half * (1.0 + _NODES)
    each = around.part(np.repeat(np.arange(len(lower)), len(_NODES)))
    distance = _along(each, (lower[:, np.newaxis] + above_lower).ravel())
    if method == AUTOMATIC:
        states = each.at(distance, limits=True).states()
        above, _ = tail_probability(states, FURTHER, WIDEST, value)
    else:
        above = distribution(each.at(distance), method).exceedance(value)
    weighted = half * _WEIGHTS * above.reshape(above_lower.shape)
    mean, square = np.sum(weighted, axis=1), np.sum(2.0 * above_lower * weighted, axis=1)
    return np.asarray(np.sqrt(np.maximum(square - mean**2, 0.0)))


def _along(around: Rays, slant: FloatArray) -> FloatArray:
    """Return the distances (n,) at slant ranges (n,); 0 for 0."""
    ends = np.full(len(slant), NEAREST), np.full(len(slant), FARTHEST)
    near, far = halved(*ends, lambda at: around.slant_range(at) < slant)
    return np.where(slant > 0, np.sqrt(near * far), 0.0)


def _limit_in_reach(around: Rays, distance: FloatArray) -> NDArray[np.bool_]:
    """Return where (n,) errors may take the aircraft at some distances (n,) beyond a limit."""
    reached = np.where(np.nan_to_num(distance) > 0, distance, FARTHEST)
    at = around.at(reached, limits=True)
    return np.asarray(at.states().sight(WIDEST)[:, 0] != ALWAYS)


def _confirmed(around: Rays, end: FloatArray, value: float, beta: float) -> NDArray[np.bool_]:
    """Return where (n,) draws confirm the end of a band."""
    confirmed = np.zeros(len(end), dtype=bool)
    rows = np.flatnonzero(end > 0)
    for draws in (FIRST, *DRAWS):
        if not rows.size:
            break
        excess, errors = _beside(around.part(rows), end[rows], value, beta, draws)
        confirmed[rows] = _enclosed(excess, errors, end[rows])
        off = np.any(excess * np.array([[1.0], [-1.0]]) < -ERRORS * errors, axis=0)
        rows = rows[~confirmed[rows] & ~off]
    return confirmed


def _by_draws(
    seen: Survey, guess: FloatArray, value: float, beta: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return how far (n,) the quantile of P_D at Φ(β) by draws reaches a value, within the limits.

    There P(P_D > value) is Φ(−β). It falls with distance without a jump, also across a limit that
    errors may cross. Few draws search the distance, from a guess (n,) that is NaN where none
    is known. More draws correct it until its standard error is `PRECISION`: Φ⁻¹(P) is close to
    linear. Also returned is where (n,) even the most draws are not precise.
    """
    limit = np.full(len(guess), FARTHEST)
    first, step = first_guess(seen, value, beta)
    guess = np.where(np.isnan(guess), first, guess)

    def above(rays: Rays, at: FloatArray) -> FloatArray:
        tail, _ = tail_probability(rays.at(at, limits=True).states(), FIRST, beta, value)
        return np.asarray(np.sign(beta) * ndtri(tail) + beta)

    reach = reach_of_bound(seen, guess, step, limit, above, *TOLERANCES)
    rows = np.flatnonzero(reach > 0)
    for draws in DRAWS:
        if not rows.size:
            break
        at = reach[rows]
        excess, errors = _beside(seen.all_rays.part(rows), at, value, beta, draws)
        near, far = np.sign(beta) * ndtri(np.sign(beta) * excess + ndtr(-abs(beta)))
        with np.errstate(divide="ignore", invalid="ignore"):
            step = ((near + far) / 2.0 + beta) / np.maximum(near - far, 0.0)
        sure = 2.0 * np.max(errors, axis=0) <= excess[0] - excess[1]
        enclosed = _enclosed(excess, errors, at)
        settled = enclosed | (sure & (abs(step) <= 1.0))
        # beside a limit Φ⁻¹(P) is not linear, and the search has found the end
        step = np.where(enclosed, 0.0, np.clip(np.nan_to_num(step), -1.0, 1.0))
        reach[rows] = np.minimum(at * np.exp(2.0 * PRECISION * step), FARTHEST)
        rows = rows[~settled]
    return reach, np.isin(np.arange(len(reach)), rows)


def _beside(
    rays: Rays, end: FloatArray, value: float, beta: float, draws: int
) -> tuple[FloatArray, FloatArray]:
    """Return P(P_D > value) − Φ(−β) (2, n) by draws, `PRECISION` nearer than an end and farther.

    The standard errors (2, n) are returned, too. Both are of the smaller tail, without rounding.
    """
    sides = end[:, np.newaxis] * (1.0 + PRECISION * np.array([-1.0, 1.0]))
    found = tail_probability(rays.at(sides, limits=True).states(), draws, beta, value)
    tail, errors = (values.reshape(sides.shape).T for values in found)
    return np.sign(beta) * (tail - ndtr(-abs(beta))), errors


def _enclosed(excess: FloatArray, errors: FloatArray, end: FloatArray) -> NDArray[np.bool_]:
    """Return where (n,) the end by draws is between two sides, from what `_beside` returns.

    At the end of the search P is higher than wanted, and needs no precision.
    """
    higher, lower = excess > ERRORS * errors, excess < -ERRORS * errors
    return np.asarray(higher[0] & (lower[1] | (end >= FARTHEST) & higher[1]))


def _slope(around: Rays, distance: FloatArray) -> FloatArray:
    """Return the slope (n,) of P_D by slant range along each ray [1/m]."""
    ends = [distance * (1.0 + step) for step in (-_STEP, _STEP)]
    low, high = (around.p_d(end) for end in ends)
    near, far = (around.slant_range(end) for end in ends)
    # for an aircraft very far above or below, both ends round to one slant range
    undefined = np.full_like(far, np.nan)
    return np.divide(high - low, far - near, out=undefined, where=far != near)


def limit_of_radar(seen: Survey) -> FloatArray:
    """Return the slant range (n,) of the limit of the radar; infinite if no limit is reached."""
    if seen.visible[:, -1].all():
        return np.full(len(seen.visible), np.inf)
    return seen.all_rays.slant_range(seen.limit)
