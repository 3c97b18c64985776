"""The two state vectors: their components, in order, and the sources of uncertainty in them.

Every array of states has its components on the last axis, in the order given here. Nothing else
in the package spells that order out.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]

#: x_a of the paper: position in the north-east-down frame [m] and ZYX Euler angles [rad].
AIRCRAFT = ("north", "east", "down", "roll", "pitch", "yaw")
#: x_r of the paper: position in the north-east-down frame [m] and radar constant c_r [J m²/K].
RADAR = ("north", "east", "down", "constant")

POSITION = slice(0, 3)
ATTITUDE = slice(3, 6)
CONSTANT = 3

#: The sources of the paper's error budget: whose state, and which of its components.
SOURCES: dict[str, tuple[str, slice]] = {
    "aircraft_position": ("aircraft", POSITION),
    "aircraft_orientation": ("aircraft", ATTITUDE),
    "radar_position": ("radar", POSITION),
    "radar_constant": ("radar", slice(CONSTANT, CONSTANT + 1)),
}
