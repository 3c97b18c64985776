"""A mission: the probability of having been detected by each look along a path, and its bounds.

A mission needs times, so it needs a path, and the time from one look of a radar to the next,
`radar.scan_period_s`. Radars look from the first pose on. Between two poses the position is on the
straight line (in latitude and longitude on one that follows the curve of the earth), the attitude
turns the short way at a constant rate, and the covariance is the weighted mean. So poses far apart
in a turn make a poor path: `geometry.interpolate` fills them in first. The errors of the poses are
correlated as `uncertainty.aircraft_correlation_s` says. The errors of a radar are the same at all
looks.

The radars of a network that have one scan period are a scan group. They look together, and their
looks at one time are one look. P_c counts the looks of all radars. A track is m detections in n
looks in a row of one scan group. The network has a track when a scan group has one.

The default method is importance sampling, see `mission.importance`. The methods `linear` and
`probit` are of first order. That is not enough for tracks, or for errors of kilometres or decibels.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from radar_sense.plotting import Figure

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from radar_sense import axis
from radar_sense.analyses.columns import AXIS, Column, of_radars, quantity
from radar_sense.analyses.contract import OPTIONS, Option, Progress, Result, analysis, silent
from radar_sense.analyses.report import (
    clipping_warnings,
    describe_extreme,
    describe_poses,
    distribution_warnings,
    peak,
)
from radar_sense.axis import Axis
from radar_sense.errors import InputError, did_you_mean
from radar_sense.limits import MIN_RANGE, RUNS, WINDOW
from radar_sense.mission import cumulative
from radar_sense.mission.cumulative import Cumulative, cumulative_detection
from radar_sense.mission.draws import Drawn, MissionDraws, mission_monte_carlo
from radar_sense.mission.importance import importance_sampling
from radar_sense.mission.looks import linearize_looks
from radar_sense.mission.schedule import Schedule, schedule_looks
from radar_sense.mission.tracks import track_initiation
from radar_sense.model.geometry import slant_range
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.scenario import Scenario, single_radar_scenarios
from radar_sense.states import RADAR, FloatArray

#: The default method: importance sampling.
IMPORTANCE = "importance"
#: All methods that can be named.
METHODS = (IMPORTANCE, *cumulative.METHODS)
#: Probabilities that the report gives the time of.
MILESTONES = (0.5, 0.9)
#: Memory of a track by first order grows with the square of the looks, to some 0.6 GB here, ...
MAX_TRACK_LOOKS = 4000
#: ... and its time with that times 2^(n − 1), to half a minute here.
MAX_TRACK_WORK = 2e9


def with_schedule(scenario: Scenario) -> tuple[Scenario, Schedule]:
    """Return the scenario of a path with a pose for each time of a look, and the looks.

    Raises:
        InputError: If the geometry has no times, a look would be on top of a radar, or a radar
            has no scan period.
    """
    if scenario.time_s is None:
        raise InputError(
            "a mission needs times, which an orbit does not have: "
            "give a path, geometry: {type: path, file: my_route.csv}"
        )
    when, poses = schedule_looks(scenario.model, scenario.route())
    along = axis.time(when.time)
    # Between poses a line may come nearer to a radar than any pose does.
    for radar in scenario.radar.reshape(-1, len(RADAR)):
        distance = slant_range(poses.aircraft, radar)
        nearest = int(np.argmin(distance))
        if distance[nearest] < MIN_RANGE:
            raise InputError(
                f"the aircraft is on top of the radar at the look at {along.at(nearest)}, slant "
                f"range {distance[nearest]:.2g} m; allowed is {MIN_RANGE:g} m or more"
            )
    looks = scenario.along_path(
        axis=along,
        aircraft=poses.aircraft,
        cov_aircraft=scenario.cov_aircraft if poses.covariance is None else poses.covariance,
        time_s=when.time,
    )
    return looks, when


def plot(result: Result, figure: Figure) -> None:
    """Draw the figure."""
    from radar_sense.plotting import (
        BAND,
        LINES,
        draw_band,
        draw_fill,
        draw_legend,
        draw_line,
        pose_coordinates,
        pose_panels,
        styles,
    )

    table, x = result.table, pose_coordinates(result.scenario.axis)
    tracked = "track_p_d" in table
    (top, *below) = pose_panels(figure, 3 if tracked else 2, result.scenario.axis)
    names = result.scenario.model.names
    radars = dict(zip(names if len(names) > 1 else (), styles(BAND, LINES[0]), strict=False))
    for name, style in radars.items():
        looks = np.isfinite(table[f"p_d_{name}"])
        draw_line(top, x[looks], table[f"p_d_{name}"][looks], style, label=name)
        top.lines[-1].set_linewidth(0.8)
    if not radars:
        draw_line(top, x, table["p_d"], ("black", "-"), label=r"$P_D$ of a look")
        if len(x) <= 100:
            top.lines[-1].set(marker="o", markersize=1.8)
    top.set_ylabel(r"$P_D$ of a look")
    events = [("", "cumulative_p_d", r"Cumulative $P_D$"), ("track_", "track_p_d", "Track")]
    for axes, (before, column, name) in zip(below, events, strict=False):
        for radar, style in radars.items():
            draw_line(axes, x, table[f"{column}_{radar}"], style)
            axes.lines[-1].set_linewidth(0.8)
        if f"{before}mc_mean" in table:
            ends = table[f"{before}mc_lower"], table[f"{before}mc_upper"]
            draw_fill(axes, x, *ends, color="0.8", lw=0, label="Monte Carlo")
        draw_line(axes, x, table[column], LINES[0], label="nominal")
        draw_band(
            axes,
            x,
            table[f"{before}lower_3sigma"],
            table[f"{before}upper_3sigma"],
            result.band_label,
        )
        if f"{before}mc_mean" in table:
            some = slice(None, None, -(-len(x) // 40))
            mean = table[f"{before}mc_mean"]
            axes.plot(x[some], mean[some], "k.", ms=2.5, label="mean of runs")
        if before:
            name = "Track, {} of {}".format(*result.summary["m_of_n"])
            own = result.summary.get("radars", {}).values()
            if len({radar["scan_period_s"] for radar in own}) > 1:
                name += "\nlooks of one period"
        axes.set_ylabel(name)
    draw_legend(figure, *([top] if radars else []), *below[:1])


_METHOD = dataclasses.replace(
    OPTIONS["method"],
    help="importance: importance sampling; or first order, probit or linear.",
    default=IMPORTANCE,
    choices=METHODS,
)
_M = Option("m", "With --n: detections that start a track.", WINDOW)
_N = Option("n", "Looks in a row that they must be within; of radars with one period.", WINDOW)
_RUNS = Option("runs", "Also make so many plain draws.", RUNS, default_text="none")


#: Of each event: what its bounds, its σ and mean, and its probability begin with in the table.
_COLUMNS = {
    "detection": ("", "cumulative", "cumulative_p_d"),
    "track": ("track_", "track", "track_p_d"),
}


def _columns(event: str, what: str) -> tuple[Column, ...]:
    """Return the columns of an event."""
    before, name, p = _COLUMNS[event]
    return (
        quantity(p, f"Probability that {what} by now."),
        quantity(f"sigma_{name}", "Standard deviation of this probability."),
        quantity(f"{before}lower_3sigma", "Lower 3-sigma bound of this probability."),
        quantity(f"{before}upper_3sigma", "Upper 3-sigma bound of this probability."),
        quantity(f"{before}mc_mean", "With --runs: mean of the draws of this probability."),
        quantity(f"{before}mc_std", "With --runs: standard deviation of the draws."),
        quantity(f"{before}mc_lower", "With --runs: quantile 0.00135 of the draws."),
        quantity(f"{before}mc_upper", "With --runs: quantile 0.99865 of the draws."),
        quantity(f"mean_{name}", "Mean of this probability over the uncertain states."),
        quantity(f"{before}lower_3sigma_se", "Standard error of the lower bound; by importance."),
        quantity(f"{before}upper_3sigma_se", "Standard error of the upper bound; by importance."),
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

    The scenario must have a path, whose poses have times. A radar looks every
    radar.scan_period_s. The pose errors are correlated over uncertainty.aircraft_correlation_s, the
    radar errors the same at all looks. The last columns are the standard errors of the bounds.

    A track is M detections in N looks in a row. Radars of a network that have the same period look
    together, as one; a track that the radars of any one period have started is the network's.

    Args:
        scenario: The scenario, whose geometry is a path.
        method: "importance", or "probit" or "linear", which are of first order.
        m: Detections that start a track; with n.
        n: Looks in a row that they must be within.
        runs: Plain draws of the mission to compare with; None draws none.
        workers: Threads to draw with; the result does not depend on them.
        progress: Shows the plain draws that are done.

    Raises:
        InputError: If the geometry has no times, or a choice is not allowed.
    """
    if (m is None) != (n is None):
        raise InputError("--m and --n belong together, as in --m 3 --n 5")
    m_of_n = None if m is None or n is None else (m, n)
    if method not in METHODS:
        raise InputError(
            f"method must be one of {', '.join(METHODS)} for a mission, got {method!r}"
            + did_you_mean(method, METHODS)
        )
    scenario, schedule = with_schedule(scenario.with_analysis(runs=runs))
    along = scenario.axis
    if m_of_n is not None:
        _check_window(*m_of_n, len(schedule.pose), method)
    network, each = _events(scenario, schedule, m_of_n, method, workers)
    drawn = None
    if runs is not None:
        with progress(runs, "runs") as advance:
            drawn = _draw(scenario, schedule, m_of_n, workers, advance)
    names = {"detection": "cumulative P_D"}
    if m_of_n is not None:
        names["track"] = "track, {} of {}".format(*m_of_n)
    found = _found(network.events, along)
    off = (
        {}
        if drawn is None
        else {e: _differences(v, _of(drawn, e), along) for e, v in network.events.items()}
    )
    errors = _standard_errors(network.events, along)
    return Result(
        scenario=scenario,
        method=method,
        table={
            along.key: along.values,
            **_table(network, drawn),
            **_of_each(each, _table),
            **_table_of_errors(network),
            **_of_each(each, _table_of_errors),
        },
        summary={
            "looks": len(along),
            "m_of_n": None if m_of_n is None else list(m_of_n),
            **found,
            **({"largest_standard_error_of_bounds": errors} if errors else {}),
            "monte_carlo": None
            if drawn is None
            else {
                "runs": drawn.runs,
                "radar_constants_set_to_zero": drawn.clipped,
                "largest_difference": off,
            },
            **_each_summary(each, along),
        },
        report=(
            _looks(scenario, schedule),
            *(
                line
                for event in network.events
                for line in _event(names[event], scenario, method, found[event])
            ),
            *(
                f"{names[event]}: standard error of the 3-sigma bounds at most "
                f"{describe_extreme(error, along)}"
                for event, error in errors.items()
            ),
            *_each_report(each),
            *_drawn_report(drawn, method, names, off, along),
        ),
        warnings=_warnings(scenario, method, network.events, names, drawn),
    )


