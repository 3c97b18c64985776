"""The accuracy that a limit requires of each source, in words and numbers, for `budget`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from radar_sense import options, words
from radar_sense.acceptance import refinement
from radar_sense.acceptance.accuracy import P_D_ITSELF, RequiredAccuracy, required_accuracies
from radar_sense.acceptance.requirement import Requirement
from radar_sense.analyses.verdict import condition, side
from radar_sense.axis import Axis
from radar_sense.command import Option
from radar_sense.errors import InputError
from radar_sense.limits import ANY, TARGET
from radar_sense.propagation import AUTOMATIC, METHODS, MONTE_CARLO, band_of_scenario
from radar_sense.scenario import Scenario
from radar_sense.sources import sources_of

OPTIONS = (
    Option(
        "target",
        "Also the accuracy at which 3 sigma is X.",
        TARGET,
        metavar="X",
        excludes=("threshold", "at_least"),
    ),
    dataclasses.replace(
        options.THRESHOLD, help="Also the accuracy at which P_D + K sigma is P_MAX."
    ),
    dataclasses.replace(
        options.AT_LEAST, help="Also the accuracy at which P_D - K sigma is P_MIN."
    ),
    dataclasses.replace(options.K, needs=("threshold", "at_least")),
    options.PROBABILITY,
    Option(
        "at",
        "The pose looked at, and the only one of a limit: azimuth [deg], range [km], time [s] or "
        "distance [m].",
        ANY,
        metavar="X",
        default_text="that with the largest total; all for a limit",
    ),
)


def required_accuracy(
    scenario: Scenario, asked: Requirement | None, target: float | None, at: float | None
) -> tuple[list[str], dict[str, Any]]:
    """Return the largest factor on σ of each source, and of all, at which a limit holds.

    The limit is that of what is asked of P_D, or the target of 3σ. The lines of the report and the
    numbers of the record are empty without a limit.

    Raises:
        InputError: If options do not go together, or there is no such pose.
    """
    option = "target" if asked is None else "at_least" if asked.at_least else "threshold"
    limit, method = target if asked is None else asked.limit, scenario.method
    if limit is None:
        return [], {}
    if method == MONTE_CARLO:
        others = ", ".join(m for m in METHODS if m != MONTE_CARLO)
        raise InputError(f"'{option}' needs one of the methods {others}")
    goal = asked or Requirement(limit, width=True)
    chosen = scenario if at is None else scenario.at_poses(np.array([scenario.axis.pose_at(at)]))
    propagate = partial(band_of_scenario, method=method, beta=goal.k)
    poses = refinement.resolve(chosen, propagate, goal, propagate(chosen))
    if not poses.resolved:
        raise InputError(f"{refinement.unresolved()}, or one pose with 'at'")
    axis = poses.scenario.axis
    required = required_accuracies(poses.scenario, goal, method=method)

    wanted = f"3 sigma <= {limit:.12g}" if asked is None else condition(asked)
    place = "at all poses" if at is None else f"at {axis.format(at)}"
    between = f" and at {poses.added} between them" if poses.added else ""
    start = f"for {wanted} {place}{between}, "
    if required["all"].residual_from == P_D_ITSELF:
        itself = f"P_D itself is {side(goal)}, most at {axis.format(required['all'].place)}"
        lines = [f"{start}no better knowledge helps: {itself}"]
    else:
        lines = [f"{start}sigma of all sources or of one (others unchanged) must be, in % of now:"]
        lines += _rows(required, scenario, axis)
    numbers = {
        **({"three_sigma": limit} if asked is None else asked.numbers),
        "poses": len(axis),
        "poses_between_rows": poses.added,
        f"at_{axis.unit or axis.key}": at,
        "required_accuracy": _by_source(required, axis),
    }
    return lines, {"target" if asked is None else "threshold": numbers}


def _rows(required: Mapping[str, RequiredAccuracy], scenario: Scenario, axis: Axis) -> list[str]:
    """Return a line for all sources, and for each with those of its parts below it.

    What is enough alone comes before what is not.
    """
    whole_of = {name: source.part_of for name, source in sources_of(scenario).items()}
    place_of = ["all", *required].index

    def order(name: str) -> tuple[bool, int]:
        whole = whole_of.get(name) or name
        return required[whole].factor is None, place_of(whole)

    names = sorted(required, key=order)
    return words.rows(
        (
            f"  {name.removeprefix(f'{whole}_')}" if (whole := whole_of.get(name)) else name,
            in_words(required[name], axis, scenario.method),
        )
        for name in names
    )


def _by_source(required: Mapping[str, RequiredAccuracy], axis: Axis) -> dict[str, dict[str, Any]]:
    """Return the numbers of the record, with the place under the name of the axis."""
    found = {}
    for source, accuracy in required.items():
        numbers = dataclasses.asdict(accuracy)
        numbers[axis.key] = numbers.pop("place")
        numbers["unlimited"] = accuracy.factor == np.inf  # null is the factor in both cases
        found[source] = numbers
    return found


def in_words(accuracy: RequiredAccuracy, axis: Axis, method: str) -> str:
    """Describe the largest factor on the standard deviations of a source."""
    factor = accuracy.factor
    if factor is None and accuracy.known:
        source = f", from {accuracy.residual_from}" if accuracy.residual_from else ""
        place = axis.format(accuracy.place)
        about = "about " if method == AUTOMATIC else ""  # by few draws
        left = f"{about}{accuracy.residual:.4f}"
        return f"impossible alone ({left} remains at {place}{source})"
    if not factor:
        return "less than a millionth" if accuracy.known else "not known"
    if np.isinf(factor):
        return "no smaller; may grow without end" if accuracy.exceeded_at_0 else "anything"
    least = "" if accuracy.known else "at least "
    if factor >= 1:
        growth = f"{factor:.4g}"
        return "no smaller" if growth == "1" else f"no smaller; may grow {least}{growth}-fold"
    return f"{least}{100 * factor:.3g} %" + ", but not 0" * accuracy.exceeded_at_0
