"""Mean, deviation and bounds of P_D by weighted draws, many of them in the tails.

Nothing is assumed of P_D: draws follow limits, horizons, lobes and several radars alike. Every
number has a standard error. All poses have the same unit normals, so that bounds change smoothly
from pose to pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from radar_sense.propagation.emphasis import Mixture
from radar_sense.states import FloatArray
from radar_sense.streams import Stream, random_stream
from radar_sense.uncertain_states import BLOCK, UncertainStates

#: Draws of the mixture at a time. A matrix product of this size stays in one thread.
DRAWS = 1024
#: Numbers of an array that is computed at a time (2 MB), and of P_D that are kept (8 MB).
TOGETHER, KEPT = 2**18, 2**20


@dataclass(frozen=True, eq=False)
class Estimate:
    """What draws at k poses say of P_D.

    Attributes:
        mean: Mean of P_D (k,).
        mean_error: Standard error of `mean` (k,).
        std: Standard deviation of P_D (k,).
        std_error: Standard error of `std` (k,).
        lower: Bound that P_D falls below with probability Φ(−β) (k,).
        lower_error: Standard error of `lower` (k,).
        upper: Bound that P_D stays below with probability Φ(β) (k,).
        upper_error: Standard error of `upper` (k,).
        above: P(P_D > p_max) (k,); NaN without p_max.
        above_error: Standard error of `above` (k,).
        draws: Number of draws (k,).
    """

    mean: FloatArray
    mean_error: FloatArray
    std: FloatArray
    std_error: FloatArray
    lower: FloatArray
    lower_error: FloatArray
    upper: FloatArray
    upper_error: FloatArray
    above: FloatArray
    above_error: FloatArray
    draws: FloatArray

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bound (2, k), and their standard errors (2, k)."""
        errors = np.stack([self.lower_error, self.upper_error])
        return np.stack([self.lower, self.upper]), errors

    @property
    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation (2, k), and their standard errors (2, k)."""
        errors = np.stack([self.mean_error, self.std_error])
        return np.stack([self.mean, self.std]), errors

    @classmethod
    def constant(cls, poses: int, value: float) -> Estimate:
        """Return an estimate with one value of everything at all poses, to be filled."""
        return cls(*(np.full(poses, value) for _ in fields(cls)))

    @classmethod
    def join(cls, parts: Sequence[Estimate]) -> Estimate:
        """Return the values at the poses of all parts, one part after the other."""
        arrays = zip(*(vars(part).values() for part in parts), strict=True)
        return cls(*map(np.concatenate, arrays))

    def at(self, rows: NDArray[np.intp] | slice) -> Estimate:
        """Return a copy of the values at some poses."""
        return Estimate(*(values[rows].copy() for values in vars(self).values()))

    def put(self, rows: NDArray[np.intp] | slice, other: Estimate) -> None:
        """Overwrite the values at some poses."""
        for name, values in vars(self).items():
            values[rows] = getattr(other, name)


def estimate(
    states: UncertainStates, draws: int, beta: float, p_max: float = np.nan, *, plain: bool = False
) -> Estimate:
    """Return what draws say of P_D at each pose: it is 0 where no radar may see the aircraft.

    Args:
        states: The uncertain states of k poses.
        draws: Number of draws at each pose.
        beta: β of the bounds.
        p_max: Limit whose exceedance is counted; NaN for none.
        plain: Whether to draw from the natural density alone.
    """
    found, size = Estimate.constant(len(states), 0.0), max(1, KEPT // draws)
    found.draws[:] = draws
    if np.isnan(p_max):
        found.above[:] = found.above_error[:] = np.nan
    for poses, part in states.by_sight():
        first = 0
        for block in part.cut(BLOCK):
            block = _row_by_row(block)
            mixture = None if plain else Mixture.of(block, beta)
            for start in range(0, len(block), size):
                rows = slice(start, start + size)
                drawn = _draw(block.at(rows), mixture and mixture.at(rows), draws)
                last = first + len(drawn[0])
                found.put(poses[first:last], _estimate(*drawn, beta, p_max))
                first = last
    return found


def _draw(
    states: UncertainStates, mixture: Mixture | None, draws: int
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return P_D (k, n), weights (k, n), and what is beyond the planes of the mixture (2, k, n).

    Each of the parts of `DRAWS` draws is a whole mixture.
    """
    p_d, beyond = np.empty((len(states), draws)), np.zeros((2, len(states), draws), dtype=bool)
    weights = np.full(p_d.shape, 1.0 / draws)
    rng, d = random_stream(states.seed, Stream.EMPHASIS, draws), states.normals
    size = max(1, TOGETHER // (min(draws, DRAWS) * d))
    for start in range(0, draws, DRAWS):
        normals = rng.standard_normal((d, min(DRAWS, draws - start)))
        n = normals.shape[1]
        for first in range(0, len(states), size):
            rows, columns = slice(first, first + size), slice(start, start + n)
            if mixture is None:
                u = np.broadcast_to(normals, (len(p_d[rows]), d, n))
            else:
                u, ratio, beyond[:, rows, columns] = mixture.at(rows).draw(normals)
                weights[rows, columns] *= ratio
            p_d[rows, columns] = states.model.unchecked_p_d(*states.at_normals(u, rows))
    return p_d, weights, beyond


def _row_by_row(states: UncertainStates) -> UncertainStates:
    """Return states with a row of nominal states for each pose."""
    return replace(
        states,
        aircraft=np.broadcast_to(states.aircraft, (len(states), states.aircraft.shape[1])),
        radar=np.broadcast_to(states.radar, (len(states), states.radar.shape[1])),
    )


def _estimate(
    p_d: FloatArray, weights: FloatArray, beyond: NDArray[np.bool_], beta: float, p_max: float
) -> Estimate:
    """Return the estimate from P_D (k, n), weights (k, n), which add up to about 1, and planes.

    Args:
        p_d: P_D of the draws (k, n).
        weights: Weights of the draws (k, n).
        beyond: Which draws are beyond a plane near the greatest P_D, and one near the least
            (2, k, n), each with probability Φ(−β); none if there is no such plane.
        beta: β of the bounds.
        p_max: Limit whose exceedance is counted; NaN for none.
    """
    total = np.sum(weights, axis=1)
    mean = np.sum(weights * p_d, axis=1) / total
    mean = np.where(np.ptp(p_d, axis=1) == 0, p_d[:, 0], mean)  # without rounding
    square = np.square(p_d - mean[:, np.newaxis])
    variance = np.sum(weights * square, axis=1) / total
    std = np.sqrt(variance)
    mean_error = np.sqrt(np.sum(weights * weights * square, axis=1))
    off = np.sum(np.square(weights * (square - variance[:, np.newaxis])), axis=1)
    with np.errstate(invalid="ignore"):
        std_error = np.where(std > 0, 0.5 * np.sqrt(off) / std, 0.0)

    order = np.argsort(p_d, axis=1)
    order += np.arange(0, p_d.size, p_d.shape[1])[:, np.newaxis]  # places in the whole array
    values, weights = (array.ravel()[order] for array in (p_d, weights))
    high, low = (side.ravel()[order] for side in beyond)
    tail = float(ndtr(-beta))
    lower, lower_error = _quantile(values, weights, low, tail)
    upper, upper_error = _quantile(values[:, ::-1], weights[:, ::-1], high[:, ::-1], tail)
    above, above_error = np.full(len(p_d), np.nan), np.full(len(p_d), np.nan)
    if not np.isnan(p_max):
        # from the rarer of the two sides, so that the probability is at most 1
        up, up_error = _share(weights, values > p_max, high, tail)
        down, down_error = _share(weights, values <= p_max, low, tail)
        above = np.where(up <= down, up, 1.0 - down)
        above_error = np.where(up <= down, up_error, down_error)
    return Estimate(
        mean,
        mean_error,
        std,
        std_error,
        lower,
        lower_error,
        upper,
        upper_error,
        above,
        above_error,
        np.full(len(p_d), float(p_d.shape[1])),
    )


def _quantile(
    values: FloatArray, weights: FloatArray, beyond: NDArray[np.bool_], tail: float
) -> tuple[FloatArray, FloatArray]:
    """Return the first of the values (k, n) with this weight up to it, and its standard error (k,).

    The weight beyond a plane is a control variate: it should be `tail`, and what it has too much
    goes to the quantile (T. Hesterberg and B. Nelson, Management Science 44(9), 1998). Where P_D
    changes along one direction, all draws up to the quantile are beyond the plane, and no error is
    left.

    The standard error is a third of the way to the values at three standard errors of the weight.
    It is large beside a jump of P_D that the tail may or may not reach.
    """
    number, known = np.arange(values.shape[1]), weights * beyond
    mass, control = np.cumsum(weights, axis=1), np.sum(known, axis=1, keepdims=True)

    def first(level: FloatArray | float) -> NDArray[np.intp]:
        index = np.count_nonzero(mass < level, axis=1, keepdims=True)
        return np.asarray(np.minimum(index, len(number) - 1))

    def at(array: FloatArray, index: NDArray[np.intp]) -> FloatArray:
        return np.take_along_axis(array, index, axis=1)

    slope = _slope(weights * (number <= first(tail)), known)
    level = tail + slope * (control - tail)
    index = first(level)
    counted = weights * (number <= index)
    # Draws between plane and quantile are counted. That there are none may be chance.
    heaviest = np.maximum(2.0 * at(weights, index), np.max(counted, axis=1, keepdims=True))
    error = np.sqrt(_variance(counted - slope * known) + heaviest * heaviest)
    quantile = at(values, index)
    beside = (abs(at(values, first(level + away * error)) - quantile) for away in (-3.0, 3.0))
    return quantile[:, 0], np.maximum(*beside)[:, 0] / 3.0


def _share(
    weights: FloatArray, inside: NDArray[np.bool_], beyond: NDArray[np.bool_], tail: float
) -> tuple[FloatArray, FloatArray]:
    """Return the weight (k,) of draws (k, n) that are inside, and its standard error.

    The weight beyond a plane is a control variate, as in `_quantile`.
    """
    counted, known = weights * inside, weights * beyond
    slope = _slope(counted, known)
    share = np.sum(counted, axis=1)
    taken = slope[:, 0] * (np.sum(known, axis=1) - tail)
    resolution = 2.0 * share / np.maximum(np.count_nonzero(inside, axis=1), 1)
    variance = _variance(counted - slope * known)[:, 0]
    return np.clip(share - taken, 0.0, 1.0), np.sqrt(variance + resolution * resolution)


def _slope(counted: FloatArray, known: FloatArray) -> FloatArray:
    """Return the change (k, 1) of the sum of counted weights (k, n) by that of known weights."""
    n = counted.shape[1]
    total, control = (np.sum(w, axis=1, keepdims=True) for w in (counted, known))
    of_both = np.sum(counted * known, axis=1, keepdims=True) - total * control / n
    of_control = _variance(known)
    slope: FloatArray = np.divide(
        of_both, of_control, out=np.zeros_like(of_control), where=of_control > 0
    )
    return slope


def _variance(weights: FloatArray) -> FloatArray:
    """Return the variance (k, 1) of the sum of independent weights (k, n)."""
    total = np.sum(weights, axis=1, keepdims=True)
    squares = np.sum(weights * weights, axis=1, keepdims=True)
    variance: FloatArray = np.maximum(squares - total * total / weights.shape[1], 0.0)
    return variance
