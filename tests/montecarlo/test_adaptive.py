"""The verdict on a method: the rules of JCGM 101, and cases with a known verdict.

Most cases have a model that is linear in the states. P_D is then Gaussian, first order is exact,
and every quantile is known.
"""

import dataclasses
from contextlib import contextmanager
from dataclasses import dataclass
from decimal import Decimal
from operator import attrgetter

import numpy as np
import pytest
from helpers import scenario, single
from scipy import stats
from scipy.integrate import quad
from scipy.special import ndtr
from scipy.stats import beta as beta_distribution
from scipy.stats import norm

from radar_sense.axis import azimuth
from radar_sense.errors import ScenarioError
from radar_sense.model import detection_model as model
from radar_sense.model.network import NetworkModel
from radar_sense.montecarlo import adaptive as validation
from radar_sense.montecarlo.adaptive import numerical_tolerance, validate_method
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.montecarlo.sequences import Random
from radar_sense.propagation import Moments, propagate_scenario
from radar_sense.streams import Stream, random_stream

M = 37_040  # draws of a batch at β = 3: the next whole number above 100/(2 Φ(−3)) = 37 039.8
SIX = {"start": 0, "stop": 90, "step": 18}
ARRAYS = (
    "runs",
    "delta",
    "draws.mean",
    "draws.std",
    "draws.lower",
    "draws.upper",
    "distance_lower",
    "distance_upper",
    "stable",
    "validated",
    "inside",
)


@dataclass(frozen=True)
class LinearModel(NetworkModel):
    """P_D = 0.5 + slope · (north of the aircraft + east of the radar), in metres."""

    by_aircraft: float = 0.0
    by_radar: float = 0.0
    exaggerate: float = 1.0

    def p_d(self, aircraft, radar):
        return 0.5 + self.by_aircraft * aircraft[..., 0] + self.by_radar * radar[..., 1]

    def moments(self, aircraft, radar, cov_aircraft, cov_radar, beta):
        p_d = self.p_d(aircraft, radar)
        variance = self.by_aircraft**2 * cov_aircraft[0, 0] + self.by_radar**2 * cov_radar[1, 1]
        std = np.full_like(p_d, self.exaggerate * np.sqrt(variance))
        return Moments(
            p_d=p_d,
            mean=p_d,
            std=std,
            lower=p_d - beta * std,
            upper=p_d + beta * std,
            error=np.zeros(len(p_d)),
        )


def gaussian(std=0.03, shared=0.0, poses=4, exaggerate=1.0, seed=1):
    """P_D is Gaussian around 0.5. The radar error is common to all poses."""
    paper = scenario(analysis={"level": "medium", "seed": seed})
    slope = std * np.array([np.sqrt(1 - shared), np.sqrt(shared)])
    return dataclasses.replace(
        paper,
        model=LinearModel(paper.model.radars, *slope, exaggerate),
        axis=azimuth(np.arange(float(poses))),
        aircraft=np.zeros((poses, 6)),
        radar=np.array([0.0, 0.0, 0.0, 167.0]),
        cov_aircraft=np.diag([1.0, 0, 0, 0, 0, 0]),
        cov_radar={"medium": np.diag([0, 1.0, 0, 0])},
    )


def paper(level="medium", **azimuth):
    """The paper's scenario at few poses."""
    s = scenario(geometry__azimuth_deg={"start": 0, "stop": 180, "step": 30, **azimuth})
    return s.with_analysis(level=level)


def with_method(monkeypatch, **changes):
    """Change the moments of the method for a linear model by a function for each attribute."""

    def moments_of(scenario, *, method, beta):
        if not isinstance(scenario.model, LinearModel):
            return propagate_scenario(scenario, method=method, beta=beta)
        cov_radar = scenario.cov_radar[scenario.level]
        states = scenario.aircraft, scenario.radar, scenario.cov_aircraft, cov_radar
        exact = scenario.model.moments(*states, beta)
        return dataclasses.replace(exact, **{k: f(getattr(exact, k)) for k, f in changes.items()})

    monkeypatch.setattr(validation, "propagate_scenario", moments_of)


