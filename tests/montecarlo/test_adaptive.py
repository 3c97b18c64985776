"""The verdict on a method: the tolerance of JCGM 101, and cases with a known verdict.

Most cases have a model that is linear in the states. P_D is then Gaussian, first order is exact,
and every quantile is known.
"""

import dataclasses
from decimal import Decimal
from operator import attrgetter

import numpy as np
import pytest
from helpers import scenario, single
from scipy.special import ndtr

from radar_sense.axis import azimuth
from radar_sense.errors import ScenarioError
from radar_sense.model.network import NetworkModel
from radar_sense.montecarlo import adaptive, montecarlo
from radar_sense.montecarlo.adaptive import DRAWS, numerical_tolerance, validate_method
from radar_sense.progress import listening
from radar_sense.propagation import Moments, propagate_scenario

SIX = {"start": 0, "stop": 90, "step": 18}
ARRAYS = (
    "runs", "delta", "plain.mean", "plain.std", "lower", "upper", "distance_lower",
    "distance_upper", "stable", "agrees", "differs", "plain.inside",
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class LinearModel(NetworkModel):
    """P_D = 0.5 + slope · (north of the aircraft + east of the radar), in metres."""

    by_aircraft: float = 0.0
    by_radar: float = 0.0
    exaggerate: float = 1.0

    def p_d(self, aircraft, radar):
        return 0.5 + self.by_aircraft * aircraft[..., 0] + self.by_radar * radar[..., 1]

    def moments(self, scenario):
        p_d = np.full(len(scenario.aircraft), 0.5)
        std = np.full_like(p_d, self.exaggerate * np.hypot(self.by_aircraft, self.by_radar))
        return Moments(p_d, p_d, std, p_d - 3 * std, p_d + 3 * std, np.zeros_like(p_d))


def gaussian(std=0.03, shared=0.0, poses=4, exaggerate=1.0, seed=1):
    """P_D is Gaussian around 0.5. The radar error is common to all poses."""
    paper = scenario(analysis={"level": "medium", "seed": seed})
    slope = std * np.array([np.sqrt(1 - shared), np.sqrt(shared)])
    return dataclasses.replace(
        paper,
        model=LinearModel(paper.model.radars, *slope, exaggerate),
        axis=azimuth(np.arange(float(poses))),
        aircraft=np.tile([0.0, 0, -1e5, 0, 0, 0], (poses, 1)),
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

    def moments_of(scenario, *, method):
        if not isinstance(scenario.model, LinearModel):
            return propagate_scenario(scenario, method=method)
        exact = scenario.model.moments(scenario)
        return dataclasses.replace(exact, **{k: f(getattr(exact, k)) for k, f in changes.items()})

    monkeypatch.setattr(montecarlo, "propagate_scenario", moments_of)


@pytest.fixture(autouse=True)
def _exact(monkeypatch):
    with_method(monkeypatch)
    monkeypatch.setattr(adaptive, "RUNS", 20_000)


def validate(s, *, method="linear", digits=2, workers=1):
    return validate_method(s, method=method, digits=digits, workers=workers)


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


def test_where_first_order_is_exact_it_agrees():
    v = validate(gaussian(poses=20, shared=0.3), digits=1)
    assert v.verdict == "agrees"
    assert np.all(v.agrees & v.stable)
    assert not np.any(v.differs | v.undecided)
    np.testing.assert_array_equal(v.delta, 0.005)
    # twice the standard error is within δ
    assert np.all(abs(v.lower - 0.41) < 2 * 0.005)
    assert np.all(abs(v.upper - 0.59) < 2 * 0.005)
    assert np.all(abs(v.plain.mean - 0.5) < 4 * 0.03 / np.sqrt(v.plain.runs))
    assert np.all(abs(v.plain.std - 0.03) < 4 * 0.03 / np.sqrt(2 * v.plain.runs))
    np.testing.assert_array_equal(v.distance_lower, abs(v.plain.band.lower - v.lower))
    np.testing.assert_array_equal(v.distance_upper, abs(v.plain.band.upper - v.upper))


def test_the_ends_have_the_stated_accuracy():
    """Over 40 independent poses the ends scatter as their standard errors say."""
    ends = [validate(gaussian(std=0.012, poses=1, seed=seed), digits=2) for seed in range(40)]
    off = np.array([[v.lower[0] - 0.464, v.upper[0] - 0.536] for v in ends]) / ends[0].delta[0]
    # stable: a standard error of at most δ/2; a draw of 80 normals is beyond 4 once in 200 times
    assert np.max(abs(off)) < 2
    assert np.sqrt(np.mean(off**2)) < 0.5 * 1.25
    assert len({v.lower[0] for v in ends}) == 40


@pytest.mark.parametrize(("digits", "verdict"), [(1, "agrees"), (2, "differs")])
def test_a_wrong_deviation_is_told_where_the_digits_show_it(digits, verdict):
    # 3 % of 0.09 is 0.0027: within half a unit of 0.03, not within one of 0.030
    v = validate(gaussian(exaggerate=1.03, poses=2), digits=digits)
    assert v.verdict == verdict
    assert np.all(v.differs) == (verdict == "differs")


@pytest.mark.parametrize("bound", ["lower", "upper"])
@pytest.mark.parametrize("sign", [-1, 1])
def test_one_end_is_enough_to_differ(monkeypatch, bound, sign):
    with_method(monkeypatch, **{bound: lambda ends: ends + sign * 0.015 * np.array([1, 0])})
    v = validate(gaussian(poses=2), digits=1)
    assert v.agrees.tolist() == [False, True]
    assert v.differs.tolist() == [True, False]
    assert v.verdict == "differs"


def test_only_the_interval_is_judged(monkeypatch):
    with_method(monkeypatch, mean=lambda mean: mean + 0.1, std=lambda std: std * 2)
    assert validate(gaussian(), digits=1).verdict == "agrees"


def test_tiny_uncertainties_of_the_paper_agree():
    tiny = scenario(
        geometry__azimuth_deg=SIX | {"start": 9},
        uncertainty={
            "aircraft": {"position_m": 1, "attitude_deg": 0.01},
            "radar": {"tiny": {"position_m": 1, "constant": 0.05}},
        },
        analysis={"level": "tiny"},
    )
    v = validate(tiny, digits=1)
    assert v.verdict == "agrees"
    assert np.max(v.plain.std) < 0.0005


def test_the_paper_differs_at_90_degrees_and_high():
    v = validate(paper("high", start=90, stop=90), digits=1)
    assert v.verdict == "differs"
    assert v.plain.band.upper[0] > 1 > v.upper[0]
    error = np.sqrt(0.028 / v.plain.runs)
    assert v.plain.coverage[0] == pytest.approx(0.972, abs=0.001 + 4 * error)


def test_the_paper_at_high_differs_for_linear_and_agrees_for_form():
    s = paper("high", stop=60, step=20)
    linear, form = (validate(s, method=m) for m in ("linear", "form"))
    assert linear.verdict == "differs"
    assert form.verdict == "agrees"
    assert (linear.method, form.method) == ("linear", "form")
    same = linear.runs == form.runs
    np.testing.assert_array_equal(linear.lower[same], form.lower[same])  # the same draws


def test_too_few_draws_decide_nothing(monkeypatch):
    monkeypatch.setattr(adaptive, "MOST_BATCHES", 2)
    v = validate(gaussian(poses=3), digits=3)
    np.testing.assert_array_equal(v.runs, 2 * DRAWS)
    assert not np.any(v.stable | v.agrees | v.differs)
    assert np.all(v.undecided)
    assert v.verdict == "undecided"


def test_undecided_does_not_agree_even_if_it_is_the_same(monkeypatch):
    monkeypatch.setattr(adaptive, "MOST_BATCHES", 2)
    seen = validate(gaussian(poses=1), digits=3)
    with_method(monkeypatch, lower=lambda _: seen.lower, upper=lambda _: seen.upper)
    again = validate(gaussian(poses=1), digits=3)
    assert again.distance_lower[0] == again.distance_upper[0] == 0
    assert again.verdict == "undecided"
    assert not again.agrees[0]


@pytest.mark.parametrize("workers", [2, 5])
def test_workers_do_not_change_a_bit(workers):
    s = paper(step=60)
    assert_same(validate(s, digits=1), validate(s, digits=1, workers=workers))


def test_a_pose_does_not_depend_on_the_others():
    s = paper("high", step=30)
    together = validate(s, method="form")
    assert len(set(together.runs)) > 1
    alone = validate(s.at_poses(slice(3)), method="form")
    for name in ("runs", "lower", "upper", "agrees"):
        np.testing.assert_allclose(getattr(together, name)[:3], getattr(alone, name), rtol=1e-12)


def test_seed_makes_the_draws_and_zero_is_a_seed():
    zero, again, one = (validate(gaussian(seed=seed), digits=1) for seed in (0, 0, 1))
    assert_same(zero, again)
    assert (zero.plain.seed, one.plain.seed) == (0, 1)
    assert not np.any(zero.plain.mean == one.plain.mean)
    assert not np.any(zero.lower == one.lower)


@pytest.mark.parametrize("detector", ["north", "swerling1"])
@pytest.mark.parametrize("method", ["linear", "probit", "form"])
def test_without_uncertainty_the_nominal_value_agrees(method, detector):
    """The draws and a method may round P_D differently."""
    nothing = {"position_m": 0, "attitude_deg": 0}
    certain = {"only": {"position_m": 0, "constant": 0}}
    s = scenario(
        geometry__azimuth_deg=SIX,
        radar__detector=detector,
        uncertainty={"aircraft": nothing, "radar": certain},
        analysis={"level": "only"},
    )
    v = validate(s, method=method)
    assert v.verdict == "agrees"
    np.testing.assert_array_equal(v.runs, DRAWS)
    np.testing.assert_array_equal(v.plain.coverage, 1.0)
    np.testing.assert_allclose(v.delta, 1e-13 * v.plain.mean, rtol=1e-9)  # the rounding
    assert np.all(v.plain.std < 1e-15)


def test_without_uncertainty_rounding_is_no_error(monkeypatch):
    with_method(monkeypatch, lower=lambda lower: lower + 2e-14, upper=lambda upper: upper - 2e-14)
    v = validate(gaussian(std=0.0))
    assert v.verdict == "agrees"
    np.testing.assert_array_equal(v.plain.coverage, 1.0)


def test_without_uncertainty_another_value_differs(monkeypatch):
    with_method(monkeypatch, upper=lambda upper: upper + 1e-9)
    v = validate(gaussian(std=0.0))
    assert np.all(v.stable)
    assert np.all(v.differs)


def test_a_method_without_a_result_differs(monkeypatch):
    undefined = np.array([1, np.nan])
    with_method(monkeypatch, **{k: lambda v: v * undefined for k in ("mean", "std", "lower")})
    v = validate(gaussian(poses=2), digits=1)
    assert v.agrees.tolist() == [True, False]
    assert v.differs.tolist() == [False, True]
    assert v.plain.coverage[0] > 0.99
    assert np.isnan(v.plain.coverage[1])
    low, high = v.plain.coverage_interval()
    assert np.isnan([low[1], high[1]]).all()
    assert low[0] < v.plain.coverage[0] < high[0]
    assert np.isfinite(v.upper).all()


@pytest.mark.parametrize("exaggerate", [1.0, 0.9])
def test_coverage_is_that_of_the_normal_distribution(exaggerate):
    v = validate(gaussian(exaggerate=exaggerate, poses=10), digits=1)
    expected = 1 - 2 * ndtr(-3 * exaggerate)
    low, high = v.plain.coverage_interval(0.9999)
    assert np.all((low < expected) & (expected < high))


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
    runs, share = v.plain.runs, ndtr(-2.0)
    assert v.plain.clipped == pytest.approx(runs * share, abs=4 * np.sqrt(runs * share))
    noise_alone = single(s).p_d(s.aircraft[0], np.zeros(4))
    np.testing.assert_allclose(v.lower, noise_alone, rtol=1e-12)
    assert np.all(v.differs)


def test_progress_is_in_poses():
    s, seen = paper(step=30), []
    with listening(lambda *steps: seen.append(steps)):
        validate(s, digits=1, method="form")
    done = [steps for steps in seen if steps[0] == "poses"]
    assert done[-1] == ("poses", len(s.aircraft), len(s.aircraft))


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