@dataclass(frozen=True, eq=False)
class _Track:
    """What a network, or one radar of it, does along a mission.

    Attributes:
        period: Scan period of the radar [s]; None for the network.
        looks: Number of times at which it looks.
        p_d: P_D of the looks at each time (K,), NaN where there is no look.
        events: Probability by each time (K,) of detection, and of a track if it is asked for.
    """

    period: float | None
    looks: int
    p_d: FloatArray
    events: dict[str, Cumulative]


def _events(
    scenario: Scenario,
    schedule: Schedule,
    m_of_n: tuple[int, int] | None,
    method: str,
    workers: int,
) -> tuple[_Track, dict[str, _Track]]:
    """Return what the network does, and what each of its radars does by itself."""
    radars = single_radar_scenarios(scenario)
    parts = []
    for i, radar in enumerate(radars.values()):
        own, rows = schedule.of_radar(i)
        parts.append((radar.part(rows), own, rows))
    if method == IMPORTANCE:
        every = importance_sampling(scenario, schedule, m_of_n, workers=workers)
    else:
        every = [_first_order(scenario, schedule, m_of_n, method)]
        for part, own, rows in parts:
            latest = np.searchsorted(rows, np.arange(len(schedule.time)), side="right") - 1
            every.append(tuple(e.at(latest) for e in _first_order(part, own, m_of_n, method)))
    events = [dict(zip(("detection", "track"), some, strict=False)) for some in every]
    network = _Track(None, len(schedule.time), _p_d(scenario, schedule), events[0])
    each = {}
    for name, (part, own, rows), some in zip(radars, parts, events[1:], strict=True):
        p_d = np.full(len(schedule.time), np.nan)
        p_d[rows] = _p_d(part, own)
        each[name] = _Track(own.period[0], len(rows), p_d, some)
    return network, each