@pytest.fixture(autouse=True)
def _exact(monkeypatch):
    with_method(monkeypatch)


@contextmanager
def settings(**constants):
    """Give constants of `adaptive` other values: `settings(beta=2)`."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in constants.items():
            patch.setattr(validation, name.upper(), value)
        yield


def validate(s, *, method="linear", digits=2, workers=1, progress=None, **constants):
    """Validate a method, with other values of the constants BETA, FRACTION and MAX_RUNS."""
    with settings(**constants):
        return validate_method(s, method=method, digits=digits, workers=workers, progress=progress)


def batches_of(s, beta=3.0):
    """Return the batches for an interval from Φ(−β) to Φ(β)."""
    with settings(beta=beta):
        return validation.Batches.of(s)


def assert_same(one, other, poses=slice(None)):
    for name in ARRAYS:
        value = attrgetter(name)
        assert value(one)[poses].tobytes() == value(other).tobytes(), name


@pytest.mark.parametrize(
    ("std", "digits", "delta"),
    [
        (0.00035, 2, 0.000005),  # 7.9.2, examples 1 to 3
        (0.00035, 1, 0.00005),
        (2.0, 1, 0.5),
        (0.35, 2, 0.005),
        (0.35, 1, 0.05),
        (0.0304, 2, 0.0005),
        (0.0304, 4, 0.000005),
        (0.1, 2, 0.005),
        (0.0999, 2, 0.005),  # rounded to 0.10: 10 · 10^-2
        (0.0994, 2, 0.0005),  # 99 · 10^-3
        (0.96, 1, 0.5),
        (0.94, 1, 0.05),
        (1.0, 1, 0.5),
        (1e-9, 3, 5e-12),
        (0.0, 2, 0.0),
    ],
)
def test_tolerance_is_half_a_unit_of_the_last_digit(std, digits, delta):
    assert numerical_tolerance(std, digits) == delta


@pytest.mark.parametrize("digits", [1, 2, 3, 4])
def test_tolerance_leaves_the_deviation_the_given_digits(digits):
    for std in 10 ** np.random.default_rng(1).uniform(-12, 2, 500):
        unit = 2 * Decimal(str(numerical_tolerance(std, digits)))
        assert unit == Decimal(10) ** unit.adjusted()
        assert len(str(round(Decimal(std) / unit))) == digits


def test_tolerance_of_no_number_is_none():
    assert np.isnan(numerical_tolerance(float("nan"), 2))


@pytest.mark.parametrize(("beta", "draws"), [(3, M), (2.0, 10_000), (1.0, 10_000), (2.8, 19_569)])
def test_a_batch_has_a_hundred_draws_outside_and_ten_thousand_in_all(beta, draws):
    assert batches_of(gaussian(), beta).draws == draws
    assert draws * 2 * ndtr(-beta) >= 100
    assert draws == 10_000 or (draws - 1) * 2 * ndtr(-beta) < 100


def test_where_first_order_is_exact_it_is_validated():
    v = validate(gaussian(poses=20, shared=0.3), digits=1, fraction=0.5)
    assert v.verdict == "validated"
    assert np.all(v.validated)
    assert not np.any(v.refuted | v.undecided)
    np.testing.assert_array_equal(v.delta, 0.005)
    # a quantile of a Gaussian has the standard error √(p/n)/φ(3), p = Φ(−3)
    error = 0.03 * np.sqrt(ndtr(-3) / v.runs) / norm.pdf(3)
    assert np.all(abs(v.draws.lower - 0.41) < 4 * error)
    assert np.all(abs(v.draws.upper - 0.59) < 4 * error)
    assert np.all(abs(v.draws.mean - 0.5) < 4 * 0.03 / np.sqrt(v.runs))
    assert np.all(abs(v.draws.std - 0.03) < 4 * 0.03 / np.sqrt(2 * v.runs))
    np.testing.assert_array_equal(v.distance_lower, abs(v.moments.lower - v.draws.lower))
    np.testing.assert_array_equal(v.distance_upper, abs(v.moments.upper - v.draws.upper))


@pytest.mark.parametrize(("digits", "verdict"), [(1, "validated"), (2, "refuted")])
def test_a_wrong_deviation_is_told_where_the_digits_show_it(digits, verdict):
    # 2 % of 0.09 is 0.0018: within half a unit of 0.03, not within one of 0.030
    v = validate(gaussian(exaggerate=1.02, poses=2), digits=digits)
    assert v.verdict == verdict
    assert np.all(v.refuted) == (verdict == "refuted")
    assert v.distance_lower == pytest.approx(0.0018, abs=1.5 * v.delta[0] / 2 + 0.0005)


@pytest.mark.parametrize("bound", ["lower", "upper"])
@pytest.mark.parametrize("sign", [-1, 1])
def test_one_end_is_enough_to_refute(monkeypatch, bound, sign):
    with_method(monkeypatch, **{bound: lambda ends: ends + sign * 0.008 * np.array([1, 0])})
    v = validate(gaussian(poses=2), digits=1, fraction=0.5)
    assert v.validated.tolist() == [False, True]
    assert v.refuted.tolist() == [True, False]
    assert v.verdict == "refuted"


def test_only_the_interval_is_judged(monkeypatch):
    with_method(monkeypatch, mean=lambda mean: mean + 0.1, std=lambda std: std * 2)
    assert validate(gaussian(), digits=1, fraction=0.5).verdict == "validated"


def test_tiny_uncertainties_of_the_paper_are_validated():
    tiny = scenario(
        geometry__azimuth_deg=SIX | {"start": 9},
        uncertainty={
            "aircraft": {"position_m": 1, "attitude_deg": 0.01},
            "radar": {"tiny": {"position_m": 1, "constant": 0.05}},
        },
        analysis={"level": "tiny"},
    )
    v = validate(tiny, digits=1, fraction=0.5)
    assert v.verdict == "validated"
    assert np.max(v.draws.std) < 0.0005


def test_the_paper_is_refuted_at_90_degrees_and_high():
    v = validate(paper("high", start=90, stop=90), digits=1)
    assert v.verdict == "refuted"
    assert v.moments.upper[0] > 1 > v.draws.upper[0]
    assert v.coverage[0] == pytest.approx(0.972, abs=0.001 + 4 * np.sqrt(0.028 / v.runs[0]))


def test_the_paper_at_high_is_refuted_for_linear_and_validated_for_form():
    s = paper("high", stop=60, step=20)
    linear, form = (validate(s, method=m, digits=1, fraction=0.5) for m in ("linear", "form"))
    assert linear.verdict == "refuted"
    assert form.verdict == "validated"
    assert (linear.method, form.method) == ("linear", "form")
    same = linear.runs == form.runs
    np.testing.assert_array_equal(
        linear.draws.lower[same], form.draws.lower[same]
    )  # the same draws


def test_too_few_runs_decide_nothing():
    s = gaussian(poses=3)
    v = validate(s, digits=3, max_runs=4 * M + 5)
    np.testing.assert_array_equal(v.runs, 4 * M)
    assert not np.any(v.stable | v.validated | v.refuted)
    assert np.all(v.undecided)
    assert v.verdict == "undecided"


def test_undecided_is_not_validated_even_if_it_agrees(monkeypatch):
    seen = validate(gaussian(poses=1), digits=3, max_runs=2 * M)
    with_method(monkeypatch, lower=lambda _: seen.draws.lower, upper=lambda _: seen.draws.upper)
    again = validate(gaussian(poses=1), digits=3, max_runs=2 * M)
    assert again.distance_lower[0] == again.distance_upper[0] == 0
    assert again.verdict == "undecided"
    assert not again.validated[0]


@pytest.mark.parametrize(("digits", "fraction"), [(1, 0.4), (2, 1.0)])
def test_each_pose_stops_at_the_first_batch_that_is_stable(digits, fraction):
    s = paper("medium", step=60)
    most = 12
    v = validate(s, digits=digits, fraction=fraction, max_runs=most * M)
    batches = batches_of(s)
    p = [ndtr(-3), ndtr(3)]
    radar = [batches.radar(number)[0] for number in range(most)]
    for pose in range(len(s.aircraft)):
        count = v.runs[pose] // M
        assert v.runs[pose] == count * M
        draws = [batches.p_d(number, radar[number], pose) for number in range(count)]
        each = np.array([[d.mean(), d.std(ddof=1), *np.quantile(d, p)] for d in draws])
        for h in range(2, count + 1):
            so_far = np.concatenate(draws[:h])
            delta = numerical_tolerance(so_far.std(ddof=1), digits)
            # 7.9.4: s² = Σ (y_i − y)² / (h (h − 1))
            errors = np.sqrt(np.sum((each[:h] - each[:h].mean(axis=0)) ** 2, axis=0) / h / (h - 1))
            stable = np.all(2 * errors <= fraction * delta)
            ends = np.array([v.moments.lower[pose], v.moments.upper[pose]])
            distances = abs(ends - np.quantile(so_far, p))
            within = np.all(distances <= delta)
            doubt = stats.t.ppf(ndtr(3), h - 1)
            beyond = np.any(distances > delta + doubt * errors[2:])
            ended = stable and (within or beyond)
            assert ended == (h == count and not v.undecided[pose])
        assert v.validated[pose] == (stable and within)
        assert v.refuted[pose] == (stable and beyond)
        assert v.stable[pose] == stable
        assert not v.undecided[pose] or count == most
        assert v.delta[pose] == delta
        assert v.draws.mean[pose] == pytest.approx(so_far.mean(), rel=1e-13)
        assert v.draws.std[pose] == pytest.approx(so_far.std(ddof=1), rel=1e-11)
        lower, upper = np.quantile(so_far, p)
        assert v.draws.lower[pose] == pytest.approx(lower, rel=1e-14)
        assert v.draws.upper[pose] == pytest.approx(upper, rel=1e-14)
        low, high = v.moments.lower[pose], v.moments.upper[pose]
        assert v.inside[pose] == np.count_nonzero((so_far >= low) & (so_far <= high))
    assert len(set(v.runs)) >= 2  # poses did stop on their own
    assert np.any(v.stable)


@pytest.mark.parametrize("beta", [0.3, 1.0, 2.0, 3.5])
def test_ends_are_the_quantiles_of_all_draws_at_any_beta(beta):
    s = gaussian(poses=1)
    batches = batches_of(s, beta)
    v = validate(s, digits=3, beta=beta, max_runs=2 * batches.draws)
    draws = [batches.p_d(number, batches.radar(number)[0], 0) for number in range(2)]
    lower, upper = np.quantile(np.concatenate(draws), [ndtr(-beta), ndtr(beta)])
    assert v.draws.lower[0] == pytest.approx(lower, rel=1e-14)
    assert v.draws.upper[0] == pytest.approx(upper, rel=1e-14)
    assert v.moments.lower[0] == pytest.approx(0.5 - beta * 0.03, rel=1e-12)


def test_quantiles_of_all_draws_are_less_biased_than_their_averages():
    def bias(draws):
        """Return the bias of the lower quantile of unit normals, from the ranks' distribution."""
        position = (draws - 1) * ndtr(-3)
        below = int(position)
        part = position - below
        ranked = [beta_distribution(rank, draws + 1 - rank) for rank in (below + 1, below + 2)]
        ends = [r.ppf([1e-13, 1 - 1e-13]) for r in ranked]
        means = [
            quad(lambda p, r=r: norm.ppf(p) * r.pdf(p), *e, epsabs=1e-12)[0]
            for r, e in zip(ranked, ends, strict=True)
        ]
        return (1 - part) * means[0] + part * means[1] + 3

    assert bias(M) == pytest.approx(0.0033, abs=0.0001)  # of the average as well
    assert bias(10 * M) == pytest.approx(0.00033, abs=0.00001)


