"""Scenarios in latitude and longitude: the choice of the origin changes nothing.

The oracle is `earth.py`. Its earth-fixed coordinates have no origin.
"""

import math

import numpy as np
import pytest
from helpers import csv_text, few_draws, single, with_arrays, write_path
from routes import GEO, STD, geodetic, load, ned
from scenario_file.earth import DEG, height_of, sees, to_ned
from scenario_file.refused import refused

import radar_sense as rs
from radar_sense.acceptance.requirement import Requirement
from radar_sense.acceptance.threshold import path_test
from radar_sense.coverage.grid import Grid, p_d_in_cells, pose_in_cells
from radar_sense.coverage.rays import rays
from radar_sense.model.geometry import body_vector
from radar_sense.model.trajectory import resample
from radar_sense.montecarlo.exceedance import exceedance
from radar_sense.plausibility import plausibility_warnings
from radar_sense.propagation import propagate_scenario


def written(folder, radars, rows, origin, *, stds="", interpolate=None, **uncertainty):
    """Load a scenario with these radars, (latitude, longitude, altitude) each, and route rows."""
    keys = ("latitude_deg", "longitude_deg", "altitude_m")
    radar = {"constant": 1.0, "p_fa": 1e-6, "horizon": True, "scan_period_s": 20}
    radar["uncertainty"] = {"a": {"position_m": [3000, 900, 30], "constant": 0.1}}
    place, *places = (dict(zip(keys, map(float, at), strict=True)) for at in (origin, *radars))
    geometry = {"type": "path", "file": "route.csv", "origin": place}
    file = write_path(
        folder,
        csv_text(GEO + stds, rows),
        name="moved",
        radars=[{"name": f"r{i}", "position_geodetic": at, **radar} for i, at in enumerate(places)],
        aircraft={"rcs": {"model": "ellipsoid_exact", "x_m": 0.3, "y_m": 0.25, "z_m": 0.1}},
        geometry=geometry | ({"interpolate": interpolate} if interpolate else {}),
        uncertainty=uncertainty,
        analysis={"level": "a", "runs": 50, "seed": 1},
    )
    return rs.load_scenario(file)


AIRCRAFT = {"position_m": [900, 300, 50], "attitude_deg": [1.0, 2.0, 4.0]}
WITH_ATTITUDE = ",roll_deg,pitch_deg,yaw_deg"
#: A radar whose place and constant are known.
CERTAIN = {"a": np.zeros((4, 4))}


def level_to(yaw):
    """Return errors of an aircraft that knows level better than north."""
    return {"position_m": 10, "attitude_deg": [0.1, 0.1, yaw]}


@pytest.mark.parametrize("stds", [[], STD])
def test_a_nose_straight_down_is_refused_where_the_file_is_read(tmp_path, stds):
    """Level flight a quarter around the earth is straight down for the origin."""
    rows = [(0.0, 0, 0, 100, 0, 0, 90), (7.5, 0, 90, 100, 0, 0, 90)]
    rows = [(*row, *([1] * len(stds))) for row in rows]
    uncertain = {} if stds else {"aircraft": AIRCRAFT}
    names = WITH_ATTITUDE + "".join(f",{name}" for name in stds)
    with refused("scenario.yaml:... geometry: at time_s 7.5 ... straight up or down"):
        written(tmp_path, [(0, 1, 15)], rows, (0, 0, 0), stds=names, **uncertain)


@pytest.mark.parametrize(
    ("altitude", "geoid", "told"),
    [(-106, None, None), (-108, None, "108 m below the ellipsoid"),
     (-90, 60.0, "150 m below the sea level"), (-160, -60.0, None)],
)  # fmt: skip
def test_an_aircraft_is_below_the_sea_level_that_is_stated(tmp_path, altitude, geoid, told):
    rows = [(60 * i, 40.1 + 0.01 * i, 10, altitude) for i in range(3)]
    written(tmp_path, [(40, 10, 15)], rows, (40, 10, 0), aircraft=AIRCRAFT)
    above = {"geometry.geoid_height_m": geoid, "geometry.altitude_above": "ellipsoid"}
    s = rs.load_scenario(tmp_path / "scenario.yaml", above if geoid is not None else {})
    texts = [text for text in plausibility_warnings(s) if "the aircraft is below" in text]
    assert len(texts) == (told is not None)
    assert all(told in text for text in texts)


