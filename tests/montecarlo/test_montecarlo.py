"""Monte Carlo against integrals, against brute force, and against itself."""

import math
import pickle
import threading
import tracemalloc
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import chain_rule
import numpy as np
import pytest
from helpers import known_to, p_d_each, scenario, single
from scipy.special import ndtr, ndtri
from scipy.stats import binom

import radar_sense as rs
from radar_sense.errors import ComputationError
from radar_sense.model import detection_model as model
from radar_sense.model.detectors import North
from radar_sense.model.network import NetworkModel
from radar_sense.model.radar import ALWAYS, NEVER, PERHAPS, Radar
from radar_sense.model.rcs import ConstantRCS
from radar_sense.montecarlo import montecarlo
from radar_sense.montecarlo.montecarlo import MAX_SAMPLE_PATHS, TAIL, monte_carlo
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.montecarlo.sequences import SAMPLERS
from radar_sense.progress import listening
from radar_sense.scenario_file.load import load_scenario
from radar_sense.uncertain_states import uncertain_states

FEW = {"start": 0, "stop": 180, "step": 15}


def p_d(scenario, aircraft, radar):
    """P_D by the paper's own chain, which shares no code with the package."""
    rcs = ("ellipsoid", 0.15, 0.13, 0.21)
    return chain_rule.p_d(aircraft, radar, rcs, single(scenario).p_fa)


def only_radar_constant(std=5.0, **changes):
    return scenario(**known_to(constant=std), **changes)


def only_yaw(**changes):
    return scenario(**known_to(0, [0, 0, 1]), **changes)


