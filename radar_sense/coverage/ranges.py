"""How far a radar detects the aircraft along rays, with σ and band of the range."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from radar_sense.coverage.rays import (
    FARTHEST,
    Rays,
    Reach,
    Survey,
    first_guess,
    reach_of_bound,
    reach_of_quantile,
)
from radar_sense.model.radar import ALWAYS, NEVER
from radar_sense.propagation import AUTOMATIC, propagate_scenario, unreliable_in_scenario
from radar_sense.propagation.automatic import ERRORS
from radar_sense.propagation.draws import estimate
from radar_sense.propagation.staged import FURTHER, MANY, PRECISE
from radar_sense.sources import error_budget
from radar_sense.states import FloatArray

#: Nodes ±√3 and 0 of the Gauss-Hermite rule of three points, exact for polynomials up to degree 5
#: (M. Abramowitz and I. A. Stegun, Handbook of Mathematical Functions, 1964, 25.4.46).
NODE = math.sqrt(3.0)
#: Relative step of the distance for the slope of P_D along a ray. The error is the square.
_STEP = 1e-5
#: Draws at each distance of the search for a bound by draws, and more where these are not precise.
#: The tolerance of z in the search is below its standard error.
DRAWS, TOLERANCE = (FURTHER, PRECISE, MANY), 0.01
#: Relative standard error of a bound of the range by draws that needs no more draws.
PRECISION = 0.01
#: Halvings of ± `PRECISION` about a distance where errors may cross a limit: P_D jumps within it.
HALVINGS = 6
#: Standard error of P_D at the bound above which few draws may have missed where P_D jumps.
LARGEST_ERROR = 0.05


@dataclass(frozen=True, eq=False)
class RangeAt:
    """Detection range for one P_D by bearing or aspect (n,), in metres of slant range.

    Attributes:
        p_d: P_D.
        reach: Distance along each ray.
        slant: Slant range; 0 where P_D is nowhere as high.
        std: Standard deviation; NaN where a limit of the radar comes first or cuts the band off,
            or there is no range.
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

    @property
    def shares(self) -> dict[str, float]:
        """Share of each source in the variance of the range, averaged over the angles."""
        variances = {name: std**2 for name, std in self.by_source.items()}
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
        unreliable = _unreliable(around, [np.where(exists, distance, 0.0)], "probit", k)
    else:
        lower, upper, std, unreliable = _band(seen, value, slant, method, k)
    defined = exists & ~reach.limited
    by_source = {
        name: np.where(defined, source.std / abs(slope), np.nan)
        for name, source in budget.sources.items()
    }
    std = np.where(defined, std, np.nan)
    return RangeAt(value, reach, slant, std, lower, upper, by_source, unreliable)


def _band(
    seen: Survey, value: float, slant: FloatArray, method: str, k: float
) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return bounds and σ (n,) of the slant range, and where they are not reliable."""
    around, betas = seen.all_rays, (-k, k, -NODE, NODE)
    smooth = "form" if method == AUTOMATIC else method
    ends = np.array([reach_of_quantile(seen, value, smooth, beta) for beta in betas])
    unreliable = _unreliable(around, ends[:2], smooth, k)
    cut, hidden = np.zeros_like(unreliable), np.zeros(len(slant))
    nowhere = np.flatnonzero((ends == 0).any(axis=0))
    if nowhere.size:
        hidden[nowhere] = _hidden(seen.part(nowhere), value, smooth, k)
    unreliable |= hidden > 0
    unknown = unreliable | np.isnan(ends).any(axis=0)
    if method == AUTOMATIC and unknown.any():
        rows, unreliable = np.flatnonzero(unknown), np.zeros_like(unknown)
        without, some = ends.copy(), seen.part(rows)
        for end, beta in zip(ends, betas, strict=True):
            guess = np.where(end == 0, hidden, end)[rows]
            end[rows], imprecise = _by_draws(some, guess, value, beta)
            unreliable[rows] |= imprecise
        moved = abs(ends - without) > 2.0 * PRECISION * without
        cut = moved.any(axis=0) & _limit_in_reach(around, ends[0])
    lower, upper, first, last = (around.slant_range(end) for end in ends)
    std = _std_of_quantiles(first, slant, last)
    std[cut] = np.nan  # three nodes do not follow a limit that moves an end
    return lower, upper, std, unreliable


def _hidden(seen: Survey, value: float, method: str, k: float) -> FloatArray:
    """Return how far (n,) errors may bring the aircraft in sight where its bound at kσ is enough.

    The bound is that without limits. The distance is 0 where errors do not.
    """
    guess, far = first_guess(seen, value, k), np.full(len(seen.p_d), FARTHEST)
    bound = partial(Rays.quantile, method=method, beta=k)
    free = reach_of_bound(seen, guess, value, far, bound)
    samples = np.broadcast_to(seen.distance, seen.p_d.shape)
    sight = seen.all_rays.at(samples, limits=True).states().sight().reshape(samples.shape)
    seen_at = (sight != NEVER) & (samples <= np.nan_to_num(free, nan=FARTHEST)[:, np.newaxis])
    return np.asarray(np.max(samples, axis=1, where=seen_at, initial=0.0))


def _std_of_quantiles(lower: FloatArray, middle: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the standard deviation (n,) of a function of a normal number, from three nodes."""
    mean = (lower + 4.0 * middle + upper) / 6.0
    variance = ((lower - mean) ** 2 + 4.0 * (middle - mean) ** 2 + (upper - mean) ** 2) / 6.0
    std: FloatArray = np.sqrt(variance)
    return std


