"""Recorded flights and planned waypoints: GPX 1.1, and ADS-B state vectors of OpenSky.

GPX: one track, or one route of waypoints. Elevations are above the sea.
OpenSky: CSV with the columns time, icao24, lat, lon, and geoaltitude (above the ellipsoid) or
baroaltitude (pressure altitude). Rows without a position or an altitude are skipped. Where the
file has lastposupdate, this is the time of a position, and repeated positions are skipped.

Time 0 is the first point of the file. All other contents of the files are ignored.
"""

from __future__ import annotations

import re
from array import array
from dataclasses import dataclass
from datetime import datetime
from typing import Any, NoReturn
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from radar_sense.errors import InputError, counted, describe
from radar_sense.limits import DEG, Limit
from radar_sense.scenario_file.table_file import MAX_ROWS, TableFile
from radar_sense.scenario_file.text_file import MAX_LETTERS, FileError, TextFile, number
from radar_sense.states import FloatArray

#: A million points of 250 bytes.
_GPX_BYTES = 2**28
#: Bytes of GPX parsed at a time. An element, an attribute or a comment may be four times as long.
_PIECE, _LONGEST = 2**16, 2**18
#: Most elements inside each other.
_DEPTH = 100
_GPX = "http://www.topografix.com/GPX/1/1"
_ENCODINGS = ("utf-8", "utf-16", "us-ascii", "iso-8859-1")
#: Where points are, and the element that has them.
_POINTS = {("gpx", "trk", "trkseg", "trkpt"): "trk", ("gpx", "rte", "rtept"): "rte"}
_TIME = re.compile(r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d)(\.\d+)?(Z|[+-]\d\d:\d\d)", re.ASCII)
#: Limits of a time [s], and of latitude, longitude [deg] and altitude [m].
TIMES = Limit(at_least=-1e12, at_most=1e12)
PLACES = (
    Limit(at_least=-90, at_most=90),
    Limit(at_least=-180, at_most=360),
    Limit(at_least=-10e3, at_most=1e8),
)
_UNITS = np.array([DEG, DEG, 1.0])
_MISSING = {"", "nan", "null", "none"}


@dataclass(frozen=True, eq=False)
class Track:
    """Places along a flight, as a file has them.

    Attributes:
        source: Name of the file.
        line: Line of the names of the columns, or of the first place.
        lines: Line of each place (n,).
        place: Latitude, longitude [rad] and altitude [m], or north, east, down [m] (n, 3).
        altitudes: What the altitudes may be above, with the convention of the format first; empty
            for north, east, down.
        time: Time of each place (n,) [s]; None for waypoints.
        time_name: Name of the time in the file.
        speed: Speed along the leg that begins at each waypoint (n,) [m/s], or None.
        attitude: Roll, pitch, yaw (n, 3) [rad], or None.
        covariance: C_aa (n, 6, 6), or None.
    """

    source: str
    line: int
    lines: NDArray[np.int64]
    place: FloatArray
    altitudes: tuple[str, ...]
    time: FloatArray | None
    time_name: str = "time"
    speed: FloatArray | None = None
    attitude: FloatArray | None = None
    covariance: FloatArray | None = None

    def error(self, message: str, row: int | None = None) -> InputError:
        """Return the error to raise about a place, or about the whole file."""
        line = self.line if row is None else self.lines[row]
        return InputError(f"{self.source}:{line}: {message}")


def read_gpx(file: TextFile) -> Track:
    """Return the contents of an open GPX file."""
    file.most_bytes, reader = _GPX_BYTES, _GpxReader(file.source)
    while data := file.read(_PIECE):
        reader.feed(data)
    rows = np.frombuffer(reader.close()).reshape(-1, 5)
    lines, time = rows[:, 0].astype(np.int64), rows[:, 4]
    if not len(rows):
        raise InputError(f"{file.source}: has no points")
    without = np.isnan(time)
    if without.any() and not without.all():
        line = lines[np.argmax(without)]
        raise InputError(f"{file.source}:{line}: has no time, but other points have one")
    return Track(
        file.source,
        int(lines[0]),
        lines,
        rows[:, 1:4] * _UNITS,
        ("sea", "ellipsoid"),
        None if without.all() else time - time[0],
    )


