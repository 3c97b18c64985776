"""The judgement of a method by draws, and the method that is right: FORM where draws agree with it.

FORM is smooth and fast. It does not see limits, other lobes, and the tail of another radar. Draws
with emphasis on the tails see all of these. `automatic` takes FORM where the draws confirm it, and
elsewhere the numbers of the draws, with their standard errors.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from radar_sense.propagation.draws import Estimate, estimate
from radar_sense.propagation.form import Form
from radar_sense.propagation.looks import FIRST, GROWTH, LAST, first_look, look_until
from radar_sense.states import FloatArray
from radar_sense.uncertain_states import UncertainStates

#: A value of a method is off if the mean or a bound is off by more than BOUND_CHANGE or by more
#: than PART_OF_BOUND of itself, or σ by more than STD_CHANGE of σ.
BOUND_CHANGE, PART_OF_BOUND, STD_CHANGE = 0.005, 0.1, 0.05
#: Differences of P_D below the first are never off: no output shows them. Below the second, they
#: may hide in the noise of the draws.
LEAST_CHANGE, LEAST_TOLD = 1e-6, 2e-5
#: Most draws at a pose that judge a named method. What they do not confirm is not confirmed.
MOST_OF_NAMED = LAST // GROWTH
#: Draws at a pose for a probability.
FOR_PROBABILITY = 16 * FIRST
#: Standard errors within which a value is taken to be.
ERRORS = 2.5
#: More draws are made where the mean or σ may be off by more than this many tolerances.
NEAR = 3.0
#: Standard errors that are good enough: of a bound that replaces another, as a part of
#: BOUND_CHANGE, of one that judges another, as a part of its tolerance, and of σ as a part of σ.
PRECISE, DECISIVE, STD_ERROR = 0.5, 0.02, 0.01


def judged(
    states: UncertainStates,
    first: Estimate,
    lower: FloatArray,
    upper: FloatArray,
    beta: float,
    p_max: float = np.nan,
    *,
    replace: bool = False,
) -> tuple[Estimate, NDArray[np.bool_]]:
    """Return what draws say of P_D at each pose, and where (k,) they do not confirm two bounds.

    A bound is confirmed if its difference from that of the draws, and ERRORS standard errors, are
    within its tolerance together. More draws are made where this is not settled. Bounds that differ
    by more than half of the tolerance, for certain, are replaced when the draws are precise.

    Args:
        states: The uncertain states of k poses.
        first: What the first look says.
        lower: Lower bound by a method (k,).
        upper: Upper bound by the method (k,).
        beta: β of the bounds.
        p_max: Limit whose exceedance is counted; NaN for none.
        replace: Whether the bounds of the draws replace those of the method.
    """
    values = np.stack([lower, upper])

    def confirmed(rows: NDArray[np.intp] | slice, found: Estimate) -> NDArray[np.bool_]:
        """Return which bounds (2, k) are confirmed."""
        bounds, errors = found.bounds
        difference, noise = abs(values[:, rows] - bounds), ERRORS * errors
        within = difference + noise <= tolerance(bounds, LEAST_TOLD)
        return np.asarray(within & (difference <= tolerance(bounds) + noise))

    def settled(rows: NDArray[np.intp], found: Estimate) -> NDArray[np.bool_]:
        bounds, errors = found.bounds
        difference, allowed = abs(values[:, rows] - bounds), tolerance(bounds)
        if replace:
            apart = ~(difference <= np.maximum(PRECISE * allowed, ERRORS * errors))  # or NaN
            apart &= errors.max(axis=0) <= PRECISE * BOUND_CHANGE
        else:
            apart = ~(difference <= allowed + ERRORS * errors)
            apart |= (errors <= DECISIVE * allowed).all(axis=0)
        return np.asarray(confirmed(rows, found).all(axis=0) | apart.any(axis=0))

    most = LAST if replace else MOST_OF_NAMED
    drawn = look_until(settled, states, first, beta, p_max, most=most)
    return drawn, np.asarray(~confirmed(slice(None), drawn).all(axis=0))


def judged_moments(
    states: UncertainStates,
    first: Estimate,
    mean: FloatArray,
    std: FloatArray,
    beta: float,
    p_max: float = np.nan,
    *,
    most: int,
) -> tuple[Estimate, NDArray[np.bool_]]:
    """Return what draws say of P_D at each pose, and where (k,) mean or σ of P_D is off.

    More draws are made where a difference may be `NEAR` times its tolerance.

    Args:
        states: The uncertain states of k poses.
        first: What the first look says.
        mean: Mean by a method (k,).
        std: Standard deviation by the method (k,).
        beta: β of the draws.
        p_max: Limit whose exceedance is counted; NaN for none.
        most: Most draws at a pose.
    """
    values = np.stack([mean, std])

    def compared(rows: NDArray[np.intp] | slice, found: Estimate) -> tuple[FloatArray, FloatArray]:
        """Return the differences from the draws (2, k), and ERRORS standard errors."""
        drawn, errors = found.moments
        return abs(values[:, rows] - drawn), ERRORS * errors

    def allowed(found: Estimate, least: float) -> FloatArray:
        """Return the tolerances (2, k), which are at least `least`."""
        of_std = np.maximum(STD_CHANGE * found.std, least)
        return np.stack([tolerance(found.mean, least), of_std])

    def off(rows: NDArray[np.intp] | slice, found: Estimate) -> NDArray[np.bool_]:
        difference, noise = compared(rows, found)
        within = difference <= allowed(found, LEAST_CHANGE) + noise
        return np.asarray(~within.all(axis=0))

    def settled(rows: NDArray[np.intp], found: Estimate) -> NDArray[np.bool_]:
        difference, noise = compared(rows, found)
        near = difference + noise <= NEAR * allowed(found, LEAST_TOLD)
        return np.asarray(near.all(axis=0) | off(rows, found))

    drawn = look_until(settled, states, first, beta, p_max, most=most)
    return drawn, off(slice(None), drawn)


def tolerance(probability: FloatArray, least: float = LEAST_CHANGE) -> FloatArray:
    """Return by how much (...) a mean or a bound (...) may be off."""
    allowed: FloatArray = np.clip(PART_OF_BOUND * probability, least, BOUND_CHANGE)
    return allowed


class Automatic:
    """P_D of uncertain states by FORM where draws agree with it, and by the draws elsewhere.

    Args:
        states: The uncertain states of k poses.
        form: FORM of these states; made if None.
        p_max: Limit whose exceedance `drawn` has; NaN for none.
    """

    def __init__(
        self, states: UncertainStates, form: Form | None = None, p_max: float = np.nan
    ) -> None:
        self.states = states
        self._form, self._p_max = form or Form(states), p_max
        self._first: dict[float, Estimate] = {}
        self._bands: dict[float, tuple[FloatArray, FloatArray, FloatArray, Estimate]] = {}

    @property
    def p_d(self) -> FloatArray:
        """P_D of the nominal states (k,)."""
        return self._form.p_d

    @property
    def mean(self) -> FloatArray:
        """Mean of P_D (k,)."""
        return self._moments[0]

    @property
    def std(self) -> FloatArray:
        """Standard deviation of P_D (k,)."""
        return self._moments[1]

    def quantile(self, beta: float) -> FloatArray:
        """Return the quantile of P_D (k,) at Φ(β)."""
        lower, upper, *_ = self._band(abs(beta))
        return lower if beta < 0 else upper

    def error(self, beta: float) -> FloatArray:
        """Return the standard error of the bounds at ±β (k,), 0 where they are by FORM."""
        return self._band(abs(beta))[2]

    def drawn(self, beta: float) -> Estimate:
        """Return what the draws say that judge the bounds at ±β."""
        return self._band(abs(beta))[3]

    def exceedance(self, p_max: float) -> FloatArray:
        """Return P(P_D > p_max) (k,) by draws."""
        return estimate(self.states, FOR_PROBABILITY, 3.0, p_max).above

    def with_covariances(self, changed: UncertainStates) -> Automatic:
        """Return the method for the same states with other covariances."""
        return Automatic(changed, self._form.with_covariances(changed), self._p_max)

    @cached_property
    def _moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation of P_D (k,)."""
        form, first = self._form, self._look(3.0)
        drawn, off = judged_moments(
            self.states, first, form.mean, form.std, 3.0, self._p_max, most=LAST
        )

        def settled(rows: NDArray[np.intp], found: Estimate) -> NDArray[np.bool_]:
            precise = found.std_error <= STD_ERROR * np.maximum(found.std, BOUND_CHANGE)
            return ~off[rows] | (precise & (found.mean_error <= BOUND_CHANGE))

        found = look_until(settled, self.states, drawn, 3.0, self._p_max, most=LAST)
        return np.where(off, found.mean, form.mean), np.where(off, found.std, form.std)

    def _band(self, beta: float) -> tuple[FloatArray, FloatArray, FloatArray, Estimate]:
        """Return lower and upper bound at β, their standard error (k,), and the draws."""
        if beta not in self._bands:
            lower, upper = self._form.quantile(-beta), self._form.quantile(beta)
            first = self._look(beta)
            drawn, off = judged(self.states, first, lower, upper, beta, self._p_max, replace=True)
            self._bands[beta] = (
                np.where(off, drawn.lower, lower),
                np.where(off, drawn.upper, upper),
                np.where(off, np.max(drawn.bounds[1], axis=0), 0.0),
                drawn,
            )
        return self._bands[beta]

    def _look(self, beta: float) -> Estimate:
        """Return what the first draws say."""
        if beta not in self._first:
            self._first[beta] = first_look(self.states, beta, self._p_max)
        return self._first[beta]
