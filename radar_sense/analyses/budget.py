"""Error budget: 3 sigma of P_D from each source alone."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace
from functools import partial

import numpy as np

from radar_sense import options, plotting, words
from radar_sense.analyses.required import OPTIONS, required_accuracy
from radar_sense.analyses.verdict import requirement
from radar_sense.command import Figure, Result, command
from radar_sense.propagation import MONTE_CARLO, std_off_in_scenario
from radar_sense.scenario import Scenario
from radar_sense.source_names import FURTHER
from radar_sense.sources import TIE, Budget, Contribution, error_budget, worth_most

#: Half the deviation of a part must reduce the total by this part, to be worth a measurement.
LEAST_GAIN = 0.01
#: A line below this part of the total lies on the axis, and is left out of a figure of many lines.
VISIBLE, MANY = 0.01, 6


@command(
    options.LEVEL,
    options.ONE_RADAR,
    replace(options.METHOD, help=f"{options.METHOD.help} montecarlo gives Sobol' indices."),
    *OPTIONS,
    replace(options.NUMBER_OF_RUNS, help="Number of runs of --method montecarlo."),
    options.SEED_OF_DRAWS,
    examples=(
        "radar-sense budget",
        "radar-sense budget my.yaml --level low --no-plot",
        "radar-sense budget my.yaml --target 0.05",
        "radar-sense budget my.yaml --threshold 0.8",
        "radar-sense budget my.yaml --at-least 0.2",
        "radar-sense budget my.yaml --method montecarlo --runs 4096",
        "radar-sense budget network.yaml --radar ridge",
    ),
)
def budget(
    scenario: Scenario,
    *,
    target: float | None = None,
    threshold: float | None = None,
    at_least: float | None = None,
    k: float | None = None,
    probability: float | None = None,
    at: float | None = None,
) -> Result:
    """Error budget: 3 sigma of P_D from each source alone.

    The method montecarlo gives Sobol' indices.
    """
    axis, method, result = scenario.axis, scenario.method, Result(scenario)
    given = None if at is None else axis.pose_at(at)
    asked = requirement(threshold, k, probability, at_least)
    needed, numbers = required_accuracy(scenario, asked, target, at)
    result.report += needed
    found = replace(error_budget(scenario, method), chosen=given)
    sources, parts, finer = (kind.values() for kind in (found.sources, found.parts, found.finer))
    total, interaction, pose = found.total, found.interaction, found.pose
    at_pose = float(total.three_sigma[pose])

    def add(kind: str, contributions: Iterable[Contribution], meaning: str) -> None:
        for c in contributions:
            if getattr(c, kind) is not None:
                result.table.add(f"{kind}_{c.name}", getattr(c, kind), meaning.format(c=c))

    words.add_axis(result.table, axis)
    of_paper_first = sorted((*sources, total), key=lambda c: c.name in FURTHER)
    add("three_sigma", (*of_paper_first, *finer), "3 sigma of P_D from {c.meaning}.")
    words.add_mean(result.table, found.mean, method)
    if method != "linear":
        add("share", (*sources, interaction), "Share of the variance of P_D from {c.meaning}.")
    meaning = "Total Sobol' index of {c.name}: its share and all its interactions."
    add("total_index", sources, meaning)
    add("share_error", (*sources, interaction, *parts), "Standard error of the share of {c.name}.")
    add("three_sigma", parts, "3 sigma of P_D from {c.meaning}.")
    add("total_index_error", sources, "Standard error of the total Sobol' index of {c.name}.")
    add("three_sigma_error", (total,), "Standard error of three_sigma_total.")

    off = std_off_in_scenario(scenario, found.mean, total.std)
    if words.probability(at_pose) == "0" and not off.any():
        known = "P_D is certain" if at_pose == 0 else "3 sigma of P_D is below 1e-6"
        result.report += [f"nothing to measure: {known}"]
    elif at_pose > 0 and "threshold" not in numbers:  # what a threshold needs is in its own rows
        result.report += _know_first(scenario, found)
    chosen = words.level_and_method(scenario)
    result.report += [f"3 sigma of P_D ({chosen}) at {axis.at(pose)}, and share of its variance:"]
    shown = [c for c in (*finer, *parts) if c.three_sigma[pose] != 0]
    ranked, below = (
        sorted(group, key=lambda c: np.nan_to_num(-c.three_sigma[pose], nan=np.inf))
        for group in (sources, shown)
    )
    rows = [row for c in ranked for row in (c, *(part for part in below if part.part_of == c.name))]
    if abs(interaction.share[pose]) >= 0.5 * TIE:  # the least that shows
        rows.append(interaction)
    width = max(21, *(len(c.label) + 2 * bool(c.part_of) + 1 for c in rows))
    noise = " (noise)" if found.interaction_is_noise(method) else ""
    result.report += [
        _row(c, pose, width) + (noise if c is interaction else "") for c in (*rows, total)
    ]
    dominates = words.places(found.dominates, axis)
    result.report += [f"{name} dominates {place}" for name, place in dominates.items()]
    valued = (*sources, *parts, *finer, total)
    gaps = words.places({c.name: ~np.isfinite(c.three_sigma) for c in valued}, axis)
    result.report += [f"{name} has no value {place}" for name, place in gaps.items()]

    vanishes = found.vanishes(scenario) if method == "linear" else {}
    where = "largest" if at is None else "pose"
    optional = {
        "no_value": gaps,
        "gradient_vanishes": words.places(vanishes, axis),
        f"radar_constant_parts_at_{where}": _at(pose, parts, "three_sigma"),
        f"shares_of_radar_constant_parts_at_{where}": _at(pose, parts, "share"),
    }
    result.summary |= {
        "largest_three_sigma_total": words.peak(total.three_sigma, axis),
        f"at_{where}": _at(pose, sources, "three_sigma"),
        f"shares_at_{where}": _at(pose, (*sources, interaction), "share"),
        "dominant": None if found.dominant is None else found.dominant.name,
        "dominates": dominates,
        **{name: value for name, value in optional.items() if value},
        **numbers,
    }
    result.warnings += words.std_warnings(scenario, total.std, off)
    result.warnings += words.table_warnings(scenario)
    if method == "linear":  # other methods report the interaction
        # where σ of all sources is not off, the source that first order misses is small
        missed = {name: mask & off for name, mask in vanishes.items()}
        result.warnings += words.vanishing_gradient(words.places(missed, axis))
        three_sigma = [c.three_sigma for c in sources]
        result.warnings += words.correlated_sources(three_sigma, total.three_sigma)
    if method != MONTE_CARLO:
        words.add_trust(result, "sigma ")
    result.draw = partial(_draw, result=result, found=found)
    return result


def _at(pose: int, contributions: Iterable[Contribution], kind: str) -> dict[str, float]:
    """Return the values at a pose by name, without the common prefix of a single radar's parts."""
    return {
        c.name.removeprefix("radar_constant_") if c.part_of else c.name: float(
            getattr(c, kind)[pose]
        )
        for c in contributions
    }


