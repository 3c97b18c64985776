"""The analyses: from a scenario to one table, one summary and a few lines for a person."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_sense import covariance
from radar_sense.geometry import body_vector, slant_range
from radar_sense.model import Linearization
from radar_sense.montecarlo import WITHIN_3_SIGMA, MonteCarlo, monte_carlo
from radar_sense.scenario import Scenario
from radar_sense.states import SOURCES, FloatArray

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
        monte_carlo: The draws behind the table, if there were any.
    """

    analysis: str
    scenario: Scenario
    table: Mapping[str, FloatArray]
    summary: Mapping[str, Any]
    report: tuple[str, ...]
    warnings: tuple[str, ...]
    monte_carlo: MonteCarlo | None = None


def variance(scenario: Scenario) -> Result:
    """P_D along the geometry with its linearized standard deviation and 3σ band."""
    aircraft, radar, theta = scenario.aircraft, scenario.radar, scenario.theta_r_deg
    linear = scenario.model.linearize(aircraft, radar)
    sigma_pd = linear.std(scenario.cov_aircraft, scenario.cov_radar[scenario.level])
    snr = scenario.model.snr(aircraft, radar)
    with np.errstate(divide="ignore"):  # no cross section, no signal: −inf dB
        snr_db = 10.0 * np.log10(snr)
    low, high = _trough(linear.p_d, theta), _peak(linear.p_d, theta)
    worst = _peak(3 * sigma_pd, theta)
    return Result(
        analysis="variance",
        scenario=scenario,
        table={
            "theta_r_deg": theta,
            "range_m": slant_range(aircraft, radar),
            "rcs_m2": scenario.model.rcs.cross_section(body_vector(aircraft, radar)),
            "snr_db": snr_db,
            "p_d": linear.p_d,
            "sigma_pd": sigma_pd,
            "lower_3sigma": linear.p_d - 3 * sigma_pd,
            "upper_3sigma": linear.p_d + 3 * sigma_pd,
        },
        summary={"lowest_p_d": low, "highest_p_d": high, "largest_three_sigma": worst},
        report=(
            f"P_D runs from {_at(low)} to {_at(high)}",
            f"largest 3 sigma of P_D ({scenario.level}): {_at(worst)}",
        ),
        warnings=_doubts(linear.p_d, sigma_pd, theta),
    )


def sensitivity(scenario: Scenario) -> Result:
    """Linearized 3σ of P_D for every level of radar uncertainty."""
    theta = scenario.theta_r_deg
    linear = scenario.model.linearize(scenario.aircraft, scenario.radar)
    sigma = {
        level: linear.std(scenario.cov_aircraft, cov_radar)
        for level, cov_radar in scenario.cov_radar.items()
    }
    worst = {level: _peak(3 * s, theta) for level, s in sigma.items()}
    width = max(map(len, worst))
    return Result(
        analysis="sensitivity",
        scenario=scenario,
        table={
            "theta_r_deg": theta,
            **{f"three_sigma_{level}": 3 * s for level, s in sigma.items()},
        },
        summary={"largest_three_sigma": worst},
        report=(
            "largest 3 sigma of P_D by level:",
            *(f"  {level:{width}}  {_at(peak)}" for level, peak in worst.items()),
        ),
        warnings=tuple(
            f"{level}: {doubt}"
            for level, s in sigma.items()
            for doubt in _doubts(linear.p_d, s, theta)
        ),
    )


