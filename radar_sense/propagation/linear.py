"""First order in P_D, eq. (35): the paper's method."""

from __future__ import annotations

import numpy as np

from radar_sense.covariance import variance_along
from radar_sense.model.detection_model import Linearization
from radar_sense.propagation.moments import Distribution, normal_exceedance
from radar_sense.states import FloatArray
from radar_sense.uncertain_states import UncertainStates


class Linear(Distribution):
    """P_D of uncertain states, taken to be normal with σ from the gradient of P_D."""

    def __init__(self, states: UncertainStates, gradient: Linearization | None = None) -> None:
        super().__init__(states)
        lin = gradient or states.model.unchecked_linearize(states.aircraft, states.radar)
        by_aircraft = variance_along(lin.jac_aircraft, states.cov_aircraft)
        std = np.sqrt(by_aircraft + variance_along(lin.jac_radar, states.cov_radar))
        std = np.where(np.isnan(lin.p_d), np.nan, std)
        self.p_d, self.moments, self._gradient = lin.p_d, (lin.p_d, std), lin

    def quantile(self, beta: float) -> FloatArray:
        """Return P_D + β σ (k,), which may leave [0, 1]."""
        return self.p_d + beta * self.std

    def exceedance(self, p_max: float) -> FloatArray:
        """Return P(P_D > p_max) (k,) for normal P_D."""
        return normal_exceedance(self.p_d, self.std, p_max)

    def with_covariances(self, changed: UncertainStates) -> Linear:
        """Return the method for the same states with other covariances, at less cost."""
        return Linear(changed, self._gradient)
