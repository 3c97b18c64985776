"""How far each radar detects the aircraft, by bearing or by aspect."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from radar_sense import options, plotting, words
from radar_sense.axis import Axis, reached
from radar_sense.command import OF_RADAR, Figure, Option, Result, Table, command
from radar_sense.cost import foresee
from radar_sense.coverage.ranges import PRECISION, RangeAt, limit_of_radar, range_at
from radar_sense.coverage.rays import FARTHEST, rays
from radar_sense.coverage.reach import END, RAY, survey
from radar_sense.errors import InputError
from radar_sense.limits import PROBABILITY, Limit
from radar_sense.plausibility import height_of_option
from radar_sense.progress import report
from radar_sense.propagation import no_draws
from radar_sense.scenario import Scenario, single_radar_scenarios
from radar_sense.states import DOWN, YAW, FloatArray

#: Default P_D of the range.
P_D = 0.5
#: A smaller σ, as a part of the range, is rounding. And ranges that differ by less are shown alike.
ROUNDING, ALIKE = 1e-12, 1e-6
#: Factor by which σ to first order differs from σ where it does not explain it.
UNLIKE = 1.5
BEARING, ASPECT = "bearing", "aspect"
ANGLES = {
    BEARING: "Bearing from the radar, clockwise from north.",
    ASPECT: "With --by aspect: bearing of the radar from the heading, in the level plane.",
}


@command(
    options.LEVEL,
    options.ONE_RADAR,
    options.METHOD_BUT_DRAWS,
    Option(
        "p_d",
        "P_D at the range; may be given several times.",
        PROBABILITY,
        default_text=f"{P_D:g}",
        multiple=True,
    ),
    Option(
        "by",
        "Angle of the table; by aspect, the aircraft turns at the bearing of the first pose.",
        metavar="bearing|aspect",
        choices=(BEARING, ASPECT),
    ),
    Option("step_deg", "Step of the angle.", Limit(at_least=0.1, at_most=90), "DEG"),
    options.K,
    options.DOWN_KM,
    options.COURSE_DEG,
    examples=(
        "radar-sense range",
        "radar-sense range my.yaml --p-d 0.1 --p-d 0.9 --method form",
        "radar-sense range my.yaml --by aspect --down-km -3",
        "radar-sense range network.yaml --radar ridge",
    ),
    name="range",
)
def detection_range(
    scenario: Scenario,
    *,
    p_d: Sequence[float] = (P_D,),
    by: str = BEARING,
    step_deg: float = 1.0,
    k: float = 3.0,
    down_km: float | None = None,
    course_deg: float | None = None,
) -> Result:
    """How far each radar detects the aircraft, by bearing or by aspect.

    The aircraft is put around each radar at the height, roll, pitch and yaw of the first pose. The
    range is the farthest slant range at which P_D has the chosen value. The band of K sigma is the
    uncertainty of the range from the uncertain states and radar. By linear, sigma of the range is
    sigma of P_D divided by the slope of P_D along the ray. By other methods, the bounds of P_D have
    the value at the bounds of the range.
    """
    method = scenario.method
    no_draws(method)
    if by == ASPECT and course_deg is not None:
        raise InputError("'by' aspect turns the aircraft, 'course_deg' does not; use one of them")
    values = list(p_d)
    _check_values(scenario, values)
    result = Result(scenario)
    angle_deg = np.arange(0.0, 360.0 - 1e-9, step_deg)
    axis = Axis(f"{by}_deg", by, "deg", angle_deg, "g", 1e-9, f"{by}s", ANGLES[by])
    down = None if down_km is None else down_km * 1e3
    course = None if course_deg is None else math.radians(course_deg)
    singles = single_radar_scenarios(scenario) or {"": scenario}
    rays_in_all = len(angle_deg) * len(singles)
    foresee(f"{rays_in_all:,} rays", rays_in_all * RAY, less="rays of a longer --step-deg")
    angle = np.deg2rad(angle_deg)
    surveys = {
        name: survey(rays(single, angle, by_aspect=by == ASPECT, down=down, course=course))
        for name, single in singles.items()
    }
    ranges: dict[str, list[RangeAt]] = {}
    for name, seen in surveys.items():
        report("radars", len(ranges), len(surveys))
        ranges[name] = [range_at(seen, value, method, k) for value in values]

    words.add_axis(result.table, axis)
    columns = [  # each range with the end of its names and the start of its meanings
        (at, f"{at.p_d:g}_{name}" if name else f"{at.p_d:g}", f"{OF_RADAR}{name}: " if name else "")
        for name, of_radar in ranges.items()
        for at in of_radar
    ]
    for column in columns:
        _add_bands(result.table, *column, k)
    for column in columns:
        _add_sources(result.table, *column)

    pose = next(iter(surveys.values())).all_rays.pose
    title = f"{0.0 - pose[DOWN] / 1e3:.4g} km above the origin"
    title += "" if by == ASPECT else f", {words.heading(math.degrees(pose[YAW]))}"
    chosen = words.level_and_method(scenario)
    result.report += [f"slant range of detection by {by}, {title} ({chosen}):"]
    for name, of_radar in ranges.items():
        result.report += [f"{name}:"] if name else []
        for at in of_radar:
            result.report += [f"  P_D {at.p_d:g}: {line}" for line in _lines(at, axis, k)]
        result.report += [f"  {line}" for at in of_radar for line in _exceptions(at, axis)]
    names = [name for name in singles if name]
    result.summary |= {
        "by": by,
        "p_d": values,
        "radars": names,
        "down_km": float(pose[DOWN]) / 1e3,
        "title": title,
        "range_m": {
            name or "radar": {f"{at.p_d:g}": _summary(at) for at in of_radar}
            for name, of_radar in ranges.items()
        },
    }

    off = {name: np.any([at.unreliable for at in group], axis=0) for name, group in ranges.items()}
    why, error = f"; {words.REMEDY}", f"{PRECISION:.0%}"
    warnings = [
        (name, text)
        for name, mask in off.items()
        for text in words.band_off(mask, axis, method, why, error, " of the range")
    ]
    result.warnings += height_of_option(scenario, down_km)
    result.warnings += words.gathered(warnings) if names else [text for _, text in warnings]
    checked = sum(map(_checked, ranges.values()))
    if not warnings and checked:
        text = f"both ends of the band checked by draws on {checked:,} rays"
        result.report.append(f"method: {method}, {text}")
    limits = {name: limit_of_radar(seen) for name, seen in surveys.items()}
    label = rf"band of ${k:g}\,\sigma$ ({scenario.level})"
    result.draw = partial(
        _draw, angle_deg=angle_deg, ranges=ranges, limits=limits, by=by, title=title, label=label
    )
    return result


def _add_bands(table: Table, at: RangeAt, label: str, of: str, k: float) -> None:
    """Add the range and its band."""
    first = f"{of}Farthest slant range with P_D {at.p_d:g}; 0 where there is none."
    of_std = (
        "Standard deviation of this range, of drawn ranges unless by linear; NaN where there is "
        "none, at the end of the search, and by linear where a limit comes first."
    )
    table.add(f"range_m_{label}", at.slant, first, "m")
    table.add(f"sigma_range_m_{label}", at.std, f"{of}{of_std}", "m")
    for end, bound in (("lower", at.lower), ("upper", at.upper)):
        meaning = f"{of}{end.capitalize()} {k:g}-sigma bound of this range."
        table.add(f"{end}_{k:.12g}sigma_m_{label}", bound, meaning, "m")


def _add_sources(table: Table, at: RangeAt, label: str, of: str) -> None:
    """Add the sources of the range, the limit of the radar, and the edges."""
    for source, std in at.by_source.items():
        meaning = f"{of}Standard deviation from {source} alone, to first order."
        table.add(f"sigma_range_m_{label}_from_{source}", std, meaning, "m")
    limited, edges = at.reach.limited.astype(float), at.reach.edges.astype(float)
    meaning = f"{of}1 where a limit of the radar comes first, else 0."
    table.add(f"limited_{label}", limited, meaning)
    meaning = f"{of}Number of times that P_D was found to pass the value along the ray."
    table.add(f"edges_{label}", edges, meaning)


def _check_values(scenario: Scenario, values: Sequence[float]) -> None:
    """Raise InputError unless all P_D are different, above P_D without a signal and below 1."""
    nothing = np.zeros(())
    floor = max(max(m.p_fa, float(m.detector.p_d(nothing, m.p_fa))) for m in scenario.model.models)
    for value in values:
        if not (1.0 + 1e-9) * floor < value < 1:
            raise InputError(
                f"'p_d' must be above {floor:.4g}, P_D without a signal, and less than 1; "
                f"got {value:g}"
            )
    if len({f"{value:g}" for value in values}) < len(values) or not values:
        raise InputError("'p_d' must have one value or more, each once")


def _summary(at: RangeAt) -> dict[str, Any]:
    """Return the numbers of the record for one P_D."""
    return {
        "least_m": float(at.slant.min()),
        "greatest_m": float(at.slant.max()),
        "largest_sigma_m": float(np.fmax.reduce(at.std)),
        "limited": int(np.count_nonzero(at.reach.limited)),
        "none": int(np.count_nonzero(at.slant == 0)),
        "no_value": int(np.count_nonzero(np.isnan([at.std, at.lower, at.upper]).any(axis=0))),
        "share": at.shares(),
    }


def _checked(of_radar: Sequence[RangeAt]) -> int:
    """Return the number of rays with a band at every P_D."""
    bands = [np.isfinite(at.upper - at.lower) & (at.upper > 0) for at in of_radar]
    return int(np.count_nonzero(np.all(bands, axis=0)))


def _lines(at: RangeAt, axis: Axis, k: float) -> list[str]:
    """Describe the range for one P_D, and its band where it is widest, with the sources of it."""
    if not (at.slant > 0).any():
        if not (at.upper > 0).any():
            bound = "" if np.all(at.upper == 0) else " of the nominal states"
            return [f"at no range{bound}; sigma has no value"]
        highest = int(np.nanargmax(at.upper))
        place = axis.at(highest)
        if np.ptp(at.upper) <= PRECISION * at.upper[highest]:
            place = f"every {axis.name}"
        upper = f"up to {_km(at.upper[highest])} at {place}"
        return [f"at no range of the nominal states; the upper bound ({k:g} sigma) is {upper}"]
    least, greatest = at.slant.min(), at.slant.max()
    alike = greatest - least <= ALIKE * greatest
    if alike:
        first = f"{_km(greatest)} at every {axis.name}"
    else:
        first = " to ".join(
            f"{_km(end)} {words.describe_poses(abs(at.slant - end) <= ALIKE * greatest, axis)}"
            for end in (least, greatest)
        )
    width = at.upper - at.lower
    if not np.isfinite(width).any():
        return [first]
    widest = int(np.argmax(reached(width)))
    if width[widest] <= ROUNDING * at.slant[widest] and at.upper[widest] > 0:
        unknown = at.reach.endless[widest] or np.isnan(width).any()
        return [first] if unknown else [first, "the band has no width"]
    middle, lower, upper = (_km(x[widest]) for x in (at.slant, at.lower, at.upper))
    band = f"between {lower.removesuffix(' km')} and {upper} ({k:g} sigma)"
    shares = sorted(at.shares([widest]).items(), key=lambda item: -item[1])
    sources = [f"{name} {share:.0%}" for name, share in shares if share >= 0.005]
    # to first order sources do not explain σ across limits and lobes
    first_order = math.hypot(*(std[widest] for std in at.by_source.values()))
    std = at.std[widest]
    explained = sources and first_order < UNLIKE * std and std < UNLIKE * first_order
    end = f"; from {words.listed(sources)}" if explained else ""
    if alike and np.ptp(width) <= ALIKE * greatest:
        return [f"{first}, {band}{end}"]
    return [first, f"{middle}, {band}, where the band is widest, at {axis.at(widest)}{end}"]


def _km(distance: float) -> str:
    """Return a distance [m] in words. At the end of the search it is a lower bound."""
    return f"{distance / 1e3:.4g} km" if distance < END else f"over {FARTHEST / 1e3:g} km"


def _exceptions(at: RangeAt, axis: Axis) -> list[str]:
    """Describe where there is no range, where a limit comes first, and where P_D rises again."""
    none, limited, edges = at.slant == 0, at.reach.limited, at.reach.edges
    without = np.isnan([at.std, at.lower, at.upper]) & ~at.reach.endless
    without[0] &= ~none
    end = f"{FARTHEST / 1e3:g} km, the end of the search"
    masks = {
        "at no range {}; sigma has no value": none & ~none.all(),
        "the limit of the radar comes first {}": limited & ~without[0],
        "the limit of the radar comes first {}; sigma has no value": limited & without[0],
        "sigma has no value {}: P_D does not fall with distance": without[0] & ~limited,
        "the lower bound has no value {}": without[1],
        "the upper bound has no value {}": without[2],
        f"passed at {edges.max()} ranges or more, {{}}; the farthest is given": edges > 1,
        f"still higher at {end}, {{}}; sigma has no value": at.reach.endless,
    }
    said = (text.format(place) for text, place in words.places(masks, axis).items())
    return [f"P_D {at.p_d:g}: {text}" for text in said]


def _draw(
    figure: Figure,
    angle_deg: FloatArray,
    ranges: Mapping[str, Sequence[RangeAt]],
    limits: Mapping[str, FloatArray],
    by: str,
    title: str,
    label: str,
) -> None:
    """Draw ranges and bands around each radar."""
    width, count = plotting.nominal_width(figure), len(ranges)
    columns = min(count, int(width / (1.6 if count <= 6 else 1.1)))
    rows = -(-count // columns)
    plotting.set_height(figure, 3.3 if count == 1 else rows * (0.35 + min(width / columns, 1.75)))
    panels: Any = figure.subplots(rows, columns, squeeze=False, subplot_kw={"projection": "polar"})
    angle, styles = np.deg2rad(np.append(angle_deg, 360.0)), plotting.radar_styles(list(ranges))

    def closed(distance: FloatArray) -> FloatArray:
        """Return distances [km], with the first again at the end of the circle."""
        return np.append(distance, distance[0]) / 1e3

    for panel, (name, of_radar) in zip(panels.flat, ranges.items(), strict=False):
        # of a network the colour is the radar, and the dashes are the P_D in every panel
        own = ((styles[name][0] if name else colour, dash) for colour, dash in plotting.styles())
        for at, (colour, dashes) in zip(of_radar, own, strict=False):
            known = np.where(at.reach.endless, np.nan, at.slant)
            lower, reach, upper = map(closed, (at.lower, known, at.upper))
            band = label if at is of_radar[0] else None
            panel.fill_between(angle, lower, upper, color=colour, alpha=0.22, lw=0, label=band)
            panel.plot(angle, reach, color=colour, ls=dashes, label=rf"$P_D$ = {at.p_d:g}")
        # the data set the radius, and not a limit far beyond them
        farthest = 1.15 * max(float(np.nanmax([at.slant, at.upper])) for at in of_radar) / 1e3
        limit = closed(limits[name])
        if limit.min() < farthest:
            thin, text = plotting.points(0.8), "limit of the radar"
            panel.plot(angle, limit, color="0.35", lw=thin, ls=":", label=text)
        names = plotting.ASPECTS if by == ASPECT else plotting.BEARINGS
        radius = "" if count > 1 else "Slant range [km]"
        panel.set_rlim(0, farthest or 1.0)
        plotting.set_compass(panel, () if count > 1 else names, radius)
        if count > 1:
            letters = int(16 * width / columns)  # of the size below in the width of a panel
            panel.set_title(plotting.in_lines(name, letters), fontsize=plotting.points(8))
    for panel in panels.flat[count:]:
        panel.remove()
    if any(at.reach.endless.any() for of_radar in ranges.values() for at in of_radar):
        text = f"no line where P_D is still higher at {FARTHEST / 1e3:g} km"
        plotting.add_small_print(figure, text)
    up = "nose" if by == ASPECT else "north"
    unit = f"slant range in km, {up} up\n" if count > 1 else ""
    drawn = panels.flat[:count]
    most = max(drawn, key=lambda panel: len(panel.get_legend_handles_labels()[1]))
    plotting.draw_legend(figure, most, title=unit + title)
