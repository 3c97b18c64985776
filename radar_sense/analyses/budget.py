"""Error budget: 3σ of P_D from each source alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from radar_sense.plotting import Figure

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from radar_sense.analyses.contract import OPTIONS, Option, Result, analysis
from radar_sense.analyses.error_budget import (
    MONTE_CARLO,
    Allowance,
    allowances,
    error_budget,
    parts_of,
    scaled_moments,
)
from radar_sense.analyses.report import (
    describe_extreme,
    describe_poses,
    distribution_warnings,
    largest_by_radar,
    level_and_method,
    mean_column,
    peak,
    radar_lines,
    radar_summary,
    reached,
    table_warnings,
    validity_warnings,
)
from radar_sense.axis import Axis
from radar_sense.errors import InputError
from radar_sense.limits import ANY, TARGET
from radar_sense.propagation import METHODS, check_method
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray, sources

#: First order has nothing to say of a source whose part in the total is so much smaller than its
#: part elsewhere: its gradient passes through zero there.
VANISHING = 1e-3


def plot(result: Result, figure: Figure) -> None:
    """Draw the figure."""
    from radar_sense.plotting import (
        LINES,
        draw_legend,
        draw_line,
        from_zero,
        pose_coordinates,
        pose_panels,
        styles,
    )

    (axes,) = pose_panels(figure, 1, result.scenario.axis)
    table, x = result.table, pose_coordinates(result.scenario.axis)
    every = sources(result.scenario.model.names)
    colours: dict[str, str] = {}
    for source, style in zip(every, styles(), strict=False):
        label, colours[source] = source.replace("_", " "), style[0]
        draw_line(axes, x, table[f"three_sigma_{source}"], style, label=label)
    # What radar constants are made of, thin and in the colour of the source they belong to.
    parts = parts_of(result.scenario)
    for (name, of), (_, dashes) in zip(parts.items(), itertools.cycle(LINES), strict=False):
        label = of.part.key if of.source == of.constant else f"{of.source} {of.part.key}"
        draw_line(axes, x, table[f"three_sigma_{name}"], (colours[of.source], dashes), label=label)
        axes.lines[-1].set_linewidth(0.6)
    draw_line(axes, x, table["three_sigma_total"], ("black", "-"), label="total")
    if len(result.scenario.model.names) > 1:
        axes.lines[-1].set(linewidth=2.2, zorder=1.8)
    axes.set_ylabel(r"$3\,\sigma_{pd}$")
    from_zero(axes)
    draw_legend(figure, axes)


_METHOD = dataclasses.replace(
    OPTIONS["method"], help=f"{OPTIONS['method'].help} Or montecarlo, for Sobol' indices."
)
_TARGET = Option(
    "target", "How small must each source be for 3 sigma to stay within X?", TARGET, metavar="X"
)
_AT = Option(
    "at",
    "Azimuth [deg], time [s] or distance [m] that --target is for.",
    ANY,
    metavar="X",
    default_text="all",
)


@analysis(
    plot=plot,
    options=["level", "radar", _METHOD, _TARGET, _AT, "runs", "seed"],
    examples=[
        "radar-sense budget",
        "radar-sense budget my.yaml --level low --no-plot",
        "radar-sense budget my.yaml --target 0.05",
        "radar-sense budget my.yaml --method montecarlo --runs 4096",
        "radar-sense budget network.yaml --radar ridge",
    ],
)
def budget(
    scenario: Scenario,
    *,
    method: str = "linear",
    target: float | None = None,
    at: float | None = None,
) -> Result:
    """Error budget: 3 sigma of P_D from each source alone.

    Args:
        scenario: The scenario.
        method: A method of propagation, or "montecarlo" for Sobol' indices.
        target: With it, also how small each source must be for 3σ to stay within this.
        at: Place on the scenario's axis of the only pose that counts for the target; every
            pose if None.

    Raises:
        InputError: If there is no such method or pose, or the two do not go together.
    """
    check_method(method, [MONTE_CARLO])
    if target is not None and method == MONTE_CARLO:
        raise InputError(f"a target needs one of the methods {', '.join(METHODS)}")
    if at is not None and target is None:
        raise InputError("--at says which pose a --target is for, and there is none")
    axis = scenario.axis
    found = error_budget(scenario, method)
    three_sigma, total = {s: 3 * std for s, std in found.alone.items()}, 3 * found.std
    shares = found.shares()
    worst = peak(total, axis)
    pose = int(np.argmax(reached(total)))  # the first of several that differ by rounding alone
    at_worst = {source: float(values[pose]) for source, values in three_sigma.items()}
    ranked = sorted(at_worst, key=lambda source: np.nan_to_num(-at_worst[source], nan=np.inf))
    known = np.isfinite(np.stack(list(three_sigma.values()))).all(axis=0) & np.isfinite(total)
    dominant = np.argmax(np.stack(list(three_sigma.values())), axis=0)
    dominates = {
        source: place
        for i, source in enumerate(three_sigma)
        if (place := describe_poses((dominant == i) & known & (total > 0), axis))
    }
    gaps = {
        source: place
        for source, values in {**three_sigma, "total": total}.items()
        if (place := describe_poses(~np.isfinite(values), axis))
    }
    errors = {s: float(v[pose]) for s, v in (found.share_error or {}).items()}
    parts = {name: 3 * std for name, std in found.parts.items()}
    part_shares = {name: float(v[pose]) for name, v in found.part_shares().items()}
    parts_ranked = sorted(parts, key=lambda name: np.nan_to_num(-parts[name][pose], nan=np.inf))
    of_parts = parts_of(scenario)
    indented = {name: f"  {name.removeprefix(of.source + '_')}" for name, of in of_parts.items()}
    width = max(21, *(len(name) + 1 for name in (*ranked, *indented.values())))
    rows = {s: [_row(s, at_worst[s], shares[s][pose], errors.get(s), width)] for s in ranked}
    for name in parts_ranked:
        share, error, three = part_shares[name], errors.get(name), float(parts[name][pose])
        rows[of_parts[name].source].append(_row(indented[name], three, share, error, width))
    inverse: dict[str, Any] = {}
    inverse_report: list[str] = []
    if target is not None:
        allowed = allowances(scenario, target, method=method, at=at)
        inverse = {"target": _inverse_summary(target, at, allowed, axis)}
        inverse_report = _inverse_report(target, at, allowed, axis)
    by_itself = {} if method == MONTE_CARLO else largest_by_radar(scenario, method)
    warnings = (
        [] if found.moments is None else [*validity_warnings(scenario, found.moments, method)]
    )
    if method != MONTE_CARLO:
        warnings += distribution_warnings(scenario, method)
    warnings += table_warnings(scenario)
    if method == "linear":
        warnings += _vanishing(scenario, three_sigma, total)
    return Result(
        scenario=scenario,
        method=method,
        table={
            axis.key: axis.values,
            **{f"three_sigma_{source}": values for source, values in three_sigma.items()},
            "three_sigma_total": total,
            **{f"three_sigma_{source}": 3 * std for source, std in found.finer.items()},
            **mean_column(found.mean, method),
            **({} if method == "linear" else {f"share_{s}": v for s, v in shares.items()}),
            **{f"total_index_{s}": v for s, v in (found.total_index or {}).items()},
            **{f"share_error_{s}": v for s, v in (found.share_error or {}).items()},
            **{f"three_sigma_{name}": values for name, values in parts.items()},
        },
        summary={
            "largest_three_sigma_total": worst,
            "at_largest": at_worst,
            "shares_at_largest": {s: float(v[pose]) for s, v in shares.items()},
            "dominant": ranked[0] if known[pose] else None,
            "dominates": dominates,
            **({"no_value": gaps} if gaps else {}),
            **radar_summary(by_itself),
            **_parts_summary({name: float(v[pose]) for name, v in parts.items()}, part_shares),
            **inverse,
        },
        report=(
            f"3 sigma of P_D ({level_and_method(scenario.level, method)}) at {axis.at(pose)}, "
            "where the total is largest, and share of its variance:",
            *(row for source in ranked for row in rows[source]),
            *_interaction_row(shares["interaction"][pose], errors.get("interaction"), width),
            _row("total", float(total[pose]), width=width),
            *(f"{source} dominates {place}" for source, place in dominates.items()),
            *(f"{source} has no value {place}" for source, place in gaps.items()),
            *_measure_better(scenario, method, parts_ranked, pose, float(total[pose])),
            *radar_lines({name: describe_extreme(top, axis) for name, top in by_itself.items()}),
            *inverse_report,
        ),
        warnings=(*warnings, *_correlated(three_sigma, total, method)),
    )


def _vanishing(
    scenario: Scenario, alone: Mapping[str, FloatArray], total: FloatArray
) -> tuple[str, ...]:
    """Say where first order reports (nearly) nothing for a source that matters elsewhere."""
    doubts = []
    # A radar that does not see the aircraft has nothing to report, of whatever order.
    seen = scenario.model.visible(scenario.aircraft, scenario.radar)
    sees = dict(zip(scenario.model.names, np.moveaxis(seen, -1, 0), strict=False))
    for source, values in alone.items():
        part = np.divide(values, total, out=np.zeros_like(total), where=total > 0)
        nothing = (part < VANISHING * part.max()) & (total > 0) & sees.get(source, True)
        if place := describe_poses(nothing, scenario.axis):
            doubts.append(
                f"the gradient for {source} vanishes {place}: only effects of second order remain "
                "there, which the linearized budget leaves out"
            )
    return tuple(doubts)


def _correlated(alone: Mapping[str, FloatArray], total: FloatArray, method: str) -> tuple[str, ...]:
    """Say so if linear contributions do not add up, because sources are correlated."""
    if method != "linear":
        return ()  # nonlinearity keeps them from adding up too; the interaction row has both
    together = np.sqrt(np.sum([values**2 for values in alone.values()], axis=0))
    gap = np.nanmax(abs(total - together), initial=0)
    if gap <= 1e-9 * np.nanmax(total, initial=0):
        return ()
    return (
        "the sources are correlated: the total differs from the root sum of squares "
        f"by up to {gap:.2g}",
    )


def _row(
    name: str,
    three_sigma: float,
    share: float = float("nan"),
    error: float | None = None,
    width: int = 21,
) -> str:
    rounds_away = 0 < three_sigma < 5e-5
    shown = f"{three_sigma:.0e}" if rounds_away else f"{three_sigma:.4f}"
    return f"  {name:{width}}{shown:6}{_percent(share, error)}"


def _parts_summary(three_sigma: Mapping[str, float], shares: Mapping[str, float]) -> dict[str, Any]:
    """Return what the JSON record says of the parts of radar constants, if there are any."""
    if not three_sigma:
        return {}
    return {
        "radar_constant_parts_at_largest": {_short(n): v for n, v in three_sigma.items()},
        "shares_of_radar_constant_parts_at_largest": {_short(n): v for n, v in shares.items()},
    }


def _short(part: str) -> str:
    """Name of a part without what goes without saying where there is a single radar."""
    return part.removeprefix("radar_constant_")


def _measure_better(
    scenario: Scenario, method: str, ranked: Sequence[str], pose: int, total: float
) -> tuple[str, ...]:
    """Say which part of a radar constant is worth measuring better, and what that would bring."""
    if not ranked or not total > 0:
        return ()
    several = "s" if len(scenario.tolerances_at_level) > 1 else ""
    said = f"of the radar constant{several}, {_short(ranked[0])} is what to measure better first"
    if method == MONTE_CARLO:
        return (said,)
    halved = scaled_moments(scenario, method, [ranked[0]], 0.5).std
    return (f"{said}: with half its deviation the total would be {3 * halved[pose]:.4f}",)


def _interaction_row(share: float, error: float | None, width: int) -> tuple[str, ...]:
    """Return a row for what no source does alone, unless there is nothing but rounding."""
    if not abs(share) > 1e-9:
        return ()
    return (f"  {'interaction':{width + 6}}{_percent(share, error)}",)


def _percent(share: float, error: float | None) -> str:
    if np.isnan(share):
        return ""
    return f" {share:6.1%}" + ("" if error is None else f" +/- {error:.1%}")


def _inverse_summary(
    target: float, at: float | None, found: Mapping[str, Allowance], axis: Axis
) -> dict[str, Any]:
    return {
        "three_sigma": target,
        f"at_{axis.unit}": at,
        "allowances": {
            source: {
                axis.key if key == "place" else key: value
                for key, value in dataclasses.asdict(allowance).items()
            }
            for source, allowance in found.items()
        },
    }


def _inverse_report(
    target: float, at: float | None, found: Mapping[str, Allowance], axis: Axis
) -> list[str]:
    place = "every pose" if at is None else f"{axis.say(at)}"
    lines = [
        f"to keep 3 sigma within {target:g} at {place}, multiply the standard "
        "deviations of one source, the others as they are, or of all together, by at most:"
    ]
    names = {source: _short(source) for source in found}
    names = {source: name if name == source else f"  {name}" for source, name in names.items()}
    width = max(21, *(len(name) + 1 for name in names.values()))
    for source, allowance in found.items():
        if not allowance.known:
            said = "not known: this method has no answer"
            if allowance.factor:
                said = f"at least {allowance.factor:.4g}, beyond which this method has no answer"
        elif allowance.factor is None:
            said = (
                f"no value of it alone is small enough: {allowance.remains:.4f} remains "
                f"at {axis.say(allowance.place)}, most of it from {allowance.remains_from}"
            )
        elif np.isinf(allowance.factor):
            said = "any factor"
        elif allowance.factor == 0:
            said = "less than a millionth"
        else:
            said = f"{allowance.factor:.4g}"
        lines.append(f"  {names[source]:{width}}{said}")
    return lines
