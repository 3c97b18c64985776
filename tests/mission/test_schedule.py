"""Missions of radars with different periods, against an oracle that takes each look by itself."""

import math
import re
import runpy
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers import (
    CONFIGS,
    corridor,
    few_draws,
    lay_out,
    legend_off_data,
    mission,
    one_line,
    p_d_each,
    write_path,
)
from mission.plain import PlainMissions
from routes import POSE_HEAD, STD

import radar_sense as rs
from radar_sense.mission.looks import Looks
from radar_sense.model import geodesy as wgs84
from radar_sense.propagation import propagate_scenario
from radar_sense.sources import error_budget
from radar_sense.words import probability

HEADER = ",".join([POSE_HEAD, *STD])
#: Straight and level at one heading: a pose between two is their weighted mean.
ROUTE = f"""{HEADER}
10,200e3,-40e3,-8000,5,2,70,300,400,50,0.5,0.5,0.5
50,200e3,0,-8000,5,2,70,500,400,50,0.5,0.5,1
82,190e3,30e3,-8000,5,2,70,800,900,50,0.5,0.5,2
"""
#: Place, c_r, P_fa, detector and limits; σ of the place and of c_r.
KINDS = {
    "far": ([0, 0, -30], 1.9, 1e-6, "north", {}, 400, 0.1),
    "near": ([120e3, 10e3, -20], 0.03, 1e-4, "swerling1", {"max_range_km": 85}, 900, 0.002),
    "hill": ([240e3, 60e3, -500], 0.03, 1e-5, "marcum", {"horizon": True}, 300, 0.002),
}


def radar(name, period):
    place, constant, p_fa, detector, limits, std, std_constant = KINDS[name]
    scan_period = {} if period is None else {"scan_period_s": period}
    levels = {"one": {"position_m": std, "constant": std_constant}}
    return {
        "name": name, "position_m": place, "constant": constant, "p_fa": p_fa,
        "detector": detector, **limits, **scan_period, "uncertainty": levels,
    }  # fmt: skip


@pytest.fixture(autouse=True)
def _few_draws(monkeypatch):
    few_draws(monkeypatch)


def write(folder, periods, tau=0.0, route=ROUTE, **changes):
    given = {
        "name": "flight",
        "radars": [radar(*one) for one in periods.items()],
        "uncertainty": {"aircraft_correlation_s": tau},
        "analysis": {"level": "one"},
    }
    return write_path(folder, route, "my.yaml", **{**given, **changes})


def load(folder, *args, **options):
    return rs.load_scenario(write(folder, *args, **options))


def plain(folder, *args):
    """The missions of the scenario that was written to a folder, by plain loops."""
    return PlainMissions(yaml.safe_load((folder / "my.yaml").read_text()), ROUTE, *args)


#: Two periods; three; and two radars that look together beside one that does not.
CASES = [
    {"far": 10, "near": 4},
    {"hill": 7, "far": 12, "near": 5},
    {"near": 4, "hill": 8, "far": 8},
]


@pytest.mark.parametrize("periods", CASES)
def test_p_d_cumulative_p_d_and_tracks_at_the_nominal_states(tmp_path, periods):
    found = mission(load(tmp_path, periods), m_of_n=(2, 3)).table
    exact, same = plain(tmp_path), partial(np.testing.assert_allclose, rtol=1e-9, atol=1e-10)
    assert found["time_s"].tolist() == exact.times
    assert len(exact.p_d) > len(exact.times)
    same(found["p_d"], [exact.fused(t, periods)[0] for t in exact.times])
    detection, track = exact.events(2, 3)
    same(found["cumulative_p_d"], detection[:, 0])
    same(found["track_p_d"], track[:, 0])
    assert 0.2 < detection[-1] < 0.999
    assert 0.05 < track[-1] < 0.99
    for name in periods:
        own = [k for k, t in enumerate(exact.times) if (name, t) in exact.p_d]
        mine = np.array([exact.p_d[name, exact.times[k]][0] for k in own])
        same(found[f"p_d_{name}"][own], mine)
        assert np.isnan(np.delete(found[f"p_d_{name}"], own)).all()
        ends = found[f"cumulative_p_d_{name}"]
        same(ends[own], 1 - np.cumprod(1 - mine))
        for k, value in enumerate(ends):  # constant between the looks of the radar
            assert value == ends[max(o for o in own if o <= k)]


