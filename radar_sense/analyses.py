"""The analyses: from a scenario to one table, one summary and a few lines for a person.

They take `method`, a method of propagation. Without it they are the paper's: linear, and with the
paper's columns alone; a method that is named adds columns of its own, its mean among them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np

from radar_sense import validation
from radar_sense.axis import Axis
from radar_sense.error_budget import (
    MONTE_CARLO,
    Allowance,
    allowances,
    error_budget,
    parts_of,
    scaled_moments,
)
from radar_sense.geometry import body_vector, slant_range
from radar_sense.montecarlo import TAIL, WITHIN_3_SIGMA, MonteCarlo, monte_carlo
from radar_sense.network import alone
from radar_sense.propagation import (
    BOUND_CHANGE,
    METHODS,
    STD_CHANGE,
    Moments,
    check_method,
    nonlinear_in_scenario,
    propagate_scenario,
)
from radar_sense.radar_constant import doubts
from radar_sense.reader import ScenarioError
from radar_sense.scenario import DETECTORS, Scenario
from radar_sense.states import FloatArray
from radar_sense.wording import at, peak, reached, trough, where

#: False alarm probabilities that `detectors` shows beside the scenario's, ...
P_FAS = (1e-2, 1e-4, 1e-6, 1e-8, 1e-12)
#: ... and its signal-to-noise ratios [dB].
SNR_DB = np.linspace(-10.0, 30.0, 401)
#: With a single pulse the others are the same as one of these.
DISTINCT = ("north", "marcum", "swerling1", "swerling3")

#: First order has nothing to say of a source whose part in the total is so much smaller than its
#: part elsewhere: its gradient passes through zero there.
VANISHING = 1e-3


@dataclass(frozen=True, eq=False)
class Result:
    """What an analysis found.

    Attributes:
        analysis: Its name.
        scenario: The scenario, with level, runs and seed as they were used.
        table: Columns of the CSV file, by name, each (n,).
        summary: Numbers for the JSON record.
        report: Lines for the terminal.
        warnings: Where the numbers are not to be trusted, one sentence each.
        method: Method of propagation behind the numbers.
        monte_carlo: The draws behind the table, if there were any.
        passed: Whether what was asked for holds; false if a method is not validated.
    """

    analysis: str
    scenario: Scenario
    table: Mapping[str, FloatArray]
    summary: Mapping[str, Any]
    report: tuple[str, ...]
    warnings: tuple[str, ...]
    method: str = "linear"
    monte_carlo: MonteCarlo | None = None
    passed: bool = True


def variance(scenario: Scenario, *, method: str | None = None) -> Result:
    """P_D along the geometry with its standard deviation and 3σ band; of each radar too."""
    axis = scenario.axis
    moments = propagate_scenario(scenario, method=_chosen(method))
    low, high = trough(moments.p_d, axis), peak(moments.p_d, axis)
    worst = peak(3 * moments.std, axis)
    each = {
        name: (one, propagate_scenario(one, method=_chosen(method)))
        for name, one in alone(scenario).items()
    }
    by_itself = {name: peak(3 * found.std, axis) for name, (_, found) in each.items()}
    return Result(
        analysis="variance",
        scenario=scenario,
        method=_chosen(method),
        table={
            axis.key: axis.values,
            **_towards(scenario),
            **_band(moments),
            **_mean(moments.mean, method),
            **{
                f"{name}_{radar}": column
                for radar, (one, found) in each.items()
                for name, column in {**_towards(one), **_band(found)}.items()
            },
        },
        summary={
            "lowest_p_d": low,
            "highest_p_d": high,
            "largest_three_sigma": worst,
            **_by_radar_summary(by_itself),
        },
        report=(
            f"P_D runs from {at(low, axis)} to {at(high, axis)}",
            f"largest 3 sigma of P_D ({_named(scenario.level, method)}): {at(worst, axis)}",
            *_by_radar({name: at(top, axis) for name, top in by_itself.items()}),
        ),
        warnings=(*_doubts(scenario, moments, method), *_not_as_taken(scenario, method)),
    )


def sensitivity(scenario: Scenario, *, method: str | None = None) -> Result:
    """3σ of P_D for every level of radar uncertainty."""
    axis = scenario.axis
    moments = {
        level: propagate_scenario(scenario.with_analysis(level=level), method=_chosen(method))
        for level in scenario.cov_radar
    }
    worst = {level: peak(3 * m.std, axis) for level, m in moments.items()}
    width = max(map(len, worst))
    by_itself = {
        level: _largest_by_radar(scenario.with_analysis(level=level), method)
        for level in scenario.cov_radar
    }
    of_radars = {
        name: ", ".join(f"{level} {at(tops[name], axis)}" for level, tops in by_itself.items())
        for name in by_itself[scenario.level]
    }
    return Result(
        analysis="sensitivity",
        scenario=scenario,
        method=_chosen(method),
        table={
            axis.key: axis.values,
            **{f"three_sigma_{level}": 3 * m.std for level, m in moments.items()},
            **{
                key: column
                for level, m in moments.items()
                for key, column in _mean(m.mean, method, f"_{level}").items()
            },
        },
        summary={
            "largest_three_sigma": worst,
            **_by_radar_summary(by_itself if of_radars else {}),
        },
        report=(
            f"largest 3 sigma of P_D by level{_by(method)}:",
            *(f"  {level:{width}}  {at(top, axis)}" for level, top in worst.items()),
            *_by_radar(of_radars),
        ),
        warnings=tuple(
            f"{level}: {doubt}"
            for level, m in moments.items()
            for doubt in (
                *_doubts(scenario.with_analysis(level=level), m, method),
                *_not_as_taken(scenario.with_analysis(level=level), method),
            )
        ),
    )


def budget(
    scenario: Scenario,
    *,
    method: str | None = None,
    target: float | None = None,
    only_at: float | None = None,
) -> Result:
    """3σ of P_D from each source of uncertainty alone, and from all together.

    Args:
        scenario: The scenario.
        method: A method of propagation, or "montecarlo" for Sobol' indices.
        target: With it, also how small each source must be for 3σ to stay within this.
        only_at: Place on the scenario's axis of the only pose that counts for the target; every
            pose if None.

    Raises:
        ScenarioError: If there is no such method or pose, or the two do not go together.
    """
    check_method(_chosen(method), [MONTE_CARLO])
    if target is not None and method == MONTE_CARLO:
        raise ScenarioError(f"a target needs one of the methods {', '.join(METHODS)}")
    if only_at is not None and target is None:
        raise ScenarioError("--at says which pose a --target is for, and there is none")
    axis = scenario.axis
    found = error_budget(scenario, _chosen(method))
    three_sigma, total = {s: 3 * std for s, std in found.alone.items()}, 3 * found.std
    shares = found.shares()
    worst = peak(total, axis)
    pose = int(np.argmax(reached(total)))  # the first of several that differ by rounding alone
    at_worst = {source: float(values[pose]) for source, values in three_sigma.items()}
    ranked = sorted(at_worst, key=at_worst.__getitem__, reverse=True)
    dominant = np.argmax(np.stack(list(three_sigma.values())), axis=0)
    dominates = {
        source: place
        for i, source in enumerate(three_sigma)
        if (place := where((dominant == i) & (total > 0), axis))
    }
    errors = {s: float(v[pose]) for s, v in (found.share_error or {}).items()}
    parts = {name: 3 * std for name, std in found.parts.items()}
    part_shares = {name: float(v[pose]) for name, v in found.part_shares().items()}
    parts_ranked = sorted(parts, key=lambda name: parts[name][pose], reverse=True)
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
        allowed = allowances(scenario, target, method=_chosen(method), at=only_at)
        inverse = {"target": _inverse_summary(target, only_at, allowed, axis)}
        inverse_report = _inverse_report(target, only_at, allowed, axis)
    by_itself = {} if method == MONTE_CARLO else _largest_by_radar(scenario, method)
    warnings = [] if found.moments is None else [*_doubts(scenario, found.moments, method)]
    if method != MONTE_CARLO:
        warnings += _not_as_taken(scenario, method)
    if _chosen(method) == "linear":
        warnings += _vanishing(scenario, three_sigma, total)
    return Result(
        analysis="budget",
        scenario=scenario,
        method=_chosen(method),
        table={
            axis.key: axis.values,
            **{f"three_sigma_{source}": values for source, values in three_sigma.items()},
            "three_sigma_total": total,
            **{f"three_sigma_{source}": 3 * std for source, std in found.finer.items()},
            **_mean(found.mean, method),
            **({} if method is None else {f"share_{s}": v for s, v in shares.items()}),
            **{f"total_index_{s}": v for s, v in (found.total_index or {}).items()},
            **{f"share_error_{s}": v for s, v in (found.share_error or {}).items()},
            **{f"three_sigma_{name}": values for name, values in parts.items()},
        },
        summary={
            "largest_three_sigma_total": worst,
            "at_largest": at_worst,
            "shares_at_largest": {s: float(v[pose]) for s, v in shares.items()},
            "dominant": ranked[0],
            "dominates": dominates,
            **_by_radar_summary(by_itself),
            **_parts_summary({name: float(v[pose]) for name, v in parts.items()}, part_shares),
            **inverse,
        },
        report=(
            f"3 sigma of P_D ({_named(scenario.level, method)}) at {axis.at(pose)}, "
            "where the total is largest, and share of its variance:",
            *(row for source in ranked for row in rows[source]),
            *_interaction_row(shares["interaction"][pose], errors.get("interaction"), width),
            _row("total", float(total[pose]), width=width),
            *(f"{source} dominates {place}" for source, place in dominates.items()),
            *_measure_better(scenario, method, parts_ranked, pose, float(total[pose])),
            *_by_radar({name: at(top, axis) for name, top in by_itself.items()}),
            *inverse_report,
        ),
        warnings=(*warnings, *_correlated(three_sigma, total, method)),
    )


def montecarlo(
    scenario: Scenario,
    *,
    method: str | None = None,
    sampler: str = "random",
    workers: int = 1,
    executor: Executor | None = None,
    progress: Callable[[int], None] | None = None,
) -> Result:
    """Monte Carlo draws of P_D against the 3σ band of a method."""
    axis = scenario.axis
    mc = monte_carlo(
        scenario,
        method=_chosen(method),
        sampler=sampler,
        workers=workers,
        executor=executor,
        progress=progress,
    )
    pose = int(np.argmin(mc.coverage))
    overall = float(mc.coverage.mean())
    name = _band_name(method)
    warnings = list(_doubts(scenario, mc.band, method))
    lowest_summary: dict[str, Any] = {
        "value": float(mc.coverage[pose]),
        axis.key: float(axis.values[pose]),
    }
    summary: dict[str, Any] = {
        "runs": mc.runs,
        "sampler": mc.sampler,
        "coverage_expected": WITHIN_3_SIGMA,
        "coverage_overall": overall,
        "coverage_lowest": lowest_summary,
    }
    lowest = f"lowest coverage {mc.coverage[pose]:.2%} at {axis.at(pose)}"
    if mc.sampler == "random":
        low, high = mc.coverage_interval()
        # Bonferroni: with 95 % confidence none of the poses is called inconsistent by chance.
        least, most = mc.coverage_interval(1 - 0.05 / len(axis))
        off = (most < WITHIN_3_SIGMA) | (least > WITHIN_3_SIGMA)
        lowest += f" (95 % confidence {low[pose]:.2%} to {high[pose]:.2%})"
        lowest_summary["confidence_95"] = [float(low[pose]), float(high[pose])]
        summary["coverage_confidence_95"] = {"lower": low.tolist(), "upper": high.tolist()}
        summary["poses_inconsistent"] = int(np.count_nonzero(off))
        if off.any():
            warnings.append(
                f"the {name} band does not hold the 99.73 % of the draws that it should "
                f"{where(off, axis)} (95 % confidence for all poses together)"
            )
    warnings += (*_not_as_taken(scenario, method), *_clipped(mc.clipped))
    by_itself = _largest_by_radar(scenario, method)
    return Result(
        analysis="montecarlo",
        scenario=scenario,
        method=_chosen(method),
        table={
            axis.key: axis.values,
            **_band(mc.band),
            **_drawn(mc.mean, mc.std, mc.lower, mc.upper),
            "coverage_3sigma": mc.coverage,
            **_mean(mc.band.mean, method),
        },
        summary={
            **summary,
            "quantile_rank_error": mc.rank_error,
            "largest_mean_shift": peak(abs(mc.mean - mc.band.p_d), axis),
            "radar_constants_set_to_zero": mc.clipped,
            **_by_radar_summary(by_itself),
        },
        report=(
            f"{mc.runs} runs ({scenario.level}, seed {mc.seed}{_points(mc)}): {overall:.2%} of the "
            f"draws lie in the {name} 3-sigma band, {WITHIN_3_SIGMA:.2%} should",
            lowest,
            *_rank_error(mc),
            *_by_radar({name: at(top, axis) for name, top in by_itself.items()}, name),
        ),
        warnings=tuple(warnings),
        monte_carlo=mc,
    )


def compare(
    scenario: Scenario,
    *,
    sampler: str = "random",
    workers: int = 1,
    executor: Executor | None = None,
    progress: Callable[[int], None] | None = None,
) -> Result:
    """Bounds of P_D by every method of propagation against those of Monte Carlo."""
    axis = scenario.axis
    mc = monte_carlo(
        scenario, sampler=sampler, workers=workers, executor=executor, progress=progress
    )
    moments = {method: propagate_scenario(scenario, method=method) for method in METHODS}
    worst = {
        method: {
            "bounds": peak(np.maximum(abs(m.lower - mc.lower), abs(m.upper - mc.upper)), axis),
            "sigma": peak(abs(m.std - mc.std), axis),
            "mean": peak(abs(m.mean - mc.mean), axis),
        }
        for method, m in moments.items()
    }
    return Result(
        analysis="compare",
        scenario=scenario,
        table={
            axis.key: axis.values,
            "p_d": mc.band.p_d,
            **_drawn(mc.mean, mc.std, mc.lower, mc.upper),
            **{
                f"{name}_{method}": column
                for method, m in moments.items()
                for name, column in (
                    ("mean_pd", m.mean),
                    ("sigma_pd", m.std),
                    ("lower_3sigma", m.lower),
                    ("upper_3sigma", m.upper),
                )
            },
        },
        summary={
            "runs": mc.runs,
            "sampler": mc.sampler,
            "quantile_rank_error": mc.rank_error,
            "largest_difference": worst,
        },
        report=(
            f"largest difference from {mc.runs} runs "
            f"({scenario.level}, seed {mc.seed}{_points(mc)}):",
            f"  {'':10}{'3-sigma bounds':28}{'sigma':28}{'mean'}",
            *(
                f"  {method:10}"
                + "".join(f"{at(extreme, axis):28}" for extreme in w.values()).rstrip()
                for method, w in worst.items()
            ),
        ),
        warnings=tuple(
            doubt
            for method, m in moments.items()
            for doubt in (*_doubts(scenario, m, method), *_not_as_taken(scenario, method))
        ),
        monte_carlo=mc,
    )


def validate(
    scenario: Scenario,
    *,
    method: str | None = None,
    digits: int = 2,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Result:
    """Verdict on a method of propagation by adaptive Monte Carlo, pose by pose."""
    axis = scenario.axis
    found = validation.validate(
        scenario, method=_chosen(method), digits=digits, workers=workers, progress=progress
    )
    low, high = found.coverage_interval()
    distance = np.fmax(found.distance_lower, found.distance_upper)
    # where a radar sees nothing there is no deviation and no δ, and no distance either
    without = np.where(distance > 0, np.inf, distance)
    ratio = np.divide(distance, found.delta, out=without, where=found.delta > 0)
    no_result = ~np.isfinite(found.moments.lower + found.moments.upper)
    count = int(np.count_nonzero(found.validated))
    name = _band_name(method)
    report = [
        f"{name} 3-sigma interval ({scenario.level}), {digits} significant "
        f"digit{'s' if digits > 1 else ''}: "
        + ("validated" if found.verdict == "validated" else "NOT validated"),
        f"  validated at {count} of {len(axis)} poses",
    ]
    if place := where(no_result, axis):
        report.append(f"  no result {place}")
    if place := where(found.refuted & ~no_result, axis):
        report.append(f"  refuted {place}")
    if place := where(found.undecided, axis):
        report.append(f"  undecided {place}: the draws did not become stable")
    worst = peak(ratio, axis)
    if not no_result.all():
        pose = int(np.argmax(reached(ratio)))
        report += [
            f"  farthest for what is allowed: {distance[pose]:.2g} "
            f"at {axis.at(pose)}, where {found.delta[pose]:.1g} is",
            f"  coverage {np.nanmin(found.coverage):.2%} to {np.nanmax(found.coverage):.2%} "
            f"of {found.runs.min():,} to {found.runs.max():,} draws a pose, "
            f"{WITHIN_3_SIGMA:.2%} expected",
        ]
    return Result(
        analysis="validate",
        scenario=scenario,
        method=_chosen(method),
        table={
            axis.key: axis.values,
            **_band(found.moments),
            **_drawn(found.mc_mean, found.mc_std, found.mc_lower, found.mc_upper),
            "delta": found.delta,
            "distance_lower": found.distance_lower,
            "distance_upper": found.distance_upper,
            "runs": found.runs.astype(float),
            "coverage_3sigma": found.coverage,
            "coverage_low": low,
            "coverage_high": high,
            "stable": found.stable.astype(float),
            "validated": found.validated.astype(float),
            **_mean(found.moments.mean, method),
        },
        summary={
            "verdict": found.verdict,
            "digits": digits,
            "poses_validated": count,
            "poses_refuted": int(np.count_nonzero(found.refuted)),
            "poses_undecided": int(np.count_nonzero(found.undecided)),
            "largest_distance_by_delta": worst,
            "radar_constants_set_to_zero": found.clipped,
        },
        report=tuple(report),
        warnings=(
            *_doubts(scenario, found.moments, method),
            *_not_as_taken(scenario, method),
            *_clipped(found.clipped),
        ),
        passed=found.verdict == "validated",
    )


def detectors(scenario: Scenario) -> Result:
    """P_D of every detector by P_fa and S, and how far North's approximation is from the exact."""
    p_fas = sorted({*P_FAS, *(model.p_fa for model in scenario.model.models)}, reverse=True)
    p_d = {
        name: np.concatenate(
            [DETECTORS[name]().p_d(10.0 ** (SNR_DB / 10.0), p_fa) for p_fa in p_fas]
        )
        for name in DISTINCT
    }
    error = p_d["north"] - p_d["marcum"]
    worst = []
    for p_fa, errors in zip(p_fas, error.reshape(len(p_fas), -1), strict=True):
        i = int(np.argmax(abs(errors)))
        worst.append({"p_fa": p_fa, "error": float(errors[i]), "snr_db": float(SNR_DB[i])})
    snr = scenario.model.snr(scenario.aircraft, scenario.radar)
    of_radars = []
    for model, ratio in zip(scenario.model.models, snr.reshape(len(snr), -1).T, strict=True):
        north, exact = (DETECTORS[name]().p_d(ratio, model.p_fa) for name in DISTINCT[:2])
        of_radars.append(abs(north - exact))
    at_poses = peak(np.max(of_radars, axis=0), scenario.axis)
    return Result(
        analysis="detectors",
        scenario=scenario,
        table={
            "p_fa": np.repeat(p_fas, len(SNR_DB)),
            "snr_db": np.tile(SNR_DB, len(p_fas)),
            **{f"p_d_{name}": values for name, values in p_d.items()},
            "north_less_marcum": error,
        },
        summary={"largest_error_of_north": worst, "error_of_north_at_poses": at_poses},
        report=(
            "largest error of North's approximation, its P_D less that of Marcum:",
            *(f"  P_fa {w['p_fa']:<8g} {w['error']:+.4f} at {w['snr_db']:.1f} dB" for w in worst),
            f"at a pose of this scenario at most {at(at_poses, scenario.axis)}",
        ),
        warnings=(),
    )


