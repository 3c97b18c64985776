"""Error budget: 3σ of P_D from each source alone."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from radar_sense.analyses.columns import AXIS, MEAN, quantities
from radar_sense.analyses.contract import OPTIONS, Option, Result, analysis
from radar_sense.analyses.error_budget import (
    MONTE_CARLO,
    Budget,
    RequiredAccuracy,
    error_budget,
    only_at,
    parts_of,
    required_accuracies,
    sources_of,
    value_function,
)
from radar_sense.analyses.report import (
    NAMED,
    describe_extreme,
    describe_poses,
    largest_by_radar,
    level_and_method,
    mean_column,
    method_warnings,
    peak,
    radar_lines,
    radar_summary,
    reached,
    table_warnings,
)
from radar_sense.analyses.verdicts import refinement
from radar_sense.analyses.verdicts.threshold import AUTOMATIC, FORM
from radar_sense.axis import Axis
from radar_sense.errors import InputError
from radar_sense.limits import ANY, SIGMAS, TARGET, THRESHOLD
from radar_sense.propagation import METHODS, propagate_scenario
from radar_sense.scenario import Scenario
from radar_sense.states import AIRCRAFT_RCS, RADAR_ATTENUATION, FloatArray

if TYPE_CHECKING:
    from radar_sense.plotting import Figure

#: The gradient for a source counts as zero where the share of the source is below VANISHING times
#: its largest share.
VANISHING = 1e-3
#: Sources that the paper does not have.
FURTHER = (AIRCRAFT_RCS, RADAR_ATTENUATION)
#: Half the deviation of a parameter must reduce the total by this part.
LEAST_GAIN = 0.01


def plot(result: Result, figure: Figure) -> None:
    """Draw the figure."""
    from radar_sense import plotting

    (axes,), x = plotting.pose_panels(figure, 1, result.scenario.axis)
    table = result.table
    lines = result.summary["lines"]
    colours: dict[str, str] = {}
    for source, style in zip(lines["sources"], plotting.styles(), strict=False):
        label, colours[source] = source.replace("_", " "), style[0]
        plotting.draw_line(axes, x, table[f"three_sigma_{source}"], style, label=label)
    # Parts of radar constants are thin lines in the colour of their source.
    for part, (_, dashes) in zip(lines["parts"], itertools.cycle(plotting.LINES), strict=False):
        style = (colours[part["source"]], dashes)
        plotting.draw_line(
            axes, x, table[f"three_sigma_{part['name']}"], style, label=part["label"]
        )
        axes.lines[-1].set_linewidth(plotting.points(0.6))
    plotting.draw_line(axes, x, table["three_sigma_total"], ("black", "-"), label="total")
    if lines["several_radars"]:
        axes.lines[-1].set(linewidth=plotting.points(2.2), zorder=1.8)
    axes.set_ylabel(r"$3\,\sigma$ of $P_D$")
    plotting.from_zero(axes)
    plotting.draw_legend(figure, axes, on_lines=axes.lines[: len(lines["sources"])])


_METHOD = dataclasses.replace(
    OPTIONS["method"],
    help=f"{OPTIONS['method'].help} Or montecarlo, for Sobol' indices. "
    "automatic is linear, and with --threshold form.",
    also=(MONTE_CARLO, AUTOMATIC),
    default=AUTOMATIC,
)
_TARGET = Option(
    "target", "Also the factor on each source at which 3 sigma is X.", TARGET, metavar="X"
)
_THRESHOLD = Option(
    "threshold",
    "Also the factor on each source at which P_D + K sigma is P_MAX.",
    THRESHOLD,
    metavar="P_MAX",
)
_K = Option("k", "K of --threshold.", SIGMAS, metavar="K", default_text="3")
_AT = Option(
    "at",
    "Azimuth [deg], time [s] or distance [m] of the pose for --target or --threshold.",
    ANY,
    metavar="X",
    default_text="all",
)


_TABLE = (
    *AXIS,
    *quantities(
        {
            "three_sigma_<source>": "3 sigma of P_D from <source> alone.",
            "three_sigma_total": "3 sigma of P_D from all sources together.",
        }
    ),
    MEAN,
    *quantities(
        {
            "share_<source>": "Share of the variance of P_D from <source>; not by linear.",
            "share_interaction": (
                "Share of the variance from interactions of sources; not by linear."
            ),
            "total_index_<source>": (
                "Total Sobol' index of <source>: its share and all its interactions; by montecarlo."
            ),
            "share_error_<source>": "Standard error of the share of <source>; by montecarlo.",
        }
    ),
)


@analysis(
    plot=plot,
    columns=_TABLE,
    options=["level", "radar", _METHOD, _TARGET, _THRESHOLD, _K, _AT, "runs", "seed"],
    examples=[
        "radar-sense budget",
        "radar-sense budget my.yaml --level low --no-plot",
        "radar-sense budget my.yaml --target 0.05",
        "radar-sense budget my.yaml --threshold 0.8",
        "radar-sense budget my.yaml --method montecarlo --runs 4096",
        "radar-sense budget network.yaml --radar ridge",
    ],
)
def budget(
    scenario: Scenario,
    *,
    method: str = AUTOMATIC,
    target: float | None = None,
    threshold: float | None = None,
    k: float | None = None,
    at: float | None = None,
) -> Result:
    """Error budget: 3 sigma of P_D from each source alone.

    Args:
        scenario: The scenario.
        method: A method of propagation, or "montecarlo" for Sobol' indices. "automatic" is linear,
            and form with a threshold.
        target: Limit of 3σ, for the accuracy required of each source; None for no limit.
        threshold: Limit of P_D + kσ, for the accuracy required of each source; None for no limit.
        k: k of the threshold, 3 by default.
        at: Place on the scenario's axis of the only pose that counts for target or threshold;
            every pose if None.

    Raises:
        InputError: If there is no such method or pose, or options do not go together.
    """
    if method == AUTOMATIC:
        method = "linear" if threshold is None else FORM
    goal = _goal(method, target, threshold, k, at)
    axis = scenario.axis
    contributions = error_budget(scenario, method)
    three_sigma, parts = _three_sigma(contributions.alone), _three_sigma(contributions.parts)
    finer, total = _three_sigma(contributions.finer), 3 * contributions.std
    shares, part_shares = contributions.shares(), contributions.part_shares()
    pose = int(np.argmax(reached(total)))  # the first of the poses that are equal to rounding
    at_worst = _at(three_sigma, pose)
    ranked, parts_ranked = _ranked(at_worst), _ranked(_at(parts, pose))
    dominates = _dominates(three_sigma, total, axis)
    gaps = {
        source: place
        for source, values in {**three_sigma, **finer, **parts, "total": total}.items()
        if (place := describe_poses(~np.isfinite(values), axis))
    }
    inverse: dict[str, Any] = {}
    inverse_report: list[str] = []
    if goal is not None:
        poses = _poses_of(scenario, goal, method)
        required = required_accuracies(poses.scenario, goal.limit, k=goal.k, method=method)
        inverse = {goal.name: _inverse_summary(goal, poses, required)}
        inverse_report = _inverse_report(goal, poses, required)
    by_itself = {} if method == MONTE_CARLO else largest_by_radar(scenario, method)
    vanishing = _vanishing(scenario, three_sigma, total) if method == "linear" else {}
    return Result(
        scenario=scenario,
        method=method,
        table={
            axis.key: axis.values,
            # The columns of the paper's sources and of the total are first, in a fixed order.
            **_columns({s: v for s, v in three_sigma.items() if s not in FURTHER}),
            "three_sigma_total": total,
            **_columns({s: v for s, v in three_sigma.items() if s in FURTHER}),
            **_columns(finer),
            **mean_column(contributions.mean, method),
            **({} if method == "linear" else {f"share_{s}": v for s, v in shares.items()}),
            **{f"total_index_{s}": v for s, v in (contributions.total_index or {}).items()},
            **{f"share_error_{s}": v for s, v in (contributions.share_error or {}).items()},
            **_columns(parts),
        },
        summary={
            "largest_three_sigma_total": peak(total, axis),
            "at_largest": at_worst,
            "shares_at_largest": _at(shares, pose),
            "dominant": ranked[0] if np.isfinite([*at_worst.values(), total[pose]]).all() else None,
            "dominates": dominates,
            **({"no_value": gaps} if gaps else {}),
            **({"gradient_vanishes": vanishing} if vanishing else {}),
            "lines": _lines(scenario),
            **radar_summary(by_itself),
            **_parts_summary(_at(parts, pose), _at(part_shares, pose)),
            **inverse,
        },
        report=(
            f"3 sigma of P_D ({level_and_method(scenario.level, method)}) at {axis.at(pose)}, "
            "where the total is largest, and share of its variance:",
            *_rows(scenario, contributions, ranked, parts_ranked, pose),
            *(f"{source} dominates {place}" for source, place in dominates.items()),
            *(f"{source} has no value {place}" for source, place in gaps.items()),
            *_measure_better(scenario, method, parts_ranked, pose, float(total[pose])),
            *radar_lines({name: describe_extreme(top, axis) for name, top in by_itself.items()}),
            *inverse_report,
        ),
        warnings=(
            *(
                table_warnings(scenario)
                if contributions.moments is None
                else method_warnings(scenario, contributions.moments, method)
            ),
            *_vanishing_warnings(vanishing),
            *_correlated(three_sigma, total, method),
        ),
    )


def _three_sigma(std: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    return {name: 3 * values for name, values in std.items()}


def _columns(three_sigma: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the columns of 3σ by source."""
    return {f"three_sigma_{source}": values for source, values in three_sigma.items()}