@pytest.mark.parametrize("above", ["ellipsoid", "sea"])
@pytest.mark.parametrize("geoid", [-90.0, 60.0])
def test_the_horizon_is_that_of_the_sea_level(tmp_path, above, geoid):
    """A radar 15 m and an aircraft 80 m above the sea, 20 km within and beyond the horizon."""
    farthest = math.sqrt(2 * 4 / 3 * 6.371e6) * (math.sqrt(15) + math.sqrt(80))
    given = 80 + (0.0 if above == "sea" else geoid)
    latitude = 40 + np.array([farthest - 20e3, farthest + 20e3]) / 111.1e3
    rows = [(60 * i, x, 10, given) for i, x in enumerate(latitude)]
    written(tmp_path, [(40, 10, 15 + geoid)], rows, (40, 10, 0), aircraft=AIRCRAFT)
    keys = {"geometry.geoid_height_m": geoid, "geometry.altitude_above": above}
    s = rs.load_scenario(tmp_path / "scenario.yaml", keys)
    assert (s.p_d() > 0).tolist() == [True, False]
    assert not [text for text in plausibility_warnings(s) if "below-ground" in text]
    assert rs.analyses.check(s).passed
    off = rs.load_scenario(tmp_path / "scenario.yaml")  # of the ellipsoid
    if above == "ellipsoid":
        assert (off.p_d() > 0).tolist() == ([False, False] if geoid < 0 else [True, True])


def test_the_origin_changes_nothing(tmp_path):
    """Random places, headings and heights; origins up to two thousand kilometres away."""
    rng = np.random.default_rng(12)
    poses = hidden = 0
    for _ in range(6):
        lat, lon = rng.uniform(-75, 75), rng.uniform(-170, 350)
        wide = 1 / math.cos(lat * DEG)
        here = np.array([lat, lon, 0.0])
        radars = here + rng.uniform([-2, -2, 0], [2, 2, 3e3], (2, 3)) * [1, wide, 1]
        toward, along = rng.uniform(0, 2 * math.pi), 0.12 * np.arange(-6, 7)
        north, east = along * math.cos(toward), wide * along * math.sin(toward)
        heights = rng.uniform(100, 200, 13) + 10 * np.arange(13)
        rows = np.stack([60.0 * np.arange(13), lat + north, lon + east, heights], axis=1)
        moved = [here, *(here + rng.uniform([-18, -18, -100], [18, 18, 5e3], (2, 3)))]
        moved = np.clip(moved, [-89, -999, -999], [89, 999, 9e3])
        moved[1:, 1] %= 360  # a longitude may be east of Greenwich all around
        scenarios = [written(tmp_path, radars, rows, origin, aircraft=AIRCRAFT) for origin in moved]
        margin = np.array([[sees(radar, row[1:]) for radar in radars] for row in rows])
        bands = [propagate_scenario(s, method="probit") for s in scenarios]
        p_d = scenarios[0].model.p_d(scenarios[0].aircraft, scenarios[0].radar)
        for s, origin, band in zip(scenarios, moved, bands, strict=True):
            seen = s.model.visible(s.aircraft, s.radar)
            np.testing.assert_array_equal(seen, margin >= 0)
            found_heights = s.model.radars[0].horizon.height(s.aircraft)
            np.testing.assert_allclose(found_heights, heights, atol=1e-6)
            np.testing.assert_allclose(s.aircraft[3, :3], to_ned(rows[3][1:], origin), atol=1e-6)
            for quantity in ("std", "lower", "upper"):
                found, expected = (getattr(one, quantity) for one in (band, bands[0]))
                np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-12)
            np.testing.assert_allclose(s.model.p_d(s.aircraft, s.radar), p_d, rtol=1e-7)
        poses, hidden = poses + margin.size, hidden + np.sum(margin < 0)
    assert 0.1 < hidden / poses < 0.9


