"""Random routes of two or three rows that graze a limit or a lobe between the rows, and the truth.

Between two rows the position is on a straight line. The attitude turns about one axis at a constant
rate. P_D of the nominal states is computed every 0.02 s. A route grazes where P_D is above the
threshold for at least a second, and well below it at every row. Some routes pass by instead, eight
standard deviations from a limit or far from the lobe, and P_D stays near P_fa.
"""

from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from .model import EFFECTIVE_RADIUS, Oracle, Problem, Radar
from .populations import DEG, DETECTORS, diagonal, nominal_aspect, random_rcs, snr_for, with_snr

STEP = 0.02
KINDS = ("range", "eclipse", "horizon", "closest", "lobe", "turn")
#: Kinds that can pass by.
PASSING = ("range", "horizon", "lobe")
#: P_D at a row over the threshold, at most.
WELL_BELOW = 0.5
#: Distance from the limit of a route that passes by, in standard deviations.
APART = 8.0


@dataclass(frozen=True, eq=False)
class Path:
    """A route and its threshold.

    Attributes:
        kind: What it grazes, one of `KINDS`.
        problem: The radars, the RCS and the covariances; its aircraft is the first row.
        time_s: Times of the rows (n,).
        aircraft: States at the rows (n, 6).
        threshold: P_max.
        peak: Largest P_D along the route.
        seconds: For how long P_D is above the threshold.
        highest_row: Largest P_D at a row.
    """

    kind: str
    problem: Problem
    time_s: np.ndarray
    aircraft: np.ndarray
    threshold: float
    peak: float
    seconds: float
    highest_row: float


def grazing(seed, number):
    """Return the route of a number that grazes: the first of its attempts that does."""
    kind = KINDS[number % len(KINDS)]
    attempts = (
        _route(np.random.default_rng([seed, 1, number, attempt]), kind, passes=False)
        for attempt in count()
    )
    return next(
        path
        for path in attempts
        if path.seconds >= 1.0 and path.highest_row <= WELL_BELOW * path.threshold
    )


def passing(seed, number):
    """Return the route of a number that passes by."""
    kind = PASSING[number % len(PASSING)]
    attempts = (
        _route(np.random.default_rng([seed, 2, number, attempt]), kind, passes=True)
        for attempt in count()
    )
    return next(path for path in attempts if path.peak <= 0.1 * path.threshold)


def along(time_s, aircraft, at):
    """Return the states (k, 6) at times (k,) between rows."""
    states = np.empty((len(at), 6))
    for i in range(3):
        states[:, i] = np.interp(at, time_s, aircraft[:, i])
    leg = np.clip(np.searchsorted(time_s, at, side="right") - 1, 0, len(time_s) - 2)
    for i in np.unique(leg):  # SciPy 1.15, the last for Python 3.10, has no rotations of no times
        ends, here = slice(i, i + 2), leg == i
        turning = Slerp(time_s[ends], Rotation.from_euler("ZYX", aircraft[ends, :2:-1]))
        states[here, 3:] = turning(at[here]).as_euler("ZYX")[:, ::-1]
    return states


def sampled(problem, time_s, aircraft):
    """Return times (k,) and P_D (k,) along a route, and P_D at its rows."""
    at = np.linspace(time_s[0], time_s[-1], int(np.ceil((time_s[-1] - time_s[0]) / STEP)) + 1)
    independent = Oracle(problem)
    radars = independent.nominal_radars[:, None]
    p_d = independent.p_d(along(time_s, aircraft, at).T, radars)
    return at, p_d, independent.p_d(aircraft.T, radars)


@dataclass(frozen=True, eq=False)
class _Flyby:
    """A leg past a radar: speed, course, closest slant range, height, and seconds around it."""

    speed: float
    course: float
    closest: float
    height: float
    before: float
    after: float


