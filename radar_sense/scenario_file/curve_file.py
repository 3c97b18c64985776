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
from radar_sense.scenario_file.table_file import Column, TableFile
from radar_sense.scenario_file.text_file import TextFile
from radar_sense.states import FloatArray

#: Columns of the two files, the angle first, with the units of SI.
GAIN_COLUMNS = {"elevation_deg": Column(ELEVATION, DEG), "gain_db": Column(GAIN_DB)}
MASK_COLUMNS = {"azimuth_deg": Column(AZIMUTH, DEG), "elevation_deg": Column(ELEVATION, DEG)}
#: A turn, and the least part of it that a mask has: the rest is a straight line.
_TURN_DEG, _LEAST_DEG = 360.0, 240.0


def read_curve(opened: TextFile, columns: Mapping[str, Column]) -> tuple[FloatArray, FloatArray]:
    """Return angles (n,) and values (n,) of an open file, in SI or decibels.

    The columns are `GAIN_COLUMNS` or `MASK_COLUMNS`.
    """
    file = TableFile(opened)
    file.require_known(columns, " and ".join(columns))
    file.require([*columns], " and ".join(columns))
    rows = file.numbers(columns)
    angle, value = (rows[:, file.names.index(name)] for name in columns)
    name = next(iter(columns))
    if len(rows) < 2:
        raise file.error("needs two rows or more")
    for row in np.flatnonzero(np.diff(angle) <= 0)[:1].tolist():
        ends = f"{angle[row + 1]:g} after {angle[row]:g}"
        raise file.error(f"{name} must ascend from row to row, got {ends}", file.lines[row + 1])
    turn = angle[-1] - angle[0]
    if name == "azimuth_deg" and not _LEAST_DEG <= turn <= _TURN_DEG:
        allowed = f"the last row {_LEAST_DEG:g} to {_TURN_DEG:g} deg after the first"
        raise file.error(f"{name} must go around: {allowed}, got {turn:g}", file.lines[-1])
    if name == "azimuth_deg" and turn == _TURN_DEG and value[0] != value[-1]:
        ends = f"got {value[0]:g} and {value[-1]:g} at {angle[0]:g} and {angle[-1]:g} deg"
        raise file.error(f"must be the same at both ends of a full turn, {ends}", file.lines[-1])
    units = [column.unit for column in columns.values()]
    return angle * units[0], value * units[1]
