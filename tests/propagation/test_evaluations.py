"""How often methods, checks and budgets evaluate the model: counts per pose, not seconds."""

import dataclasses
import math

import numpy as np
import pytest
from helpers import scenario

from radar_sense import analyses
from radar_sense.analyses.error_budget import error_budget
from radar_sense.model.detection_model import DetectionModel
from radar_sense.model.network import NetworkModel, Radar
from radar_sense.propagation import (
    METHODS,
    exceedance_probability,
    nonlinear,
    nonlinear_in_scenario,
    propagate,
    propagate_scenario,
    std_function,
    upper_bound,
    upper_bound_in_scenario,
)

RADARS = (1, 6)


def problem(radars):
    """The paper's scenario at seven poses, with a network of radars about the origin."""
    s = scenario(geometry__azimuth_deg={"start": 0, "stop": 180, "step": 30})
    if radars == 1:
        return s
    state = np.tile(s.radar, radars)
    state[0::4] += 2e4 * np.arange(radars)
    state[3::4] *= 0.4
    cov = np.kron(np.eye(radars), s.cov_radar[s.level])
    model = NetworkModel(tuple(Radar(s.model.radars[0].model, name=f"r{i}") for i in range(radars)))
    return dataclasses.replace(s, model=model, radar=state, cov_radar={s.level: cov})


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

    counted("linearize", "gradients")
    counted("unchecked_probit", "gradients")
    counted("p_d_and_probit", "gradients")
    counted("p_d", "values")

    def run(function, s):
        found.update(gradients=0, values=0)
        function(s)
        poses = len(s.aircraft) * len(s.model.models)
        return found["gradients"] / poses, found["values"] / poses

    return run


@pytest.fixture
def half_blind():
    """Six radars, of which one sees all poses, two see some and three see none."""
    s = problem(6)
    away = np.hypot(*(s.aircraft[:, i, None] - s.radar[i::4] for i in (0, 1)))
    limits = [math.inf, *np.median(away, axis=0)[1:3], *[1.0] * 3]
    radars = zip(s.model.radars, limits, strict=True)
    return dataclasses.replace(
        s,
        model=NetworkModel(tuple(dataclasses.replace(r, max_range=limit) for r, limit in radars)),
    )


#: Gradients of each radar behind the second derivatives: two along each of its 3 + 4 axes, and one.
EXPANSION = 2 * (3 + 4) + 1
#: Gradients of each radar in a check: one along each of its axes, and one.
ONE_SIDED = 3 + 4 + 1


#: Most gradients and values of each method. FORM searches nine extremes, with one or two each.
METHOD_COUNTS = {"linear": (1, 0), "probit": (1, 1), "form": (19, 1)}


@pytest.mark.parametrize("radars", RADARS)
@pytest.mark.parametrize("method", METHODS)
def test_evaluations_of_a_method(method, radars, count):
    gradients, values = count(lambda s: propagate_scenario(s, method=method), problem(radars))
    more = EXPANSION if method == "form" else 0
    assert more + 1 <= gradients <= more + METHOD_COUNTS[method][0]
    one_computation = method == "probit" and radars == 1  # of P_D and z
    assert values == (0 if one_computation else METHOD_COUNTS[method][1])


@pytest.mark.parametrize("radars", RADARS)
@pytest.mark.parametrize("method", METHODS)
def test_evaluations_of_one_bound(method, radars, count):
    def bound(s):
        cov = s.cov_aircraft, s.cov_radar[s.level]
        return upper_bound(s.model, s.aircraft, s.radar, *cov, method=method)

    gradients, values = count(bound, problem(radars))
    assert 1 <= gradients <= (EXPANSION + 2.5 if method == "form" else 1)
    assert values == 0


@pytest.mark.parametrize("radars", RADARS)
@pytest.mark.parametrize("method", METHODS)
def test_evaluations_of_a_check(method, radars, count):
    """No draws are needed on the paper's scenario. FORM is checked while it is computed."""
    s = problem(radars)
    found = propagate_scenario(s, method=method)
    gradients, values = count(lambda s: nonlinear_in_scenario(s, found, method=method), s)
    assert (gradients, values) == ((0, 0) if method == "form" else (ONE_SIDED, 2))


@pytest.mark.parametrize("radars", RADARS)
@pytest.mark.parametrize("method", METHODS)
def test_evaluations_of_a_budget(method, radars, count):
    """First order takes one gradient beside the total's; FORM takes one expansion beside it."""
    s = problem(radars)
    gradients, _ = count(lambda s: error_budget(s, method), s)
    if method == "form":
        sources = 4 if radars == 1 else 2 + radars + 1 + 2 * radars
        assert gradients <= 2 * EXPANSION + 19 * (1 + sources)
    else:
        assert gradients == 2


def test_radars_that_do_not_see_a_pose_cost_form_nothing(half_blind, count):
    s = half_blind
    share = s.model.visible(s.aircraft, s.radar).mean()
    assert 1 / 6 < share < 1 / 2
    gradients, _ = count(lambda s: propagate_scenario(s, method="form"), s)
    assert EXPANSION < gradients / share <= EXPANSION + METHOD_COUNTS["form"][0]


