"""Covariance matrices: construction, checks, blocks, projections, square roots and draws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_sense.errors import InputError
from radar_sense.states import FloatArray, at_pose, components_first, real_array, slices

#: Largest deviation of a correlation matrix from symmetric and semidefinite by rounding.
TOLERANCE = 1e-9
#: Components from which a matrix product takes less time than a sum written out.
MANY = 32


def problem(covariance: FloatArray) -> str | None:
    """Return why a matrix (n, n) is not a covariance, or None if the matrix is a covariance."""
    finite = np.isfinite(covariance)
    if not finite.all():
        i, j = np.argwhere(~finite)[0].tolist()
        return f"must be finite, got {covariance[i, j]:g} for entry [{i + 1}][{j + 1}]"
    variances = np.diagonal(covariance)
    if np.any(variances < 0):
        return f"has a negative variance on its diagonal, {variances.min():g}"
    correlation = _correlation(covariance)
    if not np.allclose(correlation, correlation.T, rtol=0, atol=TOLERANCE):
        i, j = np.unravel_index(np.argmax(abs(correlation - correlation.T)), correlation.shape)
        return (
            f"is not symmetric: entry [{i + 1}][{j + 1}] is {covariance[i, j]:g}, "
            f"[{j + 1}][{i + 1}] is {covariance[j, i]:g}"
        )
    if np.any(covariance[variances == 0]):
        return "is not positive semidefinite: a component without variance has a covariance"
    lowest = np.linalg.eigvalsh(correlation).min()
    if lowest < -TOLERANCE:
        return (
            f"is not positive semidefinite: its correlation matrix has the eigenvalue {lowest:.3g}"
        )
    return None


def first_wrong(matrices: FloatArray) -> tuple[int, str] | None:
    """Return the first matrix (k, n, n) that is not a covariance, and the problem."""
    for block in slices(len(matrices)):
        if _are_covariances(matrices[block]):
            continue
        for index, matrix in enumerate(matrices[block], start=block.start):
            if text := problem(matrix):
                return index, text
    return None


def _are_covariances(matrices: FloatArray) -> bool:
    """Return whether no matrix (k, n, n) has a `problem`, much faster; False if not sure."""
    certain = np.diagonal(matrices, axis1=-2, axis2=-1) == 0
    if not np.isfinite(matrices).all() or matrices[certain].any():
        return False
    correlation = _correlation(matrices)
    asymmetry = abs(correlation - np.swapaxes(correlation, -1, -2))
    try:
        np.linalg.cholesky(correlation + TOLERANCE * np.eye(matrices.shape[-1]))
    except np.linalg.LinAlgError:
        return False
    return bool(np.all(asymmetry <= TOLERANCE))


def checked(whose: str, covariance: ArrayLike, n: int) -> FloatArray:
    """Return covariances (..., n, n) of "aircraft" or "radar" as an array, checked.

    The error names the first that is none.
    """
    matrices = real_array(f"{whose} covariance", covariance)
    if matrices.shape[-2:] != (n, n):
        raise InputError(
            f"{whose} covariance must have shape (..., {n}, {n}), got {matrices.shape}"
        )
    if wrong := first_wrong(matrices.reshape(-1, n, n)):
        place = at_pose([int(i) for i in np.unravel_index(wrong[0], matrices.shape[:-2])])
        raise InputError(f"{whose} covariance{place} {wrong[1]}")
    return matrices


def block_diagonal(covariances: Sequence[FloatArray]) -> FloatArray:
    """Return the covariance (n, n) of independent states from the covariance of each.

    `scipy.linalg` has this too, and is slow to import.
    """
    ends = np.cumsum([len(matrix) for matrix in covariances])
    total = np.zeros((ends[-1], ends[-1]))
    for matrix, end in zip(covariances, ends, strict=True):
        own = slice(end - len(matrix), end)
        total[own, own] = matrix
    return total


def without_components(covariance: FloatArray, components: NDArray[np.intp]) -> FloatArray:
    """Return a copy of the covariance (..., n, n) with some components certain."""
    covariance = covariance.copy()
    covariance[..., components, :] = 0.0
    covariance[..., components] = 0.0
    return covariance


def variance_along(jacobian: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the variance A C Aᵀ (...) of a linear function of the state, eq. (35) of the paper.

    The function has the partials A (..., n), and the state the covariance C (..., n, n).
    """
    if covariance.shape[:-2] == (1,) and jacobian.ndim > 1:
        covariance = covariance[0]  # the same at all poses
    # An undefined partial of a certain component must not make the variance NaN.
    uncertain = covariance.any(axis=-1)
    if not uncertain.all():
        jacobian = np.where(uncertain, jacobian, 0.0)
    variances = np.diagonal(covariance, axis1=-2, axis2=-1)
    if covariance.ndim == 2 and np.count_nonzero(covariance) == np.count_nonzero(variances):
        variance = np.einsum("...i,i,...i->...", jacobian, variances, jacobian)  # C is diagonal
    elif covariance.ndim == 2 and len(covariance) > MANY:
        variance = np.sum((jacobian @ covariance) * jacobian, axis=-1)
    else:
        variance = np.einsum("...i,...ij,...j->...", jacobian, covariance, jacobian)
    # A C Aᵀ of a semidefinite C can round to just below zero.
    return np.maximum(variance, 0.0)


