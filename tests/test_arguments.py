"""Wrong arguments in Python raise an error of one line with the name of the argument, at once."""

import dataclasses
import json
import re
from fractions import Fraction

import numpy as np
import pytest
from helpers import CONFIGS

import radar_sense as rs
from radar_sense.errors import describe
from radar_sense.propagation import METHODS

PAPER = rs.load_scenario()
(RADAR,) = PAPER.radars
MODEL = RADAR.model
PATH = rs.load_scenario(CONFIGS / "path.yaml")
ANGLES = np.deg2rad(np.arange(0.0, 360.0, 10.0))


def scenario(**changes):
    return rs.Scenario(**{"radars": [RADAR], "geometry": PAPER.geometry} | changes)


def changed(**changes):
    return dataclasses.replace(RADAR, **changes)


def model(**changes):
    return dataclasses.replace(MODEL, **changes)


def level(**changes):
    return rs.Level(np.eye(4), **changes)


def path(**changes):
    return scenario(geometry=dataclasses.replace(PATH.geometry, **changes))


def propagated(of=MODEL, **options):
    names = ("aircraft", "radar", "cov_aircraft", "cov_radar")
    return rs.propagate(of, **{**{name: getattr(PAPER, name) for name in names}, **options})


class Half:
    """A detector that lacks the probit."""

    def p_d(self, snr, p_fa):
        return snr * p_fa


