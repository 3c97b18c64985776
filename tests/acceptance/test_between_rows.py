"""Between two rows, errors may reach a limit, a lobe or a gap that the nominal states do not.

P(P_D > 0.1) at the worst place is a closed form. A test of the maxima of P_D of the nominal states
alone would say "holds" in each of these cases.
"""

import math
import re

import numpy as np
import pytest
from helpers import csv_text, drawn_p_d, known_to, required, scenario, write_path
from routes import HEAD, POSE_HEAD, triangle
from scipy.constants import Boltzmann
from scipy.special import ndtr

import radar_sense as rs
from radar_sense import analyses
from radar_sense.acceptance import refinement
from radar_sense.acceptance.requirement import Requirement
from radar_sense.acceptance.threshold import path_test
from radar_sense.errors import InputError
from radar_sense.propagation import band_of_scenario
from radar_sense.propagation.staged import MANY

#: How draws judge a method is tested in `test_verdicts` and `test_guarantees`.
pytestmark = pytest.mark.usefixtures("few_judge")

LIMIT = 0.1


def past(start, end):
    """Rows of a flight at 200 m/s that is closest to the origin, 80 km, at 300 s."""
    return "".join(f"{t},{200 * (t - 300)},80000,-3000\n" for t in (start, end))


def flight(folder, rows, radar, rcs, aircraft):
    """Return the scenario of a straight flight past one radar, or several."""
    several = [
        {"p_fa": 1e-6, "detector": "swerling1", "name": f"r{i}", **one}
        for i, one in enumerate(radar)
    ]
    known = {"uncertainty__aircraft": aircraft, "analysis": {"level": "medium"}}
    changes = {"aircraft__rcs": rcs, "radars": several, **known}
    return rs.load_scenario(write_path(folder, f"{HEAD}\n{rows}", "flight.yaml", **changes))


def flown(*args):
    return analyses.variance(flight(*args), threshold=LIMIT)


def radar(constant, **keys):
    known = {"medium": {"position_m": 1, "constant": 0.005 * constant}}
    return {"position_m": [0, 0, 0], "constant": constant, "uncertainty": known, **keys}


def check(result, probability, time, rel=0.0, near=3.0):
    found = result.summary["threshold"]
    assert found["verdict"] == "violated"
    highest = found["highest_probability_above"]
    error = 4.0 * highest["standard_error"] + rel * probability
    assert highest["value"] == pytest.approx(probability, abs=error)
    assert highest["time_s"] == pytest.approx(time, abs=near)


def test_a_course_that_jumps_at_a_waypoint(tmp_path):
    """P_D of a shield falls to the waypoint, and jumps there: by a dense grid of the legs."""
    rows = "0,-6817,-5874,-3000\n300,-2221,-2017,-3000\n600,2307,1919,-3000\n"
    changes = {
        "radar": {"position_m": [-148629, 133826, 0], "constant": 0.2666, "p_fa": 1e-5},
        "aircraft__rcs": {"model": "ellipsoid_exact", "x_m": 0.6, "y_m": 0.3, "z_m": 0.2},
        "geometry__interpolate": {"step_s": 300},
        **known_to(1e-3, 1e-4, position_m=1e-3, constant=1e-9),
    }
    s = rs.load_scenario(write_path(tmp_path, f"{HEAD}\n{rows}", "turn.yaml", **changes))
    dense = s.along(s.geometry.at(np.arange(0, 600, 0.05)))
    limit = float(np.mean(dense.p_d()[[5990, 6000]]))
    above = np.flatnonzero(dense.p_d() > limit) * 0.05
    (jump,) = np.flatnonzero(np.diff(above) > 1)
    expected = [above[0], above[jump], above[jump + 1], above[-1]]
    found = analyses.variance(s, threshold=limit)
    spans = re.findall(r"[\d.]+", found.report[0].partition(" s:")[0])
    assert [float(end) for end in spans] == pytest.approx(expected, abs=1.5)


