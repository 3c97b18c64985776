"""The detectors that a scenario can name."""

from __future__ import annotations

from collections.abc import Mapping

from radar_sense.model.detectors import Detector, Marcum, North, Swerling1, Swerling3

#: The detectors that a scenario can name. With a single pulse Swerling's cases are two.
DETECTORS: Mapping[str, type[Detector]] = {
    "north": North,
    "marcum": Marcum,
    "swerling1": Swerling1,
    "swerling2": Swerling1,
    "swerling3": Swerling3,
    "swerling4": Swerling3,
}
