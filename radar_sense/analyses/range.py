"""How far each radar detects the aircraft, by bearing or by aspect."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from radar_sense.analyses.verdict import K
from radar_sense.axis import Axis, reached
from radar_sense.command import (
    COURSE_DEG,
    DOWN_KM,
    LEVEL,
    METHOD,
    ONE_RADAR,
    Option,
    Result,
    Table,
    command,
)
from radar_sense.cost import foresee
from radar_sense.coverage.rays import (
    EVALUATIONS,
    FARTHEST,
    Rays,
    Reach,
    Survey,
    bounds_of_reach,
    rays,
    survey,
)
from radar_sense.errors import InputError
from radar_sense.limits import PROBABILITY, Limit
from radar_sense.plausibility import below_ground
from radar_sense.propagation import (
    AUTOMATIC,
    distribution,
    no_draws,
    propagate_scenario,
    unreliable_in_scenario,
)
from radar_sense.propagation.draws import estimate
from radar_sense.scenario import Scenario, single_radar_scenarios
from radar_sense.sources import error_budget
from radar_sense.states import DOWN, YAW, FloatArray
from radar_sense.words import (
    describe_poses,
    gathered,
    level_and_method,
    listed,
    warning,
)

if TYPE_CHECKING:
    from radar_sense.plotting import Figure

#: Default P_D of the range.
P_D = 0.5
#: Nodes ±√3 and 0 of the Gauss-Hermite rule of three points, exact for polynomials up to degree 5
#: (M. Abramowitz and I. A. Stegun, Handbook of Mathematical Functions, 1964, 25.4.46).
NODE = math.sqrt(3.0)
#: Relative step of the distance for the slope of P_D along a ray. The error is the square.
_STEP = 1e-5
#: Bounds by draws: draws at each end, steps of Newton's method, the longest step in ln of the
#: distance, the step of the slope, and |z| of a P_D that is 0 or 1 for the method.
DRAWS, NEWTON_STEPS, MOST_STEP, WIDER, FAR = 4096, 3, 0.2, 0.01, 8.0
#: A smaller σ, as a part of the range, is rounding.
ROUNDING = 1e-12
BEARING, ASPECT = "bearing", "aspect"
ANGLES = {
    BEARING: "Bearing from the radar, clockwise from north.",
    ASPECT: "With --by aspect: azimuth in the body frame, clockwise from the nose.",
}


@dataclass(frozen=True, eq=False)
class RangeAt:
    """Detection range for one P_D by bearing or aspect (n,), in metres of slant range.

    Attributes:
        p_d: P_D.
        reach: Distance along each ray.
        slant: Slant range; 0 where P_D is nowhere as high.
        std: Standard deviation; NaN where a limit of the radar comes first or there is no range.
        lower: Lower bound at Φ(−k).
        upper: Upper bound at Φ(k).
        by_source: Standard deviation from each source alone, to first order.
        unreliable: Where the method is unreliable.
    """

    p_d: float
    reach: Reach
    slant: FloatArray
    std: FloatArray
    lower: FloatArray
    upper: FloatArray
    by_source: Mapping[str, FloatArray]
    unreliable: NDArray[np.bool_]


@command(
    LEVEL,
    ONE_RADAR,
    METHOD,
    Option(
        "p_d",
        "P_D at the range; may be given several times.",
        PROBABILITY,
        default_text=f"{P_D:g}",
        multiple=True,
    ),
    Option(
        "by",
        "Angle of the table; by aspect, the aircraft turns at one bearing.",
        metavar="bearing|aspect",
        default=BEARING,
        choices=(BEARING, ASPECT),
    ),
    Option("step_deg", "Step of the angle.", Limit(at_least=0.1, at_most=90), "DEG", default=1.0),
    K,
    DOWN_KM,
    COURSE_DEG,
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

    Args:
        scenario: The scenario.
        p_d: P_D, or several.
        by: "bearing" from the radar, or "aspect". An aspect is the azimuth of the radar in the body
            frame. The aircraft then turns at the bearing of the first pose.
        step_deg: Step of the angle [deg].
        k: Number of σ of the band.
        down_km: Down coordinate [km]; the first pose's if None.
        course_deg: Yaw [deg]; the first pose's if None.

    Raises:
        InputError: If an option is not allowed, or a P_D is not between P_fa and 1.
    """
    method = scenario.method
    no_draws(method)
    if by == ASPECT and course_deg is not None:
        raise InputError("by aspect turns the aircraft, course_deg does not; use one of them")
    values = list(p_d)
    _check_values(scenario, values)
    result = Result(scenario, method)
    angle_deg = np.arange(0.0, 360.0 - 1e-9, step_deg)
    axis = Axis(f"{by}_deg", by, "deg", angle_deg, "g", 1e-9, f"{by}s")
    options: dict[str, Any] = {
        "by_aspect": by == ASPECT,
        "down": None if down_km is None else down_km * 1e3,
        "course": None if course_deg is None else math.radians(course_deg),
    }
    singles = single_radar_scenarios(scenario) or {"": scenario}
    rays_in_all = len(angle_deg) * len(singles)
    evaluations = rays_in_all * EVALUATIONS[method]
    foresee(f"{rays_in_all:,} rays", evaluations, less="rays of a longer --step-deg")
    surveys = {
        name: survey(rays(single, np.deg2rad(angle_deg), **options))
        for name, single in singles.items()
    }
    ranges = {name: _ranges(seen, values, method, k) for name, seen in surveys.items()}

    result.table.add(axis.key, angle_deg, ANGLES[by], "°")
    for add in (_add_bands, _add_sources):
        for name, of_radar in ranges.items():
            for at in of_radar:
                add(result.table, at, name, k)

    pose = next(iter(surveys.values())).all_rays.pose
    title = f"{0.0 - pose[DOWN] / 1e3:.4g} km above the origin"
    title += "" if by == ASPECT else f", heading {math.degrees(pose[YAW]) % 360:.4g} deg"
    chosen = level_and_method(scenario.level, method)
    result.report += [f"slant range of detection by {by}, {title} ({chosen}):"]
    for name, of_radar in ranges.items():
        result.report += [f"{name}:"] if name else []
        for at in of_radar:
            result.report += [f"  {line}" for line in (_line(at, axis), *_band(at, axis, k))]
        result.report += [f"  {line}" for at in of_radar for line in _exceptions(at, axis)]
    names = list(singles) if len(singles) > 1 else []
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

    warnings = []
    for name, of_radar in ranges.items():
        place = describe_poses(np.any([at.unreliable for at in of_radar], axis=0), axis)
        if place:
            text = f"the {method} band of the range is off {place}; use --method {AUTOMATIC}"
            warnings.append((name, warning("band-off", text)))
    result.warnings += below_ground(scenario, down_km)
    result.warnings += gathered(warnings) if names else [text for _, text in warnings]
    if not warnings and any(np.isfinite(at.std).any() for of in ranges.values() for at in of):
        checked = f"both ends of the band checked by draws on {rays_in_all:,} rays"
        result.report.append(f"method: {method}, {checked}")
    limits = {name: _limits(seen) for name, seen in surveys.items()}
    label = rf"band of ${k:g}\,\sigma$ ({scenario.level})"
    result.draw = partial(
        _draw, angle_deg=angle_deg, ranges=ranges, limits=limits, by=by, title=title, label=label
    )
    return result