def _at(values: Mapping[str, FloatArray], pose: int) -> dict[str, float]:
    """Return the values at a pose by name."""
    return {name: float(column[pose]) for name, column in values.items()}


def _ranked(values: Mapping[str, float]) -> list[str]:
    """Return names from the largest value to the smallest, NaN last."""
    return sorted(values, key=lambda name: np.nan_to_num(-values[name], nan=np.inf))


def _dominates(
    three_sigma: Mapping[str, FloatArray], total: FloatArray, axis: Axis
) -> dict[str, str]:
    """Return the poses at which each source has the largest 3σ, in words."""
    by_source = np.stack(list(three_sigma.values()))
    known = np.isfinite(by_source).all(axis=0) & np.isfinite(total)
    largest = np.argmax(by_source, axis=0)
    return {
        source: place
        for i, source in enumerate(three_sigma)
        if (place := describe_poses((largest == i) & known & (total > 0), axis))
    }


def _rows(
    scenario: Scenario,
    contributions: Budget,
    ranked: Sequence[str],
    parts_ranked: Sequence[str],
    pose: int,
) -> list[str]:
    """Return the rows of sources, each above its parts, of the interaction, and of the total."""
    three_sigma = {
        name: 3 * float(std[pose])
        for name, std in {
            **contributions.alone,
            **contributions.parts,
            **contributions.finer,
            "total": contributions.std,
        }.items()
    }
    shares = {
        **_at(contributions.shares(), pose),
        **_at(contributions.part_shares(), pose),
    }
    errors = _at(contributions.share_error or {}, pose)
    parts = parts_of(scenario)
    labels = {name: f"  {name.removeprefix(part.source + '_')}" for name, part in parts.items()}
    width = max(21, *(len(label) + 1 for label in (*ranked, *labels.values())))
    rows = []
    for source in ranked:
        rows.append(_row(source, three_sigma[source], shares[source], errors.get(source), width))
        rows += [
            _row(labels[name], three_sigma[name], shares[name], errors.get(name), width)
            for name in parts_ranked
            if parts[name].source == source
        ]
        attenuation = three_sigma.get(f"{source}_attenuation")
        if attenuation is not None:
            total = three_sigma["total"]
            share = (attenuation / total) ** 2 if total > 0 else float("nan")
            rows.append(_row("  attenuation", attenuation, share, None, width))
    rows += _interaction_row(shares["interaction"], errors.get("interaction"), width)
    return [*rows, _row("total", three_sigma["total"], width=width)]


