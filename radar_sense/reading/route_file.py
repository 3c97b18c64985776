"""A route file to a `Route`."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

import numpy as np

from radar_sense.covariance import first_problem
from radar_sense.errors import ScenarioError, did_you_mean
from radar_sense.limits import DEG, Limit
from radar_sense.model import geodesy as wgs84
from radar_sense.model.trajectory import (
    _ATTITUDE,
    _NOTHING,
    MAX_ROWS,
    MIN_STEP,
    Route,
    _attitude,
    _motion,
    _route,
    _to_origin,
)
from radar_sense.states import AIRCRAFT, POSITION, FloatArray

#: A million rows of 28 numbers with 17 digits each are 0.7 GB.
MAX_BYTES = 2**30
_READ_BYTES = 2**22
_MAX_LINE_BYTES = 2**16
_NUMBER = re.compile(rb"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
_NUMBER_BYTES = b"0123456789+-.eE, \t\n"
_NOT_FINITE = re.compile(r"[-+]?(inf|infinity|nan)", re.IGNORECASE)
_NED = AIRCRAFT[POSITION]
_GEODETIC = ("latitude_deg", "longitude_deg", "altitude_m")
_UNITS = ("m",) * 3 + ("deg",) * 3
_STD = tuple(f"std_{name}_{unit}" for name, unit in zip(AIRCRAFT, _UNITS, strict=True))
_UPPER = tuple((i, j) for i in range(6) for j in range(i, 6))
_COV = tuple(
    f"cov_{AIRCRAFT[i]}_{AIRCRAFT[j]}_"
    + (f"{_UNITS[i]}2" if _UNITS[i] == _UNITS[j] else f"{_UNITS[i]}_{_UNITS[j]}")
    for i, j in _UPPER
)
#: Where each entry of the covariance stands among the 21.
_ENTRY = np.array([[_UPPER.index((min(i, j), max(i, j))) for j in range(6)] for i in range(6)])
_COV_UNITS = np.repeat([1.0, DEG], 3)
#: Farther than any aircraft or satellite, 100 000 km, is a mistake in the units.
_FAR = 1e8
_TURN = 360.0
_STD_LIMITS = (_FAR,) * 3 + (_TURN,) * 3
_ALLOWED = (
    "time_s; north_m, east_m, down_m (or _km), or latitude_deg, longitude_deg, altitude_m; "
    "roll_deg, pitch_deg, yaw_deg; std_north_m to std_yaw_deg, "
    "or cov_north_north_m2 to cov_yaw_yaw_deg2"
)


@dataclass(frozen=True)
class _Column:
    """What a column may hold, and its unit in SI."""

    limit: Limit
    unit: float = 1.0


def _within(low: float, high: float, unit: float = 1.0) -> _Column:
    return _Column(Limit(at_least=low, at_most=high), unit)


_COLUMNS: dict[str, _Column] = {
    "time_s": _within(-1e12, 1e12),
    **{f"{axis}_m": _within(-_FAR, _FAR) for axis in _NED},
    **{f"{axis}_km": _within(-_FAR / 1e3, _FAR / 1e3, 1e3) for axis in _NED},
    "latitude_deg": _within(-90.0, 90.0, DEG),
    "longitude_deg": _within(-180.0, 360.0, DEG),
    "altitude_m": _within(-10e3, _FAR),
    "roll_deg": _within(-_TURN, _TURN, DEG),
    "pitch_deg": _within(-90.0, 90.0, DEG),
    "yaw_deg": _within(-_TURN, _TURN, DEG),
    **{name: _within(0.0, most) for name, most in zip(_STD, _STD_LIMITS, strict=True)},
    **{
        name: _within(
            0.0 if i == j else -_STD_LIMITS[i] * _STD_LIMITS[j], _STD_LIMITS[i] * _STD_LIMITS[j]
        )
        for name, (i, j) in zip(_COV, _UPPER, strict=True)
    },
}


def load_route(
    path: str | Path,
    *,
    origin: tuple[float, float, float] | None = None,
    max_gap_s: float | None = None,
) -> Route:
    """Read and check a route file.

    Args:
        path: The file; what may be in it is said at the top of this module.
        origin: Latitude, longitude [rad] and height above the ellipsoid [m] of the origin of the
            north-east-down frame; needed for a file with latitude and longitude, and only there.
        max_gap_s: The longest step of time allowed [s]; None allows any.

    Raises:
        ScenarioError: If the file cannot be read or anything in it is not allowed.
        ValueError: If the origin is no place.
    """
    source = str(path)
    if origin is not None and not (np.all(np.isfinite(origin)) and abs(origin[0]) <= np.pi / 2):
        raise ValueError(
            f"origin must be latitude and longitude [rad] and height [m], got {origin}"
        )
    if max_gap_s is not None and not max_gap_s > 0:
        raise ScenarioError(f"max_gap_s must be a number greater than 0, got {max_gap_s}")
    layout, blocks = _read(path, max_gap_s)
    if layout.geodetic and origin is None:
        raise ScenarioError(
            f"{source}:{layout.line}: latitude_deg: needs the origin of the north-east-down frame, "
            "geometry.origin in a scenario"
        )
    if not layout.geodetic and origin is not None:
        raise ScenarioError(
            f"{source}:{layout.line}: north, east and down are about an origin already, "
            "one in latitude and longitude has no use here"
        )
    time, place, attitude, covariance = _assemble(layout, blocks)
    position = place if origin is None else wgs84.ned_from_geodetic(place, origin)
    if attitude is None:
        if len(time) < 2:
            raise ScenarioError(
                f"{source}: has 1 row; attitude from the track needs 2 or more, "
                f"or the columns {', '.join(_ATTITUDE)}"
            )
        attitude = _attitude(source, place, *_motion(time, position), origin)
    if origin is not None:
        attitude = _to_origin(source, time, place, attitude, covariance, origin)
    return _route(time, position, attitude, covariance, layout.attitude is not None, origin)


@dataclass(frozen=True)
class _Layout:
    """Which column of the file holds what: indices."""

    names: tuple[str, ...]
    line: int
    time: int
    position: list[int]
    geodetic: bool
    attitude: list[int] | None
    std: list[int] | None
    cov: list[int] | None

    def units(self, columns: Sequence[int]) -> FloatArray:
        return np.array([_COLUMNS[self.names[column]].unit for column in columns])


def _assemble(
    layout: _Layout, blocks: list[FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray | None, FloatArray | None]:
    """Time, place, attitude and covariance out of the rows; these are dropped on the way."""
    count = sum(len(block) for block in blocks)
    time, place = np.empty(count), np.empty((count, 3))
    attitude = np.empty((count, 3)) if layout.attitude else None
    covariance = np.zeros((count, 6, 6)) if layout.std or layout.cov else None
    stop = count
    # From the last to the first: memory that was taken last can be given back first.
    while blocks:
        rows = blocks.pop()
        some = slice(stop - len(rows), stop)
        time[some] = rows[:, layout.time]
        place[some] = rows[:, layout.position] * layout.units(layout.position)
        if layout.attitude and attitude is not None:
            attitude[some] = rows[:, layout.attitude] * layout.units(layout.attitude)
        if layout.std and covariance is not None:
            diagonal = np.arange(6)
            covariance[some, diagonal, diagonal] = (rows[:, layout.std] * _COV_UNITS) ** 2
        if layout.cov and covariance is not None:
            covariance[some] = rows[:, layout.cov][:, _ENTRY] * np.outer(_COV_UNITS, _COV_UNITS)
        stop -= len(rows)
    return time, place, attitude, covariance


def _read(path: str | Path, max_gap_s: float | None) -> tuple[_Layout, list[FloatArray]]:
    """Read and check all rows, in the units of the file."""
    layout: _Layout | None = None
    blocks: list[FloatArray] = []
    count, before = 0, -math.inf
    for text in _texts(path):
        if layout is None:
            for line, content in text.lines():
                layout = _layout(content, text.source, line)
                break
            if layout is None:
                continue
            text = text.after(layout.line)
        rows = _numbers(text, layout)
        _check_limits(rows, text, layout)
        if count + len(rows) > MAX_ROWS:
            raise text.error(MAX_ROWS - count, f"has more than {MAX_ROWS:,} rows")
        if len(rows):
            _check_times(rows[:, layout.time], before, max_gap_s, text)
            count, before = count + len(rows), float(rows[-1, layout.time])
            blocks.append(rows)
        if layout.cov:
            numbers = rows[:, layout.cov]
            numbers[np.abs(numbers) < _NOTHING] = 0.0
            rows[:, layout.cov] = numbers
            bad = first_problem(numbers[:, _ENTRY])
            if bad:
                raise text.error(bad[0], f"covariance {bad[1]}")
    if layout is None:
        raise ScenarioError(f"{path}: is empty; the first line must name the columns: {_ALLOWED}")
    if not blocks:
        raise ScenarioError(f"{path}: has no rows below the names of its columns")
    return layout, blocks


@dataclass(frozen=True)
class _Text:
    """Whole lines of the file, without comments, and the number of the first."""

    source: str
    first_line: int
    content: bytes

    def lines(self) -> Iterator[tuple[int, str]]:
        """The lines that are not empty, with their numbers."""
        for line, content in enumerate(self.content.split(b"\n"), start=self.first_line):
            if content.strip():
                yield line, content.decode("utf-8").strip()

    def after(self, line: int) -> _Text:
        """The text below a line."""
        above = line + 1 - self.first_line
        pieces = self.content.split(b"\n", above)
        return replace(self, first_line=line + 1, content=b"".join(pieces[above:]))

    def row(self, index: int) -> tuple[int, list[str]]:
        """Number and cells of the line that holds a row."""
        line, content = next(found for i, found in enumerate(self.lines()) if i == index)
        return line, [cell.strip() for cell in content.split(",")]

    def error(self, row: int, message: str) -> ScenarioError:
        return ScenarioError(f"{self.source}:{self.row(row)[0]}: {message}")


def _texts(path: str | Path) -> Iterator[_Text]:
    """Read a file piece by piece.

    Raises:
        ScenarioError: If it cannot be read, is too large, or is not UTF-8 text.
    """
    try:
        with Path(path).open("rb") as file:
            for line, content in _pieces(file, str(path)):
                yield _Text(str(path), line, _without_comments(content, str(path), line))
    except IsADirectoryError as error:
        raise ScenarioError(f"{path}: is a directory, not a route file") from error
    except ScenarioError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte in it
        reason = getattr(error, "strerror", None) or error
        raise ScenarioError(f"{path}: cannot be read: {reason}") from error


def _pieces(file: BinaryIO, source: str) -> Iterator[tuple[int, bytes]]:
    """Whole lines, some megabytes at a time, with the number of the first."""
    line, size, rest = 1, 0, b""
    while data := file.read(_READ_BYTES):
        size += len(data)
        if size > MAX_BYTES:
            raise ScenarioError(f"{source}: is larger than {MAX_BYTES // 2**20} MiB")
        data = rest + data
        if line == 1:
            data = data.removeprefix(b"\xef\xbb\xbf")  # a byte order mark
        cut = data.rfind(b"\n") + 1
        data, rest = data[:cut], data[cut:]
        if data:
            yield line, data
            line += data.count(b"\n")
        if len(rest) > _MAX_LINE_BYTES:
            raise ScenarioError(f"{source}:{line}: is longer than {_MAX_LINE_BYTES} bytes")
    if rest:
        yield line, rest


def _without_comments(content: bytes, source: str, line: int) -> bytes:
    if not content.isascii():
        try:
            content.decode("utf-8")
        except UnicodeDecodeError as error:
            line += content[: error.start].count(b"\n")
            raise ScenarioError(
                f"{source}:{line}: is not UTF-8 text: byte 0x{content[error.start]:02x}"
            ) from error
    content = content.replace(b"\r\n", b"\n")
    return re.sub(rb"#[^\n]*", b"", content) if b"#" in content else content


def _layout(header: str, source: str, line: int) -> _Layout:
    """Find out what the columns are from the line that names them."""
    place = f"{source}:{line}"
    names = tuple(name.strip() for name in header.split(","))
    for i, name in enumerate(names):
        if name not in _COLUMNS:
            raise ScenarioError(
                f"{place}: unknown column {_shorten(name)}, allowed: {_ALLOWED}"
                + did_you_mean(name[:100], set(_COLUMNS) - set(names))
                + ("; columns are separated by commas" if re.search("[;\t]", name) else "")
                + ("; the first line must name the columns" if _is_number(names[0]) else "")
            )
        if name in names[:i]:
            raise ScenarioError(f"{place}: duplicate column '{name}'")

    def indices(wanted: Sequence[str], why: str) -> list[int]:
        missing = [name for name in wanted if name not in names]
        if missing:
            raise ScenarioError(f"{place}: missing column '{missing[0]}', {why}")
        return [names.index(name) for name in wanted]

    def optional(wanted: Sequence[str]) -> list[int] | None:
        if not set(wanted) & set(names):
            return None
        several = f"{wanted[0]} to {wanted[-1]}" if len(wanted) > 3 else ", ".join(wanted)
        return indices(wanted, f"required are all of {several}, or none")

    ned = []
    for axis in _NED:
        given = [name for name in (f"{axis}_m", f"{axis}_km") if name in names]
        if len(given) > 1:
            raise ScenarioError(f"{place}: has {' and '.join(given)}; allowed is one of them")
        ned.append(given[0] if given else f"{axis}_m")
    geodetic = bool(set(_GEODETIC) & set(names))
    if geodetic and set(ned) & set(names):
        raise ScenarioError(
            f"{place}: has north, east, down beside latitude, longitude, altitude; "
            "allowed is one or other"
        )
    position = _GEODETIC if geodetic else tuple(ned)
    layout = _Layout(
        names=names,
        line=line,
        time=indices(["time_s"], "which is always required")[0],
        position=indices(position, f"required are {', '.join(_GEODETIC)}, or north, east, down"),
        geodetic=geodetic,
        attitude=optional(_ATTITUDE),
        std=optional(_STD),
        cov=optional(_COV),
    )
    if layout.std and layout.cov:
        raise ScenarioError(f"{place}: has {_STD[0]} beside {_COV[0]}; allowed is one or other")
    return layout


def _numbers(text: _Text, layout: _Layout) -> FloatArray:
    """All numbers of a text (rows, columns): at once, and if that fails one by one to see why."""
    # Nothing but plain numbers gets to NumPy, which would take other things for numbers too.
    if text.content.strip() and not text.content.translate(None, delete=_NUMBER_BYTES):
        try:
            lines = text.content.decode("ascii").split("\n")
            rows = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)
        except ValueError:
            rows = np.empty((0, 0))
        if rows.shape[-1] == len(layout.names):
            return rows
    slowly = []
    for line, content in text.lines():
        place = f"{text.source}:{line}"
        cells = [cell.strip() for cell in content.split(",")]
        if len(cells) != len(layout.names):
            raise ScenarioError(
                f"{place}: must have {len(layout.names)} values, one for each column, "
                f"got {len(cells)}"
            )
        for name, cell in zip(layout.names, cells, strict=True):
            if _NOT_FINITE.fullmatch(cell):
                raise ScenarioError(f"{place}: {name}: must be finite, got {cell}")
            if not _is_number(cell):
                raise _wrong(place, name, cell)
        slowly.append([float(cell) for cell in cells])
    return np.array(slowly, dtype=float).reshape(-1, len(layout.names))


def _check_limits(rows: FloatArray, text: _Text, layout: _Layout) -> None:
    limits = [_COLUMNS[name].limit for name in layout.names]
    low, high = (
        np.array([getattr(limit, end) for limit in limits]) for end in ("at_least", "at_most")
    )
    if rows.size and not (np.all(rows.min(axis=0) >= low) and np.all(rows.max(axis=0) <= high)):
        row, column = np.argwhere((rows < low) | (rows > high))[0]
        line, cells = text.row(row)
        raise _wrong(f"{text.source}:{line}", layout.names[column], cells[column])


def _check_times(time: FloatArray, before: float, max_gap_s: float | None, text: _Text) -> None:
    steps = np.diff(time, prepend=before)
    backwards = steps < MIN_STEP
    if backwards.any():
        row = int(np.argmax(backwards))
        line, _ = text.row(row)
        earlier = float(time[row - 1]) if row else before
        enough = f", by {MIN_STEP:g} s or more" if steps[row] > 0 else ""
        raise ScenarioError(
            f"{text.source}:{line}: time_s: must be later than {earlier!r}, "
            f"the time of the row before{enough}, got {float(time[row])!r}"
        )
    if max_gap_s is not None:
        gap = np.isfinite(steps) & (steps > max_gap_s)
        if gap.any():
            row = int(np.argmax(gap))
            raise text.error(
                row,
                f"time_s: must be within {max_gap_s:g} s of the row before, got {steps[row]:g} s",
            )


def _wrong(place: str, name: str, cell: str) -> ScenarioError:
    got = (
        "nothing" if not cell else cell if _is_number(cell) and len(cell) <= 40 else _shorten(cell)
    )
    return ScenarioError(f"{place}: {name}: must be {_COLUMNS[name].limit}, got {got}")


def _is_number(cell: str) -> bool:
    return bool(_NUMBER.fullmatch(cell.encode()))


def _shorten(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:37] + "...")
