"""Monte Carlo against integrals, against brute force, and against itself.

A statistic of n draws is compared in units of its own standard error. Four of those are exceeded by
chance once in 16 000 comparisons; where many are compared the bound is that of the largest of many.
"""

import dataclasses
import tracemalloc

import chain_rule
import numpy as np
import pytest
from scenarios import scenario
from scipy.integrate import quad
from scipy.special import ndtr
from scipy.stats import binom

from radar_sense.model import detection_model as model
from radar_sense.model.detectors import North
from radar_sense.model.network import NetworkModel, Station
from radar_sense.montecarlo import montecarlo
from radar_sense.montecarlo.montecarlo import MAX_HAIRS, TAIL, monte_carlo
from radar_sense.montecarlo.sequences import SAMPLERS
from radar_sense.reading.parse import load_scenario

NOTHING = {"position_m": 0, "attitude_deg": 0}
FEW = {"start": 0, "stop": 180, "step": 15}


def p_d(scenario, aircraft, radar):
    """P_D by the paper's own chain, which shares no code with the package."""
    rcs = ("ellipsoid", 0.15, 0.13, 0.21)
    return chain_rule.linearize(aircraft, radar, rcs, scenario.model.p_fa)[0]


def only_radar_constant(std=5.0, **changes):
    level = {"only": {"position_m": 0, "constant": std}}
    return scenario(
        uncertainty={"aircraft": NOTHING, "radar": level}, analysis={"level": "only"}, **changes
    )


def only_yaw(**changes):
    certain = {"only": {"position_m": 0, "constant": 0}}
    aircraft = {"position_m": 0, "attitude_deg": [0, 0, 1]}
    return scenario(
        uncertainty={"aircraft": aircraft, "radar": certain}, analysis={"level": "only"}, **changes
    )


def moments_by_integral(function):
    """Mean, standard deviation and fourth central moment of a function of one unit normal."""

    def expect(g):
        return quad(lambda u: g(u) * np.exp(-u * u / 2) / np.sqrt(2 * np.pi), -9, 9, epsabs=1e-13)[
            0
        ]

    mean = expect(function)
    second, fourth = (expect(lambda u, n=n: (function(u) - mean) ** n) for n in (2, 4))
    return mean, np.sqrt(second), fourth


def errors_of_moments(std, fourth, runs):
    """Standard errors of a sample mean and of a sample standard deviation."""
    return std / np.sqrt(runs), np.sqrt((fourth - std**4) / runs) / (2 * std)


def test_radar_constant_alone_against_the_integral():
    runs = 20000
    s = only_radar_constant(geometry__azimuth_deg=FEW)
    mc = monte_carlo(s, runs=runs, seed=3)
    for i, aircraft in enumerate(s.aircraft):

        def value(u, aircraft=aircraft):
            radar = np.array([[0, 0, 0, 167.0 + 5 * u]])
            return p_d(s, aircraft[np.newaxis], radar)[0]

        mean, std, fourth = moments_by_integral(value)
        error_mean, error_std = errors_of_moments(std, fourth, runs)
        assert abs(mc.mean[i] - mean) < 4 * error_mean
        assert abs(mc.std[i] - std) < 4 * error_std
        # P_D grows with c_r, so its quantiles are P_D at the quantiles of c_r, and the rank of a
        # sample quantile is binomial.
        reach = binom.ppf([1e-5, 1 - 1e-5], runs, TAIL) / runs
        low, high = np.sort([value(u) for u in _normal_quantile(reach)])
        assert low <= mc.lower[i] <= high
        low, high = np.sort([value(-u) for u in _normal_quantile(reach)])
        assert low <= mc.upper[i] <= high


def _normal_quantile(probability):
    from scipy.special import ndtri

    return ndtri(probability)


