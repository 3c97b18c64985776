"""How sure can you be of a radar's probability of detection?

The names below are loaded when they are first used, so that the command line can answer `--help`
without loading NumPy and SciPy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOME = {
    "ConstantRCS": "rcs",
    "DetectionModel": "model",
    "EllipsoidRCS": "rcs",
    "ExactEllipsoidRCS": "rcs",
    "Horizon": "horizon",
    "Linearization": "model",
    "Marcum": "detection",
    "Moments": "propagation",
    "MonteCarlo": "montecarlo",
    "NetworkModel": "network",
    "North": "detection",
    "Result": "analyses",
    "Scenario": "scenario",
    "ScenarioError": "reader",
    "SpikeballRCS": "rcs",
    "Station": "network",
    "SurveillanceRadar": "radar",
    "Swerling1": "detection",
    "Swerling3": "detection",
    "TableRCS": "rcs_table",
    "TrackingRadar": "radar",
    "budget": "analyses",
    "compare": "analyses",
    "detectors": "analyses",
    "load_rcs_table": "rcs_file",
    "load_scenario": "scenario",
    "monte_carlo": "montecarlo",
    "parse_scenario": "scenario",
    "propagate": "propagation",
    "sensitivity": "analyses",
    "validate": "analyses",
    "variance": "analyses",
}

if TYPE_CHECKING:
    from radar_sense.analyses import (
        Result,
        budget,
        compare,
        detectors,
        sensitivity,
        validate,
        variance,
    )
    from radar_sense.detection import Marcum, North, Swerling1, Swerling3
    from radar_sense.horizon import Horizon
    from radar_sense.model import DetectionModel, Linearization
    from radar_sense.montecarlo import MonteCarlo, monte_carlo
    from radar_sense.network import NetworkModel, Station
    from radar_sense.propagation import Moments, propagate
    from radar_sense.radar import SurveillanceRadar, TrackingRadar
    from radar_sense.rcs import ConstantRCS, EllipsoidRCS, ExactEllipsoidRCS, SpikeballRCS
    from radar_sense.rcs_file import load_rcs_table
    from radar_sense.rcs_table import TableRCS
    from radar_sense.reader import ScenarioError
    from radar_sense.scenario import Scenario, load_scenario, parse_scenario

__all__ = [
    "ConstantRCS",
    "DetectionModel",
    "EllipsoidRCS",
    "ExactEllipsoidRCS",
    "Horizon",
    "Linearization",
    "Marcum",
    "Moments",
    "MonteCarlo",
    "NetworkModel",
    "North",
    "Result",
    "Scenario",
    "ScenarioError",
    "SpikeballRCS",
    "Station",
    "SurveillanceRadar",
    "Swerling1",
    "Swerling3",
    "TableRCS",
    "TrackingRadar",
    "__version__",
    "budget",
    "compare",
    "detectors",
    "load_rcs_table",
    "load_scenario",
    "monte_carlo",
    "parse_scenario",
    "propagate",
    "sensitivity",
    "validate",
    "variance",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'radar_sense' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"radar_sense.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
