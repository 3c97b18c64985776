"""Wording of reports and warnings, shared by the analyses."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from radar_sense.axis import Axis, reached, runs_of
from radar_sense.command import OF_RADAR, Result, Table
from radar_sense.covariance import square_root
from radar_sense.errors import counted
from radar_sense.model.detectors import CFARS, DETECTORS, Detector, OrderedStatistics, PulseDetector
from radar_sense.model.geometry import body_vector, elevation_of
from radar_sense.model.rcs_table import POLE, TableRCS
from radar_sense.montecarlo.statistics import DrawStatistics
from radar_sense.propagation import (
    AUTOMATIC,
    BOUND_CHANGE,
    STD_CHANGE,
    Band,
    Moments,
    unreliable_in_scenario,
)
from radar_sense.scenario import Scenario
from radar_sense.states import FloatArray
from radar_sense.units import unit_name

#: Least probability that four digits show, and least probability that is not rounding.
SHOWN, LEAST = 5e-5, 1e-6
#: What to use in place of a band that is off, where a table has the draws.
BY_DRAWS = "use the columns of the draws there"
REMEDY = f"use --method {AUTOMATIC}"
#: Most names in one warning. With more names, the warning counts the rest.
NAMED = 4


def warning(name: str, text: str) -> str:
    """Return a warning with its stable name, which docs/warnings.yaml explains."""
    return f"{text} [{name}]"


def placed(
    name: str, mask: NDArray[np.bool_], axis: Axis, before: str, after: str = ""
) -> Iterator[str]:
    """Yield a warning where a mask (n,) holds, with the poses between its words."""
    if place := describe_poses(mask, axis):
        yield warning(name, f"{before} {place}{after}")


def peak(values: FloatArray, axis: Axis) -> dict[str, Any]:
    """Return the largest value, all places with this value, and how many have none, if any."""
    if not np.isfinite(values).any():
        return {"value": float("nan"), axis.key: []}
    found = {"value": float(np.nanmax(values)), axis.key: axis.values[reached(values)].tolist()}
    without = int(np.count_nonzero(np.isnan(values)))
    return {**found, "without_value": without} if without else found


def trough(values: FloatArray, axis: Axis) -> dict[str, Any]:
    """Return the smallest value, and all places with this value."""
    top = peak(-values, axis)
    return {**top, "value": -top["value"]}


def describe_extreme(extreme: Mapping[str, Any], axis: Axis, *, gaps: bool = True) -> str:
    """Describe a peak or a trough: its value and places, and how many poses have no value."""
    places = extreme[axis.key]
    if not places:
        return "undefined"
    if len(places) > 3:
        place = f"{len(places)} {axis.places}"
    else:
        place = axis.in_words(listed(map(axis.number, places)))
    text = f"{probability(extreme['value'])} at {place}"
    without = extreme.get("without_value", 0)
    if gaps and without:
        text += f" ({counted(without, axis.places.removesuffix('s'))} without a value)"
    return text


def describe_span(p_d: FloatArray, axis: Axis) -> str:
    """Describe the range of P_D (n,) in a sentence, by the digits that are shown."""
    low, high = trough(p_d, axis), peak(p_d, axis)
    if probability(low["value"]) != probability(high["value"]) or np.isnan(high["value"]):
        least = describe_extreme(low, axis, gaps=False)  # the other end says it
        return f"P_D runs from {least} to {describe_extreme(high, axis)}"
    if len(axis) == 1:
        return f"P_D is {describe_extreme(high, axis)}"
    known = "wherever it has a value"
    if np.isfinite(p_d).all():
        known = f"at every {axis.places.removesuffix('s')}"
    return f"P_D is {probability(high['value'])} {known}"


def listed(words: Iterable[str], before_last: str = "and") -> str:
    """Return words in a sentence, with commas and an "and" between them."""
    *others, last = words
    return f" {before_last} ".join(filter(None, (", ".join(others), last)))


def describe_poses(
    mask: NDArray[np.bool_], axis: Axis, spans: Sequence[tuple[float, float]] = ()
) -> str:
    """Describe the poses of a mask; "" if there are none.

    Spans are the values from which to which each run of poses is, by default its own.
    """
    count = int(np.count_nonzero(mask))
    if count == 0:
        return ""
    if count == mask.size:
        return f"at all {count} {axis.places}" if count > 1 else f"at {axis.at(0)}"
    spans = spans or [(axis.values[a], axis.values[b]) for a, b in runs_of(mask)]
    numbers = [(axis.number(a), axis.number(b)) for a, b in spans]
    if len(numbers) > 4:
        first, last = numbers[0][0], numbers[-1][1]
        between = f"in {len(numbers)} parts between {axis.in_words(f'{first} and {last}')}"
        return f"at {count} of {mask.size} {axis.places} {between}"
    words = (a if a == b else f"{a} to {b}" for a, b in numbers)
    return f"at {axis.in_words(', '.join(words))}"


def decibels(ratio: FloatArray) -> FloatArray:
    """Return 10 log10 of a ratio; −inf where the ratio is 0."""
    with np.errstate(divide="ignore"):
        return 10.0 * np.log10(ratio)


def probability(value: float) -> str:
    """Return a probability or its 3σ in four digits; "0" below `LEAST`."""
    if np.isnan(value):
        return "-"
    if abs(value) < LEAST:
        return "0"
    return f"{value:.4f}" if abs(value) >= SHOWN else f"{value:.0e}"


def heading(yaw_deg: float) -> str:
    """Return a yaw [deg] as a heading from 0 to below 360 deg, in four digits."""
    return f"heading {float(f'{round(yaw_deg, 6) % 360:.4g}') % 360:g} deg"


def describe_detector(detector: Detector) -> str:
    """Return a detector in words."""
    names = [name for name, cls in DETECTORS.items() if type(detector) is cls]
    own = type(detector)
    words = names[:1] or [own.__name__ if own.__repr__ is object.__repr__ else repr(detector)]
    if not isinstance(detector, PulseDetector):
        return words[0]
    if detector.pulses > 1:
        words.append(f"{detector.pulses} pulses")
    if detector.cfar is not None:
        kinds = [name for name, cls in CFARS.items() if isinstance(detector.cfar, cls)]
        rank = f"{detector.cfar.rank} of " if isinstance(detector.cfar, OrderedStatistics) else ""
        words.append(f"{kinds[0]} {rank}{detector.cfar.cells}")
    if detector.binary is not None:
        words.append(f"{detector.binary.m} of {detector.binary.n}")
    return ", ".join(words)


def describe_band(p_d: float, lower: float, upper: float, k: float) -> str:
    """Return P_D and its band as two numbers."""
    middle, low, high = map(probability, (p_d, lower, upper))
    return f"P_D {middle}, between {low} and {high} ({k:.4g} sigma)"


def places(masks: Mapping[str, NDArray[np.bool_]], axis: Axis) -> dict[str, str]:
    """Return the poses of each mask in words, without the masks that hold nowhere."""
    return {name: place for name, mask in masks.items() if (place := describe_poses(mask, axis))}


def vanishing_gradient(places: Mapping[str, str]) -> Iterator[str]:
    """Yield a warning of sources whose gradient vanishes at some poses."""
    if places:
        named = ", ".join(f"{source} {place}" for source, place in places.items())
        if len(places) > NAMED:
            named = f"{len(places)} sources at some poses, listed in the record"
        yield warning(
            "gradient-vanishes",
            f"the linear budget misses {named}, where the gradient vanishes; use --method form",
        )


def correlated_sources(three_sigma: Sequence[FloatArray], total: FloatArray) -> Iterator[str]:
    """Yield a warning if the sources do not add up to the total, because they are correlated."""
    gap = np.nanmax(abs(total - np.sqrt(np.sum(np.square(three_sigma), axis=0))), initial=0)
    if gap > 1e-9 * np.nanmax(total, initial=0):
        yield warning(
            "sources-correlated",
            "the sources are correlated: the total differs from the root sum of squares by up to "
            f"{gap:.2g}",
        )


NOMINAL = "P_D at the nominal states, of all radars together."


def add_axis(table: Table, axis: Axis) -> None:
    """Add the column of the values of an axis."""
    table.add(axis.key, axis.values, axis.meaning, unit_name(axis.key))


def of_radar(name: str) -> tuple[str, str]:
    """Return the beginning of a column's meaning and the end of its name; "" for all radars."""
    return (f"{OF_RADAR}{name} alone: ", f"_{name}") if name else ("", "")


