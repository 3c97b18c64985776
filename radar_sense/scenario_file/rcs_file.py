"""An RCS table from a file.

The file is CSV, as `table_file` reads it. Its columns:

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

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radar_sense.limits import LARGEST, SMALLEST, Limit, check_flag
from radar_sense.model.rcs_table import (
    STD_DB,
    Problem,
    TableRCS,
    differs_at_a_pole,
    gap,
    out_of_order,
)
from radar_sense.scenario_file.table_file import NumberColumn, TableFile
from radar_sense.scenario_file.text_file import TextFile, open_text
from radar_sense.states import FloatArray

COLUMNS = {
    "azimuth_deg": NumberColumn(Limit(at_least=-180, at_most=360)),
    "elevation_deg": NumberColumn(Limit(at_least=-90, at_most=90)),
    "rcs_m2": NumberColumn(Limit(at_least=SMALLEST, at_most=LARGEST)),
    "rcs_dbsm": NumberColumn(
        Limit(at_least=10 * np.log10(SMALLEST), at_most=10 * np.log10(LARGEST))
    ),
    "std_db": NumberColumn(STD_DB),
}
#: Units of the values of a node, for errors.
_UNITS = {"rcs_m2": "m^2", "rcs_dbsm": "dBsm", "std_db": "dB"}
#: Azimuths of a full circle may differ by this [rad] from a turn.
_ROUNDING = 1e-9


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
    check_flag("mirror", mirror)
    with open_text(path, "an RCS table") as file:
        return read_rcs_table(file, mirror, envelope)


def read_rcs_table(opened: TextFile, mirror: bool, envelope: float | None) -> TableRCS:
    """Return the table in an open file, as `load_rcs_table` does."""
    file = TableFile(opened)
    file.require_known(COLUMNS, ", ".join(COLUMNS))
    file.require(["azimuth_deg"], "azimuth_deg, and one of rcs_m2 and rcs_dbsm")
    if ("rcs_m2" in file.names) == ("rcs_dbsm" in file.names):
        raise file.error("needs one of the columns rcs_m2 and rcs_dbsm, and not both")
    columns = dict(zip(file.names, file.numbers(COLUMNS).T.copy(), strict=True))
    azimuth, elevation, row = _nodes(file, columns, mirror)
    dbsm = columns.get("rcs_dbsm")
    rcs = columns["rcs_m2"] if dbsm is None else 10.0 ** (dbsm / 10.0)
    row = row[:, 0] if elevation is None else row
    std = columns["std_db"][row] if "std_db" in columns else None
    return TableRCS(azimuth, rcs[row], elevation, envelope, std)


def _nodes(
    file: TableFile, columns: dict[str, FloatArray], mirror: bool
) -> tuple[FloatArray, FloatArray | None, NDArray[np.intp]]:
    """Return azimuths (n,) [rad], elevations (m,) [rad] or None, and rows (n, m) or (n, 1)."""
    azimuth, elevation = np.deg2rad(columns["azimuth_deg"]), None
    row = np.arange(len(azimuth))[:, np.newaxis]
    if "elevation_deg" not in columns:
        _refuse(file, out_of_order("azimuth", azimuth), row[:, 0])
    else:
        elevation = np.deg2rad(columns["elevation_deg"])
        if len(azimuth) > 1 and azimuth[0] == azimuth[1]:
            row = _grid(file, {"azimuth": azimuth, "elevation": elevation})
        else:
            row = _grid(file, {"elevation": elevation, "azimuth": azimuth}).T
        azimuth, elevation = azimuth[row[:, 0]], elevation[row[0]]
    values = {name: unit for name, unit in _UNITS.items() if name in columns}
    if mirror:
        azimuth, row = _mirrored(file, azimuth, row)
    else:
        azimuth, row = _opened(file, azimuth, row, [columns[name] for name in values])
    _refuse(file, gap("azimuth", azimuth), row[:, 0])
    if elevation is not None:
        _refuse(file, gap("elevation", elevation), row.min(axis=0))
        for name, unit in values.items():
            problem = differs_at_a_pole(elevation, columns[name][row], unit)
            _refuse(file, problem, row.ravel())
    return azimuth, elevation, row


def _grid(file: TableFile, angles: dict[str, FloatArray]) -> NDArray[np.intp]:
    """Return the rows of a complete grid, by the slowly changing angle and by the other.

    The angles [rad] of each row are by name, the slowly changing one first.
    """
    (slow_name, slow), (fast_name, fast) = angles.items()
    starts = np.flatnonzero(np.diff(slow, prepend=np.nan) != 0)
    _refuse(file, out_of_order(slow_name, slow[starts]), starts)
    blocks = np.split(np.arange(len(slow)), starts[1:])
    first = fast[blocks[0]]
    for block in blocks:
        _refuse(file, out_of_order(fast_name, fast[block]), block)
        common = min(len(block), len(first))
        off = np.flatnonzero(fast[block[:common]] != first[:common])
        if len(off):
            raise file.error(
                f"the grid is not complete: {fast_name} must be {np.rad2deg(first[off[0]]):g} "
                f"here, as at the first {slow_name}, got {np.rad2deg(fast[block[off[0]]]):g}",
                file.lines[block[off[0]]],
            )
        if len(block) != len(first):
            raise file.error(
                f"the grid is not complete: {slow_name} {np.rad2deg(slow[block[0]]):g} has "
                f"{len(block)} of the values for {fast_name}, must have {len(first)} as the first "
                f"{slow_name} has",
                file.lines[block[-1]],
            )
    if len(blocks) < 2 or len(first) < 2:
        raise file.error(
            "needs two or more azimuths and elevations; a table that holds for all elevations has "
            "no column for them",
            file.lines[0],
        )
    return np.stack(blocks)


def _mirrored(
    file: TableFile, azimuth: FloatArray, row: NDArray[np.intp]
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return azimuths and rows of the whole circle, from one half."""
    right = azimuth[-1] > 0
    low, high = (0.0, np.pi) if right else (-np.pi, 0.0)
    outside = np.flatnonzero((azimuth < low) | (azimuth > high))
    if len(outside):
        raise file.error(
            "mirror: true is for azimuths from 0 to 180, or from -180 to 0, "
            f"got {np.rad2deg(azimuth[outside[0]]):g}",
            file.lines[row[outside[0], 0]],
        )
    # 0 and ±180 are their own mirror images
    imaged = np.flatnonzero((azimuth != 0) & (abs(azimuth) != np.pi))[::-1]
    halves = [(-azimuth[imaged], row[imaged]), (azimuth, row)]
    azimuths, rows = zip(*(halves if right else halves[::-1]), strict=True)
    return np.concatenate(azimuths), np.concatenate(rows)


def _opened(
    file: TableFile, azimuth: FloatArray, row: NDArray[np.intp], values: list[FloatArray]
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return azimuths and rows of the whole circle, without the second of two equal ends."""
    turned = azimuth - azimuth[0] - math.tau
    if turned[-1] < -_ROUNDING:
        return azimuth, row
    if turned[-1] > _ROUNDING:
        at = int(np.argmax(turned > _ROUNDING))
        raise file.error(
            f"azimuth {np.rad2deg(azimuth[at]):g} is more than a turn from the first, "
            f"{np.rad2deg(azimuth[0]):g}",
            file.lines[row[at, 0]],
        )
    differs = np.any([value[row[0]] != value[row[-1]] for value in values], axis=0)
    if differs.any():
        ends = " and ".join(f"{np.rad2deg(azimuth[i]):g}" for i in (-1, 0))
        raise file.error(
            f"azimuth {ends} are the same direction and have different values; leave one of them "
            "out",
            file.lines[row[-1, np.argmax(differs)]],
        )
    return azimuth[:-1], row[:-1]


def _refuse(file: TableFile, problem: Problem | None, rows: NDArray[np.intp]) -> None:
    if problem:
        index, message = problem
        raise file.error(message, file.lines[rows[index]])
