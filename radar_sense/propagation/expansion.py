"""z = Φ⁻¹(P_D) as a function of the errors of the states, and its second-order expansion.

P_D = Φ(z), and z is far closer to linear in the states than P_D is. z depends on positions only
through the radars' positions relative to the aircraft. The relative states y are therefore the
aircraft's attitude (3) and the states of the m radars (4m), with positions relative to the
aircraft. They have 3 + 4m components instead of 6 + 4m. The radar states may end with the errors of
further parameters, which are components too.

With F Fᵀ the covariance of y, y = F u maps independent standard normals u to errors of y. F is
determined up to a rotation. The rotation chosen here makes the second derivatives of z by u a
diagonal matrix. To second order z is then a sum over components,

    z(u) ≈ z(0) + Σ (g_i u_i + λ_i u_i²/2).

The radars that see the aircraft at the nominal states see the aircraft at all errors, so that z is
smooth.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_sense.covariance import square_root
from radar_sense.model.network import excess_hazard, linearize_fusion
from radar_sense.model.radar_equation import MOST_NEPERS
from radar_sense.states import (
    AIRCRAFT,
    ATTITUDE,
    POSITION,
    RADAR,
    FloatArray,
    components_of,
    constants_of,
)
from radar_sense.uncertain_states import UncertainStates

#: Second derivatives are differences of the gradient between −STEP and STEP standard deviations.
#: They then describe the z of a radar over the region of the states, not at a point. The fusion of
#: several radars is differentiated at the nominal states.
STEP = 0.5
#: Numbers of the matrices F that are copied at a time, which stay in the processor's cache (1 MB).
GATHERED = 131_072

_ATTITUDE = slice(0, 3)  # in the relative states
_RADARS = slice(3, None)


@dataclass(frozen=True, eq=False)
class SecondOrder:
    """z of k poses to second order in the relative states y, n components.

    Attributes:
        value: z at y = 0 (k,).
        gradient: Gradient of z (n, k).
        matrix: Second derivatives of z (n, n, k).
    """

    value: FloatArray
    gradient: FloatArray
    matrix: FloatArray


@dataclass(frozen=True, eq=False)
class RelativeProbit:
    """z of k poses as a function of the errors of the relative states y, n = 3 + 4m components.

    Components are the first axis of every array, so that each is contiguous.

    Attributes:
        states: The uncertain states (k poses).
    """

    states: UncertainStates

    @cached_property
    def sqrt_cov(self) -> FloatArray:
        """F (k, n, r), or (1, n, r) where it is the same at all poses, r ≤ n."""
        sqrt_cov = square_root(self.covariance)
        used = np.any(sqrt_cov != 0, axis=(0, 1))
        return sqrt_cov if used.all() else sqrt_cov[:, :, used]

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of y (k, n, n), or (1, n, n) where it is the same at all poses."""
        states = self.states
        count = max(len(states.cov_aircraft), len(states.cov_radar)) if len(states) else 0
        to_relative = _to_relative(len(states.log_constant), 3 + states.radar.shape[-1])
        covariance = np.empty((count, len(to_relative), len(to_relative)))
        covariance[:] = to_relative @ states.cov_aircraft @ to_relative.T
        covariance[:, _RADARS, _RADARS] += states.cov_radar
        return covariance

    @cached_property
    def visible(self) -> NDArray[np.bool_]:
        """Radars that see the aircraft at the nominal states (k, m)."""
        states = self.states
        visible = states.model.visible(states.aircraft, states.radar)
        return np.broadcast_to(visible, (len(states), visible.shape[-1]))

    @cached_property
    def std(self) -> FloatArray:
        """Standard deviations of y (n, k), or (n, 1)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2).T)

    @cached_property
    def floor(self) -> FloatArray:
        """Least possible z (k,), which is z without any signal."""
        return self.states.model.floor(self.visible)

    def __call__(
        self,
        error: FloatArray,
        pose: NDArray[np.intp] | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return z (j,) and its gradient by y (n, j) at errors (n, j) of the poses (j,).

        Without poses, errors are (n, s, k) at all poses, and results (s, k) and (n, s, k). The
        gradient by a component without uncertainty is 0, also where it is undefined.

        Args:
            error: Errors of the relative states.
            pose: Poses of the errors.
        """
        states = self.states
        aircraft, radar, growth = self._shifted(error, pose)
        visible = np.broadcast_to(
            self._at(self.visible.T, error, pose), (self.visible.shape[-1], *error.shape[1:])
        )
        value, by_aircraft, by_radar = states.model.extrapolated_probit(
            aircraft, radar, visible.reshape(len(visible), -1).T
        )
        gradient = np.concatenate((by_aircraft.T[ATTITUDE], by_radar.T)).reshape(error.shape)
        if growth is not None:
            gradient[_RADARS][constants_of(len(growth))] *= growth
        uncertain = self.std > 0
        if not uncertain.all():
            gradient = np.where(self._at(uncertain, error, pose), gradient, 0.0)
        return value.reshape(error.shape[1:]), gradient

    def _shifted(
        self, error: FloatArray, pose: NDArray[np.intp] | None
    ) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        """Return states (j, 6) and (j, 4m) with errors (n, j), and ∂c_r/∂Δ (m, j) or None for 1.

        Without poses, errors are (n, s, k), j counts all of them, and ∂c_r/∂Δ is (m, s, k). The
        position of the aircraft stays nominal, and the radars have all errors of position.
        """
        states = self.states
        nominal = [self._at(a.T, error, pose) for a in (states.aircraft, states.radar)]
        aircraft, radar = (np.empty((len(a), *error.shape[1:])) for a in nominal)
        aircraft[POSITION] = nominal[0][POSITION]
        np.add(nominal[0][ATTITUDE], error[_ATTITUDE], out=aircraft[ATTITUDE])
        np.add(nominal[1], error[_RADARS], out=radar)
        growth = None
        if states.log_constant.any():
            constants = constants_of(len(states.log_constant))
            which = np.arange(len(radar))[constants][states.log_constant]
            constant = nominal[1][which]
            growth = np.ones((len(states.log_constant), *error.shape[1:]))
            relative = error[_RADARS][which] / constant
            growth[states.log_constant] = np.exp(np.minimum(relative, MOST_NEPERS))
            radar[which] = constant * growth[states.log_constant]
        return aircraft.reshape(len(aircraft), -1).T, radar.reshape(len(radar), -1).T, growth

    @staticmethod
    def _at(values: NDArray[Any], error: FloatArray, pose: NDArray[np.intp] | None) -> NDArray[Any]:
        """Return values (c, k) or (c, 1) of the poses of errors, to broadcast against them."""
        if pose is not None and values.shape[1] > 1:
            return values[:, pose]
        return values.reshape(len(values), *(1,) * (error.ndim - 2), -1)

    def derivatives(self) -> SecondOrder:
        """Return the expansion of z about y = 0."""
        if len(self.states.log_constant) > 1:
            return self._fused_derivatives()
        k, n = len(self.states), len(self.std)
        along = np.flatnonzero(np.any(self.std > 0, axis=1))
        step = np.broadcast_to(self.std, (n, k))[along] * STEP
        points = np.arange(1, 2 * len(along) + 1, 2)
        error = np.zeros((n, 2 * len(along) + 1, k))
        error[along, points] = step
        error[along, points + 1] = -step
        value, gradient = self(error)
        second = np.zeros((n, n, k))
        change = gradient[:, 1::2] - gradient[:, 2::2]
        second[:, along] = 0.25 * change / np.where(step != 0, step, np.inf)  # half of each
        return SecondOrder(value[0], gradient[:, 0], second + second.swapaxes(0, 1))

    def _fused_derivatives(self) -> SecondOrder:
        """Return `derivatives` of a network, from the derivatives of each radar's own z."""
        states = self.states
        m, size = len(states.log_constant), states.radar.shape[-1]
        each = [RelativeProbit(states.of_radar(i)).derivatives() for i in range(m)]
        value, weight = linearize_fusion(np.stack([z.value for z in each]))
        gradient = np.zeros((3 + size, len(states)))
        second = np.zeros((3 + size, *gradient.shape))
        for i, z in enumerate(each):
            places = np.array([0, 1, 2, *(3 + np.array(components_of([i], m, size)))])
            gradient[places] += weight[i] * z.gradient
            bend = (excess_hazard(z.value) * z.gradient)[:, np.newaxis] * z.gradient
            second[np.ix_(places, places)] += weight[i] * (z.matrix + bend)
        second -= (excess_hazard(value) * gradient)[:, np.newaxis] * gradient
        return SecondOrder(value, gradient, second)


