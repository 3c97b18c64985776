"""A mission: the cumulative P_D by each look along a path, and its bounds.

A mission needs a path with times, and the time from one look of a radar to the next,
`radar.scan_period_s`. Each radar has a first look at the first pose. Between two poses the aircraft
flies a straight line. The line is in latitude and longitude if the path follows the curve of the
earth, and in the local frame otherwise. The attitude turns the short way at a constant rate. The
covariance is interpolated linearly. Poses far apart in a turn make a poor path.
`geometry.interpolate` adds poses. The errors of the poses have the correlation time
`uncertainty.aircraft_correlation_s`. The errors of a radar are the same at all looks.

The radars of a network with the same scan period are a scan group. They look together, and the
looks of a group at one time are one look. P_c counts the looks of all radars. A track is m
detections in n consecutive looks of one scan group. The network has a track when a scan group has a
track.

The default method is importance sampling, see `mission.importance`. The methods `linear` and
`probit` are of first order. First order is not enough for tracks, or for errors of kilometres or
decibels.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from radar_sense import axis
from radar_sense.analyses.columns import AXIS, Column, of_radars, quantities, quantity
from radar_sense.analyses.contract import OPTIONS, Option, Progress, Result, analysis, silent
from radar_sense.axis import Axis
from radar_sense.errors import InputError
from radar_sense.flight import Path
from radar_sense.limits import MIN_RANGE, RUNS, WINDOW
from radar_sense.mission.cumulative import METHODS as FIRST_ORDER
from radar_sense.mission.cumulative import Cumulative, cumulative_detection
from radar_sense.mission.draws import MissionDraws, mission_monte_carlo
from radar_sense.mission.importance.sampling import REPLICATES, importance_sampling
from radar_sense.mission.schedule import Schedule, schedule_looks
from radar_sense.mission.tracks import track_initiation
from radar_sense.model.geometry import slant_range
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.montecarlo.statistics import DrawStatistics
from radar_sense.scenario import Scenario, single_radar_scenarios
from radar_sense.states import RADAR, FloatArray
from radar_sense.words import (
    clipping_warnings,
    describe_extreme,
    distribution_warnings,
    listed,
    monte_carlo_columns,
    outside_unit_interval,
    peak,
    problem_warnings,
)

if TYPE_CHECKING:
    from radar_sense.plotting import Figure

#: The default method: importance sampling.
IMPORTANCE = "importance"
#: All methods that can be named.
METHODS = (IMPORTANCE, *FIRST_ORDER)
#: Probabilities whose times are in the report.
MILESTONES = (0.5, 0.9)
#: First order needs some 0.6 GB for a track of MAX_TRACK_LOOKS looks. The memory grows with the
#: square of the looks.
MAX_TRACK_LOOKS = 4000
#: Limit of looks² 2^(n − 1), which first order computes in half a minute.
MAX_TRACK_WORK = 2e9


def with_schedule(scenario: Scenario) -> tuple[Scenario, Schedule]:
    """Return the scenario with a pose for each time of a look, and the looks.

    Raises:
        InputError: If the geometry has no times, or a radar has no scan period. Also if the
            aircraft is on top of a radar at a look.
    """
    flight = scenario.geometry
    if not isinstance(flight, Path):
        raise InputError(
            "a mission needs times, which an orbit does not have: "
            "give a path, geometry: {type: path, file: my_route.csv}"
        )
    schedule, poses = schedule_looks(scenario.model, flight.route)
    along = axis.time(schedule.time)
    # The interpolated line may be nearer to a radar than any pose of the path.
    for radar in scenario.radar.reshape(-1, len(RADAR)):
        distance = slant_range(poses.aircraft, radar)
        nearest = int(np.argmin(distance))
        if distance[nearest] < MIN_RANGE:
            raise InputError(
                f"the aircraft is on top of the radar at the look at {along.at(nearest)}, slant "
                f"range {distance[nearest]:.2g} m; allowed is {MIN_RANGE:g} m or more"
            )
    looks = dataclasses.replace(
        flight,
        axis=along,
        aircraft=poses.aircraft,
        covariance=poses.covariance,
        time_s=schedule.time,
    )
    return scenario.along(looks), schedule


def plot(result: Result, figure: Figure) -> None:
    """Draw the figure."""
    from radar_sense import plotting

    table = result.table
    tracked = "track_p_d" in table
    (top, *below), x = plotting.pose_panels(figure, 3 if tracked else 2, result.scenario.axis)
    names = result.scenario.model.names
    line_styles = plotting.styles(plotting.BAND, plotting.LINES[0])
    radars = dict(zip(names if len(names) > 1 else (), line_styles, strict=False))
    radar_lines = []
    for name, style in radars.items():
        looks = np.isfinite(table[f"p_d_{name}"])
        plotting.draw_line(top, x[looks], table[f"p_d_{name}"][looks], style, label=name)
        top.lines[-1].set_linewidth(plotting.points(0.8))
        radar_lines.append(top.lines[-1])
    if not radars:
        plotting.draw_line(top, x, table["p_d"], ("black", "-"), label=r"$P_D$ of a look")
        if len(x) <= 100:
            top.lines[-1].set(marker="o", markersize=plotting.points(1.8))
    top.set_ylabel(r"$P_D$ of a look")
    events = [("", "cumulative_p_d", r"Cumulative $P_D$"), ("track_", "track_p_d", "Track")]
    for axes, (before, column, name) in zip(below, events, strict=False):
        for radar, style in radars.items():
            plotting.draw_line(axes, x, table[f"{column}_{radar}"], style)
            axes.lines[-1].set_linewidth(plotting.points(0.8))
        if f"{before}mc_mean" in table:
            ends = table[f"{before}mc_lower"], table[f"{before}mc_upper"]
            plotting.draw_fill(axes, x, *ends, color="0.8", lw=0, label="Monte Carlo")
        plotting.draw_line(axes, x, table[column], plotting.LINES[0], label="nominal")
        plotting.draw_band(
            axes,
            x,
            table[f"{before}lower_3sigma"],
            table[f"{before}upper_3sigma"],
            result.band_label,
        )
        if f"{before}mc_mean" in table:
            some = slice(None, None, -(-len(x) // 40))
            mean = table[f"{before}mc_mean"]
            axes.plot(x[some], mean[some], "k.", ms=plotting.points(2.5), label="mean of runs")
        if before:
            name = "Track, {} of {}".format(*result.summary["m_of_n"])
            by_radar = result.summary.get("radars", {}).values()
            if len({radar["scan_period_s"] for radar in by_radar}) > 1:
                name += "\nlooks of one period"
        axes.set_ylabel(name)
    plotting.draw_legend(figure, *([top] if radars else []), *below[:1], on_lines=radar_lines)


_METHOD = dataclasses.replace(
    OPTIONS["method"],
    help="importance (importance sampling), or of first order: probit, linear.",
    default=IMPORTANCE,
    choices=METHODS,
)
_M = Option("m", "With --n: detections that start a track.", WINDOW)
_N = Option("n", "With --m: length of the window of consecutive looks.", WINDOW)
_RUNS = Option("runs", "Also make this number of plain draws.", RUNS, default_text="none")


#: Names of the columns of each event: prefix of bounds, stem of σ and mean, and the probability.
_COLUMNS = {
    "detection": ("", "cumulative", "cumulative_p_d"),
    "track": ("track_", "track", "track_p_d"),
}


def _columns(event: str, what: str) -> tuple[Column, ...]:
    """Return the columns of an event."""
    before, name, p = _COLUMNS[event]
    return quantities(
        {
            p: f"Probability that {what} by now.",
            f"sigma_{name}": "Standard deviation of this probability.",
            f"{before}lower_3sigma": "Lower 3-sigma bound of this probability.",
            f"{before}upper_3sigma": "Upper 3-sigma bound of this probability.",
            f"{before}mc_mean": "With --runs: mean of the draws of this probability.",
            f"{before}mc_std": "With --runs: standard deviation of the draws.",
            f"{before}mc_lower": "With --runs: quantile 0.00135 of the draws.",
            f"{before}mc_upper": "With --runs: quantile 0.99865 of the draws.",
            f"mean_{name}": "Mean of this probability over the uncertain states.",
            f"{before}lower_3sigma_se": "Standard error of the lower bound; by importance.",
            f"{before}upper_3sigma_se": "Standard error of the upper bound; by importance.",
        }
    )


_OF_EVENTS = (
    *_columns("detection", "the aircraft has been detected"),
    *_columns("track", "a track has been started (with --m and --n)"),
)
_TABLE = (
    *AXIS,
    quantity("p_d", "P_D of the look, or of all looks at this time together."),
    *_OF_EVENTS,
    *of_radars((quantity("p_d", "P_D of the look."), *_OF_EVENTS)),
)


@analysis(
    plot=plot,
    columns=_TABLE,
    options=["level", "radar", _METHOD, _M, _N, _RUNS, "seed", "workers"],
    examples=[
        "radar-sense mission my.yaml",
        "radar-sense mission my.yaml --m 3 --n 5 --runs 10000",
    ],
)
def mission(
    scenario: Scenario,
    *,
    method: str = IMPORTANCE,
    m: int | None = None,
    n: int | None = None,
    runs: int | None = None,
    workers: int = 1,
    progress: Progress = silent,
) -> Result:
    """Cumulative P_D over the looks along a path.

    The scenario must have a path, whose poses have times. The time between looks of a radar is
    radar.scan_period_s. The pose errors are correlated over uncertainty.aircraft_correlation_s. The
    radar errors are the same at all looks. The last columns are the standard errors of the bounds.

    A track is M detections in N consecutive looks. Radars of a network with the same period look
    together, as one radar. The network has a track when the radars of one period have a track.

    Args:
        scenario: The scenario, whose geometry is a path.
        method: "importance", or of first order "probit" or "linear".
        m: Detections that start a track; with n.
        n: Length of the window of consecutive looks.
        runs: Plain draws of the mission to compare with; None draws none.
        workers: Threads to draw with; the result does not depend on their number.
        progress: Shows the replicates of importance sampling and the plain draws that are done.

    Raises:
        InputError: If the geometry has no times, or an option is not allowed.
    """
    if (m is None) != (n is None):
        raise InputError("m and n belong together, such as m 3 and n 5")
    m_of_n = None if m is None or n is None else (m, n)
    scenario, schedule = with_schedule(scenario.with_analysis(runs=runs))
    along = scenario.axis
    if m_of_n is not None:
        _check_window(*m_of_n, len(schedule.pose), method)
    network, by_radar = _missions(scenario, schedule, m_of_n, method, workers, progress)
    drawn = None
    if runs is not None:
        with progress(runs, "runs") as advance:
            drawn = _draw(scenario, schedule, m_of_n, workers, advance)
    names = {"detection": "cumulative P_D"}
    if m_of_n is not None:
        names["track"] = "track, {} of {}".format(*m_of_n)
    summaries = _summaries(network.events, along)
    differences = (
        {}
        if drawn is None
        else {e: _differences(v, drawn.events[e], along) for e, v in network.events.items()}
    )
    errors = _standard_errors(network.events, along)
    return Result(
        scenario=scenario,
        method=method,
        table={
            along.key: along.values,
            **_table(network, drawn),
            **_columns_by_radar(by_radar, _table),
            **_table_of_errors(network),
            **_columns_by_radar(by_radar, _table_of_errors),
        },
        summary={
            "looks": len(along),
            "m_of_n": None if m_of_n is None else list(m_of_n),
            **summaries,
            **({"largest_standard_error_of_bounds": errors} if errors else {}),
            "monte_carlo": None
            if drawn is None
            else {
                "runs": drawn.runs,
                "radar_constants_set_to_zero": drawn.clipped,
                "largest_difference": differences,
            },
            **_summary_by_radar(by_radar, along),
        },
        report=(
            _describe_looks(scenario, schedule),
            *(
                line
                for event in network.events
                for line in _describe_event(names[event], scenario, method, summaries[event])
            ),
            *(
                f"{names[event]}: standard error of the 3-sigma bounds at most "
                f"{describe_extreme(error, along)}"
                for event, error in errors.items()
            ),
            *_report_by_radar(by_radar),
            *_report_of_draws(drawn, method, names, differences, along),
        ),
        warnings=_warnings(scenario, method, network.events, names, drawn),
    )


@dataclass(frozen=True, eq=False)
class _Mission:
    """The mission of a network, or of one radar.

    Attributes:
        period: Scan period of the radar [s]; None for the network.
        looks: Number of times with a look.
        p_d: P_D of the looks at each time (K,), NaN where there is no look.
        events: Probability by each time (K,) of detection, and of a track if m and n are given.
    """

    period: float | None
    looks: int
    p_d: FloatArray
    events: dict[str, Cumulative]


def _missions(
    scenario: Scenario,
    schedule: Schedule,
    m_of_n: tuple[int, int] | None,
    method: str,
    workers: int,
    progress: Progress,
) -> tuple[_Mission, dict[str, _Mission]]:
    """Return the mission of the network, and the mission of each radar alone by name."""
    radars = single_radar_scenarios(scenario)
    single = []
    for i, radar in enumerate(radars.values()):
        radar_schedule, times = schedule.of_radar(i)
        single.append((radar.at_poses(times), radar_schedule, times))
    if method == IMPORTANCE:
        with progress(REPLICATES, "replicates") as advance:
            cumulatives = importance_sampling(
                scenario, schedule, m_of_n, workers=workers, progress=advance
            )
    else:
        cumulatives = [_first_order(scenario, schedule, m_of_n, method)]
        for radar, radar_schedule, times in single:
            latest = np.searchsorted(times, np.arange(len(schedule.time)), side="right") - 1
            of_radar = _first_order(radar, radar_schedule, m_of_n, method)
            cumulatives.append(tuple(event.at(latest) for event in of_radar))
    network, *by_radar = (
        dict(zip(("detection", "track"), events, strict=False)) for events in cumulatives
    )
    missions = {}
    for name, (radar, radar_schedule, times), events in zip(radars, single, by_radar, strict=True):
        p_d = np.full(len(schedule.time), np.nan)
        p_d[times] = _p_d(radar, radar_schedule)
        missions[name] = _Mission(radar_schedule.period[0], len(times), p_d, events)
    return (
        _Mission(None, len(schedule.time), _p_d(scenario, schedule), network),
        missions,
    )


def _first_order(
    scenario: Scenario, schedule: Schedule, m_of_n: tuple[int, int] | None, method: str
) -> tuple[Cumulative, ...]:
    """Return the probability by each time (K,) of detection, and of a track, to first order."""
    looks = schedule.linearize(scenario)
    covariances = scenario.at_poses(schedule.pose).cov_aircraft, scenario.cov_shared
    tau = scenario.correlation_s
    events = [cumulative_detection(looks, *covariances, correlation_time=tau, method=method)]
    if m_of_n is not None:
        events.append(
            track_initiation(
                looks,
                *m_of_n,
                *covariances,
                correlation_time=tau,
                scan_group=schedule.scan_group,
                method=method,
            )
        )
    return tuple(event.at(schedule.last) for event in events)


def _draw(
    scenario: Scenario,
    schedule: Schedule,
    m_of_n: tuple[int, int] | None,
    workers: int,
    progress: Callable[[int], None] | None,
) -> MissionDraws:
    """Draw the mission and return statistics by each time (K,)."""
    at_looks = scenario.at_poses(schedule.pose)
    drawn = mission_monte_carlo(
        schedule.model(scenario.model),
        schedule.time[schedule.pose],
        at_looks.aircraft,
        at_looks.cov_aircraft,
        Sampler.of(scenario),
        correlation_time=scenario.correlation_s,
        runs=scenario.runs,
        seed=scenario.seed,
        m_of_n=m_of_n,
        scan_group=schedule.scan_group,
        workers=workers,
        progress=progress,
    )
    by_time = {event: statistics.at(schedule.last) for event, statistics in drawn.events.items()}
    return dataclasses.replace(drawn, events=by_time)


def _p_d(scenario: Scenario, schedule: Schedule) -> FloatArray:
    """Return P_D of all radars that look at each time (K,)."""
    p_d = schedule.p_d(scenario)
    if len(p_d) == len(schedule.time):
        return p_d
    with np.errstate(divide="ignore"):  # P_D may round to 1
        hazard = -np.log1p(-p_d)
    fused: FloatArray = -np.expm1(-np.add.reduceat(hazard, schedule.first))
    return fused


def _columns_by_radar(
    missions: Mapping[str, _Mission], table: Callable[[_Mission], Mapping[str, FloatArray]]
) -> dict[str, FloatArray]:
    """Return the columns of each radar, with the name of the radar appended."""
    return {
        f"{key}_{radar}": column
        for radar, mission in missions.items()
        for key, column in table(mission).items()
    }


def _summary_by_radar(missions: Mapping[str, _Mission], along: Axis) -> dict[str, Any]:
    if not missions:
        return {}
    radars = {
        name: {
            "scan_period_s": mission.period,
            "looks": mission.looks,
            **_summaries(mission.events, along),
        }
        for name, mission in missions.items()
    }
    return {"radars": radars}


def _report_by_radar(missions: Mapping[str, _Mission]) -> list[str]:
    if not missions:
        return []
    width = max(map(len, missions))
    lines = ["at the end by each radar alone, with 3-sigma bounds:"]
    for name, mission in missions.items():
        words = [
            f"{event} {v.p[-1]:.4f} ({v.lower[-1]:.4f} to {v.upper[-1]:.4f})"
            for event, v in mission.events.items()
        ]
        lines.append(f"  {name:{width}}  every {mission.period:g} s, {', '.join(words)}")
    return lines


def _check_window(m: int, n: int, looks: int, method: str) -> None:
    if m > n:
        raise InputError(f"m of n needs m not greater than n, got {m} of {n}")
    most = min(MAX_TRACK_LOOKS, math.isqrt(int(MAX_TRACK_WORK) >> (n - 1)))
    if looks > most and method != IMPORTANCE:
        raise InputError(
            f"{m} of {n} by {method} takes at most {most:,} looks, and this path has {looks:,}; "
            "importance takes more"
        )


def _table(mission: _Mission, drawn: MissionDraws | None = None) -> dict[str, FloatArray]:
    """Return the columns of the probability, deviation and bounds of each event, and of draws."""
    table = {"p_d": mission.p_d}
    for event, cumulative in mission.events.items():
        before, stem, p = _COLUMNS[event]
        table[p] = cumulative.p
        table[f"sigma_{stem}"] = cumulative.std
        table[f"{before}lower_3sigma"] = cumulative.lower
        table[f"{before}upper_3sigma"] = cumulative.upper
        if drawn is not None:
            table |= monte_carlo_columns(drawn.events[event], before)
        table[f"mean_{stem}"] = cumulative.mean
    return table


def _table_of_errors(mission: _Mission) -> dict[str, FloatArray]:
    """Return the columns of the standard errors; {} for a method without standard errors."""
    table = {}
    for event, cumulative in mission.events.items():
        before, _, _ = _COLUMNS[event]
        for end, error in (("lower", cumulative.lower_se), ("upper", cumulative.upper_se)):
            if error is not None:
                table[f"{before}{end}_3sigma_se"] = error
    return table


def _standard_errors(events: dict[str, Cumulative], along: Axis) -> dict[str, Any]:
    """Return the largest standard error of the bounds of each event, with the time."""
    return {
        event: peak(np.maximum(cumulative.lower_se, cumulative.upper_se), along)
        for event, cumulative in events.items()
        if cumulative.lower_se is not None and cumulative.upper_se is not None
    }


def _summaries(events: dict[str, Cumulative], along: Axis) -> dict[str, Any]:
    """Return the values of each event at the end, and the times of the milestones."""
    return {
        event: {
            "at_end": _at_end(cumulative),
            "reaches": {f"{level:g}": _reaches(cumulative, level, along) for level in MILESTONES},
        }
        for event, cumulative in events.items()
    }


def _at_end(cumulative: Cumulative) -> dict[str, float]:
    columns = {
        "p": cumulative.p,
        "mean": cumulative.mean,
        "sigma": cumulative.std,
        "lower_3sigma": cumulative.lower,
        "upper_3sigma": cumulative.upper,
    }
    return {name: float(column[-1]) for name, column in columns.items()}


def _reaches(cumulative: Cumulative, level: float, along: Axis) -> dict[str, float | None]:
    """Return the first times at which the probability and the bounds are at a level or above."""

    def first(curve: FloatArray) -> float | None:
        reached = curve >= level
        return float(along.values[np.argmax(reached)]) if reached.any() else None

    return {
        "time_s": first(cumulative.p),
        "earliest_s": first(cumulative.upper),
        "latest_s": first(cumulative.lower),
    }


def _differences(cumulative: Cumulative, drawn: DrawStatistics, along: Axis) -> dict[str, Any]:
    lower, upper = abs(cumulative.lower - drawn.lower), abs(cumulative.upper - drawn.upper)
    return {
        "bounds": peak(np.maximum(lower, upper), along),
        "sigma": peak(abs(cumulative.std - drawn.std), along),
    }


def _describe_looks(scenario: Scenario, schedule: Schedule) -> str:
    along, tau = scenario.axis, scenario.correlation_s
    first, last = along.number(along.values[0]), along.at(-1)
    periods = listed([f"{period:g}" for period in sorted(schedule.period)], "or")
    errors = (
        "independent from look to look"
        if tau == 0
        else "the same at every look"
        if math.isinf(tau)
        else f"correlated over {tau:g} s"
    )
    number = f"{len(along)} looks"
    if len(schedule.radars) > 1:
        number = f"{len(schedule.pose)} looks at {len(along)} time{'s' if len(along) > 1 else ''}"
    return f"{number}, {first} to {last}, every {periods} s; pose errors {errors}"


def _describe_event(
    name: str, scenario: Scenario, method: str, summary: dict[str, Any]
) -> list[str]:
    end = summary["at_end"]
    lines = [
        f"{name} at the end ({scenario.level}, {method}): {end['p']:.4f}, "
        + (
            "its uncertainty is undefined"
            if math.isnan(end["sigma"])
            else f"sigma {end['sigma']:.2g}, "
            f"3-sigma bounds {end['lower_3sigma']:.4f} to {end['upper_3sigma']:.4f}"
        )
    ]
    for level, times in summary["reaches"].items():
        time, earliest, latest = (
            "never" if value is None else scenario.axis.format(value) for value in times.values()
        )
        reaches = f"never reaches {level}" if time == "never" else f"reaches {level} at {time}"
        lines.append(f"  {reaches} (upper bound: {earliest}, lower bound: {latest})")
    return lines


def _report_of_draws(
    drawn: MissionDraws | None,
    method: str,
    names: dict[str, str],
    differences: dict[str, dict[str, Any]],
    along: Axis,
) -> list[str]:
    if drawn is None:
        return []
    lines = [f"{drawn.runs} runs (seed {drawn.seed}), largest difference of {method}:"]
    for event, name in names.items():
        end = drawn.events[event]
        lines += [
            f"  {name}: bounds {describe_extreme(differences[event]['bounds'], along)}, "
            f"sigma {describe_extreme(differences[event]['sigma'], along)}",
            f"    at the end mean {end.mean[-1]:.4f}, sigma {end.std[-1]:.2g}, "
            f"3-sigma bounds {end.lower[-1]:.4f} to {end.upper[-1]:.4f}",
        ]
    return lines


def _warnings(
    scenario: Scenario,
    method: str,
    events: dict[str, Cumulative],
    names: dict[str, str],
    drawn: MissionDraws | None,
) -> tuple[str, ...]:
    warnings: list[str] = []
    for event, cumulative in events.items():
        problems = (
            (
                ~np.isfinite(cumulative.std),
                "the uncertainty is undefined",
                "; the radar is straight above or below the aircraft at a look, where the gradient "
                f"is undefined: use --method {IMPORTANCE}",
            ),
            outside_unit_interval(cumulative.lower, cumulative.upper, method),
        )
        texts = problem_warnings(problems, scenario.axis)
        warnings += [f"{names[event]}: {text}" for text in texts]
    if method != IMPORTANCE:  # first order assumes a distribution of c_r
        warnings += distribution_warnings(scenario, method)
    if drawn is not None and drawn.clipped:
        warnings += clipping_warnings(drawn.clipped)
    return tuple(warnings)