@pytest.mark.parametrize("workers", [2, 5])
def test_workers_do_not_change_a_bit(workers):
    s = paper(step=60)
    alone = validate(s, digits=1, fraction=0.7)
    assert_same(alone, validate(s, digits=1, fraction=0.7, workers=workers))


def test_chunks_and_groups_do_not_change_a_bit(monkeypatch):
    s = paper("high", step=60)
    before = validate(s, digits=1)
    monkeypatch.setattr(model, "BLOCK", 999)
    assert_same(before, validate(s, digits=1))
    monkeypatch.setattr(validation, "MAX_KEPT", 1)
    alone = validate(s, digits=1)
    assert_same(before, alone)
    assert before.clipped == alone.clipped


def test_a_pose_does_not_depend_on_the_others():
    s = paper(step=30)
    together = validate(s, digits=1, fraction=0.6)
    assert len(set(together.runs)) > 1
    fewer = s.at_poses(slice(3))
    assert_same(together, validate(fewer, digits=1, fraction=0.6), slice(0, 3))
    # more digits draw the same first batches
    longer = validate(fewer, digits=1, fraction=0.3)
    shorter = validate(fewer, digits=4, max_runs=2 * M)
    assert np.all(longer.runs >= shorter.runs)
    assert np.any(longer.runs > shorter.runs)