def _route(rng, kind, *, passes):
    """Return a route of a kind, which may or may not graze."""
    slow = kind in ("lobe", "turn")  # narrow lobes in aspects that turn slowly
    dwell = 10.0 ** rng.uniform(0.02, 0.7 if slow else 1.3)
    flyby = _Flyby(
        speed=rng.uniform(80, 300),
        course=rng.uniform(-np.pi, np.pi),
        closest=10.0 ** (rng.uniform(2.3, 4) if kind == "closest" else rng.uniform(3.7, 5.3)),
        height=rng.uniform(300, 8e3),
        before=rng.uniform(20, 300),
        after=rng.uniform(20, 300),
    )
    # small errors: the band of a pose beside the graze would otherwise show it
    near, far = 10.0 ** rng.uniform(-0.5, 1, 2)
    mast, turn = 10.0, 10.0 ** rng.uniform(-2.3, -1) * DEG
    if kind == "horizon":  # a metre of height moves the horizon by some 200
        near, far = 10.0 ** rng.uniform(-2.5, -0.5, 2)
        mast = 10.0 ** rng.uniform(0.5, 2)
        flyby = replace(flyby, height=10.0 ** rng.uniform(1.3, 2.7))
        edge = np.sqrt(2 * EFFECTIVE_RADIUS) * (np.sqrt(flyby.height) + np.sqrt(mast))
        if passes:
            raised = np.sqrt(flyby.height + APART * near) + np.sqrt(mast + APART * far)
            edge = np.sqrt(2 * EFFECTIVE_RADIUS) * raised + APART * np.hypot(near, far)
        inside = 0.0 if passes else min(0.5 * flyby.speed * dwell, 0.5 * edge)
        flyby = replace(flyby, closest=np.sqrt(edge**2 - inside**2))
    flyby = replace(flyby, height=min(flyby.height, 0.7 * flyby.closest))
    limit = {"horizon": True} if kind == "horizon" else {}
    if kind == "range":
        inside = np.hypot(flyby.closest, 0.5 * flyby.speed * dwell)
        limit = {"max_range": flyby.closest - APART * np.hypot(near, far) if passes else inside}
    radar = Radar(np.array([0, 0, -mast, 1.0]), str(rng.choice(DETECTORS)), 1e-6, **limit)
    times, rows = _rows(rng, kind, flyby, mast)
    moment = flyby.before
    if kind == "eclipse":  # the first row is inside it
        moment = rng.uniform(0.05, 0.5) * times[1]
        edge = np.linalg.norm(along(times, rows, np.array([moment]))[0, :3] - radar.state[:3])
        radar = replace(radar, min_range=edge)
    rcs = random_rcs(rng, str(rng.choice(["constant", "ellipsoid_exact"])))
    if slow:
        moment = rng.uniform(0.15, 0.85) * times[1]
        rcs = _lobe(times, rows, moment, dwell, elsewhere=passes)
    p_d = rng.uniform(0.3, 0.99)
    threshold = float(p_d * rng.uniform(0.15, 0.9))
    apart = 0.0
    if kind in ("closest", "eclipse"):  # P_D is the threshold this long before or after the peak
        apart, p_d = (-0.5 * dwell if kind == "closest" else dwell), threshold
    there = along(times, rows, np.array([max(moment + apart, 0.0)]))[0]
    unlimited = replace(radar, min_range=0.0, max_range=np.inf, horizon=False)
    towards = ("constant", 1.0) if slow and passes else rcs
    constant = with_snr(unlimited, there, towards, snr_for(radar, p_d)).state[3]
    radar = replace(radar, state=np.array([*radar.state[:3], constant]))
    problem = Problem(
        population=kind,
        number=0,
        aircraft=rows[0],
        radars=(radar,),
        rcs=rcs,
        cov_aircraft=diagonal([near] * 3 + [turn] * 3),
        cov_radar=diagonal(
            [far, far, min(far, 0.1 * mast), 10 ** rng.uniform(-3, -1.3) * constant]
        ),
    )
    at, p_d, p_d_of_rows = sampled(problem, times, rows)
    return Path(
        kind=kind,
        problem=problem,
        time_s=times,
        aircraft=rows,
        threshold=threshold,
        peak=float(p_d.max()),
        seconds=float(np.count_nonzero(p_d > threshold) * (at[1] - at[0])),
        highest_row=float(p_d_of_rows.max()),
    )


def _rows(rng, kind, flyby, mast):
    """Return times (n,) from 0 and states (n, 6) of two rows past a radar at the origin, or three.

    The rows of an eclipse lead from above the radar straight out.
    """
    course, speed = flyby.course, flyby.speed
    level = np.sqrt(flyby.closest**2 - (flyby.height - mast) ** 2)
    if kind == "eclipse":
        level = 0.0
    abeam = level * np.array([-np.sin(course), np.cos(course), 0]) - [0, 0, flyby.height]
    velocity = speed * np.array([np.cos(course), np.sin(course), 0])
    if kind not in ("horizon", "range") and rng.random() < 0.3:
        climb = rng.uniform(-0.3, 0.3) * flyby.height
        velocity[2] = climb / max(flyby.before, flyby.after)
    times = np.array([-flyby.before, flyby.after])
    if kind == "eclipse":
        times = np.array([0.05, 4.0]) * flyby.before
    attitude = np.tile([*rng.normal(0, 3 * DEG, 2), course], (2, 1))
    if kind == "turn":
        rate = 10.0 ** rng.uniform(-1, 0.3) * DEG
        angle = min(rate * (times[1] - times[0]), 170 * DEG)
        times[1] = times[0] + angle / rate
        attitude[1] += [rng.normal(0, 10 * DEG), 0, angle * rng.choice([-1, 1])]
    elif rng.random() < 0.3:
        attitude[1] += rng.normal(0, 5 * DEG, 3)
    rows = np.hstack([abeam + times[:, None] * velocity, attitude])
    if rng.random() < 0.4:  # a third row, after a corner
        turned, leg = course + rng.uniform(-0.5, 0.5), rng.uniform(20, 100)
        corner = rows[1, :3] + leg * speed * np.array([np.cos(turned), np.sin(turned), 0])
        rows = np.vstack([rows, [*corner, *attitude[1, :2], turned]])
        times = np.append(times, times[1] + leg)
    return times - times[0], rows


def _lobe(times, rows, moment, dwell, *, elsewhere):
    """Return a table with one lobe at the aspect of a moment, for a dwell in seconds.

    A lobe elsewhere is in the middle of the azimuths that no aspect of the route has.
    """
    origin = np.array([0, 0, -10.0])
    around = along(times, rows, moment + np.array([-0.05, 0, 0.05]))
    before, at, after = (nominal_aspect(row, origin)[0] for row in around)
    width = np.clip(abs(np.angle(np.exp(1j * (after - before)))) / 0.1 * dwell, 0.1 * DEG, 5 * DEG)
    if elsewhere:
        swept = along(times, rows, np.linspace(0, times[-1], 400))
        seen = np.sort([nominal_aspect(row, origin)[0] for row in swept])
        gaps = np.diff(np.append(seen, seen[0] + 2 * np.pi))
        widest = int(np.argmax(gaps))
        at = seen[widest] + 0.5 * gaps[widest]
    azimuth = np.linspace(-np.pi, np.pi, int(np.ceil(8 * np.pi / width)), endpoint=False)
    distance = np.mod(azimuth - at + np.pi, 2 * np.pi) - np.pi
    decibels = 20 * np.exp(-np.log(2) * (2 * distance / width) ** 2) - 20
    return "table", azimuth, 10 ** (decibels / 10), None, None
