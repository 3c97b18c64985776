"""The map: cells against the model, bounds against propagate, the files and the figure."""

import dataclasses
import math
import re

import numpy as np
import pytest
from earth import flight
from helpers import (
    CONFIGS,
    corridor,
    csv_text,
    known_to,
    lay_out,
    legend_off_data,
    paper_radar,
    scenario,
    with_arrays,
)
from matplotlib.collections import LineCollection
from scipy.optimize import brentq

import radar_sense as rs
from radar_sense import words
from radar_sense.analyses import coverage_map
from radar_sense.analyses.map import _unknown
from radar_sense.coverage import grid as area
from radar_sense.model import geodesy as wgs84
from radar_sense.progress import listening
from radar_sense.propagation import propagate_scenario

pytestmark = pytest.mark.usefixtures("quick")

#: Methods without draws, which a map can have in every cell.
SMOOTH = ("linear", "probit", "form")
WITHOUT_HORIZON = {f"radars.{name}.horizon": False for name in ("search", "ridge")}
SMALL = {"north_km": (-600, 600), "east_km": (-300, 700), "step_km": 50}


def poses_of(s, north, east):
    """Poses (n, m, 6) of cells, at the height and attitude of the first pose of a scenario."""
    states = np.zeros((len(north), len(east), 6))
    states[..., 0], states[..., 1] = north[:, None], east
    states[..., 2:] = s.aircraft[0, 2:]
    return states


def square(s, corner, down=None, course=None, side=1e3):
    """Four cells whose south-west corner is a place."""
    north, east = (corner[i] + np.array([0, side]) for i in (0, 1))
    return area.Grid(s, area.pose_in_cells(s, down, course), north, east)


def test_cells_are_those_of_the_model():
    s = scenario(aircraft__attitude_deg=[3, -2, 90], geometry__down_km=-4)
    for given, pose in (
        ({"down_km": -7, "course_deg": 20}, [-7e3, *np.deg2rad([3, -2, 20])]),
        ({}, [-4e3, *np.deg2rad([3, -2, 90])]),
    ):
        table = coverage_map(s, **given, **SMALL).table
        north, east, p_d = table["north_m"], table["east_m"], table["p_d"]
        assert p_d.shape == (25, 21)
        assert p_d.dtype == np.float32
        for i, j in ((0, 0), (3, 17), (24, 20), (12, 5)):
            state = [north[i], east[j], *pose]
            np.testing.assert_allclose(p_d[i, j], s.model.p_d(state, s.radar), rtol=1e-7)
        assert (*north[[0, -1]], *east[[0, -1]]) == (-600e3, 600e3, -300e3, 700e3)


@pytest.mark.parametrize(
    ("config", "changes", "reach", "step", "k", "method"),
    [
        *(("paper", {"analysis.level": "high"}, 600, 150, 2.0, method) for method in SMOOTH),
        # tolerances of decibels: FORM's bound is not that for a Gaussian c_r
        *(("s_band_surveillance", {}, 250, 50, 3.0, method) for method in SMOOTH),
        ("paper", {}, 600, 150, -2.0, "form"),
        # in some cells errors may take the aircraft across the limit of one of three radars
        *(("network", WITHOUT_HORIZON, 250, 30, k, "form") for k in (3.0, -3.0)),
    ],
)
def test_cells_and_bound_are_those_of_propagate(config, changes, reach, step, k, method):
    """With a negative k the bound is the lower one."""
    s = rs.load_scenario(CONFIGS / f"{config}.yaml", changes)
    cells = area.grid(s, north_km=(-reach, reach), east_km=(10, reach + 10), step_km=step)
    p_d, bound = area.p_d_in_cells(cells, method=method, beta=k)
    poses = poses_of(s, cells.north, cells.east)
    np.testing.assert_array_equal(p_d, s.model.p_d(poses, s.radar).astype(np.float32))
    moments = propagate_scenario(s.at_states(poses), method=method, beta=abs(k))
    true = moments.upper if k > 0 else moments.lower
    std, true = (np.reshape(values, cells.shape) for values in (moments.std, true))
    # one bound settles in some more cells than all that a mean takes
    known = ~np.isnan(std)
    assert known.mean() > 0.9
    crossed, (*_, radar) = np.zeros(cells.shape, dtype=bool), s.radars
    if config == "network":
        distance = np.linalg.norm(poses[..., :3] - radar.state[:3], axis=-1)
        # 2 % of the tail of 3 sigma is beyond 4.04 sigma
        error = 4.04 * np.sqrt([s.cov_aircraft[0, 0], radar.levels[s.level].covariance[0, 0]]).sum()
        beyond = np.sign(k) * (distance - radar.max_range)
        crossed = (beyond > 0) & (beyond < error)
        assert np.any(np.sign(k) * (bound - true)[crossed] > 0.05)
        rare = crossed & (beyond > 0.75 * error)  # more than 3 sigma away
        assert np.any(np.sign(k) * (bound - true)[rare] > 1e-3)
    assert np.all(np.sign(k) * (bound - true)[crossed] >= -1e-7)
    known &= ~crossed
    np.testing.assert_allclose(bound[known], true[known], rtol=2e-7, atol=1e-12)
    np.testing.assert_array_less(bound[~known & ~np.isnan(bound)], 1.0001)
    states = s.model, poses, s.radar, s.cov_aircraft, s.cov_radar
    gaussian = rs.propagate(*states, method=method, beta=abs(k))
    off = np.nanmax(abs(bound - (gaussian.upper if k > 0 else gaussian.lower))[~crossed])
    assert off > 0.02 if any(s.tolerances) and method == "form" else off < 1e-6