def _row(c: Contribution, pose: int, width: int) -> str:
    value = "" if c.name == "interaction" else words.probability(c.three_sigma[pose])
    share = "" if c.name == "total" or np.isnan(c.share[pose]) else f" {c.share[pose]:6.1%}"
    if share and c.share_error is not None:
        share += f" +/- {c.share_error[pose]:.1%}"
    if c.three_sigma_error is not None and c.three_sigma_error[pose] > 0:
        share = f" +/- {words.probability(c.three_sigma_error[pose])}"
    label = f"  {c.label}" if c.part_of else c.label
    return f"  {label:{width}}{value:6}{share}".rstrip()


def _know_first(scenario: Scenario, found: Budget) -> list[str]:
    """Return what should be known better first, where the total is largest, in a line if known."""
    pose, (first, remaining) = found.pose, worth_most(scenario, found)
    total, place = float(found.total.three_sigma[pose]), scenario.axis.at(pose)
    if words.probability(total) == "0":
        return []
    if not first:
        unknown = f"{scenario.method} has no value with half of a source at {place}"
        return [f"what to know better first is not known: {unknown}; {words.REMEDY}"]
    names, leaves = words.listed(c.name for c in first), f"leaves {words.probability(remaining)}"
    if remaining > (1.0 - LEAST_GAIN) * total:
        return [f"no source is worth a measurement: half of any one {leaves} or more at {place}"]
    share, whose = first[0].share[pose], "its deviation"
    part = "" if np.isnan(share) else f", {share:.1%} of the variance of P_D"
    if len(first) > 1:
        part, whose = " equally,", "the deviation of one"
    half = f"; half {whose} {leaves} of {words.probability(total)}"
    answer = f"know better first: {names}{part} at {place}"
    return [answer if scenario.method == MONTE_CARLO else answer + half]


def _draw(figure: Figure, result: Result, found: Budget) -> None:
    """Draw 3σ of all and of the sources, and of a single radar the parts, as thin lines."""
    model, total = result.scenario.model, found.total
    radars = model.names if len(model.radars) > 1 else ()
    sources, parts = found.sources.values(), () if radars else found.parts.values()
    style_of = plotting.source_styles([*found.sources], radars)
    tops = {c.name: np.max(c.three_sigma, initial=0.0) for c in (*sources, *parts, total)}
    least = VISIBLE * np.nanmax(total.three_sigma, initial=0.0) if len(tops) > MANY else 0.0
    seen = {name for name, top in tops.items() if not top < least}  # a gap is not small
    unseen = [_in_words(c, radars) for c in (*sources, *parts) if c.name not in seen]
    if unseen:
        text = f"below {VISIBLE:.0%} of the total: {', '.join(unseen)}"
        plotting.add_small_print(figure, text)
    (axes,), x = plotting.pose_panels(figure, 1, result.scenario.axis)
    for c in (c for c in sources if c.name in seen):
        plotting.draw_line(axes, x, c.three_sigma, style_of[c.name], label=_in_words(c, radars))
    thin = {"lw": plotting.points(0.6)}
    for i, c in enumerate(c for c in parts if c.name in seen):
        style = style_of[c.part_of][0], plotting.LINES[i % len(plotting.LINES)][1]
        plotting.draw_line(axes, x, c.three_sigma, style, label=_in_words(c, radars), **thin)
    # the total is under the line of a source that may be all of it
    under = {"lw": plotting.points(2.2), "zorder": 1.8} if radars or parts else {}
    plotting.draw_line(axes, x, total.three_sigma, ("black", "-"), label="total", **under)
    plotting.finish(figure, axes, r"$3\,\sigma$ of $P_D$")


def _in_words(c: Contribution, radars: Collection[str]) -> str:
    """Return a source in words. A part of the constant is its parameter with the unit."""
    if c.part_of:
        return plotting.key_in_words(c.label)
    return c.name if c.name in radars else c.name.replace("_", " ")
