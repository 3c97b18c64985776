"""Paths in place of the orbit: from the route file to tables, figures, words and refusals."""

import numpy as np
import pytest
from helpers import (
    CONFIGS,
    PAPER,
    cov_by_level,
    csv_text,
    read_back,
    read_record,
    stds_of,
    with_arrays,
    write_path,
)
from routes import ATTITUDE, HEAD, STD, UNCERTAIN, triangle
from scenario_file.earth import to_ned
from scenario_file.refused import refused

import radar_sense as rs
from radar_sense import analyses, axis
from radar_sense.acceptance.accuracy import required_accuracies
from radar_sense.acceptance.requirement import Requirement
from radar_sense.analyses.rcs import rcs
from radar_sense.montecarlo.montecarlo import monte_carlo
from radar_sense.propagation import propagate_scenario
from radar_sense.sources import error_budget
from radar_sense.words import describe_extreme as at
from radar_sense.words import describe_poses, peak

pytestmark = pytest.mark.usefixtures("quick")

TABLE = {"model": "table", "file": str(CONFIGS / "synthetic_aircraft.csv"), "mirror": True}
#: Three legs past the radar, with a climb and two turns.
ROUTE = f"""{HEAD}
0,400e3,-200e3,-8000
500,400e3,-100e3,-8000
1000,350e3,0,-9000
1500,350e3,100e3,-9000
"""


def load(folder, text=ROUTE, **changes):
    return rs.load_scenario(write_path(folder, text, **changes))


def correlated_route():
    mix = np.random.default_rng(5).standard_normal((4, 6, 6))
    mix *= np.array([[30.0, 20, 10, 0.5, 0.3, 1.0]]).T
    columns = triangle(mix @ np.swapaxes(mix, -1, -2))
    rows = (",".join(map(str, row)) for row in zip(*columns.values(), strict=True))
    lines = zip(ROUTE.splitlines(), [",".join(columns), *rows], strict=True)
    return "\n".join(map(",".join, lines)) + "\n"


# The paper's orbit, as a path.


def orbit_route(aircraft, theta, std):
    names = [HEAD, *ATTITUDE, *(STD if std else ())]
    rows = ((t, *pose[:3], 0, 0, 90, *std) for t, pose in zip(theta, aircraft, strict=True))
    return csv_text(",".join(names), rows)


@pytest.mark.parametrize("std", [(), (10, 10, 10, 1, 1, 1)])
@pytest.mark.parametrize(
    "analyse",
    [
        analyses.sensitivity,
        lambda s: analyses.budget(s, target=0.05, at=45),
        lambda s: analyses.budget(s.with_analysis(runs=64), method="montecarlo"),
        lambda s: analyses.montecarlo(s.with_analysis(runs=40)),
        lambda s: analyses.variance(s, method="form"),
    ],
)
def test_the_papers_orbit_as_a_path_gives_its_numbers_bit_for_bit(tmp_path, std, analyse):
    orbit = rs.load_scenario().at_poses(slice(None, None, 3))
    path = load(tmp_path, orbit_route(orbit.aircraft, orbit.axis.values, std), radar__constant=167)
    assert path.cov_aircraft.ndim == (3 if std else 2)
    expected, found = analyse(orbit), analyse(path)
    names = list(expected.table)
    assert names[0] == "theta_r_deg"
    new_names = [name for name in found.table if name not in ("north_m", "east_m", "down_m")]
    assert new_names == ["time_s", *names[1:]]
    for old, new in zip(names, new_names, strict=True):
        assert expected.table[old].tobytes() == found.table[new].tobytes()


# One covariance for each pose.


@pytest.mark.parametrize("text", [UNCERTAIN, correlated_route()], ids=["std", "cov"])
def test_every_pose_has_its_own_covariance(tmp_path, text):
    s = load(tmp_path, text)
    assert s.cov_aircraft.shape == (4, 6, 6)

    def deviations(of, method):
        moments, budget = propagate_scenario(of, method=method), error_budget(of, method)
        return np.array([moments.std, moments.upper, *stds_of(budget.sources).values()])

    for method in ("linear", "probit", "form"):
        alone = [deviations(s.at_poses(slice(i, i + 1)), method) for i in range(4)]
        np.testing.assert_allclose(deviations(s, method), np.hstack(alone), rtol=1e-9, atol=1e-15)
    swapped = with_arrays(s, cov_aircraft=s.cov_aircraft[::-1])
    stds = [propagate_scenario(of).std[:3] for of in (swapped, s)]
    assert abs(stds[0] / stds[1] - 1).max() > 1e-3


