"""z = Φ⁻¹(P_D) as a function of errors of the relative states, and its derivatives.

P_D = Φ(z), and z is far closer to linear in the states than P_D is. z depends on positions only
through the radars' positions relative to the aircraft. The relative states y are therefore the
aircraft's attitude (3) and the states of the m radars (4m), with positions relative to the
aircraft. They have 3 + 4m components instead of 6 + 4m. The radar states may end with the errors of
further parameters, which are components too.

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
from radar_sense.propagation.gaussian_states import UncertainStates
from radar_sense.propagation.second_order import SecondOrder
from radar_sense.states import (
    AIRCRAFT,
    ATTITUDE,
    POSITION,
    RADAR,
    FloatArray,
    components_of,
    constants_of,
)

#: Second derivatives are differences of the gradient between −STEP and STEP standard deviations.
#: They then describe the z of a radar over the region of the states, not at a point. The fusion of
#: several radars is differentiated at the nominal states.
STEP = 0.5
#: Step of one-sided differences. The step is shorter, because one-sided differences have an error
#: of first order. The step goes to a smaller c_r, where z has more curvature.
ONE_SIDED_STEP = -0.1
#: Largest ln of the growth of a radar constant. P_D is 1 far below this, and a larger growth
#: overflows.
MOST_NEPERS = 300.0

_ATTITUDE = slice(0, 3)  # in the relative states
_RADARS = slice(3, None)


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
        """F (k, n, r), or (1, n, r) where it is the same at all poses, r ≤ n or 6 + 4m."""
        states = self.states
        if len(states.log_constant) == 1:
            sqrt_cov = square_root(self.covariance)
        else:
            of_aircraft = self.to_relative @ square_root(states.cov_aircraft)
            of_radars = square_root(states.cov_radar)
            n, r = of_aircraft.shape[1], of_aircraft.shape[2] + of_radars.shape[2]
            sqrt_cov = np.zeros((self._covariances, n, r))
            sqrt_cov[..., : len(AIRCRAFT)] = of_aircraft
            sqrt_cov[:, _RADARS, len(AIRCRAFT) :] = of_radars
        used = np.any(sqrt_cov != 0, axis=(0, 1))
        return sqrt_cov if used.all() else sqrt_cov[:, :, used]

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of y (k, n, n), or (1, n, n) where it is the same at all poses."""
        states, to_relative = self.states, self.to_relative
        covariance = np.empty((self._covariances, len(to_relative), len(to_relative)))
        covariance[:] = to_relative @ states.cov_aircraft @ to_relative.T
        covariance[:, _RADARS, _RADARS] += states.cov_radar
        return covariance

    @property
    def to_relative(self) -> FloatArray:
        """Matrix (n, 6) from errors of the aircraft to errors of y."""
        states = self.states
        return _to_relative(len(states.log_constant), 3 + states.radar.shape[-1])

    @property
    def _covariances(self) -> int:
        """Number of covariances, of all poses or 1."""
        states = self.states
        return max(len(states.cov_aircraft), len(states.cov_radar)) if len(states) else 0

    @cached_property
    def visible(self) -> NDArray[np.bool_]:
        """Radars that see the aircraft at the nominal states (k, m)."""
        states = self.states
        visible = states.model.visible(states.aircraft, states.radar)
        return np.broadcast_to(visible, (len(states), visible.shape[-1]))

    @cached_property
    def std(self) -> FloatArray:
        """Standard deviations of y (n, k), or (n, 1)."""
        of_aircraft, of_radars = (
            np.diagonal(c, axis1=1, axis2=2).T
            for c in (self.states.cov_aircraft, self.states.cov_radar)
        )
        variance = np.zeros((3 + len(of_radars), self._covariances))
        variance += np.square(self.to_relative) @ of_aircraft
        variance[_RADARS] += of_radars
        return np.sqrt(variance)

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
        aircraft, radar, growth = self.shifted(error, pose)
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

    def p_d(self, error: FloatArray, pose: NDArray[np.intp] | None = None) -> FloatArray:
        """Return P_D (j,) or (s, k) at errors as in `__call__`; a c_r below 0 counts as 0."""
        aircraft, radar, _ = self.shifted(error, pose)
        constants = radar[:, constants_of(len(self.states.log_constant))]
        np.maximum(constants, 0.0, out=constants)
        return self.states.model.p_d(aircraft, radar).reshape(error.shape[1:])

    def shifted(
        self, error: FloatArray, pose: NDArray[np.intp] | None = None
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

    def derivatives(self, *, sides: int = 2) -> SecondOrder:
        """Return the expansion of z about y = 0.

        Args:
            sides: 2 for second derivatives by central differences of the gradient over STEP. 1 for
                one-sided differences over ONE_SIDED_STEP, which cost half as much and suit a smooth
                z.
        """
        if len(self.states.log_constant) > 1:
            return self._fused_derivatives(sides)
        k, n = len(self.states), len(self.std)
        along = np.flatnonzero(np.any(self.std > 0, axis=1))
        step = np.broadcast_to(self.std, (n, k))[along] * (STEP if sides == 2 else ONE_SIDED_STEP)
        points = np.arange(1, sides * len(along) + 1, sides)
        error = np.zeros((n, sides * len(along) + 1, k))
        error[along, points] = step
        if sides == 2:
            error[along, points + 1] = -step
        value, gradient = self(error)
        second = gradient[:, 1::sides]
        second -= gradient[:, 2::2] if sides == 2 else gradient[:, :1]
        second *= 0.5 / sides / np.where(step != 0, step, np.inf)  # half of each difference
        if len(along) < n:
            some, second = second, np.zeros((n, n, k))
            second[:, along] = some
        symmetric: FloatArray = second.swapaxes(0, 1).copy()
        symmetric += second
        return SecondOrder(value[0], gradient[:, 0], (np.arange(n),), (symmetric,))

    def _fused_derivatives(self, sides: int) -> SecondOrder:
        """Return `derivatives` of a network, from the derivatives of each radar's own z."""
        states = self.states
        m, size = len(states.log_constant), states.radar.shape[-1]
        each = [RelativeProbit(states.of_radars([i])).derivatives(sides=sides) for i in range(m)]
        value, weight = linearize_fusion(np.stack([z.value for z in each]))
        gradient = np.zeros((len(self.std), len(states)))
        places, blocks = [], []
        for i, z in enumerate(each):
            places.append(np.array([0, 1, 2, *(3 + np.array(components_of([i], m, size)))]))
            gradient[places[i]] += weight[i] * z.gradient
            bend = (excess_hazard(z.value) * z.gradient)[:, np.newaxis] * z.gradient
            blocks.append(weight[i] * (z.matrix() + bend))
        return SecondOrder(value, gradient, tuple(places), tuple(blocks), -excess_hazard(value))


@cache
def _to_relative(radars: int, n: int) -> FloatArray:
    """Return the matrix (n, 6) from errors of the aircraft to errors of y for m radars."""
    matrix = np.zeros((n, len(AIRCRAFT)))
    matrix[_ATTITUDE, ATTITUDE] = np.eye(3)
    for i in range(radars):
        first = 3 + len(RADAR) * i
        matrix[first : first + 3, POSITION] = -np.eye(3)
    return matrix