def _first_order(
    scenario: Scenario, schedule: Schedule, m_of_n: tuple[int, int] | None, method: str
) -> tuple[Cumulative, ...]:
    """Return the probability by each time (K,) of detection, and of a track, to first order."""
    pose, covariance = schedule.pose, scenario.cov_aircraft
    looks = linearize_looks(
        schedule.model(scenario.model),
        schedule.time[pose],
        scenario.aircraft[pose],
        scenario.radar,
    )
    covariances = (
        covariance if covariance.ndim == 2 else covariance[pose],
        scenario.cov_radar[scenario.level],
    )
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
    """Draw the mission; return statistics by each time (K,)."""
    pose, covariance = schedule.pose, scenario.cov_aircraft
    drawn = mission_monte_carlo(
        schedule.model(scenario.model),
        schedule.time[pose],
        scenario.aircraft[pose],
        covariance if covariance.ndim == 2 else covariance[pose],
        Sampler.of(scenario),
        correlation_time=scenario.correlation_s,
        runs=scenario.runs,
        seed=scenario.seed,
        m_of_n=m_of_n,
        scan_group=schedule.scan_group,
        workers=workers,
        progress=progress,
    )
    detection, track = (
        None if event is None else Drawn(*(values[schedule.last] for values in event))
        for event in (drawn.detection, drawn.track)
    )
    assert detection is not None
    return dataclasses.replace(drawn, detection=detection, track=track)


