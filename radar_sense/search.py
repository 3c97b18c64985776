"""The search for maxima by golden sections."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from radar_sense.states import FloatArray

_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


def golden_section(
    function: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray, steps: int
) -> tuple[FloatArray, FloatArray]:
    """Return the maxima of a function between low and high (...), and their arguments (...).

    Each step shrinks the brackets to 0.62 of themselves. A bracket should have one maximum.
    """
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = function(left), function(right)
    for _ in range(steps):
        up = at_right > at_left
        low, high = np.where(up, left, low), np.where(up, high, right)
        inner = np.where(up, low + _GOLDEN * (high - low), high - _GOLDEN * (high - low))
        value = function(inner)
        left, right = np.where(up, right, inner), np.where(up, inner, left)
        at_left, at_right = np.where(up, at_right, value), np.where(up, value, at_left)
    up = at_right > at_left
    return np.where(up, at_right, at_left), np.where(up, right, left)
