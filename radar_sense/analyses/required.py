"""The accuracy that a limit requires of each source, in words and numbers, for `budget`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from radar_sense import words
from radar_sense.acceptance import refinement
from radar_sense.accuracy import P_D_ITSELF, RequiredAccuracy, only_at, required_accuracies
from radar_sense.analyses.verdict import PROBABILITY, THRESHOLD, K, condition
from radar_sense.axis import Axis
from radar_sense.command import Option, Result
from radar_sense.errors import InputError
from radar_sense.limits import ANY, TARGET
from radar_sense.propagation import METHODS, MONTE_CARLO, band_of_scenario
from radar_sense.sources import sources_of

OPTIONS = (
    Option("target", "Also the accuracy at which 3 sigma is X.", TARGET, metavar="X"),
    dataclasses.replace(THRESHOLD, help="Also the accuracy at which P_D + K sigma is P_MAX."),
    dataclasses.replace(K, help="Number of sigma of --threshold."),
    PROBABILITY,
    Option(
        "at",
        "The only pose for --target or --threshold: azimuth [deg], time [s] or distance [m].",
        ANY,
        metavar="X",
        default_text="all",
    ),
)


def check_options(
    method: str, target: float | None, threshold: float | None, k: float | None, at: float | None
) -> None:
    """Raise InputError if options do not go together."""
    if target is not None and threshold is not None:
        raise InputError("'target' and 'threshold' exclude each other; give one of them")
    if target is None and threshold is None and at is not None:
        raise InputError("'at' needs 'target' or 'threshold'")
    if threshold is None and k is not None:
        raise InputError("'k' needs 'threshold'")
    if method == MONTE_CARLO and (target, threshold) != (None, None):
        name = "target" if threshold is None else "threshold"
        others = ", ".join(m for m in METHODS if m != MONTE_CARLO)
        raise InputError(f"'{name}' needs one of the methods {others}")


def add_required_accuracy(
    result: Result,
    *,
    target: float | None,
    threshold: float | None,
    k: float | None,
    probability: float | None,
    at: float | None,
) -> None:
    """Add the largest factor on σ of each source, and of all, at which a limit holds."""
    limit = target if threshold is None else threshold
    if limit is None:
        return
    scenario, method = result.scenario, result.method
    sigmas = None if threshold is None else 3.0 if k is None else k
    chosen = scenario if at is None else only_at(scenario, at)
    propagate = partial(band_of_scenario, method=method, beta=sigmas or 3.0)
    poses = refinement.resolve(chosen, propagate, limit)
    if not poses.resolved:
        raise InputError(f"{refinement.unresolved()}, or one pose with 'at'")
    axis = poses.scenario.axis
    required = required_accuracies(poses.scenario, limit, k=sigmas, method=method)

    goal = f"3 sigma <= {limit:g}" if sigmas is None else condition(limit, sigmas, probability)
    place = "at all poses" if at is None else f"at {axis.format(at)}"
    between = f" and at {poses.added} between them" if poses.added else ""
    result.report += [
        f"for {goal} {place}{between}, sigma of one source (others unchanged) or of all must be:"
    ]
    whole_of = {name: source.part_of for name, source in sources_of(scenario).items()}
    place_of = [*required].index
    names = sorted(required, key=lambda name: place_of(whole_of.get(name) or name))
    if required["all"].residual_from == P_D_ITSELF:
        names = ["all"]
    result.report += words.rows(
        (
            f"  {name.removeprefix(f'{whole}_')}" if (whole := whole_of.get(name)) else name,
            in_words(required[name], axis),
        )
        for name in names
    )
    result.summary["target" if sigmas is None else "threshold"] = {
        **({"three_sigma": limit} if sigmas is None else {"p_max": limit, "k": sigmas}),
        "poses": len(axis),
        "poses_between_rows": poses.added,
        f"at_{axis.unit}": at,
        "required_accuracy": _by_source(required, axis),
    }


def _by_source(required: Mapping[str, RequiredAccuracy], axis: Axis) -> dict[str, dict[str, Any]]:
    """Return the numbers of the record, with the place under the name of the axis."""
    found = {}
    for source, accuracy in required.items():
        numbers = dataclasses.asdict(accuracy)
        numbers[axis.key] = numbers.pop("place")
        numbers["unlimited"] = accuracy.factor == np.inf  # null is the factor in both cases
        found[source] = numbers
    return found


def in_words(accuracy: RequiredAccuracy, axis: Axis) -> str:
    """Describe the largest factor on the standard deviations of a source."""
    factor = accuracy.factor
    if factor is None and accuracy.known:
        place, source = axis.format(accuracy.place), accuracy.residual_from
        if source == P_D_ITSELF:
            return f"impossible: P_D itself is above at {place}, no better knowledge helps"
        shown = f", from {source}" if source else ""
        return f"impossible alone ({accuracy.residual:.4f} remains at {place}{shown})"
    if not factor:
        return "less than a millionth" if accuracy.known else "not known"
    if np.isinf(factor):
        return "anything"
    least = "" if accuracy.known else "at least "
    if factor >= 1:
        return f"no smaller; may grow {least}{factor:.4g}-fold"
    return f"{least}{100 * factor:.3g} %"
