"""Style and helpers of the figures; the only module that imports Matplotlib.

Figures fit one column of a journal (3.5 in). Lines differ by dashes as well as by colour. The
legend is outside the axes. Matplotlib is used without pyplot, which has global state and a slow
import.
"""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes as Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure as Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator as MaxNLocator
from numpy.typing import NDArray

from radar_sense.axis import Axis
from radar_sense.states import FloatArray

R = TypeVar("R")

STYLE: dict[Any, Any] = {
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
    "pdf.fonttype": 42,  # TrueType, which keeps text in a PDF searchable
    "svg.hashsalt": "radar-sense",  # the same figure must give the same bytes
    "savefig.dpi": 300,
}
WIDTH = 3.5
_LEGEND_ROW = 0.16
#: Colours of differing lightness (Okabe and Ito's set) with a dash pattern each.
LINES: tuple[tuple[str, Any], ...] = (
    ("#0072B2", "-"),
    ("#D55E00", (0, (5, 1.5))),
    ("#009E73", (0, (1.2, 1.2))),
    ("#CC79A7", (0, (5, 1.5, 1.2, 1.5))),
    ("#56B4E9", (0, (8, 2))),
    ("#E69F00", (0, (3, 1, 1.2, 1, 1.2, 1))),
)
BAND = LINES[1]
SAMPLE_PATH_COLOUR = "0.7"
#: Keeps white letters readable on light colours.
OUTLINE = (withStroke(linewidth=1.6, foreground="black"),)
#: Lines of more points than MOST_POINTS are thinned, because a million points take a minute and
#: 10 MB. A page resolves COLUMNS columns.
MOST_POINTS = 10_000
COLUMNS = 2_000


def styles(*taken: tuple[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield styles of lines, without the styles that are taken.

    After the first round each colour has another dash pattern.
    """
    colours, dashes = zip(*(style for style in LINES if style not in taken), strict=True)
    for number in itertools.count():
        turn, place = divmod(number, len(colours))
        yield colours[place], dashes[(place + 2 * turn) % len(dashes)]


def draw(plot: Callable[[R, Figure], None], result: R) -> Figure:
    """Return a new figure, drawn by an analysis' `plot` in the package's style."""
    with _style():
        figure = Figure(figsize=(WIDTH, WIDTH), layout="constrained")
        plot(result, figure)
    return figure


def render(figure: Figure, kind: str) -> bytes:
    """Return a figure as png, pdf or svg; the same figure gives the same bytes."""
    undated: Mapping[str, Any] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}
    buffer = io.BytesIO()
    with _style():
        figure.savefig(buffer, format=kind, metadata=undated.get(kind))
    return buffer.getvalue()


@contextmanager
def _style() -> Iterator[None]:
    """Apply the package's style to Matplotlib's defaults, without the user's settings."""
    kept = {"backend", "backend_fallback", "interactive", "toolbar", "timezone"}
    defaults = {key: value for key, value in mpl.rcParamsDefault.items() if key not in kept}
    with mpl.rc_context({**defaults, **STYLE}):
        yield


def contour_lines(
    x: FloatArray, y: FloatArray, values: NDArray[np.floating[Any]], level: float
) -> list[FloatArray]:
    """Return the contour lines of a level, each as x and y (n, 2).

    Args:
        x: Places of the columns (m,).
        y: Places of the rows (n,).
        values: Values (n, m); NaN where there is none.
        level: Value on the lines.
    """
    from contourpy import contour_generator  # Matplotlib's own generator

    lines = contour_generator(x, y, np.ma.masked_invalid(values)).lines(level)
    return [np.asarray(line, dtype=float) for line in lines]


def hex_colours(values: Sequence[float], name: str) -> list[str]:
    """Return colours as #rrggbb of values from 0 to 1; values outside have the end colours."""
    colours = mpl.colormaps[name](np.clip(values, 0.0, 1.0))
    return [mpl.colors.to_hex(colour) for colour in colours]


def panels(figure: Figure, count: int) -> list[Axes]:
    """Add panels below each other that share an axis."""
    figure.set_size_inches(WIDTH, 0.6 + 1.7 * count)
    return list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])


