"""From a result to files: the table as CSV or NPZ, the record as JSON, and each file whole.

All files are written beside their places and then renamed. The record is the last, and has the
digests of the other files: a table or a figure with another digest is of another run.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import math
import os
import platform
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radar_sense import __version__

if TYPE_CHECKING:  # `init` writes files without NumPy
    from radar_sense.states import FloatArray

_PACKAGES = ("numpy", "scipy", "click", "matplotlib", "pyyaml")
#: Rows of a CSV file that are turned into text at a time, which bounds the memory.
_ROWS = 16_384
#: Bytes that must fit on the disk before anything is computed.
_ROOM = 65_536


def table(columns: Mapping[str, FloatArray]) -> tuple[str, bytes]:
    """Return ending and content of the file of a table: CSV, or NPZ for a table with planes."""
    import numpy as np

    if any(column.ndim > 1 for column in columns.values()):
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **dict[str, Any](columns))
        return "npz", buffer.getvalue()
    return "csv", csv(columns)


def csv(columns: Mapping[str, FloatArray]) -> bytes:
    """Return header and numbers, with the digits that identify each float."""
    content = io.BytesIO()
    content.write(",".join(columns).encode() + b"\n")
    longest = max((len(column) for column in columns.values()), default=0)
    for start in range(0, longest, _ROWS):
        part = [list(map(repr, c[start : start + _ROWS].tolist())) for c in columns.values()]
        content.write("".join(f"{','.join(row)}\n" for row in zip(*part, strict=True)).encode())
    return content.getvalue()


def record(content: Mapping[str, Any], files: Mapping[str, bytes]) -> bytes:
    """Return the JSON record of a run, with versions and the SHA-256 digests of its files."""
    digests = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    document = {**content, "versions": versions(), "files": digests}
    text = io.BytesIO()
    # `json.dumps` would keep all pieces until the end: 150 MB for a million poses
    for piece in json.JSONEncoder(indent=2).iterencode(_finite(document)):
        text.write(piece.encode())
    text.write(b"\n")
    return text.getvalue()


def _finite(value: Any) -> Any:
    """Replace NaN and infinity, which JSON does not have, by null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return value


@cache
def versions() -> Mapping[str, str]:
    """Return the versions of the tool, of Python and of the packages, or "unknown"."""
    from importlib.metadata import PackageNotFoundError, version  # which `init` does not need

    found = dict.fromkeys(_PACKAGES, "unknown")
    for package in _PACKAGES:
        with contextlib.suppress(PackageNotFoundError):  # a package without installed metadata
            found[package] = version(package)
    return {"radar-sense": __version__, "python": platform.python_version(), **found}


def yaml_text(document: Mapping[str, Any]) -> str:
    """Return a resolved scenario as the text of a scenario file, with printable letters only."""
    import yaml  # which most commands do not need

    # default_flow_style None writes lists of numbers on one line
    dumped: Any = partial(yaml.safe_dump, document, sort_keys=False, default_flow_style=None)
    text = f"{dumped(allow_unicode=True)}"
    # YAML does not escape marks of direction, which would change what a terminal or a page shows.
    return text if text.replace("\n", "").isprintable() else f"{dumped()}"


def require_writable(paths: Sequence[Path], inputs: Iterable[Path]) -> None:
    """Raise OSError unless files of one folder can be written without overwriting an input.

    `write` makes a missing folder.
    """
    read = set(map(os.path.realpath, inputs))
    for path in paths:
        if path.is_dir():
            raise IsADirectoryError(f"{path} is a folder, and in the way of a file")
        if os.path.realpath(path) in read:
            raise FileExistsError(f"{path} is an input of this run and would be overwritten")
    folder = paths[0].parent.absolute()
    with contextlib.suppress(FileNotFoundError):
        folder.stat()  # raises OSError for an impossible name
    # lexists, because a dangling link prevents a folder too
    existing = next(path for path in (folder, *folder.parents) if os.path.lexists(path))
    with tempfile.TemporaryFile(dir=existing) as file:
        file.write(bytes(_ROOM))


def write(folder: Path, contents: Mapping[str, bytes]) -> list[Path]:
    """Write files by name into a folder, which is made if missing; return their paths.

    The files are renamed in the order given.

    Raises:
        OSError: If a file cannot be written, with its name. No file is incomplete then.
    """
    paths = {name: folder / name for name in contents}
    new = [path for path in (folder, *folder.parents) if not path.exists()]
    at = folder
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # Inside the folder, and so on its disk. Another run at work has one of another name.
        with tempfile.TemporaryDirectory("", ".", folder, ignore_cleanup_errors=True) as beside:
            for name, content in contents.items():
                at = paths[name]
                with Path(beside, name).open("xb") as file:
                    file.write(content)
                    file.flush()
                    os.fsync(file.fileno())
            for name, at in paths.items():
                Path(beside, name).replace(at)
    except OSError as error:  # with the name of the file, and not of the temporary one
        raise OSError(error.errno, error.strerror, str(at)) from error
    finally:
        for path in new:
            with contextlib.suppress(OSError):  # a folder with files stays
                path.rmdir()
    return list(paths.values())
