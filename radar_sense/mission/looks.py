"""A sequence of looks: the model of P_D at each look, and the correlation of the pose errors.

The pose errors are a first-order Gauss-Markov process, see `montecarlo.gauss_markov`. The pose at
look i is x̄_i + F_i u_i. The unit normals u_i have the covariance exp(−|t_i − t_j|/τ) I, and F_i is
the symmetric square root of C_i, F_i F_iᵀ = C_i. Two looks at one time have one pose with one
error, for every τ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtr

from radar_sense.covariance import checked, symmetric_square_root
from radar_sense.montecarlo.gauss_markov import successive_correlation
from radar_sense.states import AIRCRAFT, FloatArray, components_of


class Model(Protocol):
    """The methods of a model of looks: `DetectionModel`, a network, or `Interleaved`.

    K looks are the first axis of the aircraft states. m radars have 4m states, and may have the
    errors of further parameters after them.
    """

    def p_d(self, aircraft: FloatArray, radar: FloatArray, /) -> FloatArray:
        """Return P_D (K, ...) for aircraft (K, ..., 6) and radar (..., 4m)."""
        ...

    def linearize_probit(
        self, aircraft: FloatArray, radar: FloatArray, /
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return z (K,) and partials (K, 6) and (K, 4m) for aircraft (K, 6) and radar (4m,)."""
        ...