def pose_panels(figure: Figure, count: int, axis: Axis) -> list[Axes]:
    """Add panels below each other that share the axis of the poses."""
    axes = panels(figure, count)
    shown = display_unit(axis)
    axes[-1].set_xlabel(shown.label)
    axes[-1].xaxis.set_major_locator(MaxNLocator(nbins=7, steps=shown.steps))
    for ax in axes:
        ax.margins(x=0)
    return axes


class DisplayUnit(NamedTuple):
    """The label of an axis, its unit in units of `Axis`, and the steps of its ticks."""

    label: str
    unit: float
    steps: Sequence[float]


_TENS = (1, 2, 2.5, 5, 10)
_SIXTIES = (1, 1.5, 2, 3, 5, 6, 10)
_DEGREES = (1, 1.5, 2, 3, 4.5, 6, 9, 10)


def display_unit(axis: Axis) -> DisplayUnit:
    """Choose the unit of an axis by the span of its values."""
    span = float(np.ptp(axis.values))
    if axis.key == "time_s":
        units = (("h", 3600.0, _TENS), ("min", 60.0, _SIXTIES), ("s", 1.0, _SIXTIES))
        name, unit, steps = next(u for u in units if span >= 4 * u[1] or u[1] == 1)
        return DisplayUnit(f"Time [{name}]", unit, steps)
    if axis.key == "distance_m":
        name, unit = ("km", 1e3) if span >= 4e3 else ("m", 1.0)
        return DisplayUnit(f"Distance flown [{name}]", unit, _TENS)
    return DisplayUnit(r"Radar azimuth $\theta_r$ [deg]", 1.0, _DEGREES)


def pose_coordinates(axis: Axis) -> FloatArray:
    """Return the coordinates of the poses (n,) in the unit of the figure."""
    return axis.values / display_unit(axis).unit


def _spans(mask: NDArray[np.bool_], x: FloatArray) -> list[tuple[float, float]]:
    """Return the ranges of x where the mask holds, extended half way to the next pose."""
    middles = 0.5 * (x[1:] + x[:-1]) if len(x) > 1 else x
    lefts, rights = np.concatenate([x[:1], middles]), np.concatenate([middles, x[-1:]])
    if len(x) == 1:
        lefts, rights = x - 0.5, x + 0.5
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return [
        (float(lefts[a]), float(rights[b - 1]))
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]


def draw_shade(axes: Axes, mask: NDArray[np.bool_], x: FloatArray, label: str | None) -> None:
    """Shade the ranges where a mask holds, as pixels if there are too many ranges."""
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


def from_zero(axes: Axes) -> None:
    """Start the vertical axis slightly below zero, to keep a line at zero visible."""
    axes.set_ylim(bottom=-0.02 * axes.get_ylim()[1])


def draw_line(
    axes: Axes, x: FloatArray, y: FloatArray, style: tuple[str, Any], label: str | None = None
) -> None:
    """Draw a line in a style of `LINES`; a single pose as a dot."""
    colour, dashes = style
    marker = "o" if len(x) == 1 else None  # a line of one point is invisible
    kept = thinned(x, y)
    axes.plot(
        x[kept], y[kept], color=colour, linestyle=dashes, marker=marker, markersize=3, label=label
    )