def test_seed_makes_the_draws_and_zero_is_a_seed():
    zero, again, one = (validate(gaussian(seed=seed), digits=1) for seed in (0, 0, 1))
    assert_same(zero, again)
    assert (zero.seed, one.seed) == (0, 1)
    assert not np.any(zero.draws.mean == one.draws.mean)
    assert len(set(zero.draws.mean)) == 4


def test_streams_are_all_different_and_not_those_of_monte_carlo():
    s = gaussian(shared=1.0)
    batches = batches_of(s)
    first, second = batches.radar(0)[0], batches.radar(1)[0]
    source = Random(s.seed, 32, len(s.aircraft))
    runs = np.concatenate(
        [batches.sampler.draw_radar(source.block(index)[0])[0][:, 1] for index in range(3)]
    )
    values = np.concatenate([first[:, 1], second[:, 1], runs])
    assert len(set(values.round(9))) == len(values)
    alone = batches_of(gaussian())
    draws = [alone.p_d(number, first, pose) for number in range(2) for pose in range(3)]
    correlation = np.corrcoef([*draws, first[:, 1], second[:, 1]])[np.triu_indices(8, 1)]
    assert np.max(abs(correlation)) < 4.5 / np.sqrt(M)


def test_the_radar_is_drawn_once_per_run_for_all_poses():
    s = gaussian(shared=0.5)
    batches = batches_of(s)
    radar, _ = batches.radar(0)
    one, other = (batches.p_d(0, radar, pose) for pose in (0, 3))
    assert np.corrcoef(one, other)[0, 1] == pytest.approx(0.5, abs=4 / np.sqrt(M))


