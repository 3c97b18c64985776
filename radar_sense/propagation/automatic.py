"""The judgement of a method by draws, and the method that is right: FORM where draws agree with it.

FORM is smooth and fast. It does not see limits, other lobes, and the tail of another radar. Draws
with emphasis on the tails see all of these. `automatic` takes FORM where the draws confirm it, and
elsewhere the numbers of the draws, with their standard errors.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from radar_sense.progress import report
from radar_sense.propagation.draws import Estimate, estimate
from radar_sense.propagation.form import Form
from radar_sense.states import FloatArray
from radar_sense.uncertain_states import UncertainStates

#: A value of a method is off if a bound is off by more than BOUND_CHANGE or by more than
#: PART_OF_BOUND of the bound, or σ by more than STD_CHANGE of σ.
BOUND_CHANGE, PART_OF_BOUND, STD_CHANGE = 0.005, 0.1, 0.05
#: FORM is kept where draws confirm that its bounds are within this part of BOUND_CHANGE.
KEPT = 0.5
#: Differences of P_D below this are never off: no output shows them.
LEAST_CHANGE = 1e-6
#: Draws at a pose of the first look, growth from look to look, and most draws at a pose.
FIRST, GROWTH, LAST = 1024, 4, 2**20
#: Most draws of a look at all poses and radars together, about a second.
TOGETHER = 6e6
#: Standard errors between a difference and what is allowed, for a decision.
ERRORS = 2.0
#: Standard error of a bound that replaces a bound by a method, half of BOUND_CHANGE.
PRECISE = 0.5 * BOUND_CHANGE


def judged(
    states: UncertainStates,
    std: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    beta: float,
    *,
    part: float = 1.0,
) -> tuple[Estimate, NDArray[np.bool_]]:
    """Return what draws say of P_D at each pose, and where (k,) they say that values are off.

    More draws are made where they do not yet tell whether a bound is off, and where one is off and
    the bounds of the draws are not yet precise.

    Args:
        states: The uncertain states of k poses.
        std: σ of P_D by a method (k,).
        lower: Lower bound by the method (k,).
        upper: Upper bound by the method (k,).
        beta: β of the bounds.
        part: Part of BOUND_CHANGE above which a bound is off.
    """
    drawn, off = Estimate.empty(len(states)), np.zeros(len(states), dtype=bool)
    rows, draws = np.arange(len(states)), FIRST
    while rows.size:
        found = estimate(states.at(rows), draws, beta)
        drawn.put(rows, found)
        near = _near(std[rows], found)
        known, off[rows] = np.ones(rows.size, dtype=bool), ~near
        for value, bound, error in (
            (lower[rows], found.lower, found.lower_error),
            (upper[rows], found.upper, found.upper_error),
        ):
            difference, slack = abs(value - bound), ERRORS * error
            known &= abs(difference - part * BOUND_CHANGE) >= slack
            relative = np.maximum(PART_OF_BOUND * bound, LEAST_CHANGE) + slack
            off[rows] |= ~((difference <= part * BOUND_CHANGE) & (difference <= relative))
        off[rows] |= ~known
        precise = np.maximum(found.lower_error, found.upper_error) <= PRECISE
        rows = rows[~(known & (~off[rows] | precise))]
        report("poses judged by draws", len(states) - rows.size, len(states))
        draws *= GROWTH
        if draws > LAST or rows.size * draws * len(states.model.radars) > TOGETHER:
            break
    return drawn, off


def _near(std: FloatArray, found: Estimate) -> NDArray[np.bool_]:
    """Return where (k,) σ by a method is close to σ by draws."""
    allowed = STD_CHANGE * found.std + ERRORS * found.std_error
    return np.asarray(abs(std - found.std) <= np.maximum(allowed, LEAST_CHANGE))


class Automatic:
    """P_D of uncertain states by FORM where draws agree with it, and by the draws elsewhere."""

    def __init__(self, states: UncertainStates, form: Form | None = None) -> None:
        self.states = states
        self._form = form or Form(states)
        self._at: dict[float, tuple[FloatArray, ...]] = {}

    @property
    def p_d(self) -> FloatArray:
        """P_D of the nominal states (k,)."""
        return self._form.p_d

    @property
    def mean(self) -> FloatArray:
        """Mean of P_D (k,)."""
        return self._band(3.0)[0]

    @cached_property
    def std(self) -> FloatArray:
        """Standard deviation of P_D (k,): from the band if it is known, else from fewer draws."""
        if 3.0 in self._at:
            return self._at[3.0][1]
        std = self._form.std.copy()
        found = estimate(self.states, FIRST, 3.0)
        off = np.flatnonzero(~_near(std, found))
        if off.size:
            std[off] = estimate(self.states.at(off), FIRST * GROWTH, 3.0).std
        return std

    @property
    def error(self) -> FloatArray:
        """Standard error of the bounds (k,) asked for last, 0 where they are by FORM."""
        return next(reversed(self._at.values()))[4] if self._at else self._band(3.0)[4]

    def quantile(self, beta: float) -> FloatArray:
        """Return the quantile of P_D (k,) at Φ(β)."""
        return self._band(abs(beta))[2 if beta < 0 else 3]

    def exceedance(self, p_max: float) -> FloatArray:
        """Return P(P_D > p_max) (k,) by draws."""
        return estimate(self.states, FIRST * GROWTH**2, 3.0, p_max).above

    def with_covariances(self, changed: UncertainStates) -> Automatic:
        """Return the method for the same states with other covariances."""
        return Automatic(changed, self._form.with_covariances(changed))

    def _band(self, beta: float) -> tuple[FloatArray, ...]:
        """Return mean, σ, lower and upper bound at β, and their standard error (k,)."""
        if beta not in self._at:
            form = self._form
            values = form.mean, form.std, form.quantile(-beta), form.quantile(beta)
            drawn, off = judged(self.states, *values[1:], beta, part=KEPT)
            better = drawn.mean, drawn.std, drawn.lower, drawn.upper
            band = [np.where(off, b, v) for v, b in zip(values, better, strict=True)]
            error = np.where(off, np.maximum(drawn.lower_error, drawn.upper_error), 0.0)
            self._at[beta] = (*band, error)
        return self._at[beta]
