"""How sure can you be of a radar's probability of detection?

The names below are loaded when they are first used, so that the command line can answer `--help`
without loading NumPy and SciPy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOME = {
    "ConstantRCS": "model.rcs",
    "DetectionModel": "model.detection_model",
    "EllipsoidRCS": "model.rcs",
    "ExactEllipsoidRCS": "model.rcs",
    "Horizon": "model.horizon",
    "Linearization": "model.detection_model",
    "Marcum": "model.detectors",
    "Moments": "propagation",
    "MonteCarlo": "montecarlo.montecarlo",
    "NetworkModel": "model.network",
    "North": "model.detectors",
    "Result": "analyses.contract",
    "Scenario": "scenario",
    "ScenarioError": "errors",
    "SpikeballRCS": "model.rcs",
    "Station": "model.network",
    "SurveillanceRadar": "model.radar_equation",
    "Swerling1": "model.detectors",
    "Swerling3": "model.detectors",
    "TableRCS": "model.rcs_table",
    "TrackingRadar": "model.radar_equation",
    "budget": "analyses.budget",
    "compare": "analyses.compare",
    "detectors": "analyses.detectors",
    "load_rcs_table": "reading.rcs_file",
    "load_scenario": "reading.parse",
    "monte_carlo": "montecarlo.montecarlo",
    "monte_carlo_states": "montecarlo.montecarlo",
    "parse_scenario": "reading.parse",
    "propagate": "propagation",
    "sensitivity": "analyses.sensitivity",
    "validate": "analyses.validate",
    "variance": "analyses.variance",
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
    from radar_sense.errors import ScenarioError
    from radar_sense.model.detection_model import DetectionModel, Linearization
    from radar_sense.model.detectors import Marcum, North, Swerling1, Swerling3
    from radar_sense.model.horizon import Horizon
    from radar_sense.model.network import NetworkModel, Station
    from radar_sense.model.radar_equation import SurveillanceRadar, TrackingRadar
    from radar_sense.model.rcs import ConstantRCS, EllipsoidRCS, ExactEllipsoidRCS, SpikeballRCS
    from radar_sense.model.rcs_table import TableRCS
    from radar_sense.montecarlo.montecarlo import MonteCarlo, monte_carlo, monte_carlo_states
    from radar_sense.propagation import Moments, propagate
    from radar_sense.reading.parse import load_scenario, parse_scenario
    from radar_sense.reading.rcs_file import load_rcs_table
    from radar_sense.scenario import Scenario

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
    "monte_carlo_states",
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