def add_band(table: Table, moments: Moments, k: float = 3.0, radar: str = "") -> None:
    """Add the columns of P_D with its band, of all radars or of one alone."""
    of, ending = of_radar(radar)
    nominal = f"{of}P_D at the nominal states." if radar else NOMINAL
    table.add(f"p_d{ending}", moments.p_d, nominal)
    table.add(f"sigma_pd{ending}", moments.std, f"{of}Standard deviation of P_D.")
    add_bounds(table, moments, k, radar)


def add_bounds(table: Table, band: Band, k: float, radar: str = "") -> None:
    """Add the columns of the bounds of P_D, of all radars or of one alone."""
    of, ending = of_radar(radar)
    for end, bound in (("lower", band.lower), ("upper", band.upper)):
        meaning = f"{of}{end.capitalize()} {k:g}-sigma bound of P_D."
        table.add(f"{end}_{k:.12g}sigma{ending}", bound, meaning)


def add_mean(table: Table, mean: FloatArray, method: str, ending: str = "") -> None:
    """Add the column of the mean of P_D; the mean by `linear` is P_D itself."""
    if method != "linear":
        level = f" at the level {ending[1:]}" if ending else ""
        table.add(f"mean_pd{ending}", mean, f"Mean of P_D{level}; for linear the mean is p_d.")


