"""The judgement of a method by draws, and the method that is right: FORM where draws agree with it.

FORM is smooth and fast. It does not see limits, other lobes, and the tail of another radar. Draws
with emphasis on the tails see all of these. `automatic` takes the bounds of FORM where the draws
confirm them, and elsewhere the bounds of the draws, with their standard errors. Mean and σ change
gradually from FORM to the draws, see `_gradual`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, cached_property, partial

import numpy as np
from numpy.typing import NDArray

from radar_sense.propagation.draws import Estimate, tail_probability
from radar_sense.propagation.form import Form
from radar_sense.propagation.moments import BETA, Distribution
from radar_sense.propagation.staged import FIRST, LAST, MANY, PRECISE, StagedDraws
from radar_sense.states import FloatArray
from radar_sense.uncertain_states import UncertainStates

#: A value of a method is off if the mean or a bound is off by more than BOUND_CHANGE or by more
#: than PART_OF_BOUND of itself, or σ by more than STD_CHANGE of σ.
BOUND_CHANGE, PART_OF_BOUND, STD_CHANGE = 0.005, 0.1, 0.05
#: Differences of P_D below the first are never off: no output shows them. Below the second, they
#: may hide in the noise of the draws.
LEAST_CHANGE, LEAST_TOLD = 1e-6, 2e-5
#: Part of the largest confirmed difference up to which mean and σ are by FORM. With less, chance
#: differences that neighbouring poses share would show as peaks; with more, the change is steep.
BY_FORM = 0.5
#: Standard errors within which a value is taken to be.
ERRORS = 2.5


def judged(
    staged: StagedDraws,
    values: Sequence[FloatArray],
    read: Callable[[Estimate], tuple[FloatArray, ...]],
    *,
    to_precision: bool,
    most: NDArray[np.intp] | None = None,
) -> tuple[Estimate, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return what draws say of P_D, where (k,) they confirm two values, and where one is off.

    The noise of a drawn value is `ERRORS` standard errors. A value by a method is

    - confirmed if its difference from the drawn value, plus the noise, is at most its tolerance;
    - off if the difference is more than the tolerance plus the noise.

    Up to `MANY` draws are made until both values are confirmed or one is off. Draws to precision,
    up to `LAST`, may replace the values: they are made until both values are confirmed, or until
    the draws are better. They are better if a value that is not confirmed differs by more than the
    noise, and the noise of both is small enough, of a first stage half as large. `most` is another
    number (k,) of draws than `MANY` or `LAST`.

    The two values by a method, each (k,), are the bounds, to `read` with `of_bounds`, or mean and
    σ, with `of_moments`.
    """
    both = np.stack(values)

    def compared(
        rows: NDArray[np.intp] | slice, found: Estimate
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
        """Return where both values are confirmed, one is off, and the draws are better."""
        drawn, errors, tolerance, small = read(found)
        difference, noise = abs(both[:, rows] - drawn), ERRORS * errors
        # `not <=` is also true of NaN, where a method has no value
        off = ~(difference <= np.maximum(tolerance, LEAST_CHANGE) + noise)
        confirmed = ~off & (difference + noise <= np.maximum(tolerance, LEAST_TOLD))
        better = np.any(~(confirmed | (difference <= noise)), axis=0)
        # of a first stage an error may be small by chance
        better &= np.all(noise <= np.where(found.draws > FIRST, small, 0.5 * small), axis=0)
        return np.all(confirmed, axis=0), np.any(off, axis=0), better

    def settled(rows: NDArray[np.intp], found: Estimate) -> NDArray[np.bool_]:
        confirmed, off, better = compared(rows, found)
        return confirmed | (better if to_precision else off)

    usual = LAST if to_precision else MANY
    drawn = staged.until(settled, usual if most is None else most)
    confirmed, off, _ = compared(slice(None), drawn)
    return drawn, confirmed, off


def of_bounds(found: Estimate) -> tuple[FloatArray, ...]:
    """Return the bounds by draws (2, k), their standard errors, tolerances, and a small noise."""
    drawn, errors = found.bounds
    return drawn, errors, tolerance_of(drawn), np.full_like(drawn, BOUND_CHANGE)


def of_moments(found: Estimate) -> tuple[FloatArray, ...]:
    """Return mean and σ by draws (2, k), their standard errors, tolerances, and a small noise."""
    drawn, errors = found.moments
    of_std = STD_CHANGE * drawn[1]
    tolerance = np.stack([tolerance_of(drawn[0]), of_std])
    small = np.maximum(of_std, STD_CHANGE * BOUND_CHANGE)
    return drawn, errors, tolerance, np.stack([np.full_like(of_std, BOUND_CHANGE), small])


def tolerance_of(probability: FloatArray) -> FloatArray:
    """Return by how much (...) a mean or a bound (...) may be off."""
    return np.minimum(PART_OF_BOUND * probability, BOUND_CHANGE)


def least_off(probability: FloatArray) -> FloatArray:
    """Return the distance (...) from a mean or a bound (...) above which a value is off."""
    return np.maximum(tolerance_of(probability), LEAST_CHANGE)


def _gradual(by_form: FloatArray, found: Estimate) -> FloatArray:
    """Return mean and σ (2, k) that change gradually from those of FORM to those of the draws.

    A step between two poses would look like a peak of σ. Up to a part `BY_FORM` of the largest
    difference that the draws confirm, and within their noise, a value is by FORM. From there on it
    is mixed, and at the largest difference and above it is by the draws. It is also by the draws
    where FORM has no value.
    """
    drawn, errors, tolerance, _ = of_moments(found)
    difference, noise = drawn - by_form, ERRORS * errors
    end = np.maximum(np.maximum(tolerance, LEAST_TOLD) - noise, 0.0)
    start = np.maximum(BY_FORM * end, np.minimum(noise, end))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (abs(difference) - start) / (end - start)
    share = np.clip(np.nan_to_num(share), 0.0, 1.0)
    return np.where(abs(difference) <= end, by_form + share * difference, drawn)


class Automatic(Distribution):
    """P_D of uncertain states by FORM where draws agree with it, and by the draws elsewhere.

    Args:
        states: The uncertain states of k poses.
        form: FORM of these states; made if None.
        p_max: Limit whose exceedance `drawn` has; NaN for none.
    """

    def __init__(
        self, states: UncertainStates, form: Form | None = None, p_max: float = np.nan
    ) -> None:
        super().__init__(states)
        self.p_max, self._form = p_max, form or Form(states)
        self._staged = cache(lambda beta: StagedDraws.of_p_d(states, beta, p_max))
        self._band = cache(partial(_judged_band, self._form, self._staged))

    def quantile(self, beta: float) -> FloatArray:
        """Return the quantile of P_D (k,) at Φ(β)."""
        lower, upper, *_ = self._band(abs(beta))
        return lower if beta < 0 else upper

    def error(self, beta: float) -> FloatArray:
        """Return the standard error of the bounds at ±β (k,), 0 where they are by FORM."""
        return self._band(abs(beta))[2]

    def drawn(self, beta: float) -> Estimate | None:
        """Return what the draws say that judge the bounds at ±β; None without p_max."""
        return None if np.isnan(self.p_max) else self._band(abs(beta))[3]

    def exceedance(self, p_max: float) -> FloatArray:
        """Return P(P_D > p_max) (k,) by draws."""
        return tail_probability(self.states, PRECISE, BETA, p_max)[0]

    def with_covariances(self, changed: UncertainStates) -> Automatic:
        """Return the method for the same states with other covariances."""
        return Automatic(changed, self._form.with_covariances(changed), self.p_max)

    @cached_property
    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation of P_D (k,)."""
        by_form = self._form.moments
        found, *_ = judged(self._staged(BETA), by_form, of_moments, to_precision=True)
        mean, std = _gradual(np.stack(by_form), found)
        return mean, std


def _judged_band(
    form: Form, staged: Callable[[float], StagedDraws], beta: float
) -> tuple[FloatArray, FloatArray, FloatArray, Estimate]:
    """Return lower and upper bound at β, their standard error (k,), and the draws."""
    by_form = form.quantile(-beta), form.quantile(beta)
    drawn, confirmed, _ = judged(staged(beta), by_form, of_bounds, to_precision=True)
    bounds, errors = drawn.bounds
    lower, upper = np.where(confirmed, by_form, bounds)
    lower = np.where(bounds[0] > 0, lower, bounds[0])  # out of sight P_D is 0, and not P_fa
    return lower, upper, np.where(confirmed, 0.0, np.max(errors, axis=0)), drawn