def _add_bands(table: Table, at: RangeAt, radar: str, k: float) -> None:
    """Add the range and its band."""
    label, of = _label(at, radar)
    name = f"{at.p_d:g}"
    meaning = f"{of}Farthest slant range with P_D {name}; 0 where there is none."
    table.add(f"range_m_{label}", at.slant, meaning, "m")
    table.add(f"sigma_range_m_{label}", at.std, f"{of}Standard deviation of this range.", "m")
    for end, bound in (("lower", at.lower), ("upper", at.upper)):
        meaning = f"{of}{end.capitalize()} {k:g}-sigma bound of this range."
        table.add(f"{end}_{k:.12g}sigma_m_{label}", bound, meaning, "m")


def _add_sources(table: Table, at: RangeAt, radar: str, _: float) -> None:
    """Add the sources of the range, the limit of the radar, and the edges."""
    label, of = _label(at, radar)
    for source, std in at.by_source.items():
        meaning = f"{of}Standard deviation from {source} alone, to first order."
        table.add(f"sigma_range_m_{label}_from_{source}", std, meaning, "m")
    meaning = f"{of}1 where a limit of the radar comes first, else 0."
    table.add(f"limited_{label}", at.reach.limited.astype(float), meaning)
    meaning = f"{of}Number of times that P_D passes the value along the ray."
    table.add(f"edges_{label}", at.reach.edges.astype(float), meaning)


def _label(at: RangeAt, radar: str) -> tuple[str, str]:
    """Return the end of the names of columns, and the start of their meanings."""
    return (f"{at.p_d:g}_{radar}", f"For radar {radar}: ") if radar else (f"{at.p_d:g}", "")


