"""Error budget: 3 sigma of P_D from each source alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from radar_sense import words
from radar_sense.analyses.required import OPTIONS, add_required_accuracy, check_options
from radar_sense.analyses.verdict import sigmas
from radar_sense.axis import reached
from radar_sense.command import (
    LEVEL,
    METHOD,
    NUMBER_OF_RUNS,
    ONE_RADAR,
    SEED_OF_DRAWS,
    Result,
    command,
)
from radar_sense.propagation import AUTOMATIC, MONTE_CARLO, STD_CHANGE, std_off_in_scenario
from radar_sense.propagation.automatic import ERRORS
from radar_sense.scenario import Scenario
from radar_sense.source_names import AIRCRAFT_RCS, PARAMETERS
from radar_sense.sources import (
    Contribution,
    contributions,
    error_budget,
    value_function,
)
from radar_sense.states import FloatArray

if TYPE_CHECKING:
    from radar_sense.axis import Axis
    from radar_sense.plotting import Figure

#: The gradient for a source counts as zero where the share of the source is below VANISHING times
#: its largest share.
VANISHING = 1e-3
#: Sources that the paper does not have; their columns follow the total.
FURTHER = (AIRCRAFT_RCS, *(f"radar_{name}" for name in PARAMETERS))
#: Half the deviation of a part must reduce the total by this part, to be worth a measurement.
LEAST_GAIN = 0.01
#: A line below this part of the total lies on the axis, and is left out of a figure of many lines.
VISIBLE, MANY = 0.01, 6
#: Sources within this part of the largest are equal, as they are printed.
TIE = 1e-3


@command(
    LEVEL,
    ONE_RADAR,
    replace(METHOD, help=f"{METHOD.help} montecarlo gives Sobol' indices."),
    *OPTIONS,
    NUMBER_OF_RUNS,
    SEED_OF_DRAWS,
    examples=(
        "radar-sense budget",
        "radar-sense budget my.yaml --level low --no-plot",
        "radar-sense budget my.yaml --target 0.05",
        "radar-sense budget my.yaml --threshold 0.8",
        "radar-sense budget my.yaml --method montecarlo --runs 4096",
        "radar-sense budget network.yaml --radar ridge",
    ),
)
def budget(
    scenario: Scenario,
    *,
    target: float | None = None,
    threshold: float | None = None,
    k: float | None = None,
    probability: float | None = None,
    at: float | None = None,
) -> Result:
    """Error budget: 3 sigma of P_D from each source alone.

    The method montecarlo gives Sobol' indices.

    Args:
        scenario: The scenario.
        target: Limit of 3σ, for the accuracy required of each source; None for no limit.
        threshold: Limit of P_D + kσ, for the accuracy required of each source; None for no limit.
        k: k of the threshold, 3 by default.
        probability: P(P_D > P_max) that is allowed, in place of k.
        at: Place on the scenario's axis of the only pose that counts for target or threshold;
            every pose if None.

    Raises:
        InputError: If there is no such pose, or options do not go together.
    """
    method = scenario.method
    k = sigmas(threshold, k, probability)
    check_options(method, target, threshold, k, at)
    axis, result = scenario.axis, Result(scenario, method)
    found = error_budget(scenario, method)
    by_name = contributions(scenario, found)
    sources, parts = ([by_name[name] for name in group] for group in (found.alone, found.parts))
    total, interaction = 3 * found.std, found.shares()["interaction"]
    pose = int(np.argmax(reached(total)))  # the first of those that are equal to rounding

    words.add_axis(result.table, axis)
    add, errors = result.table.add, found.share_error or {}
    first = [name for name in found.alone if name not in FURTHER]
    further = [name for name in found.alone if name in FURTHER]
    for name in (*first, "total", *further, *found.finer):
        values = total if name == "total" else by_name[name].three_sigma
        add(f"three_sigma_{name}", values, f"3 sigma of P_D from {_source(name)}.")
    words.add_mean(result.table, found.mean, method)
    for name, share in found.shares().items() if method != "linear" else ():
        add(f"share_{name}", share, f"Share of the variance of P_D from {_source(name)}.")
    for name, index in (found.total_index or {}).items():
        meaning = f"Total Sobol' index of {name}: its share and all its interactions."
        add(f"total_index_{name}", index, meaning)
    for name, error in errors.items():
        add(f"share_error_{name}", error, f"Standard error of the share of {name}.")
    for c in parts:
        add(f"three_sigma_{c.name}", c.three_sigma, f"3 sigma of P_D from {c.name} alone.")

    ranked = sorted(sources, key=lambda c: _last_if_unknown(c, pose))
    largest = np.argmax([c.three_sigma for c in sources], axis=0)
    known = np.isfinite([*(c.three_sigma for c in sources), total]).all(axis=0) & (total > 0)
    dominates = words.places({c.name: (largest == i) & known for i, c in enumerate(sources)}, axis)
    everything = {name: c.three_sigma for name, c in by_name.items()} | {"total": total}
    gaps = words.places({name: ~np.isfinite(v) for name, v in everything.items()}, axis)
    result.report += _measure_first(scenario, method, ranked, parts, pose, total[pose])
    chosen = words.level_and_method(scenario.level, method)
    result.report += [f"3 sigma of P_D ({chosen}) at {axis.at(pose)}, and share of its variance:"]
    below = sorted(by_name.values(), key=lambda c: _last_if_unknown(c, pose))
    rows = [row for c in ranked for row in (c, *(part for part in below if part.part_of == c.name))]
    width = max(21, *(len(c.label) + 2 * bool(c.part_of) + 1 for c in rows))
    result.report += [_row(c, pose, width) for c in rows]
    spread = errors["interaction"][pose] if errors else None
    # σ by draws may have a standard error of STD_CHANGE / ERRORS, its variance twice as much;
    # 5e-4 is shown as 0.1 %
    noise = spread or (2.0 * STD_CHANGE / ERRORS if method == AUTOMATIC else 5e-4)
    if abs(interaction[pose]) >= noise:
        between = words.percent(interaction[pose], spread)
        result.report += [f"  {'interaction':{width + 6}}{between}"]
    result.report += [f"  {'total':{width}}{words.probability(total[pose])}"]
    result.report += [f"{name} dominates {place}" for name, place in dominates.items()]
    result.report += [f"{name} has no value {place}" for name, place in gaps.items()]

    vanishes = _vanishing(scenario, sources, total) if method == "linear" else {}
    vanishing = words.places(vanishes, axis)
    optional = {
        "no_value": gaps,
        "gradient_vanishes": vanishing,
        "radar_constant_parts_at_largest": _at(pose, parts, "three_sigma"),
        "shares_of_radar_constant_parts_at_largest": _at(pose, parts, "share"),
    }
    result.summary |= {
        "largest_three_sigma_total": words.peak(total, axis),
        "at_largest": _at(pose, sources, "three_sigma"),
        "shares_at_largest": _at(pose, sources, "share")
        | {"interaction": float(interaction[pose])},
        "dominant": ranked[0].name if _is_first(ranked, pose, total[pose]) else None,
        "dominates": dominates,
        **{name: value for name, value in optional.items() if value},
    }
    if method != MONTE_CARLO:
        words.add_radars(result, {scenario.level: scenario}, method)
    add_required_accuracy(result, target=target, threshold=threshold, k=k, at=at)
    if method != MONTE_CARLO:
        off = std_off_in_scenario(scenario, found.mean, found.std, method=method)
        result.warnings += words.std_warnings(axis, found.std, off, method)
    result.warnings += words.table_warnings(scenario)
    if method == "linear":  # other methods report the interaction
        # where σ of all sources is not off, the source that first order misses is small
        missed = {name: mask & off for name, mask in vanishes.items()}
        result.warnings += words.vanishing_gradient(words.places(missed, axis))
        result.warnings += words.correlated_sources([c.three_sigma for c in sources], total)
    if method != MONTE_CARLO:
        result.report += words.std_trust(result)
    names = scenario.model.names if len(scenario.model.names) > 1 else ()
    result.draw = partial(_draw, axis=axis, sources=sources, parts=parts, total=total, radars=names)
    return result


def _source(name: str) -> str:
    """Return a source in the meaning of a column."""
    named = {"total": "all sources together", "interaction": "interactions of sources"}
    return named.get(name, f"{name} alone")


def _last_if_unknown(c: Contribution, pose: int) -> float:
    return float(np.nan_to_num(-c.three_sigma[pose], nan=np.inf))


def _at(pose: int, contributions: Sequence[Contribution], kind: str) -> dict[str, float]:
    """Return the values at a pose by name, without the common prefix of a single radar's parts."""
    return {
        c.name.removeprefix("radar_constant_") if c.part_of else c.name: float(
            getattr(c, kind)[pose]
        )
        for c in contributions
    }