def _unreliable(
    around: Rays, band: Iterable[FloatArray], method: str, k: float
) -> NDArray[np.bool_]:
    """Return where (n,) the method is unreliable at one end of the band, with limits in reach."""
    unreliable = np.zeros(len(around.bearing), dtype=bool)
    for end in band:
        exists = np.nan_to_num(end) > 0
        at = around.at(np.where(exists, end, FARTHEST), limits=True)
        moments = propagate_scenario(at, method=method, beta=k)
        unreliable |= exists & unreliable_in_scenario(at, moments, method=method, beta=k)
    return unreliable


def _limit_in_reach(around: Rays, distance: FloatArray) -> NDArray[np.bool_]:
    """Return where (n,) errors may take the aircraft at some distances (n,) beyond a limit."""
    reached = np.where(np.nan_to_num(distance) > 0, distance, FARTHEST)
    at = around.at(reached, limits=True)
    return np.asarray(at.states().sight()[:, 0] != ALWAYS)


def _by_draws(
    seen: Survey, guess: FloatArray, value: float, beta: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return how far (n,) the quantile of P_D at Φ(β) by draws reaches a value, within the limits.

    Few draws search the distance, from a guess (n,) that is NaN where none is known. More draws
    correct it until its standard error is `PRECISION`. Also returned is where (n,) even the most
    draws are not precise.
    """
    upper, limit = int(beta > 0), np.full(len(guess), FARTHEST)

    def drawn(draws: int, rays: Rays, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
        ends, errors = estimate(rays.at(distance, limits=True).states(), draws, abs(beta)).bounds
        return ends[upper], errors[upper]

    guess = np.where(np.isnan(guess), first_guess(seen, value, beta), guess)
    reach = reach_of_bound(
        seen, guess, value, limit, lambda *at: drawn(DRAWS[0], *at)[0], TOLERANCE
    )
    rows = np.flatnonzero(reach > 0)
    for draws in DRAWS:
        if not rows.size:
            break
        rays, at = seen.all_rays.part(rows), reach[rows]
        near, near_error = drawn(draws, rays, at * (1.0 - PRECISION))
        far, far_error = drawn(draws, rays, at * (1.0 + PRECISION))
        enclosed = (near - value > ERRORS * near_error) & (value - far > ERRORS * far_error)
        # at the end of the search the bound is higher than the value, and needs no precision
        enclosed |= (at >= FARTHEST) & (far - value > ERRORS * far_error)
        fall = near - far
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where(fall > 0, ((near + far) / 2.0 - value) / fall, 0.0)
        sure = (far_error <= LARGEST_ERROR) & (2.0 * far_error <= fall)
        # where errors may cross a limit P_D jumps, and no straight line leads there
        jumps = (near > value) & (value > far) & _limit_in_reach(rays, at)
        settled = enclosed | (sure & (abs(step) <= 1.0) & ~jumps)
        step = np.where(enclosed | jumps, 0.0, np.clip(step, -1.0, 1.0))
        reach[rows] = np.minimum(at * np.exp(2.0 * PRECISION * step), FARTHEST)
        some = np.flatnonzero(jumps)
        low, high = at[some] * (1.0 - PRECISION), at[some] * (1.0 + PRECISION)
        for _ in range(HALVINGS if some.size else 0):
            middle = 0.5 * (low + high)
            above = drawn(draws, rays.part(some), middle)[0] > value
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        reach[rows[some]] = 0.5 * (low + high)
        rows = rows[~settled]
    return reach, np.isin(np.arange(len(reach)), rows)


def _slope(around: Rays, distance: FloatArray) -> FloatArray:
    """Return the slope (n,) of P_D by slant range along each ray [1/m]."""
    ends = [distance * (1.0 + step) for step in (-_STEP, _STEP)]
    low, high = (around.p_d(end[:, np.newaxis])[:, 0] for end in ends)
    near, far = (around.slant_range(end) for end in ends)
    # for an aircraft very far above or below, both ends round to one slant range
    undefined = np.full_like(far, np.nan)
    slope: FloatArray = np.divide(high - low, far - near, out=undefined, where=far != near)
    return slope


def limit_of_radar(seen: Survey) -> FloatArray:
    """Return the slant range (n,) of the limit of the radar; infinite if no limit is reached."""
    if seen.visible[:, -1].all():
        return np.full(len(seen.visible), np.inf)
    return seen.all_rays.slant_range(seen.limit)
