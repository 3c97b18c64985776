"""The sources of unit normals: Sobol' points are a scrambled digital net at every pose.

Scrambling reorders the cells of a grid. The counts in them are those of the plain sequence.
"""

from itertools import combinations

import numpy as np
import pytest
from helpers import scenario
from scipy.special import ndtr
from scipy.stats import chisquare, qmc

from radar_sense.montecarlo.montecarlo import monte_carlo
from radar_sense.montecarlo.sequences import SAMPLERS, Sobol

RUNS, POSES = 256, 5
FEW = {"start": 0, "stop": 180, "step": 15}


def bits(normals):
    """Return the 32 bits of the coordinates of normals."""
    return np.rint(ndtr(normals) * 2.0**32 - 0.5).astype(np.uint64)


def states(source, blocks=1):
    """Normals of both states (runs, poses, 10): four of the radar, six of the aircraft."""
    radar, aircraft = (np.concatenate(a) for a in zip(*map(source, range(blocks)), strict=True))
    return np.concatenate([np.repeat(radar[:, np.newaxis], POSES, axis=1), aircraft], axis=2)


def sobol(seed=1, runs=RUNS, blocks=1):
    source = Sobol(seed, runs, POSES)
    return states(source.block, blocks)


def cells(points, splits):
    """Return the number of points (m, d) in each cell, with 2^splits[i] parts in dimension i."""
    number = np.zeros(len(points), dtype=np.int64)
    for i, split in splits.items():
        number = number << split | (points[:, i].astype(np.int64) >> (32 - split))
    return np.bincount(number, minlength=2 ** sum(splits.values()))


def test_all_dimensions_together_are_the_sobol_net():
    plain = (qmc.Sobol(10, scramble=False, bits=32).random(1024) * 2.0**32).astype(np.uint64)
    points = bits(sobol(runs=1024))
    grids = [{i: a, j: 8 - a} for i, j in combinations(range(10), 2) for a in range(1, 8)]
    grids += [{i: 3, j: 3, k: 3} for i, j, k in combinations(range(10), 3)]
    grids += [{i: 10} for i in range(10)]
    grids.append(dict.fromkeys(range(10), 1))
    for grid in grids:
        expected = np.sort(cells(plain, grid))
        for pose in (0, POSES - 1):
            np.testing.assert_array_equal(np.sort(cells(points[:, pose], grid)), expected)
    # The first two dimensions are a (0, 2)-sequence: one point in each cell, whatever its shape.
    for a in range(11):
        assert np.all(cells(points[:, 0], {0: a, 1: 10 - a}) == 1)


def test_the_points_are_scrambled_and_not_only_shifted():
    one, other = bits(sobol(1)), bits(sobol(2))
    plain = (qmc.Sobol(10, scramble=False, bits=32).random(RUNS) * 2.0**32).astype(np.uint64)
    for i in range(10):
        for difference in (one[:, 0, i] ^ other[:, 0, i], one[:, 0, i] ^ plain[:, i]):
            assert len(np.unique(difference)) > RUNS / 8


def test_every_run_is_uniform_over_shifts():
    """Each run is uniformly distributed, and the mean of the draws is therefore unbiased."""
    poses = 4000
    _, aircraft = Sobol(3, 4, poses).block(0)
    for run in aircraft:
        for i in range(6):
            counts = np.histogram(ndtr(run[:, i]), bins=16, range=(0, 1))[0]
            assert chisquare(counts).pvalue > 1e-5
    radar = np.array([Sobol(seed, 4, 1).block(0)[0] for seed in range(300)])
    for run in range(4):
        counts = np.histogram(ndtr(radar[:, run]), bins=8, range=(0, 1))[0]
        assert chisquare(counts).pvalue > 1e-5


def test_blocks_are_parts_of_one_sequence():
    whole = sobol(runs=1024)
    for runs in (8, 256):
        np.testing.assert_array_equal(sobol(runs=runs, blocks=1024 // runs), whole)


@pytest.mark.parametrize("kind", SAMPLERS)
def test_seeds_blocks_and_poses_differ(kind):
    first = SAMPLERS[kind](0, RUNS, POSES).block(0)
    for other in (
        SAMPLERS[kind](1, RUNS, POSES).block(0),
        SAMPLERS[kind](10**50, RUNS, POSES).block(0),
        SAMPLERS[kind](0, RUNS, POSES).block(1),
    ):
        for one, another in zip(first, other, strict=True):
            assert not np.any(one == another)
    _, aircraft = first
    for one, another in combinations(range(POSES), 2):
        assert not np.any(aircraft[:, one] == aircraft[:, another])


def test_random_draws_of_poses_are_independent_and_those_of_sobol_points_are_not():
    """The warning in the docstring of `Sobol`."""
    correlations = {}
    for kind in SAMPLERS:
        _, aircraft = SAMPLERS[kind](1, 1024, 60).block(0)
        matrix = np.corrcoef(aircraft[:, :, 0], rowvar=False)
        correlations[kind] = matrix[np.triu_indices(60, 1)]
    assert np.max(abs(correlations["random"])) < 5 / np.sqrt(1024)
    assert np.sqrt(np.mean(correlations["sobol"] ** 2)) == pytest.approx(0.7, abs=0.1)
    assert abs(np.mean(correlations["sobol"])) < 0.1


def test_the_ends_of_the_unit_interval_are_finite_normals(monkeypatch):
    """Points of all zeros or all ones, which occur once in 2^32."""
    for value in (0.0, 1.0 - 2.0**-32):
        monkeypatch.setattr(qmc.Sobol, "random", lambda _, n, value=value: np.full((n, 10), value))
        radar, aircraft = Sobol(1, 4, 3).block(0)
        assert np.all(abs(radar) == pytest.approx(6.338, abs=1e-3))  # −Φ⁻¹(2^−33)
        assert np.all(np.sign(radar) == (1 if value else -1))
        assert np.all(np.isfinite(aircraft))


def test_the_binomial_interval_is_for_random_draws():
    """The variance of the share is binomial for random draws, and a fifth for Sobol' points."""
    s = scenario(geometry__azimuth_deg=FEW)
    runs, seeds = 2048, 20
    for kind, low, high in (("random", 0.6, 1.5), ("sobol", 0.1, 0.3)):
        shares = np.array(
            [monte_carlo(s, runs, seed, sampler=kind).coverage for seed in range(seeds)]
        )
        share = shares.mean(axis=0)
        ratio = np.mean(shares.var(axis=0, ddof=1)) / np.mean(share * (1 - share) / runs)
        assert low < ratio < high, (kind, ratio)