def test_a_fast_and_near_pass(tmp_path):
    """Half a lobe is turned in less than 0.2 s. By a dense grid of the states, nearly certain."""
    rcs = {"model": "spikeball", "lobes": 36, "amplitude_m2": 2.0, "floor_m2": 0.05}
    rows = "0,-5100,511,-150\n28.65,4900,511,-150\n"
    s = flight(tmp_path, rows, [radar(6.95e-12)], rcs, {"position_m": 0.01, "attitude_deg": 1e-3})
    dense = s.along(s.geometry.at(np.linspace(0, 28.65, 100_001))).p_d()
    found = analyses.variance(s, threshold=0.98 * float(dense.max())).summary["threshold"]
    assert found["verdict"] == "violated"
    assert found["p_d_itself_above"]


@pytest.mark.parametrize("amplitude", [100.0, 10_000.0])
@pytest.mark.parametrize("start", [1.0, 2.5])
def test_a_gap_that_is_much_narrower_than_a_lobe(start, amplitude):
    """P_D is 1 at poses 5 deg apart, and at azimuth 0, between two of them, it is less."""
    s = scenario(
        aircraft__rcs={"model": "spikeball", "lobes": 4, "amplitude_m2": amplitude, "floor_m2": 1},
        geometry__azimuth_deg={"start": start - 60, "stop": start + 60, "step": 5},
        radar__constant=8,
        analysis__method="linear",
        **{"uncertainty__aircraft": {"position_m": 1, "attitude_deg": 0.01}},
    )
    least = float(s.along(s.geometry.at(np.zeros(1))).p_d()[0])
    assert least < 0.7
    assert s.p_d().min() > 0.99
    assert analyses.variance(s, at_least=0.8).summary["threshold"]["verdict"] == "violated"


def lobes(count, floor=0.0, amplitude=1.0):
    return {"model": "spikeball", "lobes": count, "amplitude_m2": amplitude, "floor_m2": floor}


def orbit(start, stop, step, rcs, *radars, std=10):
    """An orbit at 50 km by compass azimuth, of an aircraft with a heading of north."""
    azimuths = {"start": start, "stop": stop, "step": step}
    circle = {"type": "orbit", "range_km": 50, "down_km": -3, "azimuth_from": "north"}
    return scenario(
        radars=list(radars),
        aircraft={"rcs": rcs, "attitude_deg": [0, 0, 0]},
        geometry={**circle, "azimuth_deg": azimuths},
        uncertainty={"aircraft": {"position_m": std, "attitude_deg": 0.01}},
        analysis={"level": "l"},
    )


def one(constant, **keys):
    """A radar at the origin."""
    known = {"l": {"position_m": 1, "constant": 0}}
    of_all = {"name": "a", "position_m": [0, 0, 0], "p_fa": 1e-6, "uncertainty": known}
    return {**of_all, "constant": constant, **keys}


def verdict(s, **test):
    return analyses.variance(s, **test).summary["threshold"]["verdict"]


def test_a_gap_half_way_between_the_last_two_poses():
    """P_D of the two is the same but for rounding."""
    s = orbit(79, 87, 2, lobes(18), one(0.052))
    assert s.along(s.geometry.at(np.array([80.0]))).p_d()[0] < 1e-4
    assert verdict(s, at_least=0.9) == "violated"


def test_poses_that_lie_half_way_between_top_and_gap():
    """All of 11 poses at steps of half a lobe have one P_D, and the gaps between them less."""
    s = orbit(2.25, 47.25, 4.5, lobes(40, 0.01), one(0.174))
    gaps = s.along(s.geometry.at(np.arange(4.5, 46.0, 4.5)))
    assert s.p_d().min() > 0.99
    assert gaps.p_d().min() < 0.89
    assert verdict(s, at_least=0.9) == "violated"


def test_a_gap_that_a_radar_at_its_limit_fills():
    """Radar a sees all of the arc, but for errors of its place: b has a gap at 60 deg."""
    known = {"l": {"position_m": 300, "constant": 0}}
    a = one(0.574, band="s", max_range_km=25.695) | {"uncertainty": known}
    radars = [a | {"position_m": [0, 40000, 0]}, one(0.07, name="b", band="x")]
    rcs = {"bands": {"s": {"model": "constant", "rcs_m2": 1}, "x": lobes(12, 0.02)}}
    s = orbit(47, 73, 2, rcs, *radars, std=1)
    assert s.along(s.geometry.at(np.array([60.0]))).p_d()[0] > 0.99
    assert verdict(s, at_least=0.9) == "violated"  # a is beyond its limit in 16 % of the cases


