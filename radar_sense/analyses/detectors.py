"""P_D of every detector, the error of North's approximation, and the integration of pulses."""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from radar_sense import options, plotting
from radar_sense.analyses.margin import INTEGRATING, OPTIONS, margin
from radar_sense.command import Axes, Figure, Result, Table, command
from radar_sense.errors import counted
from radar_sense.model.detectors import DETECTORS, Detector, Swerling2, linearize, required_snr
from radar_sense.scenario import Scenario
from radar_sense.words import describe_detector, describe_extreme, peak

#: Probabilities of false alarm of the table, besides the scenario's.
P_FAS = (1e-2, 1e-4, 1e-6, 1e-8, 1e-12)
#: Signal-to-noise ratios of the table [dB].
SNR_DB = np.linspace(-10.0, 30.0, 401)
#: Detectors that differ for a single pulse. Every other detector equals one of these.
DISTINCT = ("north", "marcum", "swerling1", "swerling3")
#: Numbers of integrated pulses.
PULSES = (1, 10, 100)
#: P_D whose signal-to-noise ratio is reported.
REQUIRED = (0.5, 0.9)


@command(
    options.ONE_RADAR,
    *OPTIONS,
    *(replace(option, needs=("p_d",)) for option in (options.LEVEL, options.METHOD, options.K)),
    examples=(
        "radar-sense detectors",
        "radar-sense detectors --p-d 0.9 --pulses 24",
        "radar-sense detectors my.yaml --p-d 0.9 --k 2",
    ),
)
def detectors(
    scenario: Scenario,
    *,
    p_d: float | None = None,
    pulses: int | None = None,
    k: float | None = None,
) -> Result:
    """P_D of every detector, the error of North's approximation, and the integration of pulses.

    With --p-d the SNR that a P_D needs, the margin that the radar has at the poses, and the terms
    that make its SNR.
    """
    if p_d is not None:
        return margin(scenario, p_d, pulses, k or 3.0)
    result = Result(scenario)
    p_fas = sorted({*P_FAS, *(model.p_fa for model in scenario.model.models)}, reverse=True)
    ratios = 10.0 ** (SNR_DB / 10.0)
    by_name = {
        name: np.concatenate([DETECTORS[name]().p_d(ratios, p_fa) for p_fa in p_fas])
        for name in DISTINCT
    }
    error = by_name["north"] - by_name["marcum"]
    snr_db = np.tile(SNR_DB, len(p_fas))

    add = result.table.add
    add("p_fa", np.repeat(p_fas, len(SNR_DB)), "Probability of false alarm.")
    add("snr_db", snr_db, "Signal-to-noise ratio of a single pulse.", "dB")
    for name, values in by_name.items():
        add(f"p_d_{name}", values, f"P_D by the detector {name}.")
    add("north_less_marcum", error, "P_D by North's approximation minus the exact P_D.")
    integrated = {  # P_D and its slope (P_fas, 2, ratios) by the number of pulses
        n: np.array([linearize(Swerling2(pulses=n), ratios, p_fa) for p_fa in p_fas])
        for n in PULSES
    }
    for n, both in integrated.items():
        meaning = f"P_D by Swerling 2 with {n} integrated pulses."
        add(f"p_d_swerling2_{n}", both[:, 0].ravel(), meaning)
    per_db = ratios * (np.log(10.0) / 10.0)
    for n, both in integrated.items():
        meaning = f"Derivative of P_D by the SNR in dB, for {n} pulses."
        add(f"dp_d_per_db_swerling2_{n}", (both[:, 1] * per_db).ravel(), meaning, "1/dB")

    worst = []
    for p_fa, errors in zip(p_fas, error.reshape(len(p_fas), -1), strict=True):
        i = int(np.argmax(abs(errors)))
        worst.append({"p_fa": p_fa, "error": float(errors[i]), "snr_db": float(SNR_DB[i])})
    snr = scenario.model.snr(scenario.aircraft, scenario.radar)
    of_radars = []
    for model, ratio in zip(scenario.model.models, snr.reshape(len(snr), -1).T, strict=True):
        north, exact = (DETECTORS[name]().p_d(ratio, model.p_fa) for name in DISTINCT[:2])
        of_radars.append(abs(north - exact))
    at_poses = peak(np.max(of_radars, axis=0), scenario.axis)
    required, lines = _required(scenario)
    result.summary |= {
        "largest_error_of_north": worst,
        "error_of_north_at_poses": at_poses,
        "required_snr": required,
    }
    result.report += [
        "largest error of North's approximation, P_D(north) - P_D(marcum):",
        *(f"  P_fa {w['p_fa']:<8g} {w['error']:+.4f} at {w['snr_db']:.1f} dB" for w in worst),
        f"largest error at the poses of this scenario: {describe_extreme(at_poses, scenario.axis)}",
        "required signal-to-noise ratio S of a pulse, and dP_D/dB there:",
        *lines,
    ]
    chosen = scenario.model.models[0].p_fa
    result.draw = partial(_draw, table=result.table, chosen=chosen)
    return result


