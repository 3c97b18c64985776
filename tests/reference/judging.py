"""Judges numbers and bounds of the package by the reference set."""

from dataclasses import dataclass

import numpy as np

from radar_sense.propagation import propagate_scenario, unreliable_in_scenario

from .reading import as_scenario, gradient

#: A bound may differ by this, and by four standard errors of both.
OFF, ERRORS = 0.005, 4.0
#: What is printed as 0 is smaller than this.
ZERO = 1e-40


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


def exact_errors(block, columns):
    """Return errors (3, n): of P_D and σ, relative, and of the gradient as its part of σ.

    The gradient has the error of each partial times the deviation of its state, over σ: a partial
    may be a small difference. What is 0 in the set must be below what is printed as 0.
    """
    scenario, expected = as_scenario(block, columns), np.hstack(gradient(columns))
    states, known = scenario.states(), slice(expected.shape[1])
    found = scenario.model.linearize(scenario.aircraft, states.radar)
    partials = np.hstack([found.jac_aircraft, found.jac_radar])[:, known]
    std = np.sqrt([*np.diag(scenario.cov_aircraft), *np.diag(states.cov_radar[0])])[known]
    sigma = propagate_scenario(scenario, method="linear").std
    p_d, exact = columns["p_d"], columns["std_linear"]
    off = np.array([found.p_d - p_d, sigma - exact, np.max(abs(partials - expected) * std, axis=1)])
    scale = np.array([p_d, exact, exact])
    return abs(off) / np.where(scale == 0, ZERO, scale)