WRONG = {
    "detector must be a detector such as Marcum(), got 'marcum'": lambda: model(detector="marcum"),
    "detector has no linearize_probit, which a detector has": lambda: model(detector=Half()),
    "rcs must be an RCS model": lambda: model(rcs=rs.ConstantRCS),
    "p_fa must be a number greater than 0 and less than 1, got '1e-4'": lambda: model(p_fa="1e-4"),
    "a must be a number greater than 0, got -1": lambda: rs.EllipsoidRCS(a=-1, b=1, c=1),
    "cfar must be CellAveraging, OrderedStatistics or None, got 'os'": lambda: rs.Marcum(cfar="os"),
    "binary must be BinaryIntegration or None, got (2, 3)": lambda: rs.Marcum(binary=(2, 3)),
    "lobes must be a whole number": lambda: rs.SpikeballRCS(lobes=2.5, amplitude=1, floor=1),
    "azimuth must be an array of real numbers": lambda: rs.TableRCS("a", [1, 2]),
    "peak_power must be a number": lambda: rs.TrackingRadar("a", 1, 1, 1, 1, 1, 0),
    "value must be greater than 0 if not in decibels": lambda: rs.Tolerance("a", 0, 1, 1, False),
    "power must be a whole number": lambda: rs.Tolerance("a", 1, 1, 0.5, False),
    "c_r with tolerances must not be correlated": lambda: rs.Level(
        np.eye(4) + 0.1, (rs.Tolerance("a", 1, 0.1, 1, False),)
    ),
    "method must be one of legs, smooth, got 'leg'": lambda: path(method="leg"),
    "p_max must be a number": lambda: rs.propagate_scenario(PAPER, p_max="a"),
    "scenario must be a Scenario": lambda: rs.propagate_scenario(None),
    "confidence must be a number greater than 0 and less than 1": lambda: rs.monte_carlo(
        PAPER.at_poses(slice(2)), 8
    ).coverage_interval(95),
    "model must be a DetectionModel, got 'x'": lambda: rs.Radar("x"),
    "horizon must be Horizon or None, got True": lambda: rs.Radar(MODEL, horizon=True),
    "name must be text, got 3": lambda: rs.Radar(MODEL, name=3),
    "radars must be a tuple of one radar or more": lambda: rs.NetworkModel(rs.Radar(MODEL)),
    "radars must be of class Radar": lambda: rs.NetworkModel((MODEL,)),
    "radars must be a tuple of one radar or more, got <Radar": lambda: scenario(radars=RADAR),
    "radars must be of class Radar, got 3": lambda: scenario(radars=[3]),
    "geometry must be poses or a path, States.of(aircraft) or Path.of(time_s, aircraft), got "
    "'orbit'": lambda: scenario(geometry="orbit"),
    "shapes of poses must broadcast against each other, got (3,), (2,)": (
        lambda: MODEL.p_d(np.ones((3, 6)), np.ones((2, 4)))
    ),
    "shapes of poses must broadcast against each other, got (361,), (), (4,), ()": (
        lambda: propagated(cov_aircraft=np.stack([np.eye(6)] * 4))
    ),
    "shapes of poses must broadcast against each other, got (361,), (4,), ()": (
        lambda: MODEL.linearize(PAPER.aircraft, PAPER.radar).std([np.eye(6)] * 4, np.eye(4))
    ),
    "time_s must be finite, one for each state, got (2,) for (3, 6)": (
        lambda: rs.Path.of([0, 1], np.ones((3, 6)))
    ),
    "path must be the name of a file; parse_scenario reads text": (
        lambda: rs.load_scenario("name: a\nradar: {}\n")
    ),
    "std must be a number not less than 0, got -1": lambda: rs.Tolerance("a", 1, -1, 1, True),
    "aircraft states must have shape (..., 6) for north": lambda: PAPER.at_states(np.ones((1, 3))),
    "aircraft states must be an array of numbers": lambda: PAPER.at_states([[1, 2], [3]]),
    "changes must be values by key, got ['a=1']": lambda: rs.load_scenario(None, ["a=1"]),
    "axis must be an Axis": lambda: path(axis="azimuth"),
    "time_s must increase from pose to pose": lambda: path(time_s=np.zeros(len(PATH.axis))),
    "origin must be latitude and longitude [rad] and height [m]": lambda: path(origin=(1, 2)),
    "levels must have names, the name of a level, up to 40 letters A to Z, digits, '_' or '-', "
    "got '10 m, 1 dB'": lambda: changed(levels={"10 m, 1 dB": RADAR.levels["low"]}),
    "tolerances must have a key each": lambda: level(
        tolerances=[rs.Tolerance("loss_db", x, 0.5, -1, True) for x in (2.0, 3.0)]
    ),
    "key must be a name of up to": lambda: rs.Tolerance("a,b", 1, 1, 1, False),
    "losses_db must be losses by name, got None": lambda: rs.TrackingRadar(
        1e5, 30, 0.1, 1e6, 290, 3, 5, losses_db=None
    ),
    "origin must be latitude and longitude [rad] and height [m], got (1.35, 103.8, 0)": (
        lambda: rs.Horizon((1.35, 103.8, 0))
    ),
    "coordinate must be times": lambda: PATH.geometry.at(np.array([np.nan])),
    "changes must be values by key, got None": lambda: PAPER.with_keys(None),
    "mirror must be True or False, got 'no'": lambda: rs.load_rcs_table("a", mirror="no"),
    "method must be one of linear, probit, form, montecarlo, automatic, got ''": (
        lambda: rs.propagate_scenario(PAPER, method="")
    ),
    "levels must be a mapping": lambda: changed(levels=np.eye(4)),
    "levels['low'] must be a Level, got array": lambda: changed(levels={"low": np.eye(4)}),
    "radar state must have shape (4,) for north, east": lambda: changed(state=np.ones(3)),
    "radar covariance must have shape (4, 4), got (3, 3)": lambda: rs.Level(np.eye(3)),
    "names of radars must be the name of a radar, up to 40 letters A to Z, digits, '_' or '-', "
    "got '../x'": lambda: scenario(radars=[changed(name="../x")]),
    "tolerances must be a tuple of Tolerance, got (3,)": lambda: level(tolerances=(3,)),
    "errors['tilt'] must be a number not less than 0": lambda: level(errors={"tilt": "a"}),
    "errors must be one of attenuation, tilt, got 'tlt'": lambda: level(errors={"tlt": 0.1}),
    "errors must be a mapping, {'attenuation': 0.2}": lambda: level(errors=0.1),
    "levels['low'].errors['attenuation'] must be a number not less than 0 and not greater than 1, "
    "got 1.1": lambda: changed(
        model=dataclasses.replace(RADAR.model, factors=(rs.Attenuation(1e-5),)),
        levels={"low": level(errors={"attenuation": 1.1})},
    ),
    "model must be a DetectionModel or": lambda: propagated("x"),
    "beta must be a number greater than 0 and not greater than 10, got 0": (
        lambda: propagated(beta=0)
    ),
    "beta must be a number greater than 0 and not greater than 10, got 1e": (
        lambda: propagated(beta=1e300)
    ),
    "shared must be the name of a type": lambda: rs.Tolerance("a", 1, 1, 1, True, shared=1),
    "rectangular must be True or False, got 'no'": (
        lambda: rs.Tolerance("a", 1, 1, 1, True, rectangular="no")
    ),
    "decibels must be True or False, got nan": lambda: rs.Tolerance("a", 1, 1, 1, np.nan),
    "level must be one of low, medium, high, got array": lambda: scenario(level=np.zeros(2)),
    "level must be one of low, medium, high, got 0": lambda: scenario(level=0),
    "level must be one of low, medium, high, got 'medum'; did": lambda: scenario(level="medum"),
    "correlation_s must be a number not less than 0, or .inf, got nan": (
        lambda: dataclasses.replace(PAPER, correlation_s=np.nan)
    ),
    "correlation_s must be a number not less than 0, or .inf, got array": (
        lambda: scenario(correlation_s=np.zeros(2))
    ),
    "max_range must be a number greater than 0, or .inf, got array": (
        lambda: changed(max_range=np.ones(2))
    ),
    "source must be SourceFile or None, got 'x'": lambda: scenario(source="x"),
    "flight must be a Route or None, got 'x'": lambda: path(flight="x"),
    "azimuth must be finite and of shape (n,), with n > 0": lambda: rs.TableRCS([], []),
    "radars of one band must have the RCS of one and the same target: give them one object": (
        lambda: scenario(
            radars=[
                changed(name=name, model=model(rcs=rs.TableRCS(ANGLES, np.ones(36))))
                for name in ("a", "b")
            ]
        )
    ),
    "aircraft covariance must have shape": lambda: propagated(cov_aircraft=np.zeros((4, 4))),
    "radar covariance must have shape": lambda: propagated(cov_radar=np.zeros(4)),
    "workers must be a whole number": lambda: rs.monte_carlo(PAPER, runs=2, workers=0),
    "scenario must be a Scenario, as load_scenario returns, got 'x'": lambda: rs.monte_carlo("x"),
    "scenario must be a Scenario, as load_scenario returns, got 3": lambda: rs.analyses.variance(3),
    "poses must select one pose or more, got slice": lambda: PAPER.at_poses(slice(0, 0)),
    "poses must be a slice or an array of numbers": lambda: PAPER.at_poses(np.array([361])),
    "poses of a path must stay in order": lambda: PATH.at_poses(slice(None, None, -1)),
    "poses of a path must stay in order, got array([0, 0, 1])": (
        lambda: PATH.at_poses(np.array([0, 0, 1]))
    ),
    "text must be YAML as text, got {}": lambda: rs.parse_scenario({}),
    "path must be text or a Path, got 3": lambda: rs.load_scenario(3),
    "max_gap_s must be a number greater than 0, got 'a'": lambda: rs.load_route("a", max_gap_s="a"),
    "altitude_above must be one of ellipsoid, sea, pressure, got 'see'; did you mean 'sea'?": (
        lambda: rs.load_route("a", altitude_above="see")
    ),
    "icao24 must be 6 digits 0 to 9 and a to f, got 3": lambda: rs.load_route("a", icao24=3),
    "aircraft must have shape (n, 6) for north, east, down, roll, pitch, yaw, got (2, 5)": (
        lambda: scenario(geometry=rs.States.of(np.zeros((2, 5))))
    ),
    "aircraft must be an array of real numbers, got <U1": lambda: rs.States.of([["a"] * 6]),
    "aircraft states must be finite, got nan for down": (
        lambda: scenario(geometry=rs.States.of([0, 0, np.nan, 0, 0, 0]))
    ),
    "covariance of the aircraft must have shape (6, 6) or (2, 6, 6), got (3, 6, 6)": (
        lambda: scenario(geometry=rs.States.of(np.zeros((2, 6)), np.ones((3, 6, 6))))
    ),
    "covariance of the aircraft at pose 1 is not positive semidefinite": (
        lambda: scenario(geometry=rs.States.of(np.zeros((2, 6)), [np.eye(6), np.eye(6) - 0.5]))
    ),
    "radar constants must be greater than 0, got -1": lambda: changed(state=[0, 0, 0, -1]),
    "every radar of a scenario needs a state": lambda: scenario(radars=[changed(state=None)]),
    "every radar needs a level": lambda: scenario(radars=[changed(levels={})]),
    "all radars must have the levels low, medium, high, radar 'b' has x": (
        lambda: scenario(radars=[changed(name="a"), changed(name="b", levels={"x": level()})])
    ),
    "runs must be a whole number not less than 2": lambda: scenario(runs=1),
    "name must be a name of up to 100 letters": lambda: scenario(name="../x"),
    "time_s must have one value for each of 724": lambda: path(time_s=np.zeros(1)),
}