@dataclass(frozen=True)
class _Goal:
    """A limit of 3σ of P_D (k is None), or of P_D + kσ, at one place or at all (at is None)."""

    limit: float
    k: float | None
    at: float | None

    @property
    def name(self) -> str:
        return "target" if self.k is None else "threshold"

    def __str__(self) -> str:
        value = "3 sigma" if self.k is None else f"P_D + {self.k:g} sigma"
        return f"{value} within {self.limit:g}"


def _goal(
    method: str,
    target: float | None,
    threshold: float | None,
    k: float | None,
    at: float | None,
) -> _Goal | None:
    """Return the limit given by target or threshold; None if neither is given.

    Raises:
        InputError: If options do not go together.
    """
    if target is not None and threshold is not None:
        raise InputError("target and threshold exclude each other; give one of them")
    if target is None and threshold is None:
        for name, value in (("at", at), ("k", k)):
            if value is not None:
                belongs = "threshold" if name == "k" else "target or threshold"
                raise InputError(f"{name} belongs to {belongs}, which is not given")
        return None
    if method == MONTE_CARLO:
        name = "target" if threshold is None else "threshold"
        raise InputError(f"a {name} needs one of the methods {', '.join(METHODS)}")
    if target is not None:
        if k is not None:
            raise InputError("k belongs to threshold, which is not given")
        return _Goal(target, None, at)
    assert threshold is not None
    k = 3.0 if k is None else k
    return _Goal(threshold, k, at)


