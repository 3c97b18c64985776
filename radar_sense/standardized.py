"""Standardized state space: z, the probit of P_D, as a function of independent standard normals.

P_D = Φ(z), and z is far closer to linear in the states than P_D is. With F Fᵀ the covariance of all
n = 6 + 4m states, of an aircraft and m radars, x = x̄ + F u turns independent standard normal u into
states, and a method of propagation sees a function z(u) and nothing else. F is free up to a
rotation. The one taken here makes the second derivatives of z a diagonal matrix, so that to second
order z is a sum over components,

    z(u) ≈ z(0) + Σ (g_i u_i + λ_i u_i²/2).

Which radars see the aircraft is taken to be as it is at u = 0, so that z is smooth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_sense.covariance import checked, factor
from radar_sense.model.detection_model import Model
from radar_sense.states import AIRCRAFT, CONSTANTS, RADAR, FloatArray, check_finite

#: Poses standardized at a time, and numbers in a matrix for each of them: they bound the memory in
#: use, and are of no influence on the result but for its last digit.
BLOCK = 1024
MAX_NUMBERS = 8_000_000

#: Second derivatives are differences of the gradient between −STEP and STEP standard deviations:
#: those of the region where the states are rather than of a point.
STEP = 0.5
#: How far along each axis of u to look for an edge beyond which a radar sees the aircraft no more,
#: or sees it only there. An edge 3 away across a position's axes is 3√3 away along each of them.
REACH = 5.2
#: ln of the largest growth of a radar constant, beyond which numbers would overflow. P_D has long
#: been 1 there.
MOST_NEPERS = 300.0


@dataclass(frozen=True, eq=False)
class Standardized:
    """z(u) of k poses, and its second-order expansion about u = 0.

    Attributes:
        model: The detection model.
        aircraft: Nominal aircraft states (k, 6).
        radar: Nominal radar states (k, 4m).
        cov_aircraft: C_aa (k, 6, 6).
        cov_radar: C_rr (k, 4m, 4m).
        visible: Which radars see the aircraft (k, m).
        edge: Where that may change within reach of the states (k,).
        factor: F (k, n, n).
        value: z(0) (k,).
        gradient: g (k, n), NaN where z has none.
        curvature: λ (k, n), NaN where it cannot be found.
        log_constant: Of which radars (m,) ln c_r is Gaussian: c_r = c̄_r exp(Δ/c̄_r), Δ of C_rr.
    """

    model: Model
    aircraft: FloatArray
    radar: FloatArray
    cov_aircraft: FloatArray
    cov_radar: FloatArray
    visible: NDArray[np.bool_]
    edge: NDArray[np.bool_]
    factor: FloatArray
    value: FloatArray
    gradient: FloatArray
    curvature: FloatArray
    log_constant: NDArray[np.bool_]

    def __call__(self, u: FloatArray, pose: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        """Return z (j,) and its gradient (j, n) at u (j, n), each row for its pose (j,)."""
        nominal, root = (self.aircraft[pose], self.radar[pose]), self.factor[pose]
        states = _shifted(*nominal, root, u, log_constant=self.log_constant)
        return _evaluate(self.model, states, self.visible[pose], root)

    @property
    def floor(self) -> FloatArray:
        """The least z there is (k,), that without any signal."""
        return self.model.floor(self.visible)


def standardize(
    model: Model,
    aircraft: ArrayLike,
    radar: ArrayLike,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    log_constant: ArrayLike = False,
) -> tuple[tuple[int, ...], Iterator[Standardized]]:
    """Broadcast states and covariances against each other and standardize them block by block.

    Returns:
        The shape (...) of all poses, and the blocks, which have them one after the other.

    Raises:
        ValueError: If a shape does not fit, a state is not finite, or a matrix is not a covariance.
    """
    arrays, tails = [], []
    radars = len(model.models) * len(RADAR)
    for name, values, tail in (
        ("aircraft states", aircraft, (len(AIRCRAFT),)),
        ("radar states", radar, (radars,)),
        ("aircraft covariance", cov_aircraft, 2 * (len(AIRCRAFT),)),
        ("radar covariance", cov_radar, 2 * (radars,)),
    ):
        array = np.asarray(values, dtype=float)
        if array.shape[-len(tail) :] != tail:
            wanted = ", ".join(("...", *map(str, tail)))
            raise ValueError(f"{name} must have shape ({wanted}), got {array.shape}")
        whose = name.split()[0]
        if len(tail) == 1:
            check_finite(whose, array)
        else:
            checked(whose, array)
        arrays.append(array)
        tails.append(tail)
    leading = (array.shape[: -len(tail)] for array, tail in zip(arrays, tails, strict=True))
    shape = np.broadcast_shapes(*leading)
    grid = shape or (1,)
    logarithmic = np.broadcast_to(np.asarray(log_constant, dtype=bool), len(model.models))
    views = [np.broadcast_to(a, grid + tail) for a, tail in zip(arrays, tails, strict=True)]
    poses = int(np.prod(grid))
    block = max(1, min(BLOCK, MAX_NUMBERS // (len(AIRCRAFT) + radars) ** 2))

    def blocks() -> Iterator[Standardized]:
        for start in range(0, max(poses, 1), block):
            index = np.unravel_index(np.arange(start, min(start + block, poses)), grid)
            states = (view[index] for view in views)
            yield _expand(model, *states, log_constant=logarithmic)

    return shape, blocks()


def _expand(
    model: Model,
    aircraft: FloatArray,
    radar: FloatArray,
    cov_aircraft: FloatArray,
    cov_radar: FloatArray,
    *,
    log_constant: NDArray[np.bool_],
) -> Standardized:
    n, both = len(AIRCRAFT), len(AIRCRAFT) + radar.shape[-1]
    root = np.zeros((len(aircraft), both, both))
    root[:, :n, :n] = factor(cov_aircraft)
    root[:, n:, n:] = factor(cov_radar)
    visible = model.visible(aircraft, radar)

    def shifted(root: FloatArray, u: FloatArray) -> _States:
        return _shifted(aircraft, radar, root, u, log_constant=log_constant)

    edge = np.zeros(len(aircraft), dtype=bool)
    hessian = np.empty_like(root)
    for i in range(both):
        u = np.zeros((len(aircraft), both))
        u[:, i] = 1.0
        ahead, behind = (
            _evaluate(model, shifted(root, step * u), visible, root)[1] for step in (STEP, -STEP)
        )
        hessian[:, i] = (ahead - behind) / (2.0 * STEP)
        for reach in (REACH, -REACH):
            far = shifted(root, reach * u)
            edge |= np.any(model.visible(far.aircraft, far.radar) != visible, axis=1)
    known = np.isfinite(hessian).all(axis=(1, 2))
    hessian[~known] = 0.0
    curvature, rotation = np.linalg.eigh((hessian + hessian.swapaxes(1, 2)) / 2.0)
    curvature[~known] = np.nan
    rotated = root @ rotation
    at_zero = shifted(rotated, np.zeros((len(aircraft), both)))
    value, gradient = _evaluate(model, at_zero, visible, rotated)
    return Standardized(
        model=model,
        aircraft=aircraft,
        radar=radar,
        cov_aircraft=cov_aircraft,
        cov_radar=cov_radar,
        visible=visible,
        edge=edge,
        factor=rotated,
        value=value,
        gradient=gradient,
        curvature=curvature,
        log_constant=log_constant,
    )


class _States(NamedTuple):
    """States (k, 6) and (k, 4m) at some u, and ∂c_r/∂Δ, which is c_r/c̄_r (k, m) or 1."""

    aircraft: FloatArray
    radar: FloatArray
    growth: FloatArray | float


def _shifted(
    aircraft: FloatArray,
    radar: FloatArray,
    factor: FloatArray,
    u: FloatArray,
    *,
    log_constant: NDArray[np.bool_],
) -> _States:
    """Return the states at u (k, n)."""
    shift = np.einsum("kij,kj->ki", factor, u)
    of_radar = shift[:, len(AIRCRAFT) :]
    states = _States(aircraft + shift[:, : len(AIRCRAFT)], radar + of_radar, 1.0)
    if not log_constant.any():
        return states
    growth = np.ones((len(radar), len(log_constant)))
    which = np.arange(radar.shape[-1])[CONSTANTS][log_constant]
    growth[:, log_constant] = np.exp(np.minimum(of_radar[:, which] / radar[:, which], MOST_NEPERS))
    states.radar[:, which] = radar[:, which] * growth[:, log_constant]
    return states._replace(growth=growth)


def _evaluate(
    model: Model, states: _States, visible: NDArray[np.bool_], factor: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return z (k,) at the states, and its gradient (k, n) by u."""
    value, by_aircraft, by_radar = model.continued_probit(states.aircraft, states.radar, visible)
    by_radar[:, CONSTANTS] *= states.growth
    by_state = np.concatenate((by_aircraft, by_radar), axis=1)
    # A gradient may be undefined where nothing is uncertain: 0 · NaN is no uncertainty here.
    by_state = np.where(np.any(factor != 0, axis=-1), by_state, 0.0)
    return value, np.einsum("kij,ki->kj", factor, by_state)