@dataclass(frozen=True, eq=False)
class Interleaved:
    """The model of one sequence of looks of several scan groups, each with its own look times.

    Attributes:
        models: The model of each scan group.
        scan_group: The scan group of each look (K,).
        radars: The radars of each scan group, as places among all radars.
    """

    models: tuple[Model, ...]
    scan_group: NDArray[np.intp]
    radars: tuple[tuple[int, ...], ...]

    def p_d(self, aircraft: FloatArray, radar: FloatArray, /) -> FloatArray:
        """Return P_D (K, ...) for aircraft (K, ..., 6) and radar (..., 4m)."""
        p_d = np.empty(np.broadcast_shapes(aircraft.shape[:-1], radar.shape[:-1]))
        for i, model in enumerate(self.models):
            looks = self.scan_group == i
            # the memory order of the states, component first
            states = np.moveaxis(np.moveaxis(aircraft, -1, 0)[:, looks], 0, -1)
            p_d[looks] = model.p_d(states, radar[..., self._states(i, radar.shape[-1])])
        return p_d

    def linearize_probit(
        self, aircraft: FloatArray, radar: FloatArray, /
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return z (K,) and partials (K, 6) and (K, 4m) for aircraft (K, 6) and radar (4m,)."""
        z, by_aircraft = np.empty(len(aircraft)), np.empty(aircraft.shape)
        by_radar = np.zeros((len(aircraft), len(radar)))
        for i, model in enumerate(self.models):
            looks, states = self.scan_group == i, self._states(i, len(radar))
            z[looks], by_aircraft[looks], by_radar[np.ix_(looks, states)] = model.linearize_probit(
                aircraft[looks], radar[states]
            )
        return z, by_aircraft, by_radar

    def _states(self, group: int, size: int) -> list[int]:
        """Return the places of a scan group's radar states among all radar states (size,)."""
        return components_of(self.radars[group], sum(map(len, self.radars)), size)


@dataclass(frozen=True, eq=False)
class Looks:
    """A sequence of K looks, each linearized in its probit z = Φ⁻¹(P_D).

    Attributes:
        time: Times (K,) [s], which do not decrease.
        probit: z (K,).
        by_aircraft: Partials of z for the pose at that look (K, 6).
        by_radar: Partials of z for the states of all radars (K, 4m).
    """

    time: FloatArray
    probit: FloatArray
    by_aircraft: FloatArray
    by_radar: FloatArray

    @property
    def p_d(self) -> FloatArray:
        """P_D of each look (K,)."""
        p_d: FloatArray = ndtr(self.probit)
        return p_d

    @property
    def hazard(self) -> FloatArray:
        """Hazard h = −ln(1 − P_D) of each look (K,), accurate in both tails."""
        hazard: FloatArray = -log_ndtr(-self.probit)
        return hazard


def linearize_looks(model: Model, time: ArrayLike, aircraft: ArrayLike, radar: ArrayLike) -> Looks:
    """Linearize every look of a sequence.

    Args:
        model: The model.
        time: Times of the looks (K,) [s], which do not decrease.
        aircraft: Nominal aircraft states (K, 6).
        radar: Nominal states of the radars (4m,).

    Raises:
        ValueError: If a shape does not fit or the times decrease.
    """
    time, aircraft = look_times(time), np.asarray(aircraft, dtype=float)
    if aircraft.shape != (len(time), len(AIRCRAFT)):
        raise ValueError(
            f"aircraft states must have shape ({len(time)}, 6), one a look, got {aircraft.shape}"
        )
    return Looks(time, *model.linearize_probit(aircraft, np.asarray(radar, dtype=float)))


def look_times(time: ArrayLike) -> FloatArray:
    """Return times (K,) of looks as an array.

    Raises:
        ValueError: If the times are not finite, or decrease.
    """
    time = np.asarray(time, dtype=float)
    if time.ndim != 1 or not time.size or not np.isfinite(time).all() or np.any(np.diff(time) < 0):
        raise ValueError("times of looks must be finite numbers (K,) that do not decrease")
    return time


def pose_sqrt_cov(cov_aircraft: ArrayLike, looks: int) -> FloatArray:
    """Return the symmetric square roots F (K, 6, 6) of C_aa.

    Raises:
        ValueError: If the shape is neither (6, 6) nor (K, 6, 6), or a matrix is no covariance.
    """
    covariance = np.asarray(cov_aircraft, dtype=float)
    n = len(AIRCRAFT)
    if covariance.shape not in ((n, n), (looks, n, n)):
        raise ValueError(
            f"aircraft covariance must have shape (6, 6) or ({looks}, 6, 6), got {covariance.shape}"
        )
    sqrt_cov = symmetric_square_root(checked("aircraft", covariance))
    return np.broadcast_to(sqrt_cov, (looks, n, n))


def pose_variance(
    looks: Looks, slope: FloatArray, cov_aircraft: ArrayLike, correlation_time: float
) -> FloatArray:
    """Return the variance (..., K), up to each look, of Σ slope_j z_j from the pose errors.

    With a_j = slope_j F_jᵀ ∂z_j/∂x and the correlation ρ_ij of looks i and j, the variance is the
    double sum V_k = Σ_{i,j≤k} a_i·a_j ρ_ij. For times i, j, k in order, ρ_ik = ρ_ij ρ_jk. Therefore
    A_k = Σ_{i≤k} ρ_ik a_i = ρ_{k−1,k} A_{k−1} + a_k and V_k = V_{k−1} + a_k·(2 A_k − a_k).
    """
    weights = pose_slopes(looks, cov_aircraft)
    rho, _ = successive_correlation(looks.time, correlation_time)
    variance = np.zeros(slope.shape)
    along, total = np.zeros((*slope.shape[:-1], len(AIRCRAFT))), np.zeros(slope.shape[:-1])
    for k, weight in enumerate(weights):
        if k:
            along = rho[k - 1] * along
        step = slope[..., k, np.newaxis] * weight
        if slope.ndim > 1:  # a later look does not count for an earlier event, also if NaN
            step[:k] = 0.0
        along = along + step
        total = total + np.sum(step * (2.0 * along - step), axis=-1)
        variance[..., k] = total
    # Rounding can make the sum of a semidefinite kernel negative.
    return np.maximum(variance, 0.0)


def pose_slopes(looks: Looks, cov_aircraft: ArrayLike) -> FloatArray:
    """Return the partials F_jᵀ ∂z_j/∂x (K, 6) of each look's probit for unit normals."""
    sqrt_cov = pose_sqrt_cov(cov_aircraft, len(looks.time))
    # A gradient may be undefined where nothing is uncertain; 0 · NaN must be 0 there.
    partials = np.where(np.any(sqrt_cov != 0, axis=-1), looks.by_aircraft, 0.0)
    slopes: FloatArray = np.einsum("kij,ki->kj", sqrt_cov, partials)
    return slopes