def _lines(scenario: Scenario) -> dict[str, Any]:
    """Return the names and labels of the lines of the figure: sources, and parts of constants."""
    names = scenario.model.names
    return {
        "sources": list(sources_of(scenario)),
        "several_radars": len(names) > 1,
        "parts": [
            {
                "name": name,
                "source": part.source,
                "label": part.tolerance.name
                if part.source == part.constant
                else f"{part.source} {part.tolerance.name}",
            }
            for name, part in parts_of(scenario).items()
        ],
    }


def _vanishing(
    scenario: Scenario, alone: Mapping[str, FloatArray], total: FloatArray
) -> dict[str, str]:
    """Return the sources with a vanishing gradient at some poses, and these poses in words."""
    places = {}
    # A radar that does not see the aircraft has no effect of second order either.
    visible = scenario.model.visible(scenario.aircraft, scenario.radar)
    visible_by = dict(zip(scenario.model.names, np.moveaxis(visible, -1, 0), strict=False))
    for source, values in alone.items():
        share = np.divide(values, total, out=np.zeros_like(total), where=total > 0)
        vanishes = (share < VANISHING * share.max()) & (total > 0) & visible_by.get(source, True)
        if place := describe_poses(vanishes, scenario.axis):
            places[source] = place
    return places


def _vanishing_warnings(places: Mapping[str, str]) -> tuple[str, ...]:
    """Return one warning for all sources whose gradient vanishes at some poses."""
    if not places:
        return ()
    if len(places) <= NAMED:
        sources_and_places = ", ".join(f"{source} {place}" for source, place in places.items())
    else:
        sources_and_places = f"{len(places)} sources at some poses, listed in the record"
    return (
        f"the gradient vanishes for {sources_and_places}: only effects of second order remain "
        "there, which the linear budget leaves out; use --method form or montecarlo",
    )


def _correlated(alone: Mapping[str, FloatArray], total: FloatArray, method: str) -> tuple[str, ...]:
    """Return a warning if the contributions do not add up, because sources are correlated."""
    if method != "linear":  # other methods report the interaction
        return ()
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
    if np.isnan(three_sigma):
        shown = "-"
    return f"  {name:{width}}{shown:6}{_percent(share, error)}"


def _parts_summary(three_sigma: Mapping[str, float], shares: Mapping[str, float]) -> dict[str, Any]:
    """Return the entries of the summary for the parts of radar constants; {} without parts."""
    if not three_sigma:
        return {}
    return {
        "radar_constant_parts_at_largest": {_short(n): v for n, v in three_sigma.items()},
        "shares_of_radar_constant_parts_at_largest": {_short(n): v for n, v in shares.items()},
    }


def _short(part: str) -> str:
    """Return the name of a part without the common prefix of a single radar."""
    return part.removeprefix("radar_constant_")