@dataclass(frozen=True, eq=False)
class StandardNormalSpace:
    """z(u) of k poses and its second-order expansion about u = 0, with r components of u.

    Attributes:
        probit: z as a function of the relative states.
        sqrt_cov: F (k, n, r), rotated so that second derivatives by u are a diagonal matrix.
        value: z(0) (k,).
        gradient: g (r, k), NaN where z has no gradient.
        curvature: λ (r, k), NaN where a second derivative is not finite.
    """

    probit: RelativeProbit
    sqrt_cov: FloatArray
    value: FloatArray
    gradient: FloatArray
    curvature: FloatArray

    @classmethod
    def expanded(cls, probit: RelativeProbit, z: SecondOrder) -> StandardNormalSpace:
        """Return the space for a given expansion of z in the relative states."""
        sqrt_cov = probit.sqrt_cov
        second = sqrt_cov.swapaxes(1, 2) @ np.moveaxis(z.matrix, 2, 0) @ sqrt_cov
        known = np.all(np.isfinite(second), axis=(1, 2))
        second[~known] = 0.0
        curvature, rotation = np.linalg.eigh(second)
        curvature[~known] = np.nan
        rotated = sqrt_cov @ rotation
        by_u = np.einsum("kij,ik->jk", rotated, z.gradient)
        return cls(probit, rotated, z.value, by_u, np.ascontiguousarray(curvature.T))

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


@cache
def _to_relative(radars: int, n: int) -> FloatArray:
    """Return the matrix (n, 6) from errors of the aircraft to errors of y for m radars."""
    matrix = np.zeros((n, len(AIRCRAFT)))
    matrix[_ATTITUDE, ATTITUDE] = np.eye(3)
    for i in range(radars):
        first = 3 + len(RADAR) * i
        matrix[first : first + 3, POSITION] = -np.eye(3)
    return matrix
