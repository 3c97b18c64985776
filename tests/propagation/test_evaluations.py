"""What methods take, in evaluations per pose and radar, and that what they leave out is nothing."""

import dataclasses
import math

import numpy as np
import pytest
from helpers import paper_network, scenario, with_arrays

import radar_sense as rs
from radar_sense.acceptance.requirement import Requirement
from radar_sense.acceptance.threshold import decide
from radar_sense.model.antenna import ElevationGain
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.network import NetworkModel
from radar_sense.model.radar import Level
from radar_sense.model.rcs import SpikeballRCS
from radar_sense.propagation import METHODS, band_of_scenario, distribution, propagate_scenario
from radar_sense.propagation.draws import estimate
from radar_sense.propagation.staged import FIRST, GROWTH, LAST, PRECISE, StagedDraws

#: Gradients of each radar behind the second derivatives: two along each of its 3 + 4 axes, and one.
EXPANSION = 2 * (3 + 4) + 1
#: Most gradients of the search for one extreme, and for the nine of mean and σ: one or two each.
ONE_EXTREME, NINE_EXTREMES = 2.5, 11


def problem(radars, step_deg=30, level="medium"):
    """The paper's scenario at some poses, with one radar, or several about the origin."""
    places = [(2e4 * i, 0, 0) for i in range(radars)]
    constants = [167.0 * (1 if radars == 1 else 0.4)] * radars
    s = paper_network(places, constants, poses=slice(None, None, 2 * step_deg))
    return s.with_analysis(level=level)


@pytest.fixture
def count(monkeypatch):
    """Return a function that counts evaluations of a radar's model, per pose and radar."""
    found = {"gradients": 0, "values": 0}

    def counted(name, kind):
        method = getattr(DetectionModel, name)

        def wrapped(self, aircraft, radar):
            shape = np.broadcast_shapes(np.shape(aircraft)[:-1], np.shape(radar)[:-1])
            found[kind] += math.prod(shape)
            return method(self, aircraft, radar)

        monkeypatch.setattr(DetectionModel, name, wrapped)

    counted("unchecked_probit", "gradients")
    counted("unchecked_p_d", "values")

    def run(function, s):
        found.update(gradients=0, values=0)
        function(s)
        poses = len(s.aircraft) * len(s.model.models)
        return found["gradients"] / poses, found["values"] / poses

    return run


@pytest.mark.parametrize("radars", [1, 6])
def test_evaluations_of_a_method(radars, count):
    for method, most in (("linear", 1), ("probit", 1), ("form", EXPANSION + NINE_EXTREMES)):
        s = problem(radars)
        gradients, values = count(lambda s, m=method: propagate_scenario(s, method=m), s)
        assert gradients <= most
        assert values <= (method == "form")  # which computes P_D apart
        of_bound, _ = count(lambda s, m=method: distribution(s, m).quantile(3.0), s)
        assert of_bound <= (most if most == 1 else EXPANSION + ONE_EXTREME)


@pytest.mark.parametrize("method", ["form", "montecarlo", "automatic"])
def test_states_without_errors_have_p_d_without_rounding(method):
    """As those of a source at a pose where its radar is out of sight."""
    certain = problem(2).states().with_covariances(np.zeros((6, 6)), np.zeros((14, 14)), ((), ()))
    found, nominal = METHODS[method](certain), problem(2).p_d()
    for number in (found.quantile(3.0), found.quantile(-3.0), found.mean):
        assert number == pytest.approx(nominal, abs=1e-15)
    assert not found.std.any()
    drawn = estimate(certain, FIRST, 3.0, 0.5)
    assert not drawn.errors.any()
    assert drawn.above[0].tolist() == (nominal > 0.5).tolist()


def test_draws_of_one_radar_with_errors(count):
    """They take one value of the other radars."""
    s = problem(6)
    states = s.states()
    covariance = np.zeros_like(states.cov_radar[0])
    covariance[:7, :7] = states.cov_radar[0, :7, :7]
    alone = states.with_covariances(np.zeros((6, 6)), covariance, ((),) * 6)
    found = {}
    _, values = count(lambda _: found.update(drawn=estimate(alone, FIRST, 3.0)), s)
    assert values < FIRST / 6 * 1.2
    u = np.random.default_rng(5).standard_normal((100_000, 4)) * np.sqrt(np.diag(covariance)[:4])
    for i, pose in enumerate(s.aircraft):
        radar = np.repeat(s.radar[np.newaxis], len(u), axis=0)
        radar[:, :4] += u
        p_d = s.model.p_d(pose, np.maximum(radar, np.where(np.arange(24) % 4 == 3, 0, -np.inf)))
        (mean, std), (of_mean, of_std) = (each[:, i] for each in found["drawn"].moments)
        assert mean == pytest.approx(p_d.mean(), abs=4 * of_mean + 5e-5)
        assert std == pytest.approx(p_d.std(), abs=4 * of_std + 0.01 * p_d.std())
        upper, error = (each[1, i] for each in found["drawn"].bounds)
        assert upper == pytest.approx(np.quantile(p_d, 0.99865), abs=4 * error + 0.003)


