"""The sections of a report: questions, answers, figures and tables. No physics."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from radar_sense.analyses.budget import accuracy_in_words
from radar_sense.analyses.contract import Result
from radar_sense.analyses.error_budget import RequiredAccuracy
from radar_sense.analyses.report import (
    describe_extreme,
    describe_poses,
    describe_span,
    listed,
    peak,
    trough,
)
from radar_sense.errors import InputError
from radar_sense.propagation import METHODS
from radar_sense.reporting.figure import Drawing
from radar_sense.reporting.html_elements import Html, code, element, items, table
from radar_sense.reporting.results import Results, first_largest
from radar_sense.reporting.scenario_words import (
    flight_table,
    levels_sentence,
    radar_table,
    scenario_sentence,
)

#: Sources with a smaller share of the variance are not split into their parts.
SPLIT = 0.01


@dataclass(frozen=True)
class Section:
    """A question and its answer.

    Attributes:
        key: Id in the page.
        question: Heading.
        answer: One or two sentences.
        body: Text, figures and tables that show the answer, in order.
        warnings: Where the answer is unreliable.
        by: Analysis of the answer, and the method; "" for no analysis.
    """

    key: str
    question: str
    answer: str
    body: tuple[Html | Drawing, ...] = ()
    warnings: tuple[str, ...] = ()
    by: str = ""


def sections(results: Results) -> tuple[Section, ...]:
    """Return the sections of a report in their order."""
    makers: tuple[Callable[[Results], Section | None], ...] = (
        _scenario,
        _detection,
        _sources,
        _methods,
        _threshold,
        _mission,
        _map,
    )
    return tuple(section for make in makers if (section := make(results)) is not None)


def _scenario(results: Results) -> Section:
    scenario = results.scenario
    return Section(
        key="scenario",
        question="Who looks at whom?",
        answer=scenario_sentence(scenario),
        body=(
            element("p", levels_sentence(scenario)),
            radar_table(scenario, results.variance.table),
            flight_table(scenario),
        ),
        warnings=results.implausible,
    )


def _detection(results: Results) -> Section:
    result = results.variance
    axis, columns = result.scenario.axis, result.table
    low, high = result.summary["lowest_p_d"], result.summary["highest_p_d"]
    worst = result.summary["largest_three_sigma"]
    answer = (
        f"{describe_span(low, high, axis)}. "
        f"P_D is least sure where 3 sigma is largest: {describe_extreme(worst, axis)}."
    )
    extremes = {
        "Lowest P_D": trough(columns["p_d"], axis),
        "Highest P_D": peak(columns["p_d"], axis),
        "Largest 3 sigma": peak(3 * columns["sigma_pd"], axis),
        "Highest upper bound": peak(columns["upper_3sigma"], axis),
    }
    rows = []
    for name, extreme in extremes.items():
        if not extreme[axis.key]:
            rows.append((name, "undefined", *[""] * 4))
            continue
        pose = axis.nearest(extreme[axis.key][0])
        three_sigma = 3 * float(columns["sigma_pd"][pose])
        rows.append(
            (
                name,
                _places(extreme[axis.key], result),
                _number(columns["p_d"][pose]),
                _number(three_sigma),
                _number(columns["lower_3sigma"][pose]),
                _number(columns["upper_3sigma"][pose]),
            )
        )
    limit = results.threshold
    return Section(
        key="p-d",
        question="How sure is the probability of detection?",
        answer=answer,
        body=(
            element(
                "p",
                "P_D is the probability that "
                + ("at least one radar detects" if _several(result) else "one look detects")
                + " the aircraft there. The band of 3 sigma shows how far P_D may be off, because "
                "positions, attitudes and radar constants are uncertain, as the scenario states.",
            ),
            Drawing(
                "figure-p-d",
                result,
                f"P_D with its 3-sigma band, by {axis.name}",
                f"{answer} The band by {result.method} goes from "
                f"{_number(trough(columns['lower_3sigma'], axis)['value'])} to "
                f"{_number(peak(columns['upper_3sigma'], axis)['value'])}.",
                "P_D, and the ends of its band of 3 sigma."
                + (" Thin lines are single radars." if _several(result) else "")
                + (f" The dotted line is the threshold, {limit['p_max']:g}." if limit else ""),
            ),
            table(
                "P_D and its band at the outermost places",
                ("", "Place", "P_D", "3σ", "Lower bound", "Upper bound"),
                rows,
            ),
            *_radars_by_themselves(result),
        ),
        warnings=results.warnings_of(result),
        by=_by(result),
    )


def _radars_by_themselves(result: Result) -> Iterator[Html]:
    by_itself = result.summary.get("largest_three_sigma_by_itself")
    if not by_itself:
        return
    axis = result.scenario.axis
    rows = []
    for name, largest in by_itself.items():
        highest = peak(result.table[f"p_d_{name}"], axis)
        rows.append(
            (
                name,
                _number(highest["value"]),
                _places(highest[axis.key], result),
                _number(largest["value"]),
                _places(largest[axis.key], result),
            )
        )
    yield table(
        "Each radar by itself",
        ("Radar", "Highest P_D", "Place", "Largest 3σ", "Place"),
        rows,
    )


def _sources(results: Results) -> Section:
    result = results.budget
    summary, axis = result.summary, result.scenario.axis
    total = result.table["three_sigma_total"]
    pose = first_largest(total)
    place, shares = axis.at(pose), summary["shares_at_largest"]
    first = summary["dominant"]
    if first is None:
        answer = (
            f"By {result.method} some source has no value at {place}, where 3 sigma is largest. "
            "Use draws: radar-sense budget --method montecarlo."
        )
    elif not total[pose] > 0:
        answer = "P_D has no uncertainty in this scenario: there is nothing to measure better."
    else:
        answer = (
            f"At {place}, where 3 sigma is largest ({_number(total[pose])}), "
            f"{shares[first]:.0%} of the variance of P_D comes from {_source(first, result)}. "
            f"Measure {_source(first, result)} better first: with half its deviation 3 sigma there "
            f"would be {_number(results.halved[first])}."
        )
        parts = dict(_parts(first, result))
        if len(parts) > 2:  # a radar of a network, with the constant and the parts of the constant
            parts.pop(f"{first}_constant", None)
        if parts:
            part = min(parts, key=lambda name: np.nan_to_num(results.halved[name], nan=np.inf))
            answer += (
                f" The most important part is {parts[part]}: with half its deviation alone "
                f"3 sigma would be {_number(results.halved[part])}."
            )
        if shares["interaction"] < -0.005:
            answer += (
                " All sources together make less variance than the sum of single sources: shares "
                f"add up to {1 - shares['interaction']:.0%}."
            )
    rows: list[tuple[str, ...]] = []
    at_largest = summary["at_largest"]
    for name in sorted(at_largest, key=lambda source: -np.nan_to_num(at_largest[source])):
        rows.append(_source_row(name, _words(name), shares[name], pose, results))
        split = shares[name] >= SPLIT
        rows += [
            _source_row(part, f"of this, {label}", math.nan, pose, results)
            for part, label in _parts(name, result)
            if split
        ]
    if abs(shares["interaction"]) > 1e-9:
        rows.append(("interaction", "", f"{shares['interaction']:.1%}", "", ""))
    rows.append(("total", _number(total[pose]), "", "", ""))
    return Section(
        key="sources",
        question="Where does the uncertainty come from, and what should be measured better first?",
        answer=answer,
        body=(
            Drawing(
                "figure-sources",
                result,
                f"3σ of P_D from each source alone, by {axis.name}",
                f"{answer} "
                + " ".join(
                    f"{_words(source)[:1].upper()}{_words(source)[1:]} is the largest line {where}."
                    for source, where in summary["dominates"].items()
                ),
                "3 sigma of P_D from each source alone, and from all sources together.",
            ),
            table(
                f"3σ of P_D at {place}, where it is largest, by source",
                (
                    "Source",
                    "3σ alone",
                    "Share of variance",
                    "3σ with half the deviation",
                    "Is the largest source",
                ),
                rows,
            ),
        ),
        warnings=results.warnings_of(result),
        by=_by(result),
    )


def _source_row(
    name: str, label: str, share: float, pose: int, results: Results
) -> tuple[str, ...]:
    result = results.budget
    return (
        label,
        _number(result.table[f"three_sigma_{name}"][pose]),
        "" if math.isnan(share) else f"{share:.1%}",
        _number(results.halved[name]),
        result.summary["dominates"].get(name, ""),
    )


def _parts(source: str, result: Result) -> Iterator[tuple[str, str]]:
    """Yield the columns of the parts of a source, with their labels."""
    if f"three_sigma_{source}_position" in result.table:  # a radar of a network
        yield f"{source}_position", "position"
        yield f"{source}_constant", "radar constant"
    for part in result.summary["lines"]["parts"]:
        if part["source"] == source:
            yield part["name"], part["label"].removeprefix(f"{source} ")


def _methods(results: Results) -> Section:
    result, other = results.comparison, results.repeated
    axis, worst = result.scenario.axis, result.summary["largest_difference"]
    runs, used = result.summary["runs"], results.variance.method
    noise = max(
        float(np.nanmax(abs(result.table[end] - other.table[end])))
        for end in ("mc_lower", "mc_upper")
    )
    by_size = sorted(METHODS, key=lambda m: np.nan_to_num(worst[m]["bounds"]["value"], nan=np.inf))
    nearest = by_size[0]
    answer = (
        f"The bounds by {used}, the method of the figure above, differ from the bounds by {runs:,} "
        f"draws by up to {describe_extreme(worst[used]['bounds'], axis)}. "
        + (
            "No method comes nearer."
            if nearest == used
            else f"The nearest is {nearest}: {describe_extreme(worst[nearest]['bounds'], axis)}."
        )
    )
    return Section(
        key="methods",
        question="How far can each method be trusted here?",
        answer=answer,
        body=(
            element(
                "p",
                f"Compared at {len(axis)} of {len(results.scenario.axis)} poses, between "
                f"{axis.number(float(axis.values[0]))} and {axis.at(-1)}. Two sets of draws "
                f"differ from each other by up to {_number(noise)}: differences of that size are "
                "noise of the draws. With more draws: ",
                code("radar-sense compare --runs 200000"),
                ". For a verdict: ",
                code("radar-sense validate"),
                ".",
            ),
            Drawing(
                "figure-methods",
                result,
                f"Bounds of P_D by every method and by draws, by {axis.name}",
                f"{answer} The lower panel shows the difference of each method from the draws.",
                "The 3-sigma bounds of P_D by every method. The grey band is by draws. Below: each "
                "bound minus the bound by draws.",
            ),
            table(
                f"Largest difference from {runs:,} draws",
                ("Method", "3σ bounds", "Place", "σ", "Place", "Mean", "Place"),
                [
                    (
                        f"{method} (used above)" if method == used else method,
                        *(
                            cell
                            for extreme in worst[method].values()
                            for cell in (
                                _number(extreme["value"]),
                                _places(extreme[axis.key], result),
                            )
                        ),
                    )
                    for method in METHODS
                ],
            ),
        ),
        warnings=results.warnings_of(result),
        by=f"compare, {runs:,} random draws at each of {len(axis)} poses, seeds "
        f"{result.scenario.seed} and {other.scenario.seed}",
    )


def _threshold(results: Results) -> Section | None:
    test = results.threshold
    if test is None:
        return None
    result = results.variance
    bound = f"P_D + {test['k']:g} sigma"
    start = f"{bound} <= {test['p_max']:g}"
    lines = [line.strip() for line in result.report]
    lines = lines[next(i for i, line in enumerate(lines) if line.startswith(start)) :]
    verdicts = {
        "holds": f"Yes: {bound} stays within {test['p_max']:g} at every pose"
        + (" and between them." if test["poses_between_rows"] else "."),
        "violated": f"No: {bound} exceeds {test['p_max']:g}, first at "
        f"{_first_place(test, result)}"
        + (
            f", and P_D itself does at {_above(test, result)} of {len(result.scenario.axis)} poses."
            if test["p_d_itself_above"]
            else "; P_D itself is within the threshold everywhere."
        ),
        "not known": f"Not known: the bound is unreliable somewhere, first at "
        f"{_first_place(test, result)}.",
    }
    return Section(
        key="threshold",
        question=f"Does P_D + {test['k']:g}σ stay within {test['p_max']:g}?",
        answer=verdicts[test["verdict"]],
        body=(
            items(lines),
            *_required(results),
        ),
        by=_by(result),
    )


def _first_place(test: Mapping[str, Any], result: Result) -> str:
    first = test["first_violation"]
    return "an unknown place" if first is None else result.scenario.axis.format(*first.values())


def _required(results: Results) -> Iterator[Html]:
    result = results.budget
    axis, asked = result.scenario.axis, result.summary["threshold"]
    accuracies = {
        name: RequiredAccuracy(
            **{("place" if key == axis.key else key): value for key, value in fields.items()}
        )
        for name, fields in asked["required_accuracy"].items()
    }
    if all(accuracy.residual_from == "P_D itself" for accuracy in accuracies.values()):
        return  # no better knowledge helps, as the lines of the test state
    helpful = sorted(accuracies, key=lambda name: accuracies[name].factor is None)
    rows = [
        (
            "all together" if name == "all" else _words(name),
            accuracy_in_words(accuracies[name], axis),
        )
        for name in helpful
    ]
    place = axis.format(asked[f"at_{axis.unit}"])
    yield table(
        f"What would keep the bound within the threshold at {place}, where the margin is least",
        ("Source", "Largest factor on the deviation, with the others unchanged"),
        rows,
    )


def _mission(results: Results) -> Section | None:
    result = results.mission
    question = "Will the flight have been detected?"
    if result is None:
        return None
    if isinstance(result, InputError):
        return _without(result, "mission", question)
    axis, detection = result.scenario.axis, result.summary["detection"]
    end = detection["at_end"]
    answer = (
        f"By the end, at {axis.at(-1)}, some look has detected the aircraft with probability "
        f"{_number(end['p'])} (3 sigma: {_number(end['lower_3sigma'])} to "
        f"{_number(end['upper_3sigma'])})."
    )
    rows = [
        (
            f"reaches {level}",
            *(
                "never" if times[key] is None else axis.format(times[key])
                for key in ("time_s", "earliest_s", "latest_s")
            ),
        )
        for level, times in detection["reaches"].items()
    ]
    radars = [
        (
            name,
            f"{alone['scan_period_s']:g} s",
            _number(alone["detection"]["at_end"]["p"]),
            _number(alone["detection"]["at_end"]["lower_3sigma"]),
            _number(alone["detection"]["at_end"]["upper_3sigma"]),
        )
        for name, alone in result.summary.get("radars", {}).items()
    ]
    return Section(
        key="mission",
        question=question,
        answer=answer,
        body=(
            element("p", f"{result.report[0]}."),
            Drawing(
                "figure-mission",
                result,
                "P_D of each look, and cumulative P_D with its band, by time",
                f"{answer} The cumulative P_D never decreases.",
                "Above: P_D of each look. Below: the probability that some look has detected the "
                "aircraft by then, with its 3-sigma band.",
            ),
            table(
                "When the cumulative P_D reaches a value",
                ("Cumulative P_D", "Nominal", "Earliest (upper bound)", "Latest (lower bound)"),
                rows,
            ),
            *(
                [
                    table(
                        "Each radar alone, at the end",
                        ("Radar", "Looks every", "Cumulative P_D", "Lower bound", "Upper bound"),
                        radars,
                    )
                ]
                if radars
                else []
            ),
        ),
        warnings=results.warnings_of(result),
        by=_by(result),
    )


def _map(results: Results) -> Section:
    result, question = results.map, "Where in the area is P_D high?"
    if isinstance(result, InputError):
        return _without(result, "map", question)
    summary = result.summary
    areas, whole = summary["area_km2_at_or_above"], summary["area_km2"]
    shares = {level: area / whole for level, area in areas.items()}
    answer = (
        "P_D is "
        + listed(f"{level} or more in {share:.0%}" for level, share in shares.items())
        + " of the area."
    )
    south, north = summary["north_km"]
    west, east = summary["east_km"]
    return Section(
        key="map",
        question=question,
        answer=answer,
        body=(
            element(
                "p",
                "In each cell the aircraft has the height, course and attitude in the title of the "
                f"figure. {result.report[-1][:1].upper()}{result.report[-1][1:]}.",
            ),
            Drawing(
                "figure-map",
                result,
                "Map of P_D around the radars and the route",
                f"{answer} The map goes from {south:.4g} to {north:.4g} km north and from "
                f"{west:.4g} to {east:.4g} km east. Triangles are radars; the line is the route.",
                "Lighter is a higher P_D. Lines are contours of P_D at 0.1, 0.5 and 0.9. Triangles "
                "are radars.",
            ),
            table(
                "Area by P_D",
                ("P_D at least", "Area [km²]", "Share"),
                [(level, f"{areas[level]:,.0f}", f"{shares[level]:.1%}") for level in areas],
            ),
        ),
        warnings=results.warnings_of(result),
        by="map",
    )


def _without(error: InputError, key: str, question: str) -> Section:
    return Section(key, question, f"There is no answer: {error}.", by=key)


def _by(result: Result) -> str:
    return f"{result.analysis}, by method {result.method}, at level {result.scenario.level}"


def _several(result: Result) -> bool:
    return len(result.scenario.model.names) > 1


def _words(source: str) -> str:
    return source.replace("_", " ")


def _source(source: str, result: Result) -> str:
    """Return a source in a sentence."""
    return f"radar {source}" if source in result.scenario.model.names else f"the {_words(source)}"


def _places(places: list[float], result: Result) -> str:
    axis = result.scenario.axis
    if not places:
        return "undefined"
    if len(places) > 3:
        mask = np.isin(axis.values, places)
        return describe_poses(mask, axis).removeprefix("at ")
    return f"{listed(map(axis.number, places))} {axis.unit}".strip()


def _number(value: float) -> str:
    """Return a probability or its deviation."""
    if math.isnan(value):
        return "undefined"
    return f"{value:.0e}" if 0 < abs(value) < 5e-5 else f"{value:.4f}"


def _above(test: Mapping[str, Any], result: Result) -> int:
    """Return the number of poses at which P_D itself is above P_max."""
    return int(np.count_nonzero(result.table["p_d"] > test["p_max"]))