def add_draws(
    table: Table, draws: DrawStatistics, k: float, what: str = "P_D", before: str = ""
) -> None:
    """Add the columns of the draws of P_D, or of what else they are of."""
    table.add(f"{before}mc_mean", draws.mean, f"Mean of the draws of {what}.")
    table.add(f"{before}mc_std", draws.std, f"Standard deviation of the draws of {what}.")
    for end, values, sign in (("lower", draws.lower, -1), ("upper", draws.upper, 1)):
        about = f"{sign * k:+g} sigma of a normal distribution"
        meaning = f"Quantile of the draws of {what} at {ndtr(sign * k):.5f}, as {about}."
        table.add(f"{before}mc_{end}", values, meaning)


def rows(named: Iterable[tuple[str, str]]) -> list[str]:
    """Return lines of names and words, in two columns."""
    pairs = list(named)
    width = max((len(name) for name, _ in pairs), default=0)
    return [f"  {name:{width}}  {words}" for name, words in pairs]


def add_radars(result: Result, at_level: Mapping[str, Mapping[str, FloatArray]]) -> None:
    """Add the largest 3σ of P_D by each radar of a network alone, from σ (n,) at each level."""
    scenario, axis = result.scenario, result.scenario.axis
    found = {
        level: {name: peak(3 * std, axis) for name, std in radars.items()}
        for level, radars in at_level.items()
    }
    (_, first), *others = found.items()
    if not first:
        return
    result.summary["largest_three_sigma_by_itself"] = found if others else first
    lines = []
    visible = scenario.model.visible(scenario.aircraft, scenario.radar)
    for name, seen in zip(first, visible.T, strict=True):
        tops = ", ".join(
            f"{level} " * bool(others) + describe_extreme(of_level[name], axis)
            for level, of_level in found.items()
        )
        lines.append((name, tops + ("" if seen.any() else "; out of sight at every nominal pose")))
    result.report += ["largest 3 sigma of each radar alone:", *rows(lines)]


def level_and_method(scenario: Scenario) -> str:
    """Return the level of radar uncertainty, and a method other than linear."""
    level, method = scenario.level, scenario.method
    return level if method == "linear" else f"{level}, {method}"


def validity_warnings(
    scenario: Scenario, moments: Moments, k: float = 3.0, remedy: str = REMEDY
) -> Iterator[str]:
    """Yield where the band of the method is off, or not precise, and what to use there."""
    axis, method = scenario.axis, scenario.method
    off = unreliable_in_scenario(scenario, moments, beta=k)
    outside = ((moments.lower < 0) | (moments.upper > 1)) & ~off
    known = np.isfinite(moments.std + moments.lower + moments.upper)
    yield from _of_std(scenario, moments.std, known, off, remedy)
    yield from placed("band-outside", outside, axis, f"the {method} {k:g}-sigma band leaves [0, 1]")
    far = f": a bound by over {BOUND_CHANGE:g} or a tenth of it, or sigma by over {STD_CHANGE:.0%}"
    yield from band_off(off & known, axis, method, f"{far}; {remedy}", f"{BOUND_CHANGE:g}")


def band_off(
    off: NDArray[np.bool_], axis: Axis, method: str, why: str, error: str, of: str = ""
) -> Iterator[str]:
    """Yield where (n,) a band is off, and why; of a band by draws, where its error is above one."""
    if method == AUTOMATIC:
        why = f": a bound has a standard error above {error}"
        yield from placed("band-imprecise", off, axis, f"the {method} band{of} is not precise", why)
    else:
        yield from placed("band-off", off, axis, f"the {method} band{of} is off", why)


