"""Uncertain states, and z = Φ⁻¹(P_D) as a function of independent standard normals u (u-space).

P_D = Φ(z), and z is far closer to linear in the states than P_D is. z depends on positions only
through the radars' positions relative to the aircraft. The relative states y are therefore the
aircraft's attitude (3) and the states of the m radars (4m), with positions relative to the
aircraft. They have 3 + 4m components instead of 6 + 4m. The radar states may end with the errors of
further parameters, which are components too.

With F Fᵀ the covariance of y, y = F u maps independent standard normals u to errors of y. F is
determined up to a rotation. The rotation chosen here makes the second derivatives of z by u a
diagonal matrix. To second order z is then a sum over components,

    z(u) ≈ z(0) + Σ (g_i u_i + λ_i u_i²/2).

The radars that see the aircraft at u = 0 see the aircraft at every u, so that z is smooth.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_sense.covariance import checked, square_root
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.network import (
    NetworkModel,
    as_network,
    excess_hazard,
    linearize_fusion,
)
from radar_sense.propagation.second_order import SecondOrder
from radar_sense.states import (
    AIRCRAFT,
    ATTITUDE,
    POSITION,
    RADAR,
    FloatArray,
    check_finite,
    components_of,
    constants_of,
)

#: Second derivatives are differences of the gradient between −STEP and STEP standard deviations.
#: They then describe z over the region of the states, not at a point.
STEP = 0.5
#: Step of one-sided differences. The step is shorter, because one-sided differences have an error
#: of first order. The step goes to a smaller c_r, where z has more curvature.
ONE_SIDED_STEP = -0.1
#: Second derivatives of z by idle components of u are below this fraction of σ of z. A bound of
#: FORM at β then changes by less than ½ IDLE² β³ σ in z, 5.4e-5 σ at β = 3.
IDLE = 2e-3
#: Numbers in the largest array of a block of poses, which bounds memory (16 MB).
MAX_NUMBERS = 2_000_000
#: Numbers of the matrices F that are copied at a time, which stay in the processor's cache (1 MB).
GATHERED = 131_072
#: Most poses in a block: less time in Python, and arrays of finite differences of 1 MB.
BLOCK = 2048
#: Largest ln of the growth of a radar constant. P_D is 1 far below this, and a larger growth
#: overflows.
MOST_NEPERS = 300.0

_ATTITUDE = slice(0, 3)  # in the relative states
_RADARS = slice(3, None)


#: From C_aa and C_rr, each for all poses together or for each pose, to σ of P_D (k,).
StdFunction: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class UncertainStates:
    """Nominal states of k poses, their covariances, and the detection model.

    An array with the same rows at all poses may have one row instead of k.

    Attributes:
        model: The detection model, of a radar or of a network of m.
        log_constant: Radars (m,) whose ln c_r is Gaussian: c_r = c̄_r exp(Δ/c̄_r), Δ of C_rr.
        aircraft: Nominal aircraft states (k, 6).
        radar: Nominal radar states (k, 4m), or more with the errors of further parameters.
        cov_aircraft: C_aa (k, 6, 6).
        cov_radar: C_rr (k, 4m, 4m), or more.
    """

    model: NetworkModel
    log_constant: NDArray[np.bool_]
    aircraft: FloatArray
    radar: FloatArray
    cov_aircraft: FloatArray
    cov_radar: FloatArray

    def __len__(self) -> int:
        """Number of poses."""
        lengths = {len(array) for array in self._arrays}
        return 0 if 0 in lengths else max(lengths)

    @property
    def covariances(self) -> tuple[FloatArray, FloatArray]:
        """C_aa (6, 6) or (k, 6, 6), and C_rr alike."""
        aircraft, radar = (c[0] if len(c) == 1 else c for c in (self.cov_aircraft, self.cov_radar))
        return aircraft, radar

    def blocks(self, numbers: int) -> Iterator[UncertainStates]:
        """Yield blocks of poses for an algorithm that needs this many numbers a pose."""
        return self.cut(max(1, min(BLOCK, MAX_NUMBERS // numbers)))

    def cut(self, size: int) -> Iterator[UncertainStates]:
        """Yield parts with at most this number of poses, one part if there are no poses."""
        for start in range(0, max(len(self), 1), size):
            arrays = (a if len(a) == 1 else a[start : start + size] for a in self._arrays)
            yield UncertainStates(self.model, self.log_constant, *arrays)

    def at(self, rows: NDArray[np.intp]) -> UncertainStates:
        """Return the states of some poses."""
        arrays = (a if len(a) == 1 < len(self) else a[rows] for a in self._arrays)
        return UncertainStates(self.model, self.log_constant, *arrays)

    def with_covariances(self, cov_aircraft: FloatArray, cov_radar: FloatArray) -> UncertainStates:
        """Return the states with other covariances (n, n) or (k, n, n)."""
        covariances = (c[np.newaxis] if c.ndim == 2 else c for c in (cov_aircraft, cov_radar))
        return UncertainStates(
            self.model, self.log_constant, self.aircraft, self.radar, *covariances
        )

    def by_sight(self) -> Iterator[tuple[NDArray[np.intp], UncertainStates]]:
        """Yield groups of poses that the same radars see, with the states of these radars alone.

        The other radars change neither z nor the derivatives of z. A pose that no radar sees keeps
        one radar. Without poses there is one group.
        """
        if not len(self) or len(self.log_constant) == 1 or not self.model.limited:
            yield np.arange(len(self)), self
            return
        visible = self.model.visible(self.aircraft, self.radar)
        sets, group = np.unique(
            np.broadcast_to(visible, (len(self), visible.shape[-1])), axis=0, return_inverse=True
        )
        for number, seen in enumerate(sets):
            poses = np.flatnonzero(group.reshape(-1) == number)
            yield poses, self.at(poses).of_radars(np.flatnonzero(seen).tolist() or [0])

    def of_radars(self, radars: list[int]) -> UncertainStates:
        """Return the states of some radars."""
        size = self.radar.shape[-1]
        components = components_of(radars, len(self.log_constant), size)
        return UncertainStates(
            NetworkModel(tuple(self.model.radars[i] for i in radars)),
            self.log_constant[radars],
            self.aircraft,
            self.radar[:, components],
            self.cov_aircraft,
            self.cov_radar[:, components][..., components],
        )

    @property
    def independent(self) -> bool:
        """Whether the radars of a network have independent errors; False for a single radar."""
        m, size = len(self.log_constant), self.radar.shape[-1]
        if m == 1:
            return False
        together = np.eye(size, dtype=bool)
        for i in range(m):
            own = [c for c in components_of([i], m, size) if c != len(RADAR) * m]  # not the RCS
            together[np.ix_(own, own)] = True
        return not self.cov_radar[:, ~together].any()

    @property
    def _arrays(self) -> tuple[FloatArray, ...]:
        return self.aircraft, self.radar, self.cov_aircraft, self.cov_radar


def uncertain_states(
    model: DetectionModel | NetworkModel,
    aircraft: ArrayLike,
    radar: ArrayLike,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    log_constant: ArrayLike = False,
    check: bool = True,
) -> tuple[tuple[int, ...], UncertainStates]:
    """Broadcast states and covariances against each other, with all poses along one axis.

    Args:
        model: The detection model, of a radar or of a network of m.
        aircraft: Nominal aircraft states (..., 6).
        radar: Nominal radar states (..., 4m).
        cov_aircraft: C_aa (..., 6, 6).
        cov_radar: C_rr (..., 4m, 4m).
        log_constant: Whether ln c_r is Gaussian, of all radars or of each (m,).
        check: Whether to check values. The arrays of a `Scenario` are checked already.

    Returns:
        The shape (...) of all poses, and the states.

    Raises:
        ValueError: If a shape does not fit, a state is not finite, or a matrix is not a covariance.
    """
    model = as_network(model)
    size = np.shape(radar)[-1:]
    radars = size[0] if size and size[0] in model.sizes else model.sizes[0]
    arrays: list[tuple[FloatArray, tuple[int, ...]]] = []
    wanted: tuple[tuple[str, ArrayLike, tuple[int, ...]], ...] = (
        ("aircraft states", aircraft, (len(AIRCRAFT),)),
        ("radar states", radar, (radars,)),
        ("aircraft covariance", cov_aircraft, 2 * (len(AIRCRAFT),)),
        ("radar covariance", cov_radar, 2 * (radars,)),
    )
    for name, values, tail in wanted:
        array = np.asarray(values, dtype=float)
        if array.shape[-len(tail) :] != tail:
            expected = ", ".join(("...", *map(str, tail)))
            raise ValueError(f"{name} must have shape ({expected}), got {array.shape}")
        whose = name.split()[0]
        if check and len(tail) == 1:
            check_finite(whose, array, len(model.radars))
        elif check:
            checked(whose, array)
        arrays.append((array, tail))
    shape = np.broadcast_shapes(*(array.shape[: -len(tail)] for array, tail in arrays))
    rows = []
    for array, tail in arrays:
        if math.prod(array.shape[: -len(tail)]) != 1:
            array = np.broadcast_to(array, shape + tail)
        rows.append(array.reshape(-1, *tail))
    which = np.broadcast_to(np.asarray(log_constant, dtype=bool), len(model.models))
    return shape, UncertainStates(model, which, *rows)


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


@dataclass(frozen=True, eq=False)
class StandardNormalSpace:
    """z(u) of k poses and its second-order expansion about u = 0, with r components of u.

    Attributes:
        probit: z as a function of the relative states.
        sqrt_cov: F (k, n, r), rotated so that second derivatives by u are a diagonal matrix.
        value: z(0) (k,).
        gradient: g (r, k), NaN where z has no gradient.
        curvature: λ (r, k), NaN where a second derivative is not finite.
        drift: What components that were left out add to the mean of z (k,).
    """

    probit: RelativeProbit
    sqrt_cov: FloatArray
    value: FloatArray
    gradient: FloatArray
    curvature: FloatArray
    drift: FloatArray

    @classmethod
    def of(cls, states: UncertainStates) -> StandardNormalSpace:
        """Return the expansion of z about the nominal states."""
        probit = RelativeProbit(states)
        return cls.expanded(probit, probit.derivatives())

    @classmethod
    def expanded(cls, probit: RelativeProbit, z: SecondOrder) -> StandardNormalSpace:
        """Return the space for a given expansion of z in the relative states."""
        if probit.states.independent:
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

    The components of u of each radar are rotated until z has a slope along the first one only. The
    others are idle where the second derivatives of z by them and by any component are small: the
    sum of squares over all radars is at most IDLE² σ², with σ of z. Their own second derivatives
    move the mean of z. The result has this drift (k,) too.
    """
    states = probit.states
    m, size = len(states.log_constant), states.radar.shape[-1]
    k, n, rcs = len(states), len(probit.std), len(RADAR) * m
    covariance = probit.covariance
    along = np.swapaxes(covariance @ z.gradient.T[..., np.newaxis], 0, 1)[..., 0]
    variance = np.einsum("ik,ik->k", z.gradient, along)
    of_aircraft = probit.to_relative @ square_root(states.cov_aircraft)
    columns = [np.broadcast_to(of_aircraft, (k, *of_aircraft.shape[1:]))]
    drift = np.zeros(k)
    if size > rcs:
        columns.append(np.zeros((k, n, 1)))
        columns[-1][:, 3 + rcs, 0] = np.sqrt(states.cov_radar[:, rcs, rcs])
    for i, (places, block) in enumerate(zip(z.places, z.blocks, strict=True)):
        own = [c for c in components_of([i], m, size) if c != rcs]
        rows, local = np.add(3, own), np.isin(places, np.add(3, own))
        root = square_root(states.cov_radar[:, own][..., own])
        slope = z.gradient[rows].T[:, np.newaxis] @ root
        length = np.sqrt(np.sum(slope * slope, axis=-1, keepdims=True))
        first = np.where(length > 0, slope / np.where(length > 0, length, 1.0), np.eye(len(own))[0])
        by_own = np.moveaxis(block[:, local], 2, 0) @ root  # second derivatives by y_i and by u
        squares = by_own.swapaxes(1, 2) @ covariance[:, places][..., places] @ by_own
        curvatures = root.swapaxes(1, 2) @ by_own[:, local]
        square, curvature = (
            np.einsum("kii->k", matrix) - np.einsum("kij,khi,khj->k", matrix, first, first)
            for matrix in (squares, curvatures)
        )
        idle = m * square <= IDLE**2 * variance
        drift[idle] += 0.5 * curvature[idle]
        # the reflection that takes the first axis to the direction of the slope, or its opposite
        normal = first + np.where(first[..., :1] < 0, -1.0, 1.0) * np.eye(len(own))[0]
        scale = 2.0 / np.sum(normal * normal, axis=-1, keepdims=True)
        rotated = root @ (np.eye(len(own)) - scale * normal.swapaxes(1, 2) * normal)
        rotated[idle, :, 1:] = 0.0
        columns.append(np.zeros((k, n, 1 if idle.all() else len(own))))
        columns[-1][:, rows] = rotated[..., : columns[-1].shape[-1]]
    sqrt_cov = np.concatenate(columns, axis=2)
    used = np.any(sqrt_cov != 0, axis=(0, 1))
    return sqrt_cov if used.all() else sqrt_cov[:, :, used], drift


@cache
def _to_relative(radars: int, n: int) -> FloatArray:
    """Return the matrix (n, 6) from errors of the aircraft to errors of y for m radars."""
    matrix = np.zeros((n, len(AIRCRAFT)))
    matrix[_ATTITUDE, ATTITUDE] = np.eye(3)
    for i in range(radars):
        first = 3 + len(RADAR) * i
        matrix[first : first + 3, POSITION] = -np.eye(3)
    return matrix
