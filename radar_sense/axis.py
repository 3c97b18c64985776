"""What poses are laid out along: the azimuth of an orbit, the time or the distance of a path."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from radar_sense.states import FloatArray


@dataclass(frozen=True, eq=False)
class Axis:
    """The coordinate of the poses in tables, figures and words, in one unit.

    Attributes:
        key: Its column in tables, and its name in records.
        name: What to call it in a sentence.
        unit: Its unit, that of `values` and of what a user gives.
        values: The coordinate of each pose (n,), never falling on a path.
        digits: Format of a value in words.
        tolerance: A user who gives a value this near to a pose means that pose.
    """

    key: str
    name: str
    unit: str
    values: FloatArray
    digits: str
    tolerance: float

    def __len__(self) -> int:
        return len(self.values)

    def number(self, value: float) -> str:
        """Put a value in words, without the unit."""
        return format(value, self.digits)

    def say(self, value: float) -> str:
        """Put a value in words."""
        return f"{self.number(value)} {self.unit}"

    def at(self, pose: int) -> str:
        """Say where a pose is."""
        return self.say(float(self.values[pose]))

    def part(self, poses: slice | NDArray[np.intp]) -> Axis:
        """Return the axis of some of the poses."""
        return replace(self, values=self.values[poses])

    def find(self, value: float) -> int | None:
        """Find the pose at a value, or None if there is none."""
        nearest = self.nearest(value)
        return nearest if abs(self.values[nearest] - value) <= self.tolerance else None

    def nearest(self, value: float) -> int:
        """Find the pose nearest to a value."""
        return int(np.argmin(abs(self.values - value)))


def azimuth(values: FloatArray) -> Axis:
    """θ_r of the paper [deg], for the poses of an orbit."""
    return Axis("theta_r_deg", "azimuth", "deg", values, "g", 1e-9)


def time(values: FloatArray) -> Axis:
    """Time along a path [s]."""
    return Axis("time_s", "time", "s", values, ".13g", 1e-3)


def distance(values: FloatArray) -> Axis:
    """Distance flown along a path [m]."""
    return Axis("distance_m", "distance", "m", values, ".0f", 1.0)