def std_warnings(scenario: Scenario, std: FloatArray, off: NDArray[np.bool_]) -> Iterator[str]:
    """Yield where σ (n,) by the method is off, or has no value, of analyses that have no bounds."""
    known = np.isfinite(std)
    yield from _of_std(scenario, std, known, off, REMEDY)
    why, what = f": by over {STD_CHANGE:.0%}; {REMEDY}", f"sigma by {scenario.method} is off"
    yield from placed("sigma-off", off & known, scenario.axis, what, why)


def add_trust(result: Result, what: str = "", by_draws: int = 0) -> None:
    """Add what draws say of the method, unless a warning says where it is off."""
    if not result.warnings:
        result.report.append(checked(result.scenario, what, by_draws))


def checked(scenario: Scenario, what: str = "", by_draws: int = 0) -> str:
    """Return that draws have checked the method, and at how many poses they replace `form`."""
    poses, method = counted(len(scenario.axis), "pose"), scenario.method
    instead = f"; draws replace form at {by_draws}" if by_draws and method == AUTOMATIC else ""
    return f"method: {method}, {what}checked by draws at {poses}{instead}"


def _of_std(
    scenario: Scenario,
    std: FloatArray,
    known: NDArray[np.bool_],
    off: NDArray[np.bool_],
    remedy: str,
) -> Iterator[str]:
    """Yield where σ or a bound has no value, and where σ is implausible."""
    why = "not converged, or radar straight above or below the aircraft"
    axis, large = scenario.axis, (3 * std > 1) & ~off
    what = f"{scenario.method} has no value ({why})"
    yield from placed("no-value", ~known, axis, what, f": {remedy}")
    why = ": errors cross a limit or a narrow lobe, a radar is known poorly, or a unit is wrong"
    yield from placed("uncertainty-large", large, axis, "3 sigma of P_D is above 1", why)


def gathered(labelled: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """Return one line "a, b and c: text" for all labels with a warning of one name.

    Where the texts differ, the line is "a (similar: b and c): text", with the text of a.
    """
    by_name: dict[str, dict[str, str]] = {}
    for label, text in labelled:
        by_name.setdefault(text.rpartition(" [")[2], {})[label] = text
    lines = []
    for texts in by_name.values():
        labels, text = list(texts), next(iter(texts.values()))
        if len(labels) > NAMED:
            labels[NAMED - 1 :] = [f"{len(labels) - NAMED + 1} more"]
        if len(set(texts.values())) > 1:
            lines.append(f"{labels[0]} (similar: {listed(labels[1:])}): {text}")
        else:
            lines.append(f"{listed(labels)}: {text}")
    return tuple(lines)


def table_warnings(scenario: Scenario) -> Iterator[str]:
    """Yield a warning where states within 3σ are beyond the elevations of an RCS table.

    The standard deviation of the elevation is computed to first order.
    """
    aircraft, outside = scenario.aircraft, np.zeros(len(scenario.aircraft), dtype=bool)
    covered, reached_deg = [], []
    by_aircraft = np.moveaxis(square_root(scenario.cov_aircraft), -1, 0)
    for one, radar in zip(scenario.radars, scenario.radar_states, strict=True):
        table = one.model.rcs
        if not isinstance(table, TableRCS) or table.elevation is None:
            continue
        low, high = table.elevation[[0, -1]]
        # nothing is beyond a pole
        least, most = low if low > -POLE else -np.inf, high if high < POLE else np.inf
        by_radar = square_root(one.levels[scenario.level].covariance).T
        variance = np.zeros(len(aircraft))
        for a, r in (*((a, 0.0) for a in by_aircraft), *((0.0, r) for r in by_radar)):
            ends = (body_vector(aircraft + s * a, radar + s * r) for s in (1, -1))
            above, below = map(elevation_of, ends)
            variance += (0.5 * (above - below)) ** 2
        elevation, std = elevation_of(body_vector(aircraft, radar)), np.sqrt(variance)
        lowest, highest = elevation - 3 * std, elevation + 3 * std
        beyond = (lowest < least) | (highest > most)
        outside |= beyond
        if beyond.any():
            covered.append(f"{np.rad2deg(low):g} to {np.rad2deg(high):g}")
            reached_deg += np.rad2deg([lowest.min(), highest.max()]).clip(-90, 90).tolist()
    if covered:
        yield warning(
            "table-exceeded",
            f"the RCS table covers elevations from {listed(dict.fromkeys(covered))} deg; "
            f"states within 3 sigma are at {min(reached_deg):.1f} to {max(reached_deg):.1f} deg, "
            f"beyond it {describe_poses(outside, scenario.axis)}; the outermost values of the "
            "table are used there",
        )