def _largest_by_radar(scenario: Scenario, method: str | None) -> dict[str, dict[str, Any]]:
    """Largest 3σ of P_D, and where, of each radar of a network by itself."""
    return {
        name: peak(3 * propagate_scenario(one, method=_chosen(method)).std, scenario.axis)
        for name, one in alone(scenario).items()
    }


def _by_radar(said: Mapping[str, str], how: str = "") -> tuple[str, ...]:
    """Return a line for each radar of a network, under a heading; nothing for a single radar."""
    if not said:
        return ()
    width = max(map(len, said))
    return (
        f"largest {f'{how} ' if how else ''}3 sigma of each radar by itself (more with --radar):",
        *(f"  {name:{width}}  {words}" for name, words in said.items()),
    )


def _by_radar_summary(found: Mapping[str, Any]) -> dict[str, Any]:
    return {"largest_three_sigma_by_itself": dict(found)} if found else {}


def _chosen(method: str | None) -> str:
    return "linear" if method is None else method


def _drawn(
    mean: FloatArray, std: FloatArray, lower: FloatArray, upper: FloatArray
) -> dict[str, FloatArray]:
    return {"mc_mean": mean, "mc_std": std, "mc_lower": lower, "mc_upper": upper}


def _towards(scenario: Scenario) -> dict[str, FloatArray]:
    """Return the columns of what a single radar has to do with; none for a network."""
    aircraft, radar = scenario.aircraft, scenario.radar
    if len(scenario.model.models) > 1:
        return {}
    snr = scenario.model.snr(aircraft, radar).reshape(len(aircraft))
    with np.errstate(divide="ignore"):  # no cross section, no signal: −inf dB
        snr_db = 10.0 * np.log10(snr)
    return {
        "range_m": slant_range(aircraft, radar),
        "rcs_m2": scenario.model.rcs.cross_section(body_vector(aircraft, radar)),
        "snr_db": snr_db,
    }


