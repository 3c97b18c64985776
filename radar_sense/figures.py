"""From a result to its figure: one function for each analysis, one style for all.

The figures fit one column of a journal (3.5 in), are told apart by line style as well as by colour,
and have their legend beside the axes, not on the data. Matplotlib is used without pyplot, which
keeps no global state and loads faster.
"""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from radar_sense.analyses import DISTINCT, P_FAS, Result
from radar_sense.area import LEVELS
from radar_sense.axis import Axis
from radar_sense.convergence import ESTIMATORS, STATISTICS
from radar_sense.error_budget import parts_of
from radar_sense.montecarlo import WITHIN_3_SIGMA
from radar_sense.propagation import METHODS
from radar_sense.rcs_pattern import aspects, decibels, pattern
from radar_sense.rcs_table import TableRCS
from radar_sense.states import RADAR, FloatArray, sources

_STYLE: dict[Any, Any] = {
    "font.size": 8,
    "axes.labelsize": 8,
    "legend.fontsize": 7.5,
    "mathtext.fontset": "dejavusans",
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "grid.color": "0.88",
    "grid.linewidth": 0.5,
    "axes.axisbelow": True,
    "lines.linewidth": 1.2,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "legend.frameon": False,
    "legend.handlelength": 2.8,
    "pdf.fonttype": 42,  # real fonts: text in a PDF stays text
    "svg.hashsalt": "radar-sense",  # the same figure is the same bytes
    "savefig.dpi": 300,
}
_WIDTH = 3.5
_LEGEND_ROW = 0.16

#: Colours of differing lightness (Okabe and Ito's set) with a dash pattern each.
_LINES: tuple[tuple[str, Any], ...] = (
    ("#0072B2", "-"),
    ("#D55E00", (0, (5, 1.5))),
    ("#009E73", (0, (1.2, 1.2))),
    ("#CC79A7", (0, (5, 1.5, 1.2, 1.5))),
    ("#56B4E9", (0, (8, 2))),
    ("#E69F00", (0, (3, 1, 1.2, 1, 1.2, 1))),
)
_BAND = _LINES[1]
_HAIR = "0.7"
#: Lines of more points than this are thinned: a million take a minute and 10 MB to draw. A page has
#: room for no more columns than these.
MOST_POINTS = 10_000
COLUMNS = 2_000


def _styles(*taken: tuple[str, Any]) -> Iterator[tuple[str, Any]]:
    """Styles for as many lines as there are, without those that are taken.

    After the first round colours come with other dashes, so that no two lines are alike.
    """
    colours, dashes = zip(*(style for style in _LINES if style not in taken), strict=True)
    for number in itertools.count():
        turn, place = divmod(number, len(colours))
        yield colours[place], dashes[(place + 2 * turn) % len(dashes)]


def draw(result: Result) -> Figure:
    """Draw the figure of a result."""
    with mpl.rc_context(_STYLE):
        return _FIGURES[result.analysis](result)


def render(figure: Figure, kind: str) -> bytes:
    """Encode a figure as png, pdf or svg; the same figure gives the same bytes."""
    undated: Mapping[str, Any] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}
    buffer = io.BytesIO()
    with mpl.rc_context(_STYLE):
        figure.savefig(buffer, format=kind, metadata=undated.get(kind))
    return buffer.getvalue()


def _variance(result: Result) -> Figure:
    figure, (axes,) = _new(1, result)
    table, x = result.table, _x(result)
    _line(axes, x, table["p_d"], ("black", "-"), label=r"$P_D$")
    names = result.scenario.model.names
    if len(names) > 1:  # where one radar is all there is, its line is on that of the network
        axes.lines[-1].set(linewidth=2.2, zorder=1.8)
    for name, style in zip(names if len(names) > 1 else (), _styles(_BAND), strict=False):
        _line(axes, x, table[f"p_d_{name}"], style, label=name)
        axes.lines[-1].set_linewidth(0.8)
    _fill(axes, x, table["lower_3sigma"], table["upper_3sigma"], color=_BAND[0], alpha=0.18, lw=0)
    _band(axes, x, table["lower_3sigma"], table["upper_3sigma"], result)
    if "threshold" in result.summary:
        _threshold(axes, x, result)
    axes.set_ylabel(r"Probability of detection $P_D$")
    _legend(figure, axes)
    return figure


