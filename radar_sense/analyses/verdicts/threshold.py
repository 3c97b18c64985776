"""The threshold test of path planning: does P_D, with its uncertainty, stay below a threshold?

A path is accepted where P_D + kσ ≤ P_max at every pose (A. Costley, G. Droge, R. Christensen,
R. C. Leishman and J. Swedeen, "Path planning with uncertainty for aircraft under threat of
detection from ground-based radar", 2022). The linear bound P_D + kσ can exceed 1. The quantile of
P_D at Φ(k) is a bound for any distribution.

A path is also tested between its rows. The test has no answer where the check of the method finds
the bound unreliable. Draws can decide these poses.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from radar_sense.analyses.columns import quantities
from radar_sense.analyses.contract import Result
from radar_sense.analyses.verdicts import refinement
from radar_sense.flight import Path
from radar_sense.montecarlo.exceedance import Anywhere, decide, exceeded_anywhere
from radar_sense.propagation import (
    Moments,
    exceedance_probability,
    nonlinear_in_scenario,
    propagate_scenario,
)
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray
from radar_sense.words import describe_poses, distribution_warnings

#: The default method of a threshold test: `FORM`, and draws where its bound is unreliable.
AUTOMATIC, FORM = "automatic", "form"
#: Columns of the test.
COLUMNS = quantities(
    {
        "upper_<k>sigma": "With --threshold and --k: upper bound of P_D at <k> sigma.",
        "margin": "With --threshold: P_MAX minus the upper bound of P_D.",
        "violated": "With --threshold: 1 where the bound is above P_MAX, else 0.",
        "not_known": "With --threshold: 1 where the test has no answer, else 0.",
        "probability_above": "With --threshold: probability that P_D is above P_MAX.",
    }
)


@dataclass(frozen=True, eq=False)
class ThresholdTest:
    """The threshold test of an upper bound of P_D, pose by pose.

    Attributes:
        p_max: P_max.
        margin: P_max minus the bound (n,): negative above P_max, NaN without a bound.
        violated: Where P_max is exceeded (n,).
        unknown: Where the test has no answer (n,): without a bound, or with an unreliable bound.
        above: Length of the path with the bound above P_max, in the unit of the coordinate. Steps
            to and from a pose without a bound are counted.
        total: Length of the path, in the unit of the coordinate.
    """

    p_max: float
    margin: FloatArray
    violated: NDArray[np.bool_]
    unknown: NDArray[np.bool_]
    above: float
    total: float

    @property
    def verdict(self) -> str:
        """Verdict on all poses: "violated" or "not known" at a pose, or "holds"."""
        if self.violated.any():
            return "violated"
        return "not known" if self.unknown.any() else "holds"

    @property
    def passed(self) -> bool:
        """Whether the test holds at every pose."""
        return self.verdict == "holds"

    @property
    def first(self) -> int | None:
        """First violated pose, or else the first pose that is not known; None if the test holds."""
        for mask in (self.violated, self.unknown):
            if mask.any():
                return int(np.argmax(mask))
        return None

    @property
    def worst(self) -> int:
        """The pose with the least margin, or the first without a bound."""
        return int(np.argmin(np.where(np.isnan(self.margin), -np.inf, self.margin)))


def threshold_test(
    upper: ArrayLike,
    p_max: float,
    coordinate: ArrayLike,
    *,
    p_d: ArrayLike | None = None,
    unreliable: ArrayLike = False,
) -> ThresholdTest:
    """Test an upper bound of P_D against a threshold along a path.

    The bound is assumed to be linear between poses.

    Args:
        upper: The upper bound (n,): P_D + kσ, or `Moments.upper` at β = k.
        p_max: P_max, greater than 0 and at most 1.
        coordinate: Time [s] of each pose (n,), or azimuth on an orbit [deg], in order.
        p_d: P_D (n,). Where P_D itself is above P_max, the test is violated.
        unreliable: Where (n,) the bound is unreliable.
    """
    upper, coordinate = np.asarray(upper, dtype=float), np.asarray(coordinate, dtype=float)
    margin = p_max - upper
    certain = np.zeros(upper.shape, dtype=bool) if p_d is None else np.asarray(p_d) > p_max
    without = ~np.isfinite(margin) | np.asarray(unreliable, dtype=bool)
    return ThresholdTest(
        p_max=p_max,
        margin=margin,
        violated=certain | (~without & (margin < 0)),
        unknown=without & ~certain,
        above=math.fsum(abs(np.diff(coordinate)) * _share_above(margin)),
        total=abs(float(coordinate[-1] - coordinate[0])),
    )


def _share_above(margin: FloatArray) -> FloatArray:
    """Return the share of each step (n − 1,) with a negative margin, linear between poses."""
    known = np.isfinite(margin)
    margin = np.where(known, margin, 0.0)
    above, within = np.maximum(-margin, 0.0), np.maximum(margin, 0.0)
    negative, whole = above[:-1] + above[1:], (above + within)[:-1] + (above + within)[1:]
    # On a line from −b to a, b/(a + b) of the step is negative.
    share = np.divide(negative, whole, out=np.zeros_like(negative), where=negative > 0)
    return np.where(known[:-1] & known[1:], share, 1.0)


@dataclass(frozen=True, eq=False)
class _PathTest:
    """A threshold test of a scenario, at the poses of its refined path.

    Attributes:
        path: The scenario of the poses tested (n,), and which poses are rows of the path.
        test: The test.
        probability: P(P_D > P_max) (n,).
        drawn: Where draws decided (n,).
        undecided: Where draws did not decide (n,).
        anywhere: P(P_D > P_max) at any pose.
    """

    path: refinement.Refined
    test: ThresholdTest
    probability: FloatArray
    drawn: NDArray[np.bool_]
    undecided: NDArray[np.bool_]
    anywhere: Anywhere


def require_threshold(
    result: Result, p_max: float, k: float = 3.0, *, with_draws: bool = False
) -> Result:
    """Add the threshold test P_D + kσ ≤ P_max to a result of `variance`.

    The table gets the columns `margin`, `violated`, `not_known`, `probability_above`, and the
    bound, for k = 2 `upper_2sigma`. `probability_above` is P(P_D > P_max). The result passes if the
    test holds at every pose, and on a path also between the poses.

    Args:
        result: The result of `variance`.
        p_max: P_max, greater than 0 and at most 1.
        k: k, greater than 0.
        with_draws: Whether draws decide where the bound of the method is unreliable.
    """
    scenario, method = result.scenario, result.method
    tested = _tested(scenario, method, p_max, k, with_draws=with_draws)
    rows, test = tested.path.rows, tested.test
    column = f"upper_{k:.12g}sigma"
    upper = result.table.get(column, tested.path.moments.upper[rows])
    return dataclasses.replace(
        result,
        table={
            **result.table,
            column: upper,
            "margin": test.margin[rows],
            "violated": test.violated[rows].astype(float),
            "not_known": test.unknown[rows].astype(float),
            "probability_above": tested.probability[rows],
        },
        summary={**result.summary, "threshold": _summary(tested, column, k)},
        report=(*result.report, *_report(tested, method, k)),
        passed=test.passed,
    )


def _tested(
    scenario: Scenario, method: str, p_max: float, k: float, *, with_draws: bool
) -> _PathTest:
    def propagate(path_scenario: Scenario) -> Moments:
        return propagate_scenario(path_scenario, method=method, beta=k)

    path = refinement.resolve(scenario, propagate, p_max)
    poses, moments = path.scenario, path.moments
    unreliable = ~np.isfinite(moments.upper)
    unreliable |= nonlinear_in_scenario(poses, moments, method=method, beta=k)
    if distribution_warnings(scenario, method):
        unreliable[:] = True
    probability = exceedance_probability(poses, p_max, method=method)
    upper, drawn = moments.upper.copy(), np.zeros(len(moments.p_d), dtype=bool)
    undecided, violated = drawn.copy(), drawn.copy()
    open_poses = np.flatnonzero(unreliable & ~(moments.p_d > p_max))
    if with_draws and open_poses.size:
        decision = decide(poses.at_poses(open_poses), p_max, float(ndtr(-k)))
        upper[open_poses], probability[open_poses] = decision.upper, decision.probability
        drawn[open_poses] = decision.holds | decision.violated
        undecided[open_poses] = ~drawn[open_poses]
        violated[open_poses] = decision.violated
    test = threshold_test(
        upper,
        p_max,
        poses.geometry.coordinate,
        p_d=np.where(violated, np.inf, moments.p_d),
        unreliable=unreliable & ~drawn,
    )
    if not path.resolved:
        test = dataclasses.replace(test, unknown=~test.violated)
    return _PathTest(
        path=path,
        test=test,
        probability=probability,
        drawn=drawn,
        undecided=undecided,
        anywhere=exceeded_anywhere(poses, p_max, probability),
    )


def _unit(scenario: Scenario) -> str:
    """Return the unit of the coordinate of `refinement`."""
    return scenario.axis.unit if scenario.time_s is None else "s"


def _summary(tested: _PathTest, column: str, k: float) -> dict[str, Any]:
    test, axis = tested.test, tested.path.scenario.axis
    unit = _unit(tested.path.scenario)
    highest = int(np.argmax(np.nan_to_num(tested.probability, nan=-1.0)))

    def place(pose: int) -> dict[str, float]:
        return {axis.key: float(axis.values[pose])}

    return {
        "p_max": test.p_max,
        "k": k,
        "bound": column,
        "verdict": test.verdict,
        "passed": test.passed,
        "poses": len(axis),
        "poses_between_rows": tested.path.added,
        "tolerance_between_poses": tested.path.tolerance,
        "poses_violated": int(np.count_nonzero(test.violated)),
        "poses_not_known": int(np.count_nonzero(test.unknown)),
        "poses_without_bound": int(np.count_nonzero(np.isnan(test.margin))),
        "poses_decided_by_draws": int(np.count_nonzero(tested.drawn)),
        "p_d_itself_above": bool(np.any(tested.path.moments.p_d > test.p_max)),
        f"above_{unit}": test.above,
        f"total_{unit}": test.total,
        "share_above": _share(test),
        "first_violation": None if test.first is None else place(test.first),
        "worst_margin": {"value": float(test.margin[test.worst]), **place(test.worst)},
        "highest_probability_above": {
            "value": float(tested.probability[highest]),
            **place(highest),
        },
        "probability_above_at_any_pose": {
            "value": tested.anywhere.probability,
            "standard_error": tested.anywhere.error,
            "runs": tested.anywhere.runs,
        },
    }


def _share(test: ThresholdTest) -> float:
    return test.above / test.total if test.total > 0 else float(not test.passed)


def _report(tested: _PathTest, method: str, k: float) -> list[str]:
    test, scenario = tested.test, tested.path.scenario
    axis = scenario.axis
    limit = f"{test.p_max:g}"
    lines = [
        f"P_D + {k:g} sigma <= {limit} (bound by {_bound_by(tested, method)}): {_verdict(tested)}"
    ]
    if test.violated.any() and test.unknown.any():
        lines += [f"  not known {describe_poses(test.unknown, axis)}"]
    if test.unknown.any():
        lines += [_remedy(tested, method)]
    if test.violated.any():
        lines += [_why(tested, k)]
    if test.first is not None and not np.isnan(test.margin).all():
        unit = _unit(scenario)
        lines += [
            f"  above it for {test.above:.6g} of {test.total:.6g} {unit} ({_share(test):.1%}), "
            f"first at {axis.at(test.first)}"
        ]
    without = np.isnan(test.margin)
    if without.any():
        lines += [f"  no bound {describe_poses(without, axis)}: counted as above it"]
    if not without.all():
        least = int(np.nanargmin(test.margin))
        lines += [f"  least margin {test.margin[least]:.4f} at {axis.at(least)}"]
    lines += _probability_lines(tested, limit)
    lines += _poses_lines(tested)
    return lines


def _bound_by(tested: _PathTest, method: str) -> str:
    if not tested.drawn.any():
        return method
    return f"{method}, and by draws {describe_poses(tested.drawn, tested.path.scenario.axis)}"


def _verdict(tested: _PathTest) -> str:
    test, axis = tested.test, tested.path.scenario.axis
    if test.violated.any():
        return f"VIOLATED {describe_poses(test.violated, axis)}"
    if test.unknown.any():
        return f"NOT KNOWN {describe_poses(test.unknown, axis)}"
    return "holds at every pose" + (" and between them" if tested.path.added else "")


def _remedy(tested: _PathTest, method: str) -> str:
    """Return the reason why the test has no answer, and the remedy."""
    if not tested.path.resolved:
        return f"  {refinement.unresolved(tested.path)}"
    if tested.undecided.any():
        reason = "the tail is too thin for draws, or the bound too near to the threshold"
        return f"  draws do not decide there: {reason}"
    remedy = "leave out --method: draws then decide"
    if method != FORM:
        remedy = f"use --method {FORM}, or leave out --method"
    return f"  the {method} bound is unreliable there: {remedy}"


def _why(tested: _PathTest, k: float) -> str:
    """Return whether P_D itself is above P_max, or only its bound."""
    test, axis, p_d = tested.test, tested.path.scenario.axis, tested.path.moments.p_d
    place = describe_poses(p_d > test.p_max, axis)
    if place:
        return f"  P_D itself is above {test.p_max:g} {place}: no better knowledge helps there"
    highest = int(np.nanargmax(p_d))
    return (
        f"  P_D itself is {p_d[highest]:.4f} at most, at {axis.at(highest)}: better knowledge "
        f"helps, see budget --threshold {test.p_max:g} --k {k:g}"
    )


def _probability_lines(tested: _PathTest, limit: str) -> list[str]:
    axis, probability = tested.path.scenario.axis, tested.probability
    if np.isnan(probability).all():
        return []
    highest = int(np.nanargmax(probability))
    line = f"  P(P_D > {limit}) is {_number(probability[highest])} at most, at {axis.at(highest)}"
    anywhere = tested.anywhere
    if len(axis) == 1 or not anywhere.runs:
        return [line]
    return [
        f"{line}; at any pose {_number(anywhere.probability)} +/- {anywhere.error:.1g} "
        f"({anywhere.runs:,} runs, {_correlation(tested.path.scenario)})"
    ]


def _number(probability: float) -> str:
    return f"{probability:.4f}" if probability >= 1e-3 or probability == 0 else f"{probability:.1e}"


def _correlation(scenario: Scenario) -> str:
    """Describe the correlation of the aircraft errors from pose to pose."""
    if not scenario.correlation_s or scenario.time_s is None:
        return f"errors of the aircraft independent at {len(scenario.axis)} poses"
    return f"errors of the aircraft correlated over {scenario.correlation_s:g} s"


def _poses_lines(tested: _PathTest) -> list[str]:
    """Return the number or the step of the poses tested on a path."""
    scenario = tested.path.scenario
    if tested.path.tolerance is not None:
        given = "the azimuths given" if scenario.time_s is None else "the rows of the path"
        return [
            f"  tested at {len(scenario.axis)} poses, {tested.path.added} of them between {given}: "
            f"P_D and bound are within {tested.path.tolerance:g} of straight lines"
        ]
    geometry = scenario.geometry
    if isinstance(geometry, Path) and geometry.step_s is not None:
        return [f"  tested every {geometry.step_s:g} s, the step of geometry.interpolate"]
    return []