@pytest.mark.parametrize("method", ["linear", "probit", "form"])
def test_without_uncertainty_the_nominal_value_is_validated(method):
    nothing = {"position_m": 0, "attitude_deg": 0}
    certain = {"only": {"position_m": 0, "constant": 0}}
    s = scenario(
        geometry__azimuth_deg=SIX,
        uncertainty={"aircraft": nothing, "radar": certain},
        analysis={"level": "only"},
    )
    v = validate(s, method=method)
    assert v.verdict == "validated"
    np.testing.assert_array_equal(v.runs, 2 * M)
    np.testing.assert_array_equal(v.coverage, 1.0)
    np.testing.assert_allclose(
        v.delta, 1e-13 * v.draws.mean, rtol=1e-9
    )  # the rounding of the arithmetic
    assert np.all(v.draws.std < 1e-15)


def test_without_uncertainty_rounding_is_no_error(monkeypatch):
    with_method(monkeypatch, lower=lambda lower: lower + 2e-14, upper=lambda upper: upper - 2e-14)
    v = validate(gaussian(std=0.0))
    assert v.verdict == "validated"
    np.testing.assert_array_equal(v.coverage, 1.0)


def test_without_uncertainty_another_value_is_refuted(monkeypatch):
    with_method(monkeypatch, upper=lambda upper: upper + 1e-9)
    v = validate(gaussian(std=0.0))
    assert np.all(v.stable)
    assert np.all(v.refuted)


