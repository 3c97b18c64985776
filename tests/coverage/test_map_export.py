"""Maps as GeoJSON: valid by RFC 7946, by a validator that shares no code with the package."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from earth import flight
from helpers import CONFIGS

import radar_sense as rs
from radar_sense.analyses.map import coverage_map
from radar_sense.errors import InputError
from radar_sense.model import geodesy
from radar_sense.propagation import propagate_scenario

pytestmark = pytest.mark.usefixtures("quick")

#: Across the meridian of 180 degrees.
PLACES = [(47.0, 179.9, 9000.0), (48.0, -179.0, 9000.0), (48.2, -178.0, 9500.0)]
AREA = {"north_km": (-150, 160), "east_km": (-150, 160), "step_km": 5}


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    folder = tmp_path_factory.mktemp("map")
    scenario = flight(folder, PLACES, (47, 179.5, 400), radar__constant=0.02)
    result = coverage_map(scenario, upper=True, p_d=[0.2, 0.6], **AREA)
    paths = result.save(folder / "out", ("geojson",))
    assert [path.suffix for path in paths] == [".npz", ".geojson", ".json"]
    return result, paths


def states(result, longitude, latitude, height):
    """Poses of the cells: at a place, with the attitude of the first pose in the local level."""
    place = np.column_stack([np.deg2rad(latitude), np.deg2rad(longitude), height])
    origin = result.scenario.origin
    attitude = np.broadcast_to(np.deg2rad(result.summary["attitude_deg"]), place.shape)
    turned = geodesy.turned_attitude(attitude, geodesy.turn_to_origin(place, origin))
    return np.hstack([geodesy.ned_from_geodetic(place, origin), turned])


def test_cells_have_their_place(saved):
    result, paths = saved
    scenario = result.scenario
    with np.load(paths[0]) as data:
        assert data["latitude_deg"].shape == data["longitude_deg"].shape == data["p_d"].shape
        height = np.full(data["p_d"].size, 400 - 1e3 * result.summary["down_km"])
        poses = states(result, data["longitude_deg"].ravel(), data["latitude_deg"].ravel(), height)
        north, east = np.meshgrid(data["north_m"], data["east_m"], indexing="ij")
        np.testing.assert_allclose(poses[:, 0], north.ravel(), atol=0.02)
        np.testing.assert_allclose(poses[:, 1], east.ravel(), atol=0.02)
        p_d = scenario.model.p_d(poses, scenario.radar)
        np.testing.assert_allclose(data["p_d"].ravel(), p_d, atol=1e-5)


def test_a_lower_bound_is_named_and_a_leg_has_the_least_of_its_poses(saved):
    result = coverage_map(saved[0].scenario, lower=True, p_d=[0.2], **AREA)
    features = json.loads(result.exports["geojson"](result))["features"]
    names = [f["properties"]["name"] for f in features if f["properties"]["kind"] == "contour"]
    assert names == ["P_D = 0.2", "lower 3-sigma bound of P_D = 0.2"]
    lower = propagate_scenario(result.scenario, method="automatic").lower
    legs = [f["properties"]["lower_3sigma"] for f in features if f["properties"]["kind"] == "route"]
    np.testing.assert_array_equal(legs, np.minimum(lower[1:], lower[:-1]))


def test_geojson_has_contours_radars_and_route(saved):
    result, paths = saved
    scenario = result.scenario
    features = json.loads(paths[1].read_text(encoding="utf-8"))["features"]
    by_kind = {kind: [f for f in features if f["properties"]["kind"] == kind]
               for kind in ("contour", "radar", "route")}  # fmt: skip
    shown = {(f["properties"]["quantity"], f["properties"]["value"]) for f in by_kind["contour"]}
    assert shown == {(q, v) for q in ("p_d", "upper_3sigma") for v in (0.2, 0.6)}
    for feature in by_kind["contour"]:
        assert feature["geometry"]["type"] == "MultiLineString"
        points = np.vstack(feature["geometry"]["coordinates"])
        assert len(points) > 20
        assert np.ptp(points[:, 0] % 360) < 10  # degrees
        poses = states(result, *points.T)
        of_points = scenario.model.p_d(poses, scenario.radar)
        if feature["properties"]["quantity"] == "upper_3sigma":
            cov = scenario.cov_aircraft[0], scenario.cov_radar  # of the first pose
            method = {"method": scenario.method}
            of_points = rs.propagate(scenario.model, poses, scenario.radar, *cov, **method).upper
        off = np.abs(of_points - feature["properties"]["value"])
        assert np.median(off) < 0.01  # linear interpolation over cells of 5 km
        assert np.max(off) < 0.02
    (radar,) = by_kind["radar"]
    longitude, latitude, height = radar["geometry"]["coordinates"]
    back = geodesy.ned_from_geodetic(
        [np.deg2rad(latitude), np.deg2rad(longitude), height], scenario.origin
    )
    np.testing.assert_allclose(back, scenario.radar[:3], atol=0.02)
    places = np.array(PLACES)[:, [1, 0, 2]]
    over, after = by_kind["route"]
    assert over["geometry"]["type"] == "MultiLineString"  # the first leg goes across 180 degrees
    (start, west), (east, end) = over["geometry"]["coordinates"]
    assert (west[0], east[0]) == (180, -180)
    assert west[1:] == east[1:]
    a, b = unit(start), unit(end)
    crossing = b[1] * a - a[1] * b  # on the great circle, at y = 0
    latitude = np.rad2deg(np.arctan(abs(crossing[2] / crossing[0])))
    np.testing.assert_allclose(west[1], latitude, rtol=0, atol=1e-4)
    assert after["geometry"]["type"] == "LineString"
    found = [start, end, *after["geometry"]["coordinates"]]
    np.testing.assert_allclose(found, places[[0, 1, 1, 2]], rtol=0, atol=0.0051)
    for i, feature in enumerate(by_kind["route"]):
        value = feature["properties"]["upper_3sigma"]
        assert value == max(result.draw.keywords["route"][i : i + 2])


def test_contours_over_all_headings_say_so(tmp_path):
    s = flight(tmp_path, PLACES, (47, 179.5, 400), radar__constant=0.02)
    result = coverage_map(s, worst_heading=True, p_d=[0.2], **{**AREA, "step_km": 20})
    (path,) = (p for p in result.save(tmp_path / "out", "geojson") if p.suffix == ".geojson")
    features = json.loads(path.read_text(encoding="utf-8"))["features"]
    names = [f["properties"]["name"] for f in features]
    assert "P_D over all headings = 0.2" in names
    assert sum("over all headings" in name for name in names) == 1  # the legs have their own


def unit(position):
    """Unit vector to a position of GeoJSON."""
    longitude, latitude = np.deg2rad(position[:2])
    level = np.cos(latitude)
    return np.array([level * np.cos(longitude), level * np.sin(longitude), np.sin(latitude)])


def lines_of(geometry):
    """Check a geometry by RFC 7946, and return its lines."""
    assert set(geometry) == {"type", "coordinates"}
    coordinates = geometry["coordinates"]
    lines = {
        "Point": lambda: [[coordinates]],
        "LineString": lambda: [coordinates],
        "MultiLineString": lambda: coordinates,
    }[geometry["type"]]()
    assert lines
    for line in lines:
        assert len(line) >= (1 if geometry["type"] == "Point" else 2)
        for longitude, latitude, height in line:
            assert -180 <= longitude <= 180
            assert -90 <= latitude <= 90
            assert -1e4 < height < 1e6
    return lines


def check_geojson(text):
    """Check a text by RFC 7946, and return its features and the number of cuts at 180 degrees."""
    collection = json.loads(text)
    assert set(collection) == {"type", "features"}
    assert collection["type"] == "FeatureCollection"
    cuts = 0
    for feature in collection["features"]:
        assert set(feature) == {"type", "geometry", "properties"}
        assert feature["type"] == "Feature"
        lines = lines_of(feature["geometry"])
        ends = []
        for line in lines:
            for a, b in pairwise(line):
                span = abs(b[0] - a[0])
                assert span <= 180
                # Only near a pole does a short line span many degrees.
                from_axis = min(np.hypot(*unit(end)[:2]) for end in (a, b))
                assert span < 45 or from_axis < 2 * np.linalg.norm(unit(b) - unit(a))
            ends += [end for end in (line[0], line[-1]) if abs(end[0]) == 180]
        # At each cut one part ends and another begins, at the same place.
        assert sorted(e[1:] for e in ends if e[0] > 0) == sorted(e[1:] for e in ends if e[0] < 0)
        cuts += len(ends) // 2
    return collection["features"], cuts


def test_random_maps_are_valid(tmp_path):
    rng = np.random.default_rng(0)
    cut = polar = 0
    for _ in range(12):
        near_pole = 90 - rng.exponential(2)
        latitude = rng.choice([rng.uniform(-80, 80), near_pole, -near_pole])
        longitude = rng.choice([rng.uniform(-180, 360), 180 + rng.normal(), rng.normal() - 180])
        longitude = float(np.clip(longitude, -180, 360))
        steps = np.cumsum(rng.normal(0, [0.3, 1.0], (6, 2)), axis=0)
        lat, lon = (np.array([latitude, longitude]) + steps).T
        lon = np.where(abs(lat) > 90, lon + 180, lon) % 360  # over the pole, on the other side
        lat = np.where(abs(lat) > 90, np.copysign(180, lat) - lat, lat)
        places = [(a, b, 9000) for a, b in zip(lat, lon, strict=True)]
        radar = {
            "radar__constant": float(rng.uniform(0.005, 0.05)),
            "radar__position_m": [*rng.uniform(-1e5, 1e5, 2).tolist(), 0],
        }
        scenario = flight(tmp_path, places, (float(latitude), longitude, 0), **radar)
        result = coverage_map(scenario, step_km=20)
        features, cuts = check_geojson(result.exports["geojson"](result))
        assert {feature["properties"]["kind"] for feature in features} >= {"radar", "route"}
        cut += cuts > 0
        polar += abs(latitude) > 85
    assert cut > 7
    assert polar > 7


def test_a_route_from_the_antimeridian_has_no_part_without_length(tmp_path):
    scenario = flight(tmp_path, [(10, 180, 9000), (10.1, -179, 9000)], (10, 180, 0))
    result = coverage_map(scenario, step_km=20)
    features = json.loads(result.exports["geojson"](result))["features"]
    (leg,) = (f["geometry"] for f in features if f["properties"]["kind"] == "route")
    assert leg["type"] == "LineString"
    assert [place[0] for place in leg["coordinates"]] == [-180, -179]


def test_a_map_without_an_origin_has_no_place_on_the_earth(tmp_path, tool):
    result = coverage_map(rs.load_scenario(), step_km=200)
    assert "latitude_deg" not in result.table
    with pytest.raises(InputError, match="geojson needs the origin"):
        result.save(tmp_path / "out", ("geojson",))
    assert not (tmp_path / "out").exists()
    code, _, err = tool("map", "--format", "geojson")
    assert (code, err.splitlines()) == (2, [
        "Error: --format geojson: needs geometry.origin, which scenarios with a route in latitude "
        "and longitude have"])  # fmt: skip
    assert not Path("figures").exists()
    code, _, err = tool("rcs", "--format", "geojson")
    assert code == 2
    with pytest.raises(ValueError, match="format must be one of png, pdf, svg, got 'geojson'"):
        rs.analyses.variance(rs.load_scenario()).save(tmp_path, ("geojson",))


@pytest.mark.parametrize("longitudes", [(-0.5, 0, 0.5), (-0.5, 0, 0, 0.5), (0,)])
def test_the_bound_along_the_route_is_known_straight_above_the_radar(tmp_path, longitudes):
    """The aspect has no gradient there, and no method but draws has a bound."""
    over = [(0, longitude, 9000) for longitude in longitudes]
    scenario = flight(tmp_path, over, (0, 0, 0), (0, 0, 90), radar__position_m=[0, 0, 0])
    result = coverage_map(scenario, upper=True, method="linear", **AREA)
    low, high = result.summary["route"]
    assert f"{low:.4f} to {high:.4f}, by automatic" in result.report[-1]
    _, path, _ = result.save(tmp_path / "out", ("geojson",))
    features, _ = check_geojson(path.read_text(encoding="utf-8"))
    values = [f["properties"] for f in features if f["properties"]["kind"] == "route"]
    assert len(values) == len(longitudes) - 1
    assert all(low <= value["upper_3sigma"] <= high for value in values)


def test_a_map_without_contours_is_refused():
    with pytest.raises(InputError, match="'p_d' must have the P_D of one contour line or more"):
        coverage_map(rs.load_scenario(), p_d=[], **AREA)


def test_no_plot_leaves_out_the_figure_alone(tool, tmp_path):
    area = "--north-km", "-50", "50", "--east-km", "0", "90", "--step-km", "20"
    formats = "--format", "geojson", "--format", "png", "--no-plot", "--out", str(tmp_path)
    code, out, _ = tool("map", str(CONFIGS / "corridor.yaml"), *area, *formats)
    assert code == 0
    assert {path.suffix for path in tmp_path.iterdir()} == {".npz", ".json", ".geojson"}
    assert "corridor_map.geojson" in out