@pytest.mark.parametrize(
    ("periods", "tau", "rcs_db"),
    [({"far": 5}, 25.0, 0), (CASES[0], 0.0, 0), (CASES[1], 25.0, 0), (CASES[2], math.inf, 1.5)],
)
def test_draws_agree_with_draws_of_everything_at_once(tmp_path, periods, tau, rcs_db):
    runs, aircraft = 4000, {"uncertainty__aircraft": {"rcs_db": rcs_db}}
    found = mission(load(tmp_path, periods, tau, **aircraft), m_of_n=(2, 3), runs=runs).table
    exact = plain(tmp_path, runs, 11)
    for column, drawn in zip(("", "track_"), exact.events(2, 3), strict=True):
        mean, std = drawn.mean(axis=1), drawn.std(axis=1)
        shown = std > 1e-2 * std.max()
        error = std[shown] * math.sqrt(2 / runs)
        assert np.max(abs((found[f"{column}mc_mean"] - mean)[shown] / error)) < 4.5
        # the error of a standard deviation comes from the fourth moment
        fourth = np.mean((drawn.T - mean) ** 4, axis=0)[shown]
        error = np.sqrt(2 * (fourth - std[shown] ** 4) / runs) / (2 * std[shown])
        assert np.max(abs((found[f"{column}mc_std"] - std)[shown] / error)) < 4.5
        for end, level in (("lower", 0.00135), ("upper", 0.99865)):
            quantile = np.quantile(drawn, level, axis=1)
            assert np.max(abs(found[f"{column}mc_{end}"] - quantile)) < 0.9 * std.max()


def test_times_that_differ_by_rounding_are_one(tmp_path):
    assert 3 * 0.1 != 0.3
    periods = {"far": 0.1, "hill": 0.3, "near": 0.2}
    route = f"{HEADER}\n" + "".join(
        f"{t},200e3,{100 * t},-8000,0,0,90,100,100,50,1,1,1\n" for t in (0, 0.3, 1.2)
    )
    looks = Looks.of(load(tmp_path, periods, route=route)).scenario
    np.testing.assert_allclose(looks.axis.values, 0.1 * np.arange(13), rtol=1e-12)
    # at 1.6e9 s, where floats are 2e-7 s apart
    head, *rows = route.splitlines()
    rows = [row.split(",", 1) for row in rows]
    late = "\n".join([head, *(f"{1.6e9 + float(t)!r},{rest}" for t, rest in rows)])
    looks = Looks.of(load(tmp_path, periods, route=late)).scenario
    assert len(looks.axis) == 13


def test_draws_depend_on_the_seed_and_not_on_the_workers(tmp_path):
    s = load(tmp_path, CASES[1], 25.0)
    options = {"runs": 9000, "m_of_n": (2, 3)}
    one, two, other = (
        mission(c, **options, workers=w).table
        for c, w in ((s, 1), (s, 2), (s.with_analysis(seed=9), 1))
    )
    for column, values in one.items():
        assert values.tobytes() == two[column].tobytes()
        drawn = column != "time_s" and "p_d" not in column
        assert drawn == (values.tobytes() != other[column].tobytes())


def test_report(tmp_path):
    s = load(tmp_path, {"far": 10, "near": 4}, 25.0)
    result = mission(s, m_of_n=(2, 3), runs=50)
    said = "27 looks at 23 times, 10 to 82 s, every 4 or 10 s; pose errors correlated over 25 s"
    assert said in result.report
    assert result.summary["looks"] == 23
    assert [*result.summary["radars"]] == ["far", "near"]
    at = result.report.index("each radar alone, by the end:") + 1
    radars = result.summary["radars"].items()
    for line, (name, of_radar) in zip(result.report[at : at + 2], radars, strict=True):
        ends = [of_radar[event]["at_end"] for event in ("detection", "track")]
        detection, track = (
            f"{probability(e['p'])}, on average {probability(e['mean'])}{error} "
            f"({probability(e['lower_3sigma'])} to {probability(e['upper_3sigma'])})"
            for e in ends
            for error in (f" +/- {e['mean_se']:.1g}" if e["mean_se"] >= 5e-5 else "",)
        )
        every = f"every {of_radar['scan_period_s']:g} s"
        shown = re.sub(r" \+/- [\d.]+(?= to |\))", "", line)  # of a bound
        assert shown == f"  {name:4}  detection {detection}, track {track}, {every}"


