"""From a result to its figure."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import matplotlib as mpl
from matplotlib.figure import Figure

from radar_sense.analyses.budget import _budget
from radar_sense.analyses.compare import _compare
from radar_sense.analyses.contract import Result
from radar_sense.analyses.convergence import _convergence
from radar_sense.analyses.coverage_map import _map
from radar_sense.analyses.detectors import _detectors
from radar_sense.analyses.mission_plot import _mission
from radar_sense.analyses.montecarlo import _montecarlo
from radar_sense.analyses.rcs import _rcs
from radar_sense.analyses.sensitivity import _sensitivity
from radar_sense.analyses.validate import _validate
from radar_sense.analyses.variance import _variance
from radar_sense.plotting import _STYLE
from radar_sense.plotting import render as render
from radar_sense.plotting import thinned as thinned

_FIGURES: Mapping[str, Callable[[Result], Figure]] = {
    "variance": _variance,
    "montecarlo": _montecarlo,
    "sensitivity": _sensitivity,
    "budget": _budget,
    "compare": _compare,
    "validate": _validate,
    "detectors": _detectors,
    "rcs": _rcs,
    "convergence": _convergence,
    "map": _map,
    "mission": _mission,
}


def draw(result: Result) -> Figure:
    """Draw the figure of a result."""
    with mpl.rc_context(_STYLE):
        return _FIGURES[result.analysis](result)