def largest_variance(covariance: FloatArray) -> FloatArray:
    """Return the largest variance (k,) in any direction of C (k, n, n)."""
    return np.asarray(np.linalg.eigvalsh(covariance)[:, -1])


def without_rounding(covariance: FloatArray) -> FloatArray:
    """Return C (..., n, n) with correlations below 1e-14 set to 0.

    A rotated covariance of equal variances is then diagonal again. Otherwise the square root, and
    with it the draws, would depend on rounding.
    """
    std = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    least = 1e-14 * std[..., :, np.newaxis] * std[..., np.newaxis, :]
    return np.where(abs(covariance) > least, covariance, 0.0)


def square_root(covariance: FloatArray) -> FloatArray:
    """Return F (..., n, n) with F Fᵀ = C; C may be singular.

    F is made from the eigenvectors of the correlation matrix, which have no units. For independent
    components, F is the diagonal matrix of standard deviations.
    """
    if covariance.ndim == 2:
        return _square_root(covariance)
    sqrt_cov = np.empty(covariance.shape)
    for block in slices(len(covariance)):  # temporaries of one block at a time
        sqrt_cov[block] = _square_root(covariance[block])
    return sqrt_cov


def _square_root(covariance: FloatArray) -> FloatArray:
    std = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    diagonal = std[..., np.newaxis] * np.eye(std.shape[-1])
    independent = np.all((covariance == 0) | np.eye(std.shape[-1], dtype=bool), axis=(-2, -1))
    if independent.all():
        return diagonal
    eigenvalues, eigenvectors = np.linalg.eigh(_correlation(covariance))
    coupled = std[..., np.newaxis] * eigenvectors
    rounding = 1e-14 * std.shape[-1]  # the root of which would be a deviation
    coupled *= np.sqrt(np.where(eigenvalues > rounding, eigenvalues, 0.0))[..., np.newaxis, :]
    return np.where(independent[..., np.newaxis, np.newaxis], diagonal, coupled)


def block_square_root(covariance: FloatArray) -> FloatArray:
    """Return F (n, n) with F Fᵀ = C, block by block of components that are independent of the rest.

    A column of F belongs to one block. Columns without variance are 0: the error that two
    components share, for example, has one column.
    """
    linked = np.where((covariance != 0) | np.eye(len(covariance), dtype=bool), 1.0, 0.0)
    while np.any((further := np.minimum(linked @ linked, 1.0)) > linked):
        linked = further
    first = linked.argmax(axis=1)  # the first component of the block of each
    sqrt_cov = np.diag(np.sqrt(np.diagonal(covariance)))
    for block in np.flatnonzero(np.bincount(first) > 1):
        places = np.ix_(first == block, first == block)
        sqrt_cov[places] = square_root(covariance[places])
    return sqrt_cov


def symmetric_square_root(covariance: FloatArray) -> FloatArray:
    """Return F (..., n, n) with F Fᵀ = C, continuous in C; C may be singular.

    F is D S, with D the standard deviations and S the symmetric square root of the correlation
    matrix. F does not depend on units. The eigenvectors of `square_root` can change sign and
    order between nearly equal matrices. Use this F for errors that are correlated from pose to
    pose.
    """
    std = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    eigenvalues, eigenvectors = np.linalg.eigh(_correlation(covariance))
    scaled_vectors = eigenvectors * np.sqrt(np.maximum(eigenvalues, 0.0))[..., np.newaxis, :]
    return std[..., np.newaxis] * (scaled_vectors @ np.swapaxes(eigenvectors, -1, -2))


def draws(mean: FloatArray, sqrt_cov: FloatArray, normals: FloatArray) -> FloatArray:
    """Return draws (..., n) with covariance F Fᵀ from independent unit normals (..., r).

    The sums are explicit, because the rounding of a matrix product depends on the BLAS library and
    on the number of draws. F is (n, r), or (k, n, r) for draws (..., k, n) at k poses.
    """
    n, r = sqrt_cov.shape[-2:]
    others = range(sqrt_cov.ndim - 2)
    present = np.any(sqrt_cov, axis=tuple(others))
    entries = sqrt_cov.transpose(-2, -1, *others)
    means, components = components_first(mean), components_first(normals)
    drawn = np.empty((n, *normals.shape[:-1]))
    for i, (out, used) in enumerate(zip(drawn, present.tolist(), strict=True)):
        columns = [j for j in range(r) if used[j]]
        if not columns:
            out[:] = means[i]
            continue
        np.multiply(components[columns[0]], entries[i, columns[0]], out=out)
        for j in columns[1:]:
            out += entries[i, j] * components[j]
        out += means[i]
    return drawn.transpose(*range(1, drawn.ndim), 0)


def _correlation(covariance: FloatArray) -> FloatArray:
    std = np.sqrt(abs(np.diagonal(covariance, axis1=-2, axis2=-1)))
    std = np.where(std > 0, std, 1.0)
    return covariance / (std[..., :, np.newaxis] * std[..., np.newaxis, :])