def test_lobes_by_azimuth_pass_fast_beside_the_pole_of_the_aircraft():
    """Level, 10 km up and 87 m beside a radar, it turns 120 deg of azimuth within 300 m."""
    s = orbit(0, 10, 5, lobes(4), one(1))
    path = [[north, 87, -10e3, 0, 0, 0] for north in (-150, 150)]
    flown = s.along(rs.Path.of([0, 1], path))
    (turn,) = refinement.coarseness(flown) * refinement.LARGEST_TURN
    assert turn == pytest.approx(2.0 * math.atan(150 / 87))


def test_an_error_of_the_rcs_that_is_large_at_one_aspect(tmp_path):
    """At 270 deg it is 8 dB in place of 1 dB, and P_D of the nominal states is the same."""
    rows = [(a, 1.0, 8.0 if a == 90 else 1.0) for a in range(0, 360, 5)]
    (tmp_path / "rcs.csv").write_text(csv_text("azimuth_deg,rcs_m2,std_db", rows))
    table = {"model": "table", "file": str(tmp_path / "rcs.csv")}
    s = orbit(256.25, 283.75, 2.5, table, one(0.261), std=1)
    e = np.random.default_rng(1).standard_normal(400_000)
    radar = s.radars[0].model
    snr = radar.snr(s.along(s.geometry.at(np.array([270.0]))).aircraft, s.radar)[0]
    below = np.mean(radar.detector.p_d(snr * 10 ** (0.8 * e), 1e-6) < 0.9)
    assert below > 2 * ndtr(-3)
    assert verdict(s, at_least=0.9) == "violated"


def test_the_time_above_leaves_out_gaps():
    """18 lobes have a gap every 20 deg; P_D > 0.9 by a dense grid."""
    s = orbit(2.5, 82.5, 5, lobes(18), one(0.0087), std=0.1)
    dense = s.along(s.geometry.at(np.linspace(2.5, 82.5, 80_001))).p_d()
    found = analyses.variance(s, threshold=0.9).summary["threshold"]
    assert found["above_deg"] == pytest.approx(80 * np.mean(dense > 0.9), rel=0.02)
    assert found["total_deg"] == 80


def test_a_ring_that_is_grazed_by_two_sigma(tmp_path):
    """The ring ends 20 m beside the route; another radar has the greatest P_D elsewhere."""
    radars = [
        radar(2000, max_range_km=100),
        radar(0.08, position_m=[120e3, 300e3, 0]),
    ]
    rows, sphere = "0,-110000,100020,0\n1100,30000,100020,0\n", {"model": "constant", "rcs_m2": 1}
    result = flown(tmp_path, rows, radars, sphere, {"position_m": 10, "attitude_deg": 1})
    check(result, ndtr(-20 / math.hypot(10, 1)), 110e3 / 140e3 * 1100, near=6.0)  # few draws
    (axes,) = result.plot().axes
    drawn = np.concatenate([line.get_ydata() for line in axes.lines if len(line.get_ydata()) > 2])
    assert drawn.max() > LIMIT  # the band is drawn at the poses between the rows too


def test_the_accuracy_that_a_ring_beside_the_route_needs(tmp_path, monkeypatch):
    """20 m are three sigma of the distance where √((10 f)² + 1²) is 20/3."""
    monkeypatch.setattr("radar_sense.acceptance.accuracy.MANY", MANY)
    rows, sphere = "0,-4000,100020,0\n60,4000,100020,0\n", {"model": "constant", "rcs_m2": 1}
    errors = {"position_m": 10, "attitude_deg": 1}
    s = flight(tmp_path, rows, [radar(2000, max_range_km=100)], sphere, errors)
    band = band_of_scenario(s, method="automatic")
    path = path_test(s.with_analysis(method="automatic"), Requirement(LIMIT), band).path
    (found,) = required(path.scenario, LIMIT, "aircraft_position", k=3.0).values()
    assert found.factor == pytest.approx(math.sqrt((20 / 3) ** 2 - 1) / 10, rel=0.02)