def _check_values(scenario: Scenario, values: Sequence[float]) -> None:
    """Raise InputError unless all P_D are different, above P_fa and below 1."""
    p_fa = max(model.p_fa for model in scenario.model.models)
    for value in values:
        if not p_fa < value < 1:
            raise InputError(
                f"p_d must be greater than p_fa, {p_fa:g}, and less than 1, got {value:g}"
            )
    if len({f"{value:g}" for value in values}) < len(values) or not values:
        raise InputError("p_d must have one value or more, each once")


def _ranges(seen: Survey, values: list[float], method: str, k: float) -> list[RangeAt]:
    """Return the detection range for each P_D, with σ and band."""
    around = seen.all_rays
    ranges = []
    for value in values:
        reach = seen.reach(value)
        exists = ~np.isnan(reach.distance)
        slant = _slant(around, np.nan_to_num(reach.distance))
        defined = exists & ~reach.limited
        # Where a limit comes first, the band is computed without the limit and cut off there.
        unlimited = seen.reach(value, limits=False).distance
        distance = np.where(exists, unlimited, FARTHEST)
        at = around.at(distance)
        slope = _slope(around, distance)
        slope = np.where(exists & (slope < 0), slope, np.nan)
        budget = error_budget(at)
        std = budget.std / abs(slope)
        by_source = {
            name: np.where(defined, alone / abs(slope), np.nan)
            for name, alone in budget.alone.items()
        }
        if method == "linear":
            lower, upper = _first_order_band(seen, _slant(around, distance), k * std)
            moments = propagate_scenario(at, method="probit", beta=k)
            unreliable = exists & unreliable_in_scenario(at, moments, method="probit", beta=k)
        else:
            smooth = "form" if method == AUTOMATIC else method
            band = bounds_of_reach(seen, value, smooth, k)
            middle = bounds_of_reach(seen, value, smooth, NODE)
            unreliable = _unreliable(around, band, smooth, k)
            if method == AUTOMATIC and unreliable.any():
                some = around.part(np.flatnonzero(unreliable))
                limit = np.nan_to_num(seen.limit)[unreliable]
                for ends, beta in ((band, k), (middle, NODE)):
                    for end, sign in zip(ends, (-1.0, 1.0), strict=True):
                        drawn = _by_draws(some, end[unreliable], value, sign * beta)
                        end[unreliable] = np.minimum(drawn, limit)
                unreliable = np.zeros_like(unreliable)
            lower, upper = (_slant(around, end) for end in band)
            first, last = (_slant(around, end) for end in middle)
            std = _std_of_quantiles(first, slant, last)
        std = np.where(defined, std, np.nan)
        ranges.append(RangeAt(value, reach, slant, std, lower, upper, by_source, unreliable))
    return ranges


