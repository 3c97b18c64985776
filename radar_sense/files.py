"""From a result to files: CSV, NPZ and JSON as bytes, written all together or not at all.

A run replaces all of its files or none. All new files are complete under temporary names before the
first rename. Ctrl-C and SIGTERM are delayed during the renames, and a failed rename is undone. A
lock on the folder excludes other processes. Table and record are therefore of one run.

SIGKILL can stop a run between two renames. The old record is therefore removed before the first
rename, and the new record is renamed last. Files beside a record are always of one run. Files
without a record may be of two runs. The next run replaces these files and reports the missing
record.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import io
import json
import math
import os
import platform
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from types import FrameType, MappingProxyType
from typing import Any

import numpy as np

from radar_sense import __version__
from radar_sense.states import FloatArray

try:
    import fcntl
except ImportError:  # Windows has no locks on folders
    fcntl = None  # type: ignore[assignment]

_PACKAGES = ("numpy", "scipy", "click", "matplotlib", "pyyaml")
#: Endings of the temporary names: the new content, and the old file until all are renamed.
_NEW, _OLD = ".radar-sense-new", ".radar-sense-old"
#: Rows of a CSV file that are turned into text at a time, which bounds the memory.
_ROWS = 16_384
#: Bytes of a file that are read at a time.
_PART = 1 << 20
#: Bytes that must fit on the disk before anything is computed.
_ROOM = 65_536
#: Options that choose where and how files are written, with the number of their values.
_OUTPUT_OPTIONS = {
    "--out": 1,
    "--format": 1,
    "--workers": 1,
    "--dask": 1,
    "--no-plot": 0,
    "--quiet": 0,
    "-q": 0,
}


class InterruptedAfterWriting(KeyboardInterrupt):
    """Ctrl-C or SIGTERM arrived during the renames; all files are in place."""


def data(table: Mapping[str, FloatArray]) -> tuple[str, bytes]:
    """Return ending and content of the file of a table: CSV, or NPZ for a table with planes."""
    if any(column.ndim > 1 for column in table.values()):
        return "npz", npz(table)
    return "csv", csv(table)


def npz(table: Mapping[str, FloatArray]) -> bytes:
    """Return arrays by name for `numpy.load`; the same arrays give the same bytes."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **dict[str, Any](table))
    return buffer.getvalue()


def csv(table: Mapping[str, FloatArray]) -> bytes:
    """Return header and numbers, with the digits that identify each float."""
    content = io.BytesIO()
    content.write(",".join(table).encode() + b"\n")
    longest = max((len(column) for column in table.values()), default=0)
    for start in range(0, longest, _ROWS):
        part = [list(map(repr, c[start : start + _ROWS].tolist())) for c in table.values()]
        rows = map(",".join, zip(*part, strict=True))
        content.write(("\n".join(rows) + "\n").encode())
    return content.getvalue()


def record(
    *,
    analysis: str,
    command: Sequence[str],
    seed: int,
    scenario: Mapping[str, Any],
    warnings: Sequence[str],
    summary: Mapping[str, Any],
    columns: Mapping[str, Mapping[str, str]],
) -> bytes:
    """Return the JSON record of a result: inputs, warnings, summary and columns."""
    content = {
        "analysis": analysis,
        "command": list(command),
        "versions": versions(),
        "seed": seed,
        "scenario": scenario,
        "warnings": list(warnings),
        "summary": summary,
        "columns": columns,
    }
    text = io.BytesIO()
    # `json.dumps` would keep all pieces until the end: 150 MB for a million poses
    for piece in json.JSONEncoder(indent=2).iterencode(_finite(content)):
        text.write(piece.encode())
    text.write(b"\n")
    return text.getvalue()


def holds(path: Path, content: bytes) -> bool:
    """Return whether a file has this content, reading a part at a time."""
    try:
        with path.open("rb") as file:
            place = 0
            while part := file.read(_PART):
                if content[place : place + len(part)] != part:
                    return False
                place += len(part)
    except OSError:
        return False
    return place == len(content)


