"""Recorded flights and planned waypoints: GPX 1.1, KML, and ADS-B state vectors of OpenSky.

GPX: one track, or one route of waypoints. Elevations are above the sea.
KML: one gx:Track (or gx:MultiTrack) with times, or one LineString of waypoints. The altitudeMode
must be absolute. Altitudes are above the sea.
OpenSky: CSV with the columns time, icao24, lat, lon, and geoaltitude (above the ellipsoid) or
baroaltitude (pressure altitude). Rows without a position or an altitude are skipped. Where the
file has lastposupdate, this is the time of a position, and repeated positions are skipped.

Time 0 is the first point of the file. All other contents of the files are ignored.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, NoReturn
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from radar_sense.errors import InputError, shorten
from radar_sense.limits import DEG, Limit
from radar_sense.reading.csv_reader import Header, read_rows
from radar_sense.reading.text_file import NUMBER, FileError, open_text
from radar_sense.states import FloatArray

#: A point of an XML file takes some 1 KB of memory.
_XML_BYTES = 2**26
_CSV_BYTES = 2**30
_GPX = "{http://www.topografix.com/GPX/1/1}"
_KML = "{http://www.opengis.net/kml/2.2}"
_GX = "{http://www.google.com/kml/ext/2.2}"
#: Attribute of an element for its line.
_LINE = "{radar-sense}line"
_TIME = re.compile(r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d)(\.\d+)?(Z|[+-]\d\d:\d\d)", re.ASCII)
_LIMITS = (
    Limit(at_least=-90, at_most=90),
    Limit(at_least=-180, at_most=360),
    Limit(at_least=-10e3, at_most=1e8),
)
_UNITS = np.array([DEG, DEG, 1.0])
_MISSING = {"", "nan", "null", "none"}
#: Formats by the ending of the name.
_ENDINGS = (".gpx", ".kml")


@dataclass(frozen=True, eq=False)
class Samples:
    """Places along a flight.

    Attributes:
        source: Name of the file.
        lines: Line of each place (n,).
        time: Time of each place (n,) [s]; None for waypoints.
        place: Latitude, longitude [rad] and altitude [m] (n, 3).
        altitudes: What the altitudes may be above, with the convention of the format first.
        sha256: Digest of the bytes of the file.
    """

    source: str
    lines: NDArray[np.intp]
    time: FloatArray | None
    place: FloatArray
    altitudes: tuple[str, ...]
    sha256: str

    def error(self, row: int, message: str) -> InputError:
        """Return the error to raise about a place."""
        return InputError(f"{self.source}:{self.lines[row]}: {message}")


def is_track(path: str | Path) -> bool:
    """Return whether a file is GPX, KML or a table of state vectors."""
    if Path(path).suffix.lower() in _ENDINGS:
        return True
    with open_text(path, "a route file", _CSV_BYTES) as file:
        start = file.read(2**12)
    lines = (line.partition(b"#")[0].strip() for line in start.splitlines())
    header = next((line for line in lines if line), b"")
    return b"icao24" in re.split(rb"[,;\s\"]+", header)


def read_track(
    path: str | Path, *, pressure: bool, icao24: str | None, sha256: str | None
) -> Samples:
    """Read a file that `is_track`.

    Args:
        path: The file.
        pressure: Whether the altitude is the pressure altitude, of state vectors only.
        icao24: Address of the aircraft, of state vectors only; None if the file has one aircraft.
        sha256: Digest that the file must have; None allows any.

    Raises:
        InputError: If the file cannot be read or anything in the file is not allowed.
    """
    ending = Path(path).suffix.lower()
    if ending not in _ENDINGS:
        return _state_vectors(path, pressure, icao24, sha256)
    if icao24 is not None:
        raise InputError(f"{path}: icao24 is for files of ADS-B state vectors only")
    with open_text(path, f"a {ending[1:].upper()} file", _XML_BYTES) as file:
        pieces = []
        while data := file.read(2**22):
            pieces.append(data)
        digest = file.sha256(sha256)
        root = _parsed(b"".join(pieces), str(path))
        points = (_gpx_points if ending == ".gpx" else _kml_points)(_Document(str(path), root))
    with_times = [point for point in points if point.time is not None]
    if len(with_times) not in (0, len(points)):
        missing = next(point for point in points if point.time is None)
        raise InputError(f"{path}:{missing.line}: has no time, but other points have one")
    if not points:
        raise InputError(f"{path}: has no points")
    time = [_seconds(point.time, f"{path}:{point.line}") for point in with_times]
    return Samples(
        source=str(path),
        lines=np.array([point.line for point in points], dtype=np.intp),
        time=np.array(time) if time else None,
        place=np.array([_place(point, str(path)) for point in points]) * _UNITS,
        altitudes=("sea", "ellipsoid"),
        sha256=digest,
    )


@dataclass(frozen=True)
class _Point:
    """The text of a point: line, latitude, longitude, altitude, time."""

    line: int
    place: Sequence[str | None]
    names: tuple[str, ...]
    time: str | None = None


@dataclass(frozen=True)
class _Document:
    """An XML document."""

    source: str
    root: Element

    def error(self, element: Element, message: str) -> InputError:
        """Return the error to raise about an element."""
        return InputError(f"{self.source}:{element.get(_LINE)}: {message}")


def _parsed(data: bytes, source: str) -> Element:
    """Return the root of an XML document whose elements have their lines.

    A document type is refused, because its entities can expand without end or name other files.
    """
    parser = expat.ParserCreate(namespace_separator="}")
    builder = TreeBuilder()

    def name(text: str) -> str:
        return "{" + text if "}" in text else text

    def start(tag: str, attributes: dict[str, str]) -> None:
        line = str(parser.CurrentLineNumber)
        builder.start(name(tag), {**{name(k): v for k, v in attributes.items()}, _LINE: line})

    def doctype(*_: Any) -> NoReturn:
        raise InputError(
            f"{source}:{parser.CurrentLineNumber}: has a DOCTYPE, which is not allowed; remove it"
        )

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda tag: builder.end(name(tag))
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = doctype
    parser.buffer_text = True
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise InputError(f"{source}:{error.lineno}: is not valid XML: {reason}") from error
    except InputError:
        raise
    except (ValueError, LookupError) as error:  # an unknown encoding
        raise InputError(f"{source}: is not valid XML: {error}") from error
    return builder.close()


def _gpx_points(document: _Document) -> list[_Point]:
    root = document.root
    if root.tag != f"{_GPX}gpx":
        raise document.error(root, "must be GPX 1.1, with the root gpx of its namespace")
    tracks, routes = (root.findall(f"{_GPX}{name}") for name in ("trk", "rte"))
    if len(tracks) == 1:
        elements = list(tracks[0].iter(f"{_GPX}trkpt"))
    elif not tracks and len(routes) == 1:
        elements = routes[0].findall(f"{_GPX}rtept")
    else:
        raise document.error(
            root, f"must have one track or one route, got {len(tracks)} and {len(routes)}"
        )
    return [
        _Point(
            int(element.get(_LINE, 0)),
            (element.get("lat"), element.get("lon"), element.findtext(f"{_GPX}ele")),
            ("lat", "lon", "ele"),
            element.findtext(f"{_GPX}time"),
        )
        for element in elements
    ]


def _kml_points(document: _Document) -> list[_Point]:
    root = document.root
    if root.tag != f"{_KML}kml":
        raise document.error(root, "must be KML 2.2 or later, with the root kml of its namespace")
    tracks = list(root.iter(f"{_GX}Track"))
    groups = list(root.iter(f"{_GX}MultiTrack"))
    lines = list(root.iter(f"{_KML}LineString"))
    if groups:
        inside = len(groups) == 1 and len(list(groups[0].iter(f"{_GX}Track"))) == len(tracks)
    else:
        inside = len(tracks) == 1
    if tracks and inside:
        of_group = groups[0] if groups else tracks[0]
        return [p for track in tracks for p in _track_points(document, track, of_group)]
    if not tracks and len(lines) == 1:
        return _waypoints(document, lines[0])
    raise document.error(
        root, f"must have one gx:Track or one LineString, got {len(tracks)} and {len(lines)}"
    )


def _track_points(document: _Document, track: Element, group: Element) -> list[_Point]:
    _require_absolute(document, track, group)
    times, places = track.findall(f"{_KML}when"), track.findall(f"{_GX}coord")
    if len(times) != len(places):
        raise document.error(
            track, f"must have a time for each place, got {len(times)} times, {len(places)} places"
        )
    points = []
    for when, coord in zip(times, places, strict=True):
        numbers = (coord.text or "").split()
        if len(numbers) != 3:
            raise document.error(
                coord, f"gx:coord: must be longitude, latitude, altitude, got {len(numbers)} words"
            )
        longitude, latitude, altitude = numbers
        place = (latitude, longitude, altitude)
        points.append(_Point(int(coord.get(_LINE, 0)), place, _OF_KML, when.text or ""))
    return points


def _waypoints(document: _Document, line_string: Element) -> list[_Point]:
    _require_absolute(document, line_string)
    element = line_string.find(f"{_KML}coordinates")
    if element is None:
        raise document.error(line_string, "LineString: has no coordinates")
    points = []
    first = int(element.get(_LINE, 0))
    for line, text in enumerate((element.text or "").split("\n"), start=first):
        for word in text.split():
            numbers = word.split(",")
            if len(numbers) != 3:
                raise InputError(
                    f"{document.source}:{line}: coordinates: must be longitude,latitude,altitude, "
                    f"got {shorten(word)}"
                )
            longitude, latitude, altitude = numbers
            points.append(_Point(line, (latitude, longitude, altitude), _OF_KML))
    return points


_OF_KML = ("latitude", "longitude", "altitude")


def _require_absolute(document: _Document, *elements: Element) -> None:
    """Require the altitude mode absolute, of the first element that has a mode."""
    modes = (
        element.findtext(f"{space}altitudeMode") for element in elements for space in (_KML, _GX)
    )
    mode = next((mode.strip() for mode in modes if mode), "clampToGround")
    if mode != "absolute":
        raise document.error(
            elements[0], f"altitudeMode: must be absolute, got {shorten(mode)}, without a height"
            " above the sea"
        )  # fmt: skip


def _place(point: _Point, source: str) -> list[float]:
    """Return latitude, longitude [deg] and altitude [m]."""
    numbers = []
    for name, text, limit in zip(point.names, point.place, _LIMITS, strict=True):
        numbers.append(_number(f"{source}:{point.line}: {name}", (text or "").strip(), limit))
    return numbers


def _number(place: str, text: str, limit: Limit) -> float:
    if not NUMBER.fullmatch(text) or not limit.allows(float(text)):
        raise InputError(f"{place}: must be {limit}, got {shorten(text) if text else 'nothing'}")
    return float(text)


def _seconds(text: str | None, place: str) -> float:
    """Return a time in seconds since 1970, to the microsecond."""
    words = _TIME.fullmatch((text or "").strip())
    try:
        if words is None:
            raise ValueError
        zone = words[3].replace("Z", "+00:00")
        return datetime.fromisoformat(words[1] + zone).timestamp() + float(words[2] or 0)
    except ValueError as error:
        raise InputError(
            f"{place}: time: must be a date and time with its zone, as 2026-11-22T07:08:00Z, "
            f"got {shorten((text or '').strip())}"
        ) from error


def _state_vectors(
    path: str | Path, pressure: bool, icao24: str | None, sha256: str | None
) -> Samples:
    """Read the positions of one aircraft from state vectors."""
    altitude = "baroaltitude" if pressure else "geoaltitude"
    lines: list[int] = []
    rows: list[list[float]] = []
    addresses: set[str] = set()

    def check_header(header: Header) -> None:
        for name in ("time", "icao24", "lat", "lon", altitude):
            if name in header.names:
                continue
            instead = (
                "; baroaltitude is the pressure altitude, which differs from a height by up to "
                "some hundred metres; geometry.altitude_above: pressure takes it as the height "
                "above the sea"
                if name == "geoaltitude" and "baroaltitude" in header.names
                else ""
            )
            raise header.error(f"missing column '{name}' of ADS-B state vectors{instead}")

    def take(header: Header, line: int, cells: list[str]) -> None:
        cell = dict(zip(header.names, cells, strict=True))
        address = cell["icao24"].lower()
        if icao24 is not None and address != icao24.lower():
            return
        addresses.add(address)
        if len(addresses) > 1:
            raise InputError(
                f"{header.source}:{line}: icao24: must be one aircraft, got {shorten(address)} "
                "too; geometry.icao24 chooses one"
            )
        moment = "lastposupdate" if "lastposupdate" in cell else "time"
        names = (moment, "lat", "lon", altitude)
        if any(cell[name].lower() in _MISSING for name in names):
            return
        limits = (Limit(at_least=-1e12, at_most=1e12), *_LIMITS)
        row = [
            _number(f"{header.source}:{line}: {name}", cell[name], limit)
            for name, limit in zip(names, limits, strict=True)
        ]
        if moment == "lastposupdate" and rows and rows[-1][0] == row[0]:
            return  # the position before, repeated
        lines.append(line)
        rows.append(row)

    digest = read_rows(
        path,
        "a table of ADS-B state vectors",
        _CSV_BYTES,
        check_header=check_header,
        take=take,
        sha256=sha256,
    )
    if not rows:
        who = f"the aircraft {icao24}" if icao24 is not None and not addresses else "any row"
        raise FileError(f"{path}: has no position of {who}, with an altitude in {altitude}")
    numbers = np.array(rows)
    return Samples(
        source=str(path),
        lines=np.array(lines, dtype=np.intp),
        time=numbers[:, 0].copy(),
        place=numbers[:, 1:] * _UNITS,
        altitudes=("pressure",) if pressure else ("ellipsoid",),
        sha256=digest,
    )