class _GpxReader:
    """A parser of GPX that keeps the numbers of the points only.

    A document type is refused, because its entities can expand without end or name other files.
    Encodings that Python decodes are refused too: some are no encodings of text.
    """

    def __init__(self, source: str) -> None:
        self._source, self._size = source, 0
        #: The number of tracks and of routes. Line, latitude, longitude [deg], elevation [m] and
        #: time [s] of each point of these, and the first error in a point.
        self._count = {"trk": 0, "rte": 0}
        self._points = {kind: array("d") for kind in self._count}
        self._problems: dict[str, InputError] = {}
        #: Names of the open elements; "" of another namespace.
        self._path: tuple[str, ...] = ()
        #: Line of the point that is open, its texts by name, and the text of its open element.
        self._line, self._texts, self._text = 0, dict[str, str](), ""
        parser = self._parser = expat.ParserCreate(namespace_separator=" ")
        parser.buffer_text = True
        parser.XmlDeclHandler = self._declared
        parser.StartDoctypeDeclHandler = self._doctype
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._characters

    def feed(self, data: bytes, last: bool = False) -> None:
        """Parse the next bytes."""
        parser = self._parser
        try:
            parser.Parse(data, last)
        except expat.ExpatError as error:
            reason = expat.ErrorString(error.code)
            raise self._error(f"is not valid XML: {reason}", error.lineno) from error
        self._size += len(data)
        if self._size - parser.CurrentByteIndex > _PIECE + _LONGEST:
            raise self._error(f"has an element, an attribute or a comment over {_LONGEST} bytes")

    def close(self) -> array[float]:
        """Return the numbers of the points of the one track, or of the one route."""
        self.feed(b"", last=True)
        tracks, routes = self._count.values()
        if tracks != 1 and (tracks, routes) != (0, 1):
            both = f"{counted(tracks, 'track')} and {counted(routes, 'route')}"
            raise self._error(f"must have one track or one route, got {both}", 1)
        kind = "trk" if tracks else "rte"
        if kind in self._problems:
            raise self._problems[kind]
        return self._points[kind]

    def _error(self, message: str, line: int | None = None) -> InputError:
        return InputError(f"{self._source}:{line or self._parser.CurrentLineNumber}: {message}")

    def _declared(self, version: str, encoding: str | None, standalone: int) -> None:
        if encoding is not None and encoding.lower() not in _ENCODINGS:
            raise self._error(
                f"encoding: must be one of {', '.join(_ENCODINGS)}, got {describe(encoding)}"
            )

    def _doctype(self, *_: Any) -> NoReturn:
        raise self._error("has a DOCTYPE, which is not allowed; remove it")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        space, _, name = tag.rpartition(" ")
        if not self._path and (space, name) != (_GPX, "gpx"):
            raise self._error("must be GPX 1.1, with the root gpx of its namespace")
        if len(self._path) == _DEPTH:
            raise self._error(f"has more than {_DEPTH} elements inside each other")
        if self._path in _POINTS:
            self._text = ""
        self._path = *self._path, name if space == _GPX else ""
        if len(self._path) == 2 and self._path[1] in self._count:
            self._count[name] += 1
        elif self._path in _POINTS:
            self._line, self._texts = self._parser.CurrentLineNumber, dict(attributes)

    def _characters(self, text: str) -> None:
        self._text = (self._text + text).lstrip()[: MAX_LETTERS + 1]

    def _end(self, _: str) -> None:
        *outer, name = self._path
        if self._path in _POINTS:
            self._add(_POINTS[self._path])
        elif tuple(outer) in _POINTS and name in ("ele", "time"):
            self._texts.setdefault(name, self._text)
        self._path = tuple(outer)

    def _add(self, kind: str) -> None:
        if len(self._points[kind]) == 5 * MAX_ROWS:
            raise self._error(f"has more than {MAX_ROWS:,} points", self._line)
        if kind in self._problems:
            return
        place, texts = f"{self._source}:{self._line}", self._texts
        try:
            if "ele" not in texts:
                raise InputError(f"{place}: missing 'ele', the elevation of the point")
            row = [
                number(texts.get(name, ""), limit, f"{place}: {name}")
                for name, limit in zip(("lat", "lon", "ele"), PLACES, strict=True)
            ]
            time = texts.get("time")
            row.append(np.nan if time is None else _seconds(f"{place}: time", time.strip()))
        except InputError as error:
            self._problems[kind] = error
        else:
            self._points[kind].extend([self._line, *row])


