"""Sobol' indices: values known in closed form, standard errors, blocks of outputs, and memory."""

import re
import tracemalloc

import numpy as np
import pytest

from radar_sense.errors import InputError
from radar_sense.montecarlo import sobol
from radar_sense.montecarlo.sobol import sobol_indices

GROUPS = [[0], [1, 2], [3]]


def several_outputs(u, outputs=slice(None)):
    """Four functions of four unit normals whose variance is known term by term."""
    a, b, c, d = u.T
    return np.stack(
        [1 + 2 * a + 3 * b + 1.5 * a * b + c**2, a * b * c * d, np.full_like(a, 5.0), a + b * c][
            outputs
        ]
    )


# Groups {a}, {b, c}, {d}: first-order and total shares of the variance.
FIRST = [[4 / 17.25, 0, np.nan, 1 / 2], [11 / 17.25, 0, np.nan, 1 / 2], [0, 0, np.nan, 0]]
TOTAL = [[6.25 / 17.25, 1, np.nan, 1 / 2], [13.25 / 17.25, 1, np.nan, 1 / 2], [0, 1, np.nan, 0]]


@pytest.mark.parametrize("samples", [2**12, 2**16])
def test_indices_known_in_closed_form(samples):
    found = sobol_indices(several_outputs, GROUPS, outputs=4, samples=samples, seed=1)
    kept = [0, 1, 3]  # of an output without variance there are none
    largest = 10 / np.sqrt(samples)
    # standard errors from 8 replicates: 6 of them are 1 in 2000
    errors = found.first_error[:, kept]
    assert np.all(errors < largest)
    for values, exact, bound in (
        (found.first, FIRST, 6 * errors + 1e-12),
        (found.total, TOTAL, largest),
    ):
        assert np.isnan(values[:, 2]).all()
        assert np.all(abs(values - exact)[:, kept] <= bound)
    np.testing.assert_allclose(found.mean, [2, 0, 5, 0], atol=5 / np.sqrt(samples))
    np.testing.assert_allclose(found.variance, [17.25, 1, 0, 2], rtol=10 / np.sqrt(samples))


def test_small_and_large_indices_are_known_well():
    """The first input has nearly all the variance, the second a millionth of it, and the third
    nothing but an interaction with the first.
    """
    f = lambda u, _: (u[:, 0] + 1e-3 * u[:, 1] + 0.1 * u[:, 0] * u[:, 2])[np.newaxis]  # noqa: E731
    found = sobol_indices(f, [[0], [1], [2]], outputs=1, samples=1024, seed=1)
    variance = 1 + 1e-6 + 0.01
    first, total, error = found.first[:, 0], found.total[:, 0], found.first_error[:, 0]
    np.testing.assert_allclose(first[1], 1e-6 / variance, rtol=0.1)
    np.testing.assert_allclose(total[1:], np.array([1e-6, 0.01]) / variance, rtol=0.1)
    np.testing.assert_allclose(first[0], 1 / variance, rtol=2e-3)
    np.testing.assert_allclose(total[0], 1.01 / variance, rtol=1e-3)
    assert np.all(abs(first) <= total)
    assert error[1] < 1e-7
    assert error[0] < 1e-3


def test_standard_errors_are_the_spread_over_seeds():
    indices = [
        sobol_indices(several_outputs, GROUPS, outputs=4, samples=256, seed=seed)
        for seed in (0, *range(60))
    ]
    again = indices.pop(0)
    np.testing.assert_array_equal(again.first, indices[0].first)
    assert not np.array_equal(again.first, indices[1].first)
    for output, group in ((0, 0), (0, 1), (3, 0)):
        for kind in ("first", "total", "variance"):
            place = output if kind == "variance" else (group, output)
            found = [getattr(i, kind)[place] for i in indices]
            errors = [getattr(i, f"{kind}_error")[place] for i in indices]
            # 59 and 60 · 7 degrees of freedom: the ratio is known to 9.8 %
            mean_error = np.sqrt(np.mean(np.square(errors)))
            assert mean_error == pytest.approx(np.std(found, ddof=1), rel=4 * 0.098)