def test_a_map_of_the_round_earth_is_at_one_height_above_it(tmp_path):
    """Cells at the poses of the route have the values of the route."""
    places = [
        (place, 8.0 + east, 9000.0) for place, east in ((47, 0), (51, 0), (44.5, 9), (47, -9))
    ]
    s = flight(tmp_path, places, (47, 8, 400), (1, 2, 75), radar__constant=40)
    origin = (*np.deg2rad([47.0, 8.0]), 400.0)
    assert s.origin == pytest.approx(origin)
    place = np.array(places) * [math.pi / 180, math.pi / 180, 1]
    expected = wgs84.ned_from_geodetic(place, origin)
    np.testing.assert_allclose(s.aircraft[:, :3], expected, rtol=1e-12, atol=1e-6)
    for state in s.aircraft[1:]:  # the farthest is 700 km away, and 39 km lower
        p_d, bound = area.p_d_in_cells(square(s, state), method="probit")
        assert p_d[0, 0] == pytest.approx(s.model.p_d(state, s.radar), rel=1e-6)
        assert bound[0, 0] > p_d[0, 0]
        turned = area.p_d_in_cells(square(s, state, -8600.0, math.radians(75)))[0]
        np.testing.assert_allclose(turned, p_d, rtol=1e-6)
        low = area.p_d_in_cells(square(s, state, -2000.0))[0][0, 0]
        assert low != pytest.approx(p_d[0, 0], rel=1e-4)
    result = coverage_map(s, north_km=(-80, 90), east_km=(10, 60), step_km=12)
    summary = result.summary
    for axis in ("north", "east"):
        ends = result.table[f"{axis}_m"][[0, -1]] / 1e3
        assert summary[f"{axis}_km"] == pytest.approx(ends.tolist())
    assert summary["down_km"] == pytest.approx(-8.6, abs=1e-9)
    assert summary["attitude_deg"] == pytest.approx([1, 2, 75])


@pytest.mark.parametrize("compute", ["probit", "form", "worst heading"])
def test_blocks_and_threads_do_not_matter(monkeypatch, compute):
    s, done = scenario(aircraft__attitude_deg=[3, -2, 90]), []
    cells = area.grid(s, north_km=(-600, 600), east_km=(-300, 500), step_km=400)

    def planes(workers):
        if compute == "worst heading":
            return area.worst_p_d_in_cells(cells, workers=workers)
        return area.p_d_in_cells(cells, method=compute, workers=workers)

    with listening(lambda *step: done.append(step)):
        one = planes(1)
    assert done[0] == ("cells", 0, 12)
    assert done[-1] == ("cells", 12, 12)
    for size, workers in ((1, 2), (3, 1), (4, 3)):
        monkeypatch.setattr("radar_sense.states.BLOCK", size)
        for a, b in zip(one, planes(workers), strict=True):
            assert a.tobytes() == b.tobytes()


def brute_force(s, cells, count=20_000):
    """Largest P_D over headings in each cell, by the model at very many headings."""
    states = np.repeat(cells.states()[..., np.newaxis, :], count, axis=-2)
    states[..., 5] = np.linspace(0, 2 * np.pi, count)
    return s.model.p_d(states, s.radar).max(axis=-1)


