"""The gain of an antenna over elevation, and a mask over azimuth, from files.

Each is CSV, as `table_file` reads it, with two columns and ascending angles:

    elevation_deg, gain_db         one-way gain relative to the greatest [dB], 0 at most
    azimuth_deg, elevation_deg     lowest visible elevation, azimuth clockwise from north
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from radar_sense.limits import DEG
from radar_sense.model.antenna import AZIMUTH, ELEVATION, GAIN_DB
from radar_sense.scenario_file.table_file import NumberColumn, TableFile
from radar_sense.scenario_file.text_file import TextFile
from radar_sense.states import FloatArray

#: A turn, and the least part of it that a mask has: the rest is a straight line.
_TURN_DEG, _LEAST_DEG = 360.0, 240.0


def read_gain(opened: TextFile) -> tuple[FloatArray, FloatArray]:
    """Return elevations (n,) [rad] and gains (n,) [dB] of an open file."""
    columns = {"elevation_deg": NumberColumn(ELEVATION), "gain_db": NumberColumn(GAIN_DB)}
    _, elevation, gain = _read(opened, columns)
    return elevation * DEG, gain


def read_mask(opened: TextFile) -> tuple[FloatArray, FloatArray]:
    """Return azimuths (n,) [rad] and lowest visible elevations (n,) [rad] of an open file."""
    columns = {"azimuth_deg": NumberColumn(AZIMUTH), "elevation_deg": NumberColumn(ELEVATION)}
    file, azimuth, lowest = _read(opened, columns)
    turn = azimuth[-1] - azimuth[0]
    if not _LEAST_DEG <= turn <= _TURN_DEG:
        allowed = f"the last row {_LEAST_DEG:g} to {_TURN_DEG:g} deg after the first"
        raise file.error(f"azimuth_deg must go around: {allowed}, got {turn:g}", file.lines[-1])
    if turn == _TURN_DEG and lowest[0] != lowest[-1]:
        ends = f"got {lowest[0]:g} and {lowest[-1]:g} at {azimuth[0]:g} and {azimuth[-1]:g} deg"
        raise file.error(f"must be the same at both ends of a full turn, {ends}", file.lines[-1])
    return azimuth * DEG, lowest * DEG


def _read(
    opened: TextFile, columns: Mapping[str, NumberColumn]
) -> tuple[TableFile, FloatArray, FloatArray]:
    """Return the file, and the numbers (n,) of its two columns, of which the first ascends."""
    file = TableFile(opened)
    file.require_known(columns, " and ".join(columns))
    file.require([*columns], " and ".join(columns))
    rows = file.numbers(columns)
    angle, value = (rows[:, file.names.index(name)] for name in columns)
    if len(rows) < 2:
        raise file.error("needs two rows or more")
    for row in np.flatnonzero(np.diff(angle) <= 0)[:1].tolist():
        name, ends = next(iter(columns)), f"{angle[row + 1]:g} after {angle[row]:g}"
        raise file.error(f"{name} must ascend from row to row, got {ends}", file.lines[row + 1])
    return file, angle, value
