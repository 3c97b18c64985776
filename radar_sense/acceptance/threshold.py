"""The threshold test of path planning: does P_D, with its uncertainty, stay below a threshold?

A path is accepted where P_D + kσ ≤ P_max at every pose (A. Costley, G. Droge, R. Christensen,
R. C. Leishman and J. Swedeen, "Path planning with uncertainty for aircraft under threat of
detection from ground-based radar", 2022). The linear bound P_D + kσ can exceed 1. The quantile of
P_D at Φ(k) is a bound for any distribution.

"Holds" rests on two legs at every pose:

- draws with emphasis on the tails find P(P_D > P_max) below 1 − Φ(k), by so many standard errors
  that chance makes a false "holds" at any pose with a probability of `CHANCE` at most;
- plain runs of the whole path exceed P_max no more often than these draws predict. They are so many
  that a tail of 1 − Φ(k) which the draws had missed would show with a probability of 1 − `CHANCE`.

A path is also tested between its rows. What the draws do not decide is not known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri, pdtrc

from radar_sense.acceptance import refinement
from radar_sense.command import Result
from radar_sense.flight import Path
from radar_sense.montecarlo.exceedance import Exceedance, exceedance
from radar_sense.progress import report
from radar_sense.propagation import AUTOMATIC, Moments, propagate_scenario
from radar_sense.propagation.draws import estimate
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray
from radar_sense.words import describe_poses

#: Probability of a false "holds" at any pose by each of the two legs: 0.1 % together.
CHANCE = 0.0005
#: Probability at one pose that plain runs contradict draws that are right. The pose is then looked
#: at with more draws.
ALARM = 1e-4
#: Draws of each look at a pose that is not yet decided.
LOOKS = (1024, 4096, 16_384, 65_536, 2**18)


@dataclass(frozen=True, eq=False)
class ThresholdTest:
    """The threshold test of an upper bound of P_D, pose by pose.

    Attributes:
        p_max: P_max.
        margin: P_max minus the bound (n,): negative above P_max, NaN without a bound.
        violated: Where P_max is exceeded (n,).
        unknown: Where the test has no answer (n,).
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
    violated: ArrayLike | None = None,
    unknown: ArrayLike = False,
) -> ThresholdTest:
    """Test an upper bound of P_D against a threshold along a path.

    The bound is assumed to be linear between poses.

    Args:
        upper: The upper bound (n,): P_D + kσ, or `Moments.upper` at β = k.
        p_max: P_max, greater than 0 and at most 1.
        coordinate: Time [s] of each pose (n,), or azimuth on an orbit [deg], in order.
        violated: Where (n,) the test is violated; None for where the bound is above P_max.
        unknown: Where (n,) the test has no answer.
    """
    upper, coordinate = np.asarray(upper, dtype=float), np.asarray(coordinate, dtype=float)
    margin = p_max - upper
    exceeded = margin < 0 if violated is None else np.asarray(violated, dtype=bool)
    without = ~np.isfinite(margin) if violated is None else np.zeros(upper.shape, dtype=bool)
    return ThresholdTest(
        p_max=p_max,
        margin=margin,
        violated=exceeded,
        unknown=(without | np.asarray(unknown, dtype=bool)) & ~exceeded,
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
class Decision:
    """What draws say of P(P_D > p_max) ≤ 1 − Φ(k) at each of n poses.

    Attributes:
        holds: Where both legs say that it holds (n,).
        violated: Where the draws say that it does not (n,).
        upper: Upper bound of P_D by the draws (n,).
        runs: The runs of the path.
        wanted: Number of runs that "holds" needs.
    """

    holds: NDArray[np.bool_]
    violated: NDArray[np.bool_]
    upper: FloatArray
    runs: Exceedance
    wanted: int


def decide(scenario: Scenario, p_max: float, k: float) -> Decision:
    """Return what draws say of P(P_D > p_max) ≤ 1 − Φ(k) at each pose of a path.

    Args:
        scenario: The scenario, at its level and with its seed.
        p_max: The limit of P_D.
        k: k of the bound.
    """
    tail, poses = float(ndtr(-k)), len(scenario.aircraft)
    wanted = math.ceil(math.log(poses / CHANCE) / -math.log1p(-tail))
    runs = exceedance(scenario, p_max, wanted)
    states = scenario.states()
    above, error, upper = (np.full(poses, np.nan) for _ in range(3))
    holds, violated = np.zeros(poses, dtype=bool), np.zeros(poses, dtype=bool)
    errors = float(ndtri(1.0 - CHANCE / (poses * len(LOOKS))))
    rows = np.arange(poses)
    for draws in LOOKS:
        if not rows.size:
            break
        found = estimate(states.at(rows), draws, k, p_max)
        above[rows], error[rows], upper[rows] = found.above, found.above_error, found.upper
        report("poses decided by draws", poses - rows.size, poses)
        clear = errors * error <= abs(above - tail)
        # as many runs or more exceed the limit with this probability, if the draws are right
        chance = pdtrc(runs.counts - 1.0, runs.runs * (above + 3.0 * error))
        consistent = (runs.counts == 0) | (chance > ALARM)
        holds = clear & (above <= tail) & consistent & (runs.runs >= wanted)
        violated = clear & (above > tail)
        rows = np.flatnonzero(~(holds | violated))
    return Decision(holds, violated, upper, runs, wanted)


@dataclass(frozen=True, eq=False)
class _PathTest:
    """A threshold test of a scenario, at the poses of its refined path.

    Attributes:
        path: The scenario of the poses tested (n,), and which poses are rows of the path.
        test: The test.
        decision: What draws say.
        by_draws: Where the bound is by draws (n,).
    """

    path: refinement.Refined
    test: ThresholdTest
    decision: Decision
    by_draws: NDArray[np.bool_]


def require_threshold(result: Result, p_max: float, k: float, moments: Moments) -> None:
    """Add the threshold test P_D + kσ ≤ P_max to a result of `variance`, its verdict first.

    `probability_above` is P(P_D > P_max) in runs of the path. The result passes if the test holds
    at every pose, and on a path also between the poses.

    Args:
        result: The result of `variance`.
        p_max: P_max, greater than 0 and at most 1.
        k: k, greater than 0.
        moments: Moments of the scenario by the method, with bounds at Φ(k).
    """
    scenario, method = result.scenario, result.method
    tested = _tested(scenario, method, p_max, k, moments)
    rows, test = tested.path.rows, tested.test
    column = f"upper_{k:.12g}sigma"
    for name, values, meaning in (
        (column, p_max - test.margin, f"Upper bound of P_D at {k:g} sigma."),
        ("margin", test.margin, "P_MAX minus the upper bound of P_D."),
        ("violated", test.violated.astype(float), "1 where the test is violated, else 0."),
        ("not_known", test.unknown.astype(float), "1 where the test has no answer, else 0."),
        (
            "probability_above",
            tested.decision.runs.probability,
            "Share of the runs of the path with P_D above P_MAX.",
        ),
    ):
        result.table.add(name, values[rows], meaning)
    result.summary["threshold"] = _summary(tested, column, k)
    result.report[:0] = _report(tested, method, k)
    result.passed = test.passed


def _tested(scenario: Scenario, method: str, p_max: float, k: float, moments: Moments) -> _PathTest:
    def propagate(path_scenario: Scenario) -> Moments:
        return propagate_scenario(path_scenario, method=method, beta=k)

    path = refinement.resolve(scenario, propagate, p_max, moments)
    moments = path.moments
    decision = decide(path.scenario, p_max, k)
    upper, by_draws = moments.upper.copy(), moments.error > 0
    certain = moments.p_d > p_max
    if method == AUTOMATIC:
        # FORM may be on the other side of the limit within its tolerance
        sides = (decision.holds & (upper > p_max)) | (decision.violated & ~(upper > p_max))
        upper[sides], by_draws = decision.upper[sides], by_draws | sides
        violated, unknown = decision.violated, ~(decision.holds | decision.violated)
    else:
        exceeds = upper > p_max
        violated, unknown = exceeds & decision.violated, ~exceeds & ~decision.holds
        unknown |= (exceeds & ~decision.violated) | np.isnan(upper)
    unknown = unknown | (not path.resolved)
    test = threshold_test(
        upper,
        p_max,
        path.scenario.geometry.coordinate,
        violated=violated | certain,
        unknown=unknown,
    )
    return _PathTest(path, test, decision, by_draws)


def _unit(scenario: Scenario) -> str:
    """Return the unit of the coordinate of `refinement`."""
    return scenario.axis.unit if scenario.time_s is None else "s"


def _summary(tested: _PathTest, column: str, k: float) -> dict[str, Any]:
    test, axis, runs = tested.test, tested.path.scenario.axis, tested.decision.runs
    unit = _unit(tested.path.scenario)
    highest = int(np.argmax(runs.counts))

    def place(pose: int) -> dict[str, float]:
        return {axis.key: float(axis.values[pose])}

    summary: dict[str, Any] = {
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
        "poses_decided_by_draws": int(np.count_nonzero(tested.by_draws)),
        "probability_of_false_holds": 2.0 * CHANCE,
        "p_d_itself_above": bool(np.any(tested.path.moments.p_d > test.p_max)),
        f"above_{unit}": test.above,
        f"total_{unit}": test.total,
        "share_above": _share(test),
        "first_violation": None if test.first is None else place(test.first),
        "worst_margin": {"value": float(test.margin[test.worst]), **place(test.worst)},
        "highest_probability_above": {
            "value": float(runs.probability[highest]),
            "standard_error": runs.error(int(runs.counts[highest])),
            **place(highest),
        },
        "runs": runs.runs,
    }
    if runs.anywhere is not None:
        summary["probability_above_at_any_pose"] = {
            "value": runs.anywhere / runs.runs,
            "standard_error": runs.error(runs.anywhere),
            "runs": runs.runs,
        }
    if runs.time is not None:
        summary["mean_time_above_s"] = {"value": runs.time, "standard_error": runs.time_error}
    return summary


def _share(test: ThresholdTest) -> float:
    return test.above / test.total if test.total > 0 else float(not test.passed)


def _report(tested: _PathTest, method: str, k: float) -> list[str]:
    test, scenario = tested.test, tested.path.scenario
    axis = scenario.axis
    lines = [f"{_verdict(tested)}: P_D + {k:g} sigma <= {test.p_max:g}"]
    if test.violated.any() and test.unknown.any():
        lines += [f"not known {describe_poses(test.unknown, axis)}"]
    if test.unknown.any():
        lines += [_remedy(tested, method)]
    without = np.isnan(test.margin)
    if not without.all():
        lines += [_worst(tested, k)]
    if test.first is not None and not without.all():
        unit = _unit(scenario)
        lines += [
            f"the bound is above {test.p_max:g} for {test.above:.4g} of {test.total:.6g} {unit} "
            f"({_share(test):.1%}), first at {axis.at(test.first)}"
        ]
    lines += _probability_lines(tested)
    if test.violated.any():
        lines += [_why(tested, k)]
    return [*lines, *_trust(tested, method)]


def _verdict(tested: _PathTest) -> str:
    test, axis = tested.test, tested.path.scenario.axis
    if test.violated.any():
        return f"VIOLATED {describe_poses(test.violated, axis)}"
    if test.unknown.any():
        return f"NOT KNOWN {describe_poses(test.unknown, axis)}"
    return "holds at every pose" + (" and between them" if tested.path.added else "")


def _worst(tested: _PathTest, k: float) -> str:
    """Return P_D and its band at the pose of the least margin."""
    test, moments = tested.test, tested.path.moments
    pose = int(np.nanargmin(test.margin))
    return (
        f"at the worst pose, {tested.path.scenario.axis.at(pose)}: P_D {moments.p_d[pose]:.4f}, "
        f"between {moments.lower[pose]:.4f} and {test.p_max - test.margin[pose]:.4f} "
        f"({k:g} sigma)"
    )


def _remedy(tested: _PathTest, method: str) -> str:
    """Return the reason why the test has no answer, and the remedy."""
    if not tested.path.resolved:
        return f"  {refinement.unresolved(tested.path)}"
    runs = tested.decision.runs
    if method != AUTOMATIC:
        return (
            f"  {method} and draws disagree there, or draws do not decide: use --method automatic"
        )
    if runs.runs < tested.decision.wanted:
        wanted = f"{tested.decision.wanted:,}"
        return f"  {wanted} runs of the path would be needed: use a smaller --k, or fewer poses"
    return "  the bound is too near to the threshold for draws to decide"


def _why(tested: _PathTest, k: float) -> str:
    """Return whether P_D itself is above P_max, or only its bound."""
    test, axis, p_d = tested.test, tested.path.scenario.axis, tested.path.moments.p_d
    place = describe_poses(p_d > test.p_max, axis)
    if place:
        return f"P_D itself is above {test.p_max:g} {place}: no better knowledge helps there"
    return (
        f"P_D itself stays below: {np.nanmax(p_d):.4f} at most. To hold, know better: budget "
        f"--threshold {test.p_max:g} --k {k:g}"
    )


def _probability_lines(tested: _PathTest) -> list[str]:
    axis, runs = tested.path.scenario.axis, tested.decision.runs
    highest = int(np.argmax(runs.counts))
    count = int(runs.counts[highest])
    limit = f"P(P_D > {tested.test.p_max:g})"
    if not count and not runs.anywhere:
        return [f"{limit}: in none of {runs.runs:,} runs"]
    line = (
        f"{limit}: {_number(count / runs.runs)} +/- {runs.error(count):.1g} at "
        f"{axis.at(highest)}, where it is highest"
    )
    if len(axis) == 1:
        return [line]
    if runs.anywhere is None:
        return [line, "P anywhere on an orbit with correlated errors needs times: use a path"]
    line += (
        f"; {_number(runs.anywhere / runs.runs)} +/- {runs.error(runs.anywhere):.1g} anywhere "
        f"({runs.runs:,} runs, {_correlation(tested.path.scenario)})"
    )
    return [line]


def _number(probability: float) -> str:
    return f"{probability:.4f}" if probability >= 1e-3 or probability == 0 else f"{probability:.1e}"


def _correlation(scenario: Scenario) -> str:
    """Describe the correlation of the aircraft errors from pose to pose."""
    if not scenario.correlation_s or scenario.time_s is None:
        return f"errors of the aircraft independent at {len(scenario.axis)} poses"
    return f"errors of the aircraft correlated over {scenario.correlation_s:g} s"


def _trust(tested: _PathTest, method: str) -> list[str]:
    """Return how the bounds were computed and checked, and at which poses."""
    scenario, path = tested.path.scenario, tested.path
    count = len(scenario.axis)
    line = f"method: {method}, checked by draws at {count} poses"
    if tested.by_draws.any():
        line += f"; draws replace form at {np.count_nonzero(tested.by_draws)}"
    if tested.test.passed:
        line += f'; a false "holds" has a probability of {2 * CHANCE:.1%} at most'
    if path.tolerance is not None:
        given = "the azimuths given" if scenario.time_s is None else "the rows of the path"
        return [line, f"{path.added} of the poses are between {given}"]
    geometry = scenario.geometry
    if isinstance(geometry, Path) and geometry.step_s is not None:
        return [line, f"tested every {geometry.step_s:g} s, the step of geometry.interpolate"]
    return [line]
