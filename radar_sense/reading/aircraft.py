"""The aircraft of a scenario file."""

from __future__ import annotations

from typing import Any

import numpy as np

from radar_sense.limits import DEG, Limit, parameter_keys
from radar_sense.model.rcs import RCS, RCS_MODELS
from radar_sense.reading.geometry import _is_path
from radar_sense.reading.rcs_file import KEYS as TABLE_KEYS
from radar_sense.reading.rcs_file import read_table
from radar_sense.reading.yaml_reader import Entry
from radar_sense.states import FloatArray


def _aircraft(entry: Entry, geometry: Entry) -> tuple[RCS, FloatArray | None, dict[str, Any]]:
    """Read RCS and attitude; a path has the attitude of its own."""
    on_path = _is_path(geometry)
    found = entry.mapping(*((["rcs"], ["attitude_deg"]) if on_path else (["rcs", "attitude_deg"],)))
    if on_path and "attitude_deg" in found:
        raise found["attitude_deg"].error(
            "must be left out with a path: attitude is that of the route file, or of its track"
        )
    keys = dict.fromkeys(key for model in RCS_MODELS.values() for key in parameter_keys(model))
    choices = found["rcs"].mapping([], ["model", *keys, *TABLE_KEYS])
    if "model" not in choices:
        raise found["rcs"].error(f"missing key 'model', one of {', '.join(RCS_MODELS)}")
    name = choices["model"].choice(RCS_MODELS)
    rcs, values = (
        read_table(found["rcs"])
        if name == "table"
        else found["rcs"].instance(RCS_MODELS[name], besides=["model"])
    )
    document: dict[str, Any] = {"rcs": {"model": name, **values}}
    if on_path:
        return rcs, None, document
    attitude = found["attitude_deg"].numbers(3, Limit(at_least=-360, at_most=360))
    document["attitude_deg"] = attitude
    return rcs, np.array(attitude) * DEG, document
