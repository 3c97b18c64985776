"""The verdict on a method, mostly for a model that is linear: all quantiles are then known."""

import dataclasses

import numpy as np
import pytest
from helpers import known_to, scenario, with_arrays

from radar_sense import cost
from radar_sense.axis import azimuth
from radar_sense.model.network import NetworkModel
from radar_sense.montecarlo import adaptive
from radar_sense.montecarlo.adaptive import PRECISE, QUANTITIES, judge, numerical_tolerance
from radar_sense.progress import listening
from radar_sense.propagation import Moments, propagate_scenario
from radar_sense.scenario_file.load import load_scenario

LOWER = 2


@dataclasses.dataclass(frozen=True)
class LinearModel(NetworkModel):
    """P_D = 0.5 + slope · (north of the aircraft + east of the radar), in metres."""

    by_aircraft: float = 0.0
    by_radar: float = 0.0
    exaggerate: float = 1.0

    def unchecked_p_d(self, aircraft, radar):
        return 0.5 + self.by_aircraft * aircraft[..., 0] + self.by_radar * radar[..., 1]

    def moments(self, states):
        p_d = np.full(len(states), 0.5)
        std = np.full_like(p_d, self.exaggerate * np.hypot(self.by_aircraft, self.by_radar))
        lower, upper, error = p_d - 3 * std, p_d + 3 * std, np.zeros_like(p_d)
        return Moments(p_d=p_d, mean=p_d, std=std, lower=lower, upper=upper, error=error)


def gaussian(std=0.03, shared=0.0, poses=4, exaggerate=1.0, seed=1):
    """States with a Gaussian P_D around 0.5. The radar error is common to all poses."""
    paper = scenario(analysis={"level": "medium", "seed": seed})
    slope = std * np.array([np.sqrt(1 - shared), np.sqrt(shared)])
    s = with_arrays(
        paper,
        axis=azimuth(np.arange(float(poses))),
        aircraft=np.tile([0.0, 0, -1e5, 0, 0, 0], (poses, 1)),
        radar=np.array([0.0, 0.0, 0.0, 167.0]),
        cov_aircraft=np.diag([1.0, 0, 0, 0, 0, 0]),
        cov_radar={"medium": np.diag([0, 1.0, 0, 0])},
    )
    model = LinearModel(paper.model.radars, *slope, exaggerate)
    return dataclasses.replace(s.states(), model=model)


def paper(level="medium", **azimuth):
    s = scenario(geometry__azimuth_deg={"start": 0, "stop": 180, "step": 30, **azimuth})
    return s.with_analysis(level=level)


def validate(s, *, method="linear", digits=2, **changes):
    """Judge a method for a scenario or for states, with a function of some of its values."""
    linear = isinstance(s.model, LinearModel)
    states = s if linear else s.states()
    band = s.model.moments(s) if linear else propagate_scenario(s, method=method)
    changed = {name: f(getattr(band, name)) for name, f in changes.items()}
    return judge(states, dataclasses.replace(band, **changed), digits)


@pytest.mark.parametrize(
    ("std", "digits", "delta"),
    [
        (0.00035, 2, 0.000005),  # 7.9.2, examples 1 to 3
        (0.00035, 1, 0.00005),
        (2.0, 1, 0.5),
        (0.0999, 2, 0.005),  # rounded to 0.10: 10 · 10^-2
        (0.0994, 2, 0.0005),  # 99 · 10^-3
    ],
)
def test_tolerance_is_half_a_unit_of_the_last_digit(std, digits, delta):
    assert numerical_tolerance(std, digits) == delta
    assert np.isnan(numerical_tolerance(float("nan"), digits))


def test_where_first_order_is_exact_it_agrees():
    v = validate(gaussian(poses=20, shared=0.3), digits=1)
    assert v.word == "agrees"
    assert np.all(v.agrees & v.stable)
    assert not np.any(v.differs | v.undecided)
    np.testing.assert_array_equal(v.delta, 0.005)
    exact = np.array([[0.5], [0.03], [0.41], [0.59]])
    assert np.all(abs(v.drawn - exact) < 4 * v.error)
    assert np.all(2 * v.error <= v.delta)
    np.testing.assert_array_equal(v.distance, abs(v.values - v.drawn))


def test_the_standard_errors_are_those_of_the_draws():
    """Over 40 seeds all values scatter about the truth as their standard errors say."""
    found = [validate(gaussian(std=0.04, poses=1, seed=seed), digits=1) for seed in range(40)]
    exact = np.array([0.5, 0.04, 0.38, 0.62])
    off = np.array([(v.drawn[:, 0] - exact) / v.error[:, 0] for v in found])
    # of 160 normals the largest is beyond 4.5 once in 900 times
    assert np.max(abs(off)) < 4.5
    # χ² with 40 degrees: 0.6 to 1.4 in all four but once in 10 000 times
    scatter = np.sqrt(np.mean(off**2, axis=0))
    assert np.all(scatter < 1.45), scatter
    assert np.all(scatter[:2] > 0.5), scatter
    # the error of a bound has the heaviest draw of its tail, which is half of it here
    assert np.all(scatter[2:] > 0.3), scatter
    assert len({v.drawn[LOWER, 0] for v in found}) == 40


def test_no_standard_error_is_too_small_by_chance_at_one_pose_of_hundreds():
    """`form` is right to 0.00001 at Low, by the reference of `tests/reference`."""
    s = load_scenario().with_analysis(level="low")
    form = propagate_scenario(s, method="form")
    values = np.stack([getattr(form, name) for name in QUANTITIES])
    drawn, error = adaptive.draw_in_parts(s.states(), 4096)
    off = abs(drawn - values)
    assert np.max(np.where(off > 5e-5, off / error, 0)) < 4.5