@pytest.mark.parametrize("says", WRONG)
def test_wrong_arguments_are_one_line(says):
    with pytest.raises(rs.InputError, match=f"^{re.escape(says)}") as error:
        WRONG[says]()
    assert "\n" not in str(error.value)


def test_numbers_in_arrays_without_axes_are_numbers():
    """NumPy reductions and `np.load` return such arrays."""

    def model(number):
        rcs = rs.EllipsoidRCS(a=number(0.15), b=number(0.13), c=number(0.21))
        detection = rs.DetectionModel(rcs=rcs, p_fa=number(1.7e-4))
        return rs.Radar(detection, max_range=number(1e6), scan_period=number(10.0))

    first, *others = map(model, (np.array, np.float64, float))
    for name in ("model", "max_range", "scan_period"):
        assert {getattr(other, name) for other in others} == {getattr(first, name)}
    assert type(first.model.rcs.a) is type(first.max_range) is float
    table = rs.TableRCS(ANGLES, np.ones(36), envelope=np.array(0.1))
    assert table.envelope == 0.1
    assert rs.SpikeballRCS(lobes=np.array(4), amplitude=1, floor=0).lobes == 4
    for wrong in (np.array(-1.0), np.array(np.nan), np.array(True), np.ones(1), np.array("1")):
        with pytest.raises(rs.InputError, match=r"^rcs must be a number greater than 0, got "):
            rs.ConstantRCS(wrong)