def _row(c: Contribution, pose: int, width: int) -> str:
    value = words.probability(c.three_sigma[pose])
    error = None if c.share_error is None else c.share_error[pose]
    label = f"  {c.label}" if c.part_of else c.label
    return f"  {label:{width}}{value:6}{words.percent(c.share[pose], error)}".rstrip()


def _measure_first(
    scenario: Scenario,
    method: str,
    ranked: Sequence[Contribution],
    parts: Sequence[Contribution],
    pose: int,
    total: float,
) -> list[str]:
    """Return the one answer to what should be known better first, at the pose of the largest 3σ.

    Parts of a radar constant stand in its place.
    """
    whole = {part.part_of for part in parts}
    candidates = [c for c in (*ranked, *parts) if c.name not in whole]
    known = [c for c in candidates if np.isfinite(c.three_sigma[pose])]
    if not total > 0 or not known:
        return ["nothing to measure: P_D is certain"] if total == 0 else []
    top = max(c.three_sigma[pose] for c in known)
    if not _is_first(ranked, pose, total):
        return []
    first = [c for c in known if c.three_sigma[pose] >= (1.0 - TIE) * top]
    names = words.listed(c.name for c in first)
    share = f"{first[0].share[pose]:.1%} of the variance of P_D at {scenario.axis.at(pose)}"
    if len(first) > 1:
        return [f"know better first: {names} equally, each {share}"]
    answer = f"know better first: {names}, {share}"
    if not first[0].part_of or method == MONTE_CARLO:
        return [answer]
    at_pose = scenario.at_poses(np.array([pose]))
    (halved,) = value_function(at_pose, method)([first[0].name], 0.5)
    if halved > (1.0 - LEAST_GAIN) * total:
        return [
            f"no source is worth a measurement: half of {names} leaves {words.probability(halved)}"
        ]
    left = f"{words.probability(halved)} of {words.probability(total)}"
    return [f"{answer}; half its deviation leaves {left}"]


