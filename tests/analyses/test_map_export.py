"""Maps as GeoJSON and KML: at each point of a contour P_D has the value of the contour."""

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from helpers import document

import radar_sense as rs
from radar_sense.analyses.coverage_map import coverage_map
from radar_sense.errors import InputError
from radar_sense.model import geodesy

KML = "{http://www.opengis.net/kml/2.2}"
#: Beside the meridian of 180 degrees: longitudes must not jump.
PLACES = [(47.0, 179.9, 9000.0), (48.0, -179.0, 9000.0), (48.2, -178.0, 9500.0)]
AREA = {"north_km": (-150, 160), "east_km": (-150, 160), "step_km": 5}


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    folder = tmp_path_factory.mktemp("map")
    rows = [f"{600 * i},{lat},{lon},{alt}\n" for i, (lat, lon, alt) in enumerate(PLACES)]
    text = "time_s,latitude_deg,longitude_deg,altitude_m\n" + "".join(rows)
    (folder / "route.csv").write_text(text)
    origin = {"latitude_deg": 47, "longitude_deg": 179.5, "altitude_m": 400}
    content = document(
        radar__constant=0.02, geometry={"type": "path", "file": "route.csv", "origin": origin}
    )
    del content["aircraft"]["attitude_deg"]
    (folder / "my.yaml").write_text(yaml.safe_dump(content))
    return folder / "my.yaml"


@pytest.fixture(scope="module")
def saved(config):
    scenario = rs.load_scenario(config)
    result = coverage_map(scenario, upper=True, p_d=[0.2, 0.6], **AREA)
    paths = result.save(config.parent / "out", ("geojson", "kml"))
    assert [path.suffix for path in paths] == [".npz", ".geojson", ".kml", ".json"]
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
        assert np.ptp(points[:, 0]) < 10  # degrees: no jump by 360
        poses = states(result, *points.T)
        of_points = (
            scenario.model.p_d(poses, scenario.radar)
            if feature["properties"]["quantity"] == "p_d"
            else rs.propagate(
                scenario.model,
                poses,
                scenario.radar,
                scenario.cov_aircraft[0] if scenario.cov_aircraft.ndim == 3
                else scenario.cov_aircraft,
                scenario.cov_radar[scenario.level],
            ).upper
        )  # fmt: skip
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
    places[:, 0] %= 360
    for i, feature in enumerate(by_kind["route"]):
        np.testing.assert_allclose(
            feature["geometry"]["coordinates"], places[i : i + 2], rtol=0, atol=0.0051
        )
        value = feature["properties"]["upper_3sigma"]
        assert value == max(result.arrays["route"][i : i + 2])
    assert len(by_kind["route"]) == 2


def test_kml_is_the_same_map_on_the_ground(saved):
    _, paths = saved
    features = json.loads(paths[1].read_text(encoding="utf-8"))["features"]
    root = ElementTree.parse(paths[2]).getroot()
    assert root.find(f".//{KML}altitudeMode") is None
    marks = root.findall(f".//{KML}Placemark")
    assert len(marks) == len(features)
    for mark, feature in zip(marks, features, strict=True):
        properties, coordinates = feature["properties"], feature["geometry"]["coordinates"]
        depth = {"contour": coordinates, "route": [coordinates], "radar": [[coordinates]]}
        assert mark.findtext(f"{KML}name") == properties["name"]
        colour = mark.findtext(f"{KML}Style/{KML}LineStyle/{KML}color")
        assert properties["stroke"] == f"#{colour[6:]}{colour[4:6]}{colour[2:4]}"
        found = [
            [[float(x) for x in word.split(",")] for word in element.text.split()]
            for element in mark.iter(f"{KML}coordinates")
        ]
        assert found == [[p[:2] for p in line] for line in depth[properties["kind"]]]


def test_a_map_without_an_origin_has_no_place_on_the_earth(tmp_path, tool):
    result = coverage_map(rs.load_scenario(), step_km=200)
    assert "latitude_deg" not in result.table
    with pytest.raises(InputError, match="geojson and kml need the origin"):
        result.save(tmp_path / "out", ("geojson",))
    assert not (tmp_path / "out").exists()
    code, _, err = tool("map", "--format", "kml")
    assert (code, err.splitlines()) == (2, [
        "Error: --format kml: needs geometry.origin, which scenarios with a route in latitude and "
        "longitude have"])  # fmt: skip
    assert not Path("figures").exists()
    code, _, err = tool("rcs", "--format", "kml")
    assert code == 2
    with pytest.raises(ValueError, match="format must be one of png, pdf, svg, got 'kml'"):
        rs.variance(rs.load_scenario()).save(tmp_path, ("kml",))