def _threshold(axes: Axes, x: FloatArray, result: Result) -> None:
    """Mark the threshold of path planning, and where the bound is above it."""
    test = result.summary["threshold"]
    if test["bound"] != "upper_3sigma":
        bound = rf"bound at ${test['k']:g}\,\sigma$"
        _line(axes, x, result.table[test["bound"]], _LINES[3], label=bound)
    axes.axhline(test["p_max"], color="black", lw=0.8, ls=":", label=f"threshold {test['p_max']:g}")
    _shade(axes, result.table["violated"] > 0, x, label="violated")


def _mission(result: Result) -> Figure:
    table, x = result.table, _x(result)
    tracked = "track_p_d" in table
    figure, (top, *below) = _new(3 if tracked else 2, result)
    names = result.scenario.model.names
    radars = dict(zip(names if len(names) > 1 else (), _styles(_BAND, _LINES[0]), strict=False))
    for name, style in radars.items():
        looks = np.isfinite(table[f"p_d_{name}"])
        _line(top, x[looks], table[f"p_d_{name}"][looks], style, label=name)
        top.lines[-1].set_linewidth(0.8)
    if not radars:
        _line(top, x, table["p_d"], ("black", "-"), label=r"$P_D$ of a look")
        if len(x) <= 100:
            top.lines[-1].set(marker="o", markersize=1.8)
    top.set_ylabel(r"$P_D$ of a look")
    events = [("", "cumulative_p_d", r"Cumulative $P_D$"), ("track_", "track_p_d", "Track")]
    for axes, (before, column, name) in zip(below, events, strict=False):
        for radar, style in radars.items():
            _line(axes, x, table[f"{column}_{radar}"], style)
            axes.lines[-1].set_linewidth(0.8)
        if f"{before}mc_mean" in table:
            ends = table[f"{before}mc_lower"], table[f"{before}mc_upper"]
            _fill(axes, x, *ends, color="0.8", lw=0, label="Monte Carlo")
        _line(axes, x, table[column], _LINES[0], label="nominal")
        _band(axes, x, table[f"{before}lower_3sigma"], table[f"{before}upper_3sigma"], result)
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
    _legend(figure, *([top] if radars else []), *below[:1])
    return figure


def _montecarlo(result: Result) -> Figure:
    if result.monte_carlo is None:
        raise ValueError("a Monte Carlo figure needs the draws")
    mc, x = result.monte_carlo, _x(result)
    figure, (top, bottom) = _new(2, result)
    shown = len(mc.hairs)
    label = f"{mc.runs} runs" if shown == mc.runs else f"{shown} of {mc.runs} runs"
    _hairs(top, x, mc.hairs, label)
    _line(top, x, mc.band.p_d, ("black", "-"), label=r"nominal $\bar P_D$")
    _band(top, x, result.table["lower_3sigma"], result.table["upper_3sigma"], result)
    top.set_ylabel(r"$P_D$")
    _hairs(bottom, x, mc.hairs - mc.band.p_d, label)
    _band(bottom, x, mc.band.lower - mc.band.p_d, mc.band.upper - mc.band.p_d, result)
    bottom.set_ylabel(r"Error $P_D - \bar P_D$")
    _legend(figure, top)
    return figure


def _sensitivity(result: Result) -> Figure:
    figure, (axes,) = _new(1, result)
    levels = list(result.scenario.cov_radar)
    for i, level in enumerate(levels):
        values = result.table[f"three_sigma_{level}"]
        _line(axes, _x(result), values, _LINES[i % len(_LINES)], label=level)
    axes.set_ylabel(r"$3\,\sigma_{pd}$")
    _from_zero(axes)
    _legend(figure, axes)
    return figure


def _budget(result: Result) -> Figure:
    figure, (axes,) = _new(1, result)
    table, x = result.table, _x(result)
    every = sources(result.scenario.model.names)
    colours: dict[str, str] = {}
    for source, style in zip(every, _styles(), strict=False):
        label, colours[source] = source.replace("_", " "), style[0]
        _line(axes, x, table[f"three_sigma_{source}"], style, label=label)
    # What radar constants are made of, thin and in the colour of the source they belong to.
    parts = parts_of(result.scenario)
    for (name, of), (_, dashes) in zip(parts.items(), itertools.cycle(_LINES), strict=False):
        label = of.part.key if of.source == of.constant else f"{of.source} {of.part.key}"
        _line(axes, x, table[f"three_sigma_{name}"], (colours[of.source], dashes), label=label)
        axes.lines[-1].set_linewidth(0.6)
    _line(axes, x, table["three_sigma_total"], ("black", "-"), label="total")
    if len(result.scenario.model.names) > 1:
        axes.lines[-1].set(linewidth=2.2, zorder=1.8)
    axes.set_ylabel(r"$3\,\sigma_{pd}$")
    _from_zero(axes)
    _legend(figure, axes)
    return figure


