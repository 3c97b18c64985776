"""Tables in CSV, as programs and spreadsheets write them.

The first line names the columns and decides the delimiter: commas, or semicolons. Empty rows, empty
cells to the right of the named columns, and text after a `#` are ignored. A cell may stand in
double quotes. All numbers are finite and have ASCII digits.

Numbers between semicolons may have decimal commas. Then all numbers of the file have decimal
commas, because 1.234 could be one thousand. State vectors of ADS-B, which programs write, have
decimal points only.
"""

from __future__ import annotations

import csv
import math
import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from radar_sense.errors import InputError, describe, did_you_mean
from radar_sense.limits import Limit
from radar_sense.scenario_file.text_file import MAX_LETTERS, NUMBER, FileError, TextFile, number
from radar_sense.states import FloatArray

#: Most rows.
MAX_ROWS = 1_000_000


@dataclass(frozen=True)
class NumberColumn:
    """The numbers that a column may hold, and its unit in SI."""

    limit: Limit
    unit: float = 1.0


class TableFile:
    """An open CSV file.

    Attributes:
        source: Name of the file in errors.
        line: Line of the names of the columns.
        names: Names of the columns; none in an empty file.
        lines: Line of each row that `numbers` has read.
    """

    lines: NDArray[np.int64]

    def __init__(self, file: TextFile) -> None:
        self._file, self.source = file, file.source
        texts = self._texts()
        lines = enumerate(texts, start=1)
        self.line, head = next((pair for pair in lines if pair[1].strip(',"; ')), (1, ""))
        self._delimiter = ";" if ";" in re.sub('"[^"]*"', "", head) else ","
        self._cells = csv.reader(
            chain([head], texts), delimiter=self._delimiter, skipinitialspace=True, strict=True
        )
        _, names = next(self._rows(1), (0, []))
        self.names = tuple(names)

    def error(
        self, message: str, line: int | None = None, kind: type[InputError] = InputError
    ) -> InputError:
        """Return the error to raise about a line, or about the names of the columns."""
        return kind(f"{self.source}:{line or self.line}: {message}")

    def require_known(self, columns: Mapping[str, NumberColumn], allowed: str) -> None:
        """Raise InputError unless the file has some of these columns, and no others.

        A file without any column of the format may be a confidential file. Its text is not
        repeated. `allowed` has the columns in words.
        """
        if not self.names:
            raise InputError(
                f"{self.source}: is empty; the first line must name the columns: {allowed}"
            )
        for i, name in enumerate(self.names):
            if name in self.names[:i]:
                raise self.error(f"duplicate column {describe(name)}")
            if name in columns:
                continue
            suggestion = did_you_mean(name[:MAX_LETTERS], set(columns) - set(self.names))
            words = re.split("[,;\t]", ",".join(self.names))
            shown = suggestion or any(word.strip() in columns for word in words)
            raise self.error(
                (f"unknown column {describe(name)}" if shown else "names none of the columns")
                + f", allowed: {allowed}{suggestion}"
                + ("; columns are separated by commas or semicolons" if "\t" in name else "")
                + ("; the first line must name the columns" if NUMBER.fullmatch(name) else ""),
                kind=InputError if shown else FileError,
            )

    def require(self, names: Sequence[str], required: str) -> None:
        """Raise InputError unless the file has these columns, which are required in words."""
        for name in names:
            if name not in self.names:
                raise self.error(f"missing column '{name}', required are {required}")

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Yield line and cells of each row below the names, a cell for each column.

        Raises:
            InputError: If a row has too few or too many cells, or is not valid CSV.
        """
        count = len(self.names)
        for line, cells in self._rows(count):
            if len(cells) != count:
                hint = "; a decimal comma needs semicolons between the cells"
                raise self.error(
                    f"must have {count} values, one for each column, got {len(cells)}"
                    + (hint if self._delimiter == "," and len(cells) > count else ""),
                    line,
                )
            yield line, cells

    def number(self, cell: str, limit: Limit, name: str, line: int) -> float:
        """Return the number in a cell of a column, or raise InputError."""
        return number(cell, limit, f"{self.source}:{line}: {name}")

    def require_room(self, count: int, line: int) -> None:
        """Raise InputError if a row follows as many rows as a file may have."""
        if count == MAX_ROWS:
            raise self.error(f"has more than {MAX_ROWS:,} rows", line)

    def numbers(self, columns: Mapping[str, NumberColumn]) -> FloatArray:
        """Return the numbers (rows, columns) in the units of the file.

        Raises:
            InputError: As `rows`, or if there are no rows or too many, or if a cell is no number
                that its column allows.
        """
        limits = [columns[name].limit for name in self.names]
        values, lines, mark = array("d"), array("q"), ""
        for line, cells in self.rows():
            self.require_room(len(lines), line)
            if self._delimiter == ";":
                mark = self._decimal_mark(line, cells, mark)
                cells = [cell.replace(",", ".") for cell in cells]
            values.extend(self._row(line, cells, limits))
            lines.append(line)
        if not lines:
            raise InputError(f"{self.source}: has no rows below the names of its columns")
        rows = np.frombuffer(values).reshape(len(lines), len(limits))
        low, high = ([getattr(limit, end) for limit in limits] for end in ("at_least", "at_most"))
        for row, column in np.argwhere(~((rows >= low) & (rows <= high)))[:1]:
            cell = repr(float(rows[row, column])).removesuffix(".0")
            self.number(cell, limits[column], self.names[column], lines[row])
        self.lines = np.frombuffer(lines, dtype=np.int64)
        return rows

    def _rows(self, count: int) -> Iterator[tuple[int, list[str]]]:
        """Yield line and cells of each row that is not empty, without empty cells after `count`."""
        try:
            for row in self._cells:
                cells = [cell.strip() for cell in row]
                while len(cells) > count and not cells[-1]:
                    cells.pop()
                if any(cells):
                    yield self.line + self._cells.line_num - 1, cells
        except csv.Error as error:
            line = self.line + self._cells.line_num - 1
            reason = str(error).partition(" - ")[0]
            raise self.error(f"is not valid CSV: {reason}", line) from error

    def _texts(self) -> Iterator[str]:
        """Yield the lines without comments."""
        for line, text in enumerate(self._file.lines(), start=1):
            text = text.partition("#")[0].strip()
            if "\0" in text:  # only some versions of Python refuse it
                raise self.error("is not text: it has a zero byte", line)
            if text.count('"') % 2:
                raise self.error("is not valid CSV: a quote does not end on its line", line)
            yield text

    def _row(self, line: int, cells: list[str], limits: list[Limit]) -> list[float]:
        """Return the numbers of a row, which may still be outside the limits."""
        text = "".join(cells)
        # `float` takes other digits and 1_000 too.
        if text.isascii() and "_" not in text and len(max(cells, key=len)) <= MAX_LETTERS:
            with suppress(ValueError):
                row = [float(cell) for cell in cells]
                if math.isfinite(sum(row)):
                    return row
        # One by one, to name the wrong cell.
        of_columns = zip(cells, limits, self.names, strict=True)
        return [self.number(cell, limit, name, line) for cell, limit, name in of_columns]

    def _decimal_mark(self, line: int, cells: list[str], mark: str) -> str:
        """Return the decimal mark of the file up to a row, given that up to the row before."""
        for name, cell in zip(self.names, cells, strict=True):
            for other in ".,":
                if other in cell and other != (mark := mark or other):
                    before, here = ("comma", "point") if mark == "," else ("point", "comma")
                    raise self.error(
                        f"{name}: must have no decimal {here}, because numbers before have a "
                        f"decimal {before}, got {describe(cell)}",
                        line,
                    )
        return mark