def test_monte_carlo_agrees_with_propagation_at_every_pose(tmp_path):
    s = load(tmp_path, UNCERTAIN)
    mc = monte_carlo(s, runs=20_000, method="form")
    # a standard deviation of 20 000 draws has a standard error of 0.5 %
    assert mc.std == pytest.approx(mc.band.std, rel=0.02)


def test_sobol_indices_take_the_covariance_of_each_pose(tmp_path):
    s = load(tmp_path, UNCERTAIN).with_analysis(runs=1024)
    found, expected = error_budget(s, "montecarlo"), error_budget(s, "form")
    assert found.total.std == pytest.approx(expected.total.std, rel=0.02)
    for source, std in stds_of(expected.sources).items():
        assert found.sources[source].std == pytest.approx(std, rel=0.05, abs=0.002)
    assert found.sources["aircraft_position"].std[3] == 0
    with refused("aircraft position ... correlated"):
        error_budget(load(tmp_path, correlated_route()), "montecarlo")


def test_allowances_scale_every_covariance(tmp_path):
    s = load(tmp_path, UNCERTAIN)
    top = float(np.max(3 * propagate_scenario(s, method="linear").std))
    found = required_accuracies(s, Requirement(top / 2, width=True), method="linear")
    assert found["all"].factor == pytest.approx(0.5, rel=1e-6)


# The scenario.


def test_attitude_follows_the_track_and_waypoints_are_interpolated(tmp_path):
    s = load(tmp_path, geometry__interpolate={"step_s": 100})
    assert s.axis.key == "time_s"
    assert s.axis.values.tolist() == list(range(0, 1501, 100))
    assert s.aircraft[2] == pytest.approx([400e3, -160e3, -8000, 0, 0, np.pi / 2])
    climb = np.arctan2(1000, np.hypot(50e3, 100e3))
    assert s.aircraft[7, 3:] == pytest.approx([0, climb, np.arctan2(100, -50)])
    smooth = load(tmp_path, geometry__interpolate={"step_s": 100, "method": "smooth"})
    assert np.max(abs(smooth.aircraft[:, 3])) > 0.01  # it banks
    assert load(tmp_path).aircraft.shape == (4, 6)


def test_the_axis_may_be_the_distance_flown(tmp_path):
    s = load(tmp_path, geometry__axis="distance")
    climb = np.sqrt(50e3**2 + 100e3**2 + 1000**2)
    assert s.axis.key == "distance_m"
    assert s.axis.values == pytest.approx([0, 100e3, 100e3 + climb, 200e3 + climb], rel=1e-14)
    result = analyses.variance(s)
    assert "distance_m" in result.table
    assert result.report[0].startswith("P_D runs from ")
    assert result.report[0].endswith(" m")
    assert "distance_m" in result.summary["highest_p_d"]


GEODETIC = (
    "time_s,latitude_deg,longitude_deg,altitude_m\n"
    "0,47,8,10000\n600,47,9,10000\n1200,47.5,9.5,10000\n"
)
ORIGIN = {"latitude_deg": 47, "longitude_deg": 8.5, "altitude_m": 400}
ALPS = {"latitude_deg": 46.547, "longitude_deg": 7.985, "altitude_m": 3571}


def from_origin(**moved):
    """North, east and down of a place in the Alps, which may be moved."""
    place = (value + moved.get(key, 0) for key, value in ALPS.items())
    return np.array(to_ned(tuple(place), tuple(ORIGIN.values())))