def test_an_rcs_that_is_badly_known_at_one_aspect(tmp_path):
    azimuth = np.arange(-180, 180, 0.5)
    std = np.where(abs(azimuth + 63.0) < 1.1, 12.0, 0.1)  # on the left, where the radar is
    rows = [(a, -10, s) for a, s in zip(azimuth, std, strict=True)]
    (tmp_path / "rcs.csv").write_text(csv_text("azimuth_deg,rcs_dbsm,std_db", rows))
    table = {"model": "table", "file": "rcs.csv"}
    errors = {"position_m": 10, "attitude_deg": 0.05}
    result = flown(tmp_path, past(0, 300), [radar(0.02)], table, errors)
    # abeam at 300 s, and at 63 deg from the nose before
    north = -80e3 / math.tan(math.radians(63))
    snr = 0.02 * 0.1 / (Boltzmann * math.hypot(north, 80e3, 3e3) ** 4)
    needed = math.log(1e-6) / math.log(LIMIT) - 1
    probability = ndtr(-10 * math.log10(needed / snr) / 12)
    # the spline exceeds 12 dB between the nodes
    check(result, probability, 300 + north / 200, rel=0.15, near=10.0)


def test_a_lobe_that_only_a_roll_turns_to_the_radar(tmp_path):
    rows = [
        (a, e, 20 if e == -12 and abs(a + 63) < 0.8 else -10)
        for e in (-40, -30, -20, -15, -12, -9, -6, -3, 0, 3, 6, 9, 12, 20, 30, 40)
        for a in np.arange(-180, 180, 0.5)
    ]
    (tmp_path / "rcs.csv").write_text(csv_text("azimuth_deg,elevation_deg,rcs_dbsm", rows))
    errors = {"position_m": 10, "attitude_deg": [4, 0.05, 0.05]}
    table = {"model": "table", "file": "rcs.csv"}
    result = flown(tmp_path, past(40, 115), [radar(0.02)], table, errors)
    found = result.summary["threshold"]
    assert found["verdict"] == "violated"
    assert found["highest_probability_above"]["value"] > 0.01
    assert found["highest_probability_above"]["time_s"] == pytest.approx(100, abs=12)


def test_a_gap_of_a_mask_that_is_open_one_sigma_higher(tmp_path):
    steps = ((-180, 5), (70.4, 5), (70.5, 2.3), (71.5, 2.3), (71.6, 5), (180, 5))
    (tmp_path / "mask.csv").write_text(csv_text("azimuth_deg,elevation_deg", steps))
    sphere = {"model": "constant", "rcs_m2": 1}
    errors = {"position_m": [1, 1, 400], "attitude_deg": 1}
    result = flown(tmp_path, past(300, 500), [radar(20, mask="mask.csv")], sphere, errors)
    north = 80e3 / math.tan(math.radians(71.5))  # the nearest end of the gap
    lowest = math.hypot(north, 80e3) * math.tan(math.radians(2.3))
    check(result, ndtr((3e3 - lowest) / 400), 300 + north / 200)


def banked(folder, step, method="legs", **place):
    """Return a flight with a bank of 35° for ten seconds, in rows between the poses."""
    times = [0, *range(1195, 1226), 2400]
    rolls = np.interp(times, [1200, 1205, 1215, 1220], [0, -35, -35, 0])
    rows = [
        (t, 60000, 200 * t - 240000, -9000, roll, 0, 90)
        for t, roll in zip(times, rolls, strict=True)
    ]
    between = {"step_s": step, "method": method}
    route = {"type": "path", "file": "route.csv", "axis": "distance", "interpolate": between}
    of_radar = {"position_m": [0, 0, 0], "constant": 0.025, "p_fa": 1e-6}
    file = write_path(
        folder,
        csv_text(POSE_HEAD, rows),
        "flight.yaml",
        geometry=route,
        aircraft__rcs={"model": "ellipsoid_exact", "x_m": 0.3, "y_m": 0.25, "z_m": 0.07},
        radar={**of_radar, **place},
        **known_to(10, 1, position_m=10, constant=5e-4),
    )
    return rs.load_scenario(file)


