"""The SNR that a P_D needs, the margin left at the poses, and the terms of the SNR: `detectors`."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.constants import Boltzmann
from scipy.special import ndtr, ndtri

from radar_sense import plotting, words
from radar_sense.axis import reached, widest_of_highest
from radar_sense.command import Figure, Option, Result
from radar_sense.covariance import variance_along
from radar_sense.errors import InputError
from radar_sense.limits import Limit
from radar_sense.model.detectors import (
    DETECTORS,
    PULSES,
    Detector,
    Marcum,
    North,
    PulseDetector,
    required_snr,
)
from radar_sense.model.geometry import radar_from_aircraft, slant_range
from radar_sense.model.normal import density
from radar_sense.model.radar import Radar
from radar_sense.model.radar_equation import NEPERS
from radar_sense.propagation import AUTOMATIC, band_of_scenario
from radar_sense.propagation.automatic import judged
from radar_sense.propagation.draws import Estimate
from radar_sense.propagation.staged import StagedDraws
from radar_sense.scenario import Scenario
from radar_sense.sources import SOURCE, sources_of
from radar_sense.states import CONSTANT, FloatArray

OPTIONS = (
    Option(
        "p_d",
        "Only the SNR that this P_D needs, the margin left, and the terms of the SNR.",
        Limit(above=0, below=1),
        metavar="P_D",
    ),
    Option("pulses", "Pulses integrated.", PULSES, default_text="the radar's", needs=("p_d",)),
)
#: The detectors that integrate pulses.
INTEGRATING = [d for d in dict.fromkeys(DETECTORS.values()) if issubclass(d, PulseDetector)]
#: Decibels of a unit of z. Φ(z) has the digits of margins up to 160 dB.
SPAN = 20.0
#: By how much a bound of a margin may be off [dB].
PRECISION_DB = 0.25
#: Least S of a margin, because a radar constant may be drawn as 0.
LEAST = 1e-20
#: The term that each source besides c_r and factors makes uncertain.
TERMS = {
    "aircraft_position": "range",
    "radar_position": "range",
    "aircraft_orientation": "aircraft_rcs",
    "aircraft_rcs": "aircraft_rcs",
}


@dataclass(frozen=True)
class Margin:
    """The margin over an SNR, in the place of a detector: z is the margin over `SPAN`.

    Every method of propagation then has the distribution of the margin. First order in z is first
    order in decibels.
    """

    needed_db: float = 0.0

    def p_d(self, snr: FloatArray, p_fa: float) -> FloatArray:
        """Return Φ(z) (...)."""
        return np.asarray(ndtr(self.linearize_probit(snr, p_fa)[0]))

    def linearize_probit(self, snr: FloatArray, p_fa: float) -> tuple[FloatArray, FloatArray]:
        """Return z (...) and dz/dS (...)."""
        snr = np.maximum(snr, LEAST)
        return (words.decibels(snr) - self.needed_db) / SPAN, 1.0 / (NEPERS * SPAN * snr)


def margin(scenario: Scenario, p_d: float, pulses: int | None, k: float) -> Result:
    """Return the SNR that a P_D needs, the margin left at the poses, and the terms of the SNR.

    The SNR that other detectors need is shown, too. Without a number of pulses, those of the
    radar's detector are integrated.

    Raises:
        InputError: If there are several radars, if P_D needs no signal, or if the detector of the
            radar cannot integrate.
    """
    if len(scenario.model.radars) > 1:
        raise InputError(f"'p_d' needs one radar: {words.listed(scenario.model.names, 'or')}")
    (radar,), axis, result = scenario.model.radars, scenario.axis, Result(scenario)
    p_fa, detector = radar.model.p_fa, _integrating(radar, pulses)
    least = max(p_fa, float(detector.p_d(np.zeros(()), p_fa)))
    if not p_d > (1.0 + 1e-9) * least:
        raise InputError(f"'p_d' must be above {least:.4g}, P_D without a signal; got {p_d:g}")

    def needed_db(detector: Detector) -> float:
        return 10.0 * math.log10(required_snr(detector, p_fa, p_d))

    needed = needed_db(detector)
    after = {name: needed_db(d) for name, d in _steps(detector).items()}
    count = int(getattr(detector, "pulses", 1))
    others = {words.describe_detector(d): needed_db(d) for d in (of(count) for of in INTEGRATING)}
    terms = snr_terms(scenario)
    left, lower, upper = _add_margin(result, terms["snr"][0], needed, k)
    meaning = "A term of the SNR in SI units, such as gain_dbi; snr is their sum."
    for name, (decibels, std) in terms.items():
        result.table.add(f"term_{name}", decibels, meaning, "dB")
        result.table.add(f"sigma_term_{name}", std, "Its standard deviation, first order.", "dB")
    result.summary |= {"p_d": p_d, "p_fa": p_fa, "detector": words.describe_detector(detector)}
    result.summary |= {"needed_db_after": after, "needed_db_by_fluctuation": others}
    pose = _report_margin(result, left, (lower, upper), k)
    changes = dict(zip(after, np.diff([0.0, *after.values()]).tolist(), strict=True))
    chain = (*changes.items(), ("needed", needed))
    result.report += [
        f"SNR that a pulse needs at P_fa {p_fa:g} [dB]:",
        *words.rows((name, f"{db:8.2f}") for name, db in chain),
        "by fluctuation, with a fixed threshold [dB]:",
        *words.rows((name, f"{db:8.2f}") for name, db in others.items()),
    ]
    at_pose = {
        name: (round(float(dbs[pose]), 9) + 0.0, float(std[pose]))  # + 0.0 makes -0 a 0
        for name, (dbs, std) in terms.items()
    }
    shown = ((n, f"{db:8.2f} {std:6.2f}") for n, (db, std) in at_pose.items() if db or std)
    result.report += [
        f"terms of the SNR at {axis.at(pose)}, and sigma to first order [dB]:",
        *words.rows(shown),
    ]
    title = f"$P_D$ {p_d:.12g}, least margin at {axis.at(pose)}; lines: ${k:g}\\,\\sigma$"
    bounds = float(lower[pose]), float(upper[pose])
    losses = [name for name in terms if name.endswith("_db")]
    losses += [factor.term for factor in radar.model.factors]
    result.draw = partial(
        _draw, terms=at_pose, losses=losses, changes=changes, margin=bounds, k=k, title=title
    )
    return result


def _report_margin(result: Result, left: FloatArray, bounds: Sequence[FloatArray], k: float) -> int:
    """Report the least and the largest margin over the poses (n,). Return the pose of the least.

    Of poses with equal margins it is that with the widest band, and its band is reported.
    """
    axis, p_d = result.scenario.axis, result.summary["p_d"]
    seen, width = ~np.isnan(left), bounds[1] - bounds[0]
    masks = {"least": reached(-left), "largest": reached(left)} if seen.any() else {}
    poses = {"least": widest_of_highest(-left, width), "largest": widest_of_highest(left, width)}
    for name, mask in masks.items():
        value, lower, upper = (float(values[poses[name]]) for values in (left, *bounds))
        place = {axis.key: axis.values[mask].tolist()}
        result.summary[f"{name}_margin_db"] = {"value": value, "band": [lower, upper], **place}
        if name == "largest" and mask.sum() == seen.sum():
            continue  # the least, too
        result.report.append(
            f"{name} margin for P_D {p_d:g}: {value:.2f} dB {words.describe_poses(mask, axis)}, "
            f"{_band_in_words(lower, upper)} ({k:g} sigma)"
        )
    if not seen.all():
        result.report.append(f"no margin {words.describe_poses(~seen, axis)}: beyond a limit")
    return poses["least"]


def _band_in_words(lower: float, upper: float) -> str:
    """Describe a band [dB], without an end where c_r may be 0, or the aircraft at the radar."""
    if np.isnan([lower, upper]).any() or np.isinf([lower, upper]).all():
        return "without a band"
    if lower == -np.inf:
        return f"at most {upper:.2f}"
    return f"between {lower:.2f} and {upper:.2f}" if upper < np.inf else f"at least {lower:.2f}"


def _integrating(radar: Radar, pulses: int | None) -> Detector:
    """Return the detector of a radar with another number of pulses."""
    detector = radar.model.detector
    if pulses is None:
        return detector
    if isinstance(detector, North):
        detector = Marcum()  # which North approximates for a single pulse
    if not isinstance(detector, PulseDetector):
        raise InputError(f"'pulses' needs a detector that integrates, got {detector!r}")
    if pulses > 1 and radar.sheet and radar.sheet.kind == "surveillance":
        raise InputError(f"'pulses' must be 1 with surveillance, a pulse a scan; got {pulses}")
    return dataclasses.replace(detector, pulses=pulses)


def _steps(detector: Detector) -> dict[str, Detector]:
    """Return detectors from a steady target and a single pulse to a detector, by what is new."""
    chain: list[Detector] = [Marcum(), detector]
    if isinstance(detector, PulseDetector):
        with_cfar = dataclasses.replace(detector, binary=None)
        plain = dataclasses.replace(with_cfar, cfar=None)
        chain[1:] = [Marcum(detector.pulses), plain, with_cfar, detector]
    steps: dict[str, Detector] = {"steady target, 1 pulse": chain[0]}
    for before, after in itertools.pairwise(chain):
        known = words.describe_detector(before).split(", ")
        new = [name for name in words.describe_detector(after).split(", ") if name not in known]
        steps |= {", ".join(new): after} if new else {}
    return steps


def _add_margin(
    result: Result, snr_db: FloatArray, needed_db: float, k: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Add the margin with its bounds (n,), by the scenario's method, and return the three."""
    scenario = result.scenario
    (radar,) = scenario.model.radars
    # the margin over the middle SNR, because a probability near 0 or 1 has few digits for draws
    middle = float(np.median(np.nan_to_num(snr_db, posinf=0.0, neginf=0.0)))
    model = dataclasses.replace(radar.model, detector=Margin(middle))
    radars = (dataclasses.replace(radar.without_limits(), model=model),)
    free = dataclasses.replace(scenario, radars=radars)
    lower, upper, off = _bounds(free, k)
    lower, upper = lower + (middle - needed_db), upper + (middle - needed_db)
    no_signal = lower + needed_db <= words.decibels(np.array(LEAST)) + 1e-6
    seen = scenario.model.visible(scenario.aircraft, scenario.radar)[:, 0]
    margins = snr_db - needed_db, np.where(no_signal, -np.inf, lower), upper
    left, lower, upper = (np.where(seen, values, np.nan) for values in margins)
    words.add_axis(result.table, scenario.axis)
    meaning = "SNR less the SNR that P_D needs; NaN beyond a limit."
    result.table.add("margin_db", left, meaning, "dB")
    for end, bound in (("lower", lower), ("upper", upper)):
        meaning = f"Its {end} {k:g}-sigma bound."
        result.table.add(f"{end}_{k:.12g}sigma_margin_db", bound, meaning, "dB")
    missing, axis, method = np.isnan(lower) | np.isnan(upper), scenario.axis, scenario.method
    without = f"the {method} band of the margin has no value"
    result.warnings += words.placed("no-value", seen & missing, axis, without)
    known, least = seen & off & ~missing, f"{PRECISION_DB:g} dB"
    by = f" by over {least}"
    result.warnings += words.band_off(known, axis, method, by, least, " of the margin")
    return left, lower, upper