def _compare(result: Result) -> Figure:
    figure, (top, bottom) = _new(2, result)
    table, x = result.table, _x(result)
    ends = {"lower": table["mc_lower"], "upper": table["mc_upper"]}
    _fill(top, x, ends["lower"], ends["upper"], color="0.8", lw=0, label="Monte Carlo")
    for method, style in zip(METHODS, _LINES, strict=False):
        for end, drawn in ends.items():
            label = method if end == "upper" else None
            _line(top, x, table[f"{end}_3sigma_{method}"], style, label=label)
            _line(bottom, x, table[f"{end}_3sigma_{method}"] - drawn, style)
    top.set_ylabel(r"Bounds of $P_D$ at $\Phi(\pm 3)$")
    bottom.set_ylabel("Bounds less those\nof Monte Carlo")
    _legend(figure, top)
    return figure


def _validate(result: Result) -> Figure:
    figure, (top, bottom) = _new(2, result)
    table, x = result.table, _x(result)
    for axes in (top, bottom):
        label = f"{result.method} validated" if axes is top else None
        _shade(axes, table["validated"] > 0, x, label=label)
    for end, style in zip(("lower", "upper"), _LINES, strict=False):
        with np.errstate(invalid="ignore"):  # 0/0 where a radar sees nothing: a gap in the line
            distance = table[f"distance_{end}"] / table["delta"]
        _line(top, x, distance, style, label=f"{end} bound")
    top.axhline(1.0, color="black", lw=0.8)
    top.set_yscale("log")
    top.set_ylabel(r"Distance from Monte Carlo [$\delta$]")
    expected = "99.73 %"
    bottom.axhline(100 * WITHIN_3_SIGMA, color="black", lw=0.8, label=expected)
    _fill(
        bottom,
        x,
        100 * table["coverage_low"],
        100 * table["coverage_high"],
        color=_LINES[2][0],
        lw=0.4,
        label="coverage (95 %)",
    )
    bottom.set_ylabel("Coverage [%]")
    _legend(figure, top, bottom)
    return figure


def _detectors(result: Result) -> Figure:
    figure, (top, bottom) = _new(2, result)
    table, chosen = result.table, result.scenario.model.models[0].p_fa
    p_fas = np.unique(table["p_fa"])
    snr_db = table["snr_db"][table["p_fa"] == chosen]
    # the scenario's, and the ends if their curves and labels are well away from it
    few = [p for p in (P_FAS[0], P_FAS[-1]) if abs(np.log10(p) - np.log10(chosen)) > 1]
    for p_fa in (chosen, *few):
        for name, style in zip(DISTINCT, (("0.75", "-"), *_LINES), strict=False):
            p_d = table[f"p_d_{name}"][table["p_fa"] == p_fa]
            label = re.sub("(?<=g)(?=[0-9])", " ", name.capitalize()) if p_fa == chosen else None
            _line(top, snr_db, p_d, style, label=label)
        # labels above the data, the scenario's higher, so that none is on another
        half = np.interp(0.5, table["p_d_marcum"][table["p_fa"] == p_fa], snr_db)
        place = (np.clip(half, -5, 25), 1.2 if p_fa == chosen else 1.07)
        top.annotate(f"$P_{{fa}}$ {_power_of_ten(p_fa)}", place, ha="center", fontsize=6.5)
    for line in top.lines[:: len(DISTINCT)]:
        line.set_linewidth(3.5)  # North's shows on both sides of Marcum's
    top.set_ylim(-0.04, 1.34)
    top.set_yticks(np.linspace(0, 1, 6))
    top.set_ylabel(r"$P_D$")
    # In grey, as colours are for the detectors; the scenario's in black.
    others = [p for p in p_fas[::-1] if p != chosen]
    dashes = [dash for _, dash in (*_LINES[:4], _LINES[5])]
    styles = {p: ("0.45", dash) for p, dash in zip(others, dashes, strict=False)}
    for p_fa, style in {chosen: ("black", "-"), **styles}.items():
        error = table["north_less_marcum"][table["p_fa"] == p_fa]
        _line(bottom, snr_db, error, style, label=f"$P_{{fa}}$ {_power_of_ten(p_fa)}")
    bottom.set_ylabel("North less Marcum")
    bottom.set_xlabel("Signal-to-noise ratio $S$ [dB]")
    bottom.xaxis.set_major_locator(MaxNLocator(nbins=9))
    _legend(figure, top, bottom)
    return figure