def coloured_line(
    axes: Axes, x: FloatArray, y: FloatArray, values: FloatArray, colours: str, label: str
) -> None:
    """Draw a line with the colour of a value from 0 to 1 at each point; a single point as a dot.

    A black edge with a white rim keeps the line visible on a map of the same colours.
    """
    kept = thinned(x, y)
    points = np.column_stack([x, y])[kept]
    middles = 0.5 * (values[kept][1:] + values[kept][:-1])
    rims = [withStroke(linewidth=4.2, foreground="white"), withStroke(linewidth=3.2)]
    if len(points) == 1:
        axes.scatter(x, y, c=values, cmap=colours, vmin=0, vmax=1, s=16, ec="black", label=label)
        return
    line = LineCollection(
        list(np.stack([points[:-1], points[1:]], axis=1)),
        array=middles,
        cmap=colours,
        clim=(0, 1),
        linewidths=1.8,
        capstyle="round",
        rasterized=len(points) > COLUMNS,
    )
    axes.plot(points[:, 0], points[:, 1], color="black", lw=1.8, path_effects=rims, label=label)
    axes.add_collection(line)


def draw_fill(
    axes: Axes, x: FloatArray, lower: FloatArray, upper: FloatArray, **style: Any
) -> None:
    """Fill between two lines."""
    kept = np.union1d(thinned(x, lower), thinned(x, upper))
    axes.fill_between(x[kept], lower[kept], upper[kept], **style)


def thinned(x: FloatArray, y: FloatArray) -> NDArray[np.intp]:
    """Choose the points of a line that a page can show.

    Up to MOST_POINTS points are all kept. Of more points, each run within one column keeps the
    first, the last, the lowest and the highest. They draw the same pixels as all points (U. Jugel,
    Z. Jerzak, G. Hackenbroich and V. Markl, "M4: a visualization-oriented time series data
    aggregation", PVLDB 7(10), 2014).

    Args:
        x: Coordinates (n,), in any order.
        y: Values (n,). A run of NaN stays a gap.

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


def draw_band(axes: Axes, x: FloatArray, lower: FloatArray, upper: FloatArray, label: str) -> None:
    """Draw the ends of a band."""
    draw_line(axes, x, upper, BAND, label=label)
    draw_line(axes, x, lower, BAND)


def draw_sample_paths(axes: Axes, x: FloatArray, rows: FloatArray, label: str) -> None:
    """Draw one thin line per run, as pixels to keep a vector file small."""
    points = np.stack([np.broadcast_to(x, rows.shape), rows], axis=-1)
    axes.add_collection(
        LineCollection(
            list(points),
            colors=SAMPLE_PATH_COLOUR,
            linewidths=0.3,
            alpha=0.5,
            rasterized=True,
            label=label,
        )
    )
    axes.autoscale_view()


def _widths(entries: Sequence[int], columns: int) -> list[int]:
    """Return the widths of the columns of a legend. The first columns have the most rows."""
    short, longer = divmod(len(entries), columns)
    ends = list(itertools.accumulate([short + 1] * longer + [short] * (columns - longer)))
    return [max(entries[a:b]) for a, b in zip([0, *ends], ends, strict=False)]


def draw_legend(figure: Figure, *panels: Axes) -> None:
    """Put the legend above the axes, in the number of columns that the labels allow."""
    handles, labels = [], []
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.append(handle)
            labels.append(label)
    width = [7 + len(re.sub(r"\\\w+|[\\${}_^]", "", label)) for label in labels]
    columns = min(3, max(1, 54 // max(width)))
    if len(labels) > 6:  # columns of different widths leave room for more columns
        columns = next(c for c in (3, 2, 1) if c == 1 or sum(_widths(width, c)) <= 54)
    # The figure grows with the legend, to keep the size of the axes.
    figure.set_figheight(figure.get_figheight() + _LEGEND_ROW * -(-len(labels) // columns))
    legend = figure.legend(
        handles, labels, loc="outside upper center", ncols=columns, columnspacing=1.2
    )
    for handle, drawn in zip(handles, legend.legend_handles, strict=True):
        if isinstance(handle, LineCollection) and drawn is not None:
            drawn.set(linewidth=1.2, alpha=1.0)  # a thin line is invisible in the legend
