"""Plain draws at each pose, the method `montecarlo`."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from radar_sense.propagation.draws import Estimate, estimate
from radar_sense.states import FloatArray
from radar_sense.uncertain_states import UncertainStates


class PlainDraws:
    """P_D of uncertain states by plain draws, `states.runs` at each pose."""

    def __init__(self, states: UncertainStates) -> None:
        self.states = states
        self.p_d = states.model.p_d(states.aircraft, states.radar) + np.zeros(len(states))

    @property
    def mean(self) -> FloatArray:
        """Mean of P_D (k,)."""
        return self._estimate.mean

    @property
    def std(self) -> FloatArray:
        """Standard deviation of P_D (k,)."""
        return self._estimate.std

    @property
    def error(self) -> FloatArray:
        """Greater standard error of the bounds at ±3 (k,)."""
        return np.maximum(self._estimate.lower_error, self._estimate.upper_error)

    def quantile(self, beta: float) -> FloatArray:
        """Return the quantile of P_D (k,) at Φ(β)."""
        found = estimate(self.states, self.states.runs, abs(beta), plain=True)
        return found.lower if beta < 0 else found.upper

    def exceedance(self, p_max: float) -> FloatArray:
        """Return P(P_D > p_max) (k,)."""
        return estimate(self.states, self.states.runs, 3.0, p_max, plain=True).above

    def with_covariances(self, changed: UncertainStates) -> PlainDraws:
        """Return the method for the same states with other covariances."""
        return PlainDraws(changed)

    @cached_property
    def _estimate(self) -> Estimate:
        return estimate(self.states, self.states.runs, 3.0, plain=True)