def test_form_of_the_radars_that_see_a_pose(half_blind):
    """A pose has the same moments as in a network of the radars that see the pose."""
    s = half_blind
    moments, upper = propagate_scenario(s, method="form"), upper_bound_in_scenario(s, method="form")
    above = exceedance_probability(s, 0.3, method="form")
    std = std_function(s, method="form")(s.cov_aircraft, 2.0 * s.cov_shared)
    for i, seen in enumerate(s.model.visible(s.aircraft, s.radar)):
        places = np.flatnonzero(np.repeat(seen, 4))
        alone = dataclasses.replace(
            s.at_poses(np.array([i])),
            model=NetworkModel(tuple(np.array(s.model.radars, dtype=object)[seen])),
            radar=s.radar[places],
            cov_radar={s.level: s.cov_radar[s.level][np.ix_(places, places)]},
        )
        expected = propagate_scenario(alone, method="form")
        for name in ("p_d", "mean", "std", "lower", "upper"):
            assert getattr(moments, name)[i] == pytest.approx(getattr(expected, name)[0], rel=1e-9)
        assert upper[i] == pytest.approx(expected.upper[0], rel=1e-6)
        assert above[i] == pytest.approx(exceedance_probability(alone, 0.3, method="form")[0])
        double = std_function(alone, method="form")(alone.cov_aircraft, 2.0 * alone.cov_shared)
        assert std[i] == pytest.approx(double[0], rel=1e-9)
        assert std[i] > moments.std[i]


@pytest.mark.parametrize("method", METHODS)
def test_no_poses_give_no_moments(method, half_blind):
    s = half_blind
    states = s.model, s.aircraft[:0], s.radar, s.cov_aircraft, s.cov_radar[s.level]
    assert propagate(*states, method=method).std.shape == (0,)
    assert upper_bound(*states, method=method).shape == (0,)
    assert nonlinear(*states, method=method).shape == (0,)


def once_checked(method):
    """Gradients of a propagation and its check."""
    if method == "form":
        return EXPANSION + METHOD_COUNTS["form"][0]
    return METHOD_COUNTS[method][0] + ONE_SIDED


@pytest.mark.parametrize("radars", RADARS)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "name", ["variance", "budget", "sensitivity", "montecarlo", "coverage_map"]
)
def test_evaluations_of_an_analysis(name, method, radars, count):
    """The radars of a network by themselves cost one propagation more, of one radar each."""
    s = problem(radars).with_analysis(runs=10)
    total, levels = once_checked(method), len(s.cov_radar)
    itself = (EXPANSION + 19 if method == "form" else 1) if radars > 1 else 0
    cells, options = 1.0, {}
    if name == "coverage_map":
        options = {"step_km": 200.0, "upper": True}
        size = analyses.coverage_map(s, **options).table["p_d"].size
        cells = 1 + size / len(s.aircraft)  # and the poses of the scenario
        assert size <= 20 * 20  # the cells at which the method is checked
    gradients, values = count(lambda s: getattr(analyses, name)(s, method=method, **options), s)
    sources = 4 if radars == 1 else 2 + radars + 1 + 2 * radars
    most_gradients = {
        "variance": total + itself,
        "budget": total + itself + (EXPANSION + 19 * sources if method == "form" else 1),
        "sensitivity": levels * (total + itself),
        "montecarlo": total + itself,
        "coverage_map": cells * (EXPANSION + 2.5 if method == "form" else 1) + (cells - 1) * total,
    }[name]
    assert gradients <= most_gradients
    # the check of the map draws at suspect cells
    in_map = cells + (cells - 1) * (100 if method == "form" else 3)
    most_values = {"montecarlo": 10 + 4, "coverage_map": in_map, "sensitivity": 4 * levels}
    assert values <= most_values.get(name, 5)


@pytest.mark.parametrize("radars", RADARS)
def test_evaluations_of_an_analysis_without_a_method(radars, count):
    """Comparing takes each method once, and each check once."""
    s = problem(radars).with_analysis(runs=10)
    gradients, values = count(analyses.compare, s)
    assert gradients <= 1 + sum(once_checked(method) for method in METHODS)
    assert values <= 10 + 8
    for name in ("detectors", "rcs"):
        gradients, values = count(getattr(analyses, name), s)
        assert (gradients, values) <= (0, 2)


#: Most gradients of each ray of a radar: the ends of the band are searched by most methods.
RANGE_COUNTS = {"linear": 12, "probit": 260, "form": 900}


@pytest.mark.parametrize("radars", RADARS)
@pytest.mark.parametrize("method", METHODS)
def test_evaluations_of_ranges(method, radars, count):
    """Each ray is sampled once with values of P_D. The gradients are at the ends of the band."""
    s = problem(radars)
    bearings = 6
    gradients, values = count(
        lambda s: analyses.detection_range(s, method=method, step_deg=360 / bearings), s
    )
    rays = bearings / len(s.aircraft)
    assert gradients <= RANGE_COUNTS[method] * rays
    assert values <= 900 * rays
