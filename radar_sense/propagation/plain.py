"""Plain draws at each pose, the method `montecarlo`."""

from __future__ import annotations

from functools import cache, cached_property

import numpy as np

from radar_sense.propagation.draws import estimate, tail_probability
from radar_sense.propagation.moments import BETA, Distribution
from radar_sense.states import FloatArray
from radar_sense.uncertain_states import UncertainStates


class PlainDraws(Distribution):
    """P_D of uncertain states by plain draws, `states.runs` at each pose."""

    def __init__(self, states: UncertainStates) -> None:
        super().__init__(states)
        self._drawn = cache(lambda beta: estimate(states, states.runs, beta, plain=True))

    @cached_property
    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation of P_D (k,)."""
        mean, std = self._drawn(BETA).moments[0]
        return mean, std

    def quantile(self, beta: float) -> FloatArray:
        """Return the quantile of P_D (k,) at Φ(β)."""
        return self._drawn(abs(beta)).bounds[0][int(beta >= 0)]

    def error(self, beta: float) -> FloatArray:
        """Return the greater standard error of the bounds at ±β (k,)."""
        return np.max(self._drawn(abs(beta)).bounds[1], axis=0)

    def exceedance(self, p_max: float) -> FloatArray:
        """Return P(P_D > p_max) (k,)."""
        return tail_probability(self.states, self.states.runs, BETA, p_max, plain=True)[0]
