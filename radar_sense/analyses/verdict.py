"""The threshold test of `variance` in words, columns and numbers of the record."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.special import ndtri

from radar_sense import words
from radar_sense.acceptance import refinement
from radar_sense.acceptance.threshold import CHANCE, PathTest, ThresholdTest, path_test
from radar_sense.command import Option, Result
from radar_sense.errors import InputError
from radar_sense.limits import ABOVE, SIGMAS
from radar_sense.limits import THRESHOLD as P_MAX
from radar_sense.propagation import AUTOMATIC, Band
from radar_sense.scenario import Scenario

#: Digits of the place from which a bound is above, of the length of a path.
DIGITS = 4

THRESHOLD = Option(
    "threshold",
    "Test P_D + K sigma <= P_MAX at every pose, on a path between poses too; exit code 3 if the "
    "test is violated or not known.",
    P_MAX,
    metavar="P_MAX",
)
K = Option("k", "Number of sigma of the band.", SIGMAS, metavar="K", default_text="3")
PROBABILITY = Option(
    "probability",
    "Largest P(P_D > P_MAX) that passes the test at a pose, in place of K: 0.01 corresponds to K "
    "2.326. Unlike with K, P_D itself may be above P_MAX.",
    ABOVE,
    metavar="P",
)


def sigmas(threshold: float | None, k: float | None, probability: float | None) -> float | None:
    """Return k, also from a probability: P_D is above its bound at kσ with a probability of Φ(−k).

    Raises:
        InputError: If both are given, or a probability without a threshold.
    """
    if probability is None:
        return k
    if threshold is None:
        raise InputError("'probability' needs 'threshold'")
    if k is not None:
        raise InputError("'k' and 'probability' exclude each other; give one of them")
    return -float(ndtri(probability))


def condition(p_max: float, k: float, probability: float | None) -> str:
    """Return the test in words."""
    if probability is None:
        return f"P_D + {k:g} sigma <= {p_max:g}"
    return f"P(P_D > {p_max:g}) <= {probability:g}"


def require_threshold(
    result: Result, p_max: float, k: float, band: Band, probability: float | None
) -> PathTest:
    """Add the threshold test P_D + kσ ≤ P_max to a result of `variance`, its verdict first.

    The band has bounds at Φ(k), and the probability is Φ(−k) if it was given in place of k. The
    result passes if the test holds at every pose, and on a path also between the poses. The test at
    all of these is returned.
    """
    tested = path_test(result.scenario, result.method, p_max, k, band, probability is None)
    rows, test = tested.path.rows, tested.test
    column = f"upper_{k:.12g}sigma"
    for name, values, meaning in (
        (column, test.upper, f"Upper bound of P_D at {k:g} sigma."),
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
    if probability is not None:
        result.summary["threshold"]["probability"] = probability
    result.report[:0] = _report(tested, k, probability)
    result.passed = test.passed
    return tested


def _unit(scenario: Scenario) -> str:
    """Return the unit of the coordinate of `refinement`."""
    return scenario.axis.unit if scenario.time_s is None else "s"


def _summary(tested: PathTest, column: str, k: float) -> dict[str, Any]:
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
        "resolved": tested.path.resolved,
        "poses_violated": int(np.count_nonzero(test.violated)),
        "poses_not_known": int(np.count_nonzero(test.unknown)),
        "poses_without_bound": int(np.count_nonzero(np.isnan(test.margin))),
        "poses_decided_by_draws": int(np.count_nonzero(tested.by_draws)),
        "probability_of_false_holds": 2.0 * CHANCE,
        "p_d_itself_above": bool(np.any(tested.path.band.p_d > test.p_max)),
        f"above_{unit}": test.above,
        f"total_{unit}": test.total,
        "share_above": _share(test),
        "first_violation": None if test.first is None else place(test.first),
        "worst_margin": {"value": float(test.margin[tested.worst]), **place(tested.worst)},
        "highest_probability_above": {
            "value": float(runs.probability[highest]),
            "standard_error": runs.error(int(runs.counts[highest])),
            **place(highest),
        },
        "runs": runs.runs,
    }
    if not tested.path.resolved:  # P_D may be above elsewhere, too
        return summary | dict.fromkeys((f"above_{unit}", "share_above"))
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


def _report(tested: PathTest, k: float, probability: float | None) -> list[str]:
    test, scenario = tested.test, tested.path.scenario
    axis = scenario.axis
    lines = [f"{_verdict(tested)}: {condition(test.p_max, k, probability)}"]
    if test.violated.any() and test.unknown.any():
        lines += [f"not known {words.describe_poses(test.unknown, axis)}"]
    if test.unknown.any() or not tested.path.resolved:
        lines += [_remedy(tested)]
    known = np.isfinite(test.margin[tested.worst])
    if known:
        lines += [f"at the worst pose, {axis.at(tested.worst)}: {worst_band(tested, k)}"]
    if known and test.total > 0 and np.isfinite(test.first_above) and tested.path.resolved:
        first = float(np.interp(test.first_above, np.arange(len(axis)), axis.values))
        first = round(first, DIGITS - math.ceil(math.log10(test.total)))
        lines += [
            f"the bound is above {test.p_max:g} for {test.above:.4g} of {test.total:.6g} "
            f"{_unit(scenario)} ({_share(test):.1%}), first at {axis.format(first)}"
        ]
    lines += _probability_lines(tested)
    if test.violated.any():
        goal = f"--k {k:g}" if probability is None else f"--probability {probability:g}"
        lines += [_why(tested, goal)]
    return [*lines, *_trust(tested)]


def _verdict(tested: PathTest) -> str:
    test, axis = tested.test, tested.path.scenario.axis
    if test.violated.any():
        return f"VIOLATED {words.describe_poses(test.violated, axis)}"
    if test.unknown.any():
        return f"NOT KNOWN {words.describe_poses(test.unknown, axis)}"
    return "holds at every pose" + (" and between them" if tested.path.added else "")


def worst_band(tested: PathTest, k: float) -> str:
    """Return P_D and its band at the worst pose; no numbers without a bound."""
    pose, band = tested.worst, tested.path.band
    return words.describe_band(band.p_d[pose], band.lower[pose], tested.test.upper[pose], k)


def _remedy(tested: PathTest) -> str:
    """Return the reason why the test has no answer, and the remedy."""
    if not tested.path.resolved:
        return f"  {refinement.unresolved()}"
    if tested.far.any():
        return "  the origin is too far for errors of attitude this large: choose a nearer one"
    runs, method = tested.decision.runs, tested.path.scenario.method
    if method != AUTOMATIC:
        return f"  {method} and draws disagree there, or draws do not decide: {words.REMEDY}"
    if runs.runs < tested.decision.wanted:
        wanted = f"{tested.decision.wanted:,}"
        return f"  {wanted} runs of the path would be needed: use a smaller --k, or test a part"
    return "  the bound is too near to the threshold for draws to decide"


def _why(tested: PathTest, goal: str) -> str:
    """Return whether P_D itself is above P_max, or only its bound."""
    test, axis, p_d = tested.test, tested.path.scenario.axis, tested.path.band.p_d
    p_d = np.where(test.violated, p_d, np.nan)
    place = words.describe_poses(p_d > test.p_max, axis)
    if place:
        return f"P_D itself is above {test.p_max:g} {place}: no better knowledge helps there"
    if not tested.path.resolved:
        return f"P_D itself stays below {test.p_max:g} at the poses tested"
    return (
        f"P_D itself stays below: {words.probability(np.nanmax(p_d))} at most. What to know "
        "better, to hold: the "
        f"command budget with --threshold {test.p_max:g} {goal}"
    )


def _probability_lines(tested: PathTest) -> list[str]:
    axis, runs = tested.path.scenario.axis, tested.decision.runs
    highest = int(np.argmax(runs.counts))
    count = int(runs.counts[highest])
    limit = f"P(P_D > {tested.test.p_max:g})"
    if not count and not runs.anywhere:
        where = "" if tested.path.resolved else ", at the poses tested"
        return [f"{limit}: in none of {runs.runs:,} runs{where}"]
    places = words.describe_poses(runs.counts == count, axis)
    line = f"{limit}: {words.probability(count / runs.runs)} +/- {runs.error(count):.1g} {places}"
    if len(axis) == 1 or not tested.path.resolved:
        return [line]
    line += ", where it is highest" if np.any(runs.counts < count) else ""
    if runs.anywhere is None:
        scenario = tested.path.scenario
        missing = [] if scenario.correlation_s else ["uncertainty.aircraft_correlation_s"]
        missing += ["a path with times"] if scenario.time_s is None else []
        return [line, f"P at some pose needs {' and '.join(missing)}"]
    line += (  # P_D of a run may be higher between two poses than at both
        f"; {words.probability(runs.anywhere / runs.runs)} +/- {runs.error(runs.anywhere):.1g} at "
        f"some pose of {len(axis)} ({runs.runs:,} runs, {_correlation(tested.path.scenario)})"
    )
    return [line]


def _correlation(scenario: Scenario) -> str:
    """Describe the correlation of the aircraft errors from pose to pose."""
    if not scenario.cov_aircraft.any():
        return "no errors of the aircraft"
    if not scenario.correlation_s or scenario.time_s is None:
        return "errors of the aircraft independent from pose to pose"
    return f"errors of the aircraft correlated over {scenario.correlation_s:g} s"


def _trust(tested: PathTest) -> list[str]:
    """Return how the bounds were computed and checked, and at which poses."""
    scenario, path = tested.path.scenario, tested.path
    line = words.checked(scenario, by_draws=int(tested.by_draws.sum()))
    if tested.test.passed:
        line += f'; a false "holds" has a probability of {2 * CHANCE:.1%} at most'
    if not path.added:
        return [line]
    given = "the rows of the path"
    if scenario.time_s is None:
        given = f"the {scenario.axis.name}s given"
    return [line, f"{path.added} of the poses {'is' if path.added == 1 else 'are'} between {given}"]