def test_numbers_of_numpy_are_written_and_taken(tmp_path):
    tolerance = rs.Tolerance("loss_db", np.int64(3), np.float32(0.5), np.int64(-1), np.bool_(True))
    made = rs.Level(np.eye(4), tolerances=[tolerance])
    few = dataclasses.replace(PATH.geometry, sea_level=np.float32(3))
    s = scenario(radars=[changed(levels={"low": made})], geometry=few, correlation_s=np.int64(60))
    result = rs.analyses.variance(s.at_poses(slice(2)), method="linear", k=np.array(2))
    assert len(result.save(tmp_path, ())) == 2
    found = rs.analyses.detection_range(PAPER, p_d=np.array(0.5), step_deg=90.0, method="linear")
    assert found.summary["p_d"] == [0.5]


def test_numbers_of_other_kinds_become_floats():
    third = Fraction(1, 3)
    model = rs.DetectionModel(rs.EllipsoidRCS(third, third, np.longdouble(third)), third)
    assert type(model.rcs.c) is type(model.p_fa) is float
    assert 0.99 < model.p_d(PAPER.aircraft[0], PAPER.radar) <= 1
    beam = rs.ElevationGain(np.array([0.0, 1]), np.array([0.0, -3]), tilt=third)
    assert type(beam.tilt) is float


def test_text_of_numpy_is_written(tmp_path):
    high, form = np.array(["high", "form"])
    result = rs.analyses.budget(PAPER.at_poses(slice(2)), level=high, method=form)
    assert len(result.save(tmp_path, (), command="radar-sense budget")) == 2
    record = json.loads((tmp_path / "paper_budget.json").read_text())
    assert record["command"] == ["radar-sense budget"]
    assert "level: high" in "\n".join(rs.analyses.check(PAPER, level=high).report)
    assert type(scenario(level=high, name=np.str_("a")).name) is str


def made_of(pose, covariance, time, state, matrix):
    """Return a scenario, a path and a route that are made of these arrays."""
    states, own = np.broadcast_to(pose, (3, 6)), np.broadcast_to(covariance, (3, 6, 6))
    radar = changed(state=state, levels={"low": rs.Level(matrix)})
    s = scenario(radars=[radar], geometry=rs.States.of(states, own), level="low")
    return s, rs.Path.of(time, states, own), rs.Route(time, states, None, True)


