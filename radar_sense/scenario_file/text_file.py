"""Regular files of UTF-8 text, read once, and the numbers in them."""

from __future__ import annotations

import hashlib
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from radar_sense.errors import InputError, describe, did_you_mean, reason
from radar_sense.limits import Limit

#: Largest file of data. A million rows of 28 numbers with 17 digits each are 0.7 GB.
MAX_BYTES = 2**30
#: Longest line [bytes]. The longest line that a program writes has 28 numbers, under 1 KiB.
MAX_LINE = 2**16
#: Most letters of a number: more than five times the digits of a float.
MAX_LETTERS = 100
#: A number, with ASCII digits. Python's `float` also takes 1_000, ١٢ and infinity. The time is
#: linear in the length of the text, because no text of digits matches in two ways.
NUMBER = re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?", re.ASCII)
NOT_FINITE = re.compile(r"[-+]?\.?(inf|infinity|nan)", re.IGNORECASE)
_CLOCK = re.compile(r"([0-9]{1,4}):([0-5]?[0-9]):([0-5]?[0-9](?:\.[0-9]*)?)", re.ASCII)
_DATE_TIME = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}[T ][0-9]{2}:", re.ASCII)
_THOUSANDS = re.compile(r"[-+]?[1-9][0-9]{0,2},[0-9]{3}", re.ASCII)
_UNITS = "m|km|ft|m/s|km/h|kt|s|ms|min|h|deg|°|m2|m²|db|dbsm|w|kw|mw|hz|khz|mhz|ghz|k"
_WITH_UNIT = re.compile(rf"{NUMBER.pattern}\s*({_UNITS})", re.IGNORECASE)


class FileError(InputError):
    """A file cannot be read, or is of another kind."""


class TextFile:
    """An open file that is read once: its digest belongs to the bytes that were used.

    Attributes:
        source: Name of the file in errors.
        most_bytes: Largest size accepted.
    """

    def __init__(self, file: BinaryIO, source: str, most_bytes: int) -> None:
        self.source, self.most_bytes = source, most_bytes
        self._file, self._digest, self._size = file, hashlib.sha256(), 0

    def read(self, size: int) -> bytes:
        """Return the next bytes, or nothing at the end of the file.

        Raises:
            FileError: If the file is too large.
        """
        return self._counted(self._file.read(size))

    def lines(self) -> Iterator[str]:
        """Yield the lines, without a byte order mark.

        Raises:
            InputError: If the file is too large, or a line is too long or not UTF-8 text.
        """
        line = 0
        while data := self._counted(self._file.readline(MAX_LINE + 1)):
            line += 1
            if len(data) > MAX_LINE:
                raise InputError(f"{self.source}:{line}: is longer than {MAX_LINE} bytes")
            text = decoded(data, self.source, line)
            yield text.removeprefix("\ufeff") if line == 1 else text

    def sha256(self) -> str:
        """Read to the end of the file and return its SHA-256."""
        while self.read(2**20):
            pass
        return self._digest.hexdigest()

    def _counted(self, data: bytes) -> bytes:
        self._digest.update(data)
        self._size += len(data)
        if self._size > self.most_bytes:
            raise FileError(f"{self.source}: is larger than {_in_words(self.most_bytes)}")
        return data


@contextmanager
def open_text(path: str | Path, kind: str, most_bytes: int | None = None) -> Iterator[TextFile]:
    """Open a regular file, of `MAX_BYTES` at most. Its kind is what it should be, for errors.

    Raises:
        InputError: If the path is not text or a `Path`, or if the file cannot be read, or is a
            folder, a pipe or a device. A pipe may block without end, and a device has no end.
    """
    if not isinstance(path, str | Path):  # `open` takes a number as an open file
        raise InputError(f"path must be text or a Path, got {describe(path)}")
    try:
        with open(path, "rb", opener=_without_blocking) as binary:
            if not stat.S_ISREG(os.fstat(binary.fileno()).st_mode):
                raise FileError(f"{path}: is not a regular file, {kind} must be one")
            yield TextFile(binary, str(path), most_bytes or MAX_BYTES)
    except IsADirectoryError as error:
        raise FileError(f"{path}: is a directory, not {kind}") from error
    except InputError:
        raise
    except FileNotFoundError as error:
        near = ""
        with suppress(OSError):  # there may be no such folder, or it may not be listed
            near = did_you_mean(Path(path).name, [p.name for p in Path(path).parent.iterdir()])
        raise FileError(f"{path}: cannot be read: {reason(error)}{near}") from error
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte
        raise FileError(f"{path}: cannot be read: {reason(error)}") from error


def read_text(path: str | Path, kind: str, most_bytes: int) -> str:
    """Return the text of a file without a byte order mark, with the errors of `open_text`."""
    with open_text(path, kind, most_bytes) as file:
        return decoded(file.read(most_bytes + 1), file.source).removeprefix("\ufeff")


def decoded(data: bytes, source: str, first_line: int = 1) -> str:
    """Return UTF-8 text, or raise InputError with the line that is something else."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = first_line + data[: error.start].count(b"\n")
        raise InputError(
            f"{source}:{line}: is not UTF-8 text: byte 0x{data[error.start]:02x}"
        ) from error


def number(text: str, limit: Limit, place: str) -> float:
    """Return the number that a text is.

    Raises:
        InputError: If the text is too long, no number, or outside the limit. It says where, what
            is allowed, and what to write for a number written in another way.
    """
    text = text.strip()
    if len(text) > MAX_LETTERS:
        raise InputError(f"{place}: must be {limit}, got more than {MAX_LETTERS} letters")
    plain = NUMBER.fullmatch(text)
    if plain and limit.allows(float(text)):
        return float(text)
    if NOT_FINITE.fullmatch(text):
        raise InputError(f"{place}: must be finite, got {text}")
    got = "nothing" if not text else text if plain and len(text) <= 40 else describe(text)
    raise InputError(f"{place}: must be {limit}, got {got}{advice(text, limit)}")


def advice(text: str, limit: Limit) -> str:
    """Return how to write a number within a limit that is written in another way, or ""."""
    if len(text) > MAX_LETTERS:
        return ""
    if clock := _CLOCK.fullmatch(text):
        hours, minutes, seconds = clock.groups()
        total = 3600 * int(hours) + 60 * int(minutes) + float(seconds)
        return f"; write seconds, {total:.15g} for {text}"
    if _DATE_TIME.match(text):
        return "; write seconds, from any start"
    if text.endswith("%") and NUMBER.fullmatch(text[:-1].strip()):
        # a percentage of a quantity with a unit is no share
        is_share = 1 in (limit.at_most, limit.below)
        share = f"{float(text[:-1]) / 100:.15g} for {text}"
        return f"; write {share}" if is_share else "; write the quantity itself, without %"
    if text.count(",") == 1 and NUMBER.fullmatch(text.replace(",", ".")):
        # three digits after it, and a comma is as likely between thousands
        thousands = f"{text.replace(',', '')}" if _THOUSANDS.fullmatch(text) else ""
        with_point = "" if thousands and limit.whole else text.replace(",", ".")
        return f"; write {' or '.join(filter(None, (thousands, with_point)))} for {text}"
    if _WITH_UNIT.fullmatch(text):
        return "; leave out the unit, it is in the name"
    return ""


def _in_words(size: int) -> str:
    return f"{size // 2**20} MiB" if size >= 2**20 else f"{size // 2**10} KiB"


def _without_blocking(path: str, flags: int) -> int:
    # Without O_NONBLOCK, opening a pipe blocks until another process opens the pipe to write.
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