RCS = {
    "needle": {"model": "ellipsoid", "a_m": 1.5, "b_m": 0.02, "c_m": 0.05},
    "lobes": {"model": "spikeball", "lobes": 388, "amplitude_m2": 0.2, "floor_m2": 0.01},
    "constant": {"model": "constant", "rcs_m2": 0.1},
    "table": {"model": "table", "file": str(CONFIGS / "synthetic_aircraft.csv"), "mirror": True},
}


@pytest.mark.parametrize(
    ("rcs", "attitude"),
    [*((rcs, [-12, 8, 100]) for rcs in ("lobes", "constant", "table")), ("needle", [0, 0, 0])],
)
def test_the_worst_heading_is_that_of_brute_force(rcs, attitude):
    s = scenario(aircraft__rcs=RCS[rcs], aircraft__attitude_deg=attitude)
    sides = {"north_km": (200, 500), "east_km": (-350, 0), "step_km": 300}
    cells = area.grid(s, **sides)
    for _ in range(40):  # a radar for which P_D is neither 0 nor 1
        off = np.median(brute_force(s, cells, count=400)) - 0.6
        if abs(off) < 0.1:
            break
        s = with_arrays(s, radar=s.radar * [1, 1, 1, 0.6 if off > 0 else 1.5])
    cells = area.grid(s, **sides)
    largest, heading = area.worst_p_d_in_cells(cells)
    expected = brute_force(s, cells)
    assert np.ptp(expected) > 0.1  # neither 0 nor 1 everywhere
    # 20 000 headings miss the peak of a lobe by 1.6e-4 rad at most
    assert np.all(largest >= expected - 1e-6)
    np.testing.assert_allclose(largest, expected, atol=1e-3)
    # the value is P_D at the named heading
    aircraft = cells.states()
    aircraft[..., 5] = np.deg2rad(heading)
    np.testing.assert_allclose(s.model.p_d(aircraft, s.radar), largest, atol=2e-5)


@pytest.mark.parametrize(
    ("second", "lower", "other"), [(209.47, 10.198, 299.68), (200.58, 10.12, 299)]
)
def test_of_two_lobes_the_higher_one_is_found(tmp_path, second, lower, other):
    """The samples show the lower one higher: they miss the peak of the other. P_D is steep."""
    nodes = [a for a in range(0, 360, 10) if abs(a - second) > 6 and a != 300]
    rows = [(a, lower if a == 90 else -10.0) for a in [*nodes, other]] + [(second, 10.3)]
    s = steep(tmp_path, sorted(rows))
    cells = area.grid(s, north_km=(24, 26), east_km=(0, 2), step_km=1)
    expected = brute_force(s, cells)
    assert 0.04 < expected.min() < 0.9
    np.testing.assert_allclose(area.worst_p_d_in_cells(cells)[0], expected, atol=1e-4)


def test_the_worst_heading_of_several_radars_and_many_lobes():
    """P_D of four radars has a lobe that the two samples beside its highest one do not show."""
    rows = [
        ("one", [-8988.9, -24551, -20], 0.007578, 3.265e-6, "north"),
        ("two", [7187.3, 19465, -20], 0.001035, 1.954e-5, {"model": "swerling4", "pulses": 10}),
        ("three", [-10360, -13784, -20], 0.002867, 3.667e-7, {"model": "swerling2", "pulses": 10}),
        ("four", [-9813.2, -2660.6, -20], 0.003361, 1.318e-7, {"model": "swerling2", "pulses": 10}),
    ]
    keys = ("name", "position_m", "constant", "p_fa", "detector")
    known = {"uncertainty": {"medium": {"position_m": 10, "constant": 1e-4}}}
    lobes = {"model": "spikeball", "lobes": 26, "amplitude_m2": 0.7581, "floor_m2": 0.01421}
    s = scenario(
        radars=[dict(zip(keys, row, strict=True)) | known for row in rows],
        aircraft={"rcs": lobes, "attitude_deg": [0.43889, -9.0712, 0]},
    )
    cells = square(s, (60e3, -60e3), side=1e4)
    expected = brute_force(s, cells)
    np.testing.assert_allclose(area.worst_p_d_in_cells(cells)[0], expected, atol=1e-5)


