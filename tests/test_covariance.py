"""Covariance matrices: checks, and square roots that reproduce the covariance."""

import numpy as np
import pytest

from radar_sense.covariance import block_square_root, draws, first_wrong, problem, square_root


def random_covariance(rng, size, rank):
    scale = 10.0 ** rng.uniform(-6, 3, size)  # metres beside radians
    mix = rng.standard_normal((size, rank))
    return np.outer(scale, scale) * (mix @ mix.T)


@pytest.mark.parametrize("size", [1, 4, 6])
def test_a_square_root_gives_the_covariance_back(size):
    rng = np.random.default_rng(size)
    for rank in range(1, size + 1):
        for _ in range(50):
            covariance = random_covariance(rng, size, rank)
            assert problem(covariance) is None
            sqrt_cov = square_root(covariance)
            scale = np.sqrt(np.outer(np.diagonal(covariance), np.diagonal(covariance)))
            assert np.max(abs(sqrt_cov @ sqrt_cov.T - covariance) / scale) < 1e-14 * size**2


def test_components_that_others_link_are_one_block():
    """The first is correlated with the third, and the third with the fifth alone."""
    covariance = np.diag([4.0, 1.0, 9.0, 16.0, 25.0, 1.0])
    for i, j, value in ((0, 2, 3.0), (2, 4, 7.0), (1, 5, -0.5)):
        covariance[i, j] = covariance[j, i] = value
    sqrt_cov = block_square_root(covariance)
    np.testing.assert_allclose(sqrt_cov @ sqrt_cov.T, covariance, atol=1e-13)
    blocks = [{0, 2, 4}, {1, 5}, {3}]
    for column in sqrt_cov.T:
        assert any({*np.flatnonzero(column).tolist()} <= block for block in blocks)


def test_a_component_without_variance_stays_certain():
    covariance = np.array([[4.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 9.0]])
    assert problem(covariance) is None
    sqrt_cov = square_root(covariance)
    np.testing.assert_allclose(sqrt_cov @ sqrt_cov.T, covariance, atol=1e-14)
    assert not sqrt_cov[1].any()


@pytest.mark.parametrize(
    ("matrix", "says"),
    [
        ([[1, 0], [0, -1]], "negative variance"),
        ([[1, 0.5], [0.4, 1]], "not symmetric: entry [1][2] is 0.5, [2][1] is 0.4"),
        ([[1, 1.01], [1.01, 1]], "not positive semidefinite"),
        ([[1, 0.1], [0.1, 0]], "without variance"),
        ([[0, 1e-12], [1e-12, 1]], "without variance"),
        ([[1, 1e-6], [1e-6, 0]], "without variance"),
        # small numbers are no excuse: a correlation of 1.0001 between deviations of a micrometre
        ([[1e-12, 1.0001e-12], [1.0001e-12, 1e-12]], "not positive semidefinite"),
        # each pair is possible, the three together are not
        ([[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]], "not positive semidefinite"),
        # a tiny variance beside a large one must not hide the fault
        ([[1e12, 2.0], [2.0, 1e-12]], "not positive semidefinite"),
    ],
)
def test_matrices_that_are_no_covariances(matrix, says):
    matrix = np.array(matrix, dtype=float)
    assert says in problem(matrix)
    assert first_wrong(np.stack([np.eye(len(matrix)), matrix])) == (1, problem(matrix))


@pytest.mark.parametrize("per_pose", [False, True])
@pytest.mark.parametrize("coupled", [False, True])
def test_draws_are_the_square_root_times_the_normals(coupled, per_pose):
    rng = np.random.default_rng(3)
    sqrt_cov = rng.standard_normal((5, 6, 6) if per_pose else (6, 6)) * (
        1 if coupled else np.eye(6)
    )
    mean, normals = rng.standard_normal((5, 6)), rng.standard_normal((7, 5, 6))
    expected = mean + (sqrt_cov @ normals[..., np.newaxis])[..., 0]
    before = normals.copy()
    np.testing.assert_allclose(draws(mean, sqrt_cov, normals), expected, rtol=1e-13, atol=1e-13)
    np.testing.assert_array_equal(normals, before)


def test_rounding_is_forgiven():
    covariance = random_covariance(np.random.default_rng(7), 6, 2)
    assert problem(covariance * (1 + 1e-13 * np.random.default_rng(8).uniform(size=(6, 6)))) is None