@pytest.mark.parametrize("limit", [LIMIT, 0.9])
def test_what_is_not_resolved_is_not_said(tmp_path, monkeypatch, limit):
    monkeypatch.setattr(refinement, "MAX_POSES", 3)
    scenario = banked(tmp_path, 2400)
    result = analyses.variance(scenario, threshold=limit)
    text, found = "\n".join(result.report), result.summary["threshold"]
    highest = banked(tmp_path, 1).p_d().max()
    assert 0.15 < highest < 0.5
    assert found["verdict"] == ("violated" if limit < highest else "not known")
    assert found["worst_margin"]["value"] <= limit - highest
    assert text.count("not resolved by 3 poses") == 1
    assert "stays below:" not in text
    assert "anywhere" not in text
    assert found["above_s"] is None
    assert not {"probability_above_at_any_pose", "mean_time_above_s"} & set(found)
    if limit > highest:
        with pytest.raises(rs.InputError, match="not resolved by 3 poses"):
            analyses.budget(scenario, threshold=limit)


def test_a_path_through_the_radar_is_refused(tmp_path):
    """P_D has no value there, which is between the rows."""
    sphere, rows = {"model": "constant", "rcs_m2": 1}, "0,0,-40000,0\n100,0,40000,0\n"
    s = flight(tmp_path, rows, [radar(0.002)], sphere, KNOWN_POSE)
    with pytest.raises(InputError, match="on top of radar 'r0' at 50 s"):
        analyses.variance(s, threshold=0.5, method="linear")


def test_a_path_that_is_not_resolved_has_the_place_of_the_greatest_p_d(tmp_path, monkeypatch):
    monkeypatch.setattr(refinement, "MAX_POSES", 5)
    sphere, rows = {"model": "constant", "rcs_m2": 1}, "0,500,-40000,0\n100,500,40000,0\n"
    s = flight(tmp_path, rows, [radar(0.002)], sphere, KNOWN_POSE)
    result = analyses.variance(s, threshold=0.5, method="linear")
    found = result.summary["threshold"]
    assert not found["resolved"]
    assert found["p_d_itself_above"]
    assert np.isfinite(found["worst_margin"]["value"])
    assert "\n".join(result.report).count("not resolved by 5 poses") == 1


