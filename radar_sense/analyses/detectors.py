"""P_D of every detector, and the error of North's approximation."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from radar_sense.analyses.columns import quantity
from radar_sense.analyses.contract import Result, analysis
from radar_sense.analyses.report import describe_extreme, peak
from radar_sense.model.detectors import DETECTORS
from radar_sense.scenario import Scenario

if TYPE_CHECKING:
    from radar_sense.plotting import Figure

#: Probabilities of false alarm of the table, besides the scenario's.
P_FAS = (1e-2, 1e-4, 1e-6, 1e-8, 1e-12)
#: Signal-to-noise ratios of the table [dB].
SNR_DB = np.linspace(-10.0, 30.0, 401)
#: Detectors that differ for a single pulse. Each other detector equals one of them.
DISTINCT = ("north", "marcum", "swerling1", "swerling3")


def _power_of_ten(value: float) -> str:
    factor, exponent = f"{value:.1e}".split("e")
    power = f"10^{{{int(exponent)}}}"
    return f"${power}$" if factor == "1.0" else rf"${factor}\cdot {power}$"


def plot(result: Result, figure: Figure) -> None:
    """Draw the figure."""
    from radar_sense.plotting import LINES, MaxNLocator, draw_legend, draw_line, pose_panels

    (top, bottom) = pose_panels(figure, 2, result.scenario.axis)
    table, chosen = result.table, result.scenario.model.models[0].p_fa
    p_fas = np.unique(table["p_fa"])
    snr_db = table["snr_db"][table["p_fa"] == chosen]
    # The extreme P_fa are drawn only if their labels keep clear of the scenario's P_fa.
    extremes = [p for p in (P_FAS[0], P_FAS[-1]) if abs(np.log10(p) - np.log10(chosen)) > 1]
    for p_fa in (chosen, *extremes):
        for name, style in zip(DISTINCT, (("0.75", "-"), *LINES), strict=False):
            p_d = table[f"p_d_{name}"][table["p_fa"] == p_fa]
            label = re.sub("(?<=g)(?=[0-9])", " ", name.capitalize()) if p_fa == chosen else None
            draw_line(top, snr_db, p_d, style, label=label)
        # Labels are above the data. The scenario's label is higher, to avoid overlap.
        half = np.interp(0.5, table["p_d_marcum"][table["p_fa"] == p_fa], snr_db)
        place = (np.clip(half, -5, 25), 1.2 if p_fa == chosen else 1.07)
        top.annotate(f"$P_{{fa}}$ {_power_of_ten(p_fa)}", place, ha="center", fontsize=6.5)
    for line in top.lines[:: len(DISTINCT)]:
        line.set_linewidth(3.5)  # North's line must be visible under Marcum's
    top.set_ylim(-0.04, 1.34)
    top.set_yticks(np.linspace(0, 1, 6))
    top.set_ylabel(r"$P_D$")
    # Grey and black, because colours stand for detectors in the upper panel.
    others = [p for p in p_fas[::-1] if p != chosen]
    dashes = [dash for _, dash in (*LINES[:4], LINES[5])]
    styles = {p: ("0.45", dash) for p, dash in zip(others, dashes, strict=False)}
    for p_fa, style in {chosen: ("black", "-"), **styles}.items():
        error = table["north_less_marcum"][table["p_fa"] == p_fa]
        draw_line(bottom, snr_db, error, style, label=f"$P_{{fa}}$ {_power_of_ten(p_fa)}")
    bottom.set_ylabel("North less Marcum")
    bottom.set_xlabel("Signal-to-noise ratio $S$ [dB]")
    bottom.xaxis.set_major_locator(MaxNLocator(nbins=9))
    draw_legend(figure, top, bottom)


_TABLE = (
    quantity("p_fa", "Probability of false alarm."),
    quantity("snr_db", "Signal-to-noise ratio of a single pulse."),
    quantity("p_d_<detector>", "P_D by the detector <detector>."),
    quantity("north_less_marcum", "P_D by North's approximation less the exact P_D."),
)


@analysis(
    plot=plot,
    columns=_TABLE,
    options=[],
    examples=[
        "radar-sense detectors",
        "radar-sense detectors my.yaml --format png",
    ],
)
def detectors(scenario: Scenario) -> Result:
    """P_D of every detector, and the error of North's approximation."""
    p_fas = sorted({*P_FAS, *(model.p_fa for model in scenario.model.models)}, reverse=True)
    p_d = {
        name: np.concatenate(
            [DETECTORS[name]().p_d(10.0 ** (SNR_DB / 10.0), p_fa) for p_fa in p_fas]
        )
        for name in DISTINCT
    }
    error = p_d["north"] - p_d["marcum"]
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
    return Result(
        scenario=scenario,
        table={
            "p_fa": np.repeat(p_fas, len(SNR_DB)),
            "snr_db": np.tile(SNR_DB, len(p_fas)),
            **{f"p_d_{name}": values for name, values in p_d.items()},
            "north_less_marcum": error,
        },
        summary={"largest_error_of_north": worst, "error_of_north_at_poses": at_poses},
        report=(
            "largest error of North's approximation, P_D(north) - P_D(marcum):",
            *(f"  P_fa {w['p_fa']:<8g} {w['error']:+.4f} at {w['snr_db']:.1f} dB" for w in worst),
            f"largest error at the poses of this scenario: "
            f"{describe_extreme(at_poses, scenario.axis)}",
        ),
        warnings=(),
    )