def test_a_radar_may_be_in_latitude_and_longitude(tmp_path):
    levels = {"medium": {"position_m": [10, 20, 30], "constant": 1}}
    both = {"constant": 50, "p_fa": 1e-6, "uncertainty": levels}
    radars = [
        {"name": "sea", "position_m": [9, 8, 7], **both},
        {"name": "alps", "position_geodetic": ALPS, "horizon": True, **both},
    ]
    s = rs.load_scenario(write_path(tmp_path, GEODETIC, geometry__origin=ORIGIN, radars=radars))
    assert s.radar[:3].tolist() == [9, 8, 7]
    state = s.radar[4:]
    assert state[:3] == pytest.approx(from_origin(), rel=1e-12, abs=1e-7)
    assert -45e3 < state[1] < -35e3
    assert s.model.radars[1].horizon.height(state) == pytest.approx(3571, abs=1e-6)
    # metres of the frame where the place is in the frame, else metres north, east, down there
    covariance = cov_by_level(s)["medium"]
    assert np.diag(covariance)[:3].tolist() == [100, 400, 900]
    steps = {"latitude_deg": 1e-4, "longitude_deg": 1e-4, "altitude_m": -10}
    axes = [from_origin(**{k: v}) - from_origin(**{k: -v}) for k, v in steps.items()]
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    expected = axes.T @ np.diag([100, 400, 900]) @ axes
    np.testing.assert_allclose(covariance[4:7, 4:7], expected, atol=1e-5)
    assert abs(expected - np.diag([100, 400, 900])).max() > 1
    resolved = s.resolved()
    assert resolved["radars"][1]["position_geodetic"] == ALPS
    assert "position_m" not in resolved["radars"][1]
    read_back(s)
    radar = {"position_geodetic": ALPS, "constant": 50, "p_fa": 1e-6}
    alone = write_path(tmp_path, GEODETIC, geometry__origin=ORIGIN, radar=radar)
    assert rs.load_scenario(alone).radar.tolist() == state.tolist()


ON_EARTH = {
    "radar": {"position_geodetic": ALPS, "constant": 50, "p_fa": 1e-6},
    "geometry__origin": ORIGIN,
}
BESIDE = {"latitude_deg": 47, "longitude_deg": 9, "altitude_m": 10e3}


def test_an_rcs_table_warns_of_the_least_certain_attitude_of_all(tmp_path):
    assert "beyond" not in str(rcs(load(tmp_path, UNCERTAIN, aircraft__rcs=TABLE)).warnings)
    # 3 sigma of 11 deg of roll at the first pose alone: beyond the 30 deg of the table
    text = UNCERTAIN.replace("10,20,30,1,2,3", "10,20,30,11,2,3")
    _, warning = rcs(load(tmp_path, text, aircraft__rcs=TABLE)).warnings  # first the spacing
    assert "deg, beyond it at 100 s; the outermost" in warning


REFUSED = [
    (ROUTE, {"aircraft__attitude_deg": [0, 0, 90]}, "aircraft.attitude_deg: must be left out"),
    (UNCERTAIN, {"uncertainty__aircraft": {"position_m": 1, "attitude_deg": 1}},
     "uncertainty.aircraft: must be left"),
    (ROUTE, {"uncertainty": {"radar": {"medium": {"position_m": 1, "constant": 1}}}},
     "uncertainty: missing key 'aircraft'"),
    (ROUTE, {"geometry__file": "rout.csv"}, "geometry.file: ...rout.csv: cannot be read: No such"),
    (ROUTE, {"geometry__interpolate": {"step_s": 1e-5}}, "interpolate: step_s makes more than"),
    (ROUTE.replace("350e3", "nan"), {}, "route.csv:4: north_m: must be finite, got nan"),
    (f"{HEAD}\n0,0,-9e3,0\n60,0,0,0\n", {},
     "geometry: the aircraft is on top of the radar at time 60 s"),
    # 0.09 m/s there and back: a parabola has 0.18 m/s at its ends, straight legs do not
    (f"{HEAD}\n0,9000,0,0\n10,9000.9,0,0\n20,9000,0,0\n",
     {"geometry__interpolate": {"step_s": 5}},
     "the aircraft never moves horizontally at 0.1 m/s or more"),
    (ROUTE, {"aircraft__rcs": TABLE, "radar__position_m": [400e3, -150e3, 0],
             "geometry__interpolate": {"step_s": 250}},
     "at time 250 s the aircraft sees the radar at elevation -90 deg, the RCS table"),
    # places on the earth
    (GEODETIC, {**ON_EARTH, "geometry": PAPER["geometry"], "aircraft__attitude_deg": [0, 0, 0],
                "uncertainty__aircraft": PAPER["uncertainty"]["aircraft"]}, "needs a path"),
    (ROUTE, {"radar": ON_EARTH["radar"]}, "radar.position_geodetic: needs a path whose route is"),
    (GEODETIC, {**ON_EARTH, "radar__position_geodetic": BESIDE}, "on top of the radar"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "changes", "says"), REFUSED)
def test_bad_paths_are_refused_in_one_line(tmp_path, text, changes, says):
    file = write_path(tmp_path, text, **changes)
    with refused(says) as error:
        rs.load_scenario(file)
    assert "scenario.yaml:" in str(error.value) or "route.csv" in str(error.value)