def _p_d(scenario: Scenario, schedule: Schedule) -> FloatArray:
    """P_D of all radars that look at each time (K,)."""
    pose = schedule.pose
    p_d = schedule.model(scenario.model).p_d(scenario.aircraft[pose], scenario.radar)
    if len(pose) == len(schedule.time):
        return p_d
    with np.errstate(divide="ignore"):  # P_D may round to 1
        hazard = -np.log1p(-p_d)
    fused: FloatArray = -np.expm1(-np.add.reduceat(hazard, schedule.first))
    return fused


def _of_each(
    each: Mapping[str, _Track], table: Callable[[_Track], Mapping[str, FloatArray]]
) -> dict[str, FloatArray]:
    """Return the columns of each radar."""
    return {
        f"{key}_{radar}": column
        for radar, track in each.items()
        for key, column in table(track).items()
    }


def _each_summary(each: dict[str, _Track], along: Axis) -> dict[str, Any]:
    if not each:
        return {}
    radars = {
        name: {"scan_period_s": own.period, "looks": own.looks, **_found(own.events, along)}
        for name, own in each.items()
    }
    return {"radars": radars}


def _each_report(each: dict[str, _Track]) -> list[str]:
    if not each:
        return []
    width = max(map(len, each))
    lines = ["at the end by each radar alone, with 3-sigma bounds:"]
    for name, own in each.items():
        said = [
            f"{event} {v.p[-1]:.4f} ({v.lower[-1]:.4f} to {v.upper[-1]:.4f})"
            for event, v in own.events.items()
        ]
        lines.append(f"  {name:{width}}  every {own.period:g} s, {', '.join(said)}")
    return lines


def _check_window(m: int, n: int, looks: int, method: str) -> None:
    for name, value in (("m", m), ("n", n)):
        if not WINDOW.allows(value):
            raise InputError(f"{name} of m of n must be {WINDOW}, got {value}")
    if m > n:
        raise InputError(f"m of n needs m not greater than n, got {m} of {n}")
    most = min(MAX_TRACK_LOOKS, math.isqrt(int(MAX_TRACK_WORK) >> (n - 1)))
    if looks > most and method != IMPORTANCE:
        raise InputError(
            f"{m} of {n} by {method} takes at most {most:,} looks, and this path has {looks:,}; "
            "--method importance takes more"
        )


def _of(drawn: MissionDraws, event: str) -> Drawn:
    found = drawn.detection if event == "detection" else drawn.track
    assert found is not None  # drawn if it was asked for
    return found


def _table(track: _Track, drawn: MissionDraws | None = None) -> dict[str, FloatArray]:
    """Return the columns of probabilities, their deviation and bounds, and of the draws."""
    table = {"p_d": track.p_d}
    for event, found in track.events.items():
        before, name, p = _COLUMNS[event]
        table[p] = found.p
        table[f"sigma_{name}"] = found.std
        table[f"{before}lower_3sigma"], table[f"{before}upper_3sigma"] = found.lower, found.upper
        if drawn is not None:
            for statistic, column in _of(drawn, event)._asdict().items():
                table[f"{before}mc_{statistic}"] = column
        table[f"mean_{name}"] = found.mean
    return table


def _table_of_errors(track: _Track) -> dict[str, FloatArray]:
    """Return the columns of standard errors, for a method that has them."""
    table = {}
    for event, found in track.events.items():
        before, _, _ = _COLUMNS[event]
        for end, error in (("lower", found.lower_se), ("upper", found.upper_se)):
            if error is not None:
                table[f"{before}{end}_3sigma_se"] = error
    return table


