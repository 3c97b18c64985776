"""Mean, deviation and bounds of P_D by weighted draws, many of them in the tails.

Nothing is assumed of P_D: draws follow limits, horizons, lobes and several radars alike. Every
number has a standard error. All poses have the same unit normals, so that bounds change smoothly
from pose to pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from radar_sense.model.fusion import either
from radar_sense.propagation.emphasis import Mixture
from radar_sense.states import BLOCK, FloatArray, slices
from radar_sense.streams import Stream, random_stream
from radar_sense.uncertain_states import UncertainStates

#: Draws of the mixture at a time. A matrix product of this size stays in one thread.
DRAWS = 1024
#: Poses at a time, and poses at a time of a function that searches. A search of many poses takes
#: hardly more rounds than one of few.
ROWS, SEARCHED = BLOCK // DRAWS, 4 * BLOCK // DRAWS
#: Width of a stratum [standard deviations]. Twice or a quarter of it hardly changes an error.
STRATUM = 0.5

#: From j of the poses, and states (j, n, 6) and (j, n, 7m) at each of them, to values (j, n).
Function: TypeAlias = Callable[[slice, FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class Estimate:
    """What draws at k poses say of P_D.

    Attributes:
        values: Mean and standard deviation of P_D, the bounds that it falls below with probability
            Φ(−β) and Φ(β), and P(P_D > p_max), which is NaN without p_max (5, k).
        errors: Standard errors of the values (5, k).
        draws: Number of draws (k,).
    """

    values: FloatArray
    errors: FloatArray
    draws: FloatArray

    @property
    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation (2, k), and their standard errors (2, k)."""
        return self.values[:2], self.errors[:2]

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bound (2, k), and their standard errors (2, k)."""
        return self.values[2:4], self.errors[2:4]

    @property
    def above(self) -> tuple[FloatArray, FloatArray]:
        """P(P_D > p_max) (k,), and its standard error (k,)."""
        return self.values[4], self.errors[4]

    @property
    def below(self) -> tuple[FloatArray, FloatArray]:
        """P(P_D ≤ p_max) (k,), and its standard error (k,)."""
        above, error = self.above
        return 1.0 - above, error

    @classmethod
    def constant(cls, poses: int, value: float) -> Estimate:
        """Return an estimate with one value of everything at all poses, to be filled."""
        return cls(np.full((5, poses), value), np.full((5, poses), value), np.full(poses, value))

    @classmethod
    def of_tail(cls, tail: FloatArray, error: FloatArray, draws: int) -> Estimate:
        """Return an estimate of a probability of a tail (k,) alone, in the place of `above`."""
        found = cls.constant(len(tail), np.nan)
        found.values[4], found.errors[4], found.draws[:] = tail, error, draws
        return found

    @classmethod
    def join(cls, parts: Sequence[Estimate]) -> Estimate:
        """Return the values at the poses of all parts, one part after the other."""
        arrays = zip(*(vars(part).values() for part in parts), strict=True)
        return cls(*(np.concatenate(each, axis=-1) for each in arrays))

    def at(self, rows: NDArray[np.intp] | slice) -> Estimate:
        """Return a copy of the values at some poses."""
        return Estimate(*(array[..., rows].copy() for array in vars(self).values()))

    def put(self, rows: NDArray[np.intp] | slice, other: Estimate) -> None:
        """Overwrite the values at some poses."""
        for name, array in vars(self).items():
            array[..., rows] = getattr(other, name)


def estimate(
    states: UncertainStates, draws: int, beta: float, p_max: float = np.nan, *, plain: bool = False
) -> Estimate:
    """Return what draws say of P_D at each pose: it is 0 where no radar may see the aircraft.

    Plain draws are from the natural density alone.
    """
    found = Estimate.constant(len(states), 0.0)
    if np.isnan(p_max):
        found.values[4] = found.errors[4] = np.nan
    for poses, p_d, weights, towards in _drawn(states, draws, beta, plain=plain):
        found.put(poses, _estimate(p_d, weights, towards, beta, p_max))
    found.draws[:] = draws
    return found


def estimate_of(
    function: Function, low: UncertainStates, high: UncertainStates, draws: int, beta: float
) -> Estimate:
    """Return what draws say of a function of the states, in the place of P_D.

    The nominal states are the high ones. Many draws are about errors that raise P_D at the high
    states, and about errors that lower it at the low ones. Both have the same covariances.
    """
    n = 1 if high.certain else draws
    mixture = None if n == 1 else Mixture.of(high, beta).with_falling(Mixture.of(low, beta))
    found = _estimate(*_draw(high, mixture, n, function, SEARCHED), beta, np.nan)
    found.draws[:] = draws
    return found


def tail_probability(
    states: UncertainStates, draws: int, beta: float, value: float, *, plain: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Return P(P_D > value) (k,) by draws, for negative β P(P_D ≤ value), and its standard error.

    It takes much less time than `estimate`. The error is least where the probability is about
    Φ(−|β|). Plain draws are as of `estimate`.
    """
    found, errors = np.full(len(states), float(beta < 0)), np.zeros(len(states))
    for poses, p_d, weights, towards in _drawn(states, draws, abs(beta), plain=plain):
        strata, above = _Strata(weights, towards[int(beta < 0)], abs(beta)), p_d > value
        found[poses], errors[poses] = strata.share(above if beta > 0 else ~above)
    return found, errors