def _rcs(result: Result) -> Figure:
    scenario, model = result.scenario, result.scenario.model.rcs
    figure = Figure(figsize=(_WIDTH, 6.0), layout="constrained")
    grid = figure.add_gridspec(2, 1, height_ratios=(1.1, 1.0))
    polar: Any = figure.add_subplot(grid[0], projection="polar")
    plane = figure.add_subplot(grid[1])

    seen_azimuth, seen_elevation = aspects(scenario)
    middle = float(np.median(seen_elevation))
    azimuth = np.arange(-180.0, 180.25, 0.25)
    horizon, seen = (pattern(model, azimuth, np.array(e)) for e in (0.0, middle))
    top = max(horizon.max(), seen.max())
    # Deep nulls would leave no room for the rest, and a cross section of 0 has no decibels.
    floor = max(min(horizon.min(), seen.min()), 1e-5 * top)
    for sigma, label, style in (
        (horizon, "at the horizon", _LINES[0]),
        (seen, f"at elevation {middle:.1f} deg, as in the geometry", _LINES[1]),
    ):
        _line(polar, np.deg2rad(azimuth), decibels(np.maximum(sigma, floor)), style, label)
    low, high = decibels(np.array([floor, top]))
    margin = max(1.0, 0.05 * (high - low))
    polar.set_ylim(low - margin, high + margin)
    polar.set_theta_zero_location("N")  # the nose up, as seen from above
    polar.set_theta_direction(-1)
    polar.set_rlabel_position(65)
    polar.yaxis.set_major_locator(MaxNLocator(nbins=4))
    polar.set_xticks(np.deg2rad(np.arange(0, 360, 45)))
    polar.set_xticklabels(["nose 0", "45", "90", "135", "tail 180", "-135", "-90", "-45"])
    polar.set_ylabel("RCS [dBsm]", labelpad=24)

    azimuth, elevation = np.arange(-180.0, 180.5, 0.5), np.arange(-90.0, 91.0, 1.0)
    sigma = pattern(model, azimuth, elevation[:, np.newaxis])
    level = decibels(np.maximum(sigma, 1e-5 * sigma.max()))
    drawn = plane.pcolormesh(azimuth, elevation, level, shading="nearest", rasterized=True)
    bar = figure.colorbar(
        drawn, ax=plane, label="RCS [dBsm]", orientation="horizontal", aspect=40, pad=0.04
    )
    if np.ptp(level) > 0.1:
        contours = plane.contour(
            azimuth, elevation, level, 6, colors="white", linestyles="-", linewidths=0.3
        )
        bar.add_lines(contours)
    plane.plot(
        seen_azimuth, seen_elevation, ".", color=_BAND[0], ms=2.5, label="the radar in the geometry"
    )
    if isinstance(model, TableRCS) and model.elevation is not None:
        ends = np.rad2deg(model.elevation[[0, -1]])
        plane.hlines(
            ends, -180, 180, colors="black", linestyles="--", lw=0.8, label="ends of the table"
        )
    plane.set(xlim=(-180, 180), ylim=(-90, 90))
    plane.set(xticks=range(-180, 181, 45), yticks=range(-90, 91, 45))
    plane.set_xlabel("Azimuth in the body frame [deg]")
    plane.set_ylabel("Elevation [deg]")
    _legend(figure, polar, plane)
    return figure