def test_rows_in_which_nothing_happens_are_no_poses(tmp_path):
    """Of 8 000 rows of a level flight with noise few are tested, and the one that counts is."""
    rng, n = np.random.default_rng(1), 8_001
    roll = np.zeros(n)
    roll[n // 2 + 2] = -35  # one row, between two poses
    north = 60000 + rng.normal(0, 1, n)
    rows = [
        (f"{0.1 * i:.1f}", f"{x:.1f}", 20 * i - 80000, -9000, r, 0, 90)
        for i, (x, r) in enumerate(zip(north, roll, strict=True))
    ]
    (tmp_path / "many.csv").write_text(csv_text(POSE_HEAD, rows))
    banked(tmp_path, 60)
    scenario = rs.load_scenario(tmp_path / "flight.yaml", {"geometry.file": "many.csv"})
    found = analyses.variance(scenario, threshold=LIMIT).summary["threshold"]
    assert found["verdict"] == "violated"
    assert found["first_violation"]["distance_m"] == pytest.approx(80e3, abs=1e3)
    assert found["poses"] < 300


@pytest.mark.parametrize("method", ["legs", "smooth"])
def test_axis_and_overview_are_those_of_the_file_at_any_step(tmp_path, method):
    for step in (1, 700, 2400):
        scenario = banked(tmp_path, step, method)
        assert scenario.axis.values[-1] == pytest.approx(480e3, rel=1e-9)
        lines = analyses.check(scenario).report
        (path,) = [line for line in lines if line.startswith("# path")]
        assert path == "# path: 2400 s (0:40:00), 480 km, speed 200 m/s"
        assert any("bank -35 to 0 deg" in line for line in lines)


def test_a_row_on_top_of_the_radar_is_refused_at_any_step(tmp_path):
    for step in (5, 1000):
        with pytest.raises(rs.InputError, match="on top of the radar at"):
            banked(tmp_path, step, position_m=[60000, 2000, -9000])


def test_a_dip_into_a_ring_in_one_of_many_rows(tmp_path):
    """The dip is 300 m of 100 km, too little to be a turn, and 60 sigma deep."""
    east = range(-4000, 4001, 10)
    rows = "".join(f"{e / 100 + 40},{99700 if e == 130 else 100000},{e},0\n" for e in east)
    strong = [radar(2000, max_range_km=99.9)]
    s = flight(tmp_path, rows, strong, {"model": "constant", "rcs_m2": 1}, KNOWN_POSE)
    coarse = rs.load_scenario(tmp_path / "flight.yaml", {"geometry.interpolate": {"step_s": 20}})
    for one in (s, coarse):
        found = analyses.variance(one, threshold=LIMIT).summary["threshold"]
        assert found["verdict"] == "violated"
        assert found["p_d_itself_above"]
        assert found["first_violation"]["time_s"] == pytest.approx(41.3, abs=0.1)
    assert found["poses"] < 100


KNOWN_POSE = {"position_m": 5, "attitude_deg": 1}


def test_an_error_towards_the_radar_in_one_of_many_rows(tmp_path):
    """All rows have the same variances. In one row the correlation has another sign."""
    covariance = np.tile(np.diag([4e6, 4e6, 0.01, 0.01, 0.01, 0.01]), (200, 1, 1))
    covariance[:, 0, 1] = -3.6e6
    covariance[88, 0, 1] = 3.6e6
    columns = triangle(covariance)
    rows = [
        (0.5 * i, 30000 + i, 30000 - i, -3000, 0, 0, 0, *cells)
        for i, cells in enumerate(np.stack([*columns.values()], axis=1).tolist())
    ]
    file = write_path(
        tmp_path,
        csv_text(",".join([POSE_HEAD, *columns]), rows),
        geometry={"type": "path", "file": "route.csv", "interpolate": {"step_s": 50}},
        aircraft__rcs={"model": "constant", "rcs_m2": 0.05},
        radar={"p_fa": 1e-6, "position_m": [0, 0, 0], "constant": 0.0007},
        uncertainty={"radar": {"medium": {"position_m": 1, "constant": 0.0001 * 0.0007}}},
        analysis={"level": "medium"},
    )
    scenario = rs.load_scenario(file)
    uppers = [
        analyses.variance(s, method="form").table["upper_3sigma"].max()
        for s in (scenario, scenario.along(scenario.geometry.at(np.array([43.5, 44.0, 44.5]))))
    ]
    limit = float(np.mean(uppers))
    assert uppers[1] > 1.5 * uppers[0]
    found = analyses.variance(scenario, threshold=limit).summary["threshold"]
    assert found["verdict"] == "violated"
    assert found["first_violation"]["time_s"] == pytest.approx(44.0, abs=0.6)


def test_a_bound_that_flattens_near_one_is_beyond_the_limit_between_poses():
    """The lobe's top is a degree from the nearest of the even poses, and 0.0005 above the limit."""
    s = rs.parse_scenario("""
        name: top
        radar: {position_m: [0, 0, 0], constant: 0.03905, p_fa: 1e-6, detector: marcum}
        aircraft: {rcs: {model: spikeball, lobes: 8, amplitude_m2: 0.764, floor_m2: 0.056},
                   attitude_deg: [0, 0, 324.43]}
        geometry: {type: orbit, range_km: 100, down_km: -5,
                   azimuth_deg: {start: 44.57, stop: 84.57, step: 10}}
        uncertainty: {aircraft: {position_m: 16.75, attitude_deg: [0.08375, 0.08375, 0.80735]},
                      radar: {l: {position_m: 16.75, constant: 0.000685075}}}
        analysis: {level: l}
    """)
    assert analyses.variance(s, threshold=0.9581, k=2).summary["threshold"]["verdict"] == "violated"
    at_top = s.along(s.geometry.at(np.array([58.07])))
    assert np.mean(drawn_p_d(at_top, 200_000) > 0.9581) > 1.1 * ndtr(-2)