def _drawn(
    states: UncertainStates, draws: int, beta: float, *, plain: bool
) -> Iterator[tuple[NDArray[np.intp], FloatArray, FloatArray, FloatArray]]:
    """Yield poses (j,) and what `_draw` returns of them, where a radar may see the aircraft."""
    for poses, whole in states.by_sight():
        part, by_others = whole.of_uncertain_radars()
        n, done = 1 if part.certain else draws, 0  # without errors all draws are alike
        for block in part.blocks(2 * n):  # P_D and weights
            rows = slice(done, done + len(block))
            mixture = None if plain or n == 1 else Mixture.of(block, beta)
            p_d, weights, towards = _draw(block, mixture, n, _p_d(block))
            yield poses[rows], either(p_d, by_others[rows, np.newaxis]), weights, towards
            done = rows.stop


def _draw(
    states: UncertainStates,
    mixture: Mixture | None,
    draws: int,
    function: Function,
    size: int = ROWS,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return values (k, n), weights (k, n), and how far draws are towards two centres (2, k, n).

    Each of the parts of `DRAWS` draws is a whole mixture.
    """
    values, towards = np.empty((len(states), draws)), np.zeros((2, len(states), draws))
    weights = np.full(values.shape, 1.0 / draws)
    rng, d = random_stream(states.seed, Stream.EMPHASIS, draws), states.normals
    for start in range(0, draws, DRAWS):
        normals = rng.standard_normal((d, min(DRAWS, draws - start)))
        n = normals.shape[1]
        for rows in slices(len(states), size):
            columns = slice(start, start + n)
            if mixture is None:
                u = np.broadcast_to(normals, (len(values[rows]), d, n))
            else:
                u, ratio, towards[:, rows, columns] = mixture.at(rows).draw(normals)
                weights[rows, columns] *= ratio
            values[rows, columns] = function(rows, *states.at_normals(u, rows))
    return values, weights, towards


def _p_d(states: UncertainStates) -> Function:
    """Return P_D as a function of the states."""
    return lambda rows, aircraft, radar: states.model.unchecked_p_d(aircraft, radar)


class _Strata:
    """Weights of draws, so that every stratum along a direction has its probability.

    A change of P_D along the direction then adds little to an error (post-stratification:
    W. G. Cochran, Sampling Techniques, 3rd ed., 1977, 5A.9).

    Args:
        weights: Weights of the draws (k, n).
        towards: Unit normals of the draws along the direction (k, n), 0 where there is none.
        beta: β of the bounds. −β and β are limits of strata, unless β is within a stratum.
    """

    def __init__(self, weights: FloatArray, towards: FloatArray, beta: float) -> None:
        half = max(1, math.ceil(beta / STRATUM))
        width = beta / half if beta > STRATUM else STRATUM
        below = np.diff(ndtr([-np.inf, *(width * np.arange(-half, 1))]))
        probability = np.concatenate([below, below[::-1]])  # above 0 differences would round to 0
        self._shape = len(weights), len(probability)
        place = np.clip(np.floor(towards / width) + (half + 1), 0, 2 * half + 1)
        place += np.arange(0, math.prod(self._shape), len(probability))[:, np.newaxis]
        self._place = place.astype(np.intp)
        drawn = self._sum(weights)
        ratio = np.divide(probability, drawn, out=np.zeros(self._shape), where=drawn > 0)
        ratio /= np.sum(ratio * drawn, axis=1, keepdims=True)
        self.weights = weights * self._each(ratio)
        self._mass = ratio * drawn

    def error(self, values: FloatArray) -> FloatArray:
        """Return the standard error (k,) of the weighted sum of values (k, n)."""
        total = self._sum(self.weights * values)
        mean = np.divide(total, self._mass, out=np.zeros(self._shape), where=self._mass > 0)
        residual = self.weights * (values - self._each(mean))
        return np.sqrt(np.sum(residual * residual, axis=1))

    def share(self, inside: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
        """Return the weight of the draws that are inside (k, n), and its standard error (k,).

        That all draws of a stratum are inside, or none, may be chance. The greatest weight on the
        rarer side stands for this.
        """
        within, outside = (np.sum(self.weights, axis=1, where=w) for w in (inside, ~inside))
        rarer = inside != (within > outside)[:, np.newaxis]
        heaviest = np.max(self.weights, axis=1, where=rarer, initial=0.0)
        return within / (within + outside), np.hypot(self.error(rarer.astype(float)), heaviest)

    def _sum(self, values: FloatArray) -> FloatArray:
        """Return the sums (k, s) of values (k, n) in the strata."""
        sums = np.bincount(self._place.ravel(), values.ravel(), math.prod(self._shape))
        return np.asarray(sums, dtype=float).reshape(self._shape)

    def _each(self, values: FloatArray) -> FloatArray:
        """Return the values of the strata (k, s) at each draw (k, n)."""
        return values.ravel()[self._place]


def _estimate(
    p_d: FloatArray, weights: FloatArray, towards: FloatArray, beta: float, p_max: float
) -> Estimate:
    """Return the estimate from draws of P_D (k, n), whose weights (k, n) add up to about 1.

    Their unit normals towards the greatest and the least P_D are `towards` (2, k, n).
    """
    rising, falling = (_Strata(weights, side, beta) for side in towards)
    mean = np.sum(rising.weights * p_d, axis=1)
    mean = np.where(np.ptp(p_d, axis=1) == 0, p_d[:, 0], mean)  # without rounding
    square = np.square(p_d - mean[:, np.newaxis])
    std = np.sqrt(np.sum(rising.weights * square, axis=1))
    of_std = np.divide(0.5 * rising.error(square), std, out=np.zeros_like(std), where=std > 0)
    order, tail = np.argsort(p_d, axis=1), float(ndtr(-beta))
    lower, of_lower = _quantile(p_d, falling, order, tail)
    upper, of_upper = _quantile(-p_d, rising, order[:, ::-1], tail)
    above, of_above = np.full(len(p_d), np.nan), np.full(len(p_d), np.nan)
    if not np.isnan(p_max):
        above, of_above = rising.share(p_d > p_max)
    return Estimate(
        np.stack([mean, std, lower, -upper, above]),
        np.stack([rising.error(p_d), of_std, of_lower, of_upper, of_above]),
        np.full(len(p_d), float(p_d.shape[1])),
    )


def _quantile(
    values: FloatArray, strata: _Strata, order: NDArray[np.intp], tail: float
) -> tuple[FloatArray, FloatArray]:
    """Return the least of the values (k, n) with this weight up to it, and its standard error (k,).

    The standard error is a third of the way to the values at three standard errors of the weight.
    It is large beside a jump of P_D that the tail may or may not reach. `order` (k, n) has the
    places of the values in ascending order.
    """
    number = np.arange(values.shape[1])
    mass = np.cumsum(np.take_along_axis(strata.weights, order, axis=1), axis=1)

    def first(level: FloatArray | float) -> NDArray[np.intp]:
        index = np.count_nonzero(mass < level, axis=1, keepdims=True)
        return np.minimum(index, number[-1])

    def at(index: NDArray[np.intp]) -> FloatArray:
        return np.take_along_axis(values, np.take_along_axis(order, index, axis=1), axis=1)

    index = first(tail)
    quantile, counted = at(index), np.empty(values.shape, dtype=bool)
    np.put_along_axis(counted, order, number <= index, axis=1)  # of equal values, some
    error = strata.share(counted)[1][:, np.newaxis]
    beside = (abs(at(first(tail + away * error)) - quantile) for away in (-3.0, 3.0))
    return quantile[:, 0], np.maximum(*beside)[:, 0] / 3.0