def _convergence(result: Result) -> Figure:
    figure, panels = _panels(len(STATISTICS))
    table, runs = result.table, result.table["runs"]
    marks = dict(zip(ESTIMATORS, ("o", "s", "^", "D"), strict=True))
    names = ("the mean", r"$\sigma$", r"the $3\,\sigma$ quantiles")
    for axes, statistic, name in zip(panels, STATISTICS, names, strict=True):
        errors = {e: table[f"error_{statistic}_{e}"] for e in ESTIMATORS}
        for (estimator, error), style in zip(errors.items(), _LINES, strict=False):
            label = estimator.replace("sobol", "Sobol\N{PRIME}").replace("_", ", ")
            _line(axes, runs, error, style, label=label if axes is panels[0] else None)
            axes.lines[-1].set(marker=marks[estimator], markersize=2.8)
        axes.set_ylabel(f"Error of {name} [$\\sigma_{{pd}}$]")
        axes.set_xscale("log", base=2)
        axes.margins(x=0.03)
        first = [error[0] for error in errors.values() if np.all(error > 0)]
        if not first:
            continue  # nothing that a logarithmic axis could show
        axes.set_yscale("log")
        _slope(axes, runs, 1.6 * np.max(first), -0.5, "$n^{-1/2}$")
        if statistic != "quantile":  # which nothing brings to fall so fast
            _slope(axes, runs, np.min(first) / 1.6, -1.0, "$n^{-1}$")
    panels[-1].set_xlabel("Number of runs $n$")
    _legend(figure, panels[0])
    return figure


def _slope(axes: Axes, runs: FloatArray, start: float, power: float, name: str) -> None:
    """Draw what falls as a power of the number of runs, to compare the lines with."""
    if len(runs) < 2:
        return
    guide = start * (runs / runs[0]) ** power
    axes.plot(runs, guide, color="0.55", lw=0.7)
    middle, above = len(runs) // 2, power > -1
    axes.annotate(
        name,
        (runs[middle], guide[middle]),
        xytext=(0, 3 if above else -3),
        textcoords="offset points",
        ha="left" if above else "right",
        va="bottom" if above else "top",
        fontsize=6.5,
        color="0.35",
    )


def _map(result: Result) -> Figure:
    table, scenario = result.table, result.scenario
    north, east = table["north_m"] / 1e3, table["east_m"] / 1e3
    bounded = "upper_3sigma" in table
    # A figure has room for no more cells than this; lines through more would take long.
    every = max(1, -(-max(len(north), len(east)) // 1000))
    north, east = north[::every], east[::every]
    values = table["upper_3sigma" if bounded else "p_d"][::every, ::every]
    half = 0.5 * (east[1] - east[0]), 0.5 * (north[1] - north[0])
    extent = (east[0] - half[0], east[-1] + half[0], north[0] - half[1], north[-1] + half[1])
    shape = (extent[3] - extent[2]) / (extent[1] - extent[0])

    figure = Figure(figsize=(_WIDTH, min(8.0, 0.55 + 2.4 * shape)), layout="constrained")
    axes = figure.subplots()
    axes.grid(visible=False)
    # cividis is as light as it is high, so that it reads the same in grey
    image = axes.imshow(
        values, origin="lower", extent=extent, cmap="cividis", vmin=0, vmax=1, aspect="equal"
    )
    name = rf"Upper $3\,\sigma$ bound of $P_D$ ({scenario.level}, {result.method})"
    bar = figure.colorbar(
        image,
        ax=axes,
        label=name if bounded else r"Probability of detection $P_D$",
        extend="max" if np.nanmax(values, initial=0) > 1 else "neither",
        fraction=0.05,
        pad=0.03,
    )
    drawn = [v for v in LEVELS if np.nanmin(values, initial=1) < v < np.nanmax(values, initial=0)]
    if drawn:
        lines = axes.contour(
            east,
            north,
            values,
            drawn,
            colors=["white" if v < 0.6 else "black" for v in drawn],
            linestyles="-",
            linewidths=0.8,
        )
        if len(scenario.model.names) <= 3:  # else labels cover what they are about
            axes.clabel(lines, fmt="%g", fontsize=6.5)
        for v in drawn:
            bar.ax.axhline(v, color="white" if v < 0.6 else "black", lw=0.8)
    path_north, path_east = scenario.aircraft[:, 0] / 1e3, scenario.aircraft[:, 1] / 1e3
    _line(axes, path_east, path_north, (_BAND[0], "--"), label="path")
    radars = scenario.radar.reshape(-1, len(RADAR)) / 1e3
    axes.plot(
        radars[:, 1],
        radars[:, 0],
        "^",
        color="white",
        mec="black",
        mew=0.7,
        ms=5.5,
        label="radar" if len(radars) == 1 else "radars",
    )
    for name, radar in zip(scenario.model.names, radars, strict=False):
        axes.annotate(
            name,
            (radar[1], radar[0]),
            xytext=(4.5, 0),
            textcoords="offset points",
            va="center",
            fontsize=6.5,
            color="white",
            path_effects=[withStroke(linewidth=1.6, foreground="black")],
        )
    axes.set(xlim=extent[:2], ylim=extent[2:], xlabel="East [km]", ylabel="North [km]")
    _legend(figure, axes)
    # As the aspect is given, one round of layout can leave a label outside the page. (A map that is
    # flat has room for its labels, and would only get flatter.)
    if shape > 0.5:
        figure.draw_without_rendering()
    return figure


_FIGURES: Mapping[str, Callable[[Result], Figure]] = {
    "variance": _variance,
    "montecarlo": _montecarlo,
    "sensitivity": _sensitivity,
    "budget": _budget,
    "compare": _compare,
    "validate": _validate,
    "detectors": _detectors,
    "rcs": _rcs,
    "convergence": _convergence,
    "map": _map,
    "mission": _mission,
}


def _panels(count: int) -> tuple[Figure, list[Axes]]:
    """Make a figure with panels below each other that share an axis."""
    figure = Figure(figsize=(_WIDTH, 0.6 + 1.7 * count), layout="constrained")
    return figure, list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])


