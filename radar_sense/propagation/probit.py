"""First order in the probit z = Φ⁻¹(P_D), taken to be normal."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.special import ndtr, ndtri

from radar_sense.covariance import variance_along
from radar_sense.propagation.moments import Distribution, normal_exceedance, probit_moments
from radar_sense.states import FloatArray
from radar_sense.uncertain_states import UncertainStates


class Probit(Distribution):
    """P_D = Φ(z) of uncertain states for normal z, with its mean m at the nominal states.

    The standard deviation s of z is to first order. The quantiles Φ(m + βs) never leave [0, 1].
    Mean and variance have a closed form.
    """

    def __init__(
        self, states: UncertainStates, gradient: tuple[FloatArray, ...] | None = None
    ) -> None:
        super().__init__(states)
        self._gradient = gradient or states.model.linearize_probit(states.aircraft, states.radar)
        self._m, by_aircraft, by_radar = self._gradient
        of_aircraft = variance_along(by_aircraft, states.cov_aircraft)
        self._s = np.sqrt(of_aircraft + variance_along(by_radar, states.cov_radar))
        self.p_d = ndtr(self._m)

    def quantile(self, beta: float) -> FloatArray:
        """Return Φ(m + βs) (k,)."""
        return ndtr(self._m + beta * self._s)

    def exceedance(self, p_max: float) -> FloatArray:
        """Return P(P_D > p_max) (k,), which is P(z > z_max) for normal z."""
        return normal_exceedance(self._m, self._s, float(ndtri(p_max)))

    def with_covariances(self, changed: UncertainStates) -> Probit:
        """Return the method for the same states with other covariances, at less cost."""
        return Probit(changed, self._gradient)

    @cached_property
    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean and σ of Φ(z) (k,)."""
        return probit_moments(self._m, self._s)