@pytest.mark.parametrize("seed", [14, 50, 71, 78])
def test_the_worst_heading_of_a_table_of_random_lobes(tmp_path, seed):
    """With a smaller `RISE` one of these tables has a cell that is wrong by 0.003 or more."""
    values = np.random.default_rng(seed).uniform(-12, 10, 18).round(2)
    s = steep(tmp_path, list(zip(range(0, 360, 20), values.tolist(), strict=True)))
    cells = area.grid(s, north_km=(20, 27), east_km=(0, 7), step_km=1)
    expected = brute_force(s, cells, 1441)
    np.testing.assert_allclose(area.worst_p_d_in_cells(cells)[0], expected, atol=1e-3)


def steep(folder, rows, head="azimuth_deg,rcs_dbsm", **changes):
    """A radar whose P_D is steep in the RCS, and a table of an aircraft in level flight."""
    (folder / "rcs.csv").write_text(csv_text(head, rows))
    rcs = {"model": "table", "file": str(folder / "rcs.csv")}
    given = {
        "aircraft": {"rcs": rcs, "attitude_deg": [0, 0, 0]},
        "radar__detector": {"model": "marcum", "pulses": 100},
        "radar__constant": 2e-7,
        "radar__p_fa": 1e-6,
    }
    return scenario(**{**given, **changes})


def test_the_worst_heading_of_a_network_on_the_round_earth():
    """Radars whose lobes are at different headings; the heading is relative to each cell."""
    s = corridor()
    assert s.origin is not None
    assert len(s.model.radars) > 1

    def at(course=None):
        return square(s, s.aircraft[40], None, course, 3e4)

    largest, heading = area.worst_p_d_in_cells(at())
    courses = np.linspace(0, 2 * np.pi, 181)
    each = np.array([area.p_d_in_cells(at(course))[0] for course in courses])
    assert np.all(largest >= each.max(axis=0) - 1e-6)
    np.testing.assert_allclose(largest, each.max(axis=0), atol=1e-3)
    (there,) = area.p_d_in_cells(at(np.deg2rad(heading[0, 1])))
    assert there[0, 1] == pytest.approx(largest[0, 1], abs=1e-5)


THIN = {"model": "ellipsoid_exact", "x_m": 0.1, "y_m": 0.3, "z_m": 0.3}


@pytest.mark.parametrize(
    ("changes", "area_m2"),
    [
        # P_D is 0 within 30 km, around the whole route, and reaches 0.1 at some 50 km
        ({"aircraft__rcs": {"model": "constant", "rcs_m2": 1}, "radar__min_range_km": 30}, 1),
        # P_D reaches 0.1 three times as far ahead and behind as abeam
        *(
            ({"aircraft__rcs": THIN, "aircraft__attitude_deg": [0, 0, yaw]}, np.pi * 0.9**2)
            for yaw in (0, 90)
        ),
    ],
)
def test_the_contour_may_be_beyond_a_blind_zone_or_leave_two_sides_alone(changes, area_m2):
    radar = {"constant": 4e-4, "p_fa": 1e-6, "detector": "swerling1", "position_m": [0, 0, -3e3]}
    result = coverage_map(scenario(**{"radar": radar, "geometry__range_km": 10, **changes}))
    # P_D = P_fa^(1/(1 + S)) is 0.1 at S = 5
    farthest = (4e-4 * area_m2 / (1.380649e-23 * 5)) ** 0.25
    assert farthest < result.table["north_m"].max() < 1.3 * farthest
    assert (result.table["p_d"] >= 0.1).any()


def test_a_lobe_between_the_tens_of_degrees_of_elevation_is_found(tmp_path):
    """The lobe is one degree wide, at elevations from −6 to −4 deg: brute force over headings."""
    rows = [
        (a, e, 10 if abs(a - 37.5) < 0.6 and e in (-6, -5, -4) else -15)
        for e in range(-15, 16)
        for a in (*range(-180, 35, 5), *np.arange(35, 40, 0.5), *range(40, 180, 5))
    ]
    weak = {"radar__constant": 0.005, "radar__detector": "swerling1", "geometry__down_km": -5}
    s = steep(tmp_path, rows, "azimuth_deg,elevation_deg,rcs_dbsm", **weak)
    cells = square(s, (-68e3, 4e3), side=4e3)
    expected = brute_force(s, cells, count=7200)
    np.testing.assert_allclose(area.worst_p_d_in_cells(cells)[0], expected, atol=2e-3)


