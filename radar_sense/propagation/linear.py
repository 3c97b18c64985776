"""First order in P_D, `eq:pd_var`: the paper's method."""

from __future__ import annotations

import numpy as np

from radar_sense.covariance import variance_along
from radar_sense.model.detection_model import Linearization
from radar_sense.propagation.gaussian_states import StdFunction, UncertainStates
from radar_sense.propagation.moments import Moments, normal_exceedance
from radar_sense.states import FloatArray


def linear(states: UncertainStates, beta: float) -> Moments:
    """Return P_D ± β σ with σ from the gradient of P_D. The bounds may leave [0, 1]."""
    lin = states.model.linearize(states.aircraft, states.radar)
    std = _std(lin, *states.covariances)
    p_d = np.broadcast_to(lin.p_d, std.shape)
    converged = np.ones(std.shape, dtype=bool)
    return Moments(p_d, p_d, std, p_d - beta * std, p_d + beta * std, converged)


def linear_std(states: UncertainStates) -> StdFunction:
    """Return a function from covariances to σ of P_D, which shares the gradient."""
    lin = states.model.linearize(states.aircraft, states.radar)
    return lambda cov_aircraft, cov_radar: _std(lin, cov_aircraft, cov_radar)


def _std(lin: Linearization, cov_aircraft: FloatArray, cov_radar: FloatArray) -> FloatArray:
    """Return σ of P_D (k,) as `Linearization.std`, for covariances that are already checked."""
    by_aircraft = variance_along(lin.jac_aircraft, cov_aircraft)
    return np.sqrt(by_aircraft + variance_along(lin.jac_radar, cov_radar))


def linear_upper(states: UncertainStates, beta: float) -> FloatArray:
    """Return the upper bound (k,) of `linear`."""
    return linear(states, beta).upper


def linear_exceedance(states: UncertainStates, p_max: float) -> FloatArray:
    """Return P(P_D > p_max) (k,) for normal P_D."""
    lin = states.model.linearize(states.aircraft, states.radar)
    return normal_exceedance(lin.p_d, lin.std(*states.covariances), p_max)
