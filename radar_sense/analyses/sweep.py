"""Largest P_D, its band and the verdict of a threshold, by the value of one key of the scenario."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from functools import partial

import numpy as np

from radar_sense import options, plotting, words
from radar_sense.acceptance import refinement
from radar_sense.acceptance.requirement import Requirement
from radar_sense.acceptance.threshold import PathTest, path_test
from radar_sense.analyses.verdict import (
    beyond_in_words,
    condition,
    draw_limit,
    highest_in_words,
    requirement,
    side,
    worst_band,
)
from radar_sense.axis import Axis, steps, widest_of_highest
from radar_sense.command import Figure, Option, Result, command
from radar_sense.cost import RATE, foresee
from radar_sense.errors import InputError
from radar_sense.limits import ANY
from radar_sense.plausibility import plausibility_warnings
from radar_sense.progress import report
from radar_sense.propagation import propagate_scenario
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray
from radar_sense.units import ascii_unit, unit_name

#: Most values, and most of them that the terminal shows.
MAX_VALUES, SHOWN = 1000, 40


@command(
    Option("key", "Key of the scenario file.", metavar="KEY", positional=True),
    Option("start", "First value.", ANY, metavar="START", positional=True),
    Option("stop", "Last value.", ANY, metavar="STOP", positional=True),
    Option("step", "Step from value to value.", ANY, metavar="STEP", positional=True),
    options.LEVEL,
    options.ONE_RADAR,
    options.METHOD,
    replace(
        options.THRESHOLD,
        help="Test P_D + K sigma <= P_MAX at every value; exit code 3 if at none.",
    ),
    replace(
        options.AT_LEAST, help="Test P_D - K sigma >= P_MIN at every value; exit code 3 if at none."
    ),
    options.K,
    options.PROBABILITY,
    examples=(
        "radar-sense sweep radar.constant 50 250 25",
        "radar-sense sweep my.yaml geometry.down_km -12 -1 0.5 --threshold 0.1",
        "radar-sense sweep network.yaml radars.ridge.p_fa 1e-8 1e-6 1e-7",
    ),
    varies=True,
)
def sweep(
    scenario: Scenario,
    *,
    key: str,
    start: float,
    stop: float,
    step: float,
    threshold: float | None = None,
    at_least: float | None = None,
    k: float | None = None,
    probability: float | None = None,
) -> Result:
    """Largest P_D and its band by the value of one key of the scenario.

    KEY is the path of a number in the scenario file, such as radar.constant, geometry.range_km,
    uncertainty.radar.medium.position_m or radars.NAME.p_fa. With a threshold the answer is where
    the test P_D + K sigma <= P_MAX holds. With --at-least it is where P_D - K sigma >= P_MIN holds,
    and the smallest P_D counts. Exit code 3 means that the test holds at none of the values.
    """
    try:
        values = steps(start, stop, step, MAX_VALUES)
    except InputError as error:
        raise InputError(f"step {error}") from error
    required = requirement(threshold, k, probability, at_least)
    k, limit = (k or 3.0, None) if required is None else (required.k, required.limit)
    column = re.sub("[^A-Za-z0-9_]+", "_", key).strip("_")
    axis = Axis(column, key, ascii_unit(key), values, ".12g", 0.0, "values", f"Value of {key}.")
    # all values are read before any is computed
    scenarios = [scenario.with_keys({key: f"{value:.12g}"}) for value in values]

    result = Result(scenario)
    sign, end = (1.0, "upper") if at_least is None else (-1.0, "lower")
    most, largest = ("highest", "largest") if at_least is None else ("lowest", "smallest")
    extremes, tests, found = [], [], []
    started = time.process_time()
    for done, (one, value) in enumerate(zip(scenarios, values, strict=True)):
        report("values", done, len(values))
        moments = propagate_scenario(one, beta=k, p_max=limit)
        pose = widest_of_highest(sign * moments.p_d, moments.upper - moments.lower)
        ends = (moments.p_d[pose], moments.lower[pose], moments.upper[pose])
        # of the poses that have a value
        bound, std = (words.peak(of, one.axis)["value"] for of in (moments.upper, moments.std))
        if required is not None:  # also between the rows of a path
            tests.append(path_test(one, required, moments))
            bound = tests[-1].bound[tests[-1].worst]
        extremes.append((*ends, bound, 3.0 * std))
        for text in (
            *plausibility_warnings(one),
            *words.validity_warnings(one, moments, k),
            *words.table_warnings(one),
        ):
            found.append((axis.format(value), text))
        if not done:
            # The first value tells: how many poses and draws a test takes is not known before.
            rest = (len(values) - 1) * (time.process_time() - started)
            what = "the values after the first, if they are like it,"
            foresee(what, rest * RATE, less="fewer values")
    p_d, lower, upper, bounds, three_sigma = np.array(extremes).T

    # the column of an entry of a list ends with the number of the entry, and not with the unit
    add = result.table.add
    add(column, values, axis.meaning, unit_name(key))
    add(f"{most}_p_d", p_d, f"{largest.capitalize()} P_D of all poses.")
    add("lower", lower, f"Lower bound of the {largest} P_D at {k:g} sigma.")
    add("upper", upper, f"Upper bound of the {largest} P_D at {k:g} sigma.")
    meaning = f"{largest.capitalize()} {end} bound of P_D at {k:g} sigma, at any pose."
    add(f"{most}_{end}", bounds, meaning)
    add("largest_three_sigma", three_sigma, "Largest 3 sigma of P_D of all poses.")
    result.summary["largest_three_sigma"] = words.peak(three_sigma, axis)
    bands = [words.describe_band(*ends[:3], k) for ends in extremes]
    if tests:
        bands = _add_tests(result, axis, tests)
    else:
        low, high = words.trough(p_d, axis), words.peak(p_d, axis)
        result.summary |= {"lowest_p_d": low, "highest_p_d": high}
        result.report.append(f"by {key} the largest {words.describe_span(p_d, axis)}")
    numbers = [one for name, one in result.table.items() if name != column]
    if len(values) > 1 and all(np.array_equal(n[1:], n[:-1], equal_nan=True) for n in numbers):
        result.report.append(f"{key} changes none of these numbers at the level {scenario.level}")
    if len(values) <= SHOWN:
        result.report += words.rows(zip(map(axis.format, values), bands, strict=True))
    result.warnings += words.gathered(found)
    lines = (p_d, lower, upper, bounds)
    result.draw = partial(_draw, axis=axis, lines=lines, largest=largest, required=required, k=k)
    return result


def _add_tests(result: Result, axis: Axis, tests: list[PathTest]) -> list[str]:
    """Add the verdicts, and return the lines of the values: P_D at the worst pose, and verdict."""
    required, values = tests[0].requirement, axis.values
    verdicts = np.array([tested.verdict for tested in tests])
    holds, violated = verdicts == "holds", verdicts == "violated"
    unknown = ~holds & ~violated
    margin = np.array([tested.margin[tested.worst] for tested in tests])
    highest = np.array([tested.decision.probability.max() for tested in tests])
    add = result.table.add
    add("margin", margin, "How far the bound is within the limit.")
    add("violated", violated.astype(float), "1 where the test is violated at a pose, else 0.")
    add("not_known", unknown.astype(float), "1 where the test has no answer, else 0.")
    meaning = "Largest probability of P_D beyond the limit at a pose."
    add(f"probability_{side(required)}", highest, meaning)
    masks = {"holds": holds, "VIOLATED": violated, "NOT KNOWN": unknown}
    result.report += [f"{condition(required)} by {axis.name}:"]
    result.report += [f"{word} {place}" for word, place in words.places(masks, axis).items()]
    result.summary["threshold"] = {
        **required.numbers,
        "holds": values[holds].tolist(),
        "violated": values[violated].tolist(),
        "not_known": values[unknown].tolist(),
    }
    result.passed = bool(holds.any())
    lines = []
    for tested in tests:
        chance = f"highest {beyond_in_words(required)} {highest_in_words(tested)}"
        if not tested.path.resolved:
            chance = refinement.unresolved()
        worst = tested.path.scenario.axis.at(tested.worst)
        lines.append(f"{worst_band(tested)} at {worst}, {chance}  {tested.verdict}")
    return lines


def _draw(
    figure: Figure,
    axis: Axis,
    lines: tuple[FloatArray, ...],
    largest: str,
    required: Requirement | None,
    k: float,
) -> None:
    """Draw the extreme P_D with its band, the extreme bound of any pose, and the threshold."""
    p_d, lower, upper, bound = lines
    (axes,), x = plotting.pose_panels(figure, 1, axis)
    dots = {"marker": "o", "ms": plotting.points(1.8)} if len(x) <= SHOWN else {}
    plotting.draw_line(axes, x, p_d, ("black", "-"), label=rf"{largest} $P_D$", **dots)
    plotting.draw_fill(axes, x, lower, upper, color=plotting.BAND[0], alpha=0.18, lw=0)
    plotting.draw_band(axes, x, lower, upper, rf"its band of ${k:.4g}\,\sigma$")
    if np.any((bound > upper) | (bound < lower)):
        plotting.draw_line(axes, x, bound, ("black", ":"), label=f"{largest} bound")
    if required is not None:
        draw_limit(axes, required, "--")
    axes.set_ylabel(r"Probability of detection $P_D$")
    plotting.draw_legend(figure, axes)
