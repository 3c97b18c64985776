"""z as a function of independent standard normals u (u-space), to second order.

With F Fᵀ the covariance of the relative states y, y = F u maps independent standard normals u to
errors of y. F is determined up to a rotation. The rotation chosen here makes the second derivatives
of z by u a diagonal matrix. To second order z is then a sum over components,

    z(u) ≈ z(0) + Σ (g_i u_i + λ_i u_i²/2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sense.covariance import square_root
from radar_sense.propagation.gaussian_states import UncertainStates
from radar_sense.propagation.relative_probit import RelativeProbit
from radar_sense.propagation.second_order import SecondOrder
from radar_sense.states import RADAR, FloatArray, own_components_of

#: Components of u are idle where the second derivatives of z by them are below this fraction of σ
#: of z to first order. Where z bends little beside its slope, a bound of FORM at β then changes by
#: some ½ IDLE² β³ σ in z, 5.4e-5 σ at β = 3.
IDLE = 2e-3
#: Numbers of the matrices F that are copied at a time, which stay in the processor's cache (1 MB).
GATHERED = 131_072


@dataclass(frozen=True, eq=False)
class StandardNormalSpace:
    """z(u) of k poses and its second-order expansion about u = 0, with r components of u.

    Attributes:
        probit: z as a function of the relative states.
        sqrt_cov: F (k, n, r), rotated so that second derivatives by u are a diagonal matrix.
        value: z(0) (k,).
        gradient: g (r, k), NaN where z has no gradient.
        curvature: λ (r, k), NaN where a second derivative is not finite.
        drift: Change of the mean of z by idle components, which are left out (k,).
    """

    probit: RelativeProbit
    sqrt_cov: FloatArray
    value: FloatArray
    gradient: FloatArray
    curvature: FloatArray
    drift: FloatArray

    @classmethod
    def of(cls, states: UncertainStates, *, idle: bool = False) -> StandardNormalSpace:
        """Return the expansion of z about the nominal states, with idle components or without."""
        probit = RelativeProbit(states)
        return cls.expanded(probit, probit.derivatives(), idle=idle)

    @classmethod
    def expanded(
        cls, probit: RelativeProbit, z: SecondOrder, *, idle: bool = False
    ) -> StandardNormalSpace:
        """Return the space for a given expansion of z in the relative states.

        Args:
            probit: z as a function of the relative states.
            z: Its expansion.
            idle: Whether to keep idle components of u.
        """
        if probit.states.has_independent_radars and not idle:
            sqrt_cov, drift = _reduced_sqrt_cov(probit, z)
        else:
            sqrt_cov, drift = probit.sqrt_cov, np.zeros(len(z.value))
        second = z.second_derivatives_by(sqrt_cov)
        known = np.all(np.isfinite(second), axis=(1, 2))
        second[~known] = 0.0
        curvature, rotation = np.linalg.eigh(second)
        curvature[~known] = np.nan
        rotated = sqrt_cov @ rotation
        by_u = np.einsum("kij,ik->jk", rotated, z.gradient)
        return cls(probit, rotated, z.value, by_u, np.ascontiguousarray(curvature.T), drift)

    def __call__(self, u: FloatArray, pose: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        """Return z (j,) and its gradient (r, j) at u (r, j) of the poses (j,)."""
        n, r = self.sqrt_cov.shape[1:]
        error, by_u = np.empty((n, len(pose))), np.empty((r, len(pose)))
        size = GATHERED // max(1, n * r) + 1
        parts = [slice(start, start + size) for start in range(0, len(pose), size)]
        for part in parts:
            np.einsum("kij,jk->ik", self.sqrt_cov[pose[part]], u[:, part], out=error[:, part])
        value, by_y = self.probit(error, pose)
        for part in parts:
            np.einsum("kij,ik->jk", self.sqrt_cov[pose[part]], by_y[:, part], out=by_u[:, part])
        return value, by_u


def _reduced_sqrt_cov(probit: RelativeProbit, z: SecondOrder) -> tuple[FloatArray, FloatArray]:
    """Return F (k, n, r) without idle components of u, for radars with independent errors.

    The components of u of each radar are rotated so that z has a slope along the first one only.
    The others are idle where the second derivatives of z by them and by any component are small:
    the sum of squares over all radars is at most IDLE² σ², with σ of z to first order. Their own
    second derivatives change the mean of z.

    Returns:
        F, and the change of the mean of z (k,).
    """
    states, covariance = probit.states, probit.covariance
    m, size = len(states.log_constant), states.radar.shape[-1]
    k, n, rcs = len(states), len(probit.std), len(RADAR) * m
    along = (covariance @ z.gradient.T[..., np.newaxis])[..., 0]
    variance = np.einsum("ik,ki->k", z.gradient, along)
    of_aircraft = probit.to_relative @ square_root(states.cov_aircraft)
    columns = [np.broadcast_to(of_aircraft, (k, *of_aircraft.shape[1:]))]
    drift = np.zeros(k)
    if size > rcs:
        columns.append(np.zeros((k, n, 1)))
        columns[-1][:, 3 + rcs, 0] = np.sqrt(states.cov_radar[:, rcs, rcs])
    for i, (places, block) in enumerate(zip(z.places, z.blocks, strict=True)):
        own = own_components_of(i, m, size)
        rows = np.add(3, own)
        reflected = _reflected(square_root(states.cov_radar[:, own][..., own]), z.gradient[rows])
        others, local = reflected[:, :, 1:], np.isin(places, rows)
        by_others = np.moveaxis(block[:, local], 2, 0) @ others  # second derivatives by y_i and u
        spread = covariance[:, places][..., places] @ by_others
        idle = m * np.einsum("kij,kij->k", by_others, spread) <= IDLE**2 * variance
        drift[idle] += 0.5 * np.einsum("kij,kij->k", others[idle], by_others[idle][:, local])
        others[idle] = 0.0
        columns.append(np.zeros((k, n, 1 if idle.all() else len(own))))
        columns[-1][:, rows] = reflected[..., : columns[-1].shape[-1]]
    sqrt_cov = np.concatenate(columns, axis=2)
    used = np.any(sqrt_cov != 0, axis=(0, 1))
    return sqrt_cov if used.all() else sqrt_cov[:, :, used], drift


def _reflected(sqrt_cov: FloatArray, gradient: FloatArray) -> FloatArray:
    """Return F (k, n, n), reflected so that a function of F u has a slope along u_1 only.

    The function has the gradient (n, k). The reflection takes the axis u_1 to the direction of the
    slope or its opposite (A. S. Householder, J. ACM 5(4), 1958).
    """
    slope = gradient.T[:, np.newaxis] @ sqrt_cov
    length = np.sqrt(np.sum(slope * slope, axis=-1, keepdims=True))
    axis = np.eye(slope.shape[-1])[0]
    direction = np.where(length > 0, slope / np.where(length > 0, length, 1.0), axis)
    normal = direction + np.where(direction[..., :1] < 0, -1.0, 1.0) * axis  # not of length 0
    normal *= np.sqrt(2.0 / np.sum(normal * normal, axis=-1, keepdims=True))
    reflected: FloatArray = sqrt_cov - (sqrt_cov @ normal.swapaxes(1, 2)) * normal
    return reflected