def _required(scenario: Scenario) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the required S of all integrating detectors and of the radars' detectors, by P_fa.

    The lines for the terminal follow, one for each detector.
    """
    rows: list[dict[str, Any]] = []
    lines = []
    for p_fa in sorted({model.p_fa for model in scenario.model.models}, reverse=True):
        heads = "".join(f"{'P_D':>13} {p_d:<6g}" for p_d in REQUIRED)
        lines.append(f"  P_fa {p_fa:<8g}{'':22}{heads}")
        compared: list[Detector] = [cls(pulses=pulses) for cls in INTEGRATING for pulses in PULSES]
        for model in scenario.model.models:
            if model.p_fa == p_fa and model.detector not in compared:
                compared.append(model.detector)
        for detector in compared:
            name, cells = describe_detector(detector), ""
            for p_d in REQUIRED:
                snr = required_snr(detector, p_fa, p_d)
                snr_db = 10.0 * math.log10(snr) if snr else None
                _, slope = linearize(detector, np.asarray(snr), p_fa)
                per_db = float(slope) * snr * math.log(10.0) / 10.0
                cells += f"{'any':>20}" if snr_db is None else f"{snr_db:9.2f} dB {per_db:8.3f}"
                row = {"detector": name, "p_fa": p_fa, "p_d": p_d}
                rows.append({**row, "snr_db": snr_db, "dp_d_per_db": per_db})
            lines.append(f"    {name:<31}{cells}")
    return rows, lines


def _draw(figure: Figure, table: Table, chosen: float) -> None:
    """Draw P_D by detector, the error of North's approximation, and the slope of Swerling 2."""
    (top, bottom, slope) = plotting.panels(figure, 3)
    p_fas = np.unique(table["p_fa"])
    snr_db = table["snr_db"][table["p_fa"] == chosen]
    # The extreme P_fa are drawn only if their labels keep clear of the scenario's P_fa.
    extremes = [p for p in (P_FAS[0], P_FAS[-1]) if abs(np.log10(p) - np.log10(chosen)) > 1]
    for p_fa in (chosen, *extremes):
        for name, style in zip(DISTINCT, (("0.75", "-"), *plotting.LINES), strict=False):
            p_d = table[f"p_d_{name}"][table["p_fa"] == p_fa]
            label = re.sub("(?<=g)(?=[0-9])", " ", name.capitalize()) if p_fa == chosen else None
            plotting.draw_line(top, snr_db, p_d, style, label=label)
        # Labels are above the data. The scenario's label is higher, to avoid overlap.
        half = np.interp(0.5, table["p_d_marcum"][table["p_fa"] == p_fa], snr_db)
        place = (np.clip(half, -5, 25), 1.2 if p_fa == chosen else 1.07)
        top.annotate(
            f"$P_{{fa}}$ {_power_of_ten(p_fa)}", place, ha="center", fontsize=plotting.points(6.5)
        )
    for line in top.lines[:: len(DISTINCT)]:
        line.set_linewidth(plotting.points(3.5))  # North's line is under Marcum's line
    top.set_ylim(-0.04, 1.34)
    top.set_yticks(np.linspace(0, 1, 6))
    top.set_ylabel(r"$P_D$")
    # Grey and black, because colours stand for detectors in the upper panel.
    others = [p for p in p_fas[::-1] if p != chosen]
    dashes = itertools.cycle(dash for _, dash in (*plotting.LINES[:4], plotting.LINES[5]))
    styles = {p: ("0.45", dash) for p, dash in zip(others, dashes, strict=False)}
    for p_fa, style in {chosen: ("black", "-"), **styles}.items():
        error = table["north_less_marcum"][table["p_fa"] == p_fa]
        plotting.draw_line(bottom, snr_db, error, style, label=f"$P_{{fa}}$ {_power_of_ten(p_fa)}")
    bottom.set_ylabel("North less Marcum")
    _draw_slopes(slope, table, chosen)
    slope.set_xlabel("Signal-to-noise ratio $S$ of a pulse [dB]")
    slope.locator_params(axis="x", nbins=9)
    plotting.draw_legend(figure, top, bottom)


def _draw_slopes(axes: Axes, table: Table, p_fa: float) -> None:
    """Draw dP_D/dB of Swerling 2 by the number of pulses, with dots where P_D is 0.5."""
    rows = table["p_fa"] == p_fa
    snr_db = table["snr_db"][rows]
    slopes = {n: table[f"dp_d_per_db_swerling2_{n}"][rows] for n in PULSES}
    p_d = {n: table[f"p_d_swerling2_{n}"][rows] for n in PULSES}
    half = {n: np.interp(0.5, p_d[n], snr_db) for n in PULSES}
    for n, style in zip(
        PULSES, (plotting.LINES[1], plotting.LINES[0], plotting.LINES[3]), strict=True
    ):
        plotting.draw_line(axes, snr_db, slopes[n], style)
        if not p_d[n][0] < 0.5 < p_d[n][-1]:
            continue
        at_half = np.interp(half[n], snr_db, slopes[n])
        side = 1 if half[n] < 15.0 else -1  # where the label has room
        axes.plot(half[n], at_half, "o", color=style[0], markersize=plotting.points(4))
        text = f"{counted(n, 'pulse')}: {at_half:.3f}"
        plotting.note(axes, text, (half[n], at_half), 9.0 * side, 0.0, color=style[0])
        if n > 1:
            # One pulse, with the gain of integration added to the signal-to-noise ratio.
            gained, thin = snr_db - half[1] + half[n], plotting.points(0.7)
            plotting.draw_line(axes, gained, slopes[1], ("0.55", "-"), lw=thin)
    note = "dots: $P_D$ 0.5; thin: 1 pulse, gain in the radar constant"
    axes.set_title(note, loc="right", fontsize=plotting.points(6.5), pad=plotting.points(2))
    axes.set_xlim(SNR_DB[0], SNR_DB[-1])
    axes.set_ylim(0, 1.18 * max(values.max() for values in slopes.values()))
    plotting.from_zero(axes)
    axes.set_ylabel("d$P_D$/dB of Swerling 2")


def _power_of_ten(value: float) -> str:
    factor, exponent = f"{value:.1e}".split("e")
    power = f"10^{{{int(exponent)}}}"
    return f"${power}$" if factor == "1.0" else rf"${factor}\cdot {power}$"
