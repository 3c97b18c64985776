"""The threshold test of `variance` in words, columns and numbers of the record."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from radar_sense import plotting, words
from radar_sense.acceptance import refinement
from radar_sense.acceptance.requirement import Requirement
from radar_sense.acceptance.threshold import CHANCE, Decision, PathTest, path_test
from radar_sense.axis import runs_of
from radar_sense.command import Axes, Result
from radar_sense.flight import Geometry
from radar_sense.montecarlo.exceedance import share_beyond
from radar_sense.propagation import AUTOMATIC, Band
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray

#: Digits, of the length of a path, of the places from which to which a bound is beyond.
DIGITS = 4


def requirement(
    threshold: float | None,
    k: float | None,
    probability: float | None,
    at_least: float | None,
) -> Requirement | None:
    """Return what the options require of P_D; None without a threshold and without P_MIN.

    A probability stands for k: P_D is beyond its bound at kσ with a probability of Φ(−k).
    """
    limit = threshold if at_least is None else at_least
    if probability is not None:
        k = -float(ndtri(probability))
    if limit is None:
        return None
    return Requirement(limit, k or 3.0, at_least is not None, probability)


def condition(required: Requirement) -> str:
    """Return the test in words."""
    if required.probability is not None:
        return f"{beyond_in_words(required)} <= {required.probability:g}"
    sign, relation = ("-", ">=") if required.at_least else ("+", "<=")
    return f"P_D {sign} {required.k:g} sigma {relation} {required.limit:.12g}"


def draw_limit(axes: Axes, required: Requirement, dashes: str) -> None:
    """Draw the limit, and name it with its value."""
    label = f"{'required $P_D$' if required.at_least else 'threshold'} {required.limit:.12g}"
    axes.axhline(required.limit, color="black", lw=plotting.points(0.8), ls=dashes, label=label)


def beyond_in_words(required: Requirement) -> str:
    """Return the probability of P_D beyond the limit, in words."""
    return f"P(P_D {'<' if required.at_least else '>'} {required.limit:.12g})"


def highest_in_words(tested: PathTest) -> str:
    """Return the highest probability of P_D beyond the limit at a pose."""
    decision = tested.decision
    if _none(decision):
        return f"in none of {decision.runs.runs:,} runs"
    value, error = decision.probability[decision.highest], decision.error[decision.highest]
    return f"{words.probability(value)} +/- {error if error >= words.LEAST else 0.0:.1g}"


def _none(decision: Decision) -> bool:
    """Return whether neither draws nor runs find P_D beyond the limit at any pose."""
    found = decision.probability.max() >= words.LEAST or decision.runs.counts.any()
    return not found


def side(required: Requirement) -> str:
    """Return on which side of the limit P_D may not be."""
    return "below" if required.at_least else "above"


def require(result: Result, required: Requirement, band: Band) -> PathTest:
    """Add the threshold test to a result of `variance`, its verdict first.

    The band has bounds at Φ(±k). The result passes if the test holds at every pose, and on a path
    also between the poses. The test at all of these is returned.
    """
    tested = path_test(result.scenario, required, band)
    rows, where = tested.path.rows, side(required)
    end, limit = ("lower", "P_MIN") if required.at_least else ("upper", "P_MAX")
    column, add = f"{end}_{required.k:.12g}sigma", result.table.add
    add(column, tested.bound[rows], f"{end.capitalize()} bound of P_D at {required.k:g} sigma.")
    add("margin", tested.margin[rows], f"How far the {end} bound of P_D is within {limit}.")
    violated, unknown = tested.violated[rows].astype(float), tested.unknown[rows].astype(float)
    add("violated", violated, "1 where the test is violated, else 0.")
    add("not_known", unknown, "1 where the test has no answer, else 0.")
    meaning = f"Probability of P_D {where} {limit}, by draws or runs of the path."
    add(f"probability_{where}", tested.decision.probability[rows], meaning)
    result.summary["threshold"] = _summary(tested, column)
    result.report[:0] = _report(tested)
    result.passed = tested.passed
    return tested


def _unit(tested: PathTest) -> str:
    """Return the unit of the length of the path; without a flight it is a number of poses."""
    scenario = tested.path.scenario
    if tested.coordinate is None:
        return "poses"
    return scenario.axis.unit if scenario.time_s is None else "s"


def _summary(tested: PathTest, column: str) -> dict[str, Any]:
    required, where = tested.requirement, side(tested.requirement)
    axis, decision = tested.path.scenario.axis, tested.decision
    unit, runs = _unit(tested), decision.runs
    highest = decision.highest

    def place(pose: int) -> dict[str, float]:
        return {axis.key: float(axis.values[pose])}

    # where P_D is not resolved it may be beyond elsewhere, too
    known = tested.path.resolved and not np.isnan(tested.margin).any()
    beyond = tested.beyond if known else None

    summary: dict[str, Any] = {
        **required.numbers,
        "bound": column,
        "verdict": tested.verdict,
        "passed": tested.passed,
        "poses": len(axis),
        "poses_between_rows": tested.path.added,
        "tolerance_between_poses": tested.path.tolerance,
        "resolved": tested.path.resolved,
        "poses_violated": int(np.count_nonzero(tested.violated)),
        "poses_not_known": int(np.count_nonzero(tested.unknown)),
        "poses_without_bound": int(np.count_nonzero(np.isnan(tested.margin))),
        "poses_decided_by_draws": int(np.count_nonzero(tested.by_draws)),
        "probability_of_false_holds": 2.0 * CHANCE,
        f"p_d_itself_{where}": bool(np.any(required.margin(tested.path.band.p_d) < 0)),
        f"{where}_{unit}": beyond,
        f"total_{unit}": tested.total,
        f"share_{where}": None if beyond is None else beyond / tested.total,
        "first_violation": None if tested.first is None else place(tested.first),
        "worst_margin": {"value": float(tested.margin[tested.worst]), **place(tested.worst)},
        f"highest_probability_{where}": {
            "value": float(decision.probability[highest]),
            "standard_error": float(decision.error[highest]),
            **place(highest),
        },
        "runs": runs.runs,
    }
    if not tested.path.resolved:
        return summary
    if decision.at_some_pose is not None:
        value, error = decision.at_some_pose
        summary[f"probability_{where}_at_any_pose"] = {
            "value": value, "standard_error": error, "runs": runs.runs,
        }  # fmt: skip
    if runs.time is not None:
        summary[f"mean_time_{where}_s"] = {"value": runs.time, "standard_error": runs.time_error}
    return summary


def _report(tested: PathTest) -> list[str]:
    scenario, required = tested.path.scenario, tested.requirement
    axis = scenario.axis
    lines = [f"{_verdict(tested)}: {condition(required)}"]
    if tested.violated.any() and tested.unknown.any():
        lines += [f"not known {words.describe_poses(tested.unknown, axis)}"]
    if tested.unknown.any() or not tested.path.resolved:
        lines += [_remedy(tested)]
    known = np.isfinite(tested.margin[tested.worst])
    if known:
        lines += [f"at the worst pose, {axis.at(tested.worst)}: {worst_band(tested)}"]
    if known and tested.beyond > 0 and tested.path.resolved and len(axis) > 1:
        beyond, about = float(f"{tested.beyond:.3g}"), "for about"
        if tested.coordinate is None:
            beyond, about = tested.beyond, "at"
        lines += [
            f"the bound is {side(required)} {required.limit:.12g} {about} {beyond:g} of "
            f"{tested.total:.6g} {_unit(tested)} ({tested.beyond / tested.total:.1%})"
        ]
    lines += _probability_lines(tested)
    if tested.violated.any():
        lines += [_why(tested)]
    return [*lines, *_trust(tested)]


def _verdict(tested: PathTest) -> str:
    geometry = tested.path.scenario.geometry
    if tested.violated.any():
        return f"VIOLATED {_beyond(tested.violated, tested.margin, geometry)}"
    if tested.unknown.any():
        return f"NOT KNOWN {words.describe_poses(tested.unknown, geometry.axis)}"
    return "holds at every pose" + (" and between them" if tested.path.added else "")


def _beyond(mask: NDArray[np.bool_], margin: FloatArray, geometry: Geometry) -> str:
    """Describe the poses of a mask, of a flight from where to where a margin (n,) is below 0.

    The margin is taken to be linear between poses, and the ends are rounded outwards.
    """
    axis, values = geometry.axis, geometry.axis.values
    if not geometry.continuous:
        return words.describe_poses(mask, axis)
    digits = DIGITS - math.ceil(math.log10(np.ptp(values) or 1.0))

    def end(pose: int, beside: int) -> float:
        """Return where the margin is 0 towards a pose beside, or the pose beside if nowhere."""
        if not (0 <= beside < len(values) and margin[pose] < 0):
            return float(values[pose])
        step = float(values[beside] - values[pose])
        way = step * float(share_beyond(margin[[pose, beside]])[0])
        outwards = math.copysign(0.5 * 10.0**-digits, way)
        place = round(float(values[pose]) + way + outwards, digits)
        return place if abs(place - values[pose]) < abs(step) else float(values[beside])

    spans = [(end(a, a - 1), end(b, b + 1)) for a, b in runs_of(mask)]
    return words.describe_poses(mask, axis, spans)


def worst_band(tested: PathTest) -> str:
    """Return P_D and its band at the worst pose; no numbers without a bound."""
    pose, band, k = tested.worst, tested.band, tested.requirement.k
    return words.describe_band(band.p_d[pose], band.lower[pose], band.upper[pose], k)


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


def _why(tested: PathTest) -> str:
    """Return whether P_D itself is beyond the limit, or only its bound."""
    required, p_d = tested.requirement, tested.path.band.p_d
    margin, limit = required.margin(p_d), f"{required.limit:.12g}"
    place = _beyond(margin < 0, margin, tested.path.scenario.geometry)
    itself = f"P_D itself is {side(required)} {limit} {place}"
    goal = f"--k {required.k:g}"
    if place and (required.probability is None or tested.path.scenario.states().certain):
        return f"{itself}: no better knowledge helps there"
    if required.probability is not None:
        goal = f"--probability {required.probability:g}"
    stays = "above" if required.at_least else "below"
    if not tested.path.resolved:
        return itself if place else f"P_D itself stays {stays} {limit} at the poses tested"
    most, option = ("least", "at-least") if required.at_least else ("most", "threshold")
    if not place:
        nearest = words.probability(p_d[np.nanargmin(margin)])
        itself = f"P_D itself stays {stays}: {nearest} at {most}"
    return (
        f"{itself}. What to know better, to hold: the command budget with --{option} {limit} {goal}"
    )


def _probability_lines(tested: PathTest) -> list[str]:
    axis, decision, runs = tested.path.scenario.axis, tested.decision, tested.decision.runs
    line = f"{beyond_in_words(tested.requirement)}: {highest_in_words(tested)}"
    if _none(decision):
        return [line if tested.path.resolved else f"{line}, at the poses tested"]
    alike = decision.probability == decision.probability[decision.highest]
    line += f" {words.describe_poses(alike, axis)}"
    if len(axis) == 1 or not tested.path.resolved:
        return [line]
    line += "" if alike.all() else ", where it is highest"
    if decision.at_some_pose is None:
        scenario = tested.path.scenario
        key = "uncertainty.aircraft_correlation_s (in Python Scenario.correlation_s)"
        missing = [] if scenario.correlation_s else [key]
        missing += ["a path with times"] if scenario.time_s is None else []
        return [line, f"P at some pose needs {' and '.join(missing)}"]
    value, error = decision.at_some_pose
    line += (  # P_D of a run may be higher between two poses than at both
        f"; {words.probability(value)} +/- {error:.1g} at some pose of {len(axis)} "
        f"({runs.runs:,} runs, {_correlation(tested.path.scenario)})"
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
    if tested.passed:
        line += f'; a false "holds" has a probability of {2 * CHANCE:.1%} at most'
    if not path.added:
        return [line]
    given = "the rows of the path"
    if scenario.time_s is None:
        given = f"the {scenario.axis.name}s given"
    between = f"{path.added} of the poses {'is' if path.added == 1 else 'are'} between {given}"
    return [line, f"{between}; what follows is of {given} alone"]