@pytest.mark.parametrize("by_row", [False, True])
@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("interpolate", [None, {"step_s": 10, "method": "legs"}])
def test_the_origin_changes_nothing_between_rows(by_row, given, interpolate, tmp_path):
    """An aircraft that turns, and knows level better than north, as an inertial system does."""
    rows, names = [(0, 50, 10, 3000), (100, 50.1, 10, 3000), (200, 50.1, 10.2, 3200)], ""
    if given:
        names += WITH_ATTITUDE
        rows = [(*row, 0, 2, yaw) for row, yaw in zip(rows, (-70, 80, 100), strict=True)]
    uncertainty = {"aircraft": {"position_m": 10, "attitude_deg": [0.1, 0.2, 6]}}
    if by_row:
        names += "".join(f",{name}" for name in STD)
        rows = [(*row, 10, 20, 5, 0.1, 0.2, yaw) for row, yaw in zip(rows, (6, 2, 4), strict=True)]
        uncertainty = {}
    found = []
    for origin in ((50, 10, 0), (57, 4, 0), (45, 20, 900)):
        more = {"stds": names, "interpolate": interpolate, **uncertainty}
        s = written(tmp_path, [(51.4, 12.0, 100)], rows, origin, **more)
        between = s.along(s.geometry.at(np.linspace(2.0, 198.0, 50)))
        found.append([propagate_scenario(x, method="linear").std for x in (s, between)])
    for other in found[1:]:
        for std, expected in zip(other, found[0], strict=True):
            np.testing.assert_allclose(std, expected, rtol=1e-5)
    assert np.ptp(found[0][1]) > 0.2 * np.max(found[0][1])


@pytest.mark.parametrize("correlation", [0.0, 60.0, math.inf])
def test_the_origin_changes_no_mission(correlation, tmp_path, monkeypatch):
    """An error of yaw, known worse than level, stays an error of yaw while the aircraft turns."""
    few_draws(monkeypatch, draws=512, replicates=4)
    rows = [(0, 50, 10, 3000, 0, 0, -70), (100, 50.1, 10, 3000, 0, 0, 80)]
    found = []
    for origin in ((50, 10, 0), (54, 17, 0)):
        more = {"aircraft": level_to(5), "aircraft_correlation_s": correlation}
        s = written(tmp_path, [(51.3, 11.3, 100)], rows, origin, stds=WITH_ATTITUDE, **more)
        s = with_arrays(s, cov_radar=CERTAIN)
        table = rs.analyses.mission(s).table
        between = s.along(s.geometry.at(np.linspace(0.0, 100.0, 11)))
        limit = 1.01 * np.max(s.model.p_d(between.aircraft, s.radar))
        runs = exceedance(between, Requirement(limit).margin, 20_000)
        above = (runs.anywhere if correlation else runs.counts.max()) / runs.runs
        found.append([*(table[f"{end}_3sigma"][-1] for end in ("lower", "upper")), above])
    *bounds, above = np.transpose(found)
    for one, other in bounds:
        assert one == pytest.approx(other, rel=2e-3)
    assert above[0] == pytest.approx(above[1], abs=0.003)
    assert 0.02 < above[0] < 0.9


