"""z = Φ⁻¹(P_D) as a function of the errors of the states, and its second-order expansion.

P_D = Φ(z), and z is far closer to linear in the states than P_D is. z depends on positions only
through the radars' positions relative to the aircraft. The relative states are therefore the
aircraft's attitude (3) and the states of the m radars (7m), with positions relative to the
aircraft. y are those of the relative states that are uncertain.

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

import numpy as np
from numpy.typing import NDArray

from radar_sense.covariance import square_root
from radar_sense.model.fusion import excess_hazard, linearize_fusion
from radar_sense.model.radar_equation import MOST_NEPERS
from radar_sense.states import (
    AIRCRAFT,
    ATTITUDE,
    BLOCK,
    POSITION,
    RADAR_AND_ERRORS,
    FloatArray,
    of_radar,
    slices,
)
from radar_sense.uncertain_states import UncertainStates

#: Second derivatives are differences of the gradient between −STEP and STEP standard deviations.
#: They then describe the z of a radar over the region of the states, not at a point. The fusion of
#: several radars is differentiated at the nominal states.
STEP = 0.5


@dataclass(frozen=True, eq=False)
class SecondOrder:
    """z of k poses to second order in y, n components.

    Attributes:
        components: The uncertain relative states (n,), of 3 + 7m.
        value: z at y = 0 (k,).
        gradient: Gradient of z (n, k).
        matrix: Second derivatives of z (n, n, k).
    """

    components: NDArray[np.intp]
    value: FloatArray
    gradient: FloatArray
    matrix: FloatArray

    def of(self, components: NDArray[np.intp]) -> SecondOrder:
        """Return the expansion in some of the components, the others certain."""
        own = np.searchsorted(self.components, components)
        matrix = self.matrix[own[:, np.newaxis], own]
        return SecondOrder(components, self.value, self.gradient[own], matrix)


@dataclass(frozen=True, eq=False)
class RelativeProbit:
    """z of k poses as a function of the errors of the n uncertain relative states y.

    Components are the first axis of every array, so that each is contiguous.

    Attributes:
        states: The uncertain states (k poses).
    """

    states: UncertainStates

    @cached_property
    def components(self) -> NDArray[np.intp]:
        """The uncertain relative states (n,), of 3 + 7m."""
        variances = np.diagonal(self._all_covariance, axis1=1, axis2=2)
        return np.flatnonzero(variances.any(axis=0))

    @cached_property
    def sqrt_cov(self) -> FloatArray:
        """F (k, n, r), or (1, n, r) where it is the same at all poses, r ≤ n."""
        sqrt_cov = square_root(self.covariance)
        used = np.any(sqrt_cov != 0, axis=(0, 1))
        return sqrt_cov if used.all() else sqrt_cov[:, :, used]

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of y (k, n, n), or (1, n, n) where it is the same at all poses."""
        return self._all_covariance[:, self.components[:, np.newaxis], self.components]

    @cached_property
    def _all_covariance(self) -> FloatArray:
        to_relative = _to_relative(len(self.states.model.radars))
        of_aircraft = to_relative @ self.states.cov_aircraft @ to_relative.T
        return of_aircraft + np.pad(self.states.cov_radar, [(0, 0), (3, 0), (3, 0)])

    @cached_property
    def visible(self) -> NDArray[np.bool_]:
        """Radars that see the aircraft at the nominal states (k, m)."""
        return self.states.model.visible(self.states.aircraft, self.states.radar)

    @cached_property
    def std(self) -> FloatArray:
        """Standard deviations of y (n, k)."""
        std = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2).T)
        return np.broadcast_to(std, (len(std), len(self.states)))

    @cached_property
    def floor(self) -> FloatArray:
        """Least possible z (k,), which is z without any signal."""
        return self.states.model.floor(self.visible)

    def __call__(self, error: FloatArray, pose: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        """Return z (j,) and its gradient by y (n, j) at errors (n, j) of the poses (j,).

        The gradient by a component without uncertainty is 0, also where it is undefined.
        """
        states, which = self.states, self.states.log_constants
        shifted = np.concatenate([states.aircraft.T[:, pose], states.radar.T[:, pose]])
        aircraft, radar = np.split(shifted, [len(AIRCRAFT)])
        constants = radar[which]  # a copy
        # the position of the aircraft stays nominal, and the radars have all errors of position
        shifted[len(AIRCRAFT) - 3 + self.components] += error
        growth = np.exp(np.minimum(radar[which] / constants - 1.0, MOST_NEPERS))  # ∂c_r/∂Δ
        radar[which] = constants * growth
        value, by_aircraft, by_radar = states.model.extrapolated_probit(
            aircraft.T, radar.T, self.visible[pose]
        )
        by_all = np.concatenate((by_aircraft.T[ATTITUDE], by_radar.T))
        by_all[3 + which] *= growth
        gradient = by_all[self.components]
        uncertain = self.std > 0
        if not uncertain.all():
            gradient = np.where(uncertain[:, pose], gradient, 0.0)
        return value, gradient

    def derivatives(self) -> SecondOrder:
        """Return the expansion of z about y = 0.

        Second derivatives of a network follow from those of each radar's own z.
        """
        m = len(self.states.model.radars)
        if m == 1:  # what the loop below would do to one radar is to copy it
            return self._differences()
        each = [RelativeProbit(self.states.of_radars([i]))._differences() for i in range(m)]
        value, weight = linearize_fusion(np.stack([z.value for z in each]))
        n = len(self.components)
        gradient, second = np.zeros((n, len(value))), np.zeros((n, n, len(value)))
        for i, z in enumerate(each):
            # the relative states of one radar are the attitude and its own
            moved = np.where(z.components < 3, 0, of_radar(i).start)
            places = np.searchsorted(self.components, z.components + moved)
            gradient[places] += weight[i] * z.gradient
            bend = (excess_hazard(z.value) * z.gradient)[:, np.newaxis] * z.gradient
            second[np.ix_(places, places)] += weight[i] * (z.matrix + bend)
        second -= (excess_hazard(value) * gradient)[:, np.newaxis] * gradient
        return SecondOrder(self.components, value, gradient, second)

    def _differences(self) -> SecondOrder:
        """Return the expansion of z by differences of its gradient."""
        k, n = len(self.states), len(self.std)
        step = self.std * STEP
        own, points = np.arange(n), np.arange(1, 2 * n + 1, 2)
        error = np.zeros((n, 2 * n + 1, k))
        error[own, points] = step
        error[own, points + 1] = -step
        value, by_y = self(error.reshape(n, (2 * n + 1) * k), np.tile(np.arange(k), 2 * n + 1))
        gradient = by_y.reshape(error.shape)
        change = gradient[:, 1::2] - gradient[:, 2::2]
        second = 0.25 * change / np.where(step != 0, step, np.inf)  # half of each
        return SecondOrder(
            self.components, value[:k], gradient[:, 0], second + second.swapaxes(0, 1)
        )


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
        sqrt_cov, z = probit.sqrt_cov, z.of(probit.components)
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
        parts = list(slices(len(pose), BLOCK // max(1, n * r) + 1))
        for part in parts:
            np.einsum("kij,jk->ik", self.sqrt_cov[pose[part]], u[:, part], out=error[:, part])
        value, by_y = self.probit(error, pose)
        for part in parts:
            np.einsum("kij,ik->jk", self.sqrt_cov[pose[part]], by_y[:, part], out=by_u[:, part])
        return value, by_u


@cache
def _to_relative(radars: int) -> FloatArray:
    """Return the matrix (3 + 7m, 6) from errors of the aircraft to errors of relative states."""
    matrix = np.zeros((3 + len(RADAR_AND_ERRORS) * radars, len(AIRCRAFT)))
    of_attitude, of_radars = matrix[:3], matrix[3:]
    of_attitude[:, ATTITUDE] = np.eye(3)
    for i in range(radars):
        of_radars[of_radar(i, POSITION), POSITION] = -np.eye(3)
    return matrix
