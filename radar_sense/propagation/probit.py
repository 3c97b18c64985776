"""First order in the probit z = Φ⁻¹(P_D), taken to be normal."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from radar_sense.covariance import variance_along
from radar_sense.propagation.gaussian_states import StdFunction, UncertainStates
from radar_sense.propagation.moments import Moments, normal_exceedance, probit_moments
from radar_sense.states import FloatArray


def probit(states: UncertainStates, beta: float) -> Moments:
    """Return the moments of Φ(z) for normal z, with its mean m at the nominal states.

    The standard deviation s of z is to first order. The bounds are Φ(m ± βs), which never leave
    [0, 1]. Mean and variance have a closed form.
    """
    p_d, *z_and_partials = states.model.p_d_and_probit(states.aircraft, states.radar)
    gradient = _Gradient(*z_and_partials)
    z, std = gradient.value, gradient.std(*states.covariances)
    mean, std_pd = _moments(z, std)
    return Moments(
        np.broadcast_to(p_d, std.shape),
        mean,
        std_pd,
        ndtr(z - beta * std),
        ndtr(z + beta * std),
        np.ones(std.shape, dtype=bool),
    )


def probit_std(states: UncertainStates) -> StdFunction:
    """Return a function from covariances to σ of P_D, which shares the gradient of z."""
    gradient = _Gradient.of(states)

    def std(cov_aircraft: FloatArray, cov_radar: FloatArray) -> FloatArray:
        std_z = gradient.std(cov_aircraft, cov_radar)
        return _moments(gradient.value, std_z)[1]

    return std


def probit_upper(states: UncertainStates, beta: float) -> FloatArray:
    """Return the upper bound (k,) of `probit`."""
    gradient = _Gradient.of(states)
    return np.asarray(ndtr(gradient.value + beta * gradient.std(*states.covariances)))


def probit_exceedance(states: UncertainStates, p_max: float) -> FloatArray:
    """Return P(P_D > p_max) (k,), which is P(z > z_max) for normal z."""
    gradient = _Gradient.of(states)
    return normal_exceedance(gradient.value, gradient.std(*states.covariances), float(ndtri(p_max)))


def _moments(z: FloatArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of Φ(z) (k,), with few points where few are enough."""
    mean, std_pd = probit_moments(z + np.zeros(std.shape), std, points=8)
    wide = ~(std < 0.5)
    if wide.any():
        z = np.broadcast_to(z, std.shape)
        mean[wide], std_pd[wide] = probit_moments(z[wide], std[wide])
    return mean, std_pd


class _Gradient(NamedTuple):
    """z (k,) of the nominal states, its gradient by aircraft (k, 6) and by radars (k, 4m)."""

    value: FloatArray
    by_aircraft: FloatArray
    by_radar: FloatArray

    @classmethod
    def of(cls, states: UncertainStates) -> _Gradient:
        return cls(*states.model.linearize_probit(states.aircraft, states.radar))

    def std(self, cov_aircraft: FloatArray, cov_radar: FloatArray) -> FloatArray:
        """Return the standard deviation of z (k,) to first order."""
        by_aircraft = variance_along(self.by_aircraft, cov_aircraft)
        return np.sqrt(by_aircraft + variance_along(self.by_radar, cov_radar))