def _new(panels: int, result: Result) -> tuple[Figure, list[Axes]]:
    """Make a figure with panels below each other that share the axis of the poses."""
    figure, axes = _panels(panels)
    shown = _shown(result.scenario.axis)
    axes[-1].set_xlabel(shown.label)
    axes[-1].xaxis.set_major_locator(MaxNLocator(nbins=7, steps=shown.steps))
    for ax in axes:
        ax.margins(x=0)
    return figure, axes


class _Shown(NamedTuple):
    """How an axis is drawn: its label, the size of its unit in that of `Axis`, and its ticks."""

    label: str
    unit: float
    steps: Sequence[float]


_TENS = (1, 2, 2.5, 5, 10)
_SIXTIES = (1, 1.5, 2, 3, 5, 6, 10)
_DEGREES = (1, 1.5, 2, 3, 4.5, 6, 9, 10)


def _shown(axis: Axis) -> _Shown:
    """Choose the unit of an axis by how far it reaches."""
    span = float(np.ptp(axis.values))
    if axis.key == "time_s":
        units = (("h", 3600.0, _TENS), ("min", 60.0, _SIXTIES), ("s", 1.0, _SIXTIES))
        name, unit, steps = next(u for u in units if span >= 4 * u[1] or u[1] == 1)
        return _Shown(f"Time [{name}]", unit, steps)
    if axis.key == "distance_m":
        name, unit = ("km", 1e3) if span >= 4e3 else ("m", 1.0)
        return _Shown(f"Distance flown [{name}]", unit, _TENS)
    return _Shown(r"Radar azimuth $\theta_r$ [deg]", 1.0, _DEGREES)


def _x(result: Result) -> FloatArray:
    """Where the poses are drawn."""
    axis = result.scenario.axis
    return axis.values / _shown(axis).unit


def _spans(mask: NDArray[np.bool_], x: FloatArray) -> list[tuple[float, float]]:
    """Return the ranges of x where the mask holds, each reaching half way to the next pose."""
    middles = 0.5 * (x[1:] + x[:-1]) if len(x) > 1 else x
    lefts, rights = np.concatenate([x[:1], middles]), np.concatenate([middles, x[-1:]])
    if len(x) == 1:
        lefts, rights = x - 0.5, x + 0.5
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return [
        (float(lefts[a]), float(rights[b - 1]))
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]


def _shade(axes: Axes, mask: NDArray[np.bool_], x: FloatArray, label: str | None) -> None:
    """Shade where a mask holds: one artist for all ranges, and pixels if they are very many."""
    spans = [(left, right - left) for left, right in _spans(mask, x)]
    if spans:
        axes.broken_barh(
            spans,
            (0, 1),
            transform=axes.get_xaxis_transform(),
            color="0.9",
            lw=0,
            rasterized=len(spans) > COLUMNS,
            zorder=0.9,  # over the grid, under all data
            label=label,
        )


def _power_of_ten(value: float) -> str:
    factor, exponent = f"{value:.1e}".split("e")
    power = f"10^{{{int(exponent)}}}"
    return f"${power}$" if factor == "1.0" else rf"${factor}\cdot {power}$"