def moments_by_integral(function):
    """Mean, standard deviation and fourth central moment of a function of unit normals (n,)."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(100)
    values = function(nodes)

    def expect(g):
        return np.sum(weights * g(values)) / np.sum(weights)

    mean = expect(lambda p: p)
    second, fourth = (expect(lambda p, n=n: (p - mean) ** n) for n in (2, 4))
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
            radar = np.outer(167.0 + 5 * u, [0, 0, 0, 1])
            return p_d(s, np.tile(aircraft, (len(u), 1)), radar)

        mean, std, fourth = moments_by_integral(value)
        error_mean, error_std = errors_of_moments(std, fourth, runs)
        assert abs(mc.mean[i] - mean) < 4 * error_mean
        assert abs(mc.std[i] - std) < 4 * error_std
        # P_D grows with c_r, so its quantiles are P_D at the quantiles of c_r, and the rank of a
        # sample quantile is binomial.
        reach = binom.ppf([1e-5, 1 - 1e-5], runs, TAIL) / runs
        low, high = np.sort(value(ndtri(reach)))
        assert low <= mc.lower[i] <= high
        low, high = np.sort(value(-ndtri(reach)))
        assert low <= mc.upper[i] <= high


def test_yaw_alone_against_the_integral():
    runs = 2000
    s = only_yaw(geometry__azimuth_deg={"start": 0, "stop": 180, "step": 3})
    mc = monte_carlo(s, runs=runs, seed=4)
    z_mean, z_std = [], []
    for i, nominal in enumerate(s.aircraft):

        def value(u, nominal=nominal):
            aircraft = nominal + np.outer(np.radians(u), [0, 0, 0, 0, 0, 1])
            return p_d(s, aircraft, s.radar[np.newaxis])

        mean, std, fourth = moments_by_integral(value)
        error_mean, error_std = errors_of_moments(std, fourth, runs)
        z_mean.append((mc.mean[i] - mean) / error_mean)
        z_std.append((mc.std[i] - std) / error_std)
    # The aircraft is drawn at every pose, so these are independent: their squares sum to a χ².
    assert np.sum(np.square(z_mean)) == pytest.approx(len(z_mean), abs=4 * np.sqrt(2 * len(z_mean)))
    assert np.max(np.abs(z_mean)) < 4.5
    assert np.max(np.abs(z_std)) < 4.5


def test_radar_is_drawn_once_per_run():
    mc = monte_carlo(only_radar_constant(), runs=200)
    errors = mc.sample_paths - mc.band.p_d
    # One draw moves all poses of a run: the same side, and the same rank among the runs.
    assert np.all(np.sign(errors) == np.sign(errors[:, :1]))
    assert np.all(np.argsort(errors, axis=0) == np.argsort(errors[:, 0])[:, np.newaxis])


def test_aircraft_is_drawn_at_every_pose():
    mc = monte_carlo(only_yaw(), runs=500)
    errors = (mc.sample_paths - mc.mean)[:, 60:120]
    correlation = np.corrcoef(errors, rowvar=False)[np.triu_indices(60, 1)]
    assert np.max(abs(correlation)) < 5 / np.sqrt(500)


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


def test_draws_where_the_sight_of_the_radars_changes_are_those_of_the_whole_network():
    """Each radar is out of reach, at its limit, or surely seen, in any order of the poses."""
    flight = np.zeros((400, 6))
    north = np.linspace(150e3, 1e3, 400)
    flight[:, 0], flight[:, 2] = np.random.default_rng(4).permutation(north), -8e3
    cov_aircraft = np.diag([1e4] * 3 + [0.0] * 3)
    one = model.DetectionModel(ConstantRCS(1.0), 1e-6)
    for limits in ([100e3], [100e3, 60e3]):
        radars = [Radar(one, f"r{i}", max_range=r, min_range=9e3) for i, r in enumerate(limits)]
        network, m = NetworkModel(tuple(radars)), len(limits)
        radar = np.tile([0.0, 0, 0, 2e3, 0, 0, 0], m)
        cov_radar = np.kron(np.eye(m), np.diag([400.0, 400, 400, 1e3, 0, 0, 0]))
        _, states = uncertain_states(network, flight, radar, cov_aircraft, cov_radar)
        sampler = Sampler(states)
        normals = np.random.default_rng(5).standard_normal((50, 400, 6))
        of_radars = np.random.default_rng(6).standard_normal((50, states.radar_normals))
        drawn = states.radars_at(of_radars)
        aircraft = flight + normals * np.sqrt(np.diag(cov_aircraft))
        expected = 1 - np.prod(1 - p_d_each(network, aircraft, drawn[:, np.newaxis]), axis=-1)
        np.testing.assert_allclose(sampler.draw_p_d(normals, drawn), expected, atol=1e-13)
        assert set(np.unique(states.sight())) == {NEVER, PERHAPS, ALWAYS}


def test_constants_drawn_below_zero_become_zero_and_are_counted():
    s = only_radar_constant(std=167.0 / 2, geometry__azimuth_deg=FEW)
    runs = 2000
    mc = monte_carlo(s, runs=runs)
    share = ndtr(-2.0)
    assert mc.clipped == pytest.approx(runs * share, abs=4 * np.sqrt(runs * share))
    noise_alone = North().p_d(np.zeros(1), single(s).p_fa)[0]
    for values in (mc.mean, mc.std, mc.lower, mc.upper, mc.sample_paths):
        assert np.all(np.isfinite(values))
    assert mc.lower == pytest.approx(noise_alone, rel=1e-12)
    assert mc.sample_paths.min() == pytest.approx(noise_alone, rel=1e-12)


def assert_same(one, other):
    for name in ("mean", "std", "lower", "upper", "inside", "sample_paths"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
    assert one.clipped == other.clipped


class Elsewhere(Executor):
    """What is computed goes through a pickle, as to another process."""

    def submit(self, function, /, *args):
        future = Future()
        future.set_result(pickle.loads(pickle.dumps(function))(*args))
        return future


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_neither_workers_nor_more_runs_change_a_bit(sampler):
    s = load_scenario()
    one = monte_carlo(s, runs=333, sampler=sampler)
    assert one.sampler == sampler
    for workers in (2, 8):
        assert_same(one, monte_carlo(s, runs=333, sampler=sampler, workers=workers))
    elsewhere = monte_carlo(s, runs=333, sampler=sampler, executor=Elsewhere())
    assert_same(one, elsewhere)
    few = monte_carlo(s, runs=40, sampler=sampler)
    np.testing.assert_array_equal(one.sample_paths[:40], few.sample_paths)


@pytest.mark.parametrize("chunk", [7, 1000])
def test_chunks_do_not_change_a_bit(monkeypatch, chunk):
    s = load_scenario("configs/covariance.yaml")
    before = monte_carlo(s, runs=12)
    for name in ("states", "model.detection_model"):
        monkeypatch.setattr(f"radar_sense.{name}.BLOCK", chunk)
    assert_same(before, monte_carlo(s, runs=12))


def test_seed_makes_the_draws_and_zero_is_a_seed():
    s = load_scenario()
    zero, again, one = (monte_carlo(s, runs=2, seed=seed) for seed in (0, 0, 1))
    assert_same(zero, again)
    assert not np.array_equal(zero.sample_paths, one.sample_paths)
    assert_same(monte_carlo(s, runs=2), one)  # the scenario's seed is 1
    huge = monte_carlo(s, runs=2, seed=10**50)
    assert not np.array_equal(huge.sample_paths, zero.sample_paths)


@pytest.mark.parametrize("workers", [1, 3])
def test_statistics_are_those_of_all_draws(monkeypatch, workers):
    """The last block is not full; and constants are set to zero."""
    monkeypatch.setattr(montecarlo, "SAMPLES_PER_BLOCK", 8 * 13)
    s, runs, shown = only_radar_constant(std=100.0, geometry__azimuth_deg=FEW), 8 * 130 + 3, []
    with listening(lambda *steps: shown.append(steps)):
        mc = monte_carlo(s, runs=runs, seed=5, workers=workers)
    assert shown[1:] == [("runs", min(8 * (i + 1), runs), runs) for i in range(131)]
    sampler = montecarlo.Sampler(s.states())
    source = SAMPLERS["random"](5, 8, 13, s.states().radar_normals)
    draws, radars = [], []
    for block in range(-(-runs // 8)):
        radar_normals, aircraft_normals = source.block(block)
        radars.append(s.states().radars_at(radar_normals))
        draws.append(sampler.draw_p_d(aircraft_normals, radars[-1]))
    draws, radars = np.concatenate(draws)[:runs], np.concatenate(radars)[:runs]
    np.testing.assert_array_equal(mc.sample_paths, draws[:MAX_SAMPLE_PATHS])
    assert mc.clipped == np.count_nonzero(radars[:, 3] == 0) > 10
    np.testing.assert_allclose(mc.mean, draws.mean(axis=0), rtol=1e-13)
    np.testing.assert_allclose(mc.std, draws.std(axis=0, ddof=1), rtol=1e-12)
    inside = (draws >= mc.band.lower) & (draws <= mc.band.upper)
    np.testing.assert_array_equal(mc.inside, inside.sum(axis=0))
    quantiles = np.quantile(draws, [TAIL, 1 - TAIL], axis=0)
    np.testing.assert_allclose([mc.lower, mc.upper], quantiles, rtol=1e-13)


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

    assert peak(60_000) < 1.2 * peak(20_000)


def test_a_scenario_of_arrays_has_the_bytes_of_the_file():
    s = load_scenario("configs/covariance.yaml")
    made = rs.Scenario(
        radars=[rs.Radar(single(s), state=s.radar, levels={"one": rs.Level(s.cov_radar)})],
        geometry=rs.States.of(s.aircraft, s.cov_aircraft),
    )
    for sampler in SAMPLERS:
        mc = monte_carlo(made, runs=40, seed=9, method="probit", sampler=sampler)
        expected = monte_carlo(s, runs=40, seed=9, method="probit", sampler=sampler)
        assert_same(mc, expected)
        assert mc.band.upper.tobytes() == expected.band.upper.tobytes()
    one = monte_carlo(made.at_poses(slice(7, 8)), runs=40)
    assert one.mean.shape == (1,)
    assert repr(one).startswith("MonteCarlo(40 runs of 1 poses, seed 1, random: ")


def test_running_out_of_memory_or_threads_says_what_to_reduce(monkeypatch):
    s = scenario(geometry__azimuth_deg=FEW)

    def no_memory(*_):
        raise MemoryError

    def no_thread(*_):
        raise RuntimeError("can't start new thread")

    with monkeypatch.context() as patch:
        patch.setattr(montecarlo, "draw_block", no_memory)
        for workers in (1, 3):
            with pytest.raises(ComputationError, match=r"^out of memory; use fewer workers"):
                monte_carlo(s, runs=100, workers=workers)
    with ThreadPoolExecutor(1) as shut:
        pass
    with pytest.raises(ComputationError, match=r"^no more calls .* or a running executor$"):
        monte_carlo(s, runs=100, executor=shut)
    monkeypatch.setattr(threading.Thread, "start", no_thread)
    with pytest.raises(ComputationError, match=r"^no more calls .* use fewer workers"):
        monte_carlo(s, runs=100_000, workers=3)


@pytest.mark.parametrize("k", [1.0, 2.5])
def test_the_band_at_another_k_holds_the_share_of_a_normal_distribution(k):
    s = load_scenario().at_poses(slice(None, None, 60))
    mc = rs.monte_carlo(s, runs=40_000, method="form", k=k)
    assert mc.expected == pytest.approx(math.erf(k / math.sqrt(2)), rel=1e-12)
    low, high = mc.coverage_interval(0.9999)
    assert np.all((low - 0.003 < mc.expected) & (mc.expected < high + 0.003))  # FORM's own error
    np.testing.assert_allclose(mc.lower, mc.band.lower, atol=0.01)
    with pytest.raises(ValueError, match="k must be a number greater than 0"):
        rs.monte_carlo(s, k=-1)
