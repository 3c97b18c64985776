"""The aircraft of a scenario file: RCS and attitude."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from radar_sense import keys
from radar_sense.model.rcs import RCS, RCS_MODELS
from radar_sense.provenance import TableFile
from radar_sense.reading.geometry import is_path
from radar_sense.reading.yaml_reader import Entry, file_errors
from radar_sense.scenario_file.rcs_file import read_rcs_table
from radar_sense.scenario_file.text_file import recorded
from radar_sense.states import FloatArray


def read_aircraft(entry: Entry, geometry: Entry) -> tuple[RCS, TableFile | None, FloatArray | None]:
    """Read the RCS, the file of an RCS table, and the attitude [rad] on an orbit.

    The attitude on a path comes from the route file or from the track.
    """
    if is_path(geometry):
        entries = entry.mapping(["rcs"], [keys.ATTITUDE.name])
        if keys.ATTITUDE.name in entries:
            raise entries[keys.ATTITUDE.name].error(
                "must be left out with a path: attitude is from the route file or from its track"
            )
        return *_read_rcs(entries["rcs"]), None
    section = entry.section(keys.AIRCRAFT)
    return *_read_rcs(section["rcs"]), np.array(section.si(keys.ATTITUDE))


def _read_rcs(entry: Entry) -> tuple[RCS, TableFile | None]:
    of_models = [key.name for cls in RCS_MODELS.values() for key in keys.declared(cls)]
    names = dict.fromkeys(["model", *of_models, *(key.name for key in keys.TABLE)])
    entries = entry.mapping([], list(names))
    if "model" not in entries:
        raise entry.error(f"missing key 'model', one of {', '.join(RCS_MODELS)}")
    name = entries["model"].value(keys.RCS_MODEL)
    if name == "table":
        source = _read_table(entry)
        return source.table, source
    rcs: RCS = entry.instance(RCS_MODELS[name], besides=["model"])
    return rcs, None


def _read_table(entry: Entry) -> TableFile:
    """Read an RCS table; its file is looked for from the folder of the scenario file."""
    section = entry.section(keys.TABLE)
    path = Path(entry.source).parent / section.value(keys.FILE)
    mirror, envelope = section.value(keys.MIRROR), section.si(keys.ENVELOPE_WIDTH)
    expected = section.value(keys.SHA256)
    with file_errors(section):
        table, sha256 = read_rcs_table(path, mirror=mirror, envelope=envelope, sha256=expected)
    return TableFile(recorded(path), sha256, mirror, table)
