"""A map as GeoJSON (RFC 7946) or KML 2.2: contours, radars, and the route in colours of P_D.

GeoJSON has heights above the ellipsoid. KML has altitudes above the sea, which are not known here.
All KML features are therefore on the ground. Longitudes are continuous across 180 degrees.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from radar_sense.analyses.coverage.grid import places_at, pose_in_cells
from radar_sense.errors import InputError
from radar_sense.limits import DEG
from radar_sense.model import geodesy
from radar_sense.states import POSITION, RADAR, FloatArray

if TYPE_CHECKING:
    from radar_sense.analyses.contract import Result

#: Most legs of a route in a file. More legs are joined, with the largest P_D of the legs.
_MOST_LEGS = 5_000
_COLOURS = "cividis"
_NAMES = {"p_d": "P_D", "upper_3sigma": "upper 3-sigma bound of P_D"}


@dataclass(frozen=True)
class _Feature:
    """A feature of the map.

    Attributes:
        kind: "contour", "radar" or "route".
        name: Name that a viewer shows.
        lines: Longitude, latitude [deg] and height [m] of the points (n, 3) of each line. A radar
            is one point.
        properties: Further properties by name.
        colour: Colour as #rrggbb.
    """

    kind: str
    name: str
    lines: list[FloatArray]
    properties: dict[str, Any]
    colour: str


def geojson(result: Result) -> bytes:
    """Return a map as GeoJSON.

    Raises:
        InputError: If the scenario has no origin in latitude and longitude.
    """
    features = []
    for feature in _features(result):
        lines = [line.tolist() for line in feature.lines]
        if feature.kind == "contour":
            geometry: dict[str, Any] = {"type": "MultiLineString", "coordinates": lines}
        elif feature.kind == "route":
            geometry = {"type": "LineString", "coordinates": lines[0]}
        else:
            geometry = {"type": "Point", "coordinates": lines[0][0]}
        properties = {
            "kind": feature.kind,
            "name": feature.name,
            **feature.properties,
            "stroke": feature.colour,
        }
        features.append({"type": "Feature", "geometry": geometry, "properties": properties})
    collection = {"type": "FeatureCollection", "features": features}
    return (json.dumps(collection, ensure_ascii=False, allow_nan=False) + "\n").encode()


def kml(result: Result) -> bytes:
    """Return a map as KML.

    Raises:
        InputError: If the scenario has no origin in latitude and longitude.
    """
    root = Element("kml", xmlns="http://www.opengis.net/kml/2.2")
    document = SubElement(root, "Document")
    SubElement(document, "name").text = f"{result.scenario.name}: {_NAMES[result.summary['shown']]}"
    folders: dict[str, Element] = {}
    for feature in _features(result):
        if feature.kind not in folders:
            folders[feature.kind] = SubElement(document, "Folder")
            SubElement(folders[feature.kind], "name").text = feature.kind
        mark = SubElement(folders[feature.kind], "Placemark")
        SubElement(mark, "name").text = feature.name
        style = SubElement(SubElement(mark, "Style"), "LineStyle")
        red, green, blue = (feature.colour[i : i + 2] for i in (1, 3, 5))
        SubElement(style, "color").text = f"ff{blue}{green}{red}"
        SubElement(style, "width").text = "3" if feature.kind == "route" else "2"
        data = SubElement(mark, "ExtendedData")
        for name, value in feature.properties.items():
            SubElement(SubElement(data, "Data", name=name), "value").text = str(value)
        many = SubElement(mark, "MultiGeometry") if len(feature.lines) > 1 else mark
        for line in feature.lines:
            shape = SubElement(many, "Point" if feature.kind == "radar" else "LineString")
            if feature.kind != "radar":
                SubElement(shape, "tessellate").text = "1"
            SubElement(shape, "coordinates").text = " ".join(
                f"{longitude!r},{latitude!r}" for longitude, latitude, _ in line.tolist()
            )
    indent(root)
    text: str = tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


def _features(result: Result) -> Iterator[_Feature]:
    from radar_sense import plotting

    scenario, table, summary = result.scenario, result.table, result.summary
    origin = scenario.origin
    if origin is None:
        raise InputError(
            "geojson and kml need the origin of the north-east-down frame, geometry.origin in a "
            "scenario with a route in latitude and longitude"
        )
    pose = pose_in_cells(scenario, summary["down_km"] * 1e3, None)
    for column in ("p_d", "upper_3sigma"):
        if column not in table:
            continue
        for level in summary["contours"]:
            lines = plotting.contour_lines(table["east_m"], table["north_m"], table[column], level)
            if lines:
                places = [places_at(line[:, 1], line[:, 0], pose, origin) for line in lines]
                yield _Feature(
                    "contour",
                    f"{_NAMES[column]} = {level:g}",
                    [_rounded(place, origin) for place in places],
                    {"quantity": column, "value": level, "level": scenario.level},
                    plotting.hex_colour(level, _COLOURS),
                )
    radars = scenario.radar.reshape(-1, len(RADAR))
    of_radars = _rounded(geodesy.geodetic_from_ned(radars[:, POSITION], origin), origin)
    for name, place in zip(scenario.model.names or ["radar"], of_radars, strict=True):
        yield _Feature("radar", name, [place[np.newaxis]], {}, "#000000")
    yield from _legs(result, origin)


def _legs(result: Result, origin: tuple[float, float, float]) -> Iterator[_Feature]:
    """Yield the legs of the route, each with the largest value of the poses on the leg."""
    from radar_sense import plotting

    position = result.scenario.aircraft[:, POSITION]
    places = _rounded(geodesy.geodetic_from_ned(position, origin), origin)
    values, column = result.arrays["route"], result.summary["shown"]
    last = len(values) - 1
    stride = max(1, -(-last // _MOST_LEGS))
    for start in range(0, last, stride):
        leg = slice(start, min(start + stride, last) + 1)
        value = float(np.max(values[leg]))
        yield _Feature(
            "route",
            f"{_NAMES[column]} {value:.4f}",
            [places[leg]],
            {column: value},
            plotting.hex_colour(value, _COLOURS),
        )


def _rounded(place: FloatArray, origin: tuple[float, float, float]) -> FloatArray:
    """Return longitude, latitude [deg] and height [m] of places (n, 3), rounded to 1 cm."""
    east = (place[:, 1] - origin[1] + np.pi) % (2 * np.pi) - np.pi
    longitude = (origin[1] + east) / DEG
    columns = [np.round(longitude, 7), np.round(place[:, 0] / DEG, 7), np.round(place[:, 2], 2)]
    return np.column_stack(columns)