@pytest.mark.parametrize(("yaw", "is_far"), [(20, {56: True, 50.2: False}), (2, {56: False})])
def test_an_origin_too_far_for_the_attitude_errors_is_warned_of(yaw, is_far, tmp_path):
    """By as much as the bound by draws differs from the one about an origin near by."""
    rows = [(t, 50, 10, 3000, 0, 0, 40 + 100 * t) for t in (0, 1)]
    found = {}
    for latitude in (*is_far, 50):
        more = {"stds": WITH_ATTITUDE, "aircraft": level_to(yaw)}
        s = written(tmp_path, [(50.8, 10.5, 100)], rows, (latitude, 10, 0), **more)
        s = with_arrays(s, cov_radar=CERTAIN)
        told = [text for text in plausibility_warnings(s) if "[origin-far]" in text]
        bounds = rs.monte_carlo(s, runs=20_000, method="linear")
        found[latitude] = bool(told), np.stack([bounds.lower, bounds.upper])
        verdict = rs.analyses.variance(s, threshold=1.0).summary["threshold"]["verdict"]
        assert verdict == ("not known" if told else "holds")
        limit = 0.999 * np.max(s.along(s.geometry.at(np.linspace(0.0, 1.0, 101))).p_d()) + 0.001
        path = path_test(
            s.with_analysis(method="automatic"),
            Requirement(limit, probability=0.001),
            propagate_scenario(s),
        )
        assert not np.any(path.violated & path.far)
        assert np.any(path.decision.violated & path.far) == bool(told)
    near = found.pop(50)
    assert not near[0]
    assert {latitude: told for latitude, (told, _) in found.items()} == is_far
    for latitude, (_, ends) in found.items():
        assert (np.max(abs(ends - near[1])) > 0.005) == is_far[latitude]


def test_monte_carlo_draws_have_the_same_horizon(tmp_path):
    """The horizon lies between the draws: about half of them are hidden, wherever the origin is."""
    radar, place = (10.0, 20.0, 100.0), [10.9, 20.0, 200.0]
    place[0] += sees(radar, place) / 111e3
    rows = [(0.0, *place), (1.0, place[0], place[1] + 1e-3, place[2])]
    for origin in ((10, 20, 0), (1, 20, 0)):
        errors = {"position_m": 200, "attitude_deg": 0}
        s = with_arrays(
            written(tmp_path, [radar], rows, origin, aircraft=errors), cov_radar=CERTAIN
        )
        found = rs.monte_carlo(s, runs=2000, seed=3)
        clear = rs.DetectionModel(rcs=single(s).rcs, p_fa=1e-6).p_d(s.aircraft[0], s.radar)
        assert 0.4 < found.mean[0] / clear < 0.6


def test_a_map_is_the_same_about_another_origin(tmp_path):
    """One cell at a place, about origins as far as 5000 km away."""
    radar, place = (50.0, 10.0, 50.0), (51.0, 11.0, 900.0)
    rows = [(0.0, 50.5, 10.0, 900.0), (60.0, 50.5, 10.1, 900.0)]
    values, bounds = [], []
    for origin in ((50, 10, 0), (42, 16, 700), (10, 20, 0)):
        s = written(tmp_path, [radar], rows, origin, aircraft=AIRCRAFT)
        north, east, _ = to_ned(place, origin)
        pose = pose_in_cells(s, origin[2] - 900.0, 1.0)
        cells = Grid(s, pose, np.array([north, north + 1e3]), np.array([east, east + 1e3]))
        found = p_d_in_cells(cells, method="probit")
        values.append(found[0][0, 0])
        bounds.append(found[1][0, 0])
    assert values[0] > 0.01
    np.testing.assert_allclose(values, values[0], rtol=1e-5)
    np.testing.assert_allclose(bounds, bounds[0], rtol=1e-5)
    far = Grid(s, pose, np.array([6.4e6, 6.5e6]), np.array([0.0, 1e3]))
    with pytest.raises(rs.InputError, match="edge of the earth"):
        p_d_in_cells(far)


def test_an_aspect_is_the_same_at_every_distance(tmp_path):
    """At 65 degrees north, the bearings of two places of each other differ by 11 degrees."""
    rows = [(t, 65, 10.5, 10_000, 0, 0, 20) for t in (0, 1)]
    of_bearings = []
    for origin in ((65, 10, 0), (60, 3, 500)):
        more = {"stds": WITH_ATTITUDE, "aircraft": AIRCRAFT}
        s = written(tmp_path, [(65, 10, 100)], rows, origin, **more)
        aspect = np.deg2rad([0.0, 7.5, 200.0])
        found = rays(s, aspect, by_aspect=True, down=None, course=None)
        states = found.states(np.tile([1e4, 6e5, 1.2e6], (3, 1)))
        x, y, _ = np.moveaxis(body_vector(states, s.radar), -1, 0)
        turned = np.mod(np.arctan2(y, x) - aspect[:, np.newaxis] + 1.0, 2 * np.pi) - 1.0
        np.testing.assert_allclose(turned, 0.0, atol=1e-9)
        heights = [[height_of(p[:3], origin) for p in row] for row in states]
        np.testing.assert_allclose(heights, 10_000, atol=1e-4)
        found = rays(s, aspect, by_aspect=False, down=None, course=0.4)
        of_bearings.append(found.p_d(np.tile([1e4, 1e5, 2e5], (3, 1))))
    np.testing.assert_allclose(*of_bearings, rtol=1e-7)
    assert np.ptp(of_bearings[0], axis=0).max() > 0.05