def test_the_route_has_its_own_probabilities():
    """At 820 s the nose is on the radar: P_D is 0.21, and 0.94 at the heading of the map."""
    s = rs.load_scenario(CONFIGS / "path.yaml")
    north, east = s.aircraft[:, 0] / 1e3, s.aircraft[:, 1] / 1e3
    result = coverage_map(s, step_km=40)
    np.testing.assert_array_equal(result.draw.keywords["route"], s.model.p_d(s.aircraft, s.radar))
    pose = int(np.argmin(abs(s.time_s - 820)))
    assert result.draw.keywords["route"][pose] == pytest.approx(0.21, abs=0.01)
    cell = (
        np.argmin(abs(result.table["north_m"] / 1e3 - north[pose])),
        np.argmin(abs(result.table["east_m"] / 1e3 - east[pose])),
    )
    assert result.table["p_d"][cell] > 0.9
    assert "0.2144 to" in result.report[-1]
    figure = result.plot()
    axes = figure.axes[0]
    (line,) = [c for c in axes.collections if isinstance(c, LineCollection)]
    assert len(line.get_segments()) == len(north) - 1
    route = result.draw.keywords["route"]
    np.testing.assert_allclose(line.get_array(), 0.5 * (route[1:] + route[:-1]))
    (image,) = axes.images
    assert line.get_clim() == image.get_clim() == (0, 1)
    assert line.get_cmap().name == image.get_cmap().name
    assert axes.get_title() == "9 km above the origin, heading 90 deg"
    upper = coverage_map(s, step_km=40, upper=True, method="probit")
    bound = rs.analyses.variance(s, method="automatic").table["upper_3sigma"]
    np.testing.assert_array_equal(upper.draw.keywords["route"], bound)
    worst = coverage_map(s, step_km=40, worst_heading=True)
    assert set(worst.table) == {"north_m", "east_m", "p_d", "worst_heading_deg"}
    axes, bar = worst.plot().axes
    assert axes.get_title() == "9 km above the origin, worst heading"
    assert "Largest" in bar.get_ylabel()
    assert "worst heading" in worst.report[0]
    assert np.all(worst.table["p_d"] >= result.table["p_d"])


def test_the_default_grid_has_radar_and_path_in_it():
    for s in (scenario(), scenario(radar__position_m=[2e6, -1e5, 0])):
        cells = area.grid(s)
        for axis, ends in enumerate((cells.north, cells.east)):
            assert ends[0] < min(s.aircraft[:, axis].min(), s.radar[axis])
            assert ends[-1] > max(s.aircraft[:, axis].max(), s.radar[axis])
        assert cells.shape == (501, 501)


@pytest.mark.parametrize("upper", [False, True])
def test_the_default_map_shows_all_of_its_contours(upper):
    s = scenario(aircraft__rcs={"model": "constant", "rcs_m2": 0.1}, geometry__range_km=300)
    column = "upper_3sigma" if upper else "p_d"
    found = []
    for level in (0.05, 0.5):
        result = coverage_map(s, upper=upper, p_d=(level, 0.9), step_km=20)
        plane = result.table[column]
        around = np.concatenate([plane[0], plane[-1], plane[:, 0], plane[:, -1]])
        assert np.all(around < level)
        found.append(result.table["east_m"][-1])
    assert found[0] > found[1]
    # What is asked for stands, and P_D below P_fa is found at any distance.
    assert coverage_map(s, east_km=(0, 300), step_km=20).table["east_m"][-1] == 300e3
    everywhere = coverage_map(s, p_d=(1e-9,), step_km=20)
    np.testing.assert_array_equal(everywhere.table["east_m"], area.grid(s, step_km=20).east)


def test_summary_and_report():
    """With a constant RCS P_D falls with range alone: the areas are circles."""
    s = scenario(aircraft__rcs={"model": "constant", "rcs_m2": 0.1}, geometry__down_km=0)
    result = coverage_map(s, north_km=(-1000, 1000), east_km=(-1000, 1000), step_km=4)
    for level, found in result.summary["area_km2_at_or_above"].items():

        def above(distance, level=float(level)):
            return s.model.p_d([distance, 0, 0, 0, 0, 0], s.radar) - level

        farthest = brentq(above, 1e3, 1e7)
        assert found == pytest.approx(math.pi * (farthest / 1e3) ** 2, rel=2e-3)
    assert result.summary["area_km2"] == 501**2 * 16
    assert result.summary["shown"] == "p_d"
    # the aircraft is at the radar in the cell in the middle, which is true of any map
    assert not result.warnings
    assert np.isnan(result.table["p_d"][250, 250])
    assert set(result.table) == {"north_m", "east_m", "p_d"}