@pytest.mark.parametrize(
    ("periods", "words"),
    [
        ({"far": 10, "near": None}, "radar 'near' needs a scan_period_s, the time [s]"),
        ({"far": 1.1e-4, "near": 1.2e-4}, "make more than 1,000,000 looks together"),
    ],
)
def test_refusals(tool, tmp_path, periods, words):
    assert words in one_line(tool, "mission", write(tmp_path, periods))
    assert not Path("figures").exists()


@pytest.mark.parametrize(
    ("runs", "m_of_n", "periods"), [(20, (2, 3), CASES[0]), (None, None, {"far": 6, "near": 6})]
)
def test_layout(tmp_path, runs, m_of_n, periods):
    figure = lay_out(mission(load(tmp_path, periods), runs=runs, m_of_n=m_of_n).plot())
    assert len(figure.axes) == (2 if m_of_n is None else 3)
    legend = legend_off_data(figure)
    labels = [text.get_text() for text in legend.get_texts()]
    assert {*periods} <= {*labels}
    assert len(set(labels)) == len(labels)


def test_the_route_of_the_corridor_is_what_its_script_makes():
    made = runpy.run_path(str(CONFIGS / "make_corridor_route.py"))["text"]()
    assert (CONFIGS / "corridor_route.csv").read_text() == made
    assert "SYNTHETIC" in made.splitlines()[0]


def test_the_numbers_of_the_corridor_example(monkeypatch):
    """Those of the comment in configs/corridor.yaml; the bounds but one are by `form`."""
    s = corridor()
    time, p_d = s.time_s, s.p_d()
    assert np.sum(np.hypot(*np.diff(s.aircraft[:, :2], axis=0).T)) > 1.04e6
    assert (time[p_d.argmax()], p_d.max()) == (4140, pytest.approx(0.072, abs=5e-4))
    few = s.at_poses(np.flatnonzero(np.isin(time, [816, 2976, 4140])))
    linear, form = (propagate_scenario(few, method=method).upper for method in ("linear", "form"))
    assert (few.p_d()[1], linear[1]) == pytest.approx((0.055, 0.113), abs=5e-4)
    assert form[1:] == pytest.approx((0.205, 0.095), abs=6e-4)

    budget = error_budget(few, "form")
    share = {name: c.share for name, c in (budget.sources | budget.finer).items()}
    of_mobile = [share[name][1] for name in ("mobile", "mobile_constant", "mobile_position")]
    assert of_mobile == pytest.approx([0.95, 0.37, 0.35], abs=0.005)
    own = share["aircraft_position"] + share["aircraft_orientation"]
    assert own[:2] == pytest.approx([0.28, 0], abs=0.005)
    for key, value, bound in (("position_m", [300, 300, 10], 0.128), ("constant", 0.00235, 0.147)):
        known = s.with_keys({f"radars.mobile.uncertainty.medium.{key}": value})
        near = known.at_poses(np.flatnonzero(abs(time - 2976) < 90))
        upper = propagate_scenario(near, method="form").upper
        assert upper.max() == pytest.approx(bound, abs=5e-4)

    # Wings level, which is relative to the level of the place.
    place = wgs84.geodetic_from_ned(s.aircraft[:, :3], s.origin)
    turn = wgs84.turn_to_origin(place, s.origin)
    attitude = wgs84.turned_attitude(s.aircraft[:, 3:], np.swapaxes(turn, -1, -2))
    attitude[:, 0] = 0
    level = np.hstack([s.aircraft[:, :3], wgs84.turned_attitude(attitude, turn)])
    banked, flat = (p_d_each(s.model, states, s.radar) for states in (s.aircraft, level))
    for at, radar, expected in ((816, 2, (0.044, 0.009)), (1776, 1, (0.034, 0.006)),
                                (2688, 0, (0.020, 0.006))):  # fmt: skip
        now = time == at
        assert (banked[now, radar], flat[now, radar]) == pytest.approx(expected, abs=5e-4)

    few_draws(monkeypatch, draws=512, replicates=4)
    found = mission(s, workers=2).summary["detection"]
    reaches = found["reaches"]["0.5"]
    assert reaches["time_s"] == 930
    assert reaches["earliest_s"] == pytest.approx(888, abs=6)  # one look
    assert reaches["latest_s"] == pytest.approx(1062, abs=15)
    assert found["at_end"]["p"] == pytest.approx(0.998, abs=5e-4)