def _standard_errors(events: dict[str, Cumulative], along: Axis) -> dict[str, Any]:
    """Return the largest standard error of a bound of each event, and its time."""
    return {
        event: peak(np.maximum(found.lower_se, found.upper_se), along)
        for event, found in events.items()
        if found.lower_se is not None and found.upper_se is not None
    }


def _found(events: dict[str, Cumulative], along: Axis) -> dict[str, Any]:
    return {
        event: {
            "at_end": _last(values),
            "reaches": {f"{level:g}": _reaches(values, level, along) for level in MILESTONES},
        }
        for event, values in events.items()
    }


def _last(found: Cumulative) -> dict[str, float]:
    values = {
        "p": found.p,
        "mean": found.mean,
        "sigma": found.std,
        "lower_3sigma": found.lower,
        "upper_3sigma": found.upper,
    }
    return {name: float(value[-1]) for name, value in values.items()}


def _reaches(found: Cumulative, level: float, along: Axis) -> dict[str, float | None]:
    """Time of the first look by which a probability is reached: it, its upper and lower bound."""

    def first(curve: FloatArray) -> float | None:
        reached = curve >= level
        return float(along.values[np.argmax(reached)]) if reached.any() else None

    return {
        "time_s": first(found.p),
        "earliest_s": first(found.upper),
        "latest_s": first(found.lower),
    }


def _differences(found: Cumulative, drawn: Drawn, along: Axis) -> dict[str, Any]:
    return {
        "bounds": peak(
            np.maximum(abs(found.lower - drawn.lower), abs(found.upper - drawn.upper)), along
        ),
        "sigma": peak(abs(found.std - drawn.std), along),
    }


def _looks(scenario: Scenario, schedule: Schedule) -> str:
    along, tau = scenario.axis, scenario.correlation_s
    first, last = along.number(along.values[0]), along.at(-1)
    periods = [f"{period:g}" for period in sorted(schedule.period)]
    which = " or ".join(filter(None, (", ".join(periods[:-1]), periods[-1])))
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
    return f"{number}, {first} to {last}, every {which} s; pose errors {errors}"


def _event(name: str, scenario: Scenario, method: str, found: dict[str, Any]) -> list[str]:
    end = found["at_end"]
    lines = [
        f"{name} at the end ({scenario.level}, {method}): {end['p']:.4f}, "
        + (
            "its uncertainty is undefined"
            if math.isnan(end["sigma"])
            else f"sigma {end['sigma']:.2g}, "
            f"3-sigma bounds {end['lower_3sigma']:.4f} to {end['upper_3sigma']:.4f}"
        )
    ]
    for level, times in found["reaches"].items():
        time, earliest, latest = (
            "never" if value is None else scenario.axis.say(value) for value in times.values()
        )
        said = f"never reaches {level}" if time == "never" else f"reaches {level} at {time}"
        lines.append(f"  {said} (upper bound: {earliest}, lower bound: {latest})")
    return lines


def _drawn_report(
    drawn: MissionDraws | None,
    method: str,
    names: dict[str, str],
    off: dict[str, dict[str, Any]],
    along: Axis,
) -> list[str]:
    if drawn is None:
        return []
    lines = [f"{drawn.runs} runs (seed {drawn.seed}), largest difference of {method}:"]
    for event, name in names.items():
        end = _of(drawn, event)
        lines += [
            f"  {name}: bounds {describe_extreme(off[event]['bounds'], along)}, "
            f"sigma {describe_extreme(off[event]['sigma'], along)}",
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
    said = []
    for event, found in events.items():
        if place := describe_poses(~np.isfinite(found.std), scenario.axis):
            said.append(
                f"{names[event]}: with a look whose gradient is undefined, the radar straight "
                f"above or below the aircraft, its uncertainty is undefined {place}: "
                f"use --method {IMPORTANCE}"
            )
        if place := describe_poses((found.lower < 0) | (found.upper > 1), scenario.axis):
            said.append(f"{names[event]}: the {method} 3-sigma band leaves [0, 1] {place}")
    if method != IMPORTANCE:  # first order takes c_r to have a distribution that it may not have
        said += distribution_warnings(scenario, method)
    if drawn is not None and drawn.clipped:
        said += clipping_warnings(drawn.clipped)
    return tuple(said)