def _is_first(ranked: Sequence[Contribution], pose: int, total: float) -> bool:
    """Return whether no source without a value can be larger than the first one that has one."""
    squares = np.square([c.three_sigma[pose] for c in ranked])
    known = np.isfinite(squares)
    return bool(known.all() or squares[0] > total**2 - squares[known].sum())


def _vanishing(
    scenario: Scenario, sources: Sequence[Contribution], total: FloatArray
) -> dict[str, NDArray[np.bool_]]:
    """Return where (n,) the gradient for each source vanishes."""
    # A radar that does not see the aircraft has no effect of second order either.
    visible = scenario.model.visible(scenario.aircraft, scenario.radar)
    visible_by = dict(zip(scenario.model.names, np.moveaxis(visible, -1, 0), strict=False))
    masks = {}
    for c in sources:
        share = np.divide(c.three_sigma, total, out=np.zeros_like(total), where=total > 0)
        vanishes = (share < VANISHING * share.max()) & (total > 0)
        masks[c.name] = vanishes & visible_by.get(c.name, True)
    return masks


def _draw(
    figure: Figure,
    axis: Axis,
    sources: Sequence[Contribution],
    parts: Sequence[Contribution],
    total: FloatArray,
    radars: Sequence[str],
) -> None:
    """Draw 3σ of the sources, of their parts as thin lines of the same colour, and of all."""
    from radar_sense import plotting

    lines, top = (*sources, *parts), np.nanmax(total, initial=0.0)
    many = len(lines) >= MANY
    zero = [c for c in lines if many and np.nanmax(c.three_sigma, initial=0.0) < VISIBLE * top]
    if zero:
        left_out = ", ".join(plotting.key_in_words(c.label) for c in zero)
        plotting.add_small_print(figure, f"below {VISIBLE:.0%} of the total: {left_out}")
    (axes,), x = plotting.pose_panels(figure, 1, axis)
    # the aircraft's sources are grey in a network, where each radar has its own colour
    style_of = dict(zip([c.name for c in sources], plotting.styles(), strict=False))
    if radars:
        greys = [("0.5", dashes) for _, dashes in plotting.LINES]
        others = [c.name for c in sources if c.name not in radars]
        style_of = dict(zip(others, greys, strict=False)) | plotting.radar_styles(radars)
    for c in sources:
        if c not in zero:
            label = plotting.key_in_words(c.label)
            plotting.draw_line(axes, x, c.three_sigma, style_of[c.name], label=label)
    for i, c in enumerate(c for c in parts if c not in zero):
        style = style_of[c.part_of][0], plotting.LINES[i % len(plotting.LINES)][1]
        of = "" if c.part_of == "radar_constant" else f"{c.part_of} "
        label = of + plotting.key_in_words(c.label.removeprefix("constant_"))
        plotting.draw_line(axes, x, c.three_sigma, style, label=label)
        axes.lines[-1].set_linewidth(plotting.points(0.6))
    plotting.draw_line(axes, x, total, ("black", "-"), label="total")
    if radars:  # the total is under the line of the only radar that sees the aircraft
        axes.lines[-1].set(linewidth=plotting.points(2.2), zorder=1.8)
    axes.set_ylabel(r"$3\,\sigma$ of $P_D$")
    plotting.from_zero(axes)
    plotting.draw_legend(figure, axes)