def test_a_method_without_a_result_is_refuted(monkeypatch):
    undefined = np.array([1, np.nan])
    with_method(monkeypatch, **{k: lambda v: v * undefined for k in ("mean", "std", "lower")})
    v = validate(gaussian(poses=2), digits=1, fraction=0.5)
    assert v.validated.tolist() == [True, False]
    assert v.refuted.tolist() == [False, True]
    assert v.coverage[0] > 0.99
    assert np.isnan(v.coverage[1])
    low, high = v.coverage_interval()
    assert np.isnan([low[1], high[1]]).all()
    assert low[0] < v.coverage[0] < high[0]
    assert np.isfinite(v.draws.upper).all()


@pytest.mark.parametrize(("beta", "exaggerate"), [(3.0, 1.0), (2.0, 1.0), (2.0, 0.9)])
def test_coverage_is_that_of_the_normal_distribution(beta, exaggerate):
    v = validate(gaussian(exaggerate=exaggerate, poses=10), digits=1, beta=beta)
    expected = 1 - 2 * ndtr(-beta * exaggerate)
    np.testing.assert_array_equal(v.coverage, v.inside / v.runs)
    low, high = v.coverage_interval(0.9999)
    assert np.all((low < expected) & (expected < high))
    wide = np.mean(high - low)
    assert wide < 8 * np.sqrt(expected * (1 - expected) / v.runs.min())
    narrow = np.subtract(*v.coverage_interval()[::-1])
    assert np.all(narrow < high - low)


def test_constants_drawn_below_zero_become_zero_and_are_counted():
    s = scenario(
        geometry__azimuth_deg=SIX,
        uncertainty={
            "aircraft": {"position_m": 0, "attitude_deg": 0},
            "radar": {"wide": {"position_m": 0, "constant": 167.0 / 2}},
        },
        analysis={"level": "wide"},
    )
    v = validate(s, digits=1)
    runs, share = v.runs.max(), ndtr(-2.0)
    assert v.clipped == pytest.approx(runs * share, abs=4 * np.sqrt(runs * share))
    noise_alone = single(s).p_d(s.aircraft[0], np.zeros(4))
    np.testing.assert_allclose(v.draws.lower, noise_alone, rtol=1e-12)
    assert np.all(v.refuted)
    assert v.clipped == montecarlo_clipped(s, runs // M)


def montecarlo_clipped(s, batches):
    """Count the draws below zero again, before they are set to zero."""
    sampler = Sampler.of(s)
    uncut = dataclasses.replace(sampler, radar=sampler.radar + np.array([0, 0, 0, 1e6]))
    draws = [
        uncut.draw_radar(random_stream(s.seed, Stream.BATCHES, b, 0).standard_normal((M, 4)))[0]
        for b in range(batches)
    ]
    return np.count_nonzero(np.concatenate(draws)[:, 3] < 1e6)


@pytest.mark.parametrize("workers", [1, 2])
def test_progress_adds_up_to_the_poses(monkeypatch, workers):
    s = paper(step=30)
    seen = []
    v = validate(s, digits=1, fraction=0.6, workers=workers, progress=seen.append)
    assert sum(seen) == len(s.aircraft)
    assert len(seen) == v.runs.max() // M
    assert seen[0] == 0  # one batch settles nothing
    counts = np.bincount(v.runs // M)
    np.testing.assert_array_equal(seen, counts[1:])


def test_whole_numbers_may_be_written_with_a_point():
    assert_same(validate(gaussian(), digits=1), validate(gaussian(), digits=1.0))


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"digits": 0}, "digits must be a whole number not less than 1 and not greater than 4"),
        ({"digits": 5}, "digits must be"),
        ({"digits": 1.5}, "digits must be"),
        ({"method": "liner"}, "did you mean 'linear'"),
    ],
)
def test_refusals_are_one_line(wrong, says):
    with pytest.raises(ScenarioError, match=says) as error:
        validate(gaussian(), **wrong)
    assert "\n" not in str(error.value)