def test_areas_are_of_cells_at_or_above_each_level():
    s = scenario()
    first = coverage_map(s, **SMALL)
    p_d = first.table["p_d"]
    own = float(p_d[3, 4])  # the cell is at this level, not above
    result = coverage_map(s, **SMALL, p_d=[0.9, own, 0.1, 0.9])
    levels = sorted([0.1, 0.9, own])
    assert result.summary["contours"] == levels
    cells = [sum(value >= level for value in p_d.ravel().tolist()) for level in levels]
    assert result.summary["area_km2_at_or_above"] == {
        f"{level:.12g}": 50 * 50 * count for level, count in zip(levels, cells, strict=True)
    }
    assert result.report[1:4] == tuple(
        f"  {level:.12g} or more in {100 * count / p_d.size:.1f} % of the area, "
        f"{float(f'{2500 * count:.4g}'):,.0f} km^2"
        for level, count in zip(levels, cells, strict=True)
    )


def test_cells_beyond_the_table_of_the_rcs_are_counted(tmp_path):
    """A cell counts once, whichever of the radars the aircraft sees beyond the table."""
    rows = [(azimuth, e, 1) for azimuth in (0, 90, 180, 270) for e in (-30, 30)]
    (tmp_path / "rcs.csv").write_text(csv_text("azimuth_deg,elevation_deg,rcs_m2", rows))
    s = scenario(
        geometry__down_km=-20,
        aircraft__rcs={"model": "table", "file": str(tmp_path / "rcs.csv")},
        radars=[
            paper_radar(f"r{i}", position_m=[north, 0, 0]) for i, north in enumerate((-2e4, 2e4))
        ],
    )
    result = coverage_map(s, north_km=(-200, 200), east_km=(-105, 105), step_km=10)
    north, east = np.meshgrid(result.table["north_m"], result.table["east_m"])
    near = 20e3 / math.tan(math.pi / 6)
    count = np.count_nonzero(np.hypot(abs(north) - 2e4, east) < near)  # of the nearer radar
    assert f"in {count} of {result.table['p_d'].size} cells the aircraft sees a radar" in str(
        result.warnings
    )


def test_a_map_warns_of_bounds_above_one_and_of_unreliable_bounds():
    s = scenario().with_analysis(level="high")
    linear = coverage_map(s, **SMALL, upper=True, method="linear")
    assert any("leaves [0, 1]" in w and w.endswith(" [band-outside]") for w in linear.warnings)
    assert any(
        "off in" in w and w.endswith("; use --method automatic [band-off]") for w in linear.warnings
    )
    vague = scenario(**known_to(constant=100))
    below = coverage_map(vague, **SMALL, lower=True, method="linear")
    assert any("leaves [0, 1]" in w for w in below.warnings)
    probit = coverage_map(s, **SMALL, upper=True, method="probit")
    assert not any("leaves [0, 1]" in w for w in probit.warnings)
    assert probit.summary["shown"] == "upper_3sigma"
    assert "high, probit" in probit.report[0]
    automatic = coverage_map(s, **SMALL, upper=True, method="automatic")
    assert "high, form" in automatic.report[0]  # draws in every cell take too long
    # only its lower bound is off, in one of the cells
    assert not any("off in" in w for w in automatic.warnings)


@pytest.mark.parametrize(
    ("changes", "upper"),
    [
        ({"radar__position_m": [2e6, -1e5, 0]}, False),
        ({"geometry__range_km": 1}, False),  # detected everywhere: no line to draw
        ({}, True),
    ],
)
def test_figure(changes, upper):
    s = scenario(**changes)
    fine = area.grid(s)
    step_km = 12.5 * (fine.north[1] - fine.north[0]) / 1e3
    result = coverage_map(s, upper=upper, step_km=step_km)
    figure = lay_out(result.plot())
    axes, bar = figure.axes
    assert axes.get_aspect() == 1
    assert axes.get_xlabel() == "East [km]"
    assert axes.get_ylabel() == "North [km]"
    assert "P_D" in bar.get_ylabel()
    labels = [text.get_text() for text in legend_off_data(figure).get_texts()]
    assert labels == [f"route, by its own {'bound' if upper else '$P_D$'}", "radar"]
    (image,) = axes.images
    low, high = axes.get_xlim()
    assert low <= s.radar[1] / 1e3 <= high
    # north is up, and east to the right
    east = result.table["east_m"]
    assert image.get_extent()[0] == pytest.approx((east[0] - 0.5 * (east[1] - east[0])) / 1e3)
    assert image.origin == "lower"


