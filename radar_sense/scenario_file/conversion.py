"""What the sections of a scenario file become in SI, and errors about files that they name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path as FilePath
from typing import TypeVar

import numpy as np

from radar_sense import covariance
from radar_sense.errors import InputError
from radar_sense.limits import DEG
from radar_sense.scenario_file import sections
from radar_sense.scenario_file.place import Place
from radar_sense.scenario_file.text_file import FileError, TextFile, open_text
from radar_sense.states import FloatArray

C = TypeVar("C")

#: One kilometre in metres, and one per kilometre in one per metre.
KM, PER_KM = 1e3, 1e-3


def on_earth(place: sections.Geodetic) -> tuple[float, float, float]:
    """Return latitude, longitude [rad] and height [m]."""
    return place.latitude_deg * DEG, place.longitude_deg * DEG, float(place.altitude_m)


def read_named(stated: sections.DataFile, kind: str, read: Callable[[TextFile], C]) -> C:
    """Return what the file that a section names holds, and let the section have its digest.

    Errors about the file as a whole get the place of the key that names it, and say what kind of
    file it should be. Errors with a line of the file stay as they are. All are explained if the
    section has the digest of another file.
    """
    place = stated.place
    path = FilePath(place.file).parent / stated.file
    try:
        with open_text(path, kind) as file:
            try:
                content = read(file)
            except InputError:
                _check_digest(file, stated)
                raise
            stated.sha256 = _check_digest(file, stated)
    except FileError as error:
        raise (place["file"] if place.is_mapping else place).error(f"{error}") from error
    stated.file = _recorded(path)
    return content


def _check_digest(file: TextFile, stated: sections.DataFile) -> str:
    """Return the digest of a file, or raise InputError if the section has another one."""
    digest = file.sha256()
    if stated.sha256 not in (None, digest):
        message = f"{file.source} is another file than it was: it has {digest}"
        raise stated.place["sha256"].error(message)
    return digest


def _recorded(path: FilePath) -> str:
    """Return the name of a file for a record: relative to the working folder if it is inside.

    The record then names no folder of the machine.
    """
    absolute, here = path.absolute(), FilePath.cwd()
    return (absolute.relative_to(here) if absolute.is_relative_to(here) else absolute).as_posix()


def covariance_of(
    stated: sections.PoseUncertainty | sections.RadarUncertainty,
    parts: Mapping[str, tuple[int, float]],
    **values: float,
) -> FloatArray:
    """Return a covariance in SI from its parts, or from the whole.

    A part has a size, and the SI value of its unit. `values` stand in place of the section's.
    """
    place, blocks = stated.place, []
    units = np.concatenate([np.full(size, unit) for size, unit in parts.values()])
    if stated.covariance is not None:
        return _matrix(stated.covariance, place["covariance"]) * np.outer(units, units)
    for name, (size, _) in parts.items():
        value = values.get(name, getattr(stated, name))
        if value is None:
            raise place.error(f"missing key '{name}', required without covariance")
        if isinstance(value, tuple) and isinstance(value[0], tuple):
            blocks.append(_matrix(value, place[name]))
        else:
            blocks.append(np.diag(np.square(np.broadcast_to(value, size))))
    return covariance.block_diagonal(blocks) * np.outer(units, units)


def _matrix(rows: Sequence[Sequence[float]], place: Place) -> FloatArray:
    matrix = np.array(rows)
    if problem := covariance.problem(matrix):
        raise place.error(problem)
    return (matrix + matrix.T) / 2