def test_yaw_alone_against_the_integral():
    runs = 2000
    s = only_yaw(geometry__azimuth_deg={"start": 0, "stop": 180, "step": 3})
    mc = monte_carlo(s, runs=runs, seed=4)
    z_mean, z_std = [], []
    for i, nominal in enumerate(s.aircraft):

        def value(u, nominal=nominal):
            aircraft = nominal + np.array([0, 0, 0, 0, 0, np.radians(u)])
            return p_d(s, aircraft[np.newaxis], s.radar[np.newaxis])[0]

        mean, std, fourth = moments_by_integral(value)
        error_mean, error_std = errors_of_moments(std, fourth, runs)
        z_mean.append((mc.mean[i] - mean) / error_mean)
        z_std.append((mc.std[i] - std) / error_std)
    # The aircraft is drawn at every pose, so these are independent: their squares sum to a χ².
    assert np.sum(np.square(z_mean)) == pytest.approx(len(z_mean), abs=4 * np.sqrt(2 * len(z_mean)))
    assert np.max(np.abs(z_mean)) < 4.5
    assert np.max(np.abs(z_std)) < 4.5


@pytest.mark.parametrize("level", ["low", "medium", "high"])
def test_everything_together_against_brute_force(level):
    s = scenario(geometry__azimuth_deg=FEW)
    runs, brute = 20000, 60000
    mc = monte_carlo(s, runs=runs, seed=5, level=level)
    rng = np.random.Generator(np.random.Philox(6))
    stds = {"low": (10, 1), "medium": (100, 5), "high": (1000, 10)}
    position, constant = stds[level]
    for i, nominal in enumerate(s.aircraft):
        angles = np.radians(1)
        aircraft = nominal + rng.normal(size=(brute, 6)) * [10, 10, 10, angles, angles, angles]
        radar = s.radar + rng.normal(size=(brute, 4)) * [position, position, position, constant]
        draws = p_d(s, aircraft, radar)
        std, fourth = draws.std(ddof=1), np.mean((draws - draws.mean()) ** 4)
        error_mean, error_std = errors_of_moments(std, fourth, 1 / (1 / runs + 1 / brute))
        assert abs(mc.mean[i] - draws.mean()) < 4.5 * error_mean
        assert abs(mc.std[i] - std) < 4.5 * error_std


def test_radar_is_drawn_once_per_run():
    mc = monte_carlo(only_radar_constant(), runs=200)
    errors = mc.hairs - mc.band.p_d
    # One draw moves all poses of a run: the same side, and the same rank among the runs.
    assert np.all(np.sign(errors) == np.sign(errors[:, :1]))
    assert np.all(np.argsort(errors, axis=0) == np.argsort(errors[:, 0])[:, np.newaxis])


def test_aircraft_is_drawn_at_every_pose():
    mc = monte_carlo(only_yaw(), runs=500)
    errors = (mc.hairs - mc.mean)[:, 60:120]
    correlation = np.corrcoef(errors, rowvar=False)[np.triu_indices(60, 1)]
    assert np.max(abs(correlation)) < 5 / np.sqrt(500)


def test_draws_have_the_covariance_asked_for():
    root = np.random.default_rng(9).standard_normal((6, 3)) * [[10], [20], [5], [0.1], [0.2], [0.3]]
    white = np.random.default_rng(10).standard_normal((100_000, 6))
    from radar_sense.covariance import draws, factor

    covariance = root @ root.T
    drawn = draws(np.zeros(6), factor(covariance), white)
    scale = np.sqrt(np.outer(np.diagonal(covariance), np.diagonal(covariance)))
    assert np.max(abs(np.cov(drawn, rowvar=False) - covariance) / scale) < 5 * np.sqrt(2 / 100_000)


@pytest.mark.parametrize(
    ("level", "coverage"), [("medium", 0.989), ("high", 0.972)]
)  # as measured in PAPER_NOTES
def test_the_linearized_band_is_not_consistent_at_90_degrees(level, coverage):
    s = scenario(geometry__azimuth_deg={"start": 90, "stop": 90, "step": 1})
    mc = monte_carlo(s, runs=50000, seed=7, level=level)
    low, high = mc.coverage_interval(0.9999)
    assert low[0] - 0.0005 < coverage < high[0] + 0.0005  # it was published to three digits
    assert high[0] < 1 - 2 * TAIL - 0.005
    assert low[0] < mc.coverage[0] < high[0]