def _bounds(free: Scenario, k: float) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return the bounds of the margin (n,) [dB], and where they are not right to `PRECISION_DB`.

    The scenario has a `Margin` as its detector.
    """
    automatic = free.method == AUTOMATIC
    smooth = {"linear": "probit", AUTOMATIC: "form"}.get(free.method, free.method)
    band = band_of_scenario(free, method=smooth, beta=k)
    bounds = np.stack([band.lower, band.upper])

    def of_margins(found: Estimate) -> tuple[FloatArray, ...]:
        drawn, errors = found.bounds
        small = density(ndtri(drawn)) * PRECISION_DB / SPAN
        return drawn, errors, small, small

    staged = StagedDraws.of_p_d(free.states(), k)
    drawn, confirmed, _ = judged(staged, tuple(bounds), of_margins, to_precision=automatic)
    if automatic:
        bounds = np.where(confirmed, bounds, drawn.bounds[0])
        _, errors, small, _ = of_margins(drawn)
        confirmed |= np.all(errors <= small, axis=0)
    lower, upper = SPAN * ndtri(bounds)
    return lower, upper, ~confirmed


def snr_terms(scenario: Scenario) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Return the terms of the SNR of the only radar at n poses, in decibels of SI units.

    Each term has values (n,) and standard deviations (n,) to first order. The last term, `snr`, is
    the sum of the others. A term of the data sheet has its tolerance, `range` the deviation from
    the positions, `aircraft_rcs` from orientation and cross section.
    """
    (radar,), constant = scenario.model.radars, float(scenario.radar[CONSTANT])
    sheet = radar.sheet if radar.sheet and radar.sheet.constant == constant else None
    rest = "radar_constant" if sheet is None else "rest_of_constant"
    parts = {} if sheet is None else sheet.terms()
    parts[rest] = 10.0 * math.log10(constant) - sum(parts.values())
    parts["boltzmann"] = -10.0 * math.log10(Boltzmann)
    std = {t.name: abs(t.slope) / NEPERS for t in scenario.tolerances[0]}
    if not std:
        std[rest] = math.sqrt(scenario.cov_radar[CONSTANT, CONSTANT]) / (constant * NEPERS)
    ones = np.ones(len(scenario.aircraft))
    terms = {name: (value * ones, std.get(name, 0.0) * ones) for name, value in parts.items()}

    states = scenario.states()
    snr_db = words.decibels(radar.model.snr(states.aircraft, states.radar))
    in_db = dataclasses.replace(radar.model, detector=Margin())
    _, by_aircraft, by_radar = in_db.linearize_probit(states.aircraft, states.radar)
    owners = {
        "aircraft": (by_aircraft, states.cov_aircraft),
        "radar": (by_radar, states.cov_radar),
    }
    uncertain = TERMS | {f"radar_{f.parameter}": f.term for f in radar.model.factors}
    variances = dict.fromkeys(uncertain.values(), 0.0 * ones)
    for name, source in sources_of(scenario, SOURCE).items():
        if term := uncertain.get(name):
            gradient, covariance = owners[source.owner]
            own = np.isin(np.arange(gradient.shape[1]), source.components)
            of_source = variance_along(np.where(own, gradient, 0.0), covariance)
            variances[term] = variances[term] + of_source
    distance = slant_range(scenario.aircraft, scenario.radar)
    values = {"range": -40.0 * np.log10(distance)}
    line = radar_from_aircraft(scenario.aircraft, scenario.radar)
    for factor in radar.model.factors:
        values[factor.term] = factor.nepers(line, np.zeros(())) / NEPERS
    values["aircraft_rcs"] = snr_db - sum(parts.values()) - sum(values.values())
    terms |= {name: (value, SPAN * np.sqrt(variances[name])) for name, value in values.items()}
    total = sum(variance_along(*owner) for owner in owners.values())
    return terms | {"snr": (snr_db, SPAN * np.sqrt(total))}