def _band(moments: Moments) -> dict[str, FloatArray]:
    return {
        "p_d": moments.p_d,
        "sigma_pd": moments.std,
        "lower_3sigma": moments.lower,
        "upper_3sigma": moments.upper,
    }


def _mean(mean: FloatArray, method: str | None, ending: str = "") -> dict[str, FloatArray]:
    """Return the column for the method's mean; the paper's tables, without a method, have none."""
    return {} if method is None else {f"mean_pd{ending}": mean}


def _by(method: str | None) -> str:
    return "" if method is None else f" ({method})"


def _named(level: str, method: str | None) -> str:
    return level if method is None else f"{level}, {method}"


def _band_name(method: str | None) -> str:
    return "linearized" if method in (None, "linear") else str(method)


def _doubts(scenario: Scenario, moments: Moments, method: str | None) -> tuple[str, ...]:
    """Say where the band of a method is not to be trusted."""
    name, axis = _band_name(method), scenario.axis
    nonlinear = nonlinear_in_scenario(scenario, moments, method=_chosen(method))
    undefined = ~np.isfinite(moments.std)
    outside = (moments.lower < 0) | (moments.upper > 1)
    said = (
        (~moments.converged, f"{name} did not converge, or its gradient is undefined,"),
        (
            undefined & moments.converged,
            "the gradient is undefined, with the radar straight above or below the aircraft,",
        ),
        (outside, f"the {name} 3-sigma band leaves [0, 1]"),
        (
            nonlinear & ~undefined,
            "effects of higher order would change sigma by over "
            f"{STD_CHANGE:.0%} or a bound by over {BOUND_CHANGE:g}: do not rely on the {name} band",
        ),
    )
    return tuple(f"{words} {place}" for mask, words in said if (place := where(mask, axis)))