def _from_zero(axes: Axes) -> None:
    """Start the vertical axis so little below zero that a line at zero is still seen."""
    axes.set_ylim(bottom=-0.02 * axes.get_ylim()[1])


def _line(
    axes: Axes, x: FloatArray, y: FloatArray, style: tuple[str, Any], label: str | None = None
) -> None:
    colour, dashes = style
    marker = "o" if len(x) == 1 else None  # a line through one pose would show nothing
    few = thinned(x, y)
    axes.plot(
        x[few], y[few], color=colour, linestyle=dashes, marker=marker, markersize=3, label=label
    )


def _fill(axes: Axes, x: FloatArray, lower: FloatArray, upper: FloatArray, **style: Any) -> None:
    few = np.union1d(thinned(x, lower), thinned(x, upper))
    axes.fill_between(x[few], lower[few], upper[few], **style)


def thinned(x: FloatArray, y: FloatArray) -> NDArray[np.intp]:
    """Choose the points of a line that a page can show: all of them, if they are not too many.

    Of every run of points within one column these are the first, the last, the lowest and the
    highest, which draw the same pixels as all (U. Jugel, Z. Jerzak, G. Hackenbroich and V. Markl,
    "M4: a visualization-oriented time series data aggregation", PVLDB 7(10), 2014).

    Args:
        x: Coordinates (n,), in any order.
        y: Values (n,). A run of nothing but NaN stays a gap.

    Returns:
        Indices, increasing.
    """
    count = len(x)
    span = float(np.ptp(x)) if count else 0.0
    if count <= MOST_POINTS or not span > 0:
        return np.arange(count)
    column = np.floor((x - x.min()) * (COLUMNS / span))
    starts = np.flatnonzero(np.diff(column, prepend=-1.0))
    ends = np.append(starts[1:], count) - 1
    run = np.repeat(np.arange(len(starts)), ends - starts + 1)
    known = np.isfinite(y)
    lowest = np.lexsort((np.where(known, y, np.inf), run))[starts]
    highest = np.lexsort((np.where(known, y, -np.inf), run))[ends]
    return np.unique(np.concatenate([starts, lowest, highest, ends]))


def _band(axes: Axes, x: FloatArray, lower: FloatArray, upper: FloatArray, result: Result) -> None:
    linear = result.method == "linear"
    name = r"$\pm 3\,\sigma_{pd}$" if linear else rf"$\pm 3\,\sigma$ by {result.method}"
    label = f"{name} ({result.scenario.level})"
    _line(axes, x, upper, _BAND, label=label)
    _line(axes, x, lower, _BAND)


def _hairs(axes: Axes, x: FloatArray, rows: FloatArray, label: str) -> None:
    """Draw one thin line per run; as pixels, so that a vector file stays small."""
    points = np.stack([np.broadcast_to(x, rows.shape), rows], axis=-1)
    axes.add_collection(
        LineCollection(
            list(points), colors=_HAIR, linewidths=0.3, alpha=0.5, rasterized=True, label=label
        )
    )
    axes.autoscale_view()


def _widths(entries: Sequence[int], columns: int) -> list[int]:
    """Widths of the columns of a legend, which has the first of them longest."""
    short, longer = divmod(len(entries), columns)
    ends = list(itertools.accumulate([short + 1] * longer + [short] * (columns - longer)))
    return [max(entries[a:b]) for a, b in zip([0, *ends], ends, strict=False)]


def _legend(figure: Figure, *panels: Axes) -> None:
    """Put the legend above the axes, in as many columns as the longest label leaves room for."""
    handles, labels = [], []
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.append(handle)
            labels.append(label)
    width = [7 + len(re.sub(r"\\\w+|[\\${}_^]", "", label)) for label in labels]
    columns = min(3, max(1, 54 // max(width)))
    if len(labels) > 6:  # many: each column as wide as it must be
        columns = next(c for c in (3, 2, 1) if c == 1 or sum(_widths(width, c)) <= 54)
    # the figure grows with the legend, so that the axes keep their size
    figure.set_figheight(figure.get_figheight() + _LEGEND_ROW * -(-len(labels) // columns))
    legend = figure.legend(
        handles, labels, loc="outside upper center", ncols=columns, columnspacing=1.2
    )
    for handle, drawn in zip(handles, legend.legend_handles, strict=True):
        if isinstance(handle, LineCollection) and drawn is not None:
            drawn.set(linewidth=1.2, alpha=1.0)  # a single hair would hardly be seen
