"""Whether the bounds of a method are those of the reference set."""

from dataclasses import dataclass

import numpy as np

from radar_sense.propagation import propagate_scenario, unreliable_in_scenario

from .reading import as_scenario

#: A bound may differ by this, and by four standard errors of both.
OFF, ERRORS = 0.005, 4.0


@dataclass(frozen=True, eq=False)
class Judged:
    """Poses (n,) of one scenario: the error of the worse bound, whether it is off, and warned."""

    scenario: int
    error: np.ndarray
    off: np.ndarray
    warned: np.ndarray


def judge(block, columns, method, poses=slice(None)):
    """Return how right the 3σ bounds of a method are."""
    scenario = as_scenario(block, columns, poses)
    found = propagate_scenario(scenario, method=method)
    warned = unreliable_in_scenario(scenario.with_analysis(method=method), found)
    errors, off = [], []
    for end in ("lower", "upper"):
        error = abs(getattr(found, end) - columns[f"{end}_3"][poses])
        allowed = OFF + ERRORS * np.hypot(columns[f"{end}_3_se"][poses], found.error)
        errors.append(error)
        off.append(~(error <= allowed))
    return Judged(block["scenario"], np.max(errors, axis=0), np.any(off, axis=0), warned)