def test_a_bound_where_the_tail_is_steep_is_not_biased(monkeypatch):
    """The lower bound is 0.0895, between 0.0870 and 0.0925, by 12e6 draws of another program."""
    s = scenario(
        radar={"position_m": [0, 0, -20], "constant": 20, "p_fa": 1e-4},
        aircraft={
            "attitude_deg": [0, 0, 100],
            "rcs": {"model": "spikeball", "lobes": 6, "amplitude_m2": 5, "floor_m2": 0.15},
        },
        geometry__azimuth_from="north",
        geometry__range_km=450,
        geometry__down_km=-6,
        geometry__azimuth_deg={"start": 0, "stop": 0, "step": 1},
        **known_to(40, 9, rcs_db=3, position_m=500, constant=5),
    )
    monkeypatch.setattr(adaptive, "MOST_DRAWS", 2**18)
    v = validate(s, method="automatic")
    assert v.draws[0] == 2**18
    assert v.word != "differs"
    assert v.drawn[LOWER, 0] == pytest.approx(0.0895, abs=0.007)


@pytest.mark.parametrize(("off", "never"), [(0.8, "differs"), (2.5, "agrees")])
def test_nearly_the_tolerance_does_not_differ_and_clearly_above_does_not_agree(off, never):
    for seed in range(5):
        states = gaussian(std=0.04, poses=1, seed=seed)
        v = validate(states, digits=1, upper=lambda u: u + off * 0.005)
        assert v.delta[0] == 0.005
        assert v.word != never, seed


@pytest.mark.parametrize(("digits", "word"), [(1, "agrees"), (2, "differs")])
def test_a_wrong_deviation_is_told_where_the_digits_show_it(digits, word):
    """3 % of 0.09 is 0.0027: within half a unit of 0.03, not within one of 0.030."""
    v = validate(gaussian(exaggerate=1.03, poses=2), digits=digits)
    assert v.word == word
    assert np.all(v.differs) == (word == "differs")


@pytest.mark.parametrize("name", QUANTITIES)
@pytest.mark.parametrize("sign", [-1, 1])
def test_one_value_is_enough_to_differ(name, sign):
    v = validate(
        gaussian(poses=2), digits=1, **{name: lambda x: x + sign * 0.015 * np.array([1, 0])}
    )
    assert v.agrees.tolist() == [False, True]
    assert v.differs.tolist() == [True, False]
    assert v.word == "differs"


def test_too_few_draws_decide_nothing(monkeypatch):
    """Also where the values of a method are those that were drawn."""
    monkeypatch.setattr(adaptive, "MOST_DRAWS", 2 * PRECISE)
    v = validate(gaussian(poses=3), digits=3)
    seen = dict(zip(QUANTITIES, v.drawn, strict=True))
    same = validate(gaussian(poses=3), digits=3, **{n: lambda _, n=n: seen[n] for n in seen})
    assert not np.any(same.distance)
    for found in (v, same):
        np.testing.assert_array_equal(found.draws, 2 * PRECISE)
        assert not np.any(found.stable | found.agrees | found.differs)
        assert np.all(found.undecided)
        assert found.word == "undecided"


def test_a_pose_does_not_depend_on_the_others():
    s, seen = paper("high", step=30), []
    with listening(lambda *steps: seen.append(steps)):
        together = validate(s, method="form")
    assert len(set(together.draws)) > 1
    alone = validate(s.at_poses(slice(3)), method="form")
    np.testing.assert_array_equal(together.draws[:3], alone.draws)
    np.testing.assert_allclose(together.drawn[:, :3], alone.drawn, rtol=1e-12)
    np.testing.assert_array_equal(together.agrees[:3], alone.agrees)
    # progress is in poses
    assert [done for done in seen if done[0] == "poses"][-1] == ("poses", len(together.draws), 7)


def test_without_uncertainty_rounding_is_no_error_and_another_value_is():
    v = validate(gaussian(std=0.0), lower=lambda x: x + 2e-14, upper=lambda x: x - 2e-14)
    assert v.word == "agrees"
    other = validate(gaussian(std=0.0), upper=lambda upper: upper + 1e-6)
    assert np.all(other.stable & other.differs)


def test_what_no_output_shows_is_no_difference():
    """A deviation below 1e-6 is printed as 0; a tenth of it more is nothing to act on."""
    assert validate(gaussian(std=1e-9), std=lambda std: 1.1 * std).word == "agrees"
    assert validate(gaussian(std=1e-5), std=lambda std: 1.1 * std).word == "differs"


def test_a_method_without_a_result_differs():
    undefined = np.array([1, np.nan])
    wrong = {name: lambda value: value * undefined for name in ("mean", "std", "lower")}
    v = validate(gaussian(poses=2), digits=1, **wrong)
    assert v.agrees.tolist() == [True, False]
    assert v.differs.tolist() == [False, True]
    assert np.isfinite(v.drawn).all()


def test_a_long_computation_says_so_before_it_starts(monkeypatch, caplog):
    caplog.set_level("WARNING", "radar_sense")  # a command with -q hears none
    monkeypatch.setattr(cost, "SECONDS", 2 * PRECISE * cost.EMPHASIS / cost.RATE)
    validate(gaussian(std=0.02, poses=1), digits=1)
    assert not caplog.records
    v = validate(gaussian(std=0.09, poses=1), digits=1)
    (said,) = caplog.messages
    assert "fewer poses take less" in said  # there are no fewer digits
    # the draws that it says are those that it takes, to some half
    draws = float(said.partition(" ")[0].replace(",", ""))
    assert draws == pytest.approx(v.draws[0], rel=0.5)