def yaml_text(document: Mapping[str, Any]) -> str:
    """Return a resolved scenario as the text of a scenario file."""
    import yaml  # which most commands do not need

    # default_flow_style None writes lists of numbers on one line
    text: str = yaml.safe_dump(
        document, sort_keys=False, default_flow_style=None, allow_unicode=True
    )
    return text


@functools.cache
def versions() -> Mapping[str, str]:
    """Return the versions of the tool, of Python and of the packages that compute and draw."""
    packages = {package: version(package) for package in _PACKAGES}  # 3 ms each
    return MappingProxyType(
        {"radar-sense": __version__, "python": platform.python_version(), **packages}
    )


def same_result(one: bytes, other: bytes) -> bool:
    """Return whether two records have the same result, in any formats and folders."""
    first = _digest_of_result(one)
    return first is not None and first == _digest_of_result(other)


def _digest_of_result(record: bytes) -> bytes | None:
    """Return a digest of the result in a record; None if the content is no record."""
    content = _parsed(record)
    if not content:
        return None
    content.pop("versions", None)
    content.pop("columns", None)
    content["command"] = _computed(content.get("command"))
    digest = hashlib.sha256()
    for piece in json.JSONEncoder(sort_keys=True).iterencode(content):
        digest.update(piece.encode())
    return digest.digest()


def replaced_command(old: bytes, new: bytes) -> str | None:
    """Return the command in an old record; None if the new record has the same command.

    Options of the output make no difference.
    """
    before, level = _command_and_level(old)
    if (before, level) == _command_and_level(new):
        return None
    return " ".join(before) or f"a run from Python at level {level}"


def _command_and_level(record: bytes) -> tuple[list[str], Any]:
    content = _parsed(record)
    return _computed(content.get("command")), _level(content)


def _parsed(content: bytes) -> dict[str, Any]:
    try:
        document = json.loads(content)
    except ValueError:
        return {}
    return document if isinstance(document, dict) else {}


def _level(content: Mapping[str, Any]) -> Any:
    scenario = content.get("scenario")
    analysis = scenario.get("analysis") if isinstance(scenario, Mapping) else None
    return analysis.get("level") if isinstance(analysis, Mapping) else None


def _computed(command: Any) -> list[str]:
    """Return a recorded command line without the options that do not change the numbers."""
    words = iter(map(str, command) if isinstance(command, list) else ())
    kept = []
    for word in words:
        name, _, value = word.partition("=")
        if name not in _OUTPUT_OPTIONS:
            kept.append(word)
        elif _OUTPUT_OPTIONS[name] and not value:
            next(words, None)
    return kept


def require_writable(paths: Sequence[Path], inputs: Iterable[Path] = ()) -> None:
    """Check that files can be written. `write` makes a missing folder.

    Args:
        paths: The files, all in one folder.
        inputs: Files that must not be overwritten.

    Raises:
        OSError: If a file cannot be written, or is an input.
    """
    folder = paths[0].parent.absolute()
    with contextlib.suppress(FileNotFoundError):
        folder.stat()  # raises OSError for an impossible name
    # lexists, because a dangling link prevents a folder too
    existing = next(path for path in (folder, *folder.parents) if os.path.lexists(path))
    with tempfile.TemporaryFile(dir=existing) as file:
        file.write(bytes(_ROOM))
    _require_no_folder(paths)
    read = {path.resolve() for path in inputs}
    for path in paths:
        if path.resolve() in read:
            raise FileExistsError(f"{path} is an input of this run and would be overwritten")


def _require_no_folder(paths: Iterable[Path]) -> None:
    for path in paths:
        if path.is_dir():
            raise IsADirectoryError(f"{path} is a folder, and in the way of a file")


