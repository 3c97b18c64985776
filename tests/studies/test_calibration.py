"""The small version of the calibration: `make study` runs all of it."""

import numpy as np
import pytest
from scipy.special import ndtr
from studies import calibration
from studies.bands import package
from studies.bands.judging import OFF
from studies.bands.model import Oracle
from studies.bands.populations import problem

UNIFORM = np.full(calibration.BINS, 1 / calibration.BINS)


def test_shares_of_a_right_distribution_with_an_atom_are_uniform():
    """Without one, and where half the values are 0, as are the quantiles up to the median."""
    normals = np.random.default_rng(1).standard_normal(400_000)
    for least in (-np.inf, 0):
        values, quantiles = (np.maximum(of, least) for of in (normals, calibration.EDGES))
        found = calibration.shares(values, quantiles, ndtr(calibration.EDGES))
        np.testing.assert_allclose(found, UNIFORM, atol=0.002)


def test_a_wrong_atom_shows():
    values = np.zeros(1000)
    quantiles = np.linspace(-0.5, 0.3, calibration.BINS - 1)  # says that 0 is the sixth of nine
    quantiles[5] = 0.0
    found = calibration.shares(values, quantiles, ndtr(calibration.EDGES))
    assert found[5] + found[6] == pytest.approx(1.0)


def test_a_band_that_is_too_narrow_shows():
    values = np.random.default_rng(1).standard_normal(100_000)
    found = calibration.shares(values, 0.8 * calibration.BOUNDS, ndtr(calibration.BOUNDS))
    inside = calibration.covered(found[np.newaxis])[0]
    np.testing.assert_allclose(inside, 1 - 2 * ndtr(-0.8 * np.array(calibration.KS)), atol=0.005)


@pytest.mark.parametrize(("population", "k"), [("short range", 1.0), ("limits", 2.0)])
def test_the_band_of_automatic_covers_what_it_says(population, k):
    """Where each bound is moved by what it may be off, it covers more than it says, or less.

    `tests/propagation/test_draws.py` has k = 3.
    """
    case = problem(population, 7, 1)
    oracle = Oracle(case)
    values = oracle.p_d(*oracle.draw(np.random.default_rng(1), 20_000))
    band = package.band(package.scenario(case), "automatic", k)
    said = 1 - 2 * ndtr(-k)
    wide = (values >= band.lower - OFF) & (values <= band.upper + OFF)
    slim = (values > band.lower + OFF) & (values < band.upper - OFF)
    error = 4 * np.sqrt(said * (1 - said) / len(values))
    assert slim.mean() - error < said < wide.mean() + error
