"""Regular files of UTF-8 text, and the numbers in them."""

from __future__ import annotations

import hashlib
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from radar_sense.errors import InputError, describe

#: A number, with ASCII digits. Python's `float` also takes 1_000, ١٢ and infinity.
NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?", re.ASCII)
NOT_FINITE = re.compile(r"[-+]?\.?(inf|infinity|nan)", re.IGNORECASE)


class FileError(InputError):
    """A file cannot be read."""


class DigestError(InputError):
    """A file differs from the recorded file."""


class TextFile:
    """An open file that is read once: its digest belongs to the bytes that were used.

    Attributes:
        source: Name of the file in errors.
        allowed_bytes: Largest size accepted.
    """

    def __init__(self, file: BinaryIO, source: str, allowed_bytes: int) -> None:
        self.source, self.allowed_bytes = source, allowed_bytes
        self._file, self._digest, self._size = file, hashlib.sha256(), 0

    def read(self, size: int) -> bytes:
        """Return the next bytes, or nothing at the end of the file.

        Raises:
            InputError: If the file is too large.
        """
        data = self._file.read(size)
        self._digest.update(data)
        self._size += len(data)
        if self._size > self.allowed_bytes:
            raise FileError(f"{self.source}: is larger than {size_in_words(self.allowed_bytes)}")
        return data

    def sha256(self, expected: str | None = None) -> str:
        """Read to the end of the file and return its SHA-256.

        Raises:
            DigestError: If another digest is expected.
        """
        while self.read(2**20):
            pass
        digest = self._digest.hexdigest()
        if expected not in (None, digest):
            raise DigestError(f"{self.source} is another file than it was: it has {digest}")
        return digest


def check_path(path: object) -> None:
    """Raise InputError unless a path is text or a `Path`. `open` takes a number as an open file."""
    if not isinstance(path, str | Path):
        raise InputError(f"path must be text or a Path, got {describe(path)}")


@contextmanager
def open_text(path: str | Path, kind: str, allowed_bytes: int) -> Iterator[TextFile]:
    """Open a regular file.

    Args:
        path: The file.
        kind: What the file should be, for errors.
        allowed_bytes: Largest size accepted.

    Raises:
        InputError: If the file cannot be read, or is a folder, a pipe or a device. A pipe may block
            without end, and a device has no end.
    """
    check_path(path)
    try:
        with open(path, "rb", opener=_without_blocking) as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise FileError(f"{path}: is not a regular file, {kind} must be one")
            yield TextFile(file, str(path), allowed_bytes)
    except IsADirectoryError as error:
        raise FileError(f"{path}: is a directory, not {kind}") from error
    except InputError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a name with a zero byte
        reason = getattr(error, "strerror", None) or error
        raise FileError(f"{path}: cannot be read: {reason}") from error


def decoded(data: bytes, source: str, first_line: int = 1) -> str:
    """Return UTF-8 text.

    Raises:
        InputError: If the data are something else, with the line.
    """
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = first_line + data[: error.start].count(b"\n")
        raise InputError(
            f"{source}:{line}: is not UTF-8 text: byte 0x{data[error.start]:02x}"
        ) from error


def recorded(path: Path) -> str:
    """Return the name of a file for a record: relative to the working folder if it is inside.

    The record then names no folder of the machine.
    """
    absolute, here = path.absolute(), Path.cwd()
    return (absolute.relative_to(here) if absolute.is_relative_to(here) else absolute).as_posix()


def size_in_words(size: int) -> str:
    """Return a number of bytes in KiB or MiB."""
    return f"{size // 2**20} MiB" if size >= 2**20 else f"{size // 2**10} KiB"


def _without_blocking(path: str, flags: int) -> int:
    # Without O_NONBLOCK, opening a pipe blocks until another process opens the pipe to write.
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
