"""The axis of the poses: azimuth on an orbit, range on a radial, time or distance on a path."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from radar_sense.errors import InputError
from radar_sense.states import FloatArray, ReadOnly, read_only

#: The key of the axis of distance.
DISTANCE = "distance_m"


@dataclass(frozen=True, eq=False)
class Axis(ReadOnly):
    """The coordinate of the poses in tables, figures and words, in one unit.

    Attributes:
        key: Column in tables, and name in records.
        name: Name in a sentence.
        unit: Unit of `values` and of the values that a user gives.
        values: Coordinate of each pose (n,), which does not decrease along a path.
        digits: Format of a value in a sentence.
        tolerance: Largest distance of a pose from the value that a user gives; 0 if none is given.
        places: Name of the places of the values, in the plural.
        meaning: Meaning of the column.
        prefix: Text before a value in a sentence.
    """

    key: str
    name: str
    unit: str
    values: FloatArray = field(repr=False)
    digits: str
    tolerance: float
    places: str = "poses"
    meaning: str = ""
    prefix: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", read_only("axis", self.values))

    def __len__(self) -> int:
        return len(self.values)

    def number(self, value: float) -> str:
        """Return a value for a sentence, without the unit, so exact that a user may give it."""
        shown = round(value, -round(math.log10(self.tolerance))) if self.tolerance else value
        return format(shown, self.digits)

    def format(self, value: float) -> str:
        """Return a value for a sentence, with the unit."""
        return self.in_words(self.number(value))

    def in_words(self, numbers: str) -> str:
        """Return numbers of a sentence with the unit, and with what stands before them."""
        return f"{self.prefix}{numbers} {self.unit}".strip()

    def at(self, pose: int) -> str:
        """Return the coordinate of a pose for a sentence, exact if a pose beside reads the same."""
        value, beside = float(self.values[pose]), self.values[max(pose - 1, 0) : pose + 2]
        numbers = [self.number(v) for v in beside.tolist()]
        alike = numbers.count(self.number(value)) > 1
        return self.in_words(format(value, self.digits)) if alike else self.format(value)

    def pose_at(self, value: float) -> int:
        """Return the pose at a value, which is within the tolerance, or raise InputError."""
        pose = int(np.argmin(abs(self.values - value)))
        if abs(self.values[pose] - value) > self.tolerance:
            raise InputError(
                f"there is no pose at {self.format(value)}, the nearest of {len(self)} is at "
                f"{self.at(pose)}"
            )
        if np.count_nonzero(self.values == self.values[pose]) > 1:
            raise InputError(f"several poses are at {self.at(pose)}, where the aircraft hovers")
        return pose

    def at_poses(self, poses: slice | NDArray[np.intp]) -> Axis:
        """Return the axis of some of the poses."""
        return replace(self, values=self.values[poses])


def reached(values: FloatArray) -> NDArray[np.bool_]:
    """Mark the poses at which the largest value is reached.

    Mirrored poses have equal values that differ by rounding. All of them are marked.
    """
    top = np.nanmax(values, initial=-np.inf)
    return np.greater_equal(values, top * (1.0 - math.copysign(1e-9, top)))


def runs_of(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and the last pose of each run of poses in a mask (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]]))).tolist()
    return [(first, end - 1) for first, end in zip(edges[::2], edges[1::2], strict=True)]


def steps(start: float, stop: float, step: float, most: int) -> FloatArray:
    """Return numbers (n,) from start to stop, which is one of them if the step leads to it.

    Raises:
        InputError: If the step does not lead to stop, or there are more than `most` numbers.
    """
    # Rounding must not lose the last number, as in (180 − 0)/0.1 = 1799.9999999999998.
    last = (stop - start) / step * (1 + 1e-12) + 1e-9 if step else -1.0  # may be infinite
    if last < 0 or (start != stop and last < 1):
        back = f"; did you mean {-step:g}?" if (stop - start) * step < 0 else ""
        raise InputError(
            f"must be a step other than 0 that leads from {start:g} to {stop:g}, got {step:g}{back}"
        )
    if last >= most:
        raise InputError(f"makes {np.floor(last) + 1:,.0f} values, allowed are {most:,}")
    # 3 · 0.1 = 0.30000000000000004 becomes 0.3: by 12 decimals, or by 14 digits of small numbers.
    digits = math.ceil(math.log10(max(abs(start), abs(stop)) or 1.0))
    decimals = min(max(12, 14 - digits), 40) if digits < 100 else 0  # which cannot overflow
    return np.round(start + step * np.arange(math.floor(last) + 1), decimals)


def widest_of_highest(values: FloatArray, width: FloatArray) -> int:
    """Return where the greatest value is (n,); of several, that with the greatest width (n,)."""
    return int(np.argmax(np.where(reached(values), np.nan_to_num(width, nan=-1.0), -np.inf)))


def azimuth(values: FloatArray) -> Axis:
    """Return the axis of azimuth θ_r [deg], for an orbit."""
    meaning = "Azimuth of the pose on an orbit."
    return Axis("theta_r_deg", "azimuth", "deg", values, ".13g", 1e-6, meaning=meaning)


def time(values: FloatArray) -> Axis:
    """Return the axis of time [s], for a path."""
    meaning = "Time of the pose on a path."
    return Axis("time_s", "time", "s", values, ".13g", 1e-3, meaning=meaning)


def ground_range(values: FloatArray) -> Axis:
    """Return the axis of the ground range from the origin [km], for a radial line."""
    meaning = "Ground range of the pose from the origin, on a radial line."
    return Axis("range_km", "range", "km", values, ".13g", 1e-6, meaning=meaning)


def distance(values: FloatArray) -> Axis:
    """Return the axis of distance flown [m], for a path."""
    meaning = "Distance flown to the pose on a path."
    return Axis(DISTANCE, "distance", "m", values, ".0f", 1.0, meaning=meaning)


def pose_number(count: int) -> Axis:
    """Return the axis of pose numbers, from 0."""
    meaning = "Number of the pose, from 0, of states given in Python."
    numbers = np.arange(float(count))
    return Axis("pose", "pose", "", numbers, "g", 1e-9, meaning=meaning, prefix="pose ")
