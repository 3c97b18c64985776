"""The RCS models that a scenario can name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from radar_sense.model.rcs import ConstantRCS, EllipsoidRCS, ExactEllipsoidRCS, SpikeballRCS
from radar_sense.model.rcs_table import TableRCS

#: The RCS models that a scenario can name. Their keys are declared with their fields.
RCS_MODELS: Mapping[str, type[Any]] = {
    "constant": ConstantRCS,
    "ellipsoid": EllipsoidRCS,
    "ellipsoid_exact": ExactEllipsoidRCS,
    "spikeball": SpikeballRCS,
    "table": TableRCS,
}
