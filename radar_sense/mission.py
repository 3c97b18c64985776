"""A mission: the probability of having been detected by each look along a path, and how sure it is.

A mission needs times, so it needs a path. The radar looks at the path's poses; or, where the
scenario says `radar.scan_period_s`, once a period from the first pose on, whatever the poses are.
Between two poses the position is then on the straight line (in latitude and longitude on one that
follows the curve of the earth), the attitude turns the short way at a constant rate, and the
covariance is the weighted mean. So poses far apart in a turn make a poor path:
`geometry.interpolate` fills them in first. The errors of the poses are correlated as
`uncertainty.aircraft_correlation_s` says, those of the radar the same at all looks. The equations
are in `cumulative`.

The radars of a network look each once a period of its own; those with the same period look
together, and that is one look. P_c counts the looks of all. A track is m detections in n looks in a
row of the radars with one period, each of them doing what it can: so the looks of a radar that sees
nothing do not come between those of one that does. The network has a track when any of them has.

Both methods are of first order. Whether that is enough is asked each time in two ways that need no
gradient: each error of a radar is made three of its deviations, and a few missions are drawn.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from radar_sense import axis as axes
from radar_sense import propagation
from radar_sense.analyses.contract import Result
from radar_sense.analyses.report import describe_extreme as at
from radar_sense.analyses.report import describe_poses as where
from radar_sense.analyses.report import peak
from radar_sense.axis import Axis
from radar_sense.cumulative import (
    METHODS,
    Cumulative,
    Drawn,
    Looks,
    Mission,
    Model,
    cumulative_detection,
    extremes,
    linearize_looks,
    mission_monte_carlo,
    track_initiation,
)
from radar_sense.errors import InputError, did_you_mean
from radar_sense.limits import MIN_RANGE, WINDOW
from radar_sense.model.geometry import slant_range
from radar_sense.model.radar_constant import shape_warnings
from radar_sense.model.trajectory import Route
from radar_sense.montecarlo.sampler import Sampler
from radar_sense.scenario import Scenario, single_radar_scenarios
from radar_sense.schedule import Schedule, schedule
from radar_sense.states import RADAR, FloatArray

#: Probabilities that the report gives the time of.
MILESTONES = (0.5, 0.9)
#: A look of a few draws, times 1 + 2^(n − 1)/16 for a track, takes some 0.8 µs: together a second.
QUICK_WORK = 1e6
#: So many runs at most are drawn to see whether a method is far off, and at least.
MOST_QUICK, LEAST_QUICK = 1000, 200
#: What is said of σ: the scatter of so few draws is far less, as long as they are not very skewed.
STD_FACTOR = 1.33
#: Memory of track initiation grows with the square of the looks, to some 0.6 GB here, ...
MAX_TRACK_LOOKS = 4000
#: ... and its time with that times 2^(n − 1), to half a minute here.
MAX_TRACK_WORK = 2e9


def at_looks(scenario: Scenario) -> Scenario:
    """Return the scenario of a path with a pose for each time of a look, laid out along time.

    Raises:
        InputError: If the geometry has no times, a look would be on top of a radar, or of
            several radars some have a period and others none.
    """
    return _with_schedule(scenario)[0]


def _with_schedule(scenario: Scenario) -> tuple[Scenario, Schedule]:
    if scenario.time_s is None:
        raise InputError(
            "a mission needs times, which an orbit does not have: "
            "give a path, geometry: {type: path, file: my_route.csv}"
        )
    covariance = scenario.cov_aircraft
    poses = Route(
        time_s=scenario.time_s,
        aircraft=scenario.aircraft,
        covariance=covariance if covariance.ndim == 3 else None,
        attitude_given=True,  # as it is by now
        origin=scenario.origin,  # legs then follow the curve of the earth
    )
    when, poses = schedule(scenario.model, scenario.scan_period_s, poses)
    along = axes.time(when.time)
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
        cov_aircraft=covariance if poses.covariance is None else poses.covariance,
        time_s=when.time,
    )
    return looks, when


def mission(
    scenario: Scenario,
    *,
    method: str = "probit",
    m_of_n: tuple[int, int] | None = None,
    runs: int | None = None,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Result:
    """Cumulative P_D along a path, with its standard deviation and 3σ bounds.

    Args:
        scenario: The scenario, whose geometry is a path.
        method: "probit", the default, or "linear", whose bounds can leave [0, 1].
        m_of_n: m and n, to have the probability of a track, m detections within n looks, too.
        runs: Also draw so many missions; None draws none.
        workers: Threads to draw with; of no influence on the result.
        progress: Called with the number of runs that have come in since the last call.

    Raises:
        InputError: If the geometry has no times, or a choice is not allowed.
    """
    chosen = method
    if chosen not in METHODS:
        raise InputError(
            f"method must be one of {', '.join(METHODS)} for a mission, got {chosen!r}"
            + did_you_mean(chosen, METHODS)
        )
    scenario, when = _with_schedule(scenario.with_analysis(runs=runs))
    along, pose = scenario.axis, when.pose
    if m_of_n is not None:
        _check_window(*m_of_n, len(pose))
    looks, events = _events(scenario, when, m_of_n, chosen)
    each = _each_alone(scenario, when, m_of_n, chosen)
    draw = partial(_draw, scenario, when, m_of_n, workers)
    drawn = None if runs is None else draw(scenario.runs, progress=progress)
    few = _few_runs(len(pose), m_of_n)
    quick = draw(few, beta=_quick_beta(few)) if few else None
    names = {"detection": "cumulative P_D"}
    if m_of_n is not None:
        names["track"] = "track, {} of {}".format(*m_of_n)
    found = _found(events, along)
    off = (
        {}
        if drawn is None
        else {e: _differences(v, _of(drawn, e), along) for e, v in events.items()}
    )
    return Result(
        scenario=scenario,
        method=chosen,
        table={
            along.key: along.values,
            **_table(_p_d(looks, when), events, drawn, with_mean=method != "probit"),
            **{
                f"{key}_{radar}": column
                for radar, own in each.items()
                for key, column in _table(own.p_d, own.events).items()
            },
        },
        summary={
            "looks": len(along),
            "m_of_n": None if m_of_n is None else list(m_of_n),
            **found,
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
            _looks(scenario, when),
            *(
                line
                for event in events
                for line in _event(names[event], scenario, chosen, found[event])
            ),
            *_each_report(each),
            *_drawn_report(drawn, chosen, names, off, along),
        ),
        warnings=(
            *_too_poor(
                names,
                _too_narrow(scenario, when, m_of_n, chosen, events),
                {} if quick is None else _unlike(chosen, events, quick, along),
                hint="" if runs else "; --runs draws better ones",
            ),
            *_warnings(scenario, chosen, events, names, drawn),
        ),
    )


def _events(
    scenario: Scenario, when: Schedule, m_of_n: tuple[int, int] | None, method: str
) -> tuple[Looks, dict[str, Cumulative]]:
    """Looks (L,), and what has happened by each time (K,)."""
    states, covariances = _of_looks(scenario, when)
    looks = linearize_looks(*states)
    tau = scenario.correlation_s
    events = {
        "detection": cumulative_detection(looks, *covariances, correlation_time=tau, method=method)
    }
    if m_of_n is not None:
        events["track"] = track_initiation(
            looks,
            *m_of_n,
            *covariances,
            correlation_time=tau,
            sequence=when.sequence,
            method=method,
        )
    return looks, {event: _rows(values, when.last) for event, values in events.items()}


def _of_looks(
    scenario: Scenario, when: Schedule
) -> tuple[tuple[Model, FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    """Model, times (L,), aircraft (L, 6) and radars (4m,) of the looks; and C_aa and C_rr."""
    pose, covariance = when.pose, scenario.cov_aircraft
    return (
        when.model(scenario.model),
        scenario.axis.values[pose],
        scenario.aircraft[pose],
        scenario.radar,
    ), (
        covariance if covariance.ndim == 2 else covariance[pose],
        scenario.cov_radar[scenario.level],
    )


def _rows(found: Cumulative, rows: NDArray[np.intp]) -> Cumulative:
    return Cumulative(
        found.p[rows], found.mean[rows], found.std[rows], found.lower[rows], found.upper[rows]
    )


def _draw(
    scenario: Scenario,
    when: Schedule,
    m_of_n: tuple[int, int] | None,
    workers: int,
    runs: int,
    *,
    beta: float = 3.0,
    progress: Callable[[int], None] | None = None,
) -> Mission:
    """Draw so many missions; what they show by each time (K,)."""
    states, covariances = _of_looks(scenario, when)
    drawn = mission_monte_carlo(
        *states,
        *covariances,
        correlation_time=scenario.correlation_s,
        runs=runs,
        seed=scenario.seed,
        m_of_n=m_of_n,
        sequence=when.sequence,
        beta=beta,
        radar_draws=Sampler.of(scenario),
        workers=workers,
        progress=progress,
    )
    return _at_times(drawn, when)


def _at_times(drawn: Mission, when: Schedule) -> Mission:
    """What draws show by each time (K,), from what they show by each look (L,)."""
    detection, track = (
        None if found is None else Drawn(*(values[when.last] for values in found))
        for found in (drawn.detection, drawn.track)
    )
    assert detection is not None
    return dataclasses.replace(drawn, detection=detection, track=track)


def _p_d(looks: Looks, when: Schedule) -> FloatArray:
    """P_D of all who look at each time (K,)."""
    if len(when.pose) == len(when.time):
        return looks.p_d
    found: FloatArray = -np.expm1(-np.add.reduceat(looks.hazard, when.first))
    return found


@dataclass(frozen=True, eq=False)
class _Alone:
    """What one radar of a network does by itself.

    Attributes:
        period: Its period [s]; None if it looks at the poses.
        looks: How many looks it has.
        p_d: P_D of its look at each time (K,), NaN where it does not look.
        events: What has happened by each time (K,), since its latest look.
    """

    period: float | None
    looks: int
    p_d: FloatArray
    events: dict[str, Cumulative]


def _each_alone(
    scenario: Scenario, when: Schedule, m_of_n: tuple[int, int] | None, method: str
) -> dict[str, _Alone]:
    found = {}
    for i, (name, radar) in enumerate(single_radar_scenarios(scenario).items()):
        own, rows = when.of_radar(i)
        looks, events = _events(radar.part(rows), own, m_of_n, method)
        p_d = np.full(len(when.time), np.nan)
        p_d[rows] = looks.p_d
        latest = np.searchsorted(rows, np.arange(len(when.time)), side="right") - 1
        events = {event: _rows(values, latest) for event, values in events.items()}
        found[name] = _Alone(own.period[0], len(rows), p_d, events)
    return found


def _each_summary(each: dict[str, _Alone], along: Axis) -> dict[str, Any]:
    if not each:
        return {}
    radars = {
        name: {"scan_period_s": own.period, "looks": own.looks, **_found(own.events, along)}
        for name, own in each.items()
    }
    return {"radars": radars}


def _each_report(each: dict[str, _Alone]) -> list[str]:
    if not each:
        return []
    width = max(map(len, each))
    lines = ["at the end by each radar alone, with 3-sigma bounds:"]
    for name, own in each.items():
        said = [
            f"{event} {v.p[-1]:.4f} ({v.lower[-1]:.4f} to {v.upper[-1]:.4f})"
            for event, v in own.events.items()
        ]
        every = "" if own.period is None else f"every {own.period:g} s, "
        lines.append(f"  {name:{width}}  {every}{', '.join(said)}")
    return lines


def _check_window(m: int, n: int, looks: int) -> None:
    for name, value in (("m", m), ("n", n)):
        if not WINDOW.allows(value):
            raise InputError(f"{name} of m of n must be {WINDOW}, got {value}")
    if m > n:
        raise InputError(f"m of n needs m not greater than n, got {m} of {n}")
    most = min(MAX_TRACK_LOOKS, math.isqrt(int(MAX_TRACK_WORK) >> (n - 1)))
    if looks > most:
        raise InputError(
            f"{m} of {n} takes at most {most:,} looks, and this path has {looks:,}; "
            "a longer radar.scan_period_s makes fewer"
        )


def _of(drawn: Mission, event: str) -> Drawn:
    found = drawn.detection if event == "detection" else drawn.track
    assert found is not None  # drawn if it was asked for
    return found


def _table(
    p_d: FloatArray,
    events: dict[str, Cumulative],
    drawn: Mission | None = None,
    *,
    with_mean: bool = False,
) -> dict[str, FloatArray]:
    """Return the columns; as in other analyses a method that is named adds its mean."""
    table = {"p_d": p_d}
    for event, found in events.items():
        before, name, p = (
            ("", "cumulative", "cumulative_p_d")
            if event == "detection"
            else ("track_", "track", "track_p_d")
        )
        table[p] = found.p
        table[f"sigma_{name}"] = found.std
        table[f"{before}lower_3sigma"], table[f"{before}upper_3sigma"] = found.lower, found.upper
        if drawn is not None:
            for statistic, column in _of(drawn, event)._asdict().items():
                table[f"{before}mc_{statistic}"] = column
        if with_mean:
            table[f"mean_{name}"] = found.mean
    return table


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


def _looks(scenario: Scenario, when: Schedule) -> str:
    along, tau = scenario.axis, scenario.correlation_s
    first, last = along.number(along.values[0]), along.at(-1)
    periods = [f"{period:g}" for period in sorted(p for p in when.period if p is not None)]
    which = (
        f"every {' or '.join(filter(None, (', '.join(periods[:-1]), periods[-1])))} s"
        if periods
        else "at the poses of the path, as radar.scan_period_s is not given"
    )
    errors = (
        "independent from look to look"
        if tau == 0
        else "the same at every look"
        if math.isinf(tau)
        else f"correlated over {tau:g} s"
    )
    number = f"{len(along)} looks"
    if len(when.radars) > 1:
        number = f"{len(when.pose)} looks at {len(along)} time{'s' if len(along) > 1 else ''}"
    return f"{number}, {first} to {last}, {which}; pose errors {errors}"


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
    drawn: Mission | None,
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
            f"  {name}: bounds {at(off[event]['bounds'], along)}, "
            f"sigma {at(off[event]['sigma'], along)}",
            f"    at the end mean {end.mean[-1]:.4f}, sigma {end.std[-1]:.2g}, "
            f"3-sigma bounds {end.lower[-1]:.4f} to {end.upper[-1]:.4f}",
        ]
    return lines


def _too_poor(
    names: dict[str, str], narrow: dict[str, str], unlike: dict[str, str], hint: str
) -> list[str]:
    """Warn where first order is not enough, for each event in a line with all that shows it."""
    return [
        f"{names[event]}: {'; '.join(filter(None, (narrow.get(event), unlike.get(event))))}{hint}"
        for event in names
        if event in narrow or event in unlike
    ]


def _too_narrow(
    scenario: Scenario,
    when: Schedule,
    m_of_n: tuple[int, int] | None,
    method: str,
    events: dict[str, Cumulative],
) -> dict[str, str]:
    """Say which bounds one error of a radar alone passes, as first order cannot know."""
    (model, _, aircraft, radar), (_, cov_radar) = _of_looks(scenario, when)
    ends = extremes(
        model,
        aircraft,
        radar,
        cov_radar,
        m_of_n=m_of_n,
        sequence=when.sequence,
        radar_draws=Sampler.of(scenario),
    )
    said = {}
    for (event, found), (low, high) in zip(events.items(), ends, strict=True):
        above, below = high[when.last] - found.upper, found.lower - low[when.last]
        beyond = np.maximum(above, below)
        if place := where(beyond > propagation.BOUND_CHANGE, scenario.axis):
            said[event] = (
                "with one error of a radar at 3 sigma, all else as it should be, it is beyond the "
                f"{method} bounds: they are too narrow, by {np.nanmax(beyond):.2g} or more, {place}"
            )
    return said


def _few_runs(looks: int, m_of_n: tuple[int, int] | None) -> int:
    """How many missions to draw to see whether a method is far off: 0 where it takes too long."""
    states = 0 if m_of_n is None else 2 ** (m_of_n[1] - 1)
    affordable = int(QUICK_WORK / (looks * (1 + states / 16)))
    return min(MOST_QUICK, max(affordable, LEAST_QUICK)) if 5 * affordable >= LEAST_QUICK else 0


def _quick_beta(runs: int) -> float:
    """β of the quantile that ten of so many runs are beyond, or one in a hundred."""
    return float(-ndtri(max(0.01, 10.0 / runs)))


def _unlike(
    method: str, events: dict[str, Cumulative], quick: Mission, along: Axis
) -> dict[str, str]:
    """Say where a few draws are not what the method says, by more than chance makes of it.

    Of the runs 0.00135 should be below the lower bound, and above the upper one. That ten or more
    of 1000 are has a probability of 5e-6, and a lesser one of fewer runs.
    """
    said = {}
    for event, found in events.items():
        drawn = _of(quick, event)
        beyond = np.maximum(drawn.upper - found.upper, found.lower - drawn.lower)
        off = 3.0 * abs(drawn.std - found.std)
        much = np.maximum(drawn.std, found.std) > STD_FACTOR * np.minimum(drawn.std, found.std)
        worst = int(np.argmax(np.where(much, off, 0.0)))
        parts = []
        if place := where(beyond > propagation.BOUND_CHANGE, along):
            parts.append(
                f"of {quick.runs} quick draws ten or more are beyond a {method} 3-sigma bound, "
                f"by {np.nanmax(beyond):.2g} or more, {place}"
            )
        if much[worst] and off[worst] > 3.0 * propagation.BOUND_CHANGE:
            parts.append(
                f"sigma of {quick.runs} quick draws is {drawn.std[worst]:.2g} at "
                f"{along.at(worst)}, that of {method} {found.std[worst]:.2g}"
            )
        if parts:
            said[event] = "; ".join(parts)
    return said


def _warnings(
    scenario: Scenario,
    method: str,
    events: dict[str, Cumulative],
    names: dict[str, str],
    drawn: Mission | None,
) -> tuple[str, ...]:
    said = []
    for event, found in events.items():
        if place := where(~np.isfinite(found.std), scenario.axis):
            said.append(
                f"{names[event]}: with a look whose gradient is undefined, the radar straight "
                f"above or below the aircraft, its uncertainty is undefined {place}"
            )
        if place := where((found.lower < 0) | (found.upper > 1), scenario.axis):
            said.append(f"{names[event]}: the {method} 3-sigma band leaves [0, 1] {place}")
    said += shape_warnings(
        scenario.model.names,
        scenario.tolerances_at_level,
        method,
        log_normal=propagation.METHODS[method].log_normal,
    )
    if drawn is not None and drawn.clipped:
        said.append(
            f"the radar constant was drawn below zero and set to zero in {drawn.clipped} runs"
        )
    return tuple(said)