def budget(scenario: Scenario) -> Result:
    """Linearized 3σ of P_D from each source of uncertainty alone, and from all together."""
    theta, cov_radar = scenario.theta_r_deg, scenario.cov_radar[scenario.level]
    linear = scenario.model.linearize(scenario.aircraft, scenario.radar)
    alone = {
        source: 3 * _std_from(linear, source, scenario.cov_aircraft, cov_radar)
        for source in SOURCES
    }
    total = 3 * linear.std(scenario.cov_aircraft, cov_radar)
    worst = _peak(total, theta)
    pose = int(np.argmax(_reached(total)))  # the first of several that differ by rounding alone
    at_worst = {source: float(values[pose]) for source, values in alone.items()}
    ranked = sorted(at_worst, key=at_worst.__getitem__, reverse=True)
    dominant = np.argmax(np.stack([alone[source] for source in SOURCES]), axis=0)
    dominates = {
        source: where
        for i, source in enumerate(SOURCES)
        if (where := _where((dominant == i) & (total > 0), theta))
    }
    return Result(
        analysis="budget",
        scenario=scenario,
        table={
            "theta_r_deg": theta,
            **{f"three_sigma_{source}": values for source, values in alone.items()},
            "three_sigma_total": total,
        },
        summary={
            "largest_three_sigma_total": worst,
            "at_largest": at_worst,
            "dominant": ranked[0],
            "dominates": dominates,
        },
        report=(
            f"3 sigma of P_D ({scenario.level}) at {theta[pose]:g} deg, "
            "where the total is largest, and share of its variance:",
            *(
                f"  {source:21}{at_worst[source]:.4f} {_share(at_worst[source], total[pose])}"
                for source in ranked
            ),
            f"  {'total':21}{total[pose]:.4f}",
            *(f"{source} dominates {where}" for source, where in dominates.items()),
        ),
        warnings=(
            *_doubts(linear.p_d, total / 3, theta),
            *_vanishing(alone, total, theta),
            *_correlated(alone, total),
        ),
    )


def montecarlo(
    scenario: Scenario, *, workers: int = 1, progress: Callable[[int], None] | None = None
) -> Result:
    """Monte Carlo draws of P_D against the linearized 3σ band."""
    theta = scenario.theta_r_deg
    mc = monte_carlo(scenario, workers=workers, progress=progress)
    low, high = mc.coverage_interval()
    pose = int(np.argmin(mc.coverage))
    # Bonferroni: with 95 % confidence none of the poses is called inconsistent by chance.
    lowest, highest = mc.coverage_interval(1 - 0.05 / len(theta))
    off = (highest < WITHIN_3_SIGMA) | (lowest > WITHIN_3_SIGMA)
    overall = float(mc.coverage.mean())
    warnings = list(_doubts(mc.p_d, mc.sigma_pd, theta))
    if off.any():
        warnings.append(
            "the linearized band does not hold the 99.73 % of the draws that it should "
            f"{_where(off, theta)} (95 % confidence for all poses together)"
        )
    if mc.clipped:
        warnings.append(
            f"the radar constant was drawn below zero and set to zero in {mc.clipped} "
            f"of {mc.runs} runs"
        )
    return Result(
        analysis="montecarlo",
        scenario=scenario,
        table={
            "theta_r_deg": theta,
            "p_d": mc.p_d,
            "sigma_pd": mc.sigma_pd,
            "lower_3sigma": mc.p_d - 3 * mc.sigma_pd,
            "upper_3sigma": mc.p_d + 3 * mc.sigma_pd,
            "mc_mean": mc.mean,
            "mc_std": mc.std,
            "mc_lower": mc.lower,
            "mc_upper": mc.upper,
            "coverage_3sigma": mc.coverage,
        },
        summary={
            "runs": mc.runs,
            "coverage_expected": WITHIN_3_SIGMA,
            "coverage_overall": overall,
            "coverage_lowest": {
                "value": float(mc.coverage[pose]),
                "theta_r_deg": float(theta[pose]),
                "confidence_95": [float(low[pose]), float(high[pose])],
            },
            "coverage_confidence_95": {"lower": low.tolist(), "upper": high.tolist()},
            "poses_inconsistent": int(np.count_nonzero(off)),
            "largest_mean_shift": _peak(abs(mc.mean - mc.p_d), theta),
            "radar_constants_set_to_zero": mc.clipped,
        },
        report=(
            f"{mc.runs} runs ({scenario.level}, seed {mc.seed}): {overall:.2%} of the draws lie "
            f"in the linearized 3-sigma band, {WITHIN_3_SIGMA:.2%} would if P_D were normal",
            f"lowest coverage {mc.coverage[pose]:.2%} at {theta[pose]:g} deg "
            f"(95 % confidence {low[pose]:.2%} to {high[pose]:.2%})",
        ),
        warnings=tuple(warnings),
        monte_carlo=mc,
    )


