"""Reading an RCS table from a file.

The file is CSV. Lines that begin with # are comments. The first other line names the columns:

    azimuth_deg                λ = atan2(y, x): 0 off the nose, 90 off the right wing
    elevation_deg (optional)   atan2(−z, √(x² + y²)): 0 at the aircraft's horizon, 90 straight above
    rcs_m2 or rcs_dbsm         σ_r, or 10 log10 of σ_r in m²

Azimuths go once around: −180 to 180, 0 to 360, or half of it (0 to 180, −180 to 0) if it is to be
mirrored. If both ends of a full circle are given they must agree. Angles ascend. In a table with
elevations every azimuth is there at each of them, row after row or column after column. A table
without them holds for all elevations.
"""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_sense.errors import ScenarioError, did_you_mean
from radar_sense.limits import LARGEST, SMALLEST
from radar_sense.model.rcs_table import (
    ENVELOPE,
    MAX_NODES,
    TURN,
    Problem,
    TableRCS,
    differs_at_a_pole,
    gap,
    out_of_order,
)
from radar_sense.reading.yaml_reader import Entry, recorded
from radar_sense.states import FloatArray

#: Keys of a scenario's RCS table, beside `model`.
KEYS = ("file", "mirror", "envelope_deg", "sha256")
MAX_BYTES = 50_000_000
#: Columns of the file, and the least and greatest that each may hold.
_COLUMNS = {
    "azimuth_deg": (-180.0, 360.0),
    "elevation_deg": (-90.0, 90.0),
    "rcs_m2": (SMALLEST, LARGEST),
    "rcs_dbsm": (10 * np.log10(SMALLEST), 10 * np.log10(LARGEST)),
}


def load_rcs_table(
    path: str | Path, *, mirror: bool = False, envelope: float | None = None
) -> TableRCS:
    """Read an RCS table from a CSV file.

    Args:
        path: The file.
        mirror: Whether the file has one half of an aircraft whose halves are alike.
        envelope: As in `TableRCS` [rad].

    Raises:
        ScenarioError: If the file cannot be read, or anything in it is not allowed.
    """
    try:
        data = _read(Path(path))
    except (OSError, ValueError) as error:
        raise ScenarioError(f"{path}: {_reason(error)}") from error
    return TableRCS(*_parse(data, str(path), mirror), envelope=envelope)


def read_table(entry: Entry) -> tuple[TableRCS, dict[str, Any]]:
    """Read the RCS table that an entry of a scenario names.

    The file is looked for from the folder of the scenario file.

    Returns:
        The table, and the entry as it is to be recorded: with the file as seen from the
        working folder and its SHA-256, so that it reads back as this table or not at all.

    Raises:
        ScenarioError: If anything in the entry or the file is not allowed.
    """
    found = entry.mapping(["model", "file"], ["mirror", "envelope_deg", "sha256"])
    name = found["file"].text(r"[^\0\r\n]{1,1000}", "the name of a CSV file")
    mirror = "mirror" in found and found["mirror"].choice(["true", "false"]) == "true"
    path = Path(entry.source).parent / name
    try:
        data = _read(path)
    except (OSError, ValueError) as error:
        raise found["file"].error(f"{path} {_reason(error)}") from error
    digest = hashlib.sha256(data).hexdigest()
    if "sha256" in found:
        expected = found["sha256"].text("[0-9a-f]{64}", "64 digits 0 to 9 and a to f")
        if expected != digest:
            raise found["sha256"].error(f"{path} is another file than it was: it has {digest}")
    document: dict[str, Any] = {"file": recorded(path), "mirror": mirror, "sha256": digest}
    envelope = None
    if "envelope_deg" in found:
        document["envelope_deg"] = found["envelope_deg"].number(ENVELOPE)
        envelope = float(np.deg2rad(document["envelope_deg"]))
    return TableRCS(*_parse(data, str(path), mirror), envelope=envelope), document


def _read(path: Path) -> bytes:
    with path.open("rb") as file:
        data = file.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise ValueError(f"is larger than {MAX_BYTES // 1_000_000} MB, too large for a table")
    return data


def _reason(error: OSError | ValueError) -> str:
    if isinstance(error, OSError):
        return f"cannot be read: {error.strerror or error}"
    return str(error)


@dataclass(frozen=True)
class _File:
    """A file in errors."""

    source: str

    def error(self, line: int, message: str) -> ScenarioError:
        return ScenarioError(f"{self.source}:{line}: {message}")