def test_few_samples_have_hardly_a_bias_and_true_errors():
    """exp(0.8 a) (1 + 0.3 b), of which the moments of both factors are known; 32 samples."""

    def product(u, _):
        return (np.exp(0.8 * u[:, 0]) * (1 + 0.3 * u[:, 1]))[np.newaxis]

    each = {"outputs": 1, "samples": 32}
    indices = [sobol_indices(product, [[0], [1]], **each, seed=seed) for seed in range(150)]
    square, spread = np.exp(0.64), np.exp(0.64) * (np.exp(0.64) - 1)
    variance = (spread + square) * 1.09 - square
    total = np.array([1.09 * spread, 0.09 * (spread + square)]) / variance
    found = np.mean([one.total[:, 0] for one in indices], axis=0)
    np.testing.assert_allclose(found, total, atol=0.05)  # means of ratios would be off by 0.15
    assert np.mean([one.variance for one in indices]) == pytest.approx(variance, rel=0.1)
    for kind in ("first", "total"):  # to first order the errors would be 0.80 to 0.92 of the spread
        spread = np.std([getattr(one, kind) for one in indices], axis=0, ddof=1)
        errors = np.mean([getattr(one, f"{kind}_error") ** 2 for one in indices], axis=0) ** 0.5
        assert np.all((0.95 * spread < errors) & (errors < 1.3 * spread))


def test_replicates_without_variance_add_nothing():
    """A function that is 0 but in one of a hundred samples, as P_D beyond a limit is."""
    rare = lambda u, _: (u[:, 0] > 2.3).astype(float)[np.newaxis]  # noqa: E731
    found = sobol_indices(rare, [[0], [1]], outputs=1, samples=64, seed=0)
    assert np.isfinite(found.first_error).all()
    assert np.all(abs(found.total - [[1], [0]]) <= 3 * found.total_error + 1e-12)


@pytest.mark.parametrize("values", [1, 1000, 10**7])
def test_blocks_of_outputs_do_not_change_a_bit(monkeypatch, values):
    """Nine outputs in blocks of two: SciPy rounds a single last output differently."""

    def nine(u, outputs):
        return np.stack([np.sin((i + 1) * u[:, 0]) + 0.1 * u[:, 1] ** 3 for i in range(9)])[outputs]

    sizes = []

    def counted(u, outputs):
        sizes.append(outputs.stop - outputs.start)
        return nine(u, outputs)

    expected = sobol_indices(nine, [[0], [1]], outputs=9, samples=2**11, seed=3)
    monkeypatch.setattr(sobol, "MAX_NUMBERS", values)
    indices = sobol_indices(counted, [[0], [1]], outputs=9, samples=2**11, seed=3)
    assert sum(sizes) == 9 * 8 * (2 * 2 + 2)
    assert (min(sizes), max(sizes)) == ((1, 1) if values < 10**7 else (9, 9))
    for field in vars(expected):
        assert getattr(indices, field).tobytes() == getattr(expected, field).tobytes()
    one = sobol_indices(lambda u, _: u.T[:1] + 0.0, [[0], [1]], outputs=1, samples=64, seed=1)
    np.testing.assert_allclose(one.total, [[1], [0]], atol=0.1)


def test_memory_does_not_grow_with_the_outputs(monkeypatch):
    monkeypatch.setattr(sobol, "MAX_NUMBERS", 200_000)

    def peak(outputs):
        tracemalloc.start()
        function = lambda u, part: np.outer(np.arange(part.start, part.stop) + 1.0, u[:, 0])  # noqa: E731
        sobol_indices(function, [[0], [1]], outputs=outputs, samples=2**14, seed=1)
        peak_bytes = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak_bytes

    peak(1)  # imports what it needs
    assert peak(120) < 1.2 * peak(40)


def test_samples_that_do_not_fit_are_refused_with_the_number_that_does():
    with pytest.raises(InputError, match=r"more than 4 GB; at most [\d,]+ runs fit$") as error:
        sobol_indices(several_outputs, GROUPS, outputs=4, samples=10**9, seed=1)
    fit = int(re.search(r"most ([\d,]+) runs", str(error.value))[1].replace(",", ""))
    row = 8 * (10 * 4 + 4 * 5)
    assert fit / 8 * row <= 4e9 < fit / 4 * row
