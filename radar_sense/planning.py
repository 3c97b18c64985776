"""The threshold test of path planning, on what `variance` found: is P_D low enough on the way?

The bound is that of whatever method of propagation was chosen, at Φ(k): P_D + kσ for `linear`,
which can pass 1, and a quantile for `probit` and `form`. The test itself is in `threshold`.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from radar_sense.analyses import Result
from radar_sense.limits import SIGMAS, THRESHOLD
from radar_sense.propagation import propagate_scenario
from radar_sense.reader import ScenarioError
from radar_sense.threshold import threshold_test
from radar_sense.wording import where


def require_threshold(result: Result, p_max: float, k: float = 3.0) -> Result:
    """Add the threshold test P_D + kσ ≤ P_max to a result of `variance`.

    The table gets the bound (`upper_2sigma` for k = 2; that for k = 3 is in it already), `margin`
    and `violated`. The result passes if no pose violates the threshold. A pose without a bound
    does: what is not known is not safe.

    Args:
        result: The result of `variance`.
        p_max: P_max, greater than 0 and at most 1.
        k: k, greater than 0.

    Raises:
        ScenarioError: If p_max or k is out of range.
    """
    check_threshold(p_max, k)
    scenario, axis = result.scenario, result.scenario.axis
    column = f"upper_{k:.12g}sigma"
    upper = (
        result.table[column]
        if column in result.table
        else propagate_scenario(scenario, method=result.method, beta=k).upper
    )
    # A path has times, also where its tables are laid out along the distance.
    coordinate, unit = (
        (axis.values, axis.unit) if scenario.time_s is None else (scenario.time_s, "s")
    )
    test = threshold_test(upper, p_max, coordinate)
    share = test.above / test.total if test.total > 0 else float(not test.passed)
    worst, unknown = test.worst, np.isnan(test.margin)
    summary: dict[str, Any] = {
        "p_max": p_max,
        "k": k,
        "bound": column,
        "passed": test.passed,
        "poses_violated": int(np.count_nonzero(test.violated)),
        "poses_without_bound": int(np.count_nonzero(unknown)),
        f"above_{unit}": test.above,
        f"total_{unit}": test.total,
        "share_above": share,
        "first_violation": None
        if test.first is None
        else {axis.key: float(axis.values[test.first])},
        "worst_margin": {
            "value": float(test.margin[worst]),
            axis.key: float(axis.values[worst]),
        },
    }
    said = [
        f"P_D + {k:g} sigma <= {p_max:g} (bound by {result.method}): "
        + ("holds at every pose" if test.passed else f"VIOLATED {where(test.violated, axis)}")
    ]
    if test.first is not None:
        said += [
            f"  above it for {test.above:.6g} of {test.total:.6g} {unit} ({share:.1%}), "
            f"first at {axis.at(test.first)}",
        ]
    if unknown.any():
        said += [f"  no bound {where(unknown, axis)}: counted as a violation"]
    if not unknown.all():
        least = int(np.nanargmin(test.margin))
        said += [f"  least margin {test.margin[least]:.4f} at {axis.at(least)}"]
    return dataclasses.replace(
        result,
        table={
            **result.table,
            column: upper,
            "margin": test.margin,
            "violated": test.violated.astype(float),
        },
        summary={**result.summary, "threshold": summary},
        report=(*result.report, *said),
        passed=test.passed,
    )


def check_threshold(p_max: float, k: float) -> None:
    """Raise ScenarioError unless P_max and k are ones that can be tested."""
    for name, value, limit in (("threshold", p_max, THRESHOLD), ("k", k, SIGMAS)):
        if not limit.allows(value):
            raise ScenarioError(f"{name} must be {limit}, got {value}")
