"""Saying in words where along the geometry something happens."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_sense.states import FloatArray


def reached(values: FloatArray) -> NDArray[np.bool_]:
    """Mark the poses at which the largest value is reached.

    Poses that mirror each other differ by rounding, which must not decide between them.
    """
    top = np.nanmax(values, initial=-np.inf)
    return np.greater_equal(values, top - 1e-9 * abs(top))


def peak(values: FloatArray, theta: FloatArray) -> dict[str, Any]:
    """Return the largest value and all angles at which it is reached."""
    if not np.isfinite(values).any():
        return {"value": float("nan"), "theta_r_deg": []}
    return {"value": float(np.nanmax(values)), "theta_r_deg": theta[reached(values)].tolist()}


def trough(values: FloatArray, theta: FloatArray) -> dict[str, Any]:
    """Return the smallest value and all angles at which it is reached."""
    top = peak(-values, theta)
    return {**top, "value": -top["value"]}


def at(extreme: Mapping[str, Any]) -> str:
    """Describe a peak or a trough: its value and the angles."""
    angles = extreme["theta_r_deg"]
    if not angles:
        return "undefined"
    if len(angles) > 3:
        place = f"{len(angles)} poses"
    else:
        *others, last = (f"{angle:g}" for angle in angles)
        place = f"{', '.join(others)} and {last} deg" if others else f"{last} deg"
    return f"{extreme['value']:.4f} at {place}"


def where(mask: NDArray[np.bool_], theta: FloatArray) -> str:
    """Describe the poses of a mask; nothing if there are none."""
    count = int(np.count_nonzero(mask))
    if count == 0:
        return ""
    if count == mask.size:
        return "at every pose" if count > 1 else f"at {theta[0]:g} deg"
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    spans = [
        f"{theta[a]:g}" if b - a == 1 else f"{theta[a]:g} to {theta[b - 1]:g}"
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]
    if len(spans) > 4:
        first, last = theta[mask][[0, -1]]
        return f"at {count} of {mask.size} poses between {first:g} and {last:g} deg"
    return f"at {', '.join(spans)} deg"
