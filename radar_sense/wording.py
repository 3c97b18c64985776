"""Saying in words where along the geometry something happens."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_sense.axis import Axis
from radar_sense.states import FloatArray


def reached(values: FloatArray) -> NDArray[np.bool_]:
    """Mark the poses at which the largest value is reached.

    Poses that mirror each other differ by rounding, which must not decide between them.
    """
    top = np.nanmax(values, initial=-np.inf)
    return np.greater_equal(values, top - 1e-9 * abs(top))


def peak(values: FloatArray, axis: Axis) -> dict[str, Any]:
    """Return the largest value and all places at which it is reached."""
    if not np.isfinite(values).any():
        return {"value": float("nan"), axis.key: []}
    return {"value": float(np.nanmax(values)), axis.key: axis.values[reached(values)].tolist()}


def trough(values: FloatArray, axis: Axis) -> dict[str, Any]:
    """Return the smallest value and all places at which it is reached."""
    top = peak(-values, axis)
    return {**top, "value": -top["value"]}


def at(extreme: Mapping[str, Any], axis: Axis) -> str:
    """Describe a peak or a trough: its value and the places."""
    places = extreme[axis.key]
    if not places:
        return "undefined"
    if len(places) > 3:
        said = f"{len(places)} poses"
    else:
        *others, last = map(axis.number, places)
        said = " and ".join(filter(None, (", ".join(others), last))) + f" {axis.unit}"
    return f"{extreme['value']:.4f} at {said}"


def where(mask: NDArray[np.bool_], axis: Axis) -> str:
    """Describe the poses of a mask; nothing if there are none."""
    count = int(np.count_nonzero(mask))
    if count == 0:
        return ""
    if count == mask.size:
        return "at every pose" if count > 1 else f"at {axis.at(0)}"
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    if len(edges) > 8:
        first, last = map(axis.number, axis.values[mask][[0, -1]])
        return f"at {count} of {mask.size} poses between {first} and {last} {axis.unit}"
    firsts, lasts = (map(axis.number, axis.values[e]) for e in (edges[::2], edges[1::2] - 1))
    spans = (a if a == b else f"{a} to {b}" for a, b in zip(firsts, lasts, strict=True))
    return f"at {', '.join(spans)} {axis.unit}"
