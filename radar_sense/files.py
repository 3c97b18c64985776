"""From a result to files: CSV and JSON as bytes, and writing that is whole or not at all."""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import platform
import tempfile
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from radar_sense import __version__
from radar_sense.states import FloatArray

_PACKAGES = ("numpy", "scipy", "click", "matplotlib", "pyyaml")


def data(table: Mapping[str, FloatArray]) -> tuple[str, bytes]:
    """Return ending and content of the file of a table: CSV, or NPZ where it has planes."""
    if any(column.ndim > 1 for column in table.values()):
        return "npz", npz(table)
    return "csv", csv(table)


def npz(table: Mapping[str, FloatArray]) -> bytes:
    """Arrays by name, as `numpy.load` reads them; the same arrays give the same bytes."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **dict[str, Any](table))
    return buffer.getvalue()


def csv(table: Mapping[str, FloatArray]) -> bytes:
    """Header and numbers, each with as many digits as it takes to read the same number back."""
    rows = zip(*(column.tolist() for column in table.values()), strict=True)
    lines = [",".join(table), *(",".join(map(repr, row)) for row in rows), ""]
    return "\n".join(lines).encode()


def record(
    *,
    analysis: str,
    command: Sequence[str],
    seed: int,
    scenario: Mapping[str, Any],
    warnings: Sequence[str],
    summary: Mapping[str, Any],
) -> bytes:
    """Return the JSON record of how a result was made and what it says."""
    content = {
        "analysis": analysis,
        "command": list(command),
        "versions": {
            "radar-sense": __version__,
            "python": platform.python_version(),
            **{package: version(package) for package in _PACKAGES},
        },
        "seed": seed,
        "scenario": scenario,
        "warnings": list(warnings),
        "summary": summary,
    }
    return (json.dumps(_finite(content), indent=2, ensure_ascii=True) + "\n").encode()


def require_folder(folder: Path) -> None:
    """Make sure, before anything is computed, that files can be written to the folder.

    The folder need not exist yet; it is made when there is something to write to it.

    Raises:
        OSError: If they cannot.
    """
    folder = folder.absolute()
    with contextlib.suppress(FileNotFoundError):
        folder.stat()  # complains of names that no folder can have
    # lexists: a link that leads nowhere is in the way too
    existing = next(path for path in (folder, *folder.parents) if os.path.lexists(path))
    with tempfile.TemporaryFile(dir=existing):
        pass


def write(files: Mapping[Path, bytes]) -> None:
    """Write files; each appears under its name only when it is complete.

    All are complete before the first appears. If one cannot appear then, those that are new are
    taken away again.

    Raises:
        OSError: If one of them cannot be written.
    """
    for path in files:
        if path.is_dir():
            raise IsADirectoryError(f"{path} is a folder, and in the way of a file")
    finished: dict[Path, Path] = {}
    new: list[Path] = []
    try:
        for path, content in files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            descriptor, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
            finished[path] = Path(name)
            with os.fdopen(descriptor, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            # mkstemp makes files private; these are to be as readable as any other.
            finished[path].chmod(0o666 & ~_umask())
        for path, temporary in finished.items():
            existed = path.exists()
            temporary.replace(path)
            if not existed:
                new.append(path)
    except BaseException:
        for path in new:
            path.unlink()
        raise
    finally:
        for temporary in finished.values():
            with contextlib.suppress(OSError):
                temporary.unlink()


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _finite(value: Any) -> Any:
    """JSON has no NaN and no infinity; null stands for them."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return value