@pytest.mark.parametrize("method", ["legs", "smooth"])
def test_two_waypoints_fly_over_the_earth(tmp_path, method):
    """Eighteen degrees apart, where the straight line is 79 km below the ground."""
    rng = np.random.default_rng(6)
    for _ in range(10):
        start = (rng.uniform(-60, 60), rng.uniform(-170, 170), rng.uniform(1e3, 12e3))
        end = (start[0] + rng.uniform(-18, 18), start[1] + 18, rng.uniform(1e3, 12e3))
        rows = [(0.0, *start), (8000.0, *end)]
        way = {"step_s": 130.0, "method": method}
        radars = [(*start[:2], 0.0)]
        s = written(tmp_path, radars, rows, start, interpolate=way, aircraft=AIRCRAFT)
        heights = [height_of(p, start) for p in s.aircraft[:, :3]]
        expected = [start[2] + t / 8000 * (end[2] - start[2]) for t in s.time_s]
        np.testing.assert_allclose(heights, expected, atol=1e-5)
        assert s.time_s[-1] == 8000


@pytest.mark.parametrize("origin", [None, (40.0, -105.0, 1600.0)])
def test_a_smooth_altitude_stays_between_its_neighbours(origin, here):
    rng = np.random.default_rng(7)
    for altitudes in (
        [1000, 9000, 9000, 9000, 2000],
        [500, 9000, 9000, 500],
        [1000, 1001, 9000, 9001, 9001],
        # the bends have one sign, but each is five times the one before, and a cubic overshoots
        *np.multiply.outer([1e-4, -1e-4], 5.0 ** np.arange(12)).tolist(),
        *rng.uniform(100, 12e3, (10, 8)),
    ):
        height = np.array(altitudes, dtype=float)
        time = np.cumsum(rng.uniform(50, 900, len(height)))
        place = np.stack([1e-3 * time, 0.2 * np.sin(time / 900), height], axis=1)
        if origin is None:
            route = load(ned(time, place * [111e3, 1e5, -1]))
        else:
            place += [40, -105, 0]
            route = load(
                geodetic(time, place * [DEG, DEG, 1]), origin=(40 * DEG, -105 * DEG, 1600.0)
            )
        found = resample(route, 7.0, "smooth")
        for t, point in zip(found.time_s, found.aircraft[:, :3], strict=True):
            leg = min(int(np.searchsorted(time, t, side="right")) - 1, len(time) - 2)
            low, high = sorted(altitudes[leg : leg + 2])
            assert low - 1e-5 <= (height_of(point, origin) if origin else -point[2]) <= high + 1e-5


def test_a_smooth_altitude_follows_a_wave_that_the_samples_show(here):
    """A phugoid of 100 m and 60 s, every 3 s: its tops are higher than the samples."""

    def wave(time):
        return 5000 + 100 * np.sin(2 * np.pi * time / 60)

    time, origin = np.arange(1.0, 241.0, 3.0), (0.0, 0.0, 0.0)
    place = np.stack([0.002 * DEG * time, 0 * time, wave(time)], axis=1)
    found = resample(load(geodetic(time, place), origin=origin), 0.5, "smooth")
    heights = np.array([height_of(p, origin) for p in found.aircraft[:, :3]])
    inner = slice(60, -60)
    np.testing.assert_allclose(heights[inner], wave(found.time_s)[inner], atol=0.05)