def _parse(
    data: bytes, source: str, mirror: bool
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Check the content of a file: azimuths (n,), values (n,) or (n, m), elevations (m,) or None.

    All in radians and m².
    """
    file = _File(source)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise file.error(line, f"is not UTF-8 text: byte 0x{data[error.start]:02x}") from error
    columns, lines = _columns(text, file)
    for name, values in columns.items():
        low, high = _COLUMNS[name]
        wrong = np.flatnonzero(~((values >= low) & (values <= high)))
        if len(wrong):
            raise file.error(
                lines[wrong[0]],
                f"{name} must be a number from {low:g} to {high:g}, got {values[wrong[0]]:g}",
            )
    if len(lines) > MAX_NODES:
        raise file.error(lines[MAX_NODES], f"has more than the {MAX_NODES:,} rows allowed")
    sigma = columns["rcs_m2"] if "rcs_m2" in columns else 10.0 ** (columns["rcs_dbsm"] / 10.0)
    azimuth = np.deg2rad(columns["azimuth_deg"])
    elevation = None
    where = lines
    if "elevation_deg" in columns:
        elevation = np.deg2rad(columns["elevation_deg"])
        by_azimuth = len(azimuth) > 1 and azimuth[0] == azimuth[1]
        if by_azimuth:
            azimuth, elevation = _grid({"azimuth": azimuth, "elevation": elevation}, lines, file)
            shape = (len(azimuth), len(elevation))
            sigma, where = sigma.reshape(shape), lines.reshape(shape)
        else:
            elevation, azimuth = _grid({"elevation": elevation, "azimuth": azimuth}, lines, file)
            shape = (len(elevation), len(azimuth))
            sigma, where = sigma.reshape(shape).T, lines.reshape(shape).T
    else:
        _refuse(out_of_order("azimuth", azimuth), lines, file)
    azimuth, sigma, where = _whole_circle(azimuth, sigma, where, mirror, file)
    _refuse(gap("azimuth", azimuth), where.reshape(len(azimuth), -1)[:, 0], file)
    if elevation is not None:
        _refuse(gap("elevation", elevation), where[0], file)
        _refuse(differs_at_a_pole(elevation, sigma), where.ravel(), file)
    return azimuth, sigma, elevation


def _columns(text: str, file: _File) -> tuple[dict[str, FloatArray], NDArray[np.intp]]:
    """Read the columns by name, and the line that each row stands on."""
    rows = csv.reader(_without_comments(text), skipinitialspace=True, strict=True)
    header: list[str] = []
    found: list[list[float]] = []
    lines: list[int] = []
    try:
        for row in rows:
            line = rows.line_num
            if not row:
                continue
            cells = [cell.strip() for cell in row]
            if not header:
                header = cells
                _check_header(header, line, file)
                continue
            if len(cells) != len(header):
                raise file.error(
                    line, f"must have {len(header)} values, {', '.join(header)}, "
                    f"got {len(cells)}"
                )  # fmt: skip
            found.append([_number(*pair, line, file) for pair in zip(header, cells, strict=True)])
            lines.append(rows.line_num)
    except csv.Error as error:
        raise file.error(rows.line_num, f"is not valid CSV: {error}") from error
    if not found:
        raise file.error(max(rows.line_num, 1), "has no rows of numbers")
    return dict(zip(header, np.array(found).T.copy(), strict=True)), np.array(lines, dtype=np.intp)


def _without_comments(text: str) -> Iterator[str]:
    """Give line after line; comments as empty lines, so that the numbers of the others stay."""
    for line in text.split("\n"):
        yield "" if line.lstrip().startswith("#") else line.rstrip("\r")


def _check_header(header: list[str], line: int, file: _File) -> None:
    for name in header:
        if name not in _COLUMNS:
            shown = name if len(name) <= 40 else name[:37] + "..."
            raise file.error(
                line,
                f"unknown column {shown!r}, allowed: {', '.join(_COLUMNS)}"
                + did_you_mean(name, set(_COLUMNS) - set(header)),
            )
        if header.count(name) > 1:
            raise file.error(line, f"has the column {name} twice")
    if "azimuth_deg" not in header:
        raise file.error(line, "has no column azimuth_deg")
    if ("rcs_m2" in header) == ("rcs_dbsm" in header):
        raise file.error(line, "needs one of the columns rcs_m2 and rcs_dbsm, and not both")


def _number(name: str, cell: str, line: int, file: _File) -> float:
    try:
        if "_" not in cell:  # Python's 1_000 is not a number elsewhere
            return float(cell)
    except ValueError:
        pass
    shown = cell if len(cell) <= 40 else cell[:37] + "..."
    raise file.error(line, f"{name} must be a number, got {shown!r}")


def _grid(
    angles: dict[str, FloatArray], lines: NDArray[np.intp], file: _File
) -> tuple[FloatArray, FloatArray]:
    """Return the two angles of a complete grid, that which changes slowly first, as it is given."""
    names, (slow, fast) = list(angles), angles.values()
    starts = np.flatnonzero(np.diff(slow, prepend=np.nan) != 0)
    _refuse(out_of_order(names[0], slow[starts]), lines[starts], file)
    blocks = np.split(fast, starts[1:])
    first = blocks[0]
    for start, block in zip(starts, blocks, strict=True):
        _refuse(out_of_order(names[1], block), lines[start:], file)
        common = min(len(block), len(first))
        off = np.flatnonzero(block[:common] != first[:common])
        at = f"{names[0]} {np.rad2deg(slow[start]):g}"
        if len(off):
            raise file.error(
                lines[start + off[0]],
                f"the grid is not complete: {names[1]} must be {np.rad2deg(first[off[0]]):g} here, "
                f"as at the first {names[0]}, got {np.rad2deg(block[off[0]]):g}",
            )
        if len(block) != len(first):
            raise file.error(
                lines[start + len(block) - 1],
                f"the grid is not complete: {at} has {len(block)} of the values for {names[1]}, "
                f"must have {len(first)} as the first {names[0]} has",
            )
    if len(starts) < 2 or len(first) < 2:
        raise file.error(
            lines[0], "needs two or more azimuths and elevations; a table that holds for all "
            "elevations has no column for them"
        )  # fmt: skip
    return slow[starts], first


def _whole_circle(
    azimuth: FloatArray, sigma: FloatArray, where: NDArray[np.intp], mirror: bool, file: _File
) -> tuple[FloatArray, FloatArray, NDArray[np.intp]]:
    """Mirror half a table, or take the second of two equal ends away."""
    first_lines = where.reshape(len(azimuth), -1)[:, 0]
    if mirror:
        right = azimuth[-1] > 0
        low, high = (0.0, np.pi) if right else (-np.pi, 0.0)
        outside = np.flatnonzero((azimuth < low) | (azimuth > high))
        if len(outside):
            raise file.error(
                first_lines[outside[0]],
                "mirror: true is for azimuths from 0 to 180, or from -180 to 0, "
                f"got {np.rad2deg(azimuth[outside[0]]):g}",
            )
        # 0 and ±180 are their own mirror images
        imaged = np.flatnonzero((azimuth != 0) & (abs(azimuth) != np.pi))[::-1]

        def both(values: NDArray[Any], images: NDArray[Any]) -> NDArray[Any]:
            return np.concatenate([images, values] if right else [values, images])

        return (
            both(azimuth, -azimuth[imaged]),
            both(sigma, sigma[imaged]),
            both(where, where[imaged]),
        )
    over = azimuth[-1] - azimuth[0] - TURN
    if over > 1e-9:
        at = np.flatnonzero(azimuth - azimuth[0] - TURN > 1e-9)[0]
        raise file.error(
            first_lines[at], f"azimuth {np.rad2deg(azimuth[at]):g} is more than a turn from the "
            f"first, {np.rad2deg(azimuth[0]):g}"
        )  # fmt: skip
    if over > -1e-9:
        differ = np.flatnonzero(np.atleast_1d(sigma[-1] != sigma[0]))
        if len(differ):
            ends = (f"{np.rad2deg(azimuth[i]):g}" for i in (-1, 0))
            raise file.error(
                int(np.atleast_1d(where[-1])[differ[0]]),
                f"azimuth {' and '.join(ends)} are the same direction and have different values; "
                "leave one of them out",
            )
        return azimuth[:-1], sigma[:-1], where[:-1]
    return azimuth, sigma, where


def _refuse(problem: Problem | None, lines: NDArray[np.intp], file: _File) -> None:
    if problem:
        index, message = problem
        raise file.error(int(lines[index]), message)
