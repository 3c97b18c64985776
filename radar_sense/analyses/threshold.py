"""The threshold test of path planning: does P_D, with its uncertainty, stay low enough on the way?

A path is accepted where P_D + kσ ≤ P_max at every pose (A. Costley, G. Droge, R. Christensen,
R. C. Leishman and J. Swedeen, "Path planning with uncertainty for aircraft under threat of
detection from ground-based radar", 2022). The linear bound P_D + kσ can pass 1; any other upper
bound, such as a quantile at Φ(k), will do as well.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_sense.analyses.contract import Result
from radar_sense.analyses.report import describe_poses
from radar_sense.errors import InputError
from radar_sense.limits import SIGMAS, THRESHOLD
from radar_sense.propagation import propagate_scenario
from radar_sense.states import FloatArray


@dataclass(frozen=True, eq=False)
class ThresholdTest:
    """Whether an upper bound of P_D stays within P_max, pose by pose.

    Attributes:
        p_max: P_max.
        margin: P_max less the bound (n,): negative where it is passed, NaN where there is no bound.
        violated: Where the bound passes P_max (n,). No bound counts as one that passes it.
        above: How long, in the units of the coordinate, the bound is above P_max.
        total: How long the whole of the path is, in the same units.
    """

    p_max: float
    margin: FloatArray
    violated: NDArray[np.bool_]
    above: float
    total: float

    @property
    def passed(self) -> bool:
        """Whether no pose violates the threshold."""
        return not self.violated.any()

    @property
    def first(self) -> int | None:
        """The first pose that violates it, or None."""
        return int(np.argmax(self.violated)) if self.violated.any() else None

    @property
    def worst(self) -> int:
        """The pose with the least margin, or the first without a bound if there is one."""
        return int(np.argmin(np.where(np.isnan(self.margin), -np.inf, self.margin)))


def threshold_test(upper: ArrayLike, p_max: float, coordinate: ArrayLike) -> ThresholdTest:
    """Test an upper bound of P_D against a threshold along a path.

    Between poses the bound is taken to be linear, and so is the crossing of the threshold. A step
    from or to a pose without a bound counts as above as a whole: what is not known is not safe.

    Args:
        upper: The upper bound (n,): P_D + kσ, or `Moments.upper` at β = k.
        p_max: P_max, greater than 0 and at most 1.
        coordinate: Time [s], or azimuth on an orbit [deg], of each pose (n,); it either does not
            decrease or does not increase.

    Raises:
        ValueError: If p_max is out of range, the coordinates are not in order or a shape does not
            fit.
    """
    upper, coordinate = np.asarray(upper, dtype=float), np.asarray(coordinate, dtype=float)
    if not 0 < p_max <= 1:
        raise ValueError(f"p_max must be greater than 0 and not greater than 1, got {p_max}")
    if upper.ndim != 1 or not upper.size or upper.shape != coordinate.shape:
        raise ValueError(
            f"bound and coordinate must both have shape (n,), "
            f"got {upper.shape} and {coordinate.shape}"
        )
    steps = np.diff(coordinate)
    if not np.isfinite(coordinate).all() or (np.any(steps < 0) and np.any(steps > 0)):
        raise ValueError("the coordinates of the poses must be finite and in order")
    margin = p_max - upper
    violated = ~(margin >= 0)
    return ThresholdTest(
        p_max=p_max,
        margin=margin,
        violated=violated,
        above=math.fsum(abs(steps) * _share_above(margin)),
        total=abs(float(coordinate[-1] - coordinate[0])),
    )


def _share_above(margin: FloatArray) -> FloatArray:
    """Share of each step (n − 1,) in which the margin, linear between its ends, is negative."""
    known = np.isfinite(margin)
    margin = np.where(known, margin, 0.0)
    above, within = np.maximum(-margin, 0.0), np.maximum(margin, 0.0)
    beyond, all_of_it = above[:-1] + above[1:], (above + within)[:-1] + (above + within)[1:]
    # Linear from −b to a, the margin is negative for b/(a + b) of the step.
    share = np.divide(beyond, all_of_it, out=np.zeros_like(beyond), where=beyond > 0)
    return np.where(known[:-1] & known[1:], share, 1.0)


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
        InputError: If p_max or k is out of range.
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
        + (
            "holds at every pose"
            if test.passed
            else f"VIOLATED {describe_poses(test.violated, axis)}"
        )
    ]
    if test.first is not None:
        said += [
            f"  above it for {test.above:.6g} of {test.total:.6g} {unit} ({share:.1%}), "
            f"first at {axis.at(test.first)}",
        ]
    if unknown.any():
        said += [f"  no bound {describe_poses(unknown, axis)}: counted as a violation"]
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
    """Raise InputError unless P_max and k are ones that can be tested."""
    for name, value, limit in (("threshold", p_max, THRESHOLD), ("k", k, SIGMAS)):
        if not limit.allows(value):
            raise InputError(f"{name} must be {limit}, got {value}")
