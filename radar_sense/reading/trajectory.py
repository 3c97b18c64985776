"""The path of a scenario file: a route file, its frame and its interpolation.

    geometry:
      type: path
      file: route.csv                   looked for from the folder of the scenario file
      axis: time                        or distance: the axis of tables and figures
      origin: {latitude_deg: 47.3, longitude_deg: 8.5, altitude_m: 430}
                                        of the north-east-down frame, for a route in latitude and
                                        longitude, and only for one
      interpolate: {step_s: 10, method: legs}
                                        or smooth; without it every row of the file is a pose
      max_gap_s: 60                     refuse a file with a longer step between two rows
      altitude_above: sea               or ellipsoid, or pressure
      geoid_height_m: 47.5              height of the sea level above the ellipsoid
      speed_m_s: 200                    between waypoints without times
      icao24: 4b1812                    which aircraft of a file of ADS-B state vectors

With an origin, a radar may have its place in latitude and longitude too:

    radar:
      position_geodetic: {latitude_deg: 47.1, longitude_deg: 9.2, altitude_m: 1500}

The covariance of its position is then relative to north, east and down at the radar. The covariance
of the aircraft, in the route file or in the scenario, is relative to north, east and down at the
aircraft.

The columns of the file are described at the top of `route_file`. Attitude comes from the file, or
from the track if the file has no attitude.
"""

from __future__ import annotations

from pathlib import Path

from radar_sense import axis, keys, provenance
from radar_sense.errors import InputError
from radar_sense.model.trajectory import Route, resample
from radar_sense.reading.yaml_reader import Entry, file_errors
from radar_sense.scenario_file.route_file import read_route
from radar_sense.scenario_file.text_file import recorded


def read_path(entry: Entry) -> tuple[axis.Axis, Route, provenance.Path]:
    """Read the path that a geometry names.

    Returns:
        The axis of the poses, the route, and the path for the record. The record has the SHA-256 of
        the file. Another file is then refused when the record is read back.

    Raises:
        InputError: If anything in the entry or the file is not allowed.
    """
    section = entry.section(keys.PATH)
    path = Path(entry.source).parent / section.value(keys.FILE)
    along = section.value(keys.AXIS)
    origin = read_place(section["origin"]) if "origin" in section else None
    step, method = None, keys.METHOD.default
    if "interpolate" in section:
        interpolate = section["interpolate"].section(keys.INTERPOLATE)
        step, method = interpolate.value(keys.STEP), interpolate.value(keys.METHOD)
    max_gap_s = section.value(keys.MAX_GAP)
    conventions = provenance.Conventions(*(section.value(key) for key in keys.CONVENTIONS))
    expected = section.value(keys.SHA256)
    with file_errors(section):
        route, sha256 = read_route(
            path, origin=origin, max_gap_s=max_gap_s, sha256=expected, **vars(conventions)
        )
    if step is not None:
        try:
            route = resample(route, step, method)
        except InputError as error:
            raise section["interpolate"].error(str(error)) from error
    source = provenance.Path(recorded(path), sha256, origin, step, method, max_gap_s, conventions)
    if along == "time":
        return axis.time(route.time_s), route, source
    return axis.distance(route.distance_m), route, source


def read_place(entry: Entry) -> tuple[float, float, float]:
    """Read latitude, longitude [rad] and height [m]."""
    section = entry.section(keys.PLACE)
    latitude, longitude, altitude = (float(section.si(key)) for key in keys.PLACE)
    return latitude, longitude, altitude