# Files and reports.


def test_the_command_line_names_poses_by_time(tool, tmp_path):
    file = write_path(tmp_path, UNCERTAIN)
    at = ("--target", 0.05, "--at", 1000, "--method", "linear", "--no-plot")
    done = tool("budget", file, *at)
    assert done.code == 0
    assert "at 1000 s" in done.out
    target = read_record(tmp_path / "figures/paper_budget.json")["summary"]["target"]
    assert target["at_s"] == 1000
    assert target["required_accuracy"]["all"]["time_s"] == 1000
    table = (tmp_path / "figures/paper_budget.csv").read_text()
    assert table.startswith("time_s,three_sigma_aircraft_position")
    assert table.splitlines()[2].startswith("500.0,")
    missed = tool("budget", file, "--target", 0.05, "--at", 900)
    assert missed.code == 2
    assert "no pose at 900 s, the nearest of 4 is at 1000 s" in missed.err


def test_places_are_written_with_the_digits_they_need():
    values = np.array([0.1, 0.2, 0.1 + 0.2, 1e6 + 0.125, 2e6])
    when = axis.time(values)
    top = np.array([0, 0, 1.0, 0, 1])
    assert at(peak(top, when), when) == "1.0000 at 0.3 and 2000000 s"
    assert describe_poses(top < 1, when) == "at 0.1 to 0.2, 1000000.125 s"
    far = axis.distance(1000 * values)
    assert describe_poses(top > 0, far) == "at 300, 2000000000 m"


def test_a_distance_at_which_the_aircraft_hovers_names_no_pose():
    flown = axis.distance(np.array([0.0, 500, 500, 900]))
    assert [flown.pose_at(value) for value in (0.0, 900.4)] == [0, 3]
    with pytest.raises(rs.InputError, match="several poses are at 500 m"):
        flown.pose_at(500.0)


LABELS = [
    ("time", 30 * 3600, "Time [s]", 1),  # as in the sentences and in the tables
    ("distance", 4000, "Distance flown [km]", 1000),
]


@pytest.mark.parametrize(("kind", "span", "label", "unit"), LABELS)
def test_figures_have_the_unit_that_fits(tmp_path, kind, span, label, unit):
    values = np.linspace(7.0, 7.0 + span, 4)
    s = with_arrays(load(tmp_path), axis=getattr(axis, kind)(values))
    figure = analyses.variance(s, method="linear").plot()
    (axes,) = figure.axes
    assert axes.get_xlabel() == label
    assert axes.lines[0].get_xdata() == pytest.approx(values / unit)
    assert axes.get_xlim() == pytest.approx((7 / unit, (7 + span) / unit))


@pytest.mark.parametrize("name", ["sensitivity", "montecarlo", "compare", "detectors", "rcs"])
def test_every_analysis_takes_a_path(tool, tmp_path, name):
    done = tool(name, write_path(tmp_path, UNCERTAIN, analysis__runs=20), "--no-plot")
    assert done.code == 0, done.err
    for ending in ("json", "csv"):
        assert "theta_r" not in (tmp_path / f"figures/paper_{name}.{ending}").read_text()


def test_the_numbers_of_the_path_example():
    s = rs.load_scenario(CONFIGS / "path.yaml")
    result = analyses.budget(s)
    time, total = result.table["time_s"], result.table["three_sigma_total"]
    assert result.summary["largest_three_sigma_total"]["time_s"] == [768]
    assert total.max() == pytest.approx(0.13, abs=0.005)
    share = (result.table["three_sigma_aircraft_orientation"] / total) ** 2
    for at_s, expected in {768: 0.30, 400: 0.12, 1100: 0.19}.items():
        assert share[time == at_s] == pytest.approx(expected, abs=0.01)
    assert share[time == 822] < 1e-3
    p_d = s.model.p_d(s.aircraft, s.radar)
    for at_s, expected in {748: 0.90, 820: 0.21}.items():
        assert p_d[time == at_s] == pytest.approx(expected, abs=0.01)
    level = s.aircraft.copy()
    level[:, 3] = 0
    assert abs(p_d - s.model.p_d(level, s.radar)).max() < 0.018
    turning = (time > 760) & (time < 830)
    bank = np.degrees(s.aircraft[turning, 3])
    assert bank == pytest.approx(np.degrees(np.arctan(200**2 / (9.80665 * 12e3))), abs=1)