def test_a_long_or_wide_map_still_fits():
    for north, east in (((-50, 900), (0, 90)), ((0, 90), (-600, 600))):
        figure = coverage_map(scenario(), north_km=north, east_km=east, step_km=10).plot()
        box = lay_out(figure).axes[0].get_window_extent()
        assert min(box.width, box.height) > 20


@pytest.mark.all_draws
@pytest.mark.parametrize("limits", [{"max_range_km": 41.2}, {"min_range_km": 45}])
@pytest.mark.parametrize(
    ("end", "off", "least"), [("upper", "high", "most"), ("lower", "low", "least")]
)
def test_a_limit_that_errors_may_cross_makes_no_bound_too_good(limits, end, off, least):
    """By FORM a radar sees nothing beyond its limit and all within it: errors may cross it."""
    s = scenario(
        radar={"position_m": [0, 0, 0], "p_fa": 1e-6, "constant": 50, **limits},
        aircraft__rcs={"model": "constant", "rcs_m2": 1.0},
        **known_to(1000, 1, position_m=10, constant=1),
    )
    sides = {"step_km": 1, "north_km": (36, 50), "east_km": (0, 1)}
    result = coverage_map(s, **{end: True}, **sides)
    shown = result.table[f"{end}_3sigma"].ravel()
    states = poses_of(s, result.table["north_m"], result.table["east_m"])
    true = propagate_scenario(s.at_states(states))
    excess = shown - getattr(true, end) if end == "upper" else getattr(true, end) - shown
    assert np.all(excess >= -0.005 - 3 * true.error)
    # four sigma beyond the limit
    assert shown.min() == 0
    assert shown.max() > 0.5
    told = [text for text in result.warnings if text.endswith("[band-off]")]
    areas = [line for line in result.report if "of the area" in line]
    assert all(f"in at {least} " * len(told) in line for line in areas)
    for warning in told:
        assert re.search(
            rf"checked: too {off} in \d+ of \d+ by up to [\d.]+, in others perhaps by more; use",
            warning,
        )


def test_errors_as_large_as_the_distance_are_no_limit():
    """A radar without limits sees the aircraft straight above it, wherever both are."""
    s = scenario(radar__position_m=[0, 0, 0], geometry__down_km=-0.5, **known_to([400, 400, 40]))
    sides = {"step_km": 0.2, "north_km": (-1, 1), "east_km": (0.3, 0.9)}
    shown = coverage_map(s, lower=True, **sides).table["lower_3sigma"]
    assert np.nanmin(shown) > 0.999


def test_no_lower_bound_is_above_p_d_where_draws_have_none(tmp_path):
    """The curvature is too large for FORM: errors of 2 km at 5 km, above a steep beam."""
    beam = ["-10,-12", "-4,-5", "-1,-0.5", "0,0", "2,-1", "8,-7", "30,-20"]
    (tmp_path / "gain.csv").write_text("\n".join(["elevation_deg,gain_db", *beam]))
    s = scenario(
        radar={
            "position_m": [0, 0, -160], "p_fa": 1e-8, "constant": 5.795e-8,
            "detector": {"model": "swerling2", "pulses": 6},
            "elevation_gain": {"file": str(tmp_path / "gain.csv")}, "tilt_deg": 7.98,
        },
        aircraft={
            "rcs": {"model": "spikeball", "lobes": 6, "amplitude_m2": 1, "floor_m2": 0.1},
            "attitude_deg": [-3.8, -2.4, 147.3],
        },
        geometry__down_km=-1.2,
        **known_to(500, position_m=2000, tilt_deg=1.145),
    )  # fmt: skip
    sides = {"north_km": (-4.5, -4), "east_km": (2, 2.5), "step_km": 0.5}
    table = coverage_map(s, lower=True, k=2.0, **sides).table
    assert np.nanmax(table["lower_2sigma"] - table["p_d"]) < 1e-4