def _std_from(
    linear: Linearization, source: str, cov_aircraft: FloatArray, cov_radar: FloatArray
) -> FloatArray:
    whose, components = SOURCES[source]
    certain_aircraft, certain_radar = np.zeros_like(cov_aircraft), np.zeros_like(cov_radar)
    if whose == "aircraft":
        return linear.std(covariance.only(cov_aircraft, components), certain_radar)
    return linear.std(certain_aircraft, covariance.only(cov_radar, components))


def _doubts(p_d: FloatArray, sigma: FloatArray, theta: FloatArray) -> tuple[str, ...]:
    """Say where the linearized band cannot be right."""
    doubts = []
    undefined = ~np.isfinite(sigma)
    if undefined.any():
        doubts.append(
            "the linearization is undefined, with the radar straight above or below the aircraft, "
            f"{_where(undefined, theta)}"
        )
    outside = (p_d - 3 * sigma < 0) | (p_d + 3 * sigma > 1)
    if outside.any():
        doubts.append(f"the linearized 3-sigma band leaves [0, 1] {_where(outside, theta)}")
    return tuple(doubts)


def _vanishing(
    alone: Mapping[str, FloatArray], total: FloatArray, theta: FloatArray
) -> tuple[str, ...]:
    """Say where first order reports (nearly) nothing for a source that matters elsewhere."""
    doubts = []
    for source, values in alone.items():
        part = np.divide(values, total, out=np.zeros_like(total), where=total > 0)
        if where := _where((part < VANISHING * part.max()) & (total > 0), theta):
            doubts.append(
                f"the gradient for {source} vanishes {where}: only effects of second order remain "
                "there, which the linearized budget leaves out"
            )
    return tuple(doubts)


def _correlated(alone: Mapping[str, FloatArray], total: FloatArray) -> tuple[str, ...]:
    """Say so if the sources do not add up because they are correlated."""
    together = np.sqrt(sum(values**2 for values in alone.values()))
    gap = np.nanmax(abs(total - together), initial=0)
    if gap <= 1e-9 * np.nanmax(total, initial=0):
        return ()
    return (
        "the sources are correlated: the total differs from the root sum of squares "
        f"by up to {gap:.2g}",
    )


def _peak(values: FloatArray, theta: FloatArray) -> dict[str, Any]:
    """Return the largest value and all angles at which it is reached."""
    if not np.isfinite(values).any():
        return {"value": float("nan"), "theta_r_deg": []}
    return {"value": float(np.nanmax(values)), "theta_r_deg": theta[_reached(values)].tolist()}


def _reached(values: FloatArray) -> NDArray[np.bool_]:
    """Mark the poses at which the largest value is reached.

    Poses that mirror each other differ by rounding, which must not decide between them.
    """
    top = np.nanmax(values, initial=-np.inf)
    return np.greater_equal(values, top - 1e-9 * abs(top))


def _trough(values: FloatArray, theta: FloatArray) -> dict[str, Any]:
    peak = _peak(-values, theta)
    return {**peak, "value": -peak["value"]}


def _at(peak: Mapping[str, Any]) -> str:
    angles = peak["theta_r_deg"]
    if not angles:
        return "undefined"
    if len(angles) > 3:
        place = f"{len(angles)} poses"
    else:
        *others, last = (f"{angle:g}" for angle in angles)
        place = f"{', '.join(others)} and {last} deg" if others else f"{last} deg"
    return f"{peak['value']:.4f} at {place}"


def _share(part: float, total: float) -> str:
    return f"{(part / total) ** 2:6.1%}" if total > 0 else ""


def _where(mask: NDArray[np.bool_], theta: FloatArray) -> str:
    """Describe the poses of a mask; nothing if there are none."""
    count = int(np.count_nonzero(mask))
    if count == 0:
        return ""
    if count == mask.size:
        return "at every pose" if count > 1 else f"at {theta[0]:g} deg"
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    spans = [
        f"{theta[a]:g}" if b - a == 1 else f"{theta[a]:g} to {theta[b - 1]:g}"
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]
    if len(spans) > 4:
        first, last = theta[mask][[0, -1]]
        return f"at {count} of {mask.size} poses between {first:g} and {last:g} deg"
    return f"at {', '.join(spans)} deg"