def arrays_of(s, flown, route):
    (radar,) = s.radars
    yield from (s.aircraft, s.cov_aircraft, s.radar, s.cov_radar, s.states().cov_radar)
    yield from (radar.state, radar.levels["low"].covariance)
    for path in (flown, scenario(geometry=flown)):
        yield from (path.time_s, path.axis.values, path.aircraft)
    yield from (flown.covariance, route.time_s, route.aircraft)


def test_arrays_of_the_caller_may_change_later():
    """A view that cannot be written changes with what it is a view of."""
    matrix = RADAR.levels["low"].covariance
    given = PAPER.aircraft[0], np.eye(6), np.arange(3.0), RADAR.state, matrix
    own = [array.copy() for array in given]
    made = made_of(*own)
    for array in own:
        array *= 100
    for found, expected in zip(arrays_of(*made), arrays_of(*made_of(*given)), strict=True):
        np.testing.assert_array_equal(found, expected)
        with pytest.raises(ValueError, match="read-only"):
            found[...] = 0


@pytest.mark.parametrize("config", ["paper", "network", "corridor", "airport_surveillance"])
def test_a_scenario_and_its_parts_have_short_reprs_with_the_names_of_radars(config):
    s = rs.load_scenario(CONFIGS / f"{config}.yaml")
    for instance in (s, s.model, s.model.radars[0], s.axis, s.geometry):
        assert len(repr(instance)) < 400
        assert "array" not in repr(instance)
    for instance in (s, s.model):
        assert len(repr(instance)) < 200
        assert all(name in repr(instance) for name in s.model.names)
    assert f"{len(s.model.radars)} radar" in repr(s.model)


def test_reprs():
    assert repr(PAPER) == (
        "<Scenario 'paper': 361 poses by azimuth, 1 radar, level medium of low, medium, high, "
        "500 runs, seed 1>"
    )
    many = rs.NetworkModel(tuple(rs.Radar(MODEL, f"r{i}".ljust(40, "x")) for i in range(64)))
    assert "r0x" in repr(many)
    lin = MODEL.linearize(PAPER.aircraft, PAPER.radar)
    for instance in (many, rs.TableRCS(ANGLES, np.ones(36)), propagated(), lin):
        assert len(repr(instance)) < 400
        assert "array" not in repr(instance)


def test_a_value_in_a_message_is_whole_up_to_40_letters():
    for value, text in (
        (1.5, "1.5"),
        (MODEL.p_fa, "0.00017"),
        ("x" * 40, repr("x" * 40)),
        ("x" * 41, repr("x" * 37 + "...")),
        ([1] * 13, repr([1] * 13)),
        ([1] * 14, "[1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, ..."),
        (np.ones((2, 2)), "array([[1., 1.], [1., 1.]])"),
    ):
        assert describe(value) == text


def test_a_scenario_has_more_errors_than_its_covariances():
    """`propagate_scenario` includes errors of the RCS and tolerances, as `variance` does."""
    s = rs.load_scenario("configs/rainy_day.yaml").at_poses(slice(0, 361, 90))
    table, moments = rs.analyses.variance(s).table, rs.propagate_scenario(s)
    np.testing.assert_array_equal(moments.upper, table["upper_3sigma"])
    np.testing.assert_array_equal(moments.std, table["sigma_pd"])
    fewer = rs.propagate(s.model, s.aircraft, s.radar, s.cov_aircraft, s.cov_radar)
    assert np.all(fewer.std < moments.std)


@pytest.mark.parametrize("method", METHODS)
def test_nothing_has_a_value_where_aircraft_and_radar_coincide(method):
    certain = {"cov_aircraft": np.zeros((6, 6)), "cov_radar": np.zeros((4, 4))}
    at = {"aircraft": np.zeros((1, 6)), "radar": np.array([0.0, 0, 0, 100])}
    found = propagated(**at, **certain, method=method)
    assert repr(found).startswith("<Moments of P_D at 1 pose: ")
    for values in (found.p_d, found.mean, found.std, found.lower, found.upper):
        assert np.isnan(values).all()
