"""A map as GeoJSON (RFC 7946): contours, radars, and the route in colours of P_D.

Heights are above the ellipsoid. Longitudes are from -180 to 180 degrees, and lines are cut at the
antimeridian (RFC 7946, section 3.1.9).
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from radar_sense import plotting
from radar_sense.command import Result
from radar_sense.coverage.grid import Grid
from radar_sense.errors import InputError
from radar_sense.limits import DEG
from radar_sense.model import geodesy
from radar_sense.states import POSITION, FloatArray

#: Most legs of a route in a file. More legs are joined.
_MOST_LEGS = 5_000
Position = list[float]
Feature = dict[str, Any]


def geojson(result: Result, cells: Grid, route: FloatArray) -> bytes:
    """Return a map as GeoJSON, with P_D or its bound (n,) at the poses; NaN where there is none.

    Raises:
        InputError: If the scenario has no origin in latitude and longitude.
    """
    origin = result.scenario.origin
    if origin is None:
        raise InputError(
            "geojson needs the origin of the north-east-down frame, geometry.origin in a scenario "
            "with a route in latitude and longitude"
        )
    features = [
        *_contours(result, cells, origin),
        *_radars(result, origin),
        *_legs(result, route, origin),
    ]
    collection = {"type": "FeatureCollection", "features": features}
    return (json.dumps(collection, ensure_ascii=False, allow_nan=False) + "\n").encode()


def _contours(result: Result, cells: Grid, origin: tuple[float, float, float]) -> Iterator[Feature]:
    heading = " over all headings" if result.summary["worst_heading"] else ""
    for column in dict.fromkeys(["p_d", result.summary["shown"]]):
        for level in result.summary["contours"]:
            values = result.table[column]
            lines = plotting.contour_lines(cells.east, cells.north, values, level)
            states = [cells.states_at(north, east) for east, north in (line.T for line in lines)]
            places = [geodesy.geodetic_from_ned(at[:, POSITION], origin) for at in states]
            parts = [part for place in places for part in _cut(place)]
            if parts:
                yield _feature(
                    "contour",
                    f"{_name(result, column)}{heading} = {level:.12g}",
                    ("MultiLineString", parts),
                    plotting.hex_colour(level),
                    {"quantity": column, "value": level, "level": result.scenario.level},
                )


def _name(result: Result, column: str) -> str:
    if column == "p_d":
        return "P_D"
    return f"{result.summary['end']} {result.summary['k']:g}-sigma bound of P_D"


def _radars(result: Result, origin: tuple[float, float, float]) -> Iterator[Feature]:
    scenario = result.scenario
    position = scenario.radar_states[:, POSITION]
    positions = _positions(geodesy.geodetic_from_ned(position, origin))
    for name, place in zip(scenario.model.names or ["radar"], positions, strict=True):
        yield _feature("radar", name, ("Point", place), "#000000", {})


def _legs(
    result: Result, values: FloatArray, origin: tuple[float, float, float]
) -> Iterator[Feature]:
    """Yield the legs of the route with a value, the largest of the poses on the leg.

    Of a lower bound it is the smallest.
    """
    places = geodesy.geodetic_from_ned(result.scenario.aircraft[:, POSITION], origin)
    column, lower = result.summary["shown"], result.summary.get("end") == "lower"
    most = np.fmin if lower else np.fmax
    last = len(values) - 1
    stride = max(1, -(-last // _MOST_LEGS))
    for start in range(0, last, stride):
        leg = slice(start, min(start + stride, last) + 1)
        value = float(most.reduce(values[leg]))
        if np.isnan(value):
            continue
        parts = _cut(places[leg])
        yield _feature(
            "route",
            f"{_name(result, column)} {value:.4f}",
            ("MultiLineString", parts) if len(parts) > 1 else ("LineString", parts[0]),
            plotting.hex_colour(value),
            {column: value},
        )


def _feature(
    kind: str, name: str, geometry: tuple[str, Any], colour: str, properties: Feature
) -> Feature:
    """Return a feature with a type of geometry and its coordinates, and a colour as #rrggbb."""
    shape, coordinates = geometry
    return {
        "type": "Feature",
        "geometry": {"type": shape, "coordinates": coordinates},
        "properties": {"kind": kind, "name": name, **properties, "stroke": colour},
    }


def _cut(line: FloatArray) -> list[list[Position]]:
    """Return a line of places (n, 3), latitude, longitude [rad] and height [m], cut at ±180 deg."""
    ecef = geodesy.ecef_from_geodetic(line)
    parts, rest = [], line
    # From the last crossing on, so that the numbers of the points before stay.
    for i in np.flatnonzero(np.abs(np.diff(line[:, 1])) > np.pi)[::-1]:
        fraction = ecef[i, 1] / (ecef[i, 1] - ecef[i + 1, 1])  # of the chord, up to y = 0
        latitude, _, _ = geodesy.geodetic_from_ecef(ecef[i] + fraction * (ecef[i + 1] - ecef[i]))
        height = line[i, 2] + fraction * (line[i + 1, 2] - line[i, 2])
        before, after = (np.copysign(np.pi, line[k, 1]) for k in (i, i + 1))
        parts.append(np.vstack([(latitude, after, height), rest[i + 1 :]]))
        rest = np.vstack([rest[: i + 1], (latitude, before, height)])
    cut = [_positions(part) for part in [*parts, rest][::-1]]
    # A point on the antimeridian leaves a part of no length.
    return [part for part in cut if part[1:] != part[:-1]] or cut[:1]


def _positions(place: FloatArray) -> list[Position]:
    """Return longitude, latitude [deg] and height [m] of places (n, 3), rounded to 1 cm."""
    latitude, longitude, height = place.T
    columns = [np.round(longitude / DEG, 7), np.round(latitude / DEG, 7), np.round(height, 2)]
    return np.column_stack(columns).tolist()
