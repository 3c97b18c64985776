"""The second-order expansion of z about the nominal states.

With y the relative states of `relative_probit`, g the gradient of z, and y_i the components that
z_i of radar i depends on,

    z(y) ≈ z + gᵀy + ½ Σ y_iᵀ E_i y_i + ½ b (gᵀy)².

A single radar has b = 0. The sum and the square come from the fusion of the z_i; see
`model.network`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from radar_sense.covariance import MANY
from radar_sense.states import (
    AIRCRAFT,
    ATTENUATION_ERROR,
    CONSTANT,
    RADAR,
    RCS_ERROR,
    FloatArray,
    own_components_of,
)

#: Place of the state of radar i in y_i, after the attitude.
_RADAR = 3


@dataclass(frozen=True, eq=False)
class SecondOrder:
    """z of k poses to second order in the relative states y, n components.

    Attributes:
        value: z at y = 0 (k,).
        gradient: g (n, k).
        places: Components (q,) of y that each radar depends on.
        blocks: E_i (q, q, k) of each radar.
        square: b (k,); None for a single radar, where b = 0.
    """

    value: FloatArray
    gradient: FloatArray
    places: tuple[NDArray[np.intp], ...]
    blocks: tuple[FloatArray, ...]
    square: FloatArray | None = None

    def matrix(self) -> FloatArray:
        """Return the second derivatives of z by y (n, n, k)."""
        if self.square is None:
            return self.blocks[0]
        second = (self.square * self.gradient)[:, np.newaxis] * self.gradient
        for places, block in zip(self.places, self.blocks, strict=True):
            second[np.ix_(places, places)] += block
        return second

    def second_derivatives_by(self, sqrt_cov: FloatArray) -> FloatArray:
        """Return the second derivatives of z by u (k, r, r), with y = F u and F (k or 1, n, r)."""
        second = np.zeros((len(self.value), *2 * sqrt_cov.shape[-1:]))
        for places, block in zip(self.places, self.blocks, strict=True):
            root = sqrt_cov[:, places]
            second += root.swapaxes(1, 2) @ np.moveaxis(block, 2, 0) @ root
        if self.square is not None:
            by_u = np.einsum(
                "kij,ik->kj",
                np.broadcast_to(sqrt_cov, (len(second), *sqrt_cov.shape[1:])),
                self.gradient,
            )
            second += (
                self.square[:, np.newaxis, np.newaxis] * by_u[:, np.newaxis] * by_u[..., np.newaxis]
            )
        return second


class Invariants(NamedTuple):
    """Numbers of the expansion in standard normal space, at each of k poses.

    g is the gradient of z by u, and H are the second derivatives. The numbers are the same for
    every rotation of u.

    Attributes:
        value: z at the nominal states (k,).
        slope: gᵀg (k,).
        curvature: gᵀHg (k,).
        trace: tr H (k,).
        trace_of_square: tr H² (k,).
        trace_of_cube: tr H³ (k,).
    """

    value: FloatArray
    slope: FloatArray
    curvature: FloatArray
    trace: FloatArray
    trace_of_square: FloatArray
    trace_of_cube: FloatArray


def invariants(z: SecondOrder, covariance: FloatArray) -> tuple[Invariants, FloatArray]:
    """Return the invariants, and the errors (n, k) of y at u = g.

    With C the covariance of y, C times the second derivatives has the traces of H.

    Args:
        z: The expansion.
        covariance: C (k, n, n), or (1, n, n).
    """
    second = z.matrix()
    along = _times(covariance, z.gradient)
    product = _times(covariance, second)
    numbers = Invariants(
        z.value,
        _dot(z.gradient, along),
        _dot(along, np.einsum("ijk,jk->ik", second, along)),
        np.einsum("iik->k", product),
        _trace_of_product(product, product),
        trace_of_cube(product),
    )
    return _not_negative(numbers), along


def invariants_of_independent(
    z: SecondOrder, cov_aircraft: FloatArray, cov_radar: FloatArray
) -> tuple[Invariants, FloatArray]:
    """Return `invariants` for radars with independent errors. The time is proportional to m.

    x are the errors of the states. All radars share the states of the aircraft and ε of the RCS:
    the shared states have the index s. The other states of radar i have the index i. V_s and V_i
    are the covariances of these errors. K_ss, K_si and K_ii are the second derivatives of
    ½ Σ y_iᵀ E_i y_i by x.

    Args:
        z: The expansion, of m radars.
        cov_aircraft: C_aa (k, 6, 6), or (1, 6, 6).
        cov_radar: C_rr (k, 4m, 4m) or (1, 4m, 4m), or more, without covariances between radars.
    """
    m, size = len(z.blocks), cov_radar.shape[-1]
    q = len(z.places[0])
    shared_error = [_RADAR + RCS_ERROR] if q > _RADAR + RCS_ERROR else []
    # The shared states in y_i. An error of the aircraft's position acts as the opposite error of a
    # radar's position.
    order = [3, 4, 5, 0, 1, 2, *shared_error]
    sign = np.array([-1.0] * 3 + [1.0] * (len(order) - 3))[:, np.newaxis]
    own = [*range(3, _RADAR + CONSTANT + 1), *range(_RADAR + ATTENUATION_ERROR, q)]
    error = len(RADAR) * m  # ε among the radar states

    covariances = max(len(cov_aircraft), len(cov_radar)) if len(z.value) else 0
    shared = np.zeros((covariances, len(order), len(order)))
    shared[:, : len(AIRCRAFT), : len(AIRCRAFT)] = cov_aircraft
    if shared_error:
        shared[:, -1, -1] = cov_radar[:, error, error]
    k_ss = np.zeros((len(order), len(order), len(z.value)))
    g_s = np.zeros((len(order), len(z.value)))
    g_s[3:6] = z.gradient[:_RADAR]
    g_s[6:] = z.gradient[_RADAR + error : _RADAR + error + 1] if shared_error else 0.0
    parts = []
    for i, (places, block) in enumerate(zip(z.places, z.blocks, strict=True)):
        k_s = sign[:, np.newaxis] * block[order]
        k_ss += k_s[:, order] * sign
        g_s[:3] -= z.gradient[places[3:6]]
        of_radar = own_components_of(i, m, size)
        v_i = cov_radar[:, of_radar][..., of_radar]
        parts.append((places[own], v_i, k_s[:, own], block[np.ix_(own, own)]))

    x_s = _times(shared, g_s)  # V g
    kvg_s = np.einsum("ijk,jk->ik", k_ss, x_s)  # K V g, with the terms of the radars below
    p_ss = _times(shared, k_ss)  # P = V K
    slope = _dot(g_s, x_s)
    trace = np.einsum("iik->k", p_ss)
    trace_of_square = _trace_of_product(p_ss, p_ss)
    cube = trace_of_cube(p_ss)
    curvature, kvg_variance = np.zeros_like(slope), np.zeros_like(slope)  # gᵀVKVg, gᵀVKVKVg
    p_si_p_is = np.zeros_like(k_ss)  # the sum over radars
    along = np.zeros_like(z.gradient)
    for places, v_i, k_si, k_ii in parts:
        g_i = z.gradient[places]
        x_i = _times(v_i, g_i)
        along[places] = x_i
        kvg_i = np.einsum("jik,jk->ik", k_si, x_s) + np.einsum("ijk,jk->ik", k_ii, x_i)
        kvg_s += np.einsum("ijk,jk->ik", k_si, x_i)
        slope += _dot(g_i, x_i)
        curvature += _dot(x_i, kvg_i)
        kvg_variance += _dot(kvg_i, _times(v_i, kvg_i))
        p_si, p_is = _times(shared, k_si), _times(v_i, k_si.swapaxes(0, 1))
        p_ii = _times(v_i, k_ii)
        back = np.einsum("ijk,jlk->ilk", p_si, p_is)
        p_si_p_is += back
        trace += np.einsum("iik->k", p_ii)
        trace_of_square += 2.0 * np.einsum("iik->k", back) + _trace_of_product(p_ii, p_ii)
        cube += 3.0 * _trace_of_product(np.einsum("ijk,jlk->ilk", p_is, p_si), p_ii)
        cube += trace_of_cube(p_ii)
    curvature += _dot(x_s, kvg_s)
    kvg_variance += _dot(kvg_s, _times(shared, kvg_s))
    cube += 3.0 * _trace_of_product(p_ss, p_si_p_is)
    along[:_RADAR] = x_s[3:6]
    if shared_error:
        along[_RADAR + error] = x_s[6]
    for places in z.places:
        along[places[3:6]] -= x_s[:3]

    # b g gᵀ is added to the second derivatives.
    b = 0.0 if z.square is None else z.square
    numbers = Invariants(
        z.value,
        slope,
        curvature + b * slope**2,
        trace + b * slope,
        trace_of_square + 2.0 * b * curvature + (b * slope) ** 2,
        cube + 3.0 * b * (kvg_variance + b * slope * curvature) + (b * slope) ** 3,
    )
    return _not_negative(numbers), along


def trace_of_cube(matrices: FloatArray) -> FloatArray:
    """Return tr A³ (k,) of matrices (n, n, k)."""
    if len(matrices) > MANY:
        each = np.ascontiguousarray(np.moveaxis(matrices, 2, 0))
        return np.asarray(np.einsum("kij,kji->k", each @ each, each))
    trace = np.zeros(matrices.shape[2])
    for i in range(len(matrices)):
        # tr A³ without its first row and column is less by a³ + 3 a r·c + 3 r·A'c
        first, row, column = matrices[i, i], matrices[i, i + 1 :], matrices[i + 1 :, i]
        rest = matrices[i + 1 :, i + 1 :]
        trace += first * (first * first + 3.0 * np.einsum("jk,jk->k", row, column))
        trace += 3.0 * np.einsum("jk,jlk,lk->k", row, rest, column)
    return trace


def _not_negative(numbers: Invariants) -> Invariants:
    """Return the numbers with gᵀg and tr H² without rounding below 0."""
    return numbers._replace(
        slope=np.maximum(numbers.slope, 0.0),
        trace_of_square=np.maximum(numbers.trace_of_square, 0.0),
    )


def _times(covariance: FloatArray, array: FloatArray) -> FloatArray:
    """Return C A (n, ..., k) of C (k, n, n) or (1, n, n) and A (n, ..., k)."""
    if len(covariance) == 1:
        (one,) = covariance
        product: FloatArray = (one @ array.reshape(len(one), -1)).reshape(array.shape)
    elif array.ndim == 2:
        product = np.einsum("kij,jk->ik", covariance, array)
    else:
        each = np.ascontiguousarray(np.moveaxis(array, 2, 0))
        product = np.moveaxis(covariance @ each, 0, 2)
    return product


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return aᵀb (k,) of vectors (n, k)."""
    return np.asarray(np.einsum("ik,ik->k", a, b))


def _trace_of_product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return tr AB (k,) of matrices (n, n, k)."""
    return np.asarray(np.einsum("ijk,jik->k", a, b))
