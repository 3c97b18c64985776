"""Mean, deviation and bounds of P_D by weighted draws, many of them in the tails.

Nothing is assumed of P_D: draws follow limits, horizons, lobes and several radars alike. Every
number has a standard error. All poses have the same unit normals, so that bounds change smoothly
from pose to pose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from radar_sense.propagation.emphasis import Mixture
from radar_sense.states import FloatArray
from radar_sense.streams import Stream, random_stream
from radar_sense.uncertain_states import BLOCK, UncertainStates

#: Numbers of an array that is computed at a time (2 MB).
TOGETHER = 2**18


@dataclass(frozen=True, eq=False)
class Estimate:
    """What draws at k poses say of P_D.

    Attributes:
        mean: Mean of P_D (k,).
        std: Standard deviation of P_D (k,).
        std_error: Standard error of `std` (k,).
        lower: Bound that P_D falls below with probability Φ(−β) (k,).
        lower_error: Standard error of `lower` (k,).
        upper: Bound that P_D stays below with probability Φ(β) (k,).
        upper_error: Standard error of `upper` (k,).
        above: P(P_D > p_max) (k,); NaN without p_max.
        above_error: Standard error of `above` (k,).
    """

    mean: FloatArray
    std: FloatArray
    std_error: FloatArray
    lower: FloatArray
    lower_error: FloatArray
    upper: FloatArray
    upper_error: FloatArray
    above: FloatArray
    above_error: FloatArray

    @classmethod
    def empty(cls, poses: int) -> Estimate:
        """Return an estimate of unknown values at some poses, to be filled."""
        return cls(*(np.full(poses, np.nan) for _ in range(9)))

    def put(self, rows: NDArray[np.intp] | slice, other: Estimate) -> None:
        """Overwrite the values at some poses."""
        for name, values in vars(self).items():
            values[rows] = getattr(other, name)


def estimate(
    states: UncertainStates, draws: int, beta: float, p_max: float = np.nan, *, plain: bool = False
) -> Estimate:
    """Return what draws say of P_D at each pose.

    Args:
        states: The uncertain states of k poses.
        draws: Number of draws at each pose.
        beta: β of the bounds.
        p_max: Limit whose exceedance is counted; NaN for none.
        plain: Whether to draw from the natural density alone.
    """
    found, first = Estimate.empty(len(states)), 0
    d = states.normals
    normals = random_stream(states.seed, Stream.EMPHASIS, draws).standard_normal((d, draws))
    size = max(1, TOGETHER // (draws * d))
    for block in states.cut(BLOCK):
        mixture = None if plain else Mixture.of(_row_by_row(block), beta)
        for start in range(0, len(block), size):
            rows = slice(start, min(start + size, len(block)))
            part = block.at(np.arange(rows.start, rows.stop))
            if mixture is None:
                u, weights = np.broadcast_to(normals, (len(part), d, draws)), np.ones((1, draws))
            else:
                u, weights = mixture.at(rows).draw(normals)
            p_d = part.model.p_d(*part.at_normals(u))
            weights = np.broadcast_to(weights / draws, p_d.shape)
            place = slice(first + rows.start, first + rows.stop)
            found.put(place, _estimate(p_d, weights, beta, p_max))
        first += len(block)
    return found


def _row_by_row(states: UncertainStates) -> UncertainStates:
    """Return states with a row of nominal states for each pose."""
    return replace(
        states,
        aircraft=np.broadcast_to(states.aircraft, (len(states), states.aircraft.shape[1])),
        radar=np.broadcast_to(states.radar, (len(states), states.radar.shape[1])),
    )


def _estimate(p_d: FloatArray, weights: FloatArray, beta: float, p_max: float) -> Estimate:
    """Return the estimate from P_D (k, n) and weights (k, n), which add up to about 1."""
    total = np.sum(weights, axis=1)
    mean = np.sum(weights * p_d, axis=1) / total
    mean = np.where(np.ptp(p_d, axis=1) == 0, p_d[:, 0], mean)  # without rounding
    square = np.square(p_d - mean[:, np.newaxis])
    variance = np.sum(weights * square, axis=1) / total
    std = np.sqrt(variance)
    off = np.sum(np.square(weights * (square - variance[:, np.newaxis])), axis=1)
    with np.errstate(invalid="ignore"):
        std_error = np.where(std > 0, 0.5 * np.sqrt(off) / std, 0.0)

    order = np.argsort(p_d, axis=1)
    values = np.take_along_axis(p_d, order, axis=1)
    weights = np.take_along_axis(weights, order, axis=1)
    tail = float(ndtr(-beta))
    lower, lower_error = _quantile(values, weights, tail)
    upper, upper_error = _quantile(values[:, ::-1], weights[:, ::-1], tail)
    above, above_error = np.full(len(p_d), np.nan), np.full(len(p_d), np.nan)
    if not np.isnan(p_max):
        # from the rarer of the two sides, so that the probability is at most 1
        is_above = values > p_max
        sides = [weights * is_above, weights * ~is_above]
        up, down = (np.sum(side, axis=1) for side in sides)
        up_error, down_error = (
            _error_of_sum(np.sum(side * side, axis=1), total, p_d.shape[1])
            for side, total in zip(sides, (up, down), strict=True)
        )
        above = np.where(up <= down, up, 1.0 - down)
        above_error = np.where(up <= down, up_error, down_error)
    return Estimate(
        mean, std, std_error, lower, lower_error, upper, upper_error, above, above_error
    )


def _quantile(
    values: FloatArray, weights: FloatArray, tail: float
) -> tuple[FloatArray, FloatArray]:
    """Return the first of the values (k, n) with this weight up to it, and its standard error (k,).

    The standard error is a third of the way to the values at three standard errors of the weight.
    It is large beside a jump of P_D that the tail may or may not reach.
    """
    mass = np.cumsum(weights, axis=1)
    error_of_mass = _error_of_sum(np.cumsum(weights * weights, axis=1), mass, values.shape[1])

    def at(level: FloatArray | float) -> tuple[FloatArray, FloatArray]:
        index = np.count_nonzero(mass < np.reshape(level, (-1, 1)), axis=1)[:, np.newaxis]
        index = np.minimum(index, values.shape[1] - 1)
        return (
            np.take_along_axis(values, index, axis=1)[:, 0],
            np.take_along_axis(error_of_mass, index, axis=1)[:, 0],
        )

    quantile, error = at(tail)
    beside = (abs(at(tail + away * error)[0] - quantile) for away in (-3.0, 3.0))
    return quantile, np.maximum(*beside) / 3.0


def _error_of_sum(squares: FloatArray, total: FloatArray, n: int) -> FloatArray:
    """Return the standard error of a sum of n weights, from the sum of their squares."""
    error: FloatArray = np.sqrt(np.maximum(squares - total * total / n, 0.0))
    return error