def _points(mc: MonteCarlo) -> str:
    return "" if mc.sampler == "random" else ", Sobol' points"


def _rank_error(mc: MonteCarlo) -> tuple[str, ...]:
    """Say how far the quantiles may be off where not all draws of the tails could be kept."""
    if not mc.rank_error:
        return ()
    share = mc.rank_error / (TAIL * mc.runs)
    return (f"quantiles at the probability 0.00135 to within {share:.2%} of it",)


def _not_as_taken(scenario: Scenario, method: str | None) -> tuple[str, ...]:
    """Say so if a radar constant is not distributed as the method takes it to be."""
    chosen = METHODS[_chosen(method)]
    return doubts(scenario.model.names, scenario.parts, chosen.name, log_normal=chosen.log_normal)


def _clipped(count: int) -> tuple[str, ...]:
    if not count:
        return ()
    return (f"the radar constant was drawn below zero and set to zero in {count} runs",)


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
        if place := where(nothing, scenario.axis):
            doubts.append(
                f"the gradient for {source} vanishes {place}: only effects of second order remain "
                "there, which the linearized budget leaves out"
            )
    return tuple(doubts)


def _correlated(
    alone: Mapping[str, FloatArray], total: FloatArray, method: str | None
) -> tuple[str, ...]:
    """Say so if linear contributions do not add up, because sources are correlated."""
    if _chosen(method) != "linear":
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
    scenario: Scenario, method: str | None, ranked: Sequence[str], pose: int, total: float
) -> tuple[str, ...]:
    """Say which part of a radar constant is worth measuring better, and what that would bring."""
    if not ranked or not total > 0:
        return ()
    several = "s" if len(scenario.parts) > 1 else ""
    said = f"of the radar constant{several}, {_short(ranked[0])} is what to measure better first"
    if method == MONTE_CARLO:
        return (said,)
    halved = scaled_moments(scenario, _chosen(method), [ranked[0]], 0.5).std
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
    target: float, only_at: float | None, found: Mapping[str, Allowance], axis: Axis
) -> dict[str, Any]:
    return {
        "three_sigma": target,
        f"at_{axis.unit}": only_at,
        "allowances": {
            source: {
                axis.key if key == "place" else key: value
                for key, value in dataclasses.asdict(allowance).items()
            }
            for source, allowance in found.items()
        },
    }


def _inverse_report(
    target: float, only_at: float | None, found: Mapping[str, Allowance], axis: Axis
) -> list[str]:
    place = "every pose" if only_at is None else f"{axis.say(only_at)}"
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