def test_the_threshold_test_goes_on_with_the_draws_of_the_band(count):
    """It makes the runs of the path, and no draws again."""
    s, p_max = problem(2).with_analysis(method="automatic"), 0.99
    band = propagate_scenario(s, p_max=p_max)
    plain, alone = propagate_scenario(s), band_of_scenario(s, method="automatic")
    for name in ("p_d", "lower", "upper", "error"):
        for other in (plain, alone):
            np.testing.assert_array_equal(getattr(band, name), getattr(other, name))
    again, on = decide(s, Requirement(p_max)), decide(s, Requirement(p_max), band.drawn)
    for name in ("holds", "violated"):
        np.testing.assert_array_equal(getattr(on, name), getattr(again, name))
    _, values = count(lambda s: decide(s, Requirement(p_max), band.drawn), s)
    assert values <= again.wanted


@pytest.mark.parametrize(
    ("lobes", "gain_deg", "draws"), [(36, 4, FIRST), (45, 4, PRECISE), (36, 2, PRECISE)]
)
def test_a_first_look_is_precise_where_errors_are_wider_than_a_lobe(lobes, gain_deg, draws):
    """Within 3 sigma the yaw is known to 9 deg, and the tilt to 3 deg."""
    s = scenario(uncertainty__aircraft={"position_m": 1, "attitude_deg": 1.5}).at_poses(slice(2))
    gain = ElevationGain(np.radians([0.0, gain_deg]), [0.0, -10.0])
    model = dataclasses.replace(s.radars[0].model, rcs=SpikeballRCS(lobes, 1, 1), factors=(gain,))
    levels = {s.level: Level(np.zeros((4, 4)), errors={"tilt": np.radians(0.5)})}
    radar = dataclasses.replace(s.radars[0], model=model, levels=levels)
    staged = StagedDraws.of_p_d(dataclasses.replace(s, radars=(radar,)).states(), 3.0)
    assert staged.until(lambda rows, found: rows >= 0, LAST).draws.tolist() == [draws] * 2


def test_form_of_the_radars_that_see_a_pose():
    """A pose has the same numbers as in a network of the radars that see the pose.

    Of six radars one sees all poses, two see some and three see none.
    """
    s = problem(6)
    away = np.hypot(*(s.aircraft[:, i, None] - s.radar[i::4] for i in (0, 1)))
    limits = [math.inf, *np.median(away, axis=0)[1:3], *[1.0] * 3]
    radars = zip(s.model.radars, limits, strict=True)
    limited = tuple(dataclasses.replace(r, max_range=limit) for r, limit in radars)
    s = with_arrays(s, model=NetworkModel(limited))
    found = distribution(s, "form")
    moments, above = propagate_scenario(s, method="form"), found.exceedance(0.3)
    for i, seen in enumerate(s.model.visible(s.aircraft, s.radar)):
        places = np.flatnonzero(np.repeat(seen, 4))
        alone = with_arrays(
            s.at_poses(np.array([i])),
            model=NetworkModel(tuple(np.array(s.model.radars, dtype=object)[seen])),
            radar=s.radar[places],
            cov_radar={s.level: s.cov_radar[np.ix_(places, places)]},
        )
        expected = propagate_scenario(alone, method="form")
        for name in ("p_d", "mean", "std", "lower", "upper"):
            assert getattr(moments, name)[i] == pytest.approx(getattr(expected, name)[0], rel=1e-9)
        assert above[i] == pytest.approx(distribution(alone, "form").exceedance(0.3)[0])


@pytest.mark.parametrize("method", METHODS)
def test_a_distribution_for_other_covariances(method):
    """FORM differentiates over a region of the first covariances, which moves σ a little."""
    s = problem(2, step_deg=60, level="low")
    states = s.states()
    double = states.with_covariances(states.cov_aircraft, 2 * states.cov_radar, states.tolerances)
    first = distribution(s, method)
    changed, fresh = first.with_covariances(double), METHODS[method](double)
    rtol = 3e-3 if method in ("form", "automatic") else 1e-12
    for value in (lambda d: d.std, lambda d: d.mean, lambda d: d.quantile(-3.0)):
        np.testing.assert_allclose(value(changed), value(fresh), rtol=rtol)
    assert np.all(changed.std > first.std)


def test_a_second_question_gets_the_draws_that_it_would_alone():
    """Each question wants other numbers of draws at the poses."""
    states = rs.load_scenario().at_poses(slice(0, None, 100)).states()
    staged, wanted = StagedDraws.of_p_d(states, 3.0), FIRST * GROWTH ** np.arange(4)
    for last in (np.resize(wanted, len(states)), np.resize(wanted[::-1], len(states))):
        drawn = staged.until(lambda rows, found, last=last: found.draws >= last[rows], LAST)
        np.testing.assert_array_equal(drawn.draws, last)
        for pose, draws in enumerate(last):
            alone = estimate(states.at(np.array([pose])), int(draws), 3.0)
            assert np.array_equal(alone.bounds[0][:, 0], drawn.bounds[0][:, pose])
