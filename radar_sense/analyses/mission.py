"""A mission: the probability of a detection and of a track by each look along a path.

Between two poses the aircraft flies as `flight.Path` says. When radars look, and which look
together, is in `mission.schedule`; the bounds are from draws, see `mission.recombined`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from radar_sense import options, plotting, words
from radar_sense.axis import Axis
from radar_sense.command import Figure, Option, Result, Table, command
from radar_sense.cost import foresee
from radar_sense.errors import InputError, counted
from radar_sense.limits import RUNS, WINDOW, Limit
from radar_sense.mission.bounds import Cumulative
from radar_sense.mission.draws import draw_missions
from radar_sense.mission.looks import Looks
from radar_sense.mission.recombined import recombined_missions
from radar_sense.mission.tracks import fuse, p_d_by_time
from radar_sense.montecarlo.statistics import DrawStatistics
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray

#: Number of σ of a bound: the draws reach no farther than 3.
REACHED = Limit(above=0, at_most=3)
#: Probabilities whose times are in the report.
MILESTONES = (0.5, 0.9)
#: Largest standard error of a bound without a warning.
MOST_ERROR = 0.01


@dataclass(frozen=True)
class Event:
    """An event of a mission, and the names of its columns.

    Attributes:
        key: Name in the record.
        stem: Name in the columns of the probability, its σ and its mean.
        before: Text before the names of the bounds.
        meaning: What the probability is of.
    """

    key: str
    stem: str
    before: str
    meaning: str


EVENTS = (
    Event("detection", "cumulative", "", "the aircraft has been detected"),
    Event("track", "track", "track_", "a track has been started"),
)


@dataclass(frozen=True, eq=False)
class Mission:
    """The mission of the network, or of one radar alone.

    Attributes:
        radar: Name of the radar; "" for the network.
        p_d: P_D of the looks at each time (K,), NaN where there is no look.
        events: Probability of each event by each time (K,): detection, and a track if wanted.
        drawn: The same by plain draws; {} without these, and for a radar alone.
    """

    radar: str
    p_d: FloatArray
    events: Mapping[Event, Cumulative]
    drawn: Mapping[Event, DrawStatistics] = field(default_factory=dict)


@command(
    options.LEVEL,
    options.ONE_RADAR,
    Option(
        "track",
        "M N: a track is M detections in N looks in a row.",
        WINDOW,
        "M N",
        count=2,
        excludes=("m", "n"),
    ),
    Option("m", "Detections that start a track.", WINDOW, needs=("n",)),
    Option("n", "Length of the window of consecutive looks, 12 at most.", WINDOW, needs=("m",)),
    replace(options.K, help="Number of sigma of the band, 3 at most.", limit=REACHED),
    Option("runs", "Also make this number of plain draws.", RUNS, default_text="none"),
    options.SEED_OF_DRAWS,
    options.WORKER_THREADS,
    examples=(
        "radar-sense mission my.yaml",
        "radar-sense mission my.yaml --track 3 5 --runs 10000",
    ),
)
def mission(
    scenario: Scenario,
    *,
    track: Sequence[int] | None = None,
    m: int | None = None,
    n: int | None = None,
    k: float = 3.0,
    runs: int | None = None,
    workers: int = 1,
) -> Result:
    """Probability of a detection, and of a track, over the looks along a path.

    The scenario must have a path, whose poses have times. The time between looks of a radar is
    radar.scan_period_s. The pose errors are correlated over uncertainty.aircraft_correlation_s. The
    radar errors are the same at all looks. The last columns are standard errors.

    A track is M detections in N consecutive looks. Radars of a network with the same period look
    together, as one radar. The network has a track when the radars of one period have a track.
    """
    window = _window(track, m, n)
    looks = Looks.of(scenario.with_analysis(runs=runs))
    scenario, axis = looks.scenario, looks.scenario.axis
    if runs is not None:
        sizes = f"{len(axis):,} times x {runs:,} runs"
        foresee(sizes, sum(map(len, looks.times)) * runs, less="fewer --runs", workers=workers)
    recombined = recombined_missions(looks, window, k=k, workers=workers)
    drawn, clipped = ([], 0) if runs is None else draw_missions(looks, window, k=k, workers=workers)
    network, *radars = missions = _missions(looks, recombined, drawn)

    result = Result(scenario)
    words.add_axis(result.table, axis)
    for one in missions:
        _add_columns(result.table, one, k)
    each = [
        (event, found, *words.of_radar(one.radar))
        for one in missions
        for event, found in one.events.items()
    ]
    for event, found, of, end in each:
        for side, error in (("lower", found.lower_se), ("upper", found.upper_se)):
            name = f"{event.before}{side}_{k:.12g}sigma"
            result.table.add(f"{name}_se{end}", error, f"{of}Standard error of {name}{end}.")
    for event, found, of, end in each:
        name = f"mean_{event.stem}"
        result.table.add(f"{name}_se{end}", found.mean_se, f"{of}Standard error of {name}{end}.")

    errors = {
        event.key: words.peak(found.bound_se, axis) for event, found in network.events.items()
    }
    result.summary |= {
        "looks": len(axis),
        "m_of_n": None if window is None else list(window),
        **_summaries(network, axis, k),
        "largest_standard_error_of_bounds": errors,
        "monte_carlo": None,
    }
    names = ["detection"] if window is None else ["detection", "track, {} of {}".format(*window)]
    for name, found in zip(names, network.events.values(), strict=True):
        result.report += _answer(name, found, scenario.level, axis, k)
    if radars:
        by_radar, rows = {}, []
        for one, single, times in zip(radars, scenario.radars, looks.times, strict=True):
            period = single.scan_period
            numbers = {"scan_period_s": period, "looks": len(times)}
            by_radar[one.radar] = {**numbers, **_summaries(one, axis, k)}
            of_events = ", ".join(
                f"{event.key} {words.probability(found.p[-1])}, "
                f"on average {_mean(found)} ({_band(found, 'to')})"
                for event, found in one.events.items()
            )
            rows.append((one.radar, f"{of_events}, every {period:g} s"))
        result.summary["radars"] = by_radar
        result.report += ["each radar alone, by the end:", *words.rows(rows)]
    if drawn:
        _add_differences(result, network, clipped, names, k)
    result.report.append(_describe_looks(looks))
    largest = (f"{key} {words.describe_extreme(top, axis)}" for key, top in errors.items())
    whose = " of all radars together" if radars else ""
    result.report.append(f"largest standard error of a bound{whose}: {', '.join(largest)}")
    draws = "mission --runs adds plain draws" + ", with --radar for one radar" * bool(radars)
    text = f"a bound has a standard error above {MOST_ERROR:g}; {draws}"
    result.warnings += words.gathered(
        (one.radar or "the mission", words.warning("band-imprecise", text))
        for one in missions
        if not one.drawn and any(np.any(e.bound_se > MOST_ERROR) for e in one.events.values())
    )
    result.draw = partial(_draw, scenario=scenario, missions=missions, window=window, k=k)
    return result


def _window(track: Sequence[int] | None, m: int | None, n: int | None) -> tuple[int, int] | None:
    """Return m and n of a track, given together or one by one."""
    if m is not None and n is not None:
        track = m, n
    if track is None:
        return None
    m, n = track
    if m > n:
        raise InputError(f"m of n needs m not greater than n, got {m} of {n}")
    return m, n


def _missions(
    looks: Looks, found: Sequence[list[Cumulative]], drawn: Sequence[DrawStatistics]
) -> list[Mission]:
    """Return the mission of the network, and that of each radar alone."""
    schedule, p_d = looks.schedule, looks.nominal_p_d
    times = np.arange(len(schedule.time))
    together = p_d_by_time(schedule, fuse(schedule.radars, p_d), times)[:, 0]
    network, *alone = (dict(zip(EVENTS, events, strict=False)) for events in found)
    missions = [Mission("", together, network, dict(zip(EVENTS, drawn, strict=False)))]
    names = looks.scenario.model.names
    for name, of_looks, at, events in zip(names, p_d, looks.times, alone, strict=False):
        by_time = np.full(len(times), np.nan)
        by_time[at] = of_looks[:, 0]
        missions.append(Mission(name, by_time, events))
    return missions


def _add_columns(table: Table, one: Mission, k: float) -> None:
    """Add P_D, and the probability, deviation and bounds of each event, and of draws."""
    of, end = words.of_radar(one.radar)
    together = "" if one.radar else ", or of all looks at this time together"
    table.add(f"p_d{end}", one.p_d, f"{of}P_D of the look{together}.")
    for event, found in one.events.items():
        before, name = event.before, f"{event.stem}_p_d{end}"
        this = f"the probability {name}"
        table.add(name, found.p, f"{of}Probability that {event.meaning} by now.")
        table.add(f"sigma_{event.stem}{end}", found.std, f"{of}Standard deviation of {this}.")
        for side, bound in (("lower", found.lower), ("upper", found.upper)):
            meaning = f"{of}{side.capitalize()} {k:g}-sigma bound of {this}."
            table.add(f"{before}{side}_{k:.12g}sigma{end}", bound, meaning)
        if draws := one.drawn.get(event):
            words.add_draws(table, draws, k, this, before)
        table.add(f"mean_{event.stem}{end}", found.mean, f"{of}Mean of {this} over the errors.")


def _summaries(one: Mission, axis: Axis, k: float) -> dict[str, Any]:
    """Return the values of each event at the end, and the times of the milestones."""
    return {
        event.key: {
            "at_end": {
                "p": float(found.p[-1]),
                "mean": float(found.mean[-1]),
                "mean_se": float(found.mean_se[-1]),
                "sigma": float(found.std[-1]),
                f"lower_{k:.12g}sigma": float(found.lower[-1]),
                f"upper_{k:.12g}sigma": float(found.upper[-1]),
            },
            "reaches": {f"{level:g}": _reaches(found, level, axis) for level in MILESTONES},
        }
        for event, found in one.events.items()
    }


def _reaches(found: Cumulative, level: float, axis: Axis) -> dict[str, float | None]:
    """Return when the probability, its upper and its lower bound first reach a level, or None."""
    curves = {"time_s": found.p, "earliest_s": found.upper, "latest_s": found.lower}
    reached = {name: curve >= level for name, curve in curves.items()}
    return {n: float(axis.values[np.argmax(m)]) if m.any() else None for n, m in reached.items()}


def _mean(found: Cumulative) -> str:
    """Return the mean at the end, with its standard error where its digits do not say it."""
    mean, error = words.probability(found.mean[-1]), found.mean_se[-1]
    return f"{mean} +/- {error:.1g}" if error >= words.SHOWN else mean


def _band(found: Cumulative, to: str) -> str:
    """Return the bounds at the end, with a word between them, and with a large standard error."""
    ends = (found.lower[-1], found.lower_se[-1]), (found.upper[-1], found.upper_se[-1])
    return f" {to} ".join(
        words.probability(bound) + f" +/- {error:.1g}" * bool(error > MOST_ERROR)
        for bound, error in ends
    )


def _answer(name: str, found: Cumulative, level: str, axis: Axis, k: float) -> list[str]:
    """Return the probability by the end with its mean and bounds, and when it is reached."""
    lines = [
        f"{name} by {axis.at(-1)}: {words.probability(found.p[-1])} at the nominal states, "
        f"{_mean(found)} on average, between {_band(found, 'and')} "
        f"({k:g} sigma, {level})"
    ]
    for milestone in MILESTONES:
        time, earliest, latest = (
            "never" if first is None else axis.format(first)
            for first in _reaches(found, milestone, axis).values()
        )
        if time != "never":
            lines.append(f"  reaches {milestone:g} at {time}, between {earliest} and {latest}")
        elif earliest != "never":
            lines.append(f"  never reaches {milestone:g}, but its upper bound does at {earliest}")
        else:
            lines.append(f"  never reaches {milestone:g}, nor does its upper bound")
            break
    return lines


def _describe_looks(looks: Looks) -> str:
    """Return the number of looks, their times, and how their pose errors are correlated."""
    axis, tau = looks.scenario.axis, looks.scenario.correlation_s
    periods = {r.scan_period for r in looks.scenario.radars if r.scan_period}
    every = words.listed([f"{p:g}" for p in sorted(periods)], "or")
    errors = (
        "independent from look to look"
        if tau == 0
        else "the same at every look"
        if math.isinf(tau)
        else f"correlated over {tau:g} s"
    )
    number = counted(len(axis), "look")
    if len(looks.schedule.radars) > 1:
        count = int(np.count_nonzero(looks.schedule.looks))
        number = f"{counted(count, 'look')} at {counted(len(axis), 'time')}"
    first, last = axis.number(axis.values[0]), axis.at(-1)
    return f"{number}, {first} to {last}, every {every} s; pose errors {errors}"


def _add_differences(
    result: Result, network: Mission, clipped: int, names: Sequence[str], k: float
) -> None:
    """Add the largest differences from plain draws, and the draws at the end."""
    axis, differences = result.scenario.axis, {}
    runs, seed = result.scenario.runs, result.scenario.seed
    drawn = f"{runs} plain runs (seed {seed})"
    result.report.append(f"largest difference from {drawn}, with their noise:")
    for name, (event, found) in zip(names, network.events.items(), strict=True):
        draws = network.drawn[event]
        lower, upper = abs(found.lower - draws.lower), abs(found.upper - draws.upper)
        bounds = words.peak(np.maximum(lower, upper), axis)
        sigma = words.peak(abs(found.std - draws.std), axis)
        differences[event.key] = {"bounds": bounds, "sigma": sigma}
        result.report += [
            f"  {name}: bounds {words.describe_extreme(bounds, axis)}, "
            f"sigma {words.describe_extreme(sigma, axis)}",
            f"    runs at the end: mean {draws.mean[-1]:.4f}, sigma {draws.std[-1]:.2g}, "
            f"between {draws.lower[-1]:.4f} and {draws.upper[-1]:.4f} ({k:g} sigma)",
        ]
    result.summary["monte_carlo"] = {
        "runs": runs,
        "radar_constants_set_to_zero": clipped,
        "largest_difference": differences,
    }


def _draw(
    figure: Figure,
    scenario: Scenario,
    missions: Sequence[Mission],
    window: tuple[int, int] | None,
    k: float,
) -> None:
    """Draw P_D of the looks, and the probability of each event with its band."""
    network, *radars = missions
    (top, *below), x = plotting.pose_panels(figure, 2 if window is None else 3, scenario.axis)
    styles, thin = plotting.radar_styles([one.radar for one in radars]), plotting.points(0.8)
    for one in radars:
        looks = np.isfinite(one.p_d)
        style = styles[one.radar]
        plotting.draw_line(top, x[looks], one.p_d[looks], style, label=one.radar, lw=thin)
    if not radars:
        dots = {"marker": "o", "ms": plotting.points(1.8)} if len(x) <= 100 else {}
        plotting.draw_line(top, x, network.p_d, ("black", "-"), label=r"$P_D$ of a look", **dots)
    top.set_ylabel(r"$P_D$ of a look")
    for axes, (event, found) in zip(below, network.events.items(), strict=True):
        for one in radars:
            plotting.draw_line(axes, x, one.events[event].p, styles[one.radar], lw=thin)
        draws = network.drawn.get(event)
        if draws:
            fill = {"color": "0.8", "lw": 0, "label": "Monte Carlo"}
            plotting.draw_fill(axes, x, draws.lower, draws.upper, **fill)
        plotting.draw_line(axes, x, found.p, ("black", "-"), label="nominal")
        mean = {"lw": thin, "label": "mean over the errors"}
        plotting.draw_line(axes, x, found.mean, ("0.65", ":"), **mean)
        label = rf"${k:g}\,\sigma$ bounds ({scenario.level})"
        plotting.draw_band(axes, x, found.lower, found.upper, label)
        if draws:
            some = slice(None, None, -(-len(x) // 40))
            size, edge = plotting.points(2), plotting.points(0.6)
            hollow: dict[str, Any] = {"ms": size, "mfc": "white", "mew": edge}
            axes.plot(x[some], draws.mean[some], "ko", label="mean of runs", **hollow)
        axes.set_ylabel(r"Cumulative $P_D$")
    if window is not None:
        periods = {radar.scan_period for radar in scenario.radars}
        together = "\nlooks of one period" if len(periods) > 1 else ""
        below[1].set_ylabel("Track, {} of {}".format(*window) + together)
    plotting.draw_legend(figure, *([top] if radars else []), *below[:1])
