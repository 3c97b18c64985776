"""An RCS table from a file.

The file is CSV, in the dialect of `csv_reader`. Its columns:

    azimuth_deg                λ = atan2(y, x): 0 off the nose, 90 off the right wing
    elevation_deg (optional)   atan2(−z, √(x² + y²)): 0 at the aircraft's horizon, 90 straight above
    rcs_m2 or rcs_dbsm         σ_r, or 10 log10 of σ_r in m²
    std_db (optional)          standard deviation of σ_r [dB], of one error that all aspects share

Azimuths go once around: −180 to 180, 0 to 360, or half of it (0 to 180, −180 to 0) if it is to be
mirrored. If both ends of a full circle are given they must agree. Angles ascend. A table with
elevations has every azimuth at each of them, row after row or column after column. A table
without elevations holds for all elevations.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_sense.errors import InputError
from radar_sense.limits import LARGEST, SMALLEST, Limit
from radar_sense.model.rcs_table import (
    MAX_NODES,
    STD_DB,
    TURN,
    Problem,
    TableRCS,
    differs_at_a_pole,
    gap,
    out_of_order,
)
from radar_sense.reading.csv_reader import Block, Column, Format, Header, read_csv
from radar_sense.states import FloatArray

COLUMNS = {
    "azimuth_deg": Column(Limit(at_least=-180, at_most=360)),
    "elevation_deg": Column(Limit(at_least=-90, at_most=90)),
    "rcs_m2": Column(Limit(at_least=SMALLEST, at_most=LARGEST)),
    "rcs_dbsm": Column(Limit(at_least=10 * np.log10(SMALLEST), at_most=10 * np.log10(LARGEST))),
    "std_db": Column(STD_DB),
}
FORMAT = Format("an RCS table", COLUMNS, ", ".join(COLUMNS), 50 * 2**20, MAX_NODES)


def load_rcs_table(
    path: str | Path, *, mirror: bool = False, envelope: float | None = None
) -> TableRCS:
    """Read an RCS table from a CSV file.

    Args:
        path: The file.
        mirror: Whether the file has one half of a symmetric aircraft.
        envelope: As in `TableRCS` [rad].

    Raises:
        InputError: If the file cannot be read or anything in the file is not allowed.
    """
    table, _ = read_rcs_table(path, mirror=mirror, envelope=envelope)
    return table


def read_rcs_table(
    path: str | Path,
    *,
    mirror: bool = False,
    envelope: float | None = None,
    sha256: str | None = None,
) -> tuple[TableRCS, str]:
    """Read an RCS table as `load_rcs_table` does, and return the SHA-256 of its bytes too.

    Args:
        path: The file.
        mirror: As in `load_rcs_table`.
        envelope: As in `load_rcs_table`.
        sha256: Digest that the file must have; None allows any.

    Raises:
        InputError: If the file cannot be read or anything in the file is not allowed.
    """
    lines: list[NDArray[np.intp]] = []

    def keep_lines(block: Block) -> None:
        lines.append(block.line_numbers())

    table = read_csv(
        path, FORMAT, check_header=_check_header, check_block=keep_lines, sha256=sha256
    )
    columns = dict(zip(table.header.names, np.concatenate(table.blocks).T.copy(), strict=True))
    where, file = np.concatenate(lines), _File(str(path))
    sigma = columns["rcs_m2"] if "rcs_m2" in columns else 10.0 ** (columns["rcs_dbsm"] / 10.0)
    azimuth, rcs, elevation = _nodes(columns, sigma, "m^2", where, mirror, file)
    std = None
    if "std_db" in columns:
        _, std, _ = _nodes(columns, columns["std_db"], "dB", where, mirror, file)
    return TableRCS(azimuth, rcs, elevation, envelope, std), table.sha256


@dataclass(frozen=True)
class _File:
    """The name of a file, for errors."""

    source: str

    def error(self, line: int, message: str) -> InputError:
        """Return the error to raise about a line."""
        return InputError(f"{self.source}:{line}: {message}")


def _check_header(header: Header) -> None:
    if "azimuth_deg" not in header.names:
        raise header.error("missing column 'azimuth_deg', which is always required")
    if ("rcs_m2" in header.names) == ("rcs_dbsm" in header.names):
        raise header.error("needs one of the columns rcs_m2 and rcs_dbsm, and not both")


def _nodes(
    columns: dict[str, FloatArray],
    sigma: FloatArray,
    unit: str,
    lines: NDArray[np.intp],
    mirror: bool,
    file: _File,
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Return azimuths (n,) [rad], values (n,) or (n, m), and elevations (m,) [rad] or None.

    Args:
        columns: The columns of the angles.
        sigma: The value of each row.
        unit: Unit of the values, for errors.
        lines: The line of each row.
        mirror: Whether the file has one half of a symmetric aircraft.
        file: The file, for errors.
    """
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
        _refuse(differs_at_a_pole(elevation, sigma, unit), where.ravel(), file)
    return azimuth, sigma, elevation


def _grid(
    angles: dict[str, FloatArray], lines: NDArray[np.intp], file: _File
) -> tuple[FloatArray, FloatArray]:
    """Return the two angles of a complete grid, the slowly changing one first."""
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
    """Mirror half a table, or remove the second of two equal ends."""
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