def test_constants_drawn_below_zero_become_zero_and_are_counted():
    s = only_radar_constant(std=167.0 / 2, geometry__azimuth_deg=FEW)
    runs = 2000
    mc = monte_carlo(s, runs=runs)
    share = ndtr(-2.0)
    assert mc.clipped == pytest.approx(runs * share, abs=4 * np.sqrt(runs * share))
    noise_alone = North().p_d(np.zeros(1), s.model.p_fa)[0]
    for values in (mc.mean, mc.std, mc.lower, mc.upper, mc.hairs):
        assert np.all(np.isfinite(values))
    assert mc.lower == pytest.approx(noise_alone, rel=1e-12)
    assert mc.hairs.min() == pytest.approx(noise_alone, rel=1e-12)


def assert_same(one, other):
    for name in ("mean", "std", "lower", "upper", "inside", "hairs"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
    assert one.clipped == other.clipped


@pytest.mark.parametrize("workers", [2, 3, 8])
def test_workers_do_not_change_a_bit(workers):
    s = load_scenario()
    assert_same(monte_carlo(s, runs=333), monte_carlo(s, runs=333, workers=workers))


@pytest.mark.parametrize("chunk", [1, 1000, 10**6])
def test_chunks_do_not_change_a_bit(monkeypatch, chunk):
    s = load_scenario("configs/covariance.yaml")
    before = monte_carlo(s, runs=100)
    monkeypatch.setattr(model, "BLOCK", chunk)
    assert_same(before, monte_carlo(s, runs=100))


def test_seed_makes_the_draws_and_zero_is_a_seed():
    s = load_scenario()
    zero, again, one = (monte_carlo(s, runs=2, seed=seed) for seed in (0, 0, 1))
    assert_same(zero, again)
    assert not np.array_equal(zero.hairs, one.hairs)
    assert_same(monte_carlo(s, runs=2), one)  # the scenario's seed is 1
    huge = monte_carlo(s, runs=2, seed=10**50)
    assert not np.array_equal(huge.hairs, zero.hairs)


def test_more_runs_begin_with_the_same_runs():
    s = load_scenario()
    few, more = monte_carlo(s, runs=40), monte_carlo(s, runs=100)
    np.testing.assert_array_equal(more.hairs[:40], few.hairs)


def test_hairs_are_a_subset_of_many_runs():
    s = scenario(geometry__azimuth_deg=FEW)
    mc = monte_carlo(s, runs=MAX_HAIRS + 50)
    assert mc.hairs.shape == (MAX_HAIRS, len(s.aircraft))
    few = monte_carlo(s, runs=64)
    np.testing.assert_allclose(few.mean, few.hairs.mean(axis=0), rtol=1e-13)
    np.testing.assert_allclose(few.std, few.hairs.std(axis=0, ddof=1), rtol=1e-11)
    inside = abs(few.hairs - few.band.p_d) <= 3 * few.band.std
    np.testing.assert_array_equal(few.inside, inside.sum(axis=0))


@pytest.mark.parametrize("workers", [1, 3])
@pytest.mark.parametrize(("runs", "together"), [(8 * 150 + 3, 2), (8 * 301 + 3, 4)])
def test_tasks_of_several_blocks_are_all_their_draws(monkeypatch, workers, runs, together):
    """The last block is not full, nor is the last task; and constants are set to zero."""
    monkeypatch.setattr(montecarlo, "SAMPLES_PER_BLOCK", 8 * 13)
    s = only_radar_constant(std=100.0, geometry__azimuth_deg=FEW)
    came_in = []
    mc = monte_carlo(s, runs=runs, seed=5, workers=workers, progress=came_in.append)
    assert came_in[:-1] == [8 * together] * (len(came_in) - 1)
    assert sum(came_in) == runs
    sampler = montecarlo.Sampler.of(s)
    source = SAMPLERS["random"](5, 8, 13, sampler.radar_normals)
    draws, clipped = [], []
    for block in range(-(-runs // 8)):
        white_radar, white_aircraft = source.block(block)
        radar, negative = sampler.draw_radar(white_radar)
        draws.append(sampler.draw_p_d(white_aircraft, radar))
        clipped.append(negative)
    draws, clipped = np.concatenate(draws)[:runs], np.concatenate(clipped)[:runs]
    np.testing.assert_array_equal(mc.hairs, draws[:MAX_HAIRS])
    assert mc.clipped == np.count_nonzero(clipped) > 10
    np.testing.assert_allclose(mc.mean, draws.mean(axis=0), rtol=1e-13)
    np.testing.assert_allclose(mc.std, draws.std(axis=0, ddof=1), rtol=1e-12)
    inside = (draws >= mc.band.lower) & (draws <= mc.band.upper)
    np.testing.assert_array_equal(mc.inside, inside.sum(axis=0))
    np.testing.assert_allclose(mc.lower, np.quantile(draws, TAIL, axis=0), rtol=1e-13)


def test_a_task_of_many_radars_is_a_block():
    """It takes long enough, and who stops it should not have to wait."""
    s = scenario()
    sampler = montecarlo.Sampler.of(s)
    for radars, together in ((1, 4), (2, 2), (3, 1), (16, 1)):
        several = NetworkModel(tuple(Station(s.model, f"r{i}") for i in range(radars)))
        blocks = montecarlo._Blocks(
            dataclasses.replace(sampler, model=several), None, None, 10**6, 256, 0
        )
        assert blocks.together == together


def test_no_uncertainty_gives_the_nominal_value_every_time():
    s = only_radar_constant(std=0.0, geometry__azimuth_deg=FEW)
    mc = monte_carlo(s, runs=50)
    np.testing.assert_allclose(mc.mean, mc.band.p_d, rtol=1e-14)
    assert np.max(mc.std) < 1e-15
    np.testing.assert_array_equal(mc.coverage, 1.0)


def test_progress_adds_up_to_the_runs():
    seen = []
    monte_carlo(load_scenario(), runs=100, workers=2, progress=seen.append)
    assert sum(seen) == 100


@pytest.mark.parametrize("sampler", ["random", "sobol"])
def test_memory_does_not_grow_with_the_runs(sampler):
    s = scenario(geometry__azimuth_deg=FEW)
    monte_carlo(s, runs=2, sampler=sampler)  # imports what it needs

    def peak(runs):
        tracemalloc.start()
        monte_carlo(s, runs=runs, sampler=sampler)
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found

    assert peak(400_000) < 1.2 * peak(40_000)


def test_quantiles_beyond_what_is_kept_say_how_far_off_they_may_be():
    s = only_radar_constant(geometry__azimuth_deg={"start": 45, "stop": 45, "step": 1})
    runs = 2_000_000
    mc = monte_carlo(s, runs=runs, seed=2)
    assert 0 < mc.rank_error < 0.01 * TAIL * runs
    # P_D at the quantile of c_r that the rank it may have allows, and what chance adds
    for side, bound in ((-1, mc.lower[0]), (1, mc.upper[0])):
        reach = 5 * np.sqrt(TAIL * runs) + mc.rank_error
        ranks = (TAIL * runs + np.array([-1, 1]) * reach) / runs
        radar = np.zeros((2, 4))
        radar[:, 3] = 167.0 - side * 5 * _normal_quantile(ranks)
        low, high = np.sort(p_d(s, np.repeat(s.aircraft, 2, axis=0), radar))
        assert low <= bound <= high
    assert monte_carlo(s, runs=100_000).rank_error == 0