def _seconds(place: str, text: str) -> float:
    """Return a time in seconds since 1970, to the microsecond."""
    words = _TIME.fullmatch(text)
    if words is not None and words[1].endswith(":60"):
        raise InputError(
            f"{place}: is a leap second, which seconds since 1970 do not have, got "
            f"{describe(text)}; leave the point out"
        )
    try:
        if words is None:
            raise ValueError
        zone = words[3].replace("Z", "+00:00")
        return datetime.fromisoformat(words[1] + zone).timestamp() + float(words[2] or 0)
    except ValueError as error:
        raise InputError(
            f"{place}: must be a date and time with its zone, as 2026-11-22T07:08:00Z, "
            f"got {describe(text)}"
        ) from error


def read_state_vectors(file: TableFile, *, pressure: bool, icao24: str | None) -> Track:
    """Return the positions of one aircraft from state vectors.

    The altitude is the pressure altitude if asked for. Without an address, icao24, the file must
    have one aircraft only.
    """
    altitude = "baroaltitude" if pressure else "geoaltitude"
    for name in ("time", "icao24", "lat", "lon", altitude):
        if name not in file.names:
            instead = (
                "; baroaltitude is the pressure altitude, which differs from a height by up to "
                "some hundred metres; geometry.altitude_above: pressure takes it as the height "
                "above the sea"
                if name == "geoaltitude" and "baroaltitude" in file.names
                else ""
            )
            raise file.error(f"missing column '{name}' of ADS-B state vectors{instead}")
    moment = "lastposupdate" if "lastposupdate" in file.names else "time"
    # what two rows of one position have in common: its time, or else latitude and longitude
    same = slice(0, 1) if moment == "lastposupdate" else slice(1, 3)
    for name in (moment, "icao24", "lat", "lon", altitude):
        if file.names.count(name) > 1:
            raise file.error(f"duplicate column '{name}'")
    used = tuple(zip((moment, "lat", "lon", altitude), (TIMES, *PLACES), strict=True))
    lines: list[int] = []
    rows: list[list[float]] = []
    addresses: set[str] = set()
    for line, cells in file.rows():
        cell = dict(zip(file.names, cells, strict=True))
        address = cell["icao24"].lower()
        if icao24 is not None and address != icao24.lower():
            continue
        addresses.add(address)
        if len(addresses) > 1:
            raise file.error(
                f"icao24: must be one aircraft, got {describe(address)} too; geometry.icao24 "
                "chooses one",
                line,
            )
        if any(cell[name].lower() in _MISSING for name, _ in used):
            continue
        row = [file.number(cell[name], limit, name, line) for name, limit in used]
        if rows and rows[-1][same] == row[same]:
            continue  # the position before, repeated
        file.require_room(len(rows), line)
        lines.append(line)
        rows.append(row)
    if not rows:
        who = f"the aircraft {icao24}" if icao24 is not None and not addresses else "any row"
        raise FileError(f"{file.source}: has no position of {who}, with an altitude in {altitude}")
    numbers = np.array(rows)
    return Track(
        file.source,
        file.line,
        np.array(lines, dtype=np.int64),
        numbers[:, 1:] * _UNITS,
        ("ellipsoid", "pressure"),
        numbers[:, 0] - numbers[0, 0],
        moment,
    )