def _draw(
    figure: Figure,
    terms: Mapping[str, tuple[float, float]],
    losses: Sequence[str],
    changes: Mapping[str, float],
    margin: tuple[float, float],
    k: float,
    title: str,
) -> None:
    """Draw losses, SNR, SNR that is needed, and margin with its bounds, as bars of one chain."""

    def chain(changes: Mapping[str, float]) -> list[tuple[str, float, float]]:
        ends = np.cumsum([0.0, *changes.values()]).tolist()
        return list(zip(changes, ends, ends[1:], strict=False))

    (snr, of_snr), needed = terms["snr"], sum(changes.values())
    lost = {name: terms[name] for name in losses if any(terms[name])}
    stds = {name: std for name, (_, std) in lost.items()} | {"SNR": of_snr}
    rest = (std for name, (_, std) in terms.items() if name not in {*lost, "snr"})
    stds["SNR without losses"] = math.hypot(*rest)
    values = {name: loss for name, (loss, _) in lost.items()}
    supply = chain({"SNR without losses": snr - sum(values.values()), **values})
    bars = [*(supply if lost else ()), ("SNR", 0.0, snr), *chain(changes)]
    bars += [("SNR needed", 0.0, needed), ("margin", needed, snr)]
    blue, red, green = (colour for colour, _ in plotting.LINES[:3])
    colours = dict.fromkeys(lost, red) | dict.fromkeys(changes, blue)
    colours["margin"] = green if snr >= needed else red
    (axes,) = plotting.panels(figure, 1)
    plotting.set_height(figure, 0.75 + 0.19 * len(bars))
    for row, (name, start, end) in enumerate(bars):
        axes.barh(row, end - start, left=start, height=0.72, color=colours.get(name, "0.6"))
        around = k * stds.get(name, 0.0) * np.array([-1, 1])
        line = np.add(needed, margin) if name == "margin" else end + around
        axes.plot(line, [row, row], color="black", lw=plotting.points(0.8))
        beside = float(np.nanmax([0.0, start, *line])), row
        plotting.note(axes, f"{end - start:.1f}", beside, 3.0, 0.0)
    names = [name.removesuffix("_db").replace("_", " ") for name, *_ in bars]
    axes.set_yticks(range(len(bars)), names)
    axes.tick_params(axis="y", which="both", length=0)
    axes.grid(visible=False, axis="y")
    axes.invert_yaxis()
    low, high = axes.dataLim.intervalx
    axes.set_xlim(low - 0.05 * (high - low), high + 0.25 * (high - low))
    axes.set_xlabel("SNR of a pulse [dB]")
    axes.set_title(title, loc="right", fontsize=plotting.points(6.5), pad=plotting.points(2))
