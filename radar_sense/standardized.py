"""Standardized state space: z, the probit of P_D, as a function of independent standard normals.

P_D = Φ(z), and z is far closer to linear in the states than P_D is. With F Fᵀ the covariance of all
ten states, x = x̄ + F u turns independent standard normal u into states, and a method of propagation
sees a function z(u) and nothing else. F is free up to a rotation. The one taken here makes the
second derivatives of z a diagonal matrix, so that to second order z is a sum over components,

    z(u) ≈ z(0) + Σ (g_i u_i + λ_i u_i²/2).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_sense.covariance import factor
from radar_sense.model import DetectionModel
from radar_sense.states import AIRCRAFT, CONSTANT, RADAR, FloatArray

#: Poses standardized at a time, which bounds the memory in use; of no influence on the result.
BLOCK = 1024

#: Second derivatives are differences of the gradient between −STEP and STEP standard deviations:
#: those of the region where the states are rather than of a point.
STEP = 0.5


@dataclass(frozen=True, eq=False)
class Standardized:
    """z(u) of m poses, and its second-order expansion about u = 0.

    Attributes:
        model: The detection model.
        aircraft: Nominal aircraft states (m, 6).
        radar: Nominal radar states (m, 4).
        cov_aircraft: C_aa (m, 6, 6).
        cov_radar: C_rr (m, 4, 4).
        factor: F (m, 10, 10).
        value: z(0) (m,).
        gradient: g (m, 10), NaN where z has none.
        curvature: λ (m, 10), NaN where it cannot be found.
        log_constant: Whether it is ln c_r that is Gaussian: c_r = c̄_r exp(Δ/c̄_r), Δ of C_rr.
    """

    model: DetectionModel
    aircraft: FloatArray
    radar: FloatArray
    cov_aircraft: FloatArray
    cov_radar: FloatArray
    factor: FloatArray
    value: FloatArray
    gradient: FloatArray
    curvature: FloatArray
    log_constant: bool = False

    def __call__(self, u: FloatArray, pose: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        """Return z (k,) and its gradient (k, 10) at u (k, 10), each row for its pose (k,)."""
        states = self.aircraft[pose], self.radar[pose]
        return _evaluate(self.model, *states, self.factor[pose], u, self.log_constant)

    @property
    def floor(self) -> float:
        """The least z there is, that without any signal."""
        return float(self.model.detector.linearize_probit(np.zeros(()), self.model.p_fa)[0])


def standardize(
    model: DetectionModel,
    aircraft: ArrayLike,
    radar: ArrayLike,
    cov_aircraft: ArrayLike,
    cov_radar: ArrayLike,
    *,
    log_constant: bool = False,
) -> tuple[tuple[int, ...], Iterator[Standardized]]:
    """Broadcast states and covariances against each other and standardize them block by block.

    Returns:
        The shape (...) of all poses, and the blocks, which have them one after the other.

    Raises:
        ValueError: If a shape does not fit.
    """
    arrays, tails = [], []
    for name, values, tail in (
        ("aircraft states", aircraft, (len(AIRCRAFT),)),
        ("radar states", radar, (len(RADAR),)),
        ("aircraft covariance", cov_aircraft, 2 * (len(AIRCRAFT),)),
        ("radar covariance", cov_radar, 2 * (len(RADAR),)),
    ):
        array = np.asarray(values, dtype=float)
        if array.shape[-len(tail) :] != tail:
            wanted = ", ".join(("...", *map(str, tail)))
            raise ValueError(f"{name} must have shape ({wanted}), got {array.shape}")
        arrays.append(array)
        tails.append(tail)
    leading = (array.shape[: -len(tail)] for array, tail in zip(arrays, tails, strict=True))
    shape = np.broadcast_shapes(*leading)
    grid = shape or (1,)
    views = [np.broadcast_to(a, grid + tail) for a, tail in zip(arrays, tails, strict=True)]
    poses = int(np.prod(grid))

    def blocks() -> Iterator[Standardized]:
        for start in range(0, max(poses, 1), BLOCK):
            index = np.unravel_index(np.arange(start, min(start + BLOCK, poses)), grid)
            states = (view[index] for view in views)
            yield _expand(model, *states, log_constant=log_constant)

    return shape, blocks()


def _expand(
    model: DetectionModel,
    aircraft: FloatArray,
    radar: FloatArray,
    cov_aircraft: FloatArray,
    cov_radar: FloatArray,
    *,
    log_constant: bool,
) -> Standardized:
    n, both = len(AIRCRAFT), len(AIRCRAFT) + len(RADAR)
    root = np.zeros((len(aircraft), both, both))
    root[:, :n, :n] = factor(cov_aircraft)
    root[:, n:, n:] = factor(cov_radar)
    hessian = np.empty_like(root)
    for i in range(both):
        u = np.zeros((len(aircraft), both))
        u[:, i] = STEP
        ahead, behind = (
            _evaluate(model, aircraft, radar, root, v, log_constant)[1] for v in (u, -u)
        )
        hessian[:, i] = (ahead - behind) / (2.0 * STEP)
    known = np.isfinite(hessian).all(axis=(1, 2))
    hessian[~known] = 0.0
    curvature, rotation = np.linalg.eigh((hessian + hessian.swapaxes(1, 2)) / 2.0)
    curvature[~known] = np.nan
    rotated = root @ rotation
    nominal = np.zeros((len(aircraft), both))
    value, gradient = _evaluate(model, aircraft, radar, rotated, nominal, log_constant)
    return Standardized(
        model=model,
        aircraft=aircraft,
        radar=radar,
        cov_aircraft=cov_aircraft,
        cov_radar=cov_radar,
        factor=rotated,
        value=value,
        gradient=gradient,
        curvature=curvature,
        log_constant=log_constant,
    )


def _evaluate(
    model: DetectionModel,
    aircraft: FloatArray,
    radar: FloatArray,
    factor: FloatArray,
    u: FloatArray,
    log_constant: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Return z (k,) and its gradient (k, 10) at u (k, 10).

    A radar constant below zero stands for zero, where z has its floor. Here z goes on below it,
    with the slope that it has at c_r = 0. Quantiles of the greater of z and the floor are the
    greater of the quantile and the floor, so that a method can work with a smooth z and apply the
    floor last.
    """
    shift = np.einsum("kij,kj->ki", factor, u)
    aircraft = aircraft + shift[:, : len(AIRCRAFT)]
    nominal, radar = radar, radar + shift[:, len(AIRCRAFT) :]
    if log_constant:
        growth = np.exp(shift[:, len(AIRCRAFT) + CONSTANT] / nominal[:, CONSTANT])
        radar[:, CONSTANT] = nominal[:, CONSTANT] * growth
    below_zero = np.minimum(radar[:, CONSTANT], 0.0)
    radar[:, CONSTANT] -= below_zero
    value, by_aircraft, by_radar = model.linearize_probit(aircraft, radar)
    if log_constant:  # ∂c_r/∂Δ
        by_radar[:, CONSTANT] *= growth
    by_state = np.concatenate((by_aircraft, by_radar), axis=1)
    # A gradient may be undefined where nothing is uncertain: 0 · NaN is no uncertainty here.
    by_state = np.where(np.any(factor != 0, axis=-1), by_state, 0.0)
    return value + by_radar[:, CONSTANT] * below_zero, np.einsum("kij,ki->kj", factor, by_state)