def _first_order_band(
    seen: Survey, slant: FloatArray, width: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the range ∓ a width, between 0 and the limit of the radar."""
    limit = _limits(seen)
    farthest = np.inf if limit is None else limit
    lower, upper = (np.clip(slant + sign * width, 0.0, farthest) for sign in (-1, 1))
    return lower, upper


def _std_of_quantiles(lower: FloatArray, middle: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the standard deviation (n,) of a function of a normal number, from three nodes."""
    mean = (lower + 4.0 * middle + upper) / 6.0
    variance = ((lower - mean) ** 2 + 4.0 * (middle - mean) ** 2 + (upper - mean) ** 2) / 6.0
    std: FloatArray = np.sqrt(variance)
    return std


def _unreliable(
    around: Rays, band: tuple[FloatArray, FloatArray], method: str, k: float
) -> NDArray[np.bool_]:
    """Return where (n,) the method is unreliable at one end of the band."""
    unreliable = np.zeros(len(around.bearing), dtype=bool)
    for end in band:
        exists = np.nan_to_num(end) > 0
        at = around.at(np.where(exists, end, FARTHEST))
        moments = propagate_scenario(at, method=method, beta=k)
        unreliable |= exists & unreliable_in_scenario(at, moments, method=method, beta=k)
    return unreliable


def _by_draws(around: Rays, end: FloatArray, value: float, beta: float) -> FloatArray:
    """Return how far (n,) a bound at Φ(β) reaches a value by draws, from how far it does by form.

    Newton's method for z of the bound over ln of the distance, with the slope by form.
    """
    moves = np.nan_to_num(end) > 0
    distance = np.where(moves, end, FARTHEST)

    def z(bound: FloatArray) -> FloatArray:
        limited: FloatArray = np.clip(ndtri(np.clip(bound, 0.0, 1.0)), -FAR, FAR)
        return limited

    for _ in range(NEWTON_STEPS):
        found = estimate(around.at(distance).states(), DRAWS, abs(beta))
        off = z(found.lower if beta < 0 else found.upper) - ndtri(value)
        ends = [around.at(distance * factor) for factor in (1.0 - WIDER, 1.0 + WIDER)]
        near, far = (z(distribution(at, "form").quantile(beta)) for at in ends)
        slope = (far - near) / np.log((1.0 + WIDER) / (1.0 - WIDER))
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where(slope < 0, -off / slope, 0.0)
        distance = distance * np.exp(np.clip(np.nan_to_num(step), -MOST_STEP, MOST_STEP))
    return np.where(moves, distance, end)


def _slope(around: Rays, distance: FloatArray) -> FloatArray:
    """Return the slope (n,) of P_D by slant range along each ray [1/m]."""
    ends = [distance * (1.0 + step) for step in (-_STEP, _STEP)]
    low, high = (around.p_d(end[:, np.newaxis])[:, 0] for end in ends)
    near, far = (around.slant_range(end) for end in ends)
    # for an aircraft very far above or below, both ends round to one slant range
    undefined = np.full_like(far, np.nan)
    slope: FloatArray = np.divide(high - low, far - near, out=undefined, where=far != near)
    return slope


def _slant(around: Rays, distance: FloatArray) -> FloatArray:
    """Return the slant ranges (n,) at distances (n,); 0 for 0, and NaN for NaN."""
    exists = np.nan_to_num(distance) > 0
    slant = around.slant_range(np.where(exists, distance, 1.0))
    return np.where(exists, slant, distance)


def _limits(seen: Survey) -> FloatArray | None:
    """Return the slant range (n,) of the limit of the radar; None if no limit is reached."""
    if seen.visible[:, -1].all():
        return None
    return _slant(seen.all_rays, np.nan_to_num(seen.limit))


def _summary(at: RangeAt) -> dict[str, Any]:
    """Return the numbers of the record for one P_D."""
    exists = at.slant > 0
    return {
        "least_m": float(at.slant.min()),
        "greatest_m": float(at.slant.max()),
        "largest_sigma_m": float(np.nanmax(at.std, initial=0.0)),
        "limited": int(np.count_nonzero(at.reach.limited)),
        "none": int(np.count_nonzero(~exists)),
        "no_value": int(np.count_nonzero(np.isnan([at.std, at.lower, at.upper]).any(axis=0))),
        "share": _shares(at),
    }


def _shares(at: RangeAt) -> dict[str, float]:
    """Return the share of each source in the variance of the range, averaged over the angles."""
    variances = {name: std**2 for name, std in at.by_source.items()}
    total = np.sum(list(variances.values()), axis=0)
    known = total > 0
    if not known.any():
        return {}
    return {name: float(np.mean(v[known] / total[known])) for name, v in variances.items()}


def _line(at: RangeAt, axis: Axis) -> str:
    """Describe the range for one P_D."""
    if not (at.slant > 0).any():
        return f"P_D {at.p_d:g}: at no range; sigma has no value"
    least, greatest = (int(f(at.slant)) for f in (np.argmin, np.argmax))
    words = f"P_D {at.p_d:g}: {at.slant[least] / 1e3:.4g} km at "
    if np.ptp(at.slant) > 1e-6 * at.slant[greatest]:
        words += f"{axis.at(least)} to {at.slant[greatest] / 1e3:.4g} km at {axis.at(greatest)}"
    else:
        words += f"every {axis.name}"
    return words


def _band(at: RangeAt, axis: Axis, k: float) -> list[str]:
    """Return the range and its band where the band is widest, and the sources of its width."""
    width = np.where(np.isnan(at.std), np.nan, at.upper - at.lower)
    if not np.isfinite(width).any():
        return []
    widest = int(np.argmax(reached(width)))
    if width[widest] <= ROUNDING * at.slant[widest]:
        return [f"P_D {at.p_d:g}: the band has no width"]
    middle, lower, upper = (x[widest] / 1e3 for x in (at.slant, at.lower, at.upper))
    words = (
        f"P_D {at.p_d:g}: {middle:.4g} km, between {lower:.4g} and {upper:.4g} km ({k:g} sigma), "
        f"where the band is widest, at {axis.at(widest)}"
    )
    shares = sorted(_shares(at).items(), key=lambda item: -item[1])
    sources = [f"{name} {share:.0%}" for name, share in shares if share >= 0.005]
    return [f"{words}; from {listed(sources)}" if sources else words]


def _exceptions(at: RangeAt, axis: Axis) -> list[str]:
    """Describe where there is no range, where a limit comes first, and where P_D rises again."""
    lines = []
    none = at.slant == 0
    if none.any() and not none.all():
        lines.append(
            f"P_D {at.p_d:g}: at no range {describe_poses(none, axis)}; sigma has no value"
        )
    far = at.slant >= 0.999 * FARTHEST
    limited = at.reach.limited & ~far
    if limited.any():
        place = describe_poses(limited, axis)
        lines.append(
            f"P_D {at.p_d:g}: the limit of the radar comes first {place}; sigma has no value"
        )
    lower, upper = (np.where(far, 0.0, bound) for bound in (at.lower, at.upper))  # said below
    values = {"sigma": at.std, "the lower bound": lower, "the upper bound": upper}
    for name, value in values.items():
        undefined = np.isnan(value) & ~limited & ~none
        if undefined.any():
            place = describe_poses(undefined, axis)
            lines.append(f"P_D {at.p_d:g}: {name} has no value {place}")
    again = at.reach.edges > 1
    if again.any():
        lines.append(
            f"P_D {at.p_d:g}: passed several times, at up to {at.reach.edges.max()} ranges, "
            f"{describe_poses(again, axis)}; the farthest is given"
        )
    if far.any():
        lines.append(
            f"P_D {at.p_d:g}: still higher at {FARTHEST / 1e3:g} km, the end of the search"
        )
    return lines


def _draw(
    figure: Figure,
    angle_deg: FloatArray,
    ranges: Mapping[str, Sequence[RangeAt]],
    limits: Mapping[str, FloatArray | None],
    by: str,
    title: str,
    label: str,
) -> None:
    """Draw ranges and bands around each radar."""
    from radar_sense import plotting

    width, count = plotting.nominal_width(figure), len(ranges)
    columns = min(count, int(width / (1.6 if count <= 6 else 1.1)))
    rows = -(-count // columns)
    plotting.set_height(figure, 3.3 if count == 1 else rows * (0.35 + min(width / columns, 1.75)))
    panels: Any = figure.subplots(rows, columns, squeeze=False, subplot_kw={"projection": "polar"})
    angle, styles = np.deg2rad(angle_deg), plotting.radar_styles(list(ranges))
    for panel, (name, of_radar) in zip(panels.flat, ranges.items(), strict=False):
        own = (
            [styles[name], *((styles[name][0], dashes) for _, dashes in plotting.LINES)]
            if name
            else plotting.LINES
        )
        for at, (colour, dashes) in zip(of_radar, own, strict=False):
            lower, reach, upper = (
                _closed(angle, values / 1e3) for values in (at.lower, at.slant, at.upper)
            )
            band = label if at is of_radar[0] else None
            panel.fill_between(
                reach[0], lower[1], upper[1], color=colour, alpha=0.22, lw=0, label=band
            )
            panel.plot(*reach, color=colour, ls=dashes, label=rf"$P_D$ = {at.p_d:g}")
        # the data set the radius, and not a limit far beyond them
        farthest = 1.15 * max(float(np.nanmax([at.slant, at.upper])) for at in of_radar) / 1e3
        limit = limits[name]
        if limit is not None and limit.min() / 1e3 < farthest:
            panel.plot(
                *_closed(angle, limit / 1e3),
                color="0.35",
                lw=plotting.points(0.8),
                ls=":",
                label="limit of the radar",
            )
        names = plotting.ASPECTS if by == ASPECT else plotting.BEARINGS
        radius = "" if count > 1 else "Slant range [km]"
        panel.set_rlim(0, farthest or 1.0)
        plotting.set_compass(panel, () if count > 1 else names, radius)
        if count > 1:
            panel.set_title(name, fontsize=plotting.points(8))
    for panel in panels.flat[count:]:
        panel.remove()
    unit = "slant range in km, " if count > 1 else ""
    plotting.draw_legend(figure, panels.flat[0], title=unit + title)


def _closed(angle: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return angles and values; of a full circle with the first point again at the end."""
    step = angle[1] - angle[0] if len(angle) > 1 else 0.0
    if not math.isclose(len(angle) * step, 2 * math.pi, rel_tol=1e-6):
        return angle, values
    return np.append(angle, angle[0] + 2 * math.pi), np.append(values, values[0])