def test_a_bound_that_is_shown_is_judged_where_the_moments_have_no_value():
    """FORM finds an upper bound in cells where its other quantiles do not converge."""
    s = scenario(
        aircraft={
            "rcs": {"model": "spikeball", "lobes": 24, "amplitude_m2": 0.5, "floor_m2": 0.05},
            "attitude_deg": [1.6, -8.2, 142.5],
        },
        radar={"position_m": [0, 0, 0], "p_fa": 1e-6, "constant": 5e-3, "detector": "swerling3"},
        **known_to(600, [0.3, 0.6, 4.4], rcs_db=2.4, position_m=10, constant=1e-3),
    )
    result = coverage_map(s, upper=True, north_km=(30, 70), east_km=(30, 70), step_km=5)
    shown = result.table["upper_3sigma"].ravel()
    states = poses_of(s, result.table["north_m"], result.table["east_m"])
    true = propagate_scenario(s.at_states(states)).upper
    most = np.nanmax(abs(true - shown))
    assert most > 0.01
    (warning,) = (text for text in result.warnings if text.endswith("[band-off]"))
    assert f"by up to {most:.2g}" in warning


@pytest.mark.parametrize("end", ["upper", "lower"])
def test_a_cell_without_a_value_counts_as_above_or_below_every_contour(end):
    """Straight above the radar the bound by linear has no gradient. Contours may be close."""
    s = scenario(radar__position_m=[0, 0, 0])
    cells = {"north_km": (-20, 20), "east_km": (-20, 20), "step_km": 20}
    levels = [0.1, 0.9999999, 0.99999990001]
    result = coverage_map(s, **{end: True}, method="linear", p_d=levels, **cells)
    shown = result.table[f"{end}_3sigma"]
    assert np.isnan(shown[1, 1])
    areas = result.summary["area_km2_at_or_above"]
    assert [*map(float, areas)] == levels
    for level, area_km2 in areas.items():
        known = np.count_nonzero(shown >= float(level))
        assert area_km2 == 400 * (known + (end == "upper"))
        assert any(line.startswith(f"  {level} or more in ") for line in result.report)


def test_a_map_covers_what_is_asked_for():
    """The step of 300 km does not lead from -400 to 400 km."""
    cells = area.grid(scenario(), north_km=(-400, 400), east_km=(0, 600), step_km=300)
    np.testing.assert_array_equal(cells.north, [-400e3, -100e3, 200e3, 500e3])
    np.testing.assert_array_equal(cells.east, [0, 300e3, 600e3])


def test_areas_are_on_the_earth(tmp_path):
    """The same place seen from its own origin and from one 30 deg away."""
    areas = []
    for origin in ((47, 9, 0), (30, 31, 0)):
        place = {"latitude_deg": 47, "longitude_deg": 9, "altitude_m": 0}
        s = flight(
            tmp_path,
            [(47, 9, 3000), (47.1, 9, 3000)],
            origin,
            radar={"position_geodetic": place, "constant": 0.005, "p_fa": 1e-6},
            aircraft__rcs={"model": "constant", "rcs_m2": 0.1},
        )
        areas.append(coverage_map(s, step_km=1).summary["area_km2_at_or_above"])
    near, far = areas
    assert near["0.5"] > 5000
    for level, expected in near.items():
        assert far[level] == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(
    ("yaw", "shown"),
    [(-90.0, "270"), (359.98, "0"), (-1e-15, "0"), (12.345, "12.35"), (90.0, "90")],
)
def test_a_heading_is_below_a_full_turn(yaw, shown):
    assert words.heading(yaw) == f"heading {shown} deg"


@pytest.mark.parametrize(("letters", "numbered"), [(5, False), (30, True)])
def test_many_long_names_are_numbers_on_the_map(letters, numbered):
    s = rs.load_scenario(CONFIGS / "network.yaml")
    names = [f"radar_{i}".ljust(letters, "x") for i in range(len(s.radars))]
    radars = [dataclasses.replace(r, name=name) for r, name in zip(s.radars, names, strict=True)]
    figure = coverage_map(dataclasses.replace(s, radars=radars), **SMALL).plot()
    shown = [text.get_text() for text in figure.axes[0].texts]
    assert shown == (["1", "2", "3"] if numbered else names)
    printed = figure.axes[0].get_title().replace("\N{NO-BREAK SPACE}", " ")
    assert (f"2 {names[1]}" in " ".join(printed.split())) == numbered


@pytest.mark.parametrize(("first", "unknown"), [(-1e3, 1), (5e3, 2)])
def test_cells_without_a_value_count_but_for_that_above_a_radar(first, unknown):
    """The radar is in the middle of nine cells, or beside them."""
    s = rs.load_scenario()
    centres = first + 1e3 * np.arange(3)
    shown = np.zeros((3, 3))
    shown[[0, 1], [0, 1]] = np.nan
    assert _unknown(area.Grid(s, s.aircraft[0], centres, centres), shown) == unknown