def _measure_better(
    scenario: Scenario, method: str, ranked: Sequence[str], pose: int, total: float
) -> tuple[str, ...]:
    """Return advice on the part of a radar constant to measure first."""
    if not ranked or not total > 0:
        return ()
    several = "s" if len(scenario.tolerances_at_level) > 1 else ""
    advice = (
        f"of the radar constant{several}, {_short(ranked[0])} is the part to measure better first"
    )
    if method == MONTE_CARLO:
        return (advice,)
    (halved,) = value_function(scenario.at_poses(np.array([pose])), method)([ranked[0]], 0.5)
    if halved > (1.0 - LEAST_GAIN) * total:
        return (
            f"no part of the radar constant{several} is worth a measurement: half the deviation of "
            f"{_short(ranked[0])}, the largest part, leaves the total at {halved:.4f}",
        )
    return (f"{advice}: with half its deviation the total would be {halved:.4f}",)


def _interaction_row(share: float, error: float | None, width: int) -> tuple[str, ...]:
    """Return the row of the interaction between sources; () for an interaction from rounding."""
    if not abs(share) > 1e-9:
        return ()
    return (f"  {'interaction':{width + 6}}{_percent(share, error)}",)


def _percent(share: float, error: float | None) -> str:
    if np.isnan(share):
        return ""
    return f" {share:6.1%}" + ("" if error is None else f" +/- {error:.1%}")


def _poses_of(scenario: Scenario, goal: _Goal, method: str) -> refinement.Refined:
    """Return the pose at the place of a goal, or enough poses to resolve P_D."""
    propagate = partial(propagate_scenario, method=method, beta=goal.k or 3.0)
    if goal.at is not None:
        scenario = only_at(scenario, goal.at)
    return refinement.resolve(scenario, propagate, goal.limit)


def _inverse_summary(
    goal: _Goal, poses: refinement.Refined, required: Mapping[str, RequiredAccuracy]
) -> dict[str, Any]:
    axis = poses.scenario.axis
    limit = {"three_sigma": goal.limit} if goal.k is None else {"p_max": goal.limit, "k": goal.k}
    return {
        **limit,
        "poses": len(axis),
        "poses_between_rows": poses.added,
        "resolved": poses.resolved,
        f"at_{axis.unit}": goal.at,
        "required_accuracy": {
            source: {
                axis.key if key == "place" else key: value
                for key, value in dataclasses.asdict(accuracy).items()
            }
            for source, accuracy in required.items()
        },
    }


def _inverse_report(
    goal: _Goal, poses: refinement.Refined, required: Mapping[str, RequiredAccuracy]
) -> list[str]:
    axis = poses.scenario.axis
    place = "at all poses" if goal.at is None else f"at {axis.format(goal.at)}"
    if poses.added:
        place += f" and at {poses.added} between them"
    lines = [
        f"to keep {goal} {place}, largest factor on the standard deviations of one source (others "
        "unchanged), or of all:",
        *([] if poses.resolved else [f"  {refinement.unresolved(poses)}"]),
    ]
    names = {source: _short(source) for source in required}
    names = {source: name if name == source else f"  {name}" for source, name in names.items()}
    width = max(21, *(len(name) + 1 for name in names.values()))
    return [
        *lines,
        *(
            f"  {names[source]:{width}}{accuracy_in_words(accuracy, axis)}"
            for source, accuracy in required.items()
        ),
    ]


def accuracy_in_words(accuracy: RequiredAccuracy, axis: Axis) -> str:
    """Describe the largest factor on the standard deviations of a source."""
    factor = accuracy.factor
    if not accuracy.known:
        if not factor:
            return "not known: this method has no value"
        if factor >= 1:
            return f"no reduction needed; may grow {factor:.4g}-fold (no value beyond)"
        return f"{factor:.4g}; this method has no value beyond"
    if factor is None:
        words = (
            f"not enough alone: {accuracy.residual:.4f} remains at {axis.format(accuracy.place)}"
        )
        return words + (f", most from {accuracy.residual_from}" if accuracy.residual_from else "")
    if np.isinf(factor):
        return "any factor"
    if factor == 0:
        return "less than a millionth"
    return f"{factor:.4g}" if factor < 1 else f"no reduction needed; may grow {factor:.4g}-fold"
