"""Tables of numbers in CSV, for routes and RCS tables, as programs and spreadsheets write them.

The first line names the columns. Empty lines, and text after a `#`, are ignored. A cell may stand
in double quotes. All numbers are finite and have ASCII digits.

The first line also decides the delimiter: commas, or semicolons. Numbers between semicolons may
have decimal commas. Then all numbers of the file have decimal commas, because 1.234 could be one
thousand. Numbers between commas have decimal points. Empty cells to the right of the named columns
and rows of empty cells are ignored.

A file is read once, some megabytes at a time. Only the numbers of all blocks stay in memory.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radar_sense.errors import InputError, did_you_mean, shorten
from radar_sense.limits import Limit
from radar_sense.reading.text_file import (
    NOT_FINITE,
    NUMBER,
    FileError,
    TextFile,
    decoded,
    open_text,
)
from radar_sense.states import FloatArray

#: Bytes of a file that are read at a time.
READ_BYTES = 2**22
_MAX_LINE_BYTES = 2**16
_PLAIN_BYTES = b"0123456789+-.eE, \t\n"
#: A row of these bytes has empty cells only.
_EMPTY_CELLS = b',;" \t\r\n\f\v'
#: From semicolons and decimal commas to commas and decimal points.
_TO_COMMAS = bytes.maketrans(b",;", b".,")
_SEMICOLONS = "a decimal comma needs semicolons between the cells"


@dataclass(frozen=True)
class Column:
    """The numbers that a column may hold, and its unit in SI."""

    limit: Limit
    unit: float = 1.0


@dataclass(frozen=True)
class Format:
    """A kind of CSV file.

    Attributes:
        kind: Kind of file, for errors.
        columns: Allowed columns by name.
        allowed: The columns in words.
        max_bytes: Largest file.
        max_rows: Most rows.
    """

    kind: str
    columns: Mapping[str, Column]
    allowed: str
    max_bytes: int
    max_rows: int


@dataclass(frozen=True)
class Header:
    """The names of the columns, with file, line and delimiter."""

    source: str
    line: int
    names: tuple[str, ...]
    delimiter: str = ","

    def error(self, message: str) -> InputError:
        """Return the error to raise about the names of the columns."""
        return InputError(f"{self.source}:{self.line}: {message}")


@dataclass(frozen=True, eq=False)
class Block:
    """Whole lines of a file without comments, and the numbers in them.

    Attributes:
        header: The columns.
        first_line: Number of the first line.
        content: The lines.
        rows: Numbers (rows, columns), in the units of the file.
    """

    header: Header
    first_line: int
    content: bytes
    rows: FloatArray

    def lines(self) -> Iterator[tuple[int, str]]:
        """Return the lines that are not empty, with their numbers."""
        return _lines(self.content, self.first_line)

    def line_numbers(self) -> NDArray[np.intp]:
        """Return the line of each row."""
        return np.array([line for line, _ in self.lines()], dtype=np.intp)

    def error(self, row: int, message: str) -> InputError:
        """Return the error to raise about a row."""
        return InputError(f"{self.header.source}:{self.line_numbers()[row]}: {message}")


@dataclass(frozen=True, eq=False)
class Table:
    """All numbers of a file, in the units of the file.

    Attributes:
        header: The columns.
        blocks: Numbers (rows, columns), block after block.
        sha256: Digest of the bytes that the numbers were read from.
    """

    header: Header
    blocks: list[FloatArray]
    sha256: str


def read_csv(
    path: str | Path,
    layout: Format,
    *,
    check_header: Callable[[Header], None],
    check_block: Callable[[Block], None],
    sha256: str | None = None,
) -> Table:
    """Read and check a CSV file.

    Args:
        path: The file.
        layout: Its format.
        check_header: Called with the columns, and raises InputError if some are missing.
        check_block: Called with each block of rows in turn.
        sha256: Digest that the file must have; None allows any.

    Raises:
        InputError: If the file cannot be read or anything in the file is not allowed.
    """
    with open_text(path, layout.kind, layout.max_bytes) as file:
        with _digest_first(file, sha256):
            header, blocks = _read(file, layout, check_header, check_block)
        return Table(header, blocks, file.sha256(sha256))


def read_rows(
    path: str | Path,
    kind: str,
    max_bytes: int,
    *,
    check_header: Callable[[Header], None],
    take: Callable[[Header, int, list[str]], None],
    sha256: str | None = None,
) -> str:
    """Read a CSV file with text in its cells, and return the SHA-256 of its bytes.

    Args:
        path: The file.
        kind: Kind of file, for errors.
        max_bytes: Largest file.
        check_header: Called with the columns.
        take: Called with the columns, the line and the cells of each row.
        sha256: Digest that the file must have; None allows any.

    Raises:
        InputError: If the file cannot be read, or `check_header` or `take` raises it.
    """
    with open_text(path, kind, max_bytes) as file:
        with _digest_first(file, sha256):
            for block in _blocks(file, _names, check_header):
                for line, text in block.lines():
                    take(block.header, line, _row(block, line, text))
        return file.sha256(sha256)


@contextmanager
def _digest_first(file: TextFile, sha256: str | None) -> Iterator[None]:
    """Check the digest before an error in the content: a wrong digest explains all other errors."""
    try:
        yield
    except FileError:
        raise
    except InputError:
        file.sha256(sha256)
        raise


def _read(
    file: TextFile,
    layout: Format,
    check_header: Callable[[Header], None],
    check_block: Callable[[Block], None],
) -> tuple[Header, list[FloatArray]]:
    header: Header | None = None
    blocks: list[FloatArray] = []
    count, mark = 0, ""
    for lines in _blocks(file, partial(_header, layout=layout), check_header):
        header = lines.header
        block = replace(lines, rows=_numbers(lines, layout))
        if not len(block.rows):
            continue
        mark = _decimal_mark(block, mark)
        _check_limits(block, layout)
        if count + len(block.rows) > layout.max_rows:
            raise block.error(layout.max_rows - count, f"has more than {layout.max_rows:,} rows")
        count += len(block.rows)
        check_block(block)
        blocks.append(block.rows)
    if header is None:
        raise InputError(
            f"{file.source}: is empty; the first line must name the columns: {layout.allowed}"
        )
    if not blocks:
        raise InputError(f"{file.source}: has no rows below the names of its columns")
    return header, blocks


def _blocks(
    file: TextFile,
    read_header: Callable[[bytes, int, str], Header | None],
    check_header: Callable[[Header], None],
) -> Iterator[Block]:
    """Yield the lines below the names of the columns, without numbers."""
    header: Header | None = None
    for first_line, content in _pieces(file):
        content = _without_comments(content, file.source, first_line)
        if header is None:
            header = read_header(content, first_line, file.source)
            if header is None:
                continue
            check_header(header)
            content, first_line = _below(content, first_line, header.line)
        yield Block(header, first_line, content, np.empty((0, len(header.names))))


def _pieces(file: TextFile) -> Iterator[tuple[int, bytes]]:
    """Return whole lines, some megabytes at a time, with the number of the first."""
    line, rest = 1, b""
    while data := file.read(READ_BYTES):
        data = rest + data
        if line == 1:
            data = data.removeprefix(b"\xef\xbb\xbf")  # a byte order mark
        cut = data.rfind(b"\n") + 1
        data, rest = data[:cut], data[cut:]
        if data:
            yield line, data
            line += data.count(b"\n")
        if len(rest) > _MAX_LINE_BYTES:
            raise InputError(f"{file.source}:{line}: is longer than {_MAX_LINE_BYTES} bytes")
    if rest:
        yield line, rest


def _without_comments(content: bytes, source: str, first_line: int) -> bytes:
    if not content.isascii():
        decoded(content, source, first_line)
    content = content.replace(b"\r\n", b"\n")
    return re.sub(rb"#[^\n]*", b"", content) if b"#" in content else content


def _lines(content: bytes, first_line: int) -> Iterator[tuple[int, str]]:
    for line, text in enumerate(content.split(b"\n"), start=first_line):
        if text.strip(_EMPTY_CELLS):
            yield line, text.decode("utf-8").strip()


def _below(content: bytes, first_line: int, line: int) -> tuple[bytes, int]:
    """Return the text below a line, and the number of its first line."""
    above = line + 1 - first_line
    pieces = content.split(b"\n", above)
    return b"".join(pieces[above:]), line + 1


def _cells(text: str, source: str, line: int, delimiter: str, count: int) -> list[str]:
    """Return the cells of a line, without the empty cells to the right of `count` cells."""
    if '"' not in text:
        cells = text.split(delimiter)
    else:
        try:
            (cells,) = csv.reader([text], delimiter=delimiter, skipinitialspace=True, strict=True)
        except csv.Error as error:
            raise InputError(f"{source}:{line}: is not valid CSV: {error}") from error
    cells = [cell.strip() for cell in cells]
    while len(cells) > count and not cells[-1]:
        cells.pop()
    return cells


def _row(block: Block, line: int, text: str) -> list[str]:
    """Return the cells of a row, one for each column."""
    header = block.header
    names = header.names
    cells = _cells(text, header.source, line, header.delimiter, len(names))
    if len(cells) != len(names):
        decimal_comma = header.delimiter == "," and len(cells) > len(names)
        raise InputError(
            f"{header.source}:{line}: must have {len(names)} values, one for each column, "
            f"got {len(cells)}" + (f"; {_SEMICOLONS}" if decimal_comma else "")
        )
    return cells


def _header(content: bytes, first_line: int, source: str, layout: Format) -> Header | None:
    """Return the columns that the first line names, or None if all lines are empty."""
    header = _names(content, first_line, source)
    if header is None:
        return None
    for i, name in enumerate(header.names):
        if name not in layout.columns:
            raise _unknown_column(header, name, layout)
        if name in header.names[:i]:
            raise header.error(f"duplicate column '{name}'")
    return header


def _names(content: bytes, first_line: int, source: str) -> Header | None:
    """Return the words of the first line, or None if all lines are empty."""
    line, text = next(_lines(content, first_line), (0, ""))
    if not line:
        return None
    delimiter = ";" if ";" in re.sub('"[^"]*"', "", text) else ","
    return Header(source, line, tuple(_cells(text, source, line, delimiter, 1)), delimiter)


def _unknown_column(header: Header, name: str, layout: Format) -> InputError:
    """Return the error for a column that is not allowed.

    A file without any column of the format may be a confidential file. Its text is not repeated.
    """
    suggestion = did_you_mean(name[:100], set(layout.columns) - set(header.names))
    separated = re.split("[,;\t]", ",".join(header.names))
    has_names = suggestion or any(part.strip().strip('"') in layout.columns for part in separated)
    return header.error(
        (f"unknown column {shorten(name)}" if has_names else "names none of the columns")
        + f", allowed: {layout.allowed}"
        + suggestion
        + ("; columns are separated by commas or semicolons" if "\t" in name else "")
        + ("; the first line must name the columns" if NUMBER.fullmatch(header.names[0]) else "")
    )


def _numbers(block: Block, layout: Format) -> FloatArray:
    """Return all numbers of a block (rows, columns).

    NumPy reads all at once. Where NumPy fails, cells are read one by one, to name the wrong cell.
    """
    header = block.header
    names = header.names
    semicolons = header.delimiter == ";"
    content = block.content.translate(_TO_COMMAS) if semicolons else block.content
    # NumPy accepts other texts as numbers too. It only gets plain numbers.
    if content.strip(_EMPTY_CELLS) and not content.translate(None, delete=_PLAIN_BYTES):
        lines = [text.rstrip(", \t") for text in content.decode("ascii").split("\n")]
        try:
            rows = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)
        except ValueError:
            rows = np.empty((0, 0))
        if rows.shape[-1] == len(names):
            return rows
    numbers = []
    for line, text in block.lines():
        row = []
        for name, cell in zip(names, _row(block, line, text), strict=True):
            number = cell.replace(",", ".") if semicolons else cell
            if NOT_FINITE.fullmatch(number):
                raise InputError(f"{header.source}:{line}: {name}: must be finite, got {cell}")
            if not NUMBER.fullmatch(number):
                raise _wrong(block, line, name, cell, layout)
            row.append(float(number))
        numbers.append(row)
    return np.array(numbers, dtype=float).reshape(-1, len(names))


def _decimal_mark(block: Block, mark: str) -> str:
    """Return the decimal mark of a file with semicolons, or "" before the first.

    Args:
        block: The rows.
        mark: The decimal mark of the rows before.

    Raises:
        InputError: If the file has decimal commas and decimal points. One of the two could
            separate thousands.
    """
    if block.header.delimiter != ";":
        return ""
    present = [other for other in ".," if other.encode() in block.content]
    if len({mark, *present} - {""}) < 2:
        return mark or "".join(present)
    for line, text in block.lines():
        for name, cell in zip(block.header.names, _row(block, line, text), strict=True):
            for other in ".,":
                if other in cell and other != (mark := mark or other):
                    before, here = ("comma", "point") if mark == "," else ("point", "comma")
                    raise InputError(
                        f"{block.header.source}:{line}: {name}: must have no decimal {here}, "
                        f"because numbers before have a decimal {before}, got {cell}"
                    )
    return mark


def _check_limits(block: Block, layout: Format) -> None:
    names, rows = block.header.names, block.rows
    limits = [layout.columns[name].limit for name in names]
    low, high = (
        np.array([getattr(limit, end) for limit in limits]) for end in ("at_least", "at_most")
    )
    if not (np.all(rows.min(axis=0) >= low) and np.all(rows.max(axis=0) <= high)):
        row, column = np.argwhere((rows < low) | (rows > high))[0]
        line, text = next(pair for i, pair in enumerate(block.lines()) if i == row)
        raise _wrong(block, line, names[column], _row(block, line, text)[column], layout)


def _wrong(block: Block, line: int, name: str, cell: str, layout: Format) -> InputError:
    plain = NUMBER.fullmatch(cell) and len(cell) <= 40
    got = "nothing" if not cell else cell if plain else shorten(cell)
    decimal_comma = "," in cell and block.header.delimiter == ","
    return InputError(
        f"{block.header.source}:{line}: {name}: must be {layout.columns[name].limit}, got {got}"
        + (f"; {_SEMICOLONS}" if decimal_comma else "")
    )
