"""How far a radar detects the aircraft along rays, with σ and band of the range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from radar_sense.coverage.drawn import DrawnRanges
from radar_sense.coverage.rays import FARTHEST, NEAREST, Rays
from radar_sense.coverage.reach import END, INSIDE, Reach, Survey, reach_of_quantile
from radar_sense.propagation import AUTOMATIC, STD_CHANGE
from radar_sense.propagation.automatic import ERRORS, judged
from radar_sense.propagation.draws import Estimate
from radar_sense.propagation.staged import FIRST, PRECISE, StagedDraws
from radar_sense.sources import error_budget
from radar_sense.states import FloatArray

#: Relative step of the distance for the slope of P_D along a ray. The error is the square.
_STEP = 1e-5
#: Part of itself by which the end of a band may be off.
PRECISION = 0.01
#: Most looks of all draws of a stage at a ray: with lobes and masks a draw takes many.
LOOKS = 500_000
#: Standard error of σ, as a part of it, that is small enough.
ERROR_OF_STD = 0.02


@dataclass(frozen=True, eq=False)
class RangeAt:
    """Detection range for one P_D by bearing or aspect (n,), in metres of slant range.

    Attributes:
        p_d: P_D.
        reach: Distance along each ray.
        slant: Slant range; 0 where P_D is nowhere as high.
        std: Standard deviation; NaN where there is no range or the search ends, and by linear
            where a limit of the radar comes first.
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

    By linear, σ is σ of P_D divided by the slope of P_D. By any other method it is σ of drawn
    ranges. These judge the bounds, and by `automatic` replace those that they do not confirm.
    """
    around, reach, limit = seen.all_rays, seen.reach(value), limit_of_radar(seen)
    exists, free, by_draws = reach.distance > 0, reach.free, method == AUTOMATIC
    first, staged, most = _drawn(seen, reach, value, k)
    total, by_source = _to_first_order(around, np.where(exists & ~reach.endless, free, np.nan))
    if method == "linear":  # as if there were no limit, and cut off there
        ends = around.slant_range(free) + np.array([[-k], [k]]) * total
        bounds = np.where(exists, np.clip(ends, 0.0, limit), 0.0)
    else:
        of_p_d = "form" if by_draws else method
        guesses = zip((-k, k), first.bounds[0], strict=True)
        found = (reach_of_quantile(seen, value, of_p_d, *guess) for guess in guesses)
        bounds = np.stack([around.slant_range(end) for end in found])
    drawn, confirmed, off = judged(
        staged, tuple(bounds), _of_ranges, to_precision=by_draws, most=most
    )
    if by_draws:
        confirmed &= np.all(bounds < INSIDE * limit, axis=0)  # FORM does not see limits
        of_draws, errors = drawn.bounds
        bounds = np.where(confirmed, bounds, of_draws)
        off = ~confirmed & np.any(errors > PRECISION * of_draws, axis=0)
        off |= exists & (of_draws[1] == 0)  # too few of them have a range

    def precise(rows: NDArray[np.intp], found: Estimate) -> NDArray[np.bool_]:
        (_, std), (_, error) = found.moments
        return error <= ERROR_OF_STD * std

    std = staged.until(precise, most).moments[0][1]
    if method == "linear":
        first_order = np.where(reach.limited, np.nan, total)
        off |= abs(first_order - std) > (STD_CHANGE + ERRORS * ERROR_OF_STD) * std
        std = first_order
    lower, upper = bounds
    return RangeAt(
        value,
        reach,
        slant=around.slant_range(reach.distance),
        std=np.where(exists & ~reach.endless, std, np.nan),
        lower=lower,
        upper=upper,
        by_source={name: np.where(reach.limited, np.nan, s) for name, s in by_source.items()},
        unreliable=off & ~reach.endless,
    )


def _drawn(
    seen: Survey, reach: Reach, value: float, k: float
) -> tuple[Estimate, StagedDraws, NDArray[np.intp]]:
    """Return what few drawn ranges say, stages with more of them, and the most draws of one (n,).

    More draws are about errors that matter at the ends of the band, here as on a flat earth.
    """
    around, free = seen.all_rays, reach.free
    # Without a range, errors matter where P_D has the value beyond a limit, or where it is highest.
    other = np.where(free > 0, free, seen.places.distance[np.argmax(seen.p_d, axis=1)])
    centre = np.where(reach.distance > 0, INSIDE * reach.distance, other)
    at_centre = DrawnRanges(around, seen.places, np.stack([centre, centre]), value)
    first = at_centre.estimate(np.arange(len(free)), FIRST, k)
    height_squared = around.slant_range(centre) ** 2 - centre**2
    distance = np.sqrt(np.maximum(first.bounds[0] ** 2 - height_squared, NEAREST**2))
    bounds = np.where(first.bounds[0] > 0, distance, centre)
    at_ends = DrawnRanges(around, seen.places, bounds, value)
    staged = StagedDraws.after(first, partial(at_ends.estimate, beta=k))
    return first, staged, np.minimum(LOOKS // at_centre.looks, PRECISE)


def _to_first_order(around: Rays, distance: FloatArray) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return σ (n,) of the range at distances (n,) of the rays, and of each source alone.

    They are σ of P_D divided by the slope of P_D, NaN where P_D does not fall or a distance is NaN.
    """
    place = np.nan_to_num(distance, nan=FARTHEST)
    slope = _slope(around, place)
    fall = np.where(np.isfinite(distance) & (slope < 0), -slope, np.nan)
    budget = error_budget(around.at(place))
    return budget.total.std / fall, {n: c.std / fall for n, c in budget.sources.items()}


def _of_ranges(found: Estimate) -> tuple[FloatArray, ...]:
    """Return the bounds by draws (2, n), their standard errors, tolerances, and a small noise."""
    drawn, errors = found.bounds
    return drawn, errors, PRECISION * drawn, ERRORS * PRECISION * drawn


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
    return np.where(seen.limit < END, seen.all_rays.slant_range(seen.limit), np.inf)