def write(folder: Path, contents: Mapping[str, bytes | None], record: str | None = None) -> None:
    """Write, replace and remove files of a folder: all of them, or none.

    Args:
        folder: The folder; made if missing.
        contents: Content of each file by its name; None removes the file.
        record: The file that is removed first and renamed last. If the file exists, all files are
            of one run, even after a process was killed.

    Raises:
        OSError: If a file cannot be written. The folder is then as before.
        InterruptedAfterWriting: If an interrupt arrived during the renames.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _require_no_folder(folder / name for name in contents)
    with _locked(folder) as alone:
        _remove_temporary(folder, contents, everything=alone)
        try:
            for name, content in contents.items():
                if content is not None:
                    _write_new(_temporary(folder, name, _NEW), content)
            with _interrupts_held():
                _replace_all(folder, contents, record)
        finally:
            _remove_temporary(folder, contents, everything=alone)


def _replace_all(folder: Path, contents: Mapping[str, bytes | None], record: str | None) -> None:
    """Rename the new files to their names; undo all renames if a rename fails."""
    names = [*(name for name in contents if name != record), *([record] if record else [])]
    existing = [name for name in names if os.path.lexists(folder / name)]
    try:
        for name in existing:
            _keep(folder / name, _temporary(folder, name, _OLD))
        if record in existing:
            (folder / record).unlink()
        for name in names:
            if contents[name] is not None:
                _temporary(folder, name, _NEW).replace(folder / name)
            elif name in existing:
                (folder / name).unlink()
    except BaseException:
        for name in names:
            with contextlib.suppress(OSError):
                if name not in existing:
                    (folder / name).unlink()
                elif os.path.lexists(old := _temporary(folder, name, _OLD)):
                    old.replace(folder / name)
        raise


def _keep(path: Path, copy: Path) -> None:
    """Give a file a second name, or copy the file if the file system has no hard links."""
    try:
        os.link(path, copy, follow_symlinks=False)
    except OSError:
        shutil.copy2(path, copy, follow_symlinks=False)


def _temporary(folder: Path, name: str, ending: str) -> Path:
    return folder / f".{name}{ending}"


def _write_new(path: Path, content: bytes) -> None:
    # "x" is O_EXCL, which refuses an existing file or link.
    with path.open("xb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _remove_temporary(folder: Path, names: Iterable[str], *, everything: bool) -> None:
    """Remove the temporary files of some names, or of all killed runs."""
    temporary = {_temporary(folder, name, ending) for name in names for ending in (_NEW, _OLD)}
    if everything:
        leftover = folder.glob(".*.radar-sense-*")
        temporary.update(path for path in leftover if path.name.endswith((_NEW, _OLD)))
    for path in temporary:
        with contextlib.suppress(OSError):
            path.unlink()


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[bool]:
    """Lock a folder against other runs, and yield whether the lock was possible.

    The lock ends with the process, however the process ends.
    """
    with contextlib.ExitStack() as stack:
        locked = False
        if fcntl is not None:
            with contextlib.suppress(OSError):  # some network file systems have no locks
                descriptor = os.open(folder, os.O_RDONLY)
                stack.callback(os.close, descriptor)
                fcntl.flock(descriptor, fcntl.LOCK_EX)
                locked = True
        yield locked


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Delay SIGINT and SIGTERM until the end of the context.

    The signal mask of a thread is not enough, because another thread could receive the signal.

    Raises:
        InterruptedAfterWriting: If a delayed signal raises KeyboardInterrupt.
    """
    held: list[int] = []

    def hold(number: int, frame: FrameType | None) -> None:
        held.append(number)

    handlers = {}
    try:
        # Only the main thread receives signals.
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                if signal.getsignal(number) not in (signal.SIG_IGN, None):
                    handlers[number] = signal.signal(number, hold)
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    for signal_number in held:
        try:
            signal.raise_signal(signal_number)
        except KeyboardInterrupt as error:
            raise InterruptedAfterWriting from error


def _finite(value: Any) -> Any:
    """Replace NaN and infinity, which JSON does not have, by null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return value
